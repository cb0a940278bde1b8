"""The Q1-Q0 element: frame indifference, symmetry, tangent against differences, patch test, quadrature."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from scipy.spatial.transform import Rotation

import jaxmyo as jm
from jaxmyo import element_batches, lagrangian, outputs, ties
from jaxmyo.hexahedron import gauss, shape, shape_gradient
from jaxmyo.system import Inputs, System

T0, A_OVER_D, BETA = 20.0, 0.2, 0.7
residual_of = jax.jit(lagrangian.residual)
residual_and_tangent_of = jax.jit(element_batches.residual_and_tangent)
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])


def distorted() -> jm.Mesh:
    """2x2x1 hexahedra, every node displaced at random, so that no face is plane."""
    mesh = jm.box((2.0, 2.0, 1.0), (2, 2, 1))
    shift = np.random.default_rng(3).uniform(-0.12, 0.12, mesh.points.shape)
    return jm.Mesh(mesh.points + shift, mesh.cells, mesh.faces)


def frames(n_elements: int) -> tuple[np.ndarray, np.ndarray]:
    """Fibre and cross-fibre of each element, in random directions."""
    axes = Rotation.random(n_elements, rng=np.random.default_rng(4)).as_matrix()
    return axes[:, 0], axes[:, 1]


class Body(NamedTuple):
    """A distorted mesh without supports in a random deformation."""

    system: System
    inputs: Inputs
    z: np.ndarray

    @property
    def u(self) -> np.ndarray:
        return self.z[: self.system.n_u].reshape(-1, 3)


def body(weave: bool, measure: str | None = None) -> Body:
    mesh = distorted()
    fibre, cross = frames(len(mesh.cells))
    scene = jm.Scene(mesh, jm.lin_yin, jm.TABLE1, fibre, cross, (jm.Homogeneous(),))
    surfaces = {measure: np.concatenate([mesh.face("x1"), mesh.face("z0")])} if measure else {}
    system = System.of(scene, ties.build(mesh, ()), weave=weave, surfaces=surfaces)
    rng = np.random.default_rng(5)
    u = 0.08 * rng.standard_normal(mesh.points.size)
    z = np.concatenate([u, rng.uniform(-3.0, 3.0, system.size - u.size)])
    T_f, T_cf = rng.uniform(-5.0, 5.0, (2, *system.weight.shape)) * (0.0 if weave else 1.0)
    vector = measure in ("nominal", "cauchy")
    loads = {k: jnp.asarray(rng.uniform(-2.0, 2.0, (len(q), 3) if vector else len(q))) for k, q in surfaces.items()}
    values = (T0, A_OVER_D, BETA, 0.02 * weave, T_f, T_cf, np.zeros(u.size))
    inputs = Inputs((scene.constants,), *(jnp.asarray(v) for v in values), loads, jnp.zeros(0), jnp.zeros(system.size))
    return Body(system, inputs, z)


CASES = [
    pytest.param((True, None), id="weave"),
    pytest.param((False, None), id="tensions"),
    pytest.param((False, "nominal"), id="nominal-tractions"),
    pytest.param((False, "cauchy"), id="cauchy-tractions"),
    pytest.param((False, "open"), id="open-pressure"),
    pytest.param((False, "closed"), id="closed-pressure"),
    pytest.param((False, "spring"), id="springs"),
    pytest.param((False, "normal spring"), id="normal-springs"),
]


@pytest.fixture(scope="module", params=CASES)
def case(request: pytest.FixtureRequest) -> tuple[str | None, Body, Any, Any]:
    weave, measure = request.param
    b = body(weave, measure)
    tangent = np.asarray(residual_and_tangent_of(b.system, b.z, b.inputs)[1])
    return measure, b, lambda z: residual_of(b.system, z, b.inputs), tangent


def central(function: Any, z: np.ndarray, h: float) -> np.ndarray:
    """Central differences of a function by every unknown; last axis: the unknown."""
    steps = h * np.eye(z.size)
    return np.stack([(np.asarray(function(z + s)) - np.asarray(function(z - s))) / (2.0 * h) for s in steps], axis=-1)


# ------------------------------------------------------------------------- an independent Lagrangian, in numpy


def lagrangian_by_hand(b: Body) -> Any:
    """z -> the Lagrangian of the body [µJ], with its own shape functions, quadrature and energies, no tractions."""
    mesh = distorted()
    fibre, cross = frames(len(mesh.cells))
    points = [np.array([x, y, t]) / np.sqrt(3.0) for x in (-1, 1) for y in (-1, 1) for t in (-1, 1)]
    c = reference.SETS["table1"]
    multipliers = b.system.size - b.system.n_u

    def gradient(xi: np.ndarray) -> np.ndarray:
        sign = 2.0 * CORNERS - 1.0
        f = 0.5 * (1.0 + sign * xi)
        return np.stack([0.5 * sign[:, k] * np.prod(np.delete(f, k, axis=1), axis=1) for k in range(3)], axis=1)

    dN = np.array([gradient(xi) for xi in points])
    J = np.einsum("eai,gak->egik", mesh.points[mesh.cells], dN)
    by_X = np.einsum("gak,egki->egai", dN, np.linalg.inv(J))

    def total(z: np.ndarray) -> float:
        u, p = z[: b.system.n_u].reshape(-1, 3), z[b.system.n_u :][: len(mesh.cells), None]
        F = np.eye(3) + np.einsum("eai,egaj->egij", u[mesh.cells], by_X)
        C = np.swapaxes(F, -1, -2) @ F
        i4, i6 = (np.einsum("ei,egij,ej->eg", d, C, d) for d in (fibre, cross))
        x, y = np.trace(C, axis1=-2, axis2=-1) - 3.0, i4 - 1.0
        W = reference.passive_energy(c, x, y) + BETA * reference.active_energy(c, x, y)
        W += 0.5 * BETA * T0 * np.log(i4) - 0.5 * p * (np.linalg.det(C) - 1.0)
        if multipliers > len(mesh.cells):
            q = z[b.system.n_u + len(mesh.cells) :, None]
            W -= 0.5 * q * reference.constraint(np.sqrt(i4), np.sqrt(i6), A_OVER_D) + 0.125 * 0.02 * q**2
        else:
            W += 0.5 * np.asarray(b.inputs.T_f) * np.log(i4) + 0.5 * np.asarray(b.inputs.T_cf) * np.log(i6)
        return float(np.sum(W * np.linalg.det(J)))

    return total


@pytest.mark.parametrize("weave", [True, False])
def test_residual_is_the_gradient_of_the_summed_lagrangian(weave: bool) -> None:
    b = body(weave)
    r = np.asarray(residual_of(b.system, b.z, b.inputs))
    by_hand = central(lagrangian_by_hand(b), b.z, 1e-5)
    np.testing.assert_allclose(r, by_hand, rtol=0, atol=1e-8 * np.abs(r).max())


# ------------------------------------------------------------------------------------------------------ tangent


def test_tangent_against_differences_of_the_residual(case: Any) -> None:
    _, b, residual, K = case
    differences = central(residual, b.z, 1e-5)
    assert np.linalg.norm(K - differences) <= 1e-6 * np.linalg.norm(differences)
    assert np.abs(K - differences).max() <= 1e-6 * np.abs(differences).max()


def test_tangent_is_symmetric_unless_the_load_follows(case: Any) -> None:
    measure, _, _, K = case
    asymmetry = np.abs(K - K.T).max() / np.abs(K).max()
    if measure in ("cauchy", "open"):
        assert asymmetry > 1e-6
    else:
        assert asymmetry <= 1e-14


def test_residual_is_the_same_with_and_without_tangent(case: Any) -> None:
    _, b, residual, _ = case
    r = np.asarray(residual_and_tangent_of(b.system, b.z, b.inputs)[0])
    np.testing.assert_allclose(np.asarray(residual(b.z)), r, rtol=0, atol=1e-13 * np.abs(r).max())


def test_multipliers_have_a_diagonal_block_only_where_the_weave_is_soft(case: Any) -> None:
    """−¼ V / k for q of a weave of stiffness k = 1/0.02 kPa, else nothing."""
    _, b, _, K = case
    block = K[b.system.n_u :, b.system.n_u :]
    volume = np.asarray(b.system.weight).sum(axis=1)
    soft = -0.25 * 0.02 * volume if b.system.weave else np.zeros(0)
    np.testing.assert_allclose(block, np.diag(np.concatenate([np.zeros(len(volume)), soft])), rtol=1e-13, atol=0)


# --------------------------------------------------------------------------------------------- frame indifference


@pytest.mark.parametrize("weave", [True, False])
def test_frame_indifference(weave: bool) -> None:
    """x -> R x + t after the deformation: S stays, nodal forces turn with R, constraint residuals stay."""
    b = body(weave)
    n_u = b.system.n_u
    X = np.asarray(b.system.points)

    @jax.jit
    def evaluate(z: Any) -> Any:
        F = lagrangian.deformation_gradients(b.system, b.system.displacements(z, b.inputs))
        multipliers = z[b.system.local_multipliers]
        S = outputs.second_piola_kirchhoff(b.system, F, multipliers, b.inputs)
        return lagrangian.residual(b.system, z, b.inputs), S, outputs.cauchy(F, S)

    r, S, sigma = (np.asarray(v) for v in evaluate(b.z))
    np.testing.assert_array_equal(S, np.swapaxes(S, -1, -2))
    assert np.abs(sigma - np.swapaxes(sigma, -1, -2)).max() <= 1e-14 * np.abs(sigma).max()
    assert np.linalg.norm(r[:n_u]) > 1.0
    for R in Rotation.random(10, rng=np.random.default_rng(6)).as_matrix():
        moved = (X + b.u) @ R.T + np.array([1.0, -2.0, 0.5]) - X
        r_, S_, sigma_ = (np.asarray(v) for v in evaluate(np.concatenate([moved.ravel(), b.z[n_u:]])))
        np.testing.assert_allclose(S_, S, rtol=0, atol=1e-12 * np.abs(S).max())
        np.testing.assert_allclose(sigma_, R @ sigma @ R.T, rtol=0, atol=1e-12 * np.abs(sigma).max())
        turned = (r[:n_u].reshape(-1, 3) @ R.T).ravel()
        np.testing.assert_allclose(r_[:n_u], turned, rtol=0, atol=1e-12 * np.abs(r).max())
        np.testing.assert_allclose(r_[n_u:], r[n_u:], rtol=0, atol=1e-13)


@pytest.mark.parametrize("weave", [True, False])
def test_internal_forces_have_no_resultant_and_no_moment(weave: bool) -> None:
    b = body(weave)
    forces = np.asarray(residual_of(b.system, b.z, b.inputs))[: b.system.n_u].reshape(-1, 3)
    x = np.asarray(b.system.points) + b.u
    np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=1e-12 * np.abs(forces).max())
    np.testing.assert_allclose(np.cross(x, forces).sum(axis=0), 0.0, atol=1e-12 * np.abs(forces).max())


def test_rigid_motion_is_no_deformation() -> None:
    b = body(False)
    X = np.asarray(b.system.points)
    R = Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix()
    z = np.concatenate([(X @ R.T + 3.0 - X).ravel(), 0.0 * b.z[b.system.n_u :]])
    none = jnp.zeros_like(b.inputs.T_f)
    rest = b.inputs._replace(beta=jnp.array(0.0), T_f=none, T_cf=none)
    np.testing.assert_allclose(np.asarray(residual_of(b.system, z, rest)), 0.0, atol=1e-13)


# -------------------------------------------------------------------------------------------------- quadrature


def test_weights_sum_to_the_volume() -> None:
    for order in (1, 2, 3, 4):
        scene = jm.thin_sample(elements=(3, 2, 2), distortion=0.2, quadrature=order)
        system = System.of(scene, scene.kinematics(()), weave=True, surfaces={})
        assert system.weight.shape == (12, order**3)
        assert (np.asarray(system.weight) > 0.0).all()
        if order > 1:  # det J of a distorted hexahedron is a polynomial that one point does not integrate
            np.testing.assert_allclose(float(system.weight.sum()), 100.0, rtol=1e-13)


def test_gauss_points_integrate_polynomials() -> None:
    for order in range(1, 9):
        xi, w = gauss(order, order, order)
        assert xi.shape == (order**3, 3)
        np.testing.assert_allclose(w.sum(), 8.0, rtol=1e-14)
        power = 2 * order - 2
        np.testing.assert_allclose(w @ xi[:, 0] ** power, 8.0 / (power + 1), rtol=1e-13)
        np.testing.assert_allclose(w @ (xi[:, 1] ** power * xi[:, 2] ** power), 8.0 / (power + 1) ** 2, rtol=1e-13)


def test_shape_functions_interpolate_linear_fields() -> None:
    xi = np.random.default_rng(7).uniform(-1.0, 1.0, (20, 3))
    N, dN = shape(xi), shape_gradient(xi)
    nodes = 2.0 * CORNERS - 1.0
    np.testing.assert_allclose(N.sum(axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(N @ nodes, xi, atol=1e-14)
    np.testing.assert_allclose(np.einsum("nai,aj->nji", dN, nodes), np.broadcast_to(np.eye(3), (20, 3, 3)), atol=1e-14)
    np.testing.assert_allclose(shape(nodes), np.eye(8), atol=0)


# -------------------------------------------------------------------------------------------------- patch test


@pytest.mark.parametrize(("weave", "order"), [(True, 2), (False, 2), (True, 3), (True, 4)])
def test_patch_a_homogeneous_state_is_in_equilibrium_on_any_mesh(weave: bool, order: int) -> None:
    """The reference's state A on a mesh with bent element edges: no force on inner nodes, no stress anywhere."""
    mesh = jm.box((10.0, 10.0, 1.0), (3, 3, 3))
    inner = ((mesh.points > 0.0) & (mesh.points < mesh.extent)).all(axis=1)
    shift = np.random.default_rng(8).uniform(-0.25, 0.25, mesh.points.shape) * mesh.extent / 3.0
    mesh = jm.Mesh(mesh.points + np.where(inner[:, None], shift, 0.0), mesh.cells, mesh.faces)
    supports = tuple(jm.Symmetry(axis) for axis in ("x", "y", "z"))
    scene = jm.Scene(mesh, jm.lin_yin, jm.TABLE1, supports=supports, quadrature=order)
    system = System.of(scene, ties.build(mesh, ()), weave=weave, surfaces={})
    a = reference.free_contraction(reference.SETS["table1"], 35.0, 0.2 if weave else None, 1.0)
    n_e = len(mesh.cells)
    z = np.concatenate([((a.stretches - 1.0) * mesh.points).ravel(), np.full(n_e, a.p), np.full(n_e * weave, a.q)])
    none = jnp.zeros(system.weight.shape)
    values = (35.0, 0.2, 1.0, 0.0, none, none, np.zeros(mesh.points.size))
    inputs = Inputs((scene.constants,), *(jnp.asarray(v) for v in values), {}, jnp.zeros(0), jnp.zeros(system.size))
    residual = np.asarray(residual_of(system, z, inputs))
    assert np.abs(residual).max() <= 1e-10


def test_the_quadrature_order_does_not_change_a_homogeneous_state() -> None:
    """Orders 1 and 4; order 2 is that of every test on a mesh, order 3 that of a patch test above."""
    exact = reference.free_contraction(reference.SETS["table1"], 5.0, 0.2, 1.0)
    for order in (1, 4):
        scene = jm.thin_sample(quadrature=order)
        state = jm.contract(scene, T0=5.0, a_over_D=0.2)
        assert state.stretches.shape == (1, order**3, 3)
        got = np.asarray(state.stretches)
        np.testing.assert_allclose(got, np.broadcast_to(exact.stretches, got.shape), rtol=0, atol=1e-11)
        np.testing.assert_allclose(np.asarray(state.p), exact.p, rtol=1e-10)
        np.testing.assert_allclose(np.asarray(state.q), exact.q, rtol=1e-10)
