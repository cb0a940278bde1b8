"""Ventricles: filling and contraction, as a body of revolution and in three dimensions, with the Guccione law."""

from functools import cache
from typing import Any

import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo import solve

VENTRICLE = jm.Ventricle.from_axes(short_endo=7.0, long_endo=17.0, short_epi=10.0)  # mm
PRESSURE = 2.0  # kPa


@pytest.fixture(autouse=True)
def sparse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sparse factors also for the small meshes: only the elements are compiled, which is most of the time."""
    monkeypatch.setattr(solve, "LARGE", 0)


def revolution(elements: tuple[int, int], **options: Any) -> jm.Scene:
    return jm.axisymmetric_ventricle(VENTRICLE, elements, law=jm.guccione, constants=jm.LAND_ACTIVE, **options)


def body(elements: tuple[int, int, int], **options: Any) -> jm.Scene:
    return jm.ventricle_body(VENTRICLE, elements, law=jm.guccione, constants=jm.LAND_ACTIVE, **options)


@cache
def filled(elements: tuple[int, ...], base: str) -> tuple[jm.State, jm.State]:
    """At rest and under pressure."""
    make: Any = revolution if len(elements) == 2 else body
    rest = jm.contract(make(elements, base=base), T0=0.0, a_over_D=None)
    return rest, jm.load(rest, jm.Pressure("endo", PRESSURE, ends="closed"))


def volume(state: jm.State) -> float:
    return float(state.cavity_volume("endo"))


def apex(state: jm.State) -> float:
    """Height [mm] of the inner apex."""
    mesh = state.scene.mesh
    nodes = np.unique(mesh.face("endo"))
    heights = [float(mesh.coordinates.position(theta)[2]) for theta in mesh.points[nodes]]
    node = nodes[int(np.argmax(heights))]
    return float(mesh.coordinates.position(mesh.points[node] + np.asarray(state.u[node]))[2])


@pytest.mark.slow
def test_at_rest() -> None:
    rest, _ = filled((2, 8), "sliding")
    assert volume(rest) == pytest.approx(VENTRICLE.enclosed(VENTRICLE.lambda_endo), rel=1e-5)
    assert apex(rest) == pytest.approx(17.0, rel=1e-12)
    assert float(rest.stored_energy) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
def test_filling_converges_at_second_order() -> None:
    """Volume and apex of three nested meshes; no negative eigenvalue: the passive body is stable."""
    states = [filled((n, 4 * n), "sliding")[1] for n in (1, 2, 4)]
    for values, least in (([volume(s) for s in states], 1.5), ([apex(s) for s in states], 1.5)):
        steps = np.abs(np.diff(values))
        assert np.log2(steps[0] / steps[1]) > least, values
    for state in states:
        assert int(state.negative_eigenvalues) == 0


@pytest.mark.parametrize("base", ["sliding", "clamped"])
@pytest.mark.slow
def test_revolution_and_three_dimensions_agree(base: str) -> None:
    """Within the discretisation errors, extrapolated at second order from a coarser mesh of each."""
    families = [((1, 4), (2, 8)), ((1, 2, 8), (2, 4, 16))]
    limits, errors = [], []
    for coarse, fine in families:
        a, b = (volume(filled(n, base)[1]) for n in (coarse, fine))
        limits.append(b + (b - a) / 3.0)
        errors.append(abs(b - a) / 3.0)
    assert abs(limits[0] - limits[1]) < max(errors), (limits, errors)


@pytest.mark.slow
def test_volume_and_pressure_drive_alike() -> None:
    rest, by_pressure = filled((2, 8), "sliding")
    by_volume = jm.load(rest, jm.Volume("endo", volume(by_pressure)))
    assert float(by_volume.cavity_pressures[0]) == pytest.approx(PRESSURE, rel=1e-9)
    np.testing.assert_allclose(np.asarray(by_volume.u), np.asarray(by_pressure.u), rtol=0, atol=1e-9)


@pytest.mark.slow
def test_the_work_of_the_pressure_is_stored() -> None:
    """∫ P dV by Gauss's rule in V; the discrete body conserves energy on any mesh, so only the rule has an error."""
    rest, end = filled((2, 8), "sliding")
    at, weight = np.polynomial.legendre.leggauss(5)
    half = 0.5 * (volume(end) - volume(rest))
    pressures, state = [], rest
    for x in at:
        state = jm.load(rest, jm.Volume("endo", volume(rest) + half * (1.0 + float(x))), start=state)
        pressures.append(float(state.cavity_pressures[0]))
    stored = float(end.stored_energy)
    assert half * float(weight @ np.array(pressures)) == pytest.approx(stored, rel=1e-6)


@pytest.mark.slow
def test_the_base_slides_without_force() -> None:
    """The three nodes that hold the body in the plane of the base, and the rim that holds its twist, carry nothing."""
    _, three = filled((2, 4, 16), "sliding")
    for face, axis in (("rim+x", 1), ("rim-x", 1), ("rim+y", 0)):
        assert abs(float(three.reaction(face)[axis])) < 1e-8
    _, round_ = filled((2, 8), "sliding")
    assert abs(float(round_.reaction("rim")[2])) < 1e-8  # mN·mm
    # The cavity is closed by a cap that hands on its thrust to the rim: nothing is left for the base to carry.
    assert abs(float(three.reaction("base")[2])) < 1e-8


@pytest.mark.slow
def test_one_q_per_element_locks() -> None:
    """With the Lin–Yin law and the weave: the cavity of finer meshes contracts less, with one q per column it does not
    depend on the mesh."""
    volumes = {}
    for q_patches in (1, None):
        for n in (2, 4):
            scene = jm.axisymmetric_ventricle(VENTRICLE, (n, 4 * n), q_patches=q_patches)
            volumes[q_patches, n] = volume(jm.contract(scene, T0=5.0, a_over_D=0.2))
    assert abs(volumes[1, 4] - volumes[1, 2]) < 10.0
    assert volumes[None, 4] - volumes[None, 2] > 200.0


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: jm.axisymmetric_ventricle(VENTRICLE, (2, 4), q_patches=3), r"q_patches = 3 must be in \[1, 2\]"),
        (lambda: jm.axisymmetric_ventricle(VENTRICLE, (2, 4), base="loose"), "base"),
        (lambda: jm.ventricle_body(VENTRICLE, (1, 2, 6)), "multiple of 4"),
        (
            lambda: jm.axisymmetric_ventricle(jm.Ventricle.from_axes(7.0, 17.0, 10.0, base_z=-5.0), (1, 2)),
            "needs a base at the equator",
        ),
    ],
)
def test_ventricles_that_are_none(make: Any, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        make()


def test_a_base_below_the_equator_is_clamped() -> None:
    low = jm.Ventricle.from_axes(7.0, 17.0, 10.0, base_z=-5.0)
    scene = jm.axisymmetric_ventricle(low, (1, 2), base="clamped")
    assert scene.kinematics(()).size == 2 * 2 * 2 + 2
