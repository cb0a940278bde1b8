"""The linear algebra of tiny matrices, against LAPACK; also of the singular and indefinite ones that solves meet."""

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend.core import jaxprs_in_params

from jaxmyo import compiler, linear, tiny


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


def test_inverse_where_two_rows_compete() -> None:
    """Of bodies alike in x and y, two rows have the same pivot but for round-off: each loop of XLA must take the same.

    (If it is computed anew in some of them, a few of a thousand inverses are of no use at all.)
    """
    a, b, c, d, e, f = np.random.default_rng(0).standard_normal((6, 4000))
    A = np.moveaxis(np.array([[a, b, c, d], [b, a, c, d], [c, c, e, f], [d, d, f, 0.0 * a]]), -1, 0)
    A = A[np.linalg.cond(A) < 1e4]
    exact = np.linalg.inv(A)
    as_users_run_it = compiler.LEAN | {"xla_backend_optimization_level": "3"}
    inverse = jax.jit(lambda A: tiny.invert(A).inverse, compiler_options=as_users_run_it)
    found = np.array([inverse(a) for a in A])
    np.testing.assert_array_less(np.abs(found - exact).max((1, 2)), 1e-11 * np.abs(exact).max((1, 2)))


def test_inverses_in_float32_of_a_batch() -> None:
    """Under `vmap` a loop is batched after its body was traced, when float64 is the default again."""

    def twice(A: Any) -> Any:
        with jax.enable_x64(False):
            return jax.lax.fori_loop(0, 2, lambda _, A: tiny.invert(A).inverse, A)

    A = jnp.asarray(np.eye(3) + np.random.default_rng(0).uniform(size=(4, 3, 3)), dtype="float32")
    found = jax.vmap(jax.jit(twice))(A)
    assert found.dtype == "float32"
    np.testing.assert_allclose(found, A, rtol=1e-4)


def test_batches_of_larger_matrices_are_solved_one_by_one() -> None:
    """A batched call of LAPACK may wait for XLA's threads for ever (jaxlib 0.10): there is none, at any level."""
    rng, n = np.random.default_rng(0), tiny.ROWS + 3
    K, b = rng.normal(size=(5, n, n)), rng.normal(size=(5, 4, n))

    def solve(K: Any, b: Any) -> Any:
        factors = linear.factors(K)
        return jax.vmap(lambda b: factors.solve(b, None))(b), factors.sign

    x, sign = jax.jit(jax.vmap(solve))(K, b)
    np.testing.assert_allclose(x, np.einsum("sij,skj->ski", np.linalg.inv(K), b), rtol=1e-9)
    np.testing.assert_array_equal(sign, np.sign(np.linalg.det(K)))

    def rows(jaxpr: Any) -> Iterator[tuple[str, int]]:
        for eqn in jaxpr.eqns:
            yield eqn.primitive.name, len(getattr(eqn.invars[0].aval, "shape", ())) if eqn.invars else 0
            for inner in jaxprs_in_params(eqn.params):
                yield from rows(inner)

    found = [r for r in rows(jax.make_jaxpr(jax.vmap(solve))(K, b).jaxpr) if r[0] in ("lu", "triangular_solve")]
    assert {name for name, _ in found} == {"lu", "triangular_solve"}
    assert {rank for _, rank in found} == {2}
