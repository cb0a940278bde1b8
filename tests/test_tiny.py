"""The linear algebra of tiny matrices, against LAPACK; also of the singular and indefinite ones that solves meet."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmyo import tiny


def matrices(n: int, count: int) -> Any:
    """Random symmetric matrices (count, n, n), some with a row of zeros, some saddle points, some of low rank."""
    rng = np.random.default_rng(n)
    A = rng.normal(size=(count, n, n))
    A = A + A.swapaxes(1, 2)
    A[: count // 4, 0] = A[: count // 4, :, 0] = 0.0
    if n > 1:
        A[count // 4 : count // 2, -1] = A[count // 4 : count // 2, :, -1] = 0.0
        A[count // 4 : count // 2, -1, 0] = A[count // 4 : count // 2, 0, -1] = 1.0
    v = rng.normal(size=(count // 4, n, 1 + n // 3))
    A[count // 2 : count // 2 + count // 4] = v @ v.swapaxes(1, 2)
    return A


@pytest.mark.parametrize("n", range(1, tiny.ROWS + 1))
def test_inertia(n: int) -> None:
    A = matrices(n, 200)
    limits = 1e-11 * np.array([-1.0, 1.0])
    found = jax.jit(jax.vmap(lambda A: tiny.eigenvalues_below(*tiny.tridiagonal(A), jnp.asarray(limits))))(A)
    exact = (np.linalg.eigvalsh(A)[:, :, None] < limits).sum(axis=1)
    np.testing.assert_array_equal(found, exact)


@pytest.mark.parametrize("n", range(1, tiny.ROWS + 1))
def test_inverse(n: int) -> None:
    A = matrices(n, 200)
    regular = np.abs(np.linalg.eigvalsh(A)).min(axis=1) > 1e-3
    found = jax.jit(jax.vmap(tiny.invert))(A)
    np.testing.assert_allclose(
        found.inverse[regular] @ A[regular], np.broadcast_to(np.eye(n), A[regular].shape), atol=1e-11
    )
    np.testing.assert_array_equal(found.sign[regular], np.sign(np.linalg.det(A[regular])))
    b = np.arange(1.0, n + 1.0)
    x = tiny.invert(jnp.asarray(A[regular][0])).solve(jnp.asarray(b), 0.0)
    np.testing.assert_allclose(A[regular][0] @ x, b, atol=1e-11 * n)
