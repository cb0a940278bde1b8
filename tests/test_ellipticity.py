"""Strong ellipticity: closed forms, a brute-force search over directions, frames, and what a failed solve says."""

from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import special_ortho_group
from support import sample

import jaxmyo as jm
from jaxmyo import ellipticity

MU, GAMMA = 3.0, 12.0  # kPa


def reinforced(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    """½ μ (I1 − 3 − ln I3) + ½ γ (I4 − 1)², the standard reinforcing model."""
    mu, gamma = constants
    I4 = frame[0] @ C @ frame[0]
    return 0.5 * mu * (jnp.trace(C) - 3.0 - jnp.log(jnp.linalg.det(C))) + 0.5 * gamma * (I4 - 1.0) ** 2


@cache
def rest() -> jm.State:
    return jm.contract(jm.thin_sample(law=reinforced, constants=(MU, GAMMA)), T0=0.0, a_over_D=None)


@pytest.mark.slow
def test_a_reinforced_material_is_lost_where_its_closed_form_says() -> None:
    """Along a compressed fibre Q has μ + 2γ (λ² − 1), for N = f: lost at λ² = 1 − μ/2γ (Merodio and Ogden 2002)."""
    lost = float(np.sqrt(1.0 - 0.5 * MU / GAMMA))
    stretches = np.array([0.8, lost - 1e-3, lost + 1e-3, 0.97, 1.0, 1.3])
    states = [jm.load(rest(), jm.Stretch("x", stretch)) for stretch in stretches]
    least = np.array([np.asarray(state.ellipticity) for state in states])
    expected = MU + np.minimum(0.0, 2.0 * GAMMA * (stretches**2 - 1.0))
    np.testing.assert_allclose(least, np.broadcast_to(expected[:, None, None], least.shape), rtol=1e-10)
    assert (least[:2] < 0.0).all()
    assert (least[2:] > 0.0).all()
    N = np.array([np.asarray(state.weakest_direction) for state in states])
    np.testing.assert_allclose(np.linalg.norm(N, axis=-1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(np.abs(N[:4, ..., 0]), 1.0, rtol=1e-8)


@pytest.mark.slow
def test_fields_of_a_batch() -> None:
    states = [jm.load(rest(), jm.Stretch("x", stretch)) for stretch in (0.8, 1.3)]
    batch = jax.jit(jax.vmap(lambda x: jm.load(rest(), jm.Stretch("x", x))))(jnp.array([0.8, 1.3]))
    for name in ("ellipticity", "weakest_direction"):
        found = np.asarray(getattr(batch, name))
        expected = np.stack([np.asarray(getattr(state, name)) for state in states])
        if name == "weakest_direction":  # up to its sign, and across a stretched fibre all directions are alike
            np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1.0, rtol=1e-8)
            found, expected = np.abs(found), np.abs(expected)
            found[1, ..., 1:] = expected[1, ..., 1:]
        np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8)
        np.testing.assert_array_equal(np.asarray(getattr(batch[0], name)), np.asarray(getattr(states[0], name)))


# ---------------------------------------------------------------------------------------- one point, any deformation


@cache
def point_values() -> Any:
    """(F, frame, T_f, T_cf, p, q) ↦ (least, N), and the moduli, of the Lin–Yin law in a state A and in a state C."""
    A = jm.contract(sample(), T0=10.0, a_over_D=0.2)
    C = jm.load(A, jm.Stretch("x", 1.1))

    def one(state: Any, F: Any, frame: Any, T: Any, multipliers: Any) -> Any:
        A = ellipticity.moduli(state.system, state.inputs, F, frame, T[0], T[1], multipliers, jnp.array(0))
        return *ellipticity.least(F, A), A

    return [jax.jit(jax.vmap(partial(one, state))) for state in (A, C)]


def deformations(n: int) -> Any:
    """Isochoric F, frames, tensions [kPa], and p and q [kPa]."""
    rng = np.random.default_rng(3)
    F = np.eye(3) + 0.35 * rng.uniform(-1.0, 1.0, size=(n, 3, 3))
    F /= np.cbrt(np.linalg.det(F))[:, None, None]
    frames = special_ortho_group.rvs(3, size=n, random_state=rng)
    return F, frames, rng.uniform(-3.0, 3.0, size=(n, 2)), rng.uniform(-20.0, 20.0, size=(n, 2))


def by_sampling(F: Any, A: Any, n: int) -> float:
    """The least of m·Q(N) m over random N, by NumPy's eigenvalues of P Q P on the plane normal to F⁻ᵀ N."""
    N = np.random.default_rng(5).normal(size=(n, 3))
    N /= np.linalg.norm(N, axis=1, keepdims=True)
    normal = N @ np.linalg.inv(F)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    P = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    Q = np.einsum("iJkL,nJ,nL->nik", A, N, N, optimize=True)
    far = 1e6 * normal[:, :, None] * normal[:, None, :]
    return float(np.linalg.eigvalsh(P @ Q @ P + far)[:, 0].min())


@pytest.mark.slow
@pytest.mark.parametrize("kind", [0, 1], ids=["A", "C"])
def test_no_direction_is_weaker(kind: int) -> None:
    F, frames, T, m = deformations(24)
    multipliers = m if kind == 0 else m[:, :1]
    least, N, A = (np.asarray(x) for x in point_values()[kind](F, frames, T, multipliers))
    assert (least < 0.0).any()
    assert (least > 0.0).any()
    for k in range(len(F)):
        sampled = by_sampling(F[k], A[k], 30_000)
        assert least[k] <= sampled + 1e-9 * np.abs(A[k]).max()
        assert least[k] >= sampled - 2e-3 * np.abs(A[k]).max()
        np.testing.assert_allclose(np.linalg.norm(N[k]), 1.0, rtol=1e-12)


@pytest.mark.slow
def test_turned_bodies_and_turned_frames() -> None:
    """F ↦ R F leaves least and N; F ↦ F Rᵀ with the frame turned as well leaves least, and turns N. p has no part."""
    F, frames, T, m = deformations(24)
    R = special_ortho_group.rvs(3, size=24, random_state=np.random.default_rng(9))
    of = point_values()[0]
    least, N, A = of(F, frames, T, m)
    at = 1e-9 * np.abs(np.asarray(A)).max()
    turned, N_turned, _ = of(R @ F, frames, T, m)
    np.testing.assert_allclose(turned, least, rtol=0, atol=at)
    np.testing.assert_allclose(np.abs(np.sum(N_turned * N, axis=1)), 1.0, rtol=1e-6)
    other, N_other, _ = of(F @ np.swapaxes(R, 1, 2), frames @ np.swapaxes(R, 1, 2), T, m)
    np.testing.assert_allclose(other, least, rtol=0, atol=at)
    np.testing.assert_allclose(np.abs(np.einsum("ni,nij,nj->n", N_other, R, N)), 1.0, rtol=1e-6)
    np.testing.assert_allclose(of(F, frames, T, m + np.array([7.0, 0.0]))[0], least, rtol=0, atol=at)


@pytest.mark.slow
def test_a_contracted_sample_is_elliptic_though_it_is_unstable() -> None:
    """Its bifurcations are of the body, not of the material; every point of a homogeneous state is as any other."""
    state = jm.contract(sample((4, 4, 2)), T0=35.0, a_over_D=0.2)
    assert int(state.negative_eigenvalues) == 2
    least = np.asarray(state.ellipticity)
    assert least.shape == (32, 8)
    assert least.min() > 1.0
    assert np.ptp(least) < 1e-9 * least.max()


# --------------------------------------------------------------------------------------------- what a failure says


@pytest.mark.slow
def test_a_failed_solve_says_that_the_material_is_lost_and_where() -> None:
    """Fibres under a compressive force soften until it has a maximum; the material is lost long before."""
    stiff = jm.thin_sample(law=reinforced, constants=(MU, 50.0 * MU))
    A = jm.contract(stiff, T0=0.0, a_over_D=None)
    with pytest.raises(jm.SolveError, match=r"^LIMIT_POINT at ") as caught:
        jm.load(A, jm.Traction("x1", (-200.0, 0.0, 0.0)))
    state = caught.value.state
    assert isinstance(state, jm.State)
    along = float(state.mean("stretches")[0])
    P = MU * (along - along**-2) + 100.0 * MU * (along**3 - along)
    np.testing.assert_allclose(P, -200.0 * float(state.reached), rtol=1e-6)
    slope = MU * (1.0 + 2.0 * along**-3) + 100.0 * MU * (3.0 * along**2 - 1.0)  # dP/dλ
    assert abs(slope) < 1.0
    assert float(state.ellipticity.min()) < 0.0
    assert "has lost ellipticity, most in element 0, Gauss point 0: " in str(caught.value)
    assert "kPa for a band normal to (1.000, 0.000, 0.000)" in str(caught.value).replace("-", "")
    assert "the largest stretch" in str(caught.value)
    quiet = jm.load(A, jm.Traction("x1", (-200.0, 0.0, 0.0)), throw=False)
    assert quiet.message == state.message == str(caught.value)


def test_an_overflow_is_no_limit_point() -> None:
    """exp Q ends the path of a prescribed stretch: the state before, and where it is."""
    A = jm.contract(sample(), T0=10.0, a_over_D=0.2)
    state = jm.load(A, jm.Stretch("x", 4.9), throw=False)
    assert int(state.status) == jm.Status.NO_DESCENT
    assert 4.2 < float(state.mean("stretches")[0]) < 4.9
    assert "element 0, Gauss point 0" in state.message
    for leaf in jax.tree.leaves(state):
        assert np.isfinite(np.asarray(leaf)).all()
