"""The homogeneous sample against the scalar root-find of the reference: states A and C at random points."""

from typing import NamedTuple

import numpy as np
import pytest
import reference
from support import BATCH, Fields, biaxial, sample

import jaxmyo as jm

KINDS = [
    pytest.param((None, True), id="0D-weave"),
    pytest.param(((1, 1, 1), True), id="element-weave"),
    pytest.param(((1, 1, 1), False), id="element-free", marks=pytest.mark.slow),
]


class Points(NamedTuple):
    """Random inputs, the package's states and the reference's."""

    T0: np.ndarray
    beta: np.ndarray
    a: Fields
    c: Fields
    a_reference: list[reference.FreeContraction]
    c_reference: list[reference.Loaded]
    nodes: np.ndarray


def draw() -> tuple[np.ndarray, ...]:
    """200 points; the first few sit on the ends of the ranges."""
    rng = np.random.default_rng(20240607)
    T0, a_over_D, beta = rng.uniform(0.0, 200.0, BATCH), rng.uniform(0.0, 0.25, BATCH), rng.uniform(0.0, 1.0, BATCH)
    l1, l2 = rng.uniform(0.8, 1.3, (2, BATCH))
    T0[:6] = 0.0, 0.0, 200.0, 200.0, 200.0, 200.0
    beta[:10] = 0.5, 0.0, 1.0, 1.0, 0.0, 0.01, 1e-2, 1e-3, 1e-4, 1e-6
    a_over_D[:6] = 0.25, 0.1, 0.0, 0.25, 0.25, 0.25
    return T0, a_over_D, beta, l1, l2


@pytest.fixture(scope="module", params=["table1", pytest.param("measured", marks=pytest.mark.slow)])
def set_name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module", params=KINDS)
def points(request: pytest.FixtureRequest, set_name: str) -> Points:
    elements, weave = request.param
    T0, a_over_D, beta, l1, l2 = inputs = draw()
    a, c = biaxial(elements, weave, *inputs, jm.SETS[set_name])
    constants = reference.SETS[set_name]
    free = [
        reference.free_contraction(constants, t, r if weave else None, b)
        for t, r, b in zip(T0, a_over_D, beta, strict=True)
    ]
    loaded = [
        reference.loaded_stretch(constants, t, b, f.T_f, f.T_cf, x, y)
        for t, b, f, x, y in zip(T0, beta, free, l1, l2, strict=True)
    ]
    return Points(T0, beta, a, c, free, loaded, sample(elements).mesh.points)


def displacement_error(u: np.ndarray, stretches: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Relative L2 norm over the nodes, per sample; in mm where the exact displacement is zero."""
    exact = (stretches[:, None, :] - 1.0) * nodes[None]
    size = np.linalg.norm(exact, axis=(1, 2))
    return np.linalg.norm(u - exact, axis=(1, 2)) / np.where(size > 0.0, size, 1.0)


def test_every_point_converges(points: Points) -> None:
    for state in (points.a, points.c):
        assert (state.status == jm.Status.CONVERGED).all()
        assert (state.reached == 1.0).all()


def test_displacements_of_free_contraction(points: Points) -> None:
    exact = np.array([r.stretches for r in points.a_reference])
    error = displacement_error(points.a.u, exact, points.nodes)
    assert error[points.beta >= 0.01].max() <= 1e-10
    # Towards rest the stiffness vanishes, and with it the resolution of a residual at round-off.
    assert np.abs(points.a.stretches - exact[:, None, None]).max() <= 1e-10


def test_displacements_under_prescribed_stretches(points: Points) -> None:
    exact = np.array([r.stretches for r in points.c_reference])
    assert displacement_error(points.c.u, exact, points.nodes).max() <= 1e-10


def test_residual_is_at_round_off(points: Points) -> None:
    for state in (points.a, points.c):
        assert state.residual.max() <= 1e-13
        assert state.constraint_residual.max() <= 1e-13


def test_free_contraction_has_no_stress(points: Points) -> None:
    scale = np.array([max(r.p, abs(r.T_cf), 1e-3) for r in points.a_reference]) + points.beta * points.T0
    assert (np.abs(points.a.cauchy).max(axis=(1, 2, 3, 4)) / scale).max() <= 1e-11


def test_multipliers_and_tensions_of_free_contraction(points: Points) -> None:
    for name in ("p", "q", "T_f", "T_cf"):
        exact = np.array([getattr(r, name) for r in points.a_reference])
        got = getattr(points.a, name).reshape(BATCH, -1)
        scale = 1e-3 + np.abs(exact)
        assert (np.abs(got - exact[:, None]) / scale[:, None]).max() <= 1e-9, name


def test_pressure_and_stress_under_prescribed_stretches(points: Points) -> None:
    exact = np.array([np.diag(r.sigma) for r in points.c_reference])
    scale = np.abs(exact).max(axis=(1, 2))
    error = np.abs(points.c.cauchy - exact[:, None, None]).max(axis=(1, 2, 3, 4))
    assert (error / scale).max() <= 1e-9
    p = np.array([r.p for r in points.c_reference])
    assert (np.abs(points.c.p[:, 0] - p) / np.maximum(scale, np.abs(p))).max() <= 1e-9


def test_tensions_are_frozen_into_the_loaded_state(points: Points) -> None:
    np.testing.assert_array_equal(points.c.T_f, points.a.T_f)
    np.testing.assert_array_equal(points.c.T_cf, points.a.T_cf)


@pytest.mark.parametrize("weave", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_states_of_the_table(weave: bool) -> None:
    rows = [(r or 0.0, t) for r, t, _, _ in reference.PRINTED_TABLE if (r is not None) == weave]
    ratio, T0 = np.array(rows).T
    nodes = sample((1, 1, 1)).mesh.points
    for name, constants in reference.SETS.items():
        a, c = biaxial((1, 1, 1), weave, T0, ratio, 1.0, 1.2, 1.2, jm.SETS[name])
        exact = [reference.free_contraction(constants, t, r if weave else None, 1.0) for r, t in rows]
        assert displacement_error(a.u, np.array([r.stretches for r in exact]), nodes).max() <= 1e-10
        loaded = np.broadcast_to([1.2, 1.2, 1.0 / 1.44], (len(rows), 3))
        assert displacement_error(c.u, loaded, nodes).max() <= 1e-10
        assert max(a.residual.max(), c.residual.max()) <= 1e-13


@pytest.mark.parametrize(
    ("weave", "expected"),
    [(True, ("0.71837", "0.95894", "1.45166")), (False, ("0.61749", "1.27258", "1.27258"))],
)
def test_free_contraction_to_all_known_digits(weave: bool, expected: tuple[str, str, str]) -> None:
    a, _ = biaxial((1, 1, 1), weave, 35.0, 0.2, 1.0, 1.2, 1.2)
    assert tuple(f"{v:.5f}" for v in a.stretches[0, 0, 0]) == expected
    state = jm.contract(sample(), T0=35.0, a_over_D=0.2 if weave else None)
    assert tuple(f"{v:.5f}" for v in np.asarray(state.mean("stretches"))) == expected


def test_struts_of_no_width_keep_the_cross_fibre_length() -> None:
    T0, beta = (v.ravel() for v in np.meshgrid([0.0, 0.6, 35.0, 200.0], [0.0, 1e-3, 0.1, 1.0]))
    for elements in (None, (1, 1, 1)):
        a, _ = biaxial(elements, True, T0, 0.0, beta, 1.1, 1.1)
        assert (a.status == jm.Status.CONVERGED).all()
        assert np.abs(a.stretches[..., 1] - 1.0).max() <= 1e-12
        assert (a.T_f == 0.0).all()


@pytest.mark.parametrize("name", ["printed", "table1", "measured"])
def test_corners_of_the_input_range(name: str) -> None:
    T0, ratio, beta = (v.ravel() for v in np.meshgrid([0.0, 0.6, 200.0], [0.0, 0.25], [0.0, 1e-6, 1e-3, 0.5, 1.0]))
    a, c = biaxial((1, 1, 1), True, T0, ratio, beta, 0.8, 1.3, jm.SETS[name])
    exact = [reference.free_contraction(reference.SETS[name], *v) for v in zip(T0, ratio, beta, strict=True)]
    assert (a.status == jm.Status.CONVERGED).all()
    assert (c.status == jm.Status.CONVERGED).all()
    assert np.abs(a.stretches - np.array([r.stretches for r in exact])[:, None, None]).max() <= 1e-10
    rest = (T0 == 0.0) | (beta == 0.0)
    assert np.abs(a.u[rest]).max() <= 1e-12
    assert np.abs(a.T_cf[rest]).max() <= 1e-12


def test_pseudo_active_tensions_pull_across_and_push_along_in_the_table() -> None:
    rows = np.array([(r, t) for r, t, _, _ in reference.PRINTED_TABLE if r is not None])
    a, _ = biaxial(None, True, rows[:, 1], rows[:, 0], 1.0, 1.2, 1.2)
    assert (a.T_cf > 0.0).all()
    assert (a.T_f < 0.0).all()


@pytest.mark.slow
def test_ten_times_the_passive_stiffness_and_activation_is_ten_times_the_tension() -> None:
    """MEASURED has ten times the passive stiffness of TABLE1: at 10 beta every energy is ten times as large."""
    T0, ratio, beta = (v.ravel() for v in np.meshgrid([0.6, 5.0, 35.0, 200.0], [0.05, 0.2, 0.25], [0.01, 0.05, 0.1]))
    for weave in (True, False):
        soft, _ = biaxial((1, 1, 1), weave, T0, ratio, beta, 1.1, 1.1, jm.TABLE1)
        stiff, _ = biaxial((1, 1, 1), weave, T0, ratio, 10.0 * beta, 1.1, 1.1, jm.MEASURED)
        np.testing.assert_allclose(stiff.stretches, soft.stretches, rtol=1e-9)
        for field in ("p", "q", "T_f", "T_cf"):
            np.testing.assert_allclose(getattr(stiff, field), 10.0 * getattr(soft, field), rtol=1e-9, atol=1e-9)
