"""Loads on faces: closed forms, tangents, two systems of coordinates."""

import re
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo import surface
from jaxmyo.coordinates import Coordinates

KINDS = [kind for kind in surface.FORCES if kind != "body"]
SYMMETRIC = {"nominal", "closed", "spring", "normal spring"}
PROLATE = jm.prolate_spheroidal(20.0)
CURVED = [
    pytest.param(jm.CARTESIAN, id="cartesian"),
    pytest.param(jm.CYLINDRICAL, id="cylindrical"),
    pytest.param(PROLATE, id="prolate"),
]


def vector(kind: str) -> bool:
    return kind in ("nominal", "cauchy")


@cache
def _compiled(c: Coordinates) -> Any:
    """Forces and tangents of every kind on the same quads, in one compiled function."""

    def every(theta: Any, reference: Any, values: Any) -> Any:
        at = {k: (c, k, theta, reference, values[k]) for k in KINDS}
        return {k: (surface.forces(*a), surface.tangents(*a)) for k, a in at.items()}

    return jax.jit(every)


def evaluated(c: Coordinates, theta: np.ndarray, reference: np.ndarray, values: dict[str, Any]) -> dict[str, Any]:
    """kind → forces (n, 4, 3) and tangents (n, 4, 3, 4, 3) on n quads; values: one for all quads, 0 where missing.

    The quads are padded to 64 that carry nothing, so that each system is compiled once.
    """
    n = len(theta)
    assert n <= 64
    theta, reference = (np.concatenate([q, np.repeat(q[:1], 64 - n, axis=0)]) for q in (theta, reference))
    full = {}
    for k in KINDS:
        full[k] = np.zeros((64, 3) if vector(k) else 64)
        full[k][:n] = values.get(k, 0.0)
    found = _compiled(c)(theta, reference, full)
    return {k: (np.asarray(f)[:n], np.asarray(K)[:n].reshape(n, 4, 3, 4, 3)) for k, (f, K) in found.items()}


def on_nodes(mesh: jm.Mesh, quads: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """The forces of quads (n, 4, 3) summed at the nodes of the mesh."""
    total = np.zeros(mesh.points.shape)
    np.add.at(total, quads, forces)
    return total


def forces(mesh: jm.Mesh, face: str, kind: str, value: Any, u: np.ndarray | float = 0.0) -> np.ndarray:
    """The forces at the nodes (n_nodes, 3) of one load."""
    quads = mesh.face(face)
    theta = mesh.points + u
    f, _ = evaluated(mesh.coordinates, theta[quads], mesh.points[quads], {kind: value})[kind]
    return on_nodes(mesh, quads, f)


# ---------------------------------------------------------------------------------------- Cartesian, flat faces

NORMALS = {"x0": (-1, 0, 0), "x1": (1, 0, 0), "y0": (0, -1, 0), "y1": (0, 1, 0), "z0": (0, 0, -1), "z1": (0, 0, 1)}


@pytest.fixture(scope="module")
def cube() -> jm.Mesh:
    return jm.box((1.0, 1.0, 1.0), (1, 1, 1))


@pytest.mark.parametrize("face", NORMALS)
def test_loads_on_a_unit_face(cube: jm.Mesh, face: str) -> None:
    """A quarter of value × area at every node: pressure against the normal, tractions along their vector."""
    at, t, normal = np.unique(cube.face(face)), np.array([2.0, -3.0, 5.0]), np.array(NORMALS[face], dtype=float)
    for kind, value, total in (("open", 4.0, -4.0 * normal), ("nominal", t, t), ("cauchy", t, t)):
        f = forces(cube, face, kind, value)
        expected = np.zeros((8, 3))
        expected[at] = 0.25 * total
        np.testing.assert_allclose(f, expected, atol=1e-15)


def test_pressure_and_tractions_on_a_face_that_grew_and_turned(cube: jm.Mesh) -> None:
    """x1 stretched by 3 × 2 and turned by 30° about z: pressure and Cauchy tractions feel 6 mm², dead ones 1 mm²."""
    s, co = 0.5, np.sqrt(0.75)
    R = np.array([[co, -s, 0.0], [s, co, 0.0], [0.0, 0.0, 1.0]])
    u = cube.points @ (R @ np.diag([1.0, 3.0, 2.0])).T - cube.points
    t = np.array([2.0, -3.0, 5.0])
    np.testing.assert_allclose(forces(cube, "x1", "open", 4.0, u).sum(axis=0), -24.0 * R[:, 0], atol=1e-13)
    np.testing.assert_allclose(forces(cube, "x1", "cauchy", t, u).sum(axis=0), 6.0 * t, rtol=1e-14)
    np.testing.assert_allclose(forces(cube, "x1", "nominal", t, u).sum(axis=0), t, rtol=1e-14)


def crumpled() -> tuple[jm.Mesh, np.ndarray]:
    """A box of 2×2×2 elements and random displacements of all of its nodes."""
    mesh = jm.box((1.0, 1.0, 1.0), (2, 2, 2))
    return mesh, np.random.default_rng(1).uniform(-0.1, 0.1, mesh.points.shape)


def test_pressure_on_a_closed_surface_has_no_resultant_and_no_moment() -> None:
    mesh, u = crumpled()
    f = sum(forces(mesh, face, "open", 7.0, u) for face in NORMALS)
    assert np.abs(f).max() > 0.1
    np.testing.assert_allclose(f.sum(axis=0), 0.0, atol=1e-14)
    np.testing.assert_allclose(np.cross(mesh.points + u, f).sum(axis=0), 0.0, atol=1e-14)


def test_open_and_closed_pressures_are_one_on_a_closed_surface() -> None:
    """Either is minus the gradient of P V there, whatever field measures the volume."""
    mesh, u = crumpled()
    every = [sum(forces(mesh, face, kind, 7.0, u) for face in NORMALS) for kind in ("open", "closed")]
    np.testing.assert_allclose(every[0], every[1], rtol=0, atol=1e-14)


def test_the_volume_of_a_closed_surface() -> None:
    """A cavity lies behind the normal of the body's face: the body's own volume counts as negative."""
    mesh, _ = crumpled()
    quads = np.concatenate([mesh.face(f) for f in NORMALS])
    volumes = jax.vmap(lambda q: surface.cavity_volume(jm.CARTESIAN, q))(jnp.asarray(mesh.points[quads]))
    np.testing.assert_allclose(float(volumes.sum()), -1.0, rtol=1e-14)


def test_springs_pull_back_to_the_state_p(cube: jm.Mesh) -> None:
    """−k u per area; normal springs feel u · N alone. The energy ½ k |u|² of a linear displacement has the moment ⅓."""
    u = np.array([0.3, -0.2, 0.7])
    np.testing.assert_allclose(forces(cube, "z1", "spring", 5.0, u).sum(axis=0), -5.0 * u, rtol=1e-14)
    np.testing.assert_allclose(
        forces(cube, "z1", "normal spring", 5.0, u).sum(axis=0), [0.0, 0.0, -5.0 * 0.7], atol=1e-14
    )
    linear = cube.points[:, :1] * np.array([1.0, 0.0, 0.0])  # u_x = X
    f = forces(cube, "z1", "spring", 5.0, linear)
    np.testing.assert_allclose(-np.sum(f * linear), 5.0 / 3.0, rtol=1e-14)
    np.testing.assert_array_equal(forces(cube, "z1", "spring", 5.0), 0.0)


# ------------------------------------------------------------------------------------------ a quarter of a cylinder

R, H = 3.0, 2.0  # mm


def quarter(cartesian: bool = False, n: int = 4) -> jm.Mesh:
    """The wall 3 ≤ r ≤ 4 mm, a quarter around, 2 mm high; n elements around."""
    nodes = [np.array([R, R + 1.0]), np.linspace(0.0, 0.5 * np.pi, n + 1), np.linspace(0.0, H, 3)]
    mesh = jm.structured(nodes, jm.CYLINDRICAL)
    return mesh.mapped(jm.CYLINDRICAL.position) if cartesian else mesh


def test_pressure_in_a_quarter_of_a_cylinder() -> None:
    """Along r it is P times the area; its Cartesian resultant is P R H along x and y, in straight edges too."""
    f = forces(quarter(), "r0", "open", 5.0)
    np.testing.assert_allclose(f.sum(axis=0), [5.0 * R * 0.5 * np.pi * H, 0.0, 0.0], rtol=1e-14, atol=1e-14)
    f = forces(quarter(cartesian=True), "r0", "open", 5.0)
    np.testing.assert_allclose(f.sum(axis=0), [5.0 * R * H, 5.0 * R * H, 0.0], rtol=1e-14, atol=1e-14)


def test_pressure_in_a_cylinder_with_closed_ends() -> None:
    """The gradient of P V with V = ¼ π r² h: P ∂V/∂r on the wall, and the caps' thrust ¼ π r² P on its rim."""
    mesh = quarter()
    r, h = R + 0.5, H * 1.2
    u = np.zeros(mesh.points.shape)
    u[:, 0], u[:, 2] = 0.5, 0.2 * mesh.points[:, 2]
    f = forces(mesh, "r0", "closed", 5.0, u)
    np.testing.assert_allclose(f[:, 0].sum(), 5.0 * 0.5 * np.pi * r * h, rtol=1e-14)
    for z, sign in ((0.0, -1.0), (H, 1.0)):
        rim = f[mesh.points[:, 2] == z, 2]
        np.testing.assert_allclose(rim.sum(), sign * 5.0 * 0.25 * np.pi * r**2, rtol=1e-13)
    np.testing.assert_allclose(f[mesh.points[:, 2] == 0.5 * H, 2], 0.0, atol=1e-13)
    np.testing.assert_allclose(forces(mesh, "r0", "open", 5.0, u)[:, 2], 0.0, atol=1e-13)


def cavity(mesh: jm.Mesh, face: str, u: np.ndarray | float = 0.0) -> float:
    quads = (mesh.points + u)[mesh.face(face)]
    return float(_cavity(mesh.coordinates, quads).sum())


_cavity = jax.jit(
    lambda c, quads: jax.vmap(lambda q: surface.cavity_volume(c, q))(jnp.asarray(quads)), static_argnums=0
)


def test_volume_of_a_cylinder() -> None:
    """Exact in cylindrical coordinates; that of the inscribed prism in Cartesian hexahedra."""
    np.testing.assert_allclose(cavity(quarter(), "r0"), 0.25 * np.pi * R**2 * H, rtol=1e-14)
    prism = 4 * 0.5 * R**2 * np.sin(np.pi / 8.0) * H
    np.testing.assert_allclose(cavity(quarter(cartesian=True), "r0"), prism, rtol=1e-14)


def test_volume_inside_an_ellipsoid() -> None:
    """½ a b² φ ∫ sin³ μ dμ for the zone of a prolate shell, at fourth order."""
    errors = []
    for size in (1.0, 0.5):
        mu = 1.3 + size * np.array([-0.4, -0.1, 0.4])
        mesh = jm.structured([[0.5, 0.8], mu, [0.0, 0.7]], PROLATE)
        a, b = 20.0 * np.cosh(0.5), 20.0 * np.sinh(0.5)
        cubic = np.cos(mu) ** 3 / 3.0 - np.cos(mu)
        errors.append(abs(cavity(mesh, "lambda0") / (0.5 * a * b**2 * 0.7 * (cubic[-1] - cubic[0])) - 1.0))
    assert 1e-9 < errors[1] < 1e-4
    assert 12.0 < errors[0] / errors[1] < 20.0


@pytest.mark.parametrize("c", CURVED)
def test_work_of_a_closed_pressure_is_p_dv(c: Coordinates) -> None:
    mesh, u = bent(c)
    f = forces(mesh, mesh_face(c), "closed", 5.0, u)
    du = 1e-5 * np.random.default_rng(2).standard_normal(u.shape) * mesh.extent
    difference = cavity(mesh, mesh_face(c), u + du) - cavity(mesh, mesh_face(c), u - du)
    np.testing.assert_allclose(np.sum(f * 2.0 * du), 5.0 * difference, rtol=1e-8)


def test_tractions_along_the_local_unit_vectors() -> None:
    """A turned and widened wall: the arm of a shear t_φ is the deformed radius, its area that of the measure."""
    mesh = quarter()
    u = np.zeros(mesh.points.shape)
    u[:, 0], u[:, 1], u[:, 2] = 0.5, 0.3, 0.2 * mesh.points[:, 2]
    t = np.array([2.0, -3.0, 5.0])
    r = R + 0.5
    for kind, area in (("nominal", 0.5 * np.pi * R * H), ("cauchy", 0.5 * np.pi * r * H * 1.2)):
        total = forces(mesh, "r0", kind, t, u).sum(axis=0)
        np.testing.assert_allclose(total, area * t * np.array([1.0, r, 1.0]), rtol=1e-14)


def test_springs_around_a_cylinder_that_turned_and_widened() -> None:
    """½ k |u|² per area with |u|² = r² + R² − 2 r R cos φ + w²; along the normal (r cos φ − R)²."""
    mesh, k, r, phi, w = quarter(), 5.0, R + 0.5, 0.3, 0.4
    u = np.tile([0.5, phi, w], (len(mesh.points), 1))
    area = 0.5 * np.pi * R * H
    every = -k * area * np.array([r - R * np.cos(phi), r * R * np.sin(phi), w])
    np.testing.assert_allclose(forces(mesh, "r0", "spring", k, u).sum(axis=0), every, rtol=1e-13)
    along = k * area * (r * np.cos(phi) - R)
    normal = along * np.array([-np.cos(phi), r * np.sin(phi), 0.0])
    np.testing.assert_allclose(forces(mesh, "r0", "normal spring", k, u).sum(axis=0), normal, rtol=1e-13, atol=1e-13)


# --------------------------------------------------------------------------------------------------------- tangents


def mesh_face(c: Coordinates) -> str:
    return f"{c.axes[0]}1"


def bent(c: Coordinates) -> tuple[jm.Mesh, np.ndarray]:
    """A face of 3×3 quads in a random deformation, with all three coordinates unequal."""
    start = {"Cartesian": (1.0, 1.5, -0.5), "cylindrical": (2.0, 0.3, -0.5), "prolate spheroidal": (0.5, 0.7, 0.3)}
    edges = {"Cartesian": (1.0, 1.2, 0.8), "cylindrical": (1.0, 0.8, 1.2), "prolate spheroidal": (0.3, 0.5, 0.6)}
    steps = [np.linspace(0.0, 1.0, n + 1) for n in (1, 3, 3)]
    mesh = jm.structured([a + e * t for a, e, t in zip(start[c.name], edges[c.name], steps, strict=True)], c)
    return mesh, np.random.default_rng(3).uniform(-0.06, 0.06, mesh.points.shape) * mesh.extent


def rim_of(mesh: jm.Mesh) -> np.ndarray:
    """The nodes on the faces across the second and third axis."""
    across = [f"{a}{end}" for a in mesh.coordinates.axes[1:] for end in (0, 1)]
    return np.unique(np.concatenate([mesh.face(f).ravel() for f in across]))


VALUES = {
    "nominal": np.array([2.0, -3.0, 5.0]),
    "cauchy": np.array([2.0, -3.0, 5.0]),
    "open": 4.0,
    "closed": 4.0,
    "spring": 5.0,
    "normal spring": 5.0,
}


@pytest.fixture(scope="module", params=CURVED)
def tangents(request: pytest.FixtureRequest) -> Any:
    c = request.param
    mesh, u = bent(c)
    quads = mesh.face(mesh_face(c))
    X, theta = mesh.points[quads], (mesh.points + u)[quads]
    return c, mesh, quads, X, theta, {k: K for k, (_, K) in evaluated(c, theta, X, VALUES).items()}


@pytest.mark.parametrize("kind", KINDS)
def test_tangent_against_differences(tangents: Any, kind: str) -> None:
    c, _, _, X, theta, K = tangents
    h = 1e-5
    for a in range(4):
        for i in range(3):
            step = np.zeros((4, 3))
            step[a, i] = h
            plus, minus = (evaluated(c, theta + s, X, VALUES)[kind][0] for s in (step, -step))
            difference = (plus - minus) / (2.0 * h)
            scale = np.abs(K[kind]).max()
            np.testing.assert_allclose(K[kind][..., a, i], difference, rtol=0, atol=1e-6 * scale)


@pytest.mark.parametrize("kind", KINDS)
def test_which_tangents_are_symmetric(tangents: Any, kind: str) -> None:
    """Those of loads with a potential. A nominal traction has one in Cartesian coordinates only: in curved ones its
    components are along unit vectors that turn with the point."""
    c, _, _, _, _, K = tangents
    matrix = K[kind].reshape(-1, 12, 12)
    asymmetry = np.abs(matrix - matrix.swapaxes(1, 2)).max()
    if kind in SYMMETRIC and not (kind == "nominal" and c.curved):
        assert asymmetry <= 1e-13 * np.abs(matrix).max()
    else:
        assert asymmetry > 1e-3 * np.abs(matrix).max()


@pytest.mark.parametrize("kind", ["open", "closed"])
def test_pressure_on_a_face_with_a_fixed_rim_has_a_symmetric_tangent(tangents: Any, kind: str) -> None:
    """The volume that the face sweeps is a potential then; 2×2 points integrate it exactly (nearly, if prolate)."""
    c, mesh, quads, _, _, K = tangents
    n = len(mesh.points)
    whole = np.zeros((n, 3, n, 3))
    for q, k in zip(quads, K[kind], strict=True):
        whole[np.ix_(q, range(3), q, range(3))] += k
    inner = np.setdiff1d(quads, rim_of(mesh))
    assert len(inner) == 4
    free = whole[np.ix_(inner, range(3), inner, range(3))].reshape(12, 12)
    asymmetry, size = np.abs(free - free.T).max(), np.abs(free).max()
    assert asymmetry <= (1e-13 if c is not PROLATE or kind == "closed" else 1e-3) * size
    if kind == "open":
        everything = whole.reshape(3 * n, 3 * n)
        assert np.abs(everything - everything.T).max() > 0.1 * np.abs(everything).max()


def test_open_and_closed_pressures_differ_on_the_rim_alone(tangents: Any) -> None:
    c, mesh, quads, X, theta, _ = tangents
    f = evaluated(c, theta, X, VALUES)
    open_, closed = (on_nodes(mesh, quads, f[k][0]) for k in ("open", "closed"))
    difference = np.abs(open_ - closed)
    assert difference[rim_of(mesh)].max() > 0.1 * np.abs(open_).max()
    difference[rim_of(mesh)] = 0.0
    assert difference.max() <= (1e-13 if c is not PROLATE else 1e-3) * np.abs(open_).max()


def test_cartesian_and_cylindrical_hexahedra_at_second_order() -> None:
    """The work of every kind of load on a smooth virtual displacement of a smoothly bent patch of a cylinder."""

    def deformed(theta: np.ndarray, t: float) -> np.ndarray:
        r, phi, z = theta.T
        return theta + np.stack(
            [
                0.1 * np.sin(phi + z) + t * (r + 0.5 * z),
                0.05 * z * phi + t * np.cos(phi),
                0.1 * r * z + t * (phi - z),
            ],
            axis=1,
        )

    def work(mesh: jm.Mesh, theta: np.ndarray, virtual: np.ndarray, values: dict[str, Any]) -> dict[str, float]:
        quads = mesh.face("r1")
        found = evaluated(mesh.coordinates, theta[quads], mesh.points[quads], values)
        return {k: float(np.sum(f * virtual[quads])) for k, (f, _) in found.items()}

    position = np.vectorize(lambda r, phi, z: (r * np.cos(phi), r * np.sin(phi), z), signature="(),(),()->(),(),()")
    errors: dict[str, list[float]] = {k: [] for k in KINDS}
    for size in (0.5, 0.25):
        nodes = [np.array([2.0, 3.0]), 0.6 + size * np.linspace(-0.5, 0.5, 4), 0.4 + size * np.linspace(-0.8, 0.8, 4)]
        mesh = jm.structured(nodes, jm.CYLINDRICAL)
        straight = mesh.mapped(jm.CYLINDRICAL.position)
        theta = deformed(mesh.points, 0.0)
        virtual = (deformed(mesh.points, 1e-4) - deformed(mesh.points, -1e-4)) / 2e-4
        x = np.stack(position(*theta.T), axis=1)
        by_t = [np.stack(position(*deformed(mesh.points, t).T), axis=1) for t in (1e-4, -1e-4)]
        moved = (by_t[0] - by_t[1]) / 2e-4
        # A traction along z: its components are the same in both systems.
        values = {**VALUES, "nominal": np.array([0.0, 0.0, 5.0]), "cauchy": np.array([0.0, 0.0, 5.0])}
        curved, flat = work(mesh, theta, virtual, values), work(straight, x, moved, values)
        for k in KINDS:
            errors[k].append(abs(curved[k] / flat[k] - 1.0))
    for k, (coarse, fine) in errors.items():
        assert 1e-6 < fine < 0.02, k
        assert 3.4 < coarse / fine < 4.8, (k, coarse, fine)


# ------------------------------------------------------------------------------------------------ what is built


def test_the_loads_of_a_mesh_by_kind() -> None:
    mesh = jm.box((2.0, 1.0, 1.0), (2, 1, 1))
    loads = (
        jm.Pressure("y1", 3.0),
        jm.Traction("x1", (1.0, 2.0, 3.0)),
        jm.Spring("x0", 4.0),
        jm.Pressure("x1", 7.0),
        jm.Pressure("x1", 8.0, "closed"),
        jm.Spring("z0", 0.0, "normal"),
        jm.Traction("x1", [4, 5, 6], "cauchy"),
    )
    quads, values = surface.build(mesh, loads)
    assert set(quads) == set(values) == set(KINDS)
    np.testing.assert_array_equal(quads["open"], np.concatenate([mesh.face("y1"), mesh.face("x1")]))
    np.testing.assert_array_equal(np.asarray(values["open"]), [3.0, 3.0, 7.0])
    np.testing.assert_array_equal(np.asarray(values["nominal"]), [[1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(np.asarray(values["cauchy"]), [[4.0, 5.0, 6.0]])
    np.testing.assert_array_equal(np.asarray(values["closed"]), [8.0])
    np.testing.assert_array_equal(np.asarray(values["spring"]), [4.0])
    np.testing.assert_array_equal(quads["normal spring"], mesh.face("z0"))
    assert surface.build(mesh, ()) == ({}, {})


def test_the_loads_of_a_mesh_in_words() -> None:
    """In the order of the conditions; loads of an earlier step come first in each kind and are not named."""
    mesh = jm.box((2.0, 1.0, 1.0), (2, 1, 1))
    own = (jm.Pressure("y1", 3.0), jm.Traction("x1", (1.0, 2.0, 3.0)), jm.Spring("x0", 4.0), jm.Pressure("x1", 7.0))
    _, loads = surface.build(mesh, (jm.Pressure("z1", 99.0), jm.Spring("z0", 99.0), *own))
    assert surface.values(mesh, own, loads) == [
        "Pressure('y1') 3 kPa",
        "Traction('x1') 1 2 3 kPa",
        "Spring('x0') 4 kPa/mm",
        "Pressure('x1') 7 kPa",
    ]
    assert surface.values(mesh, (), loads) == []


def test_the_sum_of_all_loads_at_the_nodes() -> None:
    mesh = jm.box((2.0, 1.0, 1.0), (2, 1, 1))
    quads, values = surface.build(mesh, (jm.Pressure("y1", 3.0), jm.Traction("x1", (1.0, 2.0, 3.0))))
    x = jnp.asarray(mesh.points)
    total = np.asarray(surface.nodal_forces(jm.CARTESIAN, surface.every(quads, values, (), ()), x, x))
    expected = forces(mesh, "y1", "open", 3.0) + forces(mesh, "x1", "nominal", np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(total, expected, atol=1e-14)


@pytest.mark.parametrize(
    ("load", "parts"),
    [
        (jm.Pressure("x1", np.nan), ("Pressure('x1')", "finite", "nan")),
        (jm.Pressure("x1", [1.0, 2.0]), ("Pressure('x1')", "()", "(2,)")),
        (jm.Pressure("x1", "high"), ("Pressure('x1')", "numbers", "'high'")),
        (jm.Pressure("x1", 1.0, "ajar"), ("ends", "'ajar'", "'open', 'closed'")),
        (jm.Pressure("lumen", 1.0), ("face", "'lumen'", "'x0', 'x1'")),
        (jm.Spring("x1", -1.0), ("Spring('x1')", "stiffness = -1.0", "≥ 0", "kPa/mm")),
        (jm.Spring("x1", np.inf), ("Spring('x1')", "finite", "inf")),
        (jm.Spring("x1", (1.0, 2.0, 3.0)), ("Spring('x1')", "()", "(3,)")),
        (jm.Spring("x1", 1.0, "along"), ("direction", "'along'", "'all', 'normal'")),
        (jm.Spring("x2", 1.0), ("face", "'x2'", "'x0', 'x1'")),
        (jm.Traction("x1", (1.0, 2.0)), ("Traction('x1')", "(3,)", "(2,)")),
    ],
    ids=str,
)
def test_loads_that_make_no_sense(cube: jm.Mesh, load: Any, parts: tuple[str, ...]) -> None:
    with pytest.raises((ValueError, TypeError), match="".join(f"(?=(?s:.*){re.escape(p)})" for p in parts)):
        surface.build(cube, (load,))


def test_a_traced_load_of_wrong_shape(cube: jm.Mesh) -> None:
    with pytest.raises(ValueError, match=r"Pressure\('x1'\) must have shape \(\) \(kPa\); got \(2,\)"):
        jax.jit(lambda p: surface.build(cube, (jm.Pressure("x1", p),))[1])(np.ones(2))
