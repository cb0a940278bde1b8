"""The count of negative eigenvalues of the second variation on the constraint manifold, in every result."""

from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import null_space
from support import sample

import jaxmyo as jm
from jaxmyo import element_batches

ELEMENTS = (4, 4, 2)
COUNTS = [
    (35.0, 0.2, 1.0, 2),
    pytest.param(35.0, 0.2, 0.1, 1, marks=pytest.mark.slow),
    pytest.param(35.0, 0.2, 0.01, 0, marks=pytest.mark.slow),
    (35.0, None, 1.0, 3),
    pytest.param(35.0, None, 0.1, 2, marks=pytest.mark.slow),
    pytest.param(35.0, None, 0.01, 1, marks=pytest.mark.slow),
    (0.6, 0.2, 1.0, 0),
    (5.0, 0.2, 1.0, 0),
]
residual_and_tangent = jax.jit(element_batches.residual_and_tangent)


@cache
def contracted(T0: float, a_over_D: float | None, beta: float) -> jm.State:
    return jm.contract(sample(ELEMENTS), T0=T0, a_over_D=a_over_D, beta=beta)


def saddle(state: jm.State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(saddle matrix, its block A of the displacements, the constraint Jacobian B) at a state."""
    system = state.system
    z = np.zeros(system.size)
    moves = np.asarray(system.tie_scale) != 0.0
    z[np.asarray(system.tie_index)[moves]] = np.asarray(state.u).ravel()[moves]
    multipliers = [np.asarray(state.p)] + ([] if state.q is None else [np.asarray(state.q)])
    z[system.n_u :] = np.concatenate(multipliers)
    r, K = (np.asarray(v) for v in residual_and_tangent(system, z, state.inputs))
    assert np.abs(r).max() <= 1e-8  # it is the state
    return K, K[: system.n_u, : system.n_u], K[system.n_u :, : system.n_u]


def reduced_eigenvalues(state: jm.State) -> np.ndarray:
    """Eigenvalues of A on the null space of B, formed explicitly."""
    _, A, B = saddle(state)
    Z = null_space(B)
    assert Z.shape[1] == B.shape[1] - B.shape[0]  # the constraints are independent
    return np.linalg.eigvalsh(Z.T @ A @ Z)


@pytest.mark.parametrize(("T0", "a_over_D", "beta", "expected"), COUNTS)
def test_count_of_negative_eigenvalues(T0: float, a_over_D: float | None, beta: float, expected: int) -> None:
    state = contracted(T0, a_over_D, beta)
    assert int(state.negative_eigenvalues) == expected
    assert int(state.zero_eigenvalues) == 0


@pytest.mark.parametrize("case", [(35.0, 0.2, 1.0, 2), (35.0, None, 1.0, 3), (5.0, 0.2, 1.0, 0)], ids=str)
def test_count_agrees_with_the_explicit_null_space(case: Any) -> None:
    state = contracted(*case[:3])
    eigenvalues = reduced_eigenvalues(state)
    assert np.abs(eigenvalues).min() > 1e-6 * np.abs(eigenvalues).max()  # no doubt about a sign
    assert int((eigenvalues < 0.0).sum()) == int(state.negative_eigenvalues) == case[3]


def test_an_unstable_state_is_still_an_equilibrium() -> None:
    state = contracted(35.0, 0.2, 1.0)
    assert int(state.negative_eigenvalues) == 2
    assert float(state.residual) <= 1e-13
    np.testing.assert_allclose(np.asarray(state.cauchy), 0.0, atol=1e-9)


def test_when_stability_was_lost() -> None:
    """To 0.01 of the load, and the message says so; at β = 0.1 the first mode has gone."""
    whole, part = contracted(35.0, 0.2, 1.0), contracted(35.0, 0.2, 0.1)
    beta = 0.1 * float(part.stable_until)
    assert 0.01 < beta < 0.1
    np.testing.assert_allclose(float(whole.stable_until), beta, atol=0.011)
    assert whole.message.endswith(f"; unstable: 2 modes, after {100.0 * float(whole.stable_until):.3g} % of the load)")
    assert part.message.endswith(f"; unstable: 1 mode, after {100.0 * float(part.stable_until):.3g} % of the load)")
    for stable in (contracted(5.0, 0.2, 1.0), contracted(35.0, 0.2, 0.01)):
        assert float(stable.stable_until) == 1.0
        assert "unstable" not in stable.message


def test_rest_without_shear_stiffness_reports_every_zero_eigenvalue() -> None:
    state = contracted(35.0, 0.2, 0.0)
    assert int(state.negative_eigenvalues) == 0
    K, _, _ = saddle(state)
    eigenvalues = np.linalg.eigvalsh(K)
    nullity = int((np.abs(eigenvalues) <= 1e-10 * np.abs(eigenvalues).max()).sum())
    assert nullity > 0
    assert int(state.zero_eigenvalues) == nullity


def test_rest_of_the_homogeneous_sample_has_one_free_mode_without_the_weave() -> None:
    """Two stretches at constant volume, one of them along the fibre, the only direction with a stiffness."""
    assert int(jm.contract(sample(), T0=35.0, a_over_D=None, beta=0.0).zero_eigenvalues) == 1
    assert int(jm.contract(sample(), T0=35.0, a_over_D=0.2, beta=0.0).zero_eigenvalues) == 0


def neo_hookean(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    """½ mu (I1 − 3 − s ln I3): the same incompressible body for every s; at rest its pressure is (1 − s) mu."""
    mu, s = constants
    return 0.5 * mu * (jnp.trace(C) - 3.0 - s * jnp.log(jnp.linalg.det(C)))


@pytest.mark.parametrize(("s", "negative"), [(1.0, 0), (0.0, 4)])
def test_rubber_at_rest(s: float, negative: int) -> None:
    """The count is of the discrete body: for s = 0 the pressure acts on deformations that vary inside an element."""
    scene = jm.thin_sample(law=neo_hookean, constants=(3.0, s), elements=(2, 2, 1))
    state = jm.contract(scene, T0=0.0, a_over_D=None, beta=0.0)
    np.testing.assert_allclose(np.asarray(state.p), (1.0 - s) * 3.0, atol=1e-12)
    assert int(state.negative_eigenvalues) == int((reduced_eigenvalues(state) < 0.0).sum())
    assert int(state.negative_eigenvalues) == negative
    assert int(state.zero_eigenvalues) == 0


@pytest.mark.slow
def test_stretching_makes_the_loaded_state_stable() -> None:
    state = jm.load(contracted(35.0, 0.2, 1.0), jm.Stretch("x", 1.2), jm.Stretch("y", 1.2))
    eigenvalues = reduced_eigenvalues(state)
    assert int(state.negative_eigenvalues) == int((eigenvalues < 0.0).sum())
