"""Large bodies in Cartesian hexahedra against closed forms: sphere, tube, torsion, patch test, own weight.

The law is ½ μ (I1 − 3 − ln I3): of an incompressible body ½ μ (I1 − 3) with another pressure, and stable in the
elements too (`jaxmyo.linear`, `inertia`).
"""

from collections.abc import Iterator
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference_tube as exact
from scipy.optimize import brentq

import jaxmyo as jm
from jaxmyo import solve, sparse
from jaxmyo.mesh import boundary, jitter

MU = 10.0  # kPa
#: From how many displacements on the sparse solver is taken; the dense one compiles for longer.
SOLVERS = [pytest.param(1000, id="dense", marks=pytest.mark.slow), pytest.param(0, id="sparse")]
SYMMETRIES = (jm.Symmetry("x"), jm.Symmetry("y"), jm.Symmetry("z"))


def neo_hookean(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    return 0.5 * constants["mu"] * (jnp.trace(C) - 3.0 - jnp.log(jnp.linalg.det(C)))


@pytest.fixture
def always_sparse(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Small meshes too; the first of two meshes must not be solved otherwise than the second."""
    monkeypatch.setattr(solve, "LARGE", 0)
    sparse.forget()
    yield
    sparse.forget()


def passive(mesh: jm.Mesh, supports: Any) -> jm.State:
    scene = jm.Scene(mesh, neo_hookean, {"mu": MU}, supports=supports)
    return jm.contract(scene, T0=0.0, a_over_D=None)


def with_single_nodes(mesh: jm.Mesh, nodes: Any) -> jm.Mesh:
    """With a face of its own for each of these nodes, "n7" for example: a quad whose corners are all this node."""
    faces = {**mesh.faces, **{f"n{k}": np.full((1, 4), k) for k in nodes}}
    return jm.Mesh(mesh.points, mesh.cells, faces)


def moved(nodes: Any, u: Any, axes: str = "xyz") -> list[jm.Displacement]:
    """Prescribed displacements u (n_nodes, 3) at single nodes."""
    return [jm.Displacement(f"n{k}", a, float(u[k, "xyz".index(a)])) for k in nodes for a in axes]


def assert_second_order(coarse: Any, fine: Any, least: float = 3.5, most: float = 4.5) -> None:
    ratio = np.abs(coarse) / np.abs(fine)
    assert ((ratio > least) & (ratio < most)).all(), (coarse, fine, ratio)


# ------------------------------------------------------------------------------------------------------------ sphere

RI, RO = 1.0, 2.0  # mm


def octant(n: int) -> jm.Mesh:
    """An eighth of a thick sphere: three patches of n × n × n hexahedra that meet on the diagonal."""
    t, r = np.tan(np.linspace(0.0, 0.25 * np.pi, n + 1)), np.linspace(RI, RO, n + 1)
    patch = jm.structured([np.arange(n + 1.0)] * 3)
    i, j, k = patch.points.astype(int).T
    direction = np.stack([np.ones(len(i)), t[i], t[j]], axis=1)
    own = r[k][:, None] * direction / np.linalg.norm(direction, axis=1)[:, None]
    points = np.concatenate([np.roll(own, s, axis=1) for s in range(3)])
    _, first, which = np.unique(np.round(points, 9) + 0.0, axis=0, return_index=True, return_inverse=True)
    points = points[first]
    cells = which.reshape(-1)[np.concatenate([patch.cells + s * len(own) for s in range(3)])]
    quads = boundary(cells)
    radius = np.linalg.norm(points[quads], axis=2)
    faces = {"inner": quads[(radius < RI + 1e-9).all(axis=1)], "outer": quads[(radius > RO - 1e-9).all(axis=1)]}
    faces |= {f"{a}0": quads[(np.abs(points[quads, k]) < 1e-9).all(axis=1)] for k, a in enumerate("xyz")}
    assert sum(map(len, faces.values())) == len(quads)
    return jm.Mesh(points, cells, faces)


@cache
def sphere(n: int) -> jm.State:
    return passive(octant(n), SYMMETRIES)


def inner_radius(state: jm.State) -> float:
    """Of the sphere of the cavity's volume, as a ratio to that at rest (of the hexahedra) [mm]."""
    at_rest = float(sphere_of(state).cavity_volume("inner"))
    return RI * float(np.cbrt(float(state.cavity_volume("inner")) / at_rest))


def sphere_of(state: jm.State) -> jm.State:
    return sphere(round((len(state.scene.mesh.cells) / 3) ** (1 / 3)))


def filled(n: int, ri: float, start: jm.State | None = None) -> jm.State:
    volume = float(sphere(n).cavity_volume("inner")) * (ri / RI) ** 3
    return jm.load(sphere(n), jm.Volume("inner", volume), start=start)


def limit_of_the_sphere() -> float:
    """The inner radius of the greatest pressure [mm]."""

    def slope(ri: float) -> float:
        return exact.neo_hookean_sphere(MU, RI, RO, ri + 1e-5) - exact.neo_hookean_sphere(MU, RI, RO, ri - 1e-5)

    return float(brentq(slope, 1.2, 3.0))


@pytest.mark.usefixtures("always_sparse")
@pytest.mark.slow
def test_filling_a_sphere_beyond_its_limit_point() -> None:
    """The pressure at prescribed volumes, at second order, before and beyond the greatest pressure."""
    limit = limit_of_the_sphere()
    assert 1.8 < limit < 1.9
    radii = (1.4, limit, 2.5)
    expected = np.array([exact.neo_hookean_sphere(MU, RI, RO, ri) for ri in radii])
    errors = []
    for n in (4, 8):
        state, found = None, []
        for ri in radii:
            state = filled(n, ri, state)
            assert state.converged
            np.testing.assert_allclose(inner_radius(state), ri, rtol=1e-11)
            np.testing.assert_allclose(np.linalg.det(np.asarray(state.F)).mean(), 1.0, atol=1e-2)
            found.append(float(state.cavity_pressures[0]))
        assert found[2] < found[1] > found[0]
        errors.append(np.array(found) - expected)
    assert (np.abs(errors[1]) < 4e-3 * expected).all()
    assert_second_order(*errors, 3.8, 4.2)


@pytest.mark.slow
@pytest.mark.usefixtures("always_sparse")
@pytest.mark.parametrize("ends", ["open", "closed"])
def test_filling_and_pressure_are_one_before_the_limit_point(ends: Any) -> None:
    """Open ends too: the rim lies in the planes of symmetry."""
    by_volume = filled(4, 1.4)
    pressure = float(by_volume.cavity_pressures[0])
    by_pressure = jm.load(sphere(4), jm.Pressure("inner", pressure, ends=ends))
    np.testing.assert_allclose(float(by_pressure.cavity_volume("inner")), float(by_volume.cavity_volume("inner")), 1e-9)
    np.testing.assert_allclose(np.asarray(by_pressure.u), np.asarray(by_volume.u), rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.asarray(by_pressure.p), np.asarray(by_volume.p), rtol=0, atol=1e-8)


@pytest.mark.usefixtures("always_sparse")
def test_a_pressure_beyond_the_limit_point_is_refused() -> None:
    with pytest.raises(jm.SolveError) as failure:
        jm.load(sphere(4), jm.Pressure("inner", 8.6, ends="closed"))
    state = failure.value.state
    assert isinstance(state, jm.State)
    assert int(state.status) == jm.Status.LIMIT_POINT
    greatest = exact.neo_hookean_sphere(MU, RI, RO, limit_of_the_sphere())
    assert 0.98 * greatest < 8.6 * float(state.reached) < 1.02 * greatest
    assert 1.7 < inner_radius(state) < 1.95


@pytest.mark.usefixtures("always_sparse")
def test_a_filled_sphere_is_stable_beyond_its_limit_point() -> None:
    """At a prescribed volume nothing snaps."""
    assert int(filled(4, 2.5).negative_eigenvalues) == 0


@pytest.mark.slow
def test_a_filled_sphere_by_dense_factors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stable beyond the limit point too, and the same as by sparse ones."""
    dense = [filled(2, ri) for ri in (1.4, 2.5)]
    assert {s.solver for s in dense} == {"dense LU"}
    assert {int(s.negative_eigenvalues) for s in dense} == {0}
    monkeypatch.setattr(solve, "LARGE", 0)
    for state, reference in zip([filled(2, ri) for ri in (1.4, 2.5)], dense, strict=True):
        assert state.solver != "dense LU"
        np.testing.assert_allclose(np.asarray(state.u), np.asarray(reference.u), rtol=0, atol=1e-9)


# -------------------------------------------------------------------------------------------------------------- tube

TUBE_RI, TUBE_RO, HEIGHT = 2.0, 3.5, 1.0  # mm


@cache
def tube(n: int) -> jm.State:
    """A quarter of a tube in straight hexahedra, its ends planar."""
    nodes = [
        np.linspace(TUBE_RI, TUBE_RO, n + 1),
        np.linspace(0.0, 0.5 * np.pi, 2 * n + 1),
        [0.0, 0.5 * HEIGHT, HEIGHT],
    ]
    mesh = jm.structured(nodes, jm.CYLINDRICAL).mapped(jm.CYLINDRICAL.position)
    names = {"r0": "inner", "r1": "outer", "phi0": "y0", "phi1": "x0"}
    mesh = jm.Mesh(mesh.points, mesh.cells, {names.get(k, k): quads for k, quads in mesh.faces.items()})
    return passive(mesh, (*SYMMETRIES, jm.Planar("z1", "z")))


@pytest.mark.usefixtures("always_sparse")
@pytest.mark.slow
def test_a_tube_is_inflated_and_stretched() -> None:
    """Inner radius, from the volume, and axial force of the wall at second order; by pressure and by volume."""
    P, lz = 3.0, 1.2
    ri = exact.neo_hookean_radius(MU, TUBE_RI, TUBE_RO, P, lz)
    force = 0.25 * exact.neo_hookean_tube(MU, TUBE_RI, TUBE_RO, ri, lz).force
    errors = []
    for n in (4, 8):
        at_rest = tube(n)
        state = jm.load(at_rest, jm.Stretch("z", lz), jm.Pressure("inner", P))
        volume = float(state.cavity_volume("inner"))
        found = TUBE_RI * np.sqrt(volume / float(at_rest.cavity_volume("inner")) / lz)
        errors.append([found - ri, float(state.reaction("z1")[2]) - force])
        if n == 4:
            same = jm.load(at_rest, jm.Stretch("z", lz), jm.Volume("inner", volume))
            np.testing.assert_allclose(np.asarray(same.cavity_pressures), P, rtol=1e-9)
            np.testing.assert_allclose(np.asarray(same.u), np.asarray(state.u), rtol=0, atol=1e-9)
    assert (np.abs(errors[1]) < 0.02 * np.array([ri, force])).all()
    assert_second_order(*errors)


# ----------------------------------------------------------------------------------------------------------- torsion


def rod(n: int, radius: float, height: float) -> jm.Mesh:
    """A solid cylinder of n × n × n straight hexahedra; a square is drawn on its section."""
    mesh = jm.structured([np.linspace(-1.0, 1.0, n + 1)] * 2 + [np.linspace(0.0, height, n + 1)])
    x, y, z = mesh.points.T
    points = np.stack([radius * x * np.sqrt(1.0 - 0.5 * y**2), radius * y * np.sqrt(1.0 - 0.5 * x**2), z], axis=1)
    # The corners of the square must not become flat angles: halfway between circle and square inside.
    inside = np.maximum(np.abs(x), np.abs(y))[:, None] ** 2
    points[:, :2] = inside * points[:, :2] + (1.0 - inside) * 0.75 * radius * np.stack([x, y], axis=1)
    return jm.Mesh(points, mesh.cells, mesh.faces)


@pytest.mark.slow
@pytest.mark.usefixtures("always_sparse")
def test_torsion_of_a_solid_cylinder() -> None:
    """At its length: r = R, moment ½ π μ t Ro⁴, axial force −¼ π μ t² Ro⁴, at second order; the sides are free."""
    radius, height, twist = 1.0, 1.0, 0.4  # mm, mm, rad/mm
    _, loads = exact.neo_hookean_torsion(MU, radius, twist)
    errors = []
    for n in (4, 8):
        mesh = rod(n, radius, height)
        ends = np.unique(mesh.face("z1"))
        mesh = with_single_nodes(mesh, ends)
        X, Y, Z = mesh.points.T
        cos, sin = np.cos(twist * Z), np.sin(twist * Z)
        u = np.stack([X * cos - Y * sin - X, X * sin + Y * cos - Y, 0.0 * Z], axis=1)
        state = jm.load(passive(mesh, [jm.Displacement("z0", a) for a in "xyz"]), *moved(ends, u))
        x, f = mesh.points + np.asarray(state.u), np.asarray(state.reactions)
        moment = float(np.sum(x[ends, 0] * f[ends, 1] - x[ends, 1] * f[ends, 0]))
        np.testing.assert_allclose(f.sum(axis=0), 0.0, atol=1e-9)
        np.testing.assert_allclose(np.cross(x, f).sum(axis=0), 0.0, atol=1e-9)
        errors.append([moment - loads.moment, f[ends, 2].sum() - loads.force, np.abs(np.asarray(state.u) - u).max()])
    assert (np.abs(errors[1][:2]) < 0.05 * np.abs([loads.moment, loads.force])).all(), errors
    assert_second_order(np.array(errors[0])[:2], np.array(errors[1])[:2], 3.3, 5.0)
    assert errors[1][2] < 0.4 * errors[0][2] < 0.02


# -------------------------------------------------------------------------------------------------------- patch test


def fibrous(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    i4 = frame[0] @ C @ frame[0]
    return neo_hookean(C, frame, beta, constants) + 0.5 * constants["k"] * (i4 - 1.0) ** 2


@pytest.mark.parametrize("large", SOLVERS)
def test_a_homogeneous_state_on_a_distorted_mesh(large: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of the surface moves by x = F X, dead loads act on the other: x = F X and one p everywhere, exactly."""
    monkeypatch.setattr(solve, "LARGE", large)
    mesh = jitter(jm.box((1.0, 1.3, 0.8), (3, 3, 3)), 0.3, seed=2)
    held = np.unique(np.concatenate([mesh.face(f"{a}0") for a in "xyz"]))
    fibre, constants, p = np.array([0.6, 0.8, 0.0]), {"mu": MU, "k": 5.0}, 3.0
    F = np.array([[1.1, 0.15, 0.05], [-0.05, 0.9, 0.1], [0.1, 0.0, 1.0]])
    F /= np.cbrt(np.linalg.det(F))
    frame = np.stack([fibre, [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    by_F = jax.grad(lambda F: fibrous(F.T @ F, frame, 0.0, constants) - 0.5 * p * (jnp.linalg.det(F.T @ F) - 1.0))
    nominal = np.asarray(by_F(jnp.asarray(F)))
    scene = jm.Scene(
        with_single_nodes(mesh, held),
        fibrous,
        constants,
        fibre=tuple(fibre),
        cross=(-0.8, 0.6, 0.0),
        supports=moved(held, np.zeros(mesh.points.shape)),
    )
    u = mesh.points @ (F - np.eye(3)).T
    tractions = [jm.Traction(f"{a}1", nominal[:, k]) for k, a in enumerate("xyz")]
    state = jm.load(jm.contract(scene, T0=0.0, a_over_D=None), *moved(held, u), *tractions)
    assert (state.solver == "dense LU") == (large > 0)
    np.testing.assert_allclose(np.asarray(state.u), u, rtol=0, atol=1e-10)
    np.testing.assert_allclose(np.asarray(state.p), p, rtol=0, atol=1e-8)
    np.testing.assert_allclose(np.asarray(state.F), np.broadcast_to(F, state.F.shape), rtol=0, atol=1e-9)
    stress = nominal @ F.T
    np.testing.assert_allclose(np.asarray(state.cauchy), np.broadcast_to(stress, state.F.shape), rtol=0, atol=1e-8)


# -------------------------------------------------------------------------------------------------------- own weight


def hanging(weight: float) -> jm.State:
    """A column 1 × 1 × 4 mm on an uneven mesh, held at its upper end, under a weight [kPa/mm]."""
    mesh = jitter(jm.box((1.0, 1.0, 4.0), (2, 2, 6)), 0.2, seed=4)
    at_rest = passive(mesh, (jm.Symmetry("x"), jm.Symmetry("y"), jm.Displacement("z1", "z")))
    return jm.load(at_rest, jm.BodyForce((0.0, 0.0, -weight)))


@pytest.mark.slow
@pytest.mark.parametrize("large", SOLVERS)
def test_a_column_hangs_on_its_support(large: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The reaction is the weight; at small strain the lower end sinks by ½ g L²/E in the mean, E = 3 μ.

    By reciprocity with a column in uniform tension, which the elements have exactly, so that no mesh is too coarse.
    """
    monkeypatch.setattr(solve, "LARGE", large)
    length, off = 4.0, []
    for weight in (1.0, 1e-3):
        state = hanging(weight)
        assert (state.solver == "dense LU") == (large > 0)
        np.testing.assert_allclose(np.asarray(state.reaction("z1"))[2], weight * length, rtol=1e-10)
        np.testing.assert_allclose(np.asarray(state.reactions)[:, 2].sum(), weight * length, rtol=1e-10)
        quads = state.scene.mesh.face("z0")
        sinks = -float(np.asarray(state.u)[quads, 2].mean())  # of equal squares: the mean over the area
        off.append(sinks / (0.5 * weight * length**2 / (3.0 * MU)) - 1.0)
    assert 0.0 < off[0] < 0.2
    assert abs(off[1]) < 1e-3
    np.testing.assert_allclose(off[1] / off[0], 1e-3, rtol=0.2)  # nothing is left at no load
