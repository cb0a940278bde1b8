"""Truncated ellipsoids: volumes against closed forms, faces, and the helix of the fibres, in both coordinates."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo.fibres import frame
from jaxmyo.hexahedron import NODES, gauss, shape, shape_gradient
from jaxmyo.mesh import boundary
from jaxmyo.surface import cavity_volume

VENTRICLE = jm.Ventricle.from_axes(short_endo=20.0, long_endo=50.0, short_epi=32.0, base_z=-15.0)
XI, W = gauss(2, 2, 2)
_cavity = jax.jit(jax.vmap(cavity_volume, in_axes=(None, 0)), static_argnums=0)


def cavity(mesh: jm.Mesh) -> float:
    return float(jnp.sum(_cavity(mesh.coordinates, jnp.asarray(mesh.points[mesh.face("endo")]))))


def volume(mesh: jm.Mesh) -> float:
    """[mm³], in either coordinates, by 2×2×2 Gauss points."""
    theta = mesh.points[mesh.cells]
    det = np.linalg.det(np.einsum("eai,gaj->egij", theta, shape_gradient(XI)))
    if mesh.coordinates is not jm.CARTESIAN:
        det = det * np.prod(scale_factors(np.einsum("ga,eai->egi", shape(XI), theta)), axis=-1)
    return float((det @ W).sum())


def scale_factors(theta: np.ndarray) -> np.ndarray:
    lam, mu, _ = np.moveaxis(theta, -1, 0)
    meridian = np.sqrt(np.sinh(lam) ** 2 + np.sin(mu) ** 2)
    return VENTRICLE.focus * np.stack([meridian, meridian, np.sinh(lam) * np.sin(mu)], axis=-1)


def position(theta: np.ndarray) -> np.ndarray:
    lam, mu, phi = np.moveaxis(theta, -1, 0)
    rho = np.sinh(lam) * np.sin(mu)
    return VENTRICLE.focus * np.stack([rho * np.cos(phi), rho * np.sin(phi), np.cosh(lam) * np.cos(mu)], axis=-1)


def area_vectors(points: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Half the cross product of the diagonals (n, 3), the integral of the normal over a bilinear quad."""
    a, b, c, d = np.moveaxis(points[quads], 1, 0)
    return 0.5 * np.cross(c - a, d - b)


# ------------------------------------------------------------------------------------------------------------- shape


def test_the_shape_from_its_axes() -> None:
    d = VENTRICLE.focus
    np.testing.assert_allclose(d * np.sinh([VENTRICLE.lambda_endo, VENTRICLE.lambda_epi]), [20.0, 32.0], rtol=1e-14)
    np.testing.assert_allclose(d * np.cosh(VENTRICLE.lambda_endo), 50.0, rtol=1e-14)
    theta = np.array([0.5, 1.0, 0.3])
    np.testing.assert_allclose(VENTRICLE.coordinates.position(jnp.asarray(theta)), position(theta))


def test_the_volume_enclosed() -> None:
    """Half of an ellipsoid, and by quadrature of its cross-sections."""
    half = jm.Ventricle(VENTRICLE.focus, VENTRICLE.lambda_endo, VENTRICLE.lambda_epi)
    np.testing.assert_allclose(half.enclosed(half.lambda_endo), 2.0 / 3.0 * np.pi * 20.0**2 * 50.0, rtol=1e-14)
    x, w = gauss(4)
    z = -15.0 + 65.0 * 0.5 * (1.0 + x[:, 0])
    sections = np.pi * 20.0**2 * (1.0 - (z / 50.0) ** 2)
    np.testing.assert_allclose(VENTRICLE.enclosed(VENTRICLE.lambda_endo), 32.5 * sections @ w, rtol=1e-13)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ((0.0, 0.4, 0.6), "focus = 0.0"),
        ((40.0, 0.6, 0.4), "lambda_endo = 0.6, lambda_epi = 0.4"),
        ((40.0, 0.0, 0.4), "lambda_endo = 0.0"),
        ((40.0, np.nan, 0.4), "lambda_endo must be finite"),
        ((40.0, 0.4, 0.6, -50.0), "base_z = -50.0 does not cut the cavity"),
    ],
)
def test_shapes_that_are_none(arguments: Any, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        jm.Ventricle(*arguments)


@pytest.mark.parametrize("axes", [(20.0, 15.0, 30.0), (20.0, 50.0, 20.0), (-1.0, 50.0, 30.0), (np.nan, 50.0, 30.0)])
def test_axes_that_are_none(axes: Any) -> None:
    with pytest.raises(ValueError, match="short_endo"):
        jm.Ventricle.from_axes(*axes)


# ------------------------------------------------------------------------------------------------------------ meshes

MESHES = {n: jm.ventricle_mesh(VENTRICLE, (n, 2 * n, 4 * n)) for n in (1, 2, 4, 8)}


def test_volumes_converge_at_second_order() -> None:
    exact = np.array([VENTRICLE.enclosed(VENTRICLE.lambda_epi), 0.0]) - VENTRICLE.enclosed(VENTRICLE.lambda_endo)
    errors = np.array([[volume(MESHES[n]), -cavity(MESHES[n])] for n in (2, 4, 8)]) / exact - 1.0
    ratio = errors[:-1] / errors[1:]
    assert (np.abs(errors[-1]) < 0.02).all(), errors
    assert (ratio[-1] > 3.8).all(), ratio
    assert (ratio[-1] < 4.2).all(), ratio
    prolate = np.array([[volume(m), -cavity(m)] for n in (2, 4) for m in [jm.prolate_mesh(VENTRICLE, (n, 2 * n, n))]])
    prolate = prolate.reshape(2, 2) / exact - 1.0
    assert (np.abs(prolate[1]) < 2e-3).all(), prolate
    assert (np.abs(prolate[0] / prolate[1]) > 3.6).all(), prolate


@pytest.mark.parametrize("elements", [(1, 1, 4), (1, 3, 12), (3, 2, 8), (2, 8, 16), (2, 2, 32)])
def test_no_element_is_degenerate(elements: Any) -> None:
    """At every corner: det J over the lengths of the three edges, 1 for a cube."""
    mesh = jm.ventricle_mesh(VENTRICLE, elements)
    m = elements[2] // 4
    assert len(mesh.cells) == elements[0] * (m * m + elements[1] * elements[2])
    J = np.einsum("eai,gaj->egij", mesh.points[mesh.cells], shape_gradient(NODES))
    assert (np.linalg.det(J) / np.linalg.norm(J, axis=-2).prod(axis=-1)).min() > 0.45


def test_nodes_and_faces() -> None:
    mesh = MESHES[2]
    x = mesh.points
    for face, short, long in (("endo", 20.0, 50.0), ("epi", 32.0, np.sqrt(32.0**2 + 50.0**2 - 20.0**2))):
        on = x[np.unique(mesh.face(face))]
        np.testing.assert_allclose((on[:, 0] ** 2 + on[:, 1] ** 2) / short**2 + (on[:, 2] / long) ** 2, 1.0, rtol=1e-12)
    np.testing.assert_array_equal(x[np.unique(mesh.face("base")), 2], -15.0)
    assert x[:, 2].min() == -15.0
    every = np.concatenate([mesh.face(name) for name in ("endo", "epi", "base")])
    assert len(every) == len(np.unique(np.sort(every, axis=1), axis=0))
    turns = {tuple(np.roll(q, k).tolist()) for q in boundary(mesh.cells) for k in range(4)}
    assert len(turns) == 4 * len(every)
    assert all(tuple(q) in turns for q in every.tolist())
    areas = {name: area_vectors(x, quads) for name, quads in mesh.faces.items()}
    np.testing.assert_allclose(sum(a.sum(axis=0) for a in areas.values()), 0.0, atol=1e-10)
    np.testing.assert_allclose(
        areas["base"] / np.linalg.norm(areas["base"], axis=1)[:, None] * [0, 0, -1],
        np.tile([0.0, 0.0, 1.0], (len(areas["base"]), 1)),
        atol=1e-14,
    )
    outward = {name: np.einsum("ni,ni->n", a, x[mesh.face(name)].mean(axis=1)) for name, a in areas.items()}
    assert (outward["epi"] > 0.0).all()
    assert (outward["endo"] < 0.0).all()


def test_columns_through_the_wall() -> None:
    mesh = MESHES[2]
    layer = len(mesh.cells) // 2
    assert layer == len(mesh.face("endo"))
    np.testing.assert_array_equal(mesh.cells[:layer, 4:], mesh.cells[layer:, :4])
    np.testing.assert_array_equal(mesh.cells[:layer, :4], mesh.face("endo")[:, ::-1])


@pytest.mark.parametrize("elements", [(1, 1, 6), (0, 1, 4), (1, 1)])
def test_numbers_of_elements(elements: Any) -> None:
    with pytest.raises(ValueError, match="elements"):
        jm.ventricle_mesh(VENTRICLE, elements)


def test_a_mesh_in_prolate_coordinates() -> None:
    mesh = jm.prolate_mesh(VENTRICLE, (2, 3, 4))
    assert set(mesh.faces) == {"endo", "epi", "apex", "base", "phi0", "phi1"}
    assert mesh.grid == (2, 3, 4)
    lam, mu, phi = mesh.points.T
    for name, values, there in (
        ("endo", lam, VENTRICLE.lambda_endo),
        ("epi", lam, VENTRICLE.lambda_epi),
        ("apex", mu, 0.0),
        ("phi1", phi, 2.0 * np.pi),
    ):
        np.testing.assert_allclose(values[np.unique(mesh.face(name))], there, rtol=1e-15)
    x = position(mesh.points)
    np.testing.assert_allclose(x[np.unique(mesh.face("base")), 2], -15.0, rtol=1e-13)
    x[np.unique(mesh.face("apex")), :2] = 0.0
    closed = ("endo", "epi", "base")
    np.testing.assert_allclose(sum(area_vectors(x, mesh.face(f)).sum(axis=0) for f in closed), 0.0, atol=1e-10)
    np.testing.assert_allclose(area_vectors(x, mesh.face("apex")), 0.0, atol=1e-12)
    assert (area_vectors(x, mesh.face("base"))[:, 2] < 0.0).all()
    sector = jm.prolate_mesh(VENTRICLE, (2, 3, 1), 0.5 * np.pi)
    np.testing.assert_allclose(4.0 * volume(sector), volume(mesh), rtol=1e-13)
    with pytest.raises(ValueError, match=r"angle = 7.0 must be in \(0, 2π\]"):
        jm.prolate_mesh(VENTRICLE, (1, 1, 1), 7.0)


def test_a_body_of_revolution_with_an_apex_on_the_axis() -> None:
    """The ties that the docstring names leave no rigid motion; nothing is solved."""
    half = jm.Ventricle(VENTRICLE.focus, VENTRICLE.lambda_endo, VENTRICLE.lambda_epi)
    mesh = jm.prolate_mesh(half, (1, 2, 1))
    fibre, cross = jm.helix_fibres(half, coordinates=mesh.coordinates)
    supports = (
        *(jm.Uniform(axis, ("phi",)) for axis in ("lambda", "mu")),
        jm.Uniform("phi", ("lambda", "mu", "phi")),
        jm.Displacement("base", "phi"),
        jm.Displacement("apex", "mu"),
        jm.Displacement("base", "mu"),
    )
    scene = jm.Scene(mesh, jm.lin_yin, jm.TABLE1, fibre, cross, supports, quadrature=(2, 2, 1))
    assert scene.kinematics(()).size == 2 * 3 + 2


# ------------------------------------------------------------------------------------------------------------ fibres


def at_depth(depth: float) -> np.ndarray:
    """λ, μ, φ (n, 3) of points at a depth of the wall, 0 inside, 1 outside."""
    mu, phi = np.meshgrid(np.linspace(0.05, 1.8, 7), np.linspace(-3.0, 3.0, 9), indexing="ij")
    lam = VENTRICLE.lambda_endo + depth * (VENTRICLE.lambda_epi - VENTRICLE.lambda_endo)
    return np.stack([np.full(mu.size, lam), mu.ravel(), phi.ravel()], axis=1)


def unit_vectors(theta: np.ndarray) -> np.ndarray:
    """Rows e_λ, e_μ, e_φ (n, 3, 3), by complex steps of the position."""
    columns = [np.imag(position(theta + 1e-30j * step)) for step in np.eye(3)]
    return np.stack([v / np.linalg.norm(v, axis=-1, keepdims=True) for v in columns], axis=-2)


@pytest.mark.parametrize("angles", [(60.0, -60.0), (80.0, -30.0), (0.0, 0.0)])
@pytest.mark.parametrize("depth", [0.0, 0.25, 0.5, 1.0, 1.01])
def test_the_helix(depth: float, angles: tuple[float, float]) -> None:
    """Unit, orthogonal, tangent to the wall, at the angle, and the same in both coordinates."""
    theta = at_depth(depth)
    x, e = position(theta), unit_vectors(theta)
    f, c = (d(x) for d in jm.helix_fibres(VENTRICLE, *angles))
    for vectors in (f, c):
        np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, rtol=1e-14)
        np.testing.assert_allclose(np.einsum("ni,ni->n", vectors, e[:, 0]), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.einsum("ni,ni->n", f, c), 0.0, atol=1e-14)
    np.testing.assert_allclose(np.cross(f, c), e[:, 0], atol=1e-12)
    alpha = angles[0] + depth * (angles[1] - angles[0])
    found = np.degrees(np.arctan2(-np.einsum("ni,ni->n", f, e[:, 1]), np.einsum("ni,ni->n", f, e[:, 2])))
    np.testing.assert_allclose(found, alpha, atol=1e-10)
    local = jm.helix_fibres(VENTRICLE, *angles, coordinates=VENTRICLE.coordinates)
    for vectors, own in zip((f, c), local, strict=True):
        np.testing.assert_allclose(np.einsum("ni,nij->nj", own(theta), e), vectors, atol=1e-12)


def test_the_helix_inside_is_right_handed() -> None:
    """It rises towards the apex, z > 0, as it goes around z by the right hand."""
    x = position(np.array([[VENTRICLE.lambda_endo, 1.5, 0.0]]))
    (f,) = jm.helix_fibres(VENTRICLE)[0](x)
    assert x[0, 0] > 0.0
    assert f[1] > 0.4
    assert f[2] > 0.8


@pytest.mark.parametrize("n", [1, 2, 3])
def test_the_frame_on_both_meshes(n: int) -> None:
    """At all quadrature points, also on the axis, where the direction around is any one."""
    mesh = jm.ventricle_mesh(VENTRICLE, (1, 2, 4))
    xi = gauss(n, n, n)[0]
    found = frame(mesh, xi, *jm.helix_fibres(VENTRICLE))
    np.testing.assert_allclose(found @ found.swapaxes(-1, -2), np.broadcast_to(np.eye(3), found.shape), atol=1e-13)
    prolate = jm.prolate_mesh(VENTRICLE, (1, 2, 4))
    local = frame(prolate, xi, *jm.helix_fibres(VENTRICLE, coordinates=prolate.coordinates))
    np.testing.assert_allclose(local[:, :, 2], np.broadcast_to([1.0, 0.0, 0.0], local[:, :, 2].shape), atol=1e-14)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"endo": 91.0}, r"endo = 91.0 is outside \[-90, 90\]"),
        ({"epi": np.nan}, "epi must be finite"),
        ({"coordinates": jm.CYLINDRICAL}, "coordinates must be .*cylindrical"),
        ({"coordinates": jm.prolate_spheroidal(1.0)}, "coordinates must be"),
    ],
)
def test_helices_that_are_none(arguments: Any, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        jm.helix_fibres(VENTRICLE, **arguments)
