"""Linear algebra of matrices with a few rows, for batches of them: elementwise work that runs in every thread.

A batched call of LAPACK costs more than such a matrix, and blocks one of XLA's threads.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

#: Rows up to which a matrix is tiny [–].
ROWS = 8


class Inverse(NamedTuple):
    """The inverse (n, n) of a matrix, and the sign of its determinant, ±1."""

    inverse: Array
    sign: Array

    def solve(self, b: Array, accuracy: Any, guess: Array | None = None) -> Array:
        """The solution x (n,) of A x = b; direct, whatever the accuracy asked for."""
        return jnp.sum(self.inverse * b[None], axis=1)


def invert(A: Array) -> Inverse:
    """By Gauss–Jordan elimination with row pivoting; not finite where A is singular."""
    n = len(A)
    rows, columns = jnp.arange(n), jnp.arange(2 * n)

    def eliminate(k: Array, at: tuple[Array, Array]) -> tuple[Array, Array]:
        M, sign = at
        column = _pick(columns == k, M.T)
        best = jnp.argmax(jnp.where(rows >= k, jnp.abs(column), -1.0))
        is_best, is_top = rows == best, rows == k
        pivot, row = _pick(is_best, column), _pick(is_best, M)
        M, column = _put(is_best, M, _pick(is_top, M)), _put(is_best, column, _pick(is_top, column))
        row = row / pivot
        M = _put(is_top, M - column[:, None] * row[None], row)
        return M, sign * jnp.sign(pivot) * jnp.where(best == k, 1.0, -1.0)

    beside = jnp.concatenate([A, jnp.eye(n, dtype=A.dtype)], axis=1)
    M, sign = jax.lax.fori_loop(0, n, eliminate, (beside, jnp.ones((), A.dtype)))
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
