"""State C under prescribed stretches and tractions, alone and mixed, against the reference and against each other."""

from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
import reference
from scipy.optimize import brentq
from support import sample

import jaxmyo as jm

MESH = (2, 2, 2)
AREA = {"x1": 10.0, "y1": 10.0, "z1": 100.0}  # mm² in the zero-stress state

#: (set, T0 kPa, a/D, beta): T_cf is not zero wherever a/D is given and beta T0 > 0.
ACTIVE = [
    ("table1", 0.6, 0.2, 1.0),
    ("table1", 5.0, 0.1, 0.5),
    ("table1", 35.0, 0.2, 1.0),
    ("table1", 35.0, 0.25, 0.5),
    ("measured", 0.6, 0.2, 1.0),
    ("measured", 5.0, 0.25, 0.1),
    ("measured", 35.0, 0.1, 1.0),
]
SYMMETRIC = [
    ("table1", 5.0, None, 0.1),
    ("table1", 35.0, None, 1.0),
    ("measured", 0.6, None, 0.5),
    ("measured", 35.0, None, 0.02),
]
PASSIVE = [("table1", 35.0, 0.2, 0.0), ("measured", 0.6, None, 0.0)]
MIXED = [ACTIVE[1], ACTIVE[2], ACTIVE[4], ACTIVE[6], SYMMETRIC[2]]
LOADS = [
    ("uniaxial_f", 1.2),
    ("uniaxial_f", 0.9),
    ("uniaxial_cf", 1.2),
    ("uniaxial_cf", 0.9),
    ("cauchy", (5.0, 2.0)),
    ("cauchy", (2.0, 5.0)),
    ("cauchy", (5.0, 0.0)),
    ("nominal", (5.0, 2.0)),
    ("nominal", (2.0, 2.0)),
]


@cache
def contracted(elements: Any, name: str, T0: float, a_over_D: float | None, beta: float) -> jm.State:
    scene = sample(elements, 0.2 if elements else 0.0)
    return jm.contract(scene, T0=T0, a_over_D=a_over_D, beta=beta, constants=jm.SETS[name])


def conditions(mode: str, value: Any) -> tuple[Any, ...]:
    if mode == "uniaxial_f":
        return (jm.Stretch("x", value),)
    if mode == "uniaxial_cf":
        return (jm.Stretch("y", value),)
    return jm.Traction("x1", (value[0], 0.0, 0.0), mode), jm.Traction("y1", (0.0, value[1], 0.0), mode)


def loaded_by_reference(name: str, T0: float, a_over_D: float | None, beta: float, mode: Any, value: Any) -> Any:
    constants = reference.SETS[name]
    a = reference.free_contraction(constants, T0, a_over_D, beta)
    return a, reference.loaded_mixed(constants, T0, beta, a.T_f, a.T_cf, a.stretches, mode, value)


def assert_is(state: jm.State, exact: reference.Loaded) -> None:
    """The homogeneous state of the reference, at every quadrature point."""
    assert float(state.residual) <= 1e-13
    stretches, sigma = np.asarray(state.stretches), np.asarray(state.cauchy)
    np.testing.assert_allclose(stretches, np.broadcast_to(exact.stretches, stretches.shape), rtol=0, atol=1e-9)
    scale = max(1.0, np.abs(exact.sigma).max(), abs(exact.p))
    np.testing.assert_allclose(sigma, np.broadcast_to(np.diag(exact.sigma), sigma.shape), rtol=0, atol=1e-9 * scale)
    np.testing.assert_allclose(np.asarray(state.p), exact.p, rtol=0, atol=1e-9 * scale)


# ------------------------------------------------------------------------------------------- against the reference


@pytest.mark.parametrize("case", ACTIVE + SYMMETRIC + PASSIVE, ids=str)
@pytest.mark.parametrize(("mode", "value"), LOADS, ids=str)
def test_one_load_against_the_reference(case: Any, mode: str, value: Any) -> None:
    a, exact = loaded_by_reference(*case, mode, value)
    assert (a.T_cf != 0.0) == (case in ACTIVE)
    assert_is(jm.load(contracted(None, *case), *conditions(mode, value)), exact)


@pytest.mark.parametrize(
    ("case", "mode", "value"),
    [
        (("table1", 0.6, 0.1, 0.02), "uniaxial_f", 1.2),
        (("table1", 0.6, 0.25, 0.02), "uniaxial_f", 1.2),
        (("measured", 0.6, 0.2, 0.1), "uniaxial_f", 1.2),
        (("measured", 5.0, 0.2, 0.02), "uniaxial_f", 1.2),
        (("table1", 0.6, 0.2, 0.02), "cauchy", (5.0, 0.0)),
        (("measured", 0.6, 0.1, 0.1), "cauchy", (5.0, 0.0)),
        (("measured", 5.0, 0.2, 0.02), "cauchy", (5.0, 0.0)),
    ],
    ids=str,
)
def test_the_branch_is_kept_next_to_a_bifurcation(case: Any, mode: str, value: Any) -> None:
    """A small T_cf splits the symmetric pitchfork: the branch that starts at A and the unstable one pass close by."""
    _, exact = loaded_by_reference(*case, mode, value)
    state = jm.load(contracted(None, *case), *conditions(mode, value))
    assert_is(state, exact)
    assert int(state.negative_eigenvalues) == 0


def follow_mixed(case: Any, driven: int, stretch: float, traction: float, nominal: bool) -> reference.Loaded:
    """One in-plane stretch and the traction across it grow from those of state A in proportion, in 200 small steps."""
    name, T0, a_over_D, beta = case
    a = reference.free_contraction(reference.SETS[name], T0, a_over_D, beta)
    free = 1 - driven

    def at(t: float, l_free: float) -> reference.Loaded:
        l_driven = a.stretches[driven] + t * (stretch - a.stretches[driven])
        pair = (l_driven, l_free) if driven == 0 else (l_free, l_driven)
        return reference.loaded_stretch(reference.SETS[name], T0, beta, a.T_f, a.T_cf, *pair)

    def excess(l_free: float, t: float) -> float:
        state = at(t, l_free)
        return float((state.nominal if nominal else state.sigma)[free]) - t * traction

    l_free = float(a.stretches[free])
    for t in np.linspace(0.0, 1.0, 201)[1:]:
        low, high = l_free - 0.01, l_free + 0.01
        assert excess(low, t) < 0.0 < excess(high, t), "this case is not on a stable branch"
        l_free = brentq(excess, low, high, args=(t,), xtol=1e-15)
    return at(1.0, l_free)


@pytest.mark.parametrize("measure", ["cauchy", "nominal"])
@pytest.mark.parametrize("case", MIXED, ids=str)
def test_stretch_along_and_traction_across(case: Any, measure: Any) -> None:
    exact = follow_mixed(case, 0, 1.15, 0.8, measure == "nominal")
    state = jm.load(contracted(None, *case), jm.Stretch("x", 1.15), jm.Traction("y1", (0.0, 0.8, 0.0), measure))
    assert_is(state, exact)


@pytest.mark.parametrize("measure", ["cauchy", "nominal"])
@pytest.mark.parametrize("case", MIXED, ids=str)
def test_stretch_across_and_traction_along(case: Any, measure: Any) -> None:
    exact = follow_mixed(case, 1, 1.1, 4.0, measure == "nominal")
    state = jm.load(contracted(None, *case), jm.Stretch("y", 1.1), jm.Traction("x1", (4.0, 0.0, 0.0), measure))
    assert_is(state, exact)


def test_no_load_leaves_the_contracted_state() -> None:
    a = contracted(None, *ACTIVE[2])
    c = jm.load(a, *conditions("nominal", (0.0, 0.0)))
    np.testing.assert_allclose(np.asarray(c.u), np.asarray(a.u), rtol=0, atol=1e-11)
    np.testing.assert_allclose(np.asarray(c.cauchy), 0.0, atol=1e-11)


# ---------------------------------------------------------------------------------------------------- on a mesh


@pytest.fixture(scope="module")
def state_a() -> jm.State:
    return contracted(MESH, *ACTIVE[4])


@pytest.fixture(scope="module")
def stretched(state_a: jm.State) -> jm.State:
    return jm.load(state_a, jm.Stretch("x", 1.15), jm.Stretch("y", 1.05))


@pytest.fixture(scope="module")
def exact() -> reference.Loaded:
    name, T0, a_over_D, beta = ACTIVE[4]
    a = reference.free_contraction(reference.SETS[name], T0, a_over_D, beta)
    return reference.loaded_stretch(reference.SETS[name], T0, beta, a.T_f, a.T_cf, 1.15, 1.05)


def test_mesh_under_stretches(stretched: jm.State, exact: reference.Loaded) -> None:
    assert_is(stretched, exact)


@pytest.mark.slow
@pytest.mark.parametrize("measure", ["cauchy", "nominal"])
def test_mesh_under_tractions(state_a: jm.State, exact: reference.Loaded, measure: str) -> None:
    """Tractions that the reference finds for the stretches give these stretches back, in either measure."""
    values = exact.sigma if measure == "cauchy" else exact.nominal
    assert_is(jm.load(state_a, *conditions(measure, tuple(values[:2]))), exact)


@pytest.mark.slow
def test_rigid_plates_change_nothing_in_a_homogeneous_state(state_a: jm.State, exact: reference.Loaded) -> None:
    plates = jm.Planar("x1", "x"), jm.Planar("y1", "y")
    state = jm.load(state_a, *plates, *conditions("nominal", tuple(exact.nominal[:2])))
    assert_is(state, exact)
    assert abs(float(state.reaction("x1")[0])) <= 1e-8
    assert abs(float(state.reaction("y1")[1])) <= 1e-8


def test_displacement_is_stretch(state_a: jm.State, stretched: jm.State) -> None:
    moved = jm.load(state_a, jm.Displacement("x1", "x", 1.5), jm.Displacement("y1", "y", 0.5))
    np.testing.assert_allclose(np.asarray(moved.u), np.asarray(stretched.u), rtol=0, atol=1e-11)
    np.testing.assert_allclose(np.asarray(moved.cauchy), np.asarray(stretched.cauchy), rtol=0, atol=1e-9)


def test_reactions_are_nominal_stress_times_area(stretched: jm.State, exact: reference.Loaded) -> None:
    for k, face in enumerate(("x1", "y1", "z1")):
        force = np.zeros(3)
        force[k] = exact.nominal[k] * AREA[face]
        np.testing.assert_allclose(np.asarray(stretched.reaction(face)), force, rtol=0, atol=1e-8)
        np.testing.assert_allclose(np.asarray(stretched.reaction(face.replace("1", "0"))), -force, rtol=0, atol=1e-8)


def test_nodes_without_support_carry_no_reaction(stretched: jm.State) -> None:
    reactions, nodes = np.asarray(stretched.reactions), stretched.scene.mesh.points
    held = (nodes == 0.0) | (nodes == np.array([10.0, 10.0, np.nan]))
    assert np.abs(reactions[~held]).max() <= 1e-9
    assert np.abs(reactions[held]).max() > 1.0
    np.testing.assert_allclose(reactions.sum(axis=0), 0.0, atol=1e-9)


@pytest.mark.slow
def test_reactions_balance_an_oblique_traction(state_a: jm.State) -> None:
    """A dead load in any direction: the supports return its resultant, wherever the body goes."""
    vector = np.array([3.0, 0.2, 0.1])
    state = jm.load(state_a, jm.Traction("x1", vector), jm.Traction("y1", (0.0, 1.0, 0.0)))
    total = np.asarray(state.reactions).sum(axis=0)
    np.testing.assert_allclose(total, -AREA["x1"] * vector - AREA["y1"] * np.array([0.0, 1.0, 0.0]), rtol=0, atol=1e-8)
    off_diagonal = np.asarray(state.F)[..., ~np.eye(3, dtype=bool)]
    assert np.abs(off_diagonal).max() > 1e-3


@pytest.mark.slow
def test_reactions_balance_a_cauchy_traction(state_a: jm.State, exact: reference.Loaded) -> None:
    state = jm.load(state_a, *conditions("cauchy", tuple(exact.sigma[:2])))
    for k, face in enumerate(("x0", "y0")):
        np.testing.assert_allclose(
            float(state.reaction(face)[k]), -exact.nominal[k] * AREA[face.replace("0", "1")], rtol=1e-9
        )


def test_traction_vector_may_be_an_array_of_any_kind(state_a: jm.State) -> None:
    first = jm.load(state_a, *conditions("nominal", (1.0, 1.0)))
    second = jm.load(state_a, jm.Traction("x1", jnp.array([1.0, 0.0, 0.0])), jm.Traction("y1", [0, 1, 0]))
    np.testing.assert_array_equal(np.asarray(first.u), np.asarray(second.u))


def test_second_piola_kirchhoff_and_fibre_axes(stretched: jm.State, exact: reference.Loaded) -> None:
    S = np.diag(exact.sigma / exact.stretches**2)
    got = np.asarray(stretched.second_piola_kirchhoff)
    np.testing.assert_allclose(got, np.broadcast_to(S, got.shape), rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.asarray(stretched.cauchy_fibre), np.asarray(stretched.cauchy), rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.asarray(stretched.mean("cauchy")), np.diag(exact.sigma), rtol=0, atol=1e-9)
