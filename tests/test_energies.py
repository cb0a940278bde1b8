"""The energy densities and invariants at random strains, against hand-derived derivatives."""

from typing import Any

import hypothesis.extra.numpy as hnp
import jax
import jax.numpy as jnp
import numpy as np
import reference
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import jaxmyo as jm
from jaxmyo import energies, invariants

STANDARD = np.eye(3)


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, allow_infinity=False)


vectors = hnp.arrays(float, 3, elements=numbers(-3.0, 3.0))
rotations = vectors.map(lambda v: Rotation.from_rotvec(v).as_matrix())


@st.composite
def strains(draw: st.DrawFn) -> np.ndarray:
    """C with principal stretches in [0.6, 1.6], in any directions."""
    stretches = np.array([draw(numbers(0.6, 1.6)) for _ in range(3)])
    R = draw(rotations)
    C = R.T @ np.diag(stretches**2) @ R
    return 0.5 * (C + C.T)


def lin_yin(C: Any, frame: Any, beta: Any) -> Any:
    return jm.lin_yin(C, frame, beta, jm.TABLE1)


value = jax.jit(lin_yin)
gradient = jax.jit(jax.grad(lin_yin))
passive = jax.jit(lambda C, frame: energies.lin_yin_passive(C, frame, jm.MEASURED))
active = jax.jit(lambda C, frame: energies.lin_yin_active(C, frame, jm.MEASURED))
weave_h = jax.jit(invariants.weave_h)
all_invariants = jax.jit(
    lambda C, frame: (invariants.I1(C), invariants.I3(C), invariants.I4(C, frame), invariants.I6(C, frame))
)
weave_gradient = jax.jit(jax.grad(energies.weave, argnums=(0, 1, 2)))
tension_gradient = jax.jit(jax.grad(energies.frozen_tensions))
beating_gradient = jax.jit(jax.grad(energies.beating))
pressure_gradient = jax.jit(jax.grad(energies.incompressibility, argnums=(0, 1)))


def close(got: Any, expected: Any, tolerance: float = 1e-12) -> None:
    expected = np.asarray(expected)
    np.testing.assert_allclose(np.asarray(got), expected, rtol=0, atol=tolerance * (1.0 + np.abs(expected).max()))


def symmetric(A: np.ndarray) -> np.ndarray:
    return 0.5 * (A + A.T)


def strain_measures(C: np.ndarray, frame: np.ndarray) -> tuple[float, float]:
    return float(np.trace(C)) - 3.0, float(frame[0] @ C @ frame[0]) - 1.0


# --------------------------------------------------------------------------------------------------- invariants


@given(strains(), rotations)
def test_invariants(C: np.ndarray, frame: np.ndarray) -> None:
    i1, i3, i4, i6 = all_invariants(C, frame)
    close(i1, np.trace(C))
    close(i3, np.linalg.det(C))
    close(i4, (frame @ C @ frame.T)[0, 0])
    close(i6, (frame @ C @ frame.T)[1, 1])


@given(strains(), rotations, rotations, numbers(0.0, 1.0))
def test_energy_depends_on_the_material_frame_only(
    C: np.ndarray, frame: np.ndarray, R: np.ndarray, beta: float
) -> None:
    """Turning the body in its zero-stress state together with its fibres changes nothing."""
    close(value(R @ C @ R.T, frame @ R.T, beta), value(C, frame, beta), 1e-10)


@given(strains(), rotations, numbers(0.0, 6.3), numbers(0.0, 1.0))
def test_energy_is_transversely_isotropic(C: np.ndarray, frame: np.ndarray, angle: float, beta: float) -> None:
    around = Rotation.from_rotvec(angle * frame[0]).as_matrix()
    close(value(around @ C @ around.T, frame, beta), value(C, frame, beta), 1e-10)


# ----------------------------------------------------------------------------------------------------- energies


@given(strains(), rotations)
def test_energies_against_the_reference(C: np.ndarray, frame: np.ndarray) -> None:
    x, y = strain_measures(C, frame)
    c = reference.SETS["measured"]
    close(passive(C, frame), reference.passive_energy(c, x, y), 1e-11)
    close(active(C, frame), reference.active_energy(c, x, y))


@given(strains(), rotations, numbers(0.0, 1.0))
def test_gradient_against_the_derivatives_by_hand(C: np.ndarray, frame: np.ndarray, beta: float) -> None:
    """dW/dC = W1 I + W4 f f."""
    x, y = strain_measures(C, frame)
    c = reference.SETS["table1"]
    w = reference.passive_derivatives(c, x, y).plus(beta, reference.active_derivatives(c, x, y))
    close(symmetric(np.asarray(gradient(C, frame, beta))), w.w1 * STANDARD + w.w4 * np.outer(frame[0], frame[0]), 1e-11)


@given(rotations, numbers(0.0, 1.0))
def test_rest_carries_no_deviatoric_stress(frame: np.ndarray, beta: float) -> None:
    """At C = I the law gives beta C4a I, a pressure; the passive tissue gives nothing."""
    close(value(STANDARD, frame, beta), 0.0)
    close(gradient(STANDARD, frame, beta), beta * jm.TABLE1.C4a * STANDARD)


@given(strains(), rotations)
def test_passive_energy_is_not_negative(C: np.ndarray, frame: np.ndarray) -> None:
    """Q is a positive definite form of (I1 - 3, I4 - 1) for the sets with 3.21, -2.60, 2.01."""
    assert float(passive(C, frame)) >= 0.0


def test_passive_energy_has_no_shear_stiffness_at_rest() -> None:
    second = jax.jit(jax.hessian(lambda C: energies.lin_yin_passive(C, jnp.eye(3), jm.MEASURED)))(jnp.eye(3))
    shear = np.zeros((3, 3))
    shear[0, 1] = shear[1, 0] = 1.0
    assert np.einsum("ij,ijkl,kl", shear, np.asarray(second), shear) == 0.0
    across = np.diag([0.0, 1.0, -1.0])
    np.testing.assert_allclose(np.einsum("ij,ijkl,kl", across, np.asarray(second), across), 0.0, atol=1e-15)
    along = np.diag([2.0, -1.0, -1.0])
    assert np.einsum("ij,ijkl,kl", along, np.asarray(second), along) > 1.0


def test_constants_may_be_differentiated() -> None:
    C = np.diag([1.3, 0.9, 0.8])
    x, y = strain_measures(C, STANDARD)
    by = jax.jit(jax.grad(lambda c: jm.lin_yin(jnp.asarray(C), jnp.eye(3), jnp.array(0.5), c)))(jm.TABLE1)
    close(by.C1a, 0.5 * x * y)
    close(by.C1p, reference.passive_energy(reference.SETS["table1"], x, y) / jm.TABLE1.C1p)


# ----------------------------------------------------------------------------------------------------- Guccione

guccione = jax.jit(lambda C, frame: jm.guccione(C, frame, jnp.zeros(()), jm.LAND_ACTIVE))
guccione_gradient = jax.jit(jax.grad(lambda C, frame: jm.guccione(C, frame, jnp.zeros(()), jm.LAND_ACTIVE)))


@given(strains(), rotations)
def test_guccione_by_hand(C: np.ndarray, frame: np.ndarray) -> None:
    """S = 2 dW/dC = C e^Q b∘E along the frame, b = bf, bt and bfs for the components of E."""
    c = jm.LAND_ACTIVE
    E = 0.5 * (frame @ C @ frame.T - STANDARD)
    b = np.array([[c.bf, c.bfs, c.bfs], [c.bfs, c.bt, c.bt], [c.bfs, c.bt, c.bt]])
    Q = np.sum(b * E**2)
    close(guccione(C, frame), 0.5 * c.C * np.expm1(Q), 1e-11)
    S = frame.T @ (c.C * np.exp(Q) * b * E) @ frame
    close(2.0 * symmetric(np.asarray(guccione_gradient(C, frame))), S, 1e-11)


@given(strains(), rotations, rotations, numbers(0.0, 6.3))
def test_guccione_depends_on_the_fibre_only(C: np.ndarray, frame: np.ndarray, R: np.ndarray, angle: float) -> None:
    """Turning body and fibres together, or the body about the fibre, changes nothing."""
    close(guccione(R @ C @ R.T, frame @ R.T), guccione(C, frame), 1e-10)
    around = Rotation.from_rotvec(angle * frame[0]).as_matrix()
    close(guccione(around @ C @ around.T, frame), guccione(C, frame), 1e-10)


@given(rotations)
def test_guccione_rests_without_stress(frame: np.ndarray) -> None:
    close(guccione(STANDARD, frame), 0.0)
    close(guccione_gradient(STANDARD, frame), np.zeros((3, 3)), 1e-14)


@given(strains(), rotations)
def test_guccione_with_equal_constants_is_isotropic(C: np.ndarray, frame: np.ndarray) -> None:
    """Problem 2 of Land et al.: ½ C (exp(tr E²) − 1), whatever the fibres."""
    E = 0.5 * (C - STANDARD)
    W = jm.guccione(jnp.asarray(C), jnp.asarray(frame), jnp.zeros(()), jm.LAND_PASSIVE)
    close(W, 5.0 * np.expm1(np.trace(E @ E)), 1e-11)


# ------------------------------------------------------------------------------------------ tensions and weave


@given(strains(), rotations, numbers(0.0, 200.0))
def test_beating_tension_is_a_cauchy_stress_along_the_deformed_fibre(
    C: np.ndarray, frame: np.ndarray, tension: float
) -> None:
    """sigma = 2 F (dW/dC) F^T = T f f with the unit vector f along F f0; here F is the root of C."""
    values, axes = np.linalg.eigh(C)
    F = axes @ np.diag(np.sqrt(values)) @ axes.T
    f = F @ frame[0] / np.linalg.norm(F @ frame[0])
    sigma = 2.0 * F @ symmetric(np.asarray(beating_gradient(C, frame, tension))) @ F.T
    close(sigma, tension * np.outer(f, f), 1e-11)


@given(strains(), rotations, numbers(-50.0, 50.0), numbers(-50.0, 50.0))
def test_frozen_tensions_are_cauchy_stresses_along_both_families(
    C: np.ndarray, frame: np.ndarray, T_f: float, T_cf: float
) -> None:
    values, axes = np.linalg.eigh(C)
    F = axes @ np.diag(np.sqrt(values)) @ axes.T
    f, g = (F @ d / np.linalg.norm(F @ d) for d in frame[:2])
    sigma = 2.0 * F @ symmetric(np.asarray(tension_gradient(C, frame, T_f, T_cf))) @ F.T
    close(sigma, T_f * np.outer(f, f) + T_cf * np.outer(g, g), 1e-11)


@given(strains(), numbers(-50.0, 50.0))
def test_pressure_is_a_multiplier_of_the_volume(C: np.ndarray, p: float) -> None:
    by_C, by_p = pressure_gradient(C, p)
    close(symmetric(np.asarray(by_C)), -0.5 * p * np.linalg.det(C) * np.linalg.inv(C), 1e-11)
    close(by_p, -0.5 * (np.linalg.det(C) - 1.0))


@given(numbers(0.3, 2.0), numbers(0.3, 2.0), numbers(0.0, 0.25))
def test_weave_constraint_against_its_closed_form(l1: float, l2: float, a_over_D: float) -> None:
    close(weave_h(l1**2, l2**2, a_over_D), reference.constraint(l1, l2, a_over_D))


@given(numbers(0.0, 0.25))
def test_weave_constraint_holds_at_rest(a_over_D: float) -> None:
    assert float(weave_h(1.0, 1.0, a_over_D)) == 0.0


@given(numbers(0.3, 0.99), numbers(0.01, 0.25))
def test_a_fibre_that_shortens_draws_its_neighbours_together(l1: float, a_over_D: float) -> None:
    allowed = 1.0 + float(weave_h(l1**2, 1.0, a_over_D))  # h is linear in the cross-fibre stretch
    assert allowed < 1.0
    close(weave_h(l1**2, allowed**2, a_over_D), 0.0)


@given(numbers(0.3, 2.0), numbers(0.3, 2.0), numbers(-50.0, 50.0), numbers(0.0, 0.25))
def test_pseudo_active_tensions_by_hand(l1: float, l2: float, q: float, a_over_D: float) -> None:
    """T_f = 2 I4 d/dI4 (-q h / 2) = -q (pi - 2)/4 l1^(-1/2) a/D, and T_cf = q l2 / 2."""
    by_4, by_6, by_q = weave_gradient(l1**2, l2**2, q, a_over_D, 0.0)
    close(2.0 * l1**2 * by_4, -0.25 * q * (np.pi - 2.0) * l1**-0.5 * a_over_D)
    close(2.0 * l2**2 * by_6, 0.5 * q * l2)
    close(by_q, -0.5 * reference.constraint(l1, l2, a_over_D))
