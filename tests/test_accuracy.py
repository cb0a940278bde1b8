"""`converge`: an output to a wanted accuracy. The estimate on sequences that are known, the loop, and a real tube."""

import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jaxmyo as jm
from jaxmyo.accuracy import extrapolate, first_setting

coefficient = st.floats(-1.0, 1.0).filter(lambda c: abs(c) > 0.05)


@cache
def state() -> jm.State:
    return jm.contract(jm.thin_sample(), T0=5.0, a_over_D=0.2)


def on_meshes(value: Callable[[int], float], fails_below: int = 0) -> tuple[Any, Any, list[int]]:
    """(attempt, output, meshes) of an output that is a function of the mesh alone."""
    meshes: list[int] = []

    def attempt(n: int, settings: jm.Settings) -> jm.State:
        if n < fails_below:
            raise jm.SolveError("too coarse", state())
        meshes.append(n)
        return state()

    return attempt, lambda _: value(meshes[-1]), meshes


def smooth(n: int) -> float:
    return 2.0 * (1.0 + 0.3 / n**2 - 0.2 / n**4 + 0.1 / n**6)


@given(c2=coefficient, ratio=st.floats(-1.0, 1.0), levels=st.integers(3, 5))
def test_the_estimate_bounds_the_error_of_smooth_outputs(c2: float, ratio: float, levels: int) -> None:
    values = [1.0 + c2 * (h**2 + ratio * h**4) for h in 0.25 * 0.5 ** np.arange(levels)]
    value, error, order, extrapolated = extrapolate(values)
    assert extrapolated
    assert order is not None
    assert abs(value - 1.0) <= error + 1e-14


@given(c=coefficient, p=st.floats(0.6, 1.5))
def test_the_observed_order_is_used_where_it_is_not_two(c: float, p: float) -> None:
    values = [1.0 + c * h**p for h in (0.25, 0.125, 0.0625)]
    value, error, order, extrapolated = extrapolate(values)
    assert not extrapolated
    assert order == pytest.approx(p, abs=1e-9)
    assert value == values[-1]
    assert abs(value - 1.0) <= error <= 3.0 * abs(value - 1.0)


def test_two_meshes_are_not_taken_for_more_than_they_tell() -> None:
    value, error, order, extrapolated = extrapolate([1.04, 1.01])
    assert (value, order, extrapolated) == (pytest.approx(1.0), None, True)
    assert error == pytest.approx(0.03)


@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, 1e-6, 1e-8])
def test_a_smooth_output_reaches_its_target(accuracy: float) -> None:
    attempt, output, meshes = on_meshes(smooth)
    answer = jm.converge(attempt, output, accuracy=accuracy)
    assert answer.reached
    assert abs(answer.value / 2.0 - 1.0) <= answer.error <= accuracy
    assert answer.elements == tuple(meshes)
    assert all(b == 2 * a for a, b in pairwise(meshes))
    assert answer.settings.tolerance <= 1e-4 * accuracy * (1.0 + 1e-9)


def test_a_looser_target_takes_coarser_meshes() -> None:
    finest = []
    for accuracy in ("fast", "balanced", "exact"):
        attempt, output, meshes = on_meshes(smooth)
        assert jm.converge(attempt, output, accuracy=accuracy).reached
        finest.append(meshes[-1])
    assert finest == sorted(finest)
    assert finest[0] < finest[-1]


def test_out_of_reach_is_said() -> None:
    attempt, output, _ = on_meshes(lambda n: 1.0 + n**-0.5)
    answer = jm.converge(attempt, output, accuracy=1e-6, max_elements=32)
    assert not answer.reached
    assert answer.error > 1e-6
    assert answer.elements[-1] == 32
    for word in ("OUT OF REACH", "max_elements = 32", "order is 0.5"):
        assert word in answer.message
    attempt, output, _ = on_meshes(smooth)
    beyond = jm.converge(attempt, output, accuracy=1e-12)
    assert not beyond.reached
    assert "float64" in beyond.message


def test_a_mesh_too_coarse_to_have_a_state_is_passed_over() -> None:
    attempt, output, meshes = on_meshes(smooth, fails_below=16)
    answer = jm.converge(attempt, output, accuracy=1e-4)
    assert answer.reached
    assert min(meshes) == 16
    attempt, output, _ = on_meshes(smooth, fails_below=1000)
    with pytest.raises(jm.SolveError, match="too coarse"):
        jm.converge(attempt, output, accuracy=1e-4, max_elements=64)


def test_a_homogeneous_state_needs_no_finer_mesh() -> None:
    sample = jm.thin_sample()

    def attempt(n: int, settings: jm.Settings) -> jm.State:
        return jm.contract(sample, T0=5.0, a_over_D=0.2, settings=settings)

    answer = jm.converge(attempt, lambda A: A.mean("stretches")[0], accuracy=1e-6)
    assert answer.reached
    assert len(answer.elements) == 2
    assert abs(answer.value / float(state().mean("stretches")[0]) - 1.0) <= 1e-6


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"accuracy": 0.5}, "accuracy = 0.5"),
        ({"accuracy": math.nan}, "accuracy = nan"),
        ({"accuracy": "best"}, "'fast', 'balanced', 'exact'"),
        ({"like": "cube"}, "like = 'cube'"),
        ({"max_elements": 1}, "max_elements = 1"),
        ({"value": 0.0}, "finite number other than 0"),
        ({"value": math.nan}, "finite number other than 0"),
    ],
)
def test_errors(change: dict[str, Any], says: str) -> None:
    attempt, output, _ = on_meshes(lambda n: change.get("value", 1.0))
    given = {k: v for k, v in change.items() if k != "value"}
    with pytest.raises(ValueError, match=says):
        jm.converge(attempt, output, **given)


def test_the_front_is_followed() -> None:
    finest = [first_setting(a, "radial", 256)[1] for a in (1e-2, 1e-3, 1e-4, 1e-6, 1e-8)]
    assert finest == sorted(finest)
    assert first_setting(1e-8, "radial", 8)[:2] == (2, 8)


@pytest.mark.slow
@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, 1e-6, 1e-8])
def test_the_outer_radius_of_the_tube(accuracy: float) -> None:
    from jaxmyo.tradeoff.bodies import BODIES

    assert BODIES["radial"].exact is not None
    exact = BODIES["radial"].exact()

    def attempt(n: int, settings: jm.Settings) -> jm.State:
        A = jm.contract(jm.radial_tube(n), T0=15.0, a_over_D=0.2, settings=settings)
        return jm.load(A, jm.Pressure("inner", 18.0), settings=settings)

    def outer(C: jm.State) -> Any:
        return 3.5 + C.u[int(C.scene.mesh.face("outer")[0, 0]), 0]

    answer = jm.converge(attempt, outer, accuracy=accuracy)
    assert answer.reached
    assert answer.value == pytest.approx(exact[0], rel=accuracy, abs=0.0)
