"""Multigrid for bodies that no direct factors could hold: its matrices and cycles, and products without a matrix."""

from collections.abc import Callable

import numpy as np
import pytest
import scipy.sparse as sp
from test_sparse import SOFT, filled_tube, follower_loads, neo_hookean, tube_in_its_coordinates

import jaxmyo as jm
from jaxmyo import mkl, multigrid, saddle, sparse
from jaxmyo.multigrid import Multigrid

pytest.importorskip("pyamg")


@pytest.mark.parametrize("states", [follower_loads, tube_in_its_coordinates, filled_tube])
def test_the_product_without_a_matrix_is_that_of_the_tangent(states: Callable[[], list[jm.State]]) -> None:
    C = states()[-1]
    of = sparse.Sparse(C.system)
    rng = np.random.default_rng(0)
    z = 1e-3 * rng.normal(size=C.system.size)
    K = of.tangent(z, C.inputs)
    x = rng.normal(size=C.system.n_u + of.n_m)
    by_matrix = saddle.augmented(K, of.pattern.product(K.data))(x)
    found = of.assembly.product(of._displacements(z, C.inputs), z, C.inputs, x)
    np.testing.assert_allclose(found, by_matrix, atol=1e-13 * np.max(np.abs(by_matrix)))


def cycles(n: int, monkeypatch: pytest.MonkeyPatch) -> tuple[Multigrid, sparse.Sparse]:
    """Those of ∫ |∂F|² of a block of n³ elements, clamped at a face."""
    monkeypatch.setattr(multigrid, "COARSEST", 60)
    clamps = tuple(jm.Displacement("x0", axis) for axis in "xyz")
    scene = jm.Scene(jm.box((1.0, 1.2, 0.8), (n, n, n)), neo_hookean, SOFT, supports=clamps)
    of = sparse.Sparse(jm.contract(scene, T0=0.0, a_over_D=None).system)
    solver = Multigrid(of.pattern, of._rigid)
    solver.factorise(of._metric)
    return solver, of


@pytest.mark.parametrize("n", [5, 8])
def test_a_cycle_is_symmetric_and_leaves_a_fraction_of_the_error_whatever_the_mesh(
    n: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    solver, of = cycles(n, monkeypatch)
    A = of.pattern.full(of._metric)
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(2, A.shape[0]))
    np.testing.assert_allclose(x @ solver.solve(y), y @ solver.solve(x), rtol=1e-4)
    error = x
    for _ in range(5):
        last, error = error, error - solver.solve(A @ error)
    assert np.sqrt((error @ A @ error) / (last @ A @ last)) < 0.35
    assert solver.inertia == (-1, -1)
    assert not solver.sharpen()
    np.testing.assert_allclose(multigrid.symmetric(of.pattern, of._metric)(x), A @ x, atol=1e-5 * np.abs(A @ x).max())


def test_a_matrix_of_mkl_multiplies_as_one_of_scipy() -> None:
    pytest.importorskip("pypardiso")
    rng = np.random.default_rng(0)
    dense = rng.normal(size=(12, 18)) * (rng.random((12, 18)) < 0.3)
    x = rng.normal(size=18).astype(np.float32)
    for matrix in (
        sp.csr_matrix(dense),
        sp.bsr_matrix(dense, blocksize=(3, 3)),
        sp.bsr_matrix(dense, blocksize=(6, 6)),
    ):
        product = mkl.Matrix(matrix) @ x
        assert product.dtype == np.float32
        np.testing.assert_allclose(product, dense @ x, atol=1e-5)


def test_without_mkl_a_cycle_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    with_mkl, of = cycles(5, monkeypatch)

    def missing() -> None:
        raise ImportError

    monkeypatch.setattr(mkl, "library", missing)
    mkl._functions.cache_clear()
    without, _ = cycles(5, monkeypatch)
    assert isinstance(without._levels[0].matrix, sp.bsr_matrix)
    b = np.random.default_rng(0).normal(size=of.system.n_u)
    symmetric = multigrid.symmetric(of.pattern, of._metric)(b)
    np.testing.assert_allclose(symmetric, of.pattern.product(of._metric)(b), atol=1e-5 * np.abs(symmetric).max())
    np.testing.assert_allclose(without.solve(b), with_mkl.solve(b), rtol=1e-3, atol=1e-4 * np.abs(b).max())
