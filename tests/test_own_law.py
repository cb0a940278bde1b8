"""A law of one's own, written here: a neo-Hookean and a Guccione law through the whole package, untouched."""

from functools import cache
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest
import reference
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import jaxmyo as jm

MU = 3.0
MESH = (2, 2, 1)
ELEMENTS = [pytest.param(None, id="0D"), pytest.param(MESH, id="mesh")]


def neo_hookean(C: Any, frame: Any, beta: Any, mu: Any) -> Any:
    """½ mu (I1 − 3), the same at rest and in activation."""
    return 0.5 * mu * (jnp.trace(C) - 3.0)


class Guccione(NamedTuple):
    """stiffness [kPa] and exponents of the law of Guccione, McCulloch & Waldman (1991)."""

    stiffness: float
    fibre: float
    cross: float
    shear: float


GUCCIONE = Guccione(stiffness=0.876, fibre=18.48, cross=3.58, shear=1.627)


def guccione(C: Any, frame: Any, beta: Any, c: Guccione) -> Any:
    """½ C (exp Q − 1) in the Green strain along fibre, cross-fibre and normal."""
    E = 0.5 * (frame @ C @ frame.T - jnp.eye(3))
    Q = c.fibre * E[0, 0] ** 2 + c.cross * (E[1, 1] ** 2 + E[2, 2] ** 2 + 2.0 * E[1, 2] ** 2)
    Q = Q + 2.0 * c.shear * (E[0, 1] ** 2 + E[0, 2] ** 2)
    return 0.5 * c.stiffness * jnp.expm1(Q)


def guccione_stress(F: np.ndarray, frame: np.ndarray, c: Guccione) -> np.ndarray:
    """Cauchy stress without the pressure, differentiated by hand: S = C exp(Q) b·E, sigma = F S F^T."""
    E = 0.5 * (frame @ F.T @ F @ frame.T - np.eye(3))
    b = np.array(
        [[c.fibre, c.shear, c.shear], [c.shear, c.cross, c.cross], [c.shear, c.cross, c.cross]]
    )  # Q = sum b_ij E_ij^2, dQ/dE_ij = 2 b_ij E_ij
    S = c.stiffness * np.exp(np.sum(b * E**2)) * b * E
    return F @ frame.T @ S @ frame @ F.T


@cache
def at_rest(law: Any, constants: Any, elements: Any) -> jm.State:
    scene = jm.thin_sample(law=law, constants=constants, elements=elements)
    return jm.contract(scene, T0=10.0, a_over_D=None, beta=0.0)


@pytest.fixture(params=ELEMENTS)
def rubber(request: pytest.FixtureRequest) -> jm.State:
    return at_rest(neo_hookean, MU, request.param)


@pytest.fixture(params=[ELEMENTS[0], pytest.param(MESH, id="mesh", marks=pytest.mark.slow)])
def muscle(request: pytest.FixtureRequest) -> jm.State:
    return at_rest(guccione, GUCCIONE, request.param)


def everywhere(values: Any, expected: Any, tolerance: float = 1e-10) -> None:
    values = np.asarray(values)
    np.testing.assert_allclose(values, np.broadcast_to(expected, values.shape), rtol=0, atol=tolerance)


# -------------------------------------------------------------------------------------------------- neo-Hookean


def test_neo_hookean_at_rest_is_a_pressure(rubber: jm.State) -> None:
    everywhere(rubber.u, 0.0)
    everywhere(rubber.p, MU)
    everywhere(rubber.cauchy, 0.0)
    assert int(rubber.zero_eigenvalues) == 0


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("stretch", [0.5, 0.8, 1.2, 3.0])
def test_neo_hookean_uniaxial(axis: Any, stretch: float) -> None:
    state = jm.load(at_rest(neo_hookean, MU, None), jm.Stretch(axis, stretch))
    k = "xy".index(axis)
    stretches = np.full(3, stretch**-0.5)
    stretches[k] = stretch
    sigma = np.zeros((3, 3))
    sigma[k, k] = MU * (stretch**2 - 1.0 / stretch)
    everywhere(state.stretches, stretches)
    everywhere(state.cauchy, sigma)
    area = 10.0
    assert abs(float(state.reaction(f"{axis}1")[k]) - sigma[k, k] / stretch * area) <= 1e-9


@pytest.mark.parametrize("stretch", [0.7, 1.2, 2.5])
def test_neo_hookean_equibiaxial(rubber: jm.State, stretch: float) -> None:
    state = jm.load(rubber, jm.Stretch("x", stretch), jm.Stretch("y", stretch))
    sigma = MU * (stretch**2 - stretch**-4)
    everywhere(state.cauchy, np.diag([sigma, sigma, 0.0]))
    everywhere(state.p, MU * stretch**-4)


@pytest.mark.parametrize("tension", [0.5, 5.0, 50.0])
def test_neo_hookean_contraction(rubber: jm.State, tension: float) -> None:
    """mu (l^2 - 1/l) + beta T0 = 0 without the weave."""
    state = jm.contract(rubber.scene, T0=2.0 * tension, a_over_D=None, beta=0.5)
    fibre = brentq(lambda x: MU * (x**2 - 1.0 / x) + tension, 1e-3, 1.0, xtol=1e-16)
    everywhere(state.stretches, [fibre, fibre**-0.5, fibre**-0.5])
    everywhere(state.cauchy, 0.0)
    everywhere(state.p, MU / fibre)


def test_neo_hookean_contraction_with_the_weave() -> None:
    """On l2 = 1 + k (1 - l1^(-1/2)) the work of all stresses vanishes: R = s1 - s3 + (d ln l2 / d ln l1)(s2 - s3)."""
    T0, a_over_D = 5.0, 0.2
    k = (np.pi - 2.0) * a_over_D

    def stretches(fibre: float) -> np.ndarray:
        cross = 1.0 + k * (1.0 - fibre**-0.5)
        return np.array([fibre, cross, 1.0 / (fibre * cross)])

    def work(fibre: float) -> float:
        s = MU * stretches(fibre) ** 2
        slope = 0.5 * k * fibre**-0.5 / stretches(fibre)[1]
        return float(s[0] - s[2] + T0 + slope * (s[1] - s[2]))

    exact = stretches(brentq(work, 0.4, 1.0, xtol=1e-16))
    state = jm.contract(at_rest(neo_hookean, MU, None).scene, T0=T0, a_over_D=a_over_D)
    everywhere(state.stretches, exact)
    everywhere(state.T_cf, MU * (exact[2] ** 2 - exact[1] ** 2), 1e-9)
    np.testing.assert_allclose(reference.constraint(exact[0], exact[1], a_over_D), 0.0, atol=1e-14)


# ----------------------------------------------------------------------------------------------------- Guccione


@pytest.mark.parametrize(("l1", "l2"), [(1.1, 1.1), (1.2, 0.95), (0.9, 1.15), (1.3, 1.2)])
def test_guccione_biaxial(muscle: jm.State, l1: float, l2: float) -> None:
    state = jm.load(muscle, jm.Stretch("x", l1), jm.Stretch("y", l2))
    sigma = guccione_stress(np.diag([l1, l2, 1.0 / (l1 * l2)]), np.eye(3), GUCCIONE)
    scale = np.abs(sigma).max()
    everywhere(state.cauchy, sigma - sigma[2, 2] * np.eye(3), 1e-10 * (1.0 + scale))
    everywhere(state.p, sigma[2, 2], 1e-10 * (1.0 + scale))


def test_guccione_contraction(muscle: jm.State) -> None:
    """Free fibres that pull with beta T0: the two transverse stretches are equal, one scalar root is left."""
    state = jm.contract(muscle.scene, T0=10.0, a_over_D=None, beta=0.5)

    def along(fibre: float) -> float:
        sigma = guccione_stress(np.diag([fibre, fibre**-0.5, fibre**-0.5]), np.eye(3), GUCCIONE)
        return float(sigma[0, 0] - sigma[2, 2]) + 5.0

    fibre = brentq(along, 0.3, 1.0, xtol=1e-16)
    everywhere(state.stretches, [fibre, fibre**-0.5, fibre**-0.5])
    assert int(state.zero_eigenvalues) == 0


def test_guccione_with_fibres_in_any_direction() -> None:
    """A homogeneous body whose fibres lie across its axes: shear stresses by hand, tension along the fibre included."""
    frame = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
    mesh = jm.box((10.0, 10.0, 1.0), (1, 1, 1))
    scene = jm.Scene(mesh, guccione, GUCCIONE, frame[0], frame[1], supports=(jm.Homogeneous(),), quadrature=1)
    a = jm.contract(scene, T0=10.0, a_over_D=None, beta=0.3)
    state = jm.load(a, jm.Stretch("x", 1.15), jm.Stretch("y", 0.9))
    F = np.diag([1.15, 0.9, 1.0 / (1.15 * 0.9)])
    f = F @ frame[0] / np.linalg.norm(F @ frame[0])
    sigma = guccione_stress(F, frame, GUCCIONE) + 3.0 * np.outer(f, f)
    sigma = sigma - sigma[2, 2] * np.eye(3)
    everywhere(state.cauchy, sigma)
    assert abs(sigma[0, 1]) > 0.1
    g = F @ frame[1] - f * (f @ F @ frame[1])
    axes = np.stack([f, g / np.linalg.norm(g), np.cross(f, g / np.linalg.norm(g))])
    everywhere(state.cauchy_fibre, axes @ sigma @ axes.T)
    inverse = np.linalg.inv(F)
    everywhere(state.second_piola_kirchhoff, inverse @ sigma @ inverse.T)
    everywhere(state.stretches, np.linalg.norm(F @ frame.T, axis=0))
