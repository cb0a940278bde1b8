"""Loads that change in steps: from one kind, face or value to another, and what a failure says."""

from typing import Any

import numpy as np
import pytest
from support import sample
from test_element import residual_of

import jaxmyo as jm
from jaxmyo import implicit
from jaxmyo.status import Status


@pytest.fixture(scope="module")
def contracted() -> jm.State:
    return jm.contract(sample(), T0=5.0, a_over_D=0.2)


def pulled(x: float, y: float, measure: Any = "nominal") -> tuple[jm.Traction, jm.Traction]:
    return jm.Traction("x1", (x, 0.0, 0.0), measure), jm.Traction("y1", (0.0, y, 0.0), measure)


@pytest.fixture(scope="module")
def direct(contracted: jm.State) -> jm.State:
    return jm.load(contracted, *pulled(2.0, 1.0))


def assert_same(a: jm.State, b: jm.State) -> None:
    assert a.conditions == b.conditions
    np.testing.assert_allclose(np.asarray(a.u), np.asarray(b.u), rtol=0, atol=1e-10)
    np.testing.assert_allclose(np.asarray(a.p), np.asarray(b.p), rtol=0, atol=1e-9)
    np.testing.assert_array_equal(np.asarray(a.inputs.imbalance), 0.0)
    np.testing.assert_array_equal(np.asarray(a.inputs.offset), np.asarray(b.inputs.offset))


def test_from_other_values_of_the_same_loads(contracted: jm.State, direct: jm.State) -> None:
    first = jm.load(contracted, *pulled(0.5, 1.5))
    assert np.abs(np.asarray(first.u - direct.u)).max() > 0.1
    assert_same(jm.load(contracted, *pulled(2.0, 1.0), start=first), direct)


@pytest.fixture
def paths(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What each solve of a test follows: (system, z, route, ...)."""
    followed: list[Any] = []
    follow = implicit._compiled
    monkeypatch.setattr(implicit, "_compiled", lambda *path, **dials: followed.append(path) or follow(*path, **dials))
    return followed


def test_from_a_load_on_another_face(contracted: jm.State, paths: list[Any]) -> None:
    """The old load fades while the new one grows; only the new one is a condition of the state."""
    along, across = pulled(2.0, 1.0)
    first = jm.load(contracted, across)
    second = jm.load(contracted, along, start=first)
    route = paths[-1][2]
    begin = route.inputs(route.start)
    np.testing.assert_array_equal(np.asarray(begin.loads["nominal"]), [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(np.asarray(begin.imbalance), 0.0, atol=1e-9)
    assert "Traction('x1') 2 0 0 kPa" in repr(second)
    assert "y1" not in repr(second)
    np.testing.assert_array_equal(np.asarray(second.inputs.loads["nominal"]), [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    assert_same(second, jm.load(contracted, along))


def test_from_another_kind_of_load(contracted: jm.State, direct: jm.State) -> None:
    first = jm.load(contracted, *pulled(1.0, 2.0, "cauchy"))
    assert_same(jm.load(contracted, *pulled(2.0, 1.0), start=first), direct)


def test_from_a_displacement_that_is_released(contracted: jm.State, direct: jm.State, paths: list[Any]) -> None:
    """The path starts in the equilibrium that was: the force that held the face is an imbalance, which fades."""
    held = jm.load(contracted, jm.Stretch("x", 1.15))
    force = float(held.reaction("x1")[0])
    assert abs(force) > 1.0
    second = jm.load(contracted, *pulled(2.0, 1.0), start=held)
    system, z, route, *_ = paths[-1]
    begin, end = route.inputs(route.start), route.end
    np.testing.assert_allclose(np.asarray(residual_of(system, z, begin)), 0.0, atol=1e-10)
    np.testing.assert_allclose(np.asarray(system.displacements(z, begin)), np.asarray(held.u), rtol=1e-12, atol=1e-14)
    # The three stretches are the unknowns, and the face's force works along 10 mm of the first.
    np.testing.assert_allclose(np.asarray(begin.imbalance), [10.0 * force, 0.0, 0.0, 0.0], atol=1e-8)
    np.testing.assert_array_equal(np.asarray(end.imbalance), 0.0)
    assert_same(second, direct)
    np.testing.assert_allclose(float(second.reaction("x1")[0]), 0.0, atol=1e-9)


def test_a_failure_names_the_loads_that_were_reached(contracted: jm.State, direct: jm.State) -> None:
    """Those of the last state that was found, not those that were wanted."""
    state = jm.load(contracted, *pulled(-1e300, 0.0), start=direct, throw=False)
    assert int(state.status) != Status.CONVERGED
    assert state.message.startswith(f"{Status(int(state.status)).name} at 0 % of the load")
    assert "Traction('x1') 2 0 0 kPa, Traction('y1') 0 1 0 kPa" in state.message
