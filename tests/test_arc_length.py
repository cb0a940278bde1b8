"""Branches followed by arc length: limit points of balloons and tubes, Rivlin's cube, against their closed forms."""

from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference_tube as exact
import test_closed_forms as bodies
from scipy.optimize import brentq, minimize_scalar

import jaxmyo as jm
from jaxmyo import solve, sparse

MU = bodies.MU
neo_hookean = bodies.neo_hookean


def _sphere(theta: Any) -> Any:
    r, polar, phi = theta
    out = jnp.stack([jnp.sin(polar) * jnp.cos(phi), jnp.sin(polar) * jnp.sin(phi), jnp.cos(polar)])
    return r * out


def _sphere_scale(theta: Any) -> Any:
    r, polar, _ = theta
    return jnp.stack([jnp.ones_like(r), r, r * jnp.sin(polar)])


SPHERICAL = jm.Coordinates("spherical", ("r", "theta", "phi"), ("mm", "rad", "rad"), _sphere, _sphere_scale)


@cache
def balloon(n: int, Ri: float, Ro: float) -> jm.State:
    """A piece of a sphere about its equator, u_r(R): the angles are the same factor in stresses and in the pressure."""
    mesh = jm.structured([np.linspace(Ri, Ro, n + 1), np.array([1.3, 1.8]), np.array([0.0, 0.4])], SPHERICAL)
    mesh = jm.Mesh(mesh.points, mesh.cells, {**mesh.faces, "inner": mesh.face("r0")}, coordinates=SPHERICAL)
    held = [jm.Displacement(f, a, 0.0) for a, f in (("theta", "theta0"), ("phi", "phi0"))]
    ties = [jm.Uniform("r", ("theta", "phi")), *(jm.Uniform(a, ("r", "theta", "phi")) for a in ("theta", "phi"))]
    return jm.contract(jm.Scene(mesh, neo_hookean, {"mu": MU}, supports=(*ties, *held)), T0=0.0, a_over_D=None)


def inner(state: jm.State) -> float:
    """The inner radius [mm]; nodes of the first radius are first."""
    nodes = np.unique(state.scene.mesh.face("inner"))
    return float(state.scene.mesh.points[nodes[0], 0] + np.asarray(state.u)[nodes[0], 0])


def greatest(Ri: float, Ro: float) -> tuple[float, float]:
    """(inner radius, pressure) of the limit point of a sphere [mm, kPa]."""
    found = minimize_scalar(
        lambda ri: -exact.neo_hookean_sphere(MU, Ri, Ro, ri), bounds=(1.1 * Ri, 3.0 * Ri), options={"xatol": 1e-12}
    )
    return float(found.x), -float(found.fun)


def inflated(n: int, Ri: float, Ro: float, until: float) -> jm.Trace:
    """Under a pressure that it never holds, until the inner radius [mm] is as large as that."""
    load = jm.Pressure("inner", 2.0 * greatest(Ri, Ro)[1])
    return jm.trace(balloon(n, Ri, Ro), load, stop=lambda s: inner(s) > until)


@pytest.mark.slow
def test_a_sphere_beyond_its_limit_point() -> None:
    """The limit is the greatest pressure, as far as four elements tell; beyond it one mode is unstable."""
    Ri, Ro = 1.0, 2.0
    path = inflated(4, Ri, Ro, 2.6)
    ri, P = greatest(Ri, Ro)
    assert path.status is jm.Status.CONVERGED
    assert bool(path.states.converged.all())
    assert float(path.states.residual.max()) <= 1e-12
    (top,) = path.limit_points
    assert not path.bifurcations
    np.testing.assert_allclose(2.0 * P * top.load, P, rtol=2e-2)
    np.testing.assert_allclose(inner(top.state), ri, rtol=2e-2)
    assert path.load.max() <= top.load
    turn = int(np.argmax(path.load))
    assert (np.diff(path.load[: turn + 1]) > 0.0).all()
    assert (np.diff(path.load[turn + 1 :]) < 0.0).all()
    assert inner(path.states[-2]) <= 2.6 < inner(path.states[-1])
    negative = np.asarray(path.states.negative_eigenvalues)
    beyond = np.array([inner(path.states[i]) > inner(top.state) for i in range(len(path.load))])
    np.testing.assert_array_equal(negative, beyond)
    assert "unstable: 1 mode, after" in path.states[-1].message


@pytest.mark.slow
def test_a_sphere_by_radius_and_by_pressure() -> None:
    """Each state of the branch is the one of its inner radius, prescribed; `load` stops at the limit point."""
    Ri, Ro = 1.0, 2.0
    path, P = inflated(4, Ri, Ro, 2.6), greatest(Ri, Ro)[1]
    (top,) = path.limit_points
    for i in (2, -1):
        state = path.states[i]
        held = jm.load(balloon(4, Ri, Ro), jm.Displacement("r0", "r", inner(state) - Ri))
        np.testing.assert_allclose(np.asarray(held.u), np.asarray(state.u), rtol=0, atol=1e-9)
        area = 0.5 * 0.4 * inner(state) ** 2 * np.mean(np.sin(1.55 + 0.25 / np.sqrt(3.0) * np.array([-1.0, 1.0])))
        np.testing.assert_allclose(float(held.reaction("r0")[0]), 2.0 * P * path.load[i] * area, rtol=1e-8)
    refused = jm.load(balloon(4, Ri, Ro), jm.Pressure("inner", 2.0 * P), throw=False)
    assert int(refused.status) == jm.Status.LIMIT_POINT
    np.testing.assert_allclose(float(refused.reached), top.load, rtol=1e-6)
    loaded = jm.load(balloon(4, Ri, Ro), jm.Pressure("inner", 0.9 * P))
    whole = jm.trace(balloon(4, Ri, Ro), jm.Pressure("inner", 0.9 * P))
    np.testing.assert_allclose(np.asarray(whole.states[-1].u), np.asarray(loaded.u), rtol=0, atol=1e-11)


def test_where_a_trace_ends() -> None:
    """At the load, if it is reached; after its steps; with the last state, where an input is none."""
    A, P = balloon(4, 1.0, 2.0), greatest(1.0, 2.0)[1]
    whole = jm.trace(A, jm.Pressure("inner", 0.9 * P))
    assert whole.load[-1] == 1.0
    part = jm.trace(A, jm.Pressure("inner", 2.0 * P), steps=3)
    assert len(part.load) == 4
    assert part.status is jm.Status.CONVERGED
    assert repr(part).startswith("Trace: 4 states, the last at ")
    assert f"Pressure('inner') {2.0 * P * part.load[-1]:.7g} kPa" in repr(part.states[-1])
    on = jm.trace(A, jm.Pressure("inner", 0.4 * P), start=part.states[-1])
    np.testing.assert_allclose(np.asarray(on.states[0].u), np.asarray(part.states[-1].u), rtol=0, atol=1e-11)
    assert on.load[-1] == 1.0
    late = jm.trace(A, jm.Pressure("inner", P), settings=jm.Settings(time_limit=0.0), throw=False)
    assert late.status is jm.Status.TIME_LIMIT
    with pytest.raises(jm.SolveError, match="TIME_LIMIT"):
        jm.trace(A, jm.Pressure("inner", P), settings=jm.Settings(time_limit=0.0))


@pytest.mark.parametrize(
    ("options", "error", "said"),
    [
        ({"steps": 0}, ValueError, "steps = 0 must be an integer"),
        ({"move": 0.0}, ValueError, r"move = 0 is outside \(0, 1\]"),
        ({"move": float("nan")}, ValueError, "move = nan is outside"),
    ],
)
def test_bad_input(options: dict[str, Any], error: type[Exception], said: str) -> None:
    with pytest.raises(error, match=said):
        jm.trace(balloon(4, 1.0, 2.0), jm.Pressure("inner", 1.0), **options)


def test_not_inside_jit() -> None:
    A = balloon(4, 1.0, 2.0)
    with pytest.raises(TypeError, match="outside of jit, vmap and grad"):
        jax.jit(lambda P: jm.trace(A, jm.Pressure("inner", P)).load)(1.0)


# ------------------------------------------------------------------------------------------------ limits to 1e-4


@pytest.mark.slow
def test_the_limit_of_a_thin_balloon() -> None:
    """λ = 7^(1/6) of the middle of a wall that gets thin, where the pressure is 2 μ h/R (1/λ − 1/λ⁷)."""
    ideal, off = 7.0 ** (1.0 / 6.0), []
    for h in (0.1, 0.01, 0.001):
        (top,) = inflated(32, 1.0 - 0.5 * h, 1.0 + 0.5 * h, 1.8).limit_points
        P = 2.0 * greatest(1.0 - 0.5 * h, 1.0 + 0.5 * h)[1] * top.load
        off.append(
            [
                float(inner(top.state) / (1.0 - 0.5 * h)) / ideal - 1.0,
                P / (2 * MU * h * (1 / ideal - 1 / 7 / ideal)) - 1,
            ]
        )
        middle = np.asarray(top.state.stretches)[15:17, :, 1].mean()
        off[-1].append(middle / ideal - 1.0)
    print("thin balloon, λ inner, P, λ middle:", off)
    assert abs(off[2][2]) < 1e-4
    assert abs(off[2][1]) < 1e-4
    assert abs(off[1][2]) < abs(off[0][2])


@pytest.mark.slow
def test_the_limit_of_a_thick_sphere() -> None:
    Ri, Ro = 1.0, 2.0
    ri, P = greatest(Ri, Ro)
    (top,) = inflated(32, Ri, Ro, 2.6).limit_points
    print("thick sphere:", 2.0 * top.load - 1.0, inner(top.state) / ri - 1.0)
    np.testing.assert_allclose(2.0 * P * top.load, P, rtol=1e-4)
    np.testing.assert_allclose(inner(top.state), ri, rtol=1e-3)


@pytest.mark.slow
def test_the_limit_of_a_thick_tube_with_closed_ends() -> None:
    """Its wall carries the thrust of the pressure, π ri² P; it is filled beyond, by volume, to the same states."""

    def pressure(ri: float) -> float:
        def excess(lz: float) -> float:
            loads = exact.neo_hookean_tube(MU, 2.0, 3.5, ri, lz)
            return loads.force - np.pi * ri**2 * loads.P

        return exact.neo_hookean_tube(MU, 2.0, 3.5, ri, float(brentq(excess, 0.8, 3.0, xtol=1e-14))).P

    best = minimize_scalar(lambda ri: -pressure(ri), bounds=(2.2, 4.5), options={"xatol": 1e-12})
    A = jm.contract(jm.radial_tube(32, law=neo_hookean, constants={"mu": MU}), T0=0.0, a_over_D=None)
    path = jm.trace(A, jm.Pressure("inner", 8.0, ends="closed"), stop=lambda s: 2.0 + float(s.u[0, 0]) > 5.0)
    (top,) = path.limit_points
    print("thick tube:", -8.0 * top.load / best.fun - 1.0)
    np.testing.assert_allclose(8.0 * top.load, -best.fun, rtol=1e-4)
    np.testing.assert_allclose(2.0 + float(top.state.u[0, 0]), best.x, rtol=1e-3)
    for state, load in ((top.state, top.load), (path.states[-1], path.load[-1])):
        filled = jm.load(A, jm.Volume("inner", float(state.cavity_volume("inner"))))
        np.testing.assert_allclose(float(filled.cavity_pressures[0]), 8.0 * load, rtol=1e-8)
        np.testing.assert_allclose(np.asarray(filled.u), np.asarray(state.u), rtol=0, atol=1e-7)


@pytest.mark.slow
def test_the_active_tube_without_the_weave_reaches_its_load_behind_two_limit_points() -> None:
    """7.22 kPa at first, which stops `load`; the branch turns again and comes to 18 kPa."""
    limits = []
    for n in (16, 32):
        A = jm.contract(jm.radial_tube(n), T0=15.0, a_over_D=None)
        path = jm.trace(A, jm.Pressure("inner", 18.0))
        assert path.load[-1] == 1.0
        assert [p.load < 0.5 for p in path.limit_points] == [True, True]
        assert int(path.states[-1].negative_eigenvalues) == 0
        limits.append(18.0 * path.limit_points[0].load)
    print("active tube:", limits)
    np.testing.assert_allclose(limits[1], 7.220144, rtol=1e-4)
    np.testing.assert_allclose((4.0 * limits[1] - limits[0]) / 3.0, 7.220144, rtol=1e-6)


@pytest.mark.slow
def test_a_large_body_passes_its_limit_point(monkeypatch: pytest.MonkeyPatch) -> None:
    """By sparse factors, as by dense ones; the limit is found to 1e-8."""
    found = []
    for large in (0, 10_000):
        monkeypatch.setattr(solve, "LARGE", large)
        sparse.forget()
        bodies.sphere.cache_clear()
        path = jm.trace(
            bodies.sphere(2), jm.Pressure("inner", 12.0, ends="closed"), stop=lambda s: bodies.inner_radius(s) > 2.4
        )
        (top,) = path.limit_points
        assert float(path.states.residual.max()) <= 1e-12
        found.append((top.load, np.asarray(top.state.u), path.states.solver))
    bodies.sphere.cache_clear()
    assert found[1][2] == "dense LU" != found[0][2]
    np.testing.assert_allclose(found[0][0], found[1][0], rtol=1e-8)
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=0, atol=1e-5)


# --------------------------------------------------------------------------------------------------- Rivlin's cube


@cache
def cube(n: int) -> jm.State:
    """A neo-Hookean cube between three planes of symmetry; of one element only homogeneous deformations are asked."""
    mesh = jm.box((1.0, 1.0, 1.0), (n, n, n))
    ties = [jm.Homogeneous()] if n == 1 else []
    scene = jm.Scene(mesh, neo_hookean, {"mu": MU}, supports=(*bodies.SYMMETRIES, *ties))
    return jm.contract(scene, T0=0.0, a_over_D=None)


def pulled(t: float, along_z: float | None = None) -> list[jm.Traction]:
    """Dead tractions t [kPa] on all faces."""
    each = (t, t, t if along_z is None else along_z)
    return [jm.Traction(f"{a}1", tuple(np.eye(3)[k] * each[k])) for k, a in enumerate("xyz")]


@pytest.mark.slow
@pytest.mark.parametrize("n", [1, 2])
def test_rivlins_cube_is_unstable_from_twice_its_modulus(n: int) -> None:
    """Two modes at once: the stretches of a cube have two ways at constant volume."""
    before, after = (jm.load(cube(n), *pulled(t * MU)) for t in (1.999, 2.001))
    for state in (before, after):
        np.testing.assert_allclose(np.asarray(state.stretches), 1.0, atol=1e-12)
    assert int(before.negative_eigenvalues) == 0
    assert int(after.negative_eigenvalues) == 2
    path = jm.trace(cube(n), *pulled(2.5 * MU))
    assert not path.limit_points
    np.testing.assert_allclose(2.5 * path.bifurcations[0].load, 2.0, rtol=1e-6)


@pytest.mark.slow
def test_the_secondary_branch_of_rivlins_cube() -> None:
    """Stretches (l, l, l⁻²) with t = μ (l + l⁻²): found from a load that is not quite equal, then under equal ones.

    The branch begins at t = 2 μ with l = 1 and has its least load, 3 μ / 4^⅓, at l = 2^⅓: a limit point.
    """
    t = 2.2 * MU
    path = jm.trace(cube(1), *pulled(t, 0.995 * t), steps=200, move=0.05)
    assert path.load[-1] == 1.0
    assert len(path.limit_points) == 2
    plate = jm.load(cube(1), *pulled(t), start=path.states[-1])
    wide, other, thin = np.asarray(plate.stretches)[0].mean(axis=0)
    np.testing.assert_allclose([other, thin], [wide, wide**-2], rtol=1e-10)
    np.testing.assert_allclose(MU * (wide + wide**-2), t, rtol=1e-10)
    assert wide > 2.0 ** (1.0 / 3.0)
    assert int(plate.negative_eigenvalues) == 0
    back = jm.trace(cube(1), *pulled(0.0), start=plate, steps=200, move=0.05)  # λ = 1 is the cube without load
    lowest = back.limit_points[0]
    np.testing.assert_allclose((1.0 - lowest.load) * 2.2, 3.0 / 4.0 ** (1.0 / 3.0), rtol=1e-8)
    np.testing.assert_allclose(np.asarray(lowest.state.stretches)[0, 0, 0], 2.0 ** (1.0 / 3.0), rtol=1e-5)
    for state, load in zip((back.states[i] for i in range(5)), back.load, strict=False):
        x = np.asarray(state.stretches)[0].mean(axis=0)
        np.testing.assert_allclose(x[0] + x[0] ** -2, 2.2 * (1.0 - load), rtol=1e-10)
        np.testing.assert_allclose(x[2], x[0] ** -2, rtol=1e-10)


@pytest.mark.slow
def test_from_tissue_at_rest_that_has_no_stiffness() -> None:
    """The tangent is singular at the start, and nowhere else."""
    A = jm.contract(jm.thin_sample(), T0=0.0, a_over_D=None, beta=0.0)
    assert int(A.zero_eigenvalues) > 0
    path = jm.trace(A, jm.Traction("y1", (0.0, 1.0, 0.0)), steps=10)
    assert float(path.states.residual.max()) <= 1e-12
    loaded = jm.load(A, jm.Traction("y1", (0.0, float(path.load[-1]), 0.0)))
    np.testing.assert_allclose(np.asarray(path.states[-1].u), np.asarray(loaded.u), rtol=0, atol=1e-8)
