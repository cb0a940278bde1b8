"""Passive neo-Hookean cylinders, a law of one's own, against their closed forms: inflation, extension, torsion.

The forces and moments of the radial scene are those of the whole tube. An incompressible tube with planar ends whose
inner radius, height and twist are known is known; the elements find what is not prescribed of these, the force and the
moment to second order. Where r is proportional to R, as in a solid cylinder, they are exact.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
import reference_tube as exact
from jax import Array
from scipy.optimize import brentq

import jaxmyo as jm

MU, RI, RO, HEIGHT = 10.0, 2.0, 3.5, 20.0  # kPa, mm
N = (8, 16)


def neo_hookean(C: Array, frame: Array, beta: Array, constants: Any) -> Array:
    return 0.5 * constants["mu"] * (jnp.trace(C) - 3.0)


@cache
def rest(n: int, Ri: float = RI) -> jm.State:
    """The passive state A without load: nothing but a pressure p = μ."""
    scene = jm.radial_tube(n, Ri=Ri, law=neo_hookean, constants={"mu": MU}, twist=True)
    return jm.contract(scene, T0=0.0, a_over_D=None)


def on_meshes(*conditions: Any) -> list[jm.State]:
    """The tube under these conditions, on both meshes at a time: most of the time is that of the compiler."""
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(lambda n: jm.load(rest(n), *conditions), N))


def held(lz: float, twist: float) -> tuple[Any, ...]:
    """Height ratio and twist per undeformed length [rad/mm] are prescribed."""
    return jm.Stretch("z", lz), jm.Displacement("z1", "phi", twist * HEIGHT)


def radii(state: jm.State) -> tuple[Any, Any]:
    """R and r of the nodes along the wall [mm]."""
    points, n = state.scene.mesh.points, len(state.scene.mesh.cells) + 1
    return points.reshape(n, 4, 3)[:, 0, 0], (points + np.asarray(state.u)).reshape(n, 4, 3)[:, 0, 0]


def top(state: jm.State) -> tuple[float, float]:
    """Height ratio and twist per undeformed length [rad/mm] of the upper end."""
    u = np.asarray(state.u)[np.unique(state.scene.mesh.face("z1"))]
    assert np.ptp(u[:, 1:], axis=0).max() < 1e-14
    return float(1.0 + u[0, 2] / HEIGHT), float(u[0, 1] / HEIGHT)


def measured(state: jm.State) -> Any:
    """Inner and outer radius [mm], axial force [mN] and moment [mN·mm] of the upper end."""
    _, r = radii(state)
    _, moment, force = np.asarray(state.reaction("z1"))
    return np.array([r[0], r[-1], force, moment])


def closed_form(P: float, lz: float, twist: float) -> Any:
    """What `measured` finds."""
    ri = exact.neo_hookean_radius(MU, RI, RO, P, lz, twist)
    loads = exact.neo_hookean_tube(MU, RI, RO, ri, lz, twist)
    np.testing.assert_allclose(loads.P, P, rtol=0, atol=1e-12)
    return np.array([ri, exact.tube_radius(RO, RI, ri, lz), loads.force, loads.moment])


def assert_second_order(coarse: Any, fine: Any) -> None:
    coarse, fine = np.abs(coarse), np.abs(fine)
    found = np.log2(coarse / fine)
    assert ((found >= 1.9) & (found <= 2.1)).all(), (coarse, fine, found)


def test_rest_is_free_of_stress() -> None:
    state = rest(8)
    np.testing.assert_allclose(np.asarray(state.p), MU, rtol=1e-13)
    np.testing.assert_allclose(np.asarray(state.u), 0.0, atol=1e-14)
    np.testing.assert_allclose(np.asarray(state.cauchy), 0.0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("P", "lz", "twist"),
    [
        (4.0, 1.0, 0.0),  # inflation
        (-3.0, 1.0, 0.0),
        (3.0, 1.2, 0.0),  # with extension
        (2.0, 0.9, 0.0),
        (0.0, 1.0, 0.1),  # torsion: the tube narrows, and pushes its ends apart
        (2.0, 1.2, -0.1),  # all three
    ],
)
def test_inflation_extension_and_torsion(P: float, lz: float, twist: float) -> None:
    expected = closed_form(P, lz, twist)
    states = on_meshes(*held(lz, twist), jm.Pressure("inner", P))
    for state in states:
        np.testing.assert_allclose(top(state), (lz, twist), rtol=0, atol=1e-14)
        assert int(state.negative_eigenvalues) == 0
    coarse, fine = (measured(s) - expected for s in states)
    moves = 4 if twist else 3
    assert_second_order(coarse[:moves], fine[:moves])
    assert (np.abs(fine[:3]) < 1e-3 * np.abs(expected[:3])).all()
    np.testing.assert_allclose(coarse[moves:], 0.0, atol=1e-11)
    # Extrapolated from two meshes: no error in h² is left.
    assert (np.abs((4.0 * fine - coarse) / 3.0) < 0.02 * np.abs(fine) + 1e-11).all()


@pytest.mark.slow
def test_pressure_is_found_from_the_radius() -> None:
    """The other way round: the closed form at the radius and height of the elements gives the pressure back."""
    errors = []
    for state in on_meshes(*held(1.2, 0.0), jm.Pressure("inner", 3.0)):
        _, r = radii(state)
        errors.append(exact.neo_hookean_tube(MU, RI, RO, float(r[0]), 1.2).P - 3.0)
    assert_second_order(*errors)


@pytest.mark.slow
def test_closed_ends() -> None:
    """The caps hang on the wall: it is stretched by the thrust π ri² P, which is no reaction."""
    P = 3.0

    def excess(lz: float) -> float:
        ri = exact.neo_hookean_radius(MU, RI, RO, P, lz)
        return exact.neo_hookean_tube(MU, RI, RO, ri, lz).force - np.pi * ri**2 * P

    lz = float(brentq(excess, 0.9, 1.2, xtol=1e-15))
    assert lz > 1.02
    ri = exact.neo_hookean_radius(MU, RI, RO, P, lz)
    errors = []
    for state in on_meshes(jm.Displacement("z1", "phi", 0.0), jm.Pressure("inner", P, ends="closed")):
        errors.append([radii(state)[1][0] - ri, top(state)[0] - lz])
        np.testing.assert_allclose(measured(state)[2:], 0.0, atol=1e-10)
        dv = np.asarray(state.system.weight) * np.linalg.det(np.asarray(state.F))
        axial = np.sum(dv * np.asarray(state.cauchy)[..., 2, 2]) / (HEIGHT * top(state)[0])
        np.testing.assert_allclose(axial, np.pi * radii(state)[1][0] ** 2 * P, rtol=1e-11)
    assert_second_order(*errors)


# ---------------------------------------------------------------------------------------------------------- exact


@pytest.mark.parametrize("Ri", [RI, 0.0], ids=["hollow", "solid"])
@pytest.mark.parametrize("lz", [0.8, 1.2, 1.5])
def test_homogeneous_extension_is_exact(lz: float, Ri: float) -> None:
    """r = R / √λ, and the nominal axial stress μ (λ − 1/λ²); σ = μ (λ² − 1/λ) along the axis and 0 across."""
    loads = (jm.Pressure("inner", 0.0),) if Ri else ()
    state = jm.load(rest(8, Ri), *held(lz, 0.0), *loads)
    R, r = radii(state)
    np.testing.assert_allclose(r, R / np.sqrt(lz), rtol=0, atol=1e-12)
    force = np.pi * (RO**2 - Ri**2) * MU * (lz - lz**-2)
    np.testing.assert_allclose(np.asarray(state.reaction("z1")), [0.0, 0.0, force], rtol=1e-11, atol=1e-10)
    np.testing.assert_allclose(np.asarray(state.p), MU / lz, rtol=1e-11)
    sigma = np.zeros((3, 3))
    sigma[2, 2] = MU * (lz**2 - 1.0 / lz)
    np.testing.assert_allclose(np.asarray(state.cauchy), np.broadcast_to(sigma, state.cauchy.shape), atol=1e-10)


@pytest.mark.parametrize("twist", [0.02, 0.1])
def test_torsion_of_a_solid_cylinder(twist: float) -> None:
    """At its length: r = R, moment ½ π μ t Ro⁴, and an axial force − ¼ π μ t² Ro⁴ (it would grow longer)."""
    ri, loads = exact.neo_hookean_torsion(MU, RO, twist)
    assert ri == 0.0
    np.testing.assert_allclose(loads.moment, 0.5 * np.pi * MU * twist * RO**4, rtol=1e-14)
    state = jm.load(rest(8, 0.0), *held(1.0, twist))
    R, r = radii(state)
    np.testing.assert_allclose(r, R, rtol=0, atol=1e-13)
    np.testing.assert_allclose(measured(state)[2:], [loads.force, loads.moment], rtol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("twist", [0.02, 0.1])
def test_a_twisted_cylinder_grows_longer(twist: float) -> None:
    """Free of axial force, λ³ = 1 + ¼ t² Ro²; r = R / √λ and the moment is ½ π μ t Ro⁴ / λ.

    From σzz = μ (λ² − 1/λ) − ½ μ t² (ro² − r²) and σzφ = μ λ t r.
    """
    lz = (1.0 + 0.25 * twist**2 * RO**2) ** (1.0 / 3.0)
    state = jm.load(rest(8, 0.0), jm.Displacement("z1", "phi", twist * HEIGHT))
    R, r = radii(state)
    np.testing.assert_allclose(top(state), (lz, twist), rtol=0, atol=1e-13)
    np.testing.assert_allclose(r, R / np.sqrt(lz), rtol=0, atol=1e-13)
    moment = 0.5 * np.pi * MU * twist * RO**4 / lz
    np.testing.assert_allclose(measured(state)[2:], [0.0, moment], rtol=1e-11, atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("cartesian", [False, True], ids=["cylindrical", "cartesian"])
def test_homogeneous_extension_of_a_sector(cartesian: bool) -> None:
    """In three dimensions, by curved and by straight hexahedra; the force is that of the quarter of the section."""
    lz = 1.2
    scene = jm.tube_sector((2, 2, 2), cartesian=cartesian, law=neo_hookean, constants={"mu": MU})
    state = jm.load(jm.contract(scene, T0=0.0, a_over_D=None), jm.Stretch("z", lz))
    points, u = scene.mesh.points, np.asarray(state.u)
    scale = np.array([lz**-0.5, lz**-0.5, lz]) if cartesian else np.array([lz**-0.5, 1.0, lz])
    np.testing.assert_allclose(points + u, points * scale, rtol=0, atol=1e-12)
    section = 2.0 * np.sum(np.asarray(state.system.weight)) / HEIGHT
    assert cartesian or abs(section - 0.25 * np.pi * (RO**2 - RI**2)) < 1e-12
    np.testing.assert_allclose(float(state.reaction("z1")[2]), section * MU * (lz - lz**-2), rtol=1e-11)
