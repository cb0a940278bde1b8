"""Linear algebra of matrices with a few rows, for batches of them: elementwise work that runs in every thread.

A batched call of LAPACK costs more than such a matrix, and blocks one of XLA's threads.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxmyo.lanes import batch_last, constant, once

#: Rows up to which a matrix is tiny [–].
ROWS = 8


class Inverse(NamedTuple):
    """The inverse (n, n) of a matrix, and the sign of its determinant, ±1."""

    inverse: Array
    sign: Array

    def solve(self, b: Array, accuracy: Any, guess: Array | None = None) -> Array:
        """The solution x (n,) of A x = b; direct, whatever the accuracy asked for."""
        return jnp.sum(self.inverse * b[None], axis=1)


@batch_last
def invert(A: Array) -> Inverse:
    """By Gauss–Jordan elimination with row pivoting; not finite where A (n, n, *lanes) is singular."""
    n, lanes = len(A), A.ndim - 2
    M = jnp.concatenate([A, jnp.broadcast_to(constant(np.eye(n), lanes), A.shape)], axis=1)
    sign = jnp.ones(A.shape[2:], A.dtype)
    for k in range(n):
        best, largest = jnp.zeros(A.shape[2:], int), jnp.abs(M[k, k])
        for i in range(k + 1, n):
            larger = jnp.abs(M[i, k]) > largest
            best, largest = jnp.where(larger, i, best), jnp.where(larger, jnp.abs(M[i, k]), largest)
        best = once(best)  # of rows that are equal but for round-off, two loops of XLA might choose each their own
        row = M[k]
        for i in range(k + 1, n):
            row = jnp.where((best == i)[None], M[i], row)
        pivot = row[k]
        row = once(row / pivot[None])
        below = [jnp.where((best == i)[None], M[k], M[i]) for i in range(k + 1, n)]
        M = jnp.stack([row if i == k else x - x[k][None] * row for i, x in enumerate([*M[: k + 1], *below])])
        sign = sign * jnp.sign(pivot) * jnp.where(best > k, -1.0, 1.0)
    return Inverse(M[:, n:], sign)


def tridiagonal(A: Array) -> tuple[Array, Array]:
    """The diagonal (n,) and the one beside it (n − 1,) of a matrix similar to a symmetric one, by Householder."""
    n = len(A)
    rows = jnp.arange(n)

    def reflect(k: Array, A: Array) -> Array:
        under = jnp.where(rows > k + 1, _pick(rows == k, A), 0.0)
        first = _pick(rows == k, _pick(rows == k + 1, A))
        rest = jnp.sum(under**2)
        length = jnp.sqrt(first**2 + rest)
        v = _put(rows == k + 1, under, first + jnp.where(first < 0.0, -length, length))
        square = jnp.sum(v**2)
        v = v * jnp.sqrt(2.0 / jnp.where(rest > 0.0, square, jnp.inf))  # H = I − v vᵀ; nothing to do where rest = 0
        Av = jnp.sum(A * v[None], axis=1)
        w = Av - 0.5 * jnp.sum(v * Av) * v
        return A - v[:, None] * w[None] - w[:, None] * v[None]

    A = jax.lax.fori_loop(0, n - 2, reflect, A)
    return jnp.diagonal(A), jnp.diagonal(A, 1)


def eigenvalues_below(diagonal: Array, beside: Array, limits: Array) -> Array:
    """How many eigenvalues of a symmetric tridiagonal matrix are below each limit (m,), by Sturm sequences: (m,)."""
    least = jnp.finfo(diagonal.dtype).tiny

    def term(at: tuple[Array, Array], row: tuple[Array, Array]) -> tuple[tuple[Array, Array], None]:
        count, last = at
        q = row[0] - limits - row[1] ** 2 / jnp.where(jnp.abs(last) < least, -least, last)
        return (count + (q < 0.0).astype(count.dtype), q), None

    start = jnp.zeros(len(limits), dtype=int), jnp.ones_like(limits)
    (count, _), _ = jax.lax.scan(term, start, (diagonal, jnp.concatenate([jnp.zeros(1), beside])))
    return count


def _pick(one: Array, x: Array) -> Array:
    """The row of x at the one place that is true; of a loop's index, too."""
    return jnp.sum(jnp.where(one.reshape(-1, *(1,) * (x.ndim - 1)), x, 0.0), axis=0)


def _put(one: Array, x: Array, row: Array) -> Array:
    """x with a row at the one place that is true."""
    return jnp.where(one.reshape(-1, *(1,) * (x.ndim - 1)), row[None], x)
