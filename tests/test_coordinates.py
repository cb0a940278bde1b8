"""World coordinates: scale factors, bases, F and energy in curved systems, against Cartesian tensors in numpy."""

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
import reference_tube
from hypothesis import given
from scipy.spatial.transform import Rotation
from test_element import central, residual_and_tangent_of, residual_of

import jaxmyo as jm
from jaxmyo import lagrangian, outputs, points, surface, ties
from jaxmyo.coordinates import Coordinates, evaluate
from jaxmyo.hexahedron import gauss, shape, shape_gradient
from jaxmyo.system import Inputs, System

FOCUS = 20.0  # mm
PROLATE = jm.prolate_spheroidal(FOCUS)


def _spherical(theta: Any) -> Any:
    r, mu, phi = theta
    return r * jnp.stack([jnp.sin(mu) * jnp.cos(phi), jnp.sin(mu) * jnp.sin(phi), jnp.cos(mu)])


#: A system of one's own: a position and nothing else.
SPHERICAL = Coordinates("spherical", ("r", "mu", "phi"), ("mm", "rad", "rad"), _spherical)

CURVED = [
    pytest.param(jm.CYLINDRICAL, id="cylindrical"),
    pytest.param(PROLATE, id="prolate"),
    pytest.param(SPHERICAL, id="spherical"),
]
#: The middle of a block and, at the size 1, its edges in each coordinate.
BLOCK = {
    "cylindrical": ((2.5, 0.6, 0.5), (1.0, 0.6, 2.0)),
    "prolate spheroidal": ((0.65, 1.1, 0.6), (0.3, 0.5, 0.6)),
    "spherical": ((1.8, 1.1, 0.6), (0.6, 0.5, 0.6)),
}
_g = jax.jit(lambda c, theta: c.g(theta), static_argnums=0)
_basis = jax.jit(lambda c, theta: c.basis(theta), static_argnums=0)
_position = jax.jit(lambda c, theta: c.position(theta), static_argnums=0)
_gradients = jax.jit(lagrangian.deformation_gradients)


def block(c: Coordinates, size: float, elements: tuple[int, int, int] = (2, 2, 2)) -> jm.Mesh:
    """A block of unequal elements; its edges and its elements shrink with `size` towards its middle."""
    steps = [np.linspace(0.0, 1.0, n + 1) for n in elements]
    middle, edges = BLOCK[c.name]
    return jm.structured(
        [m + size * e * (t + 0.2 * t * (1.0 - t) - 0.5) for m, e, t in zip(middle, edges, steps, strict=True)], c
    )


# ------------------------------------------------------------------- the systems by hand, in numpy: position and back


def position(c: Coordinates, theta: np.ndarray) -> np.ndarray:
    a, b, s = np.moveaxis(theta, -1, 0)
    if c is jm.CYLINDRICAL:
        return np.stack([a * np.cos(b), a * np.sin(b), s], axis=-1)
    if c is SPHERICAL:
        return np.stack([a * np.sin(b) * np.cos(s), a * np.sin(b) * np.sin(s), a * np.cos(b)], axis=-1)
    rho, z = FOCUS * np.sinh(a) * np.sin(b), FOCUS * np.cosh(a) * np.cos(b)
    return np.stack([rho * np.cos(s), rho * np.sin(s), z], axis=-1)


def coordinates_of(c: Coordinates, x: np.ndarray) -> np.ndarray:
    rho, z, phi = np.hypot(x[..., 0], x[..., 1]), x[..., 2], np.arctan2(x[..., 1], x[..., 0])
    if c is jm.CYLINDRICAL:
        return np.stack([rho, phi, z], axis=-1)
    if c is SPHERICAL:
        return np.stack([np.hypot(rho, z), np.arctan2(rho, z), phi], axis=-1)
    far, near = np.hypot(rho, z + FOCUS), np.hypot(rho, z - FOCUS)  # distances from the foci
    return np.stack([np.arccosh((far + near) / (2 * FOCUS)), np.arccos((far - near) / (2 * FOCUS)), phi], axis=-1)


def unit_vectors(c: Coordinates, theta: np.ndarray) -> np.ndarray:
    """Rows e_i at each point (..., 3, 3), by complex steps of the position."""
    columns = [np.imag(position(c, theta + 1e-30j * step)) for step in np.eye(3)]
    return np.stack([v / np.linalg.norm(v, axis=-1, keepdims=True) for v in columns], axis=-2)


# ------------------------------------------------------------------------------------------ scale factors and bases

POINTS = {
    "cylindrical": st.tuples(st.floats(1e-3, 50.0), st.floats(-7.0, 7.0), st.floats(-50.0, 50.0)),
    "prolate spheroidal": st.tuples(st.floats(0.01, 2.0), st.floats(0.01, 3.13), st.floats(-7.0, 7.0)),
    "spherical": st.tuples(st.floats(1e-3, 50.0), st.floats(0.01, 3.13), st.floats(-7.0, 7.0)),
}


@pytest.mark.parametrize("c", CURVED)
@given(data=st.data())
def test_scale_factors_and_basis(c: Coordinates, data: Any) -> None:
    """g_i = |∂x/∂θ_i|; the e_i are orthonormal and right-handed; position is the one by hand."""
    theta = np.array(data.draw(POINTS[c.name]))
    by_theta = np.asarray(_derivative(c, theta))
    g, e = np.asarray(_g(c, theta)), np.asarray(_basis(c, theta))
    np.testing.assert_allclose(g, np.linalg.norm(by_theta, axis=0), rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(e @ e.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(e), 1.0, rtol=1e-12)
    np.testing.assert_allclose(e, (by_theta / g).T, atol=1e-11)
    np.testing.assert_allclose(np.asarray(_position(c, theta)), position(c, theta), rtol=0, atol=1e-12)


_derivative = jax.jit(lambda c, theta: jax.jacfwd(c.position)(theta), static_argnums=0)


def test_scale_factors_in_numbers() -> None:
    np.testing.assert_allclose(np.asarray(_g(jm.CYLINDRICAL, np.array([2.5, 1.0, 3.0]))), [1.0, 2.5, 1.0], rtol=1e-15)
    lam, mu = 0.6, 1.1
    meridian = FOCUS * np.sqrt(np.sinh(lam) ** 2 + np.sin(mu) ** 2)
    around = FOCUS * np.sinh(lam) * np.sin(mu)
    np.testing.assert_allclose(
        np.asarray(_g(PROLATE, np.array([lam, mu, 2.0]))), [meridian, meridian, around], rtol=1e-14
    )
    np.testing.assert_allclose(
        np.asarray(_g(SPHERICAL, np.array([2.0, mu, 2.0]))), [1.0, 2.0, 2.0 * np.sin(mu)], rtol=1e-14
    )


def test_only_cartesian_coordinates_are_not_curved() -> None:
    assert not jm.CARTESIAN.curved
    assert all(c.curved for c in (jm.CYLINDRICAL, PROLATE, SPHERICAL))


def test_one_system_per_focus() -> None:
    """Systems are compared by identity of their functions; a new one for each call would compile anew."""
    assert jm.prolate_spheroidal(FOCUS) is PROLATE
    assert jm.prolate_spheroidal(10.0) != PROLATE


@pytest.mark.parametrize("focus", [0.0, -1.0, np.nan, np.inf])
def test_focus_that_is_no_length(focus: float) -> None:
    with pytest.raises(ValueError, match=f"focus = {focus}.*positive length"):
        jm.prolate_spheroidal(focus)


@pytest.mark.parametrize(
    ("c", "where", "axis"),
    [(jm.CYLINDRICAL, (-1.0, 0.0, 0.0), "phi"), (PROLATE, (0.3, -0.8, 0.0), "phi"), (PROLATE, (-0.6, 1.0, 0.0), "phi")],
)
def test_a_mesh_beyond_the_range_of_its_coordinates(c: Coordinates, where: Any, axis: str) -> None:
    nodes = [a + np.array([0.0, 0.2]) for a in where]
    with pytest.raises(ValueError, match=rf"element 0 leaves the {c.name} coordinates.*'{axis}' is -.*must be > 0"):
        jm.structured(nodes, c)


def test_a_mapped_mesh_is_the_same_body_in_straight_edges() -> None:
    mesh = block(jm.CYLINDRICAL, 1.0)
    straight = mesh.mapped(jm.CYLINDRICAL.position)
    assert straight.coordinates is jm.CARTESIAN
    assert straight.grid == (2, 2, 2)
    np.testing.assert_allclose(straight.points, position(jm.CYLINDRICAL, mesh.points), atol=1e-14)
    np.testing.assert_array_equal(straight.cells, mesh.cells)
    for name, quads in mesh.faces.items():
        np.testing.assert_array_equal(straight.face(name), quads)


# ------------------------------------------------------------------------------------------------------- systems

#: A right-handed frame, oblique to every coordinate line.
FRAME = Rotation.from_rotvec([0.3, -0.5, 0.4]).as_matrix()


def neo_hookean(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    """½ μ (I1 − 3 − ln I3): free of stress at rest."""
    return 0.5 * constants["mu"] * (jnp.trace(C) - 3.0 - jnp.log(jnp.linalg.det(C)))


def scene(mesh: jm.Mesh, **arguments: Any) -> jm.Scene:
    """A scene of neo-Hookean matter; the supports only keep it from being refused."""
    held = tuple(jm.Displacement(face, a) for face in list(mesh.faces)[:2] for a in mesh.coordinates.axes)
    return jm.Scene(mesh, **{"law": neo_hookean, "constants": {"mu": 10.0}, "supports": held, **arguments})


def unsupported(s: jm.Scene, *, weave: bool = False, surfaces: Any = None) -> System:
    """The system of all nodal displacements: z[: n_u] is u."""
    return System.of(s, ties.build(s.mesh, ()), weave=weave, surfaces=surfaces or {})


def no_inputs(system: System, constants: Any) -> Inputs:
    none = jnp.zeros(system.weight.shape)
    zero = jnp.zeros(())
    offset = jnp.zeros(system.points.size)
    return Inputs((constants,), zero, zero, zero, zero, none, none, offset, {}, jnp.zeros(0), jnp.zeros(system.size))


@pytest.mark.parametrize("c", CURVED)
def test_weights_sum_to_the_volume(c: Coordinates) -> None:
    """∫ g1 g2 g3 dθ of the block: exact in cylindrical coordinates, of fourth order in the element size else."""
    errors = []
    for size in (1.0, 0.5):
        mesh = block(c, size)
        got = float(np.sum(unsupported(scene(mesh)).weight))
        (a0, b0, s0), (a1, b1, s1) = mesh.points.min(axis=0), mesh.points.max(axis=0)
        if c is jm.CYLINDRICAL:
            volume = 0.5 * (a1**2 - a0**2) * (b1 - b0) * (s1 - s0)
        elif c is SPHERICAL:
            volume = (a1**3 - a0**3) / 3.0 * (np.cos(b0) - np.cos(b1)) * (s1 - s0)
        else:

            def cubic(cosine: Any) -> Any:
                return cosine**3 / 3.0 - cosine

            lam = cubic(np.cosh(a1)) - cubic(np.cosh(a0)), np.cosh(a1) - np.cosh(a0)
            mu = np.cos(b0) - np.cos(b1), cubic(np.cos(b1)) - cubic(np.cos(b0))
            volume = FOCUS**3 * (lam[0] * mu[0] + lam[1] * mu[1]) * (s1 - s0)
        errors.append(abs(got / volume - 1.0))
    if c is jm.CYLINDRICAL:
        assert max(errors) <= 1e-14
    else:
        assert 1e-9 < errors[1] < 1e-4
        assert 12.0 < errors[0] / errors[1] < 20.0


# ------------------------------------------------------------------------------------------ F of a Cartesian map

#: det A > 0, no symmetry; small enough to keep every block on its side of the axis.
A = np.array([[1.10, 0.12, -0.05], [-0.08, 0.95, 0.10], [0.06, -0.04, 1.07]])


def moved(mesh: jm.Mesh, F: np.ndarray) -> np.ndarray:
    """Nodal displacements of x → F x in the coordinates of the mesh."""
    return coordinates_of(mesh.coordinates, position(mesh.coordinates, mesh.points) @ F.T) - mesh.points


@pytest.mark.parametrize("c", CURVED)
def test_a_cartesian_map_at_second_order(c: Coordinates) -> None:
    """F_ij = e_i(θ) · A E_j(Θ) at the middle of every element, and in the mean over its 2×2×2 Gauss points."""
    errors = []
    for size in (0.5, 0.25):
        mesh = block(c, size)
        row = []
        for order in (1, 2):
            system = unsupported(scene(mesh, quadrature=order))
            F = np.asarray(_gradients(system, moved(mesh, A)))
            Theta = np.asarray(system.theta)
            E = unit_vectors(c, Theta)
            theta = coordinates_of(c, position(c, Theta) @ A.T)
            exact = unit_vectors(c, theta) @ A @ np.swapaxes(E, -1, -2)
            row.append(np.abs((F - exact).mean(axis=1)).max())
            assert np.abs(exact - np.eye(3)).max() > 0.05
        errors.append(row)
    ratio = np.array(errors[0]) / np.array(errors[1])
    assert (np.array(errors[1]) > 1e-6).all()
    assert (ratio > 3.4).all(), (errors, ratio)
    assert (ratio < 4.8).all(), (errors, ratio)


@pytest.mark.parametrize("c", CURVED)
def test_a_rotation_about_z_is_exact(c: Coordinates) -> None:
    """It is a shift of φ: F = 1 in the local bases, that is R in Cartesian components."""
    mesh = block(c, 1.0)
    system = unsupported(scene(mesh))
    R = Rotation.from_rotvec([0.0, 0.0, 0.4]).as_matrix()
    F = np.asarray(_gradients(system, moved(mesh, R)))
    np.testing.assert_allclose(F, np.broadcast_to(np.eye(3), F.shape), atol=1e-13)
    Theta = np.asarray(system.theta)
    turned = coordinates_of(c, position(c, Theta) @ R.T)
    cartesian = np.swapaxes(unit_vectors(c, turned), -1, -2) @ F @ unit_vectors(c, Theta)
    np.testing.assert_allclose(cartesian, np.broadcast_to(R, F.shape), atol=1e-8)


@pytest.mark.parametrize(
    ("c", "u"), [(jm.CYLINDRICAL, (-2.5, 0.0, 0.0)), (PROLATE, (-0.6, 0.0, 0.0)), (PROLATE, (0.0, -1.1, 0.0))]
)
def test_volume_ratios_beyond_the_range_of_the_coordinates(c: Coordinates, u: Any) -> None:
    """Where a scale factor is negative: two of them may leave det F positive, and the body is inside out all the same.

    A uniform shift of the radius keeps ∂θ/∂Θ = 1; elements that it leaves on their side are not touched.
    """
    mesh = block(c, 1.0)
    system = unsupported(scene(mesh))
    nodes = np.tile(np.array(u), (len(mesh.points), 1))
    in_lanes = [np.moveaxis(np.asarray(x), (1, 0), (-2, -1)) for x in (system.dN, system.theta, system.inverse_g)]
    dN, theta, inverse_g = map(jnp.asarray, in_lanes)
    of_cells = jnp.asarray(nodes[system.cells].transpose(2, 1, 0)[:, :, None])
    at = points.at(c, of_cells, dN, jnp.asarray(system.N).T[:, :, None], theta, inverse_g)
    J = np.asarray(points.least_J(c, at)).T
    g = np.asarray(jax.vmap(jax.vmap(c.g))(jnp.asarray(system.theta + np.array(u))))
    beyond = (g <= 0.0).any(axis=-1)
    assert beyond.any()
    np.testing.assert_array_equal(J[beyond], -1.0)
    if not beyond.all():
        at = np.prod(g, axis=-1) * np.prod(np.asarray(system.inverse_g), axis=-1)
        np.testing.assert_allclose(J[~beyond], at[~beyond], rtol=1e-12)
        assert (J[~beyond] > 0.0).all()


# --------------------------------------------------------------- the Lagrangian of a random deformation, in Cartesian

T0, A_OVER_D, BETA, SOFTNESS = 20.0, 0.2, 0.7, 0.02


class Body(NamedTuple):
    """A curved mesh without supports in a random deformation."""

    mesh: jm.Mesh
    frames: np.ndarray  # (n_elements, 3, 3) rows f, f⊥, n along the local unit vectors
    system: System
    inputs: Inputs
    z: np.ndarray


@cache
def body(c: Coordinates, weave: bool) -> Body:
    mesh = block(c, 1.0, (2, 1, 1))
    inner = np.random.default_rng(1).uniform(-0.06, 0.06, mesh.points.shape) * mesh.extent
    mesh = jm.Mesh(mesh.points + inner, mesh.cells, mesh.faces, c)
    frames = Rotation.random(2, rng=np.random.default_rng(2)).as_matrix()
    s = scene(mesh, law=jm.lin_yin, constants=jm.TABLE1, fibre=frames[:, 0], cross=frames[:, 1])
    system = unsupported(s, weave=weave)
    rng = np.random.default_rng(3)
    g = np.asarray(jax.vmap(c.g)(jnp.asarray(mesh.points)))
    size = np.cbrt(np.asarray(system.weight).sum() / 2)
    u = 0.08 * size * rng.standard_normal(mesh.points.shape) / g
    z = np.concatenate([u.ravel(), rng.uniform(-3.0, 3.0, system.size - u.size)])
    T_f, T_cf = rng.uniform(-5.0, 5.0, (2, *system.weight.shape)) * (0.0 if weave else 1.0)
    values = (T0, A_OVER_D, BETA, SOFTNESS * weave, T_f, T_cf, np.zeros(u.size))
    inputs = Inputs((s.constants,), *(jnp.asarray(v) for v in values), {}, jnp.zeros(0), jnp.zeros(system.size))
    return Body(mesh, frames, system, inputs, z)


BODIES = [
    pytest.param((c, weave), id=f"{name}-{'weave' if weave else 'tensions'}")
    for c, name in ((jm.CYLINDRICAL, "cylindrical"), (PROLATE, "prolate"))
    for weave in (True, False)
]


@pytest.fixture(scope="module", params=BODIES)
def case(request: pytest.FixtureRequest) -> tuple[Body, Callable[[np.ndarray], np.ndarray], np.ndarray]:
    b = body(*request.param)
    K = np.asarray(residual_and_tangent_of(b.system, b.z, b.inputs)[1])
    return b, lambda z: np.asarray(residual_and_tangent_of(b.system, z, b.inputs)[0]), K


def lagrangian_by_hand(b: Body) -> Callable[[np.ndarray], float]:
    """z → the Lagrangian [µJ], from the Cartesian deformation gradient ∂x/∂ξ (∂X/∂ξ)⁻¹: no scale factor enters."""
    c, mesh = b.mesh.coordinates, b.mesh
    xi, w = gauss(2, 2, 2)
    N, dN = shape(xi), shape_gradient(xi)
    k = reference.SETS["table1"]
    n_e = len(mesh.cells)

    def by_xi(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """θ at the Gauss points, and ∂x/∂ξ there, by complex steps of the position."""
        at = np.einsum("ga,eai->egi", N, theta[mesh.cells])
        along = np.einsum("gak,eai->egik", dN, theta[mesh.cells])
        step = [np.imag(position(c, at + 1e-30j * along[..., m])) / 1e-30 for m in range(3)]
        return at, np.stack(step, axis=-1)

    At, D = by_xi(mesh.points)
    weight = np.linalg.det(D) * w
    directions = np.einsum("eki,egij->egkj", b.frames, unit_vectors(c, At))
    f, cf = directions[:, :, 0], directions[:, :, 1]

    def total(z: np.ndarray) -> float:
        u, p = z[: mesh.points.size].reshape(-1, 3), z[mesh.points.size :][:n_e, None]
        F = by_xi(mesh.points + u)[1] @ np.linalg.inv(D)
        C = np.swapaxes(F, -1, -2) @ F
        i4, i6 = (np.einsum("egi,egij,egj->eg", d, C, d) for d in (f, cf))
        x, y = np.trace(C, axis1=-2, axis2=-1) - 3.0, i4 - 1.0
        W = reference.passive_energy(k, x, y) + BETA * reference.active_energy(k, x, y)
        W += 0.5 * BETA * T0 * np.log(i4) - 0.5 * p * (np.linalg.det(C) - 1.0)
        if b.system.weave:
            q = z[mesh.points.size + n_e :, None]
            W -= 0.5 * q * reference.constraint(np.sqrt(i4), np.sqrt(i6), A_OVER_D) + 0.125 * SOFTNESS * q**2
        else:
            W += 0.5 * np.asarray(b.inputs.T_f) * np.log(i4) + 0.5 * np.asarray(b.inputs.T_cf) * np.log(i6)
        return float(np.sum(W * weight))

    return total


def test_residual_is_the_gradient_of_the_lagrangian(case: Any) -> None:
    b, residual, _ = case
    r = residual(b.z)
    by_hand = central(lagrangian_by_hand(b), b.z, 1e-5)
    assert np.linalg.norm(r - by_hand) <= 1e-6 * np.linalg.norm(by_hand)
    np.testing.assert_allclose(r, by_hand, rtol=0, atol=1e-6 * np.abs(by_hand).max())


def test_tangent_is_the_derivative_of_the_residual(case: Any) -> None:
    b, residual, K = case
    differences = central(residual, b.z, 1e-6)
    assert np.linalg.norm(K - differences) <= 1e-6 * np.linalg.norm(differences)
    assert np.abs(K - differences).max() <= 1e-6 * np.abs(differences).max()


def test_gradient_is_the_derivative_of_f_at_rest(case: Any) -> None:
    """∂F/∂u in curved coordinates has a part from the scale factors: u_r stretches the circle."""
    b, _, _ = case
    du = b.z[: b.system.n_u]
    h = 1e-5
    plus, minus = (np.asarray(_gradients(b.system, s * h * du.reshape(-1, 3))) for s in (1.0, -1.0))
    by_columns = np.einsum("egia,ea->egi", b.system.gradient, du[np.asarray(b.system.local_u)])
    np.testing.assert_allclose(by_columns.reshape(plus.shape), (plus - minus) / (2.0 * h), rtol=0, atol=1e-9)


def test_tangent_is_symmetric(case: Any) -> None:
    _, _, K = case
    assert np.abs(K - K.T).max() <= 1e-14 * np.abs(K).max()


# -------------------------------------------------------------------------------------------- frame indifference

_stress = jax.jit(
    lambda system, z, inputs: outputs.second_piola_kirchhoff(
        system,
        lagrangian.deformation_gradients(system, system.displacements(z, inputs)),
        z[system.local_multipliers],
        inputs,
    )
)


@pytest.mark.parametrize("c", CURVED[:2])
def test_a_rotation_about_z_and_a_shift_along_it_change_nothing(c: Coordinates) -> None:
    """F, S, σ, forces and tangent keep their components in the local bases, whatever the angle."""
    b = body(c, False)
    phi = c.axes.index("phi")
    F = np.asarray(_gradients(b.system, b.z[: b.system.n_u].reshape(-1, 3)))
    S = np.asarray(_stress(b.system, b.z, b.inputs))
    r, K = (np.asarray(v) for v in residual_and_tangent_of(b.system, b.z, b.inputs))
    for angle, shift in ((0.7, 0.0), (-5.0, 3.0), (100.0, -40.0)):
        u = b.z[: b.system.n_u].reshape(-1, 3).copy()
        u[:, phi] += angle
        if c is jm.CYLINDRICAL:
            u[:, 2] += shift
        z = np.concatenate([u.ravel(), b.z[b.system.n_u :]])
        F_ = np.asarray(_gradients(b.system, u))
        np.testing.assert_allclose(F_, F, rtol=0, atol=1e-12)
        np.testing.assert_allclose(np.asarray(_stress(b.system, z, b.inputs)), S, rtol=0, atol=1e-12 * np.abs(S).max())
        r_, K_ = (np.asarray(v) for v in residual_and_tangent_of(b.system, z, b.inputs))
        np.testing.assert_allclose(r_, r, rtol=0, atol=1e-12 * np.abs(r).max())
        np.testing.assert_allclose(K_, K, rtol=0, atol=1e-12 * np.abs(K).max())


# ------------------------------------------------------------------------------------- two systems, one body


@pytest.mark.parametrize("bend", [0.0, 0.08], ids=["homogeneous", "bent"])
def test_the_same_energy_in_cylindrical_and_in_cartesian_hexahedra(bend: float) -> None:
    """A block cut from a cylinder, fibres along the Cartesian x: both energies are right at second order."""
    k = reference.SETS["table1"]

    def map_of(x: np.ndarray) -> np.ndarray:
        return x @ A.T + bend * np.stack([x[..., 1] * x[..., 2], x[..., 0] ** 2, x[..., 0] * x[..., 1]], axis=-1)

    def energy(s: jm.Scene, u: np.ndarray) -> float:
        """Per volume of the block [kPa]; the weights are those of the mesh."""
        system = unsupported(s)
        F, frame = np.asarray(_gradients(system, u)), np.asarray(system.frame)
        C = np.swapaxes(F, -1, -2) @ F
        i4 = np.einsum("egi,egij,egj->eg", frame[:, :, 0], C, frame[:, :, 0])
        W = reference.passive_energy(k, np.trace(C, axis1=-2, axis2=-1) - 3.0, i4 - 1.0)
        (r0, b0, z0), (r1, b1, z1) = (f(s.mesh.points, axis=0) for f in (np.min, np.max)) if s.mesh is mesh else limits
        return float(np.sum(np.asarray(system.weight) * W) / (0.5 * (r1**2 - r0**2) * (b1 - b0) * (z1 - z0)))

    exact = reference.passive_energy(k, np.trace(A.T @ A) - 3.0, (A.T @ A)[0, 0] - 1.0)
    errors = []
    for size in (0.5, 0.25):
        mesh = block(jm.CYLINDRICAL, size)
        limits = mesh.points.min(axis=0), mesh.points.max(axis=0)
        along_x = partial(_along, 0)
        u = coordinates_of(jm.CYLINDRICAL, map_of(position(jm.CYLINDRICAL, mesh.points))) - mesh.points
        curved = energy(scene(mesh, fibre=along_x, cross=(0.0, 0.0, 1.0)), u)
        straight = mesh.mapped(jm.CYLINDRICAL.position)
        x = straight.points
        flat = energy(scene(straight, fibre=(1.0, 0.0, 0.0), cross=(0.0, 0.0, 1.0)), map_of(x) - x)
        errors.append([abs(curved - flat), abs(curved - exact), abs(flat - exact)] if bend == 0 else [curved - flat])
    ratio = np.array(errors[0]) / np.array(errors[1])
    assert (ratio > 3.4).all(), (errors, ratio)
    assert (ratio < 4.8).all(), (errors, ratio)


def _along(axis: int, theta: np.ndarray) -> np.ndarray:
    """A Cartesian unit vector in the local bases of cylindrical coordinates."""
    return unit_vectors(jm.CYLINDRICAL, theta)[..., axis]


# --------------------------------------------------------------------------------------------------- boundary values

MU = 10.0  # kPa


def sphere(n: int) -> jm.Scene:
    """A narrow wedge of a thick sphere, radii 1 and 2 mm; the radii of n + 1 shells are the only displacements."""
    mesh = jm.structured([np.linspace(1.0, 2.0, n + 1), 0.5 * np.pi + np.array([-0.1, 0.1]), [0.0, 0.2]], SPHERICAL)
    everywhere = ("r", "mu", "phi")
    radial = jm.Uniform("r", ("mu", "phi")), jm.Uniform("mu", everywhere), jm.Uniform("phi", everywhere)
    return jm.Scene(mesh, neo_hookean, {"mu": MU}, supports=(*radial, jm.Symmetry("mu"), jm.Symmetry("phi")))


def newton(s: jm.Scene, load: jm.Pressure, u: np.ndarray) -> tuple[System, np.ndarray, Inputs]:
    """The equilibrium z near the unknowns u, in numpy on the residual of the package and its differences."""
    surfaces, loads = surface.build(s.mesh, (load,))
    system = System.of(s, s.kinematics(()), weave=False, surfaces=surfaces)
    inputs = no_inputs(system, s.constants)._replace(loads=loads)
    z = np.concatenate([u, np.zeros(system.n_p)])
    for _ in range(8):
        r = np.asarray(residual_of(system, z, inputs))
        K = central(lambda z: residual_of(system, z, inputs), z, 1e-6)
        z = z - np.linalg.solve(K, r)
    assert np.abs(r).max() <= 1e-12 * np.abs(K).max()
    return system, z, inputs


def test_inflation_of_a_thick_sphere_in_coordinates_of_ones_own() -> None:
    """Against the closed form, at second order."""
    P = reference_tube.neo_hookean_sphere(MU, 1.0, 2.0, 1.3)
    errors = []
    for n in (4, 8):
        s = sphere(n)
        assert s.kinematics(()).size == n + 1
        R = np.linspace(1.0, 2.0, n + 1)
        exact = np.cbrt(1.3**3 + R**3 - 1.0) - R
        _, z, _ = newton(s, jm.Pressure("r0", P), exact)
        errors.append(np.abs(z[: n + 1] - exact).max())
    assert 1e-5 < errors[1] < 1e-2
    assert 3.6 < errors[0] / errors[1] < 4.4, errors


def shell() -> jm.Scene:
    """The upper half of a closed ellipsoid, one element around: the axis μ = 0 is an edge of the mesh."""
    mesh = jm.structured([np.linspace(0.5, 0.8, 2), np.linspace(0.0, 0.5 * np.pi, 5), [0.0, 2.0 * np.pi]], PROLATE)
    supports = (
        jm.Uniform("lambda", ("phi",)),
        jm.Uniform("mu", ("phi",)),
        jm.Uniform("phi", ("lambda", "mu", "phi")),
        jm.Symmetry("mu"),
        jm.Displacement("mu1", "mu"),
        jm.Symmetry("phi"),
    )
    return jm.Scene(mesh, neo_hookean, {"mu": MU}, supports=supports, quadrature=(2, 2, 1))


def assert_inflated(system: System, u: np.ndarray, F: np.ndarray) -> None:
    """Finite; the volume is that of P, in the mean of each element; the wall thinner, the cavity wider."""
    assert np.isfinite(u).all()
    weight, J = np.asarray(system.weight), np.linalg.det(F)
    np.testing.assert_allclose((weight * J**2).sum(axis=1) / weight.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose((weight * J).sum() / weight.sum(), 1.0, atol=2e-3)
    inner, outer = (np.asarray(system.points) + u)[:, 0].reshape(2, 5, 2)
    assert (inner > 0.51).all()
    assert (outer - inner < 0.29).all()


def test_inflation_of_a_prolate_shell() -> None:
    """Its closed cavity grows by what the pressure's work says: P dV = dW, by differences of two pressures."""
    s = shell()
    n = s.kinematics(()).size
    energies, volumes = [], []
    u = np.zeros(n)
    for P in (2.95, 3.05, 3.0):
        system, z, inputs = newton(s, jm.Pressure("lambda0", P, "closed"), u)
        u = z[:n]
        nodes = np.asarray(system.displacements(jnp.asarray(z), inputs))
        F = np.asarray(_gradients(system, nodes))
        C = np.swapaxes(F, -1, -2) @ F
        W = 0.5 * MU * (np.trace(C, axis1=-2, axis2=-1) - 3.0 - np.log(np.linalg.det(C)))
        energies.append(float(np.sum(np.asarray(system.weight) * W)))
        quads = (np.asarray(system.points) + nodes)[s.mesh.face("lambda0")]
        volumes.append(float(jnp.sum(jax.vmap(lambda q: surface.cavity_volume(PROLATE, q))(jnp.asarray(quads)))))
    assert_inflated(system, nodes, F)
    work = 3.0 * (volumes[1] - volumes[0])
    assert work > 1.0
    np.testing.assert_allclose(energies[1] - energies[0], work, rtol=1e-3)


@pytest.mark.slow
def test_inflation_of_a_prolate_shell_from_rest() -> None:
    rest = jm.contract(shell(), T0=0.0, a_over_D=None)
    np.testing.assert_allclose(np.asarray(rest.u), 0.0, atol=1e-13)
    state = jm.load(rest, jm.Pressure("lambda0", 3.0, "closed"))
    assert int(state.negative_eigenvalues) == 0
    assert all(np.isfinite(np.asarray(f)).all() for f in (state.p, state.cauchy, state.reactions))
    assert_inflated(state.system, np.asarray(state.u), np.asarray(state.F))


def test_a_function_of_points_is_traced_once() -> None:
    """Also where a mesh is made while JAX traces."""
    traced = []

    def double(theta: Any) -> Any:
        traced.append(theta)
        return 2.0 * theta

    points = np.arange(6.0).reshape(2, 3)
    np.testing.assert_array_equal(evaluate(double, points), 2.0 * points)

    @jax.jit
    def within(x: Any) -> Any:
        return x + evaluate(double, points + 1.0)[1, 2]

    assert float(within(1.0)) == 13.0
    assert len(traced) == 1
