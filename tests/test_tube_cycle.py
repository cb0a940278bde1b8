"""Cycles of the active tube, against the exact ones and against chains of solves."""

from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
import reference_tube as exact
from test_tube import (
    A_OVER_D,
    ACTIVE,
    BODY,
    SET,
    T0,
    WEAVE,
    assert_stopped,
    height_ratio,
    l2_error,
    pressure_named,
    radial,
    radii,
    says,
    sections,
    solution,
)

import jaxmyo as jm

S = np.array([0.0, 0.25, 0.5, 0.75, 1.0])


def beta(s: float) -> float:
    return float(np.sin(np.pi * s) ** 2)


def loads(s: float) -> list[jm.Pressure]:
    return [jm.Pressure("inner", 8.0 + 10.0 * beta(s))]


def cycle(a_over_D: float | None, s: Any = S, loads: Any = loads, throw: bool = True) -> jm.Cycle:
    scene = radial(16, a_over_D).A.scene
    return jm.cycle(scene, s, T0=T0, a_over_D=a_over_D, beta=beta, loads=loads, throw=throw)


@cache
def paper_cycle(a_over_D: float | None) -> jm.Cycle:
    return cycle(a_over_D)


def assert_close(state: jm.State, other: jm.State, atol: float) -> None:
    for field in ("u", "p", "T_f", "T_cf", "cauchy"):
        one, two = (np.asarray(getattr(s, field)) for s in (state, other))
        np.testing.assert_allclose(one, two, rtol=0, atol=atol)


@pytest.mark.slow
@pytest.mark.parametrize("a_over_D", WEAVE)
def test_cycle_against_the_exact_one(a_over_D: float | None) -> None:
    """The errors of n = 16; at s = 0 and ½ the states are those whose second order is shown above."""
    found = paper_cycle(a_over_D)
    np.testing.assert_array_equal(found.s, S)
    for states in (found.A, found.C):
        np.testing.assert_array_equal(np.asarray(states.status), int(jm.Status.CONVERGED))
        assert states.u.shape[0] == len(S)
    for i, step in enumerate(exact.cycle(SET, BODY, T0, a_over_D, S)):
        A, C = found.A[i], found.C[i]
        np.testing.assert_allclose(float(A.inputs.beta), step.beta, atol=1e-15)
        np.testing.assert_allclose(float(C.inputs.loads["open"][0]), step.P, rtol=1e-15)
        assert l2_error(A, step.A) < 8e-4
        assert l2_error(C, step.C) < 1.3e-4
        assert abs(height_ratio(A) - step.A.lz) < 3e-4
        assert abs(height_ratio(C) - step.C.lz) < 2e-4
    A, C0, C = radial(16, a_over_D)
    assert_close(found.C[0], C0, 1e-10)
    assert_close(found.A[2], A, 1e-10)
    assert_close(found.C[2], C, 1e-10)


@pytest.mark.parametrize("a_over_D", WEAVE)
def test_cycle_is_symmetric_in_time(a_over_D: float | None) -> None:
    """The way back is the way there: nothing remembers."""
    found = paper_cycle(a_over_D)
    for states in (found.A, found.C):
        assert_close(states[4], states[0], 1e-10)
        assert_close(states[3], states[1], 1e-10)
        assert np.abs(np.asarray(states[1].u) - np.asarray(states[2].u)).max() > 0.01


@pytest.mark.parametrize("a_over_D", WEAVE)
def test_cycle_is_a_chain_of_solves(a_over_D: float | None) -> None:
    found = paper_cycle(a_over_D)
    A: jm.State | None = None
    C: jm.State | None = None
    for i, s in enumerate(S):
        A = jm.contract(found.A.scene, T0=T0, a_over_D=a_over_D, beta=beta(s), start=A)
        C = jm.load(A, *loads(s), start=C)
        assert_close(found.A[i], A, 1e-10)
        assert_close(found.C[i], C, 1e-10)


def test_one_state_of_a_cycle() -> None:
    found = paper_cycle(A_OVER_D)
    C = found.C[2]
    assert jnp.ndim(C.status) == 0
    assert C.u.shape == C.scene.mesh.points.shape
    assert C.mean("cauchy").shape == (3, 3)
    assert "converged" in C.message
    assert "18" in repr(C)
    assert "5 states" in repr(found.C)
    np.testing.assert_allclose(sections(C)[1], 18.0 * radii(C)[1][0], rtol=1e-11)
    again = jm.load(found.A[2], ACTIVE, start=C)  # it is a state to go on from
    assert_close(again, C, 1e-10)


@pytest.mark.slow
def test_cycle_that_starts_beyond_a_limit_point() -> None:
    """Without the weave the first C, loaded from its own A to 18 kPa, is not found; those after it are."""
    s = np.array([0.5, 0.0, 0.25, 0.5, 0.0])
    with pytest.raises(jm.SolveError, match=says("state C", "s = 0.5")) as caught:
        cycle(None, s)
    P = pressure_named(str(caught.value))
    assert abs(P - 7.220144) < 1e-3 * 7.220144
    assert_stopped(caught.value.state, P)
    found = cycle(None, s, throw=False)
    np.testing.assert_array_equal(np.asarray(found.A.converged), True)
    np.testing.assert_array_equal(np.asarray(found.C.converged), [False, True, True, True, True])
    assert_stopped(found.C[0], P)
    whole = paper_cycle(None)
    for i, j in ((1, 0), (2, 1), (3, 2), (4, 0)):
        assert_close(found.C[i], whole.C[j], 1e-10)


def test_cycle_with_a_step_that_fails() -> None:
    """At s = ½ the tube is sucked flat: that step names where the pressure turns back, the later ones are as ever."""

    def suction(s: float) -> list[jm.Pressure]:
        return [jm.Pressure("inner", -60.0)] if s == 0.5 else loads(s)

    before = exact.cycle(SET, BODY, T0, None, S[:2])[1].C
    with pytest.raises(exact.LimitPoint) as turning:
        exact.inflate(SET, BODY, solution(None).A, -60.0, start=before)
    with pytest.raises(jm.SolveError, match=says("state C", "s = 0.5")) as caught:
        cycle(None, loads=suction)
    np.testing.assert_allclose(pressure_named(str(caught.value)), turning.value.load, rtol=1e-3)
    found, whole = cycle(None, loads=suction, throw=False), paper_cycle(None)
    np.testing.assert_array_equal(np.asarray(found.C.converged), [True, True, False, True, True])
    assert 0.0 < float(found.C[2].reached) < 1.0
    assert np.isfinite(np.asarray(found.C[2].u)).all()
    for i in (0, 1, 3, 4):
        assert_close(found.C[i], whole.C[i], 1e-10)


@pytest.mark.parametrize(
    ("s", "changed", "parts"),
    [
        ([], {}, ("s is empty",)),
        ([0.0, np.nan], {}, ("s must be finite", "nan")),
        ([0.0, 0.5], {"beta": lambda s: 3.0 * s}, ("beta(0.5) = 1.5", "[0, 1]")),
        ([0.0, 0.5], {"loads": lambda s: [jm.Pressure("iner", 8.0)]}, ("face = 'iner'", "'inner'")),
        (
            [0.0, 0.5],
            {"loads": lambda s: [jm.Pressure("inner" if s == 0.0 else "outer", 8.0)]},
            ("loads(0.5)", "loads(0)", "'outer'"),
        ),
    ],
)
def test_bad_cycle(s: Any, changed: Any, parts: tuple[str, ...]) -> None:
    arguments = {"T0": T0, "a_over_D": A_OVER_D, "beta": beta, "loads": loads, **changed}
    with pytest.raises(ValueError, match=says(*parts)):
        jm.cycle(radial(16, A_OVER_D).A.scene, s, **arguments)
