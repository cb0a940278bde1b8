"""Material tests on the sample: simple shear, control by stress, uniaxial and biaxial, against stresses by hand."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo import protocols, ties
from jaxmyo.data import AXES, MODES

CUBE = jm.box((1.0, 1.0, 1.0), (1, 1, 1))


@pytest.fixture(scope="module")
def tissue() -> tuple[jm.State, jm.State]:
    """A passive and a contracted sample, of the set that reproduces the measurement."""
    scene = jm.thin_sample(constants=jm.MEASURED)
    return tuple(jm.contract(scene, T0=5.0, a_over_D=0.2, beta=b) for b in (0.0, 1.0))  # type: ignore[return-value]


def by_hand(A: jm.State, F: Any, free: int) -> np.ndarray:
    """Cauchy stress (3, 3) [kPa] at F, with the tensions of A, the pressure so that σ = 0 in a free direction."""
    beta, T_f, T_cf = float(A.inputs.beta), float(A.T_f[0, 0]), float(A.T_cf[0, 0])

    def energy(C: Any) -> Any:
        W = jm.lin_yin(C, jnp.eye(3), jnp.array(beta), jm.MEASURED)
        return W + 0.5 * (beta * 5.0 + T_f) * jnp.log(C[0, 0]) + 0.5 * T_cf * jnp.log(C[1, 1])

    C = F.T @ F
    sigma = F @ np.asarray(2.0 * jax.grad(energy)(C)) @ F.T
    sigma = 0.5 * (sigma + sigma.T)
    return sigma - sigma[free, free] * np.eye(3)


@pytest.mark.parametrize("mode", MODES)
def test_simple_shear(mode: str, tissue: tuple[jm.State, jm.State]) -> None:
    i, j = (AXES.index(a) for a in mode.split("-"))
    (k,) = {0, 1, 2} - {i, j}
    for A in tissue:
        C = jm.load(A, *protocols.simple_shear(mode, 0.4))
        F = np.eye(3)
        F[j, i] = 0.4
        np.testing.assert_allclose(C.F[0, 0], F, rtol=0, atol=1e-10)
        exact = by_hand(A, F, k)
        np.testing.assert_allclose(C.mean("cauchy"), exact, rtol=0, atol=1e-9)
        place = 3 + MODES.index(mode)
        for measure in ("cauchy", "nominal"):  # the area and its normal do not change
            np.testing.assert_allclose(protocols.measured(C, measure)[place], exact[j, i], rtol=0, atol=1e-9)
        S = np.linalg.solve(F, exact) @ np.linalg.inv(F).T
        np.testing.assert_allclose(protocols.measured(C, "pk2")[place], S[j, i], rtol=0, atol=1e-9)


def test_shear_of_stretched_tissue(tissue: tuple[jm.State, jm.State]) -> None:
    C = jm.load(tissue[1], *protocols.simple_shear("f-cf", 0.2, (1.1, 0.95)))
    F = np.diag([1.1, 0.95, 1.0 / (1.1 * 0.95)])
    F[1, 0] = 0.2
    np.testing.assert_allclose(C.F[0, 0], F, rtol=0, atol=1e-10)
    np.testing.assert_allclose(C.mean("cauchy"), by_hand(tissue[1], F, 2), rtol=0, atol=1e-9)


@pytest.mark.parametrize("measure", ["nominal", "cauchy"])
def test_control_by_stress_is_the_inverse_of_control_by_stretch(
    measure: Any, tissue: tuple[jm.State, jm.State]
) -> None:
    for A in tissue:
        C = jm.load(A, *protocols.biaxial_stress(5.0, 3.0, measure))
        np.testing.assert_allclose(protocols.measured(C, measure)[:3], [5.0, 3.0, 0.0], rtol=0, atol=1e-9)
        f, cf, _ = C.mean("stretches")
        D = jm.load(A, *protocols.biaxial(f, cf))
        np.testing.assert_allclose(protocols.measured(D, measure)[:3], [5.0, 3.0, 0.0], rtol=0, atol=1e-8)


def test_uniaxial_and_equibiaxial(tissue: tuple[jm.State, jm.State]) -> None:
    C = jm.load(tissue[1], *protocols.uniaxial("cf", 1.2))
    stretches = np.asarray(C.mean("stretches"))
    assert stretches[1] == pytest.approx(1.2, abs=1e-12)
    np.testing.assert_allclose(C.mean("cauchy"), by_hand(tissue[1], np.diag(stretches), 2), rtol=0, atol=1e-9)
    np.testing.assert_allclose(protocols.measured(C, "cauchy")[jnp.array([0, 2])], 0.0, atol=1e-9)
    D = jm.load(tissue[1], *protocols.equibiaxial(1.2))
    exact = by_hand(tissue[1], np.diag([1.2, 1.2, 1.2**-2]), 2)
    np.testing.assert_allclose(D.mean("cauchy"), exact, rtol=0, atol=1e-9)
    nominal = protocols.measured(D, "nominal")
    np.testing.assert_allclose(nominal[:2], np.diagonal(exact)[:2] / 1.2, rtol=1e-9)


@pytest.mark.slow
def test_a_batch_and_a_derivative_of_shear() -> None:
    scene = jm.thin_sample(constants=jm.MEASURED)

    def stress(amount: Any) -> Any:
        A = jm.contract(scene, T0=5.0, a_over_D=None, throw=False)
        return protocols.measured(jm.load(A, *protocols.simple_shear("f-cf", amount), throw=False), "cauchy")[3]

    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(stress)))(jnp.array([0.2, 0.3 - 1e-4, 0.3, 0.3 + 1e-4]))
    np.testing.assert_allclose(slopes[2], (values[3] - values[1]) / 2e-4, rtol=1e-6)


def test_shear_on_other_bodies() -> None:
    """It is added to what is held: an affine motion of the boundary gives the affine motion of the body."""
    mesh = jm.box((2.0, 1.0, 1.0), (2, 1, 1))
    built = ties.build(mesh, (*(jm.Symmetry(a) for a in "xyz"), jm.Shear("x", "z", 0.3)))
    np.testing.assert_allclose(built.offset.reshape(-1, 3)[:, 0], 0.3 * mesh.points[:, 2], atol=1e-15)
    assert not built.free.reshape(-1, 3)[mesh.points[:, 0] == 0.0, 0].any()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: protocols.simple_shear("f-f", 0.1), "mode = 'f-f' is unknown; valid: 'f-cf'"),
        (lambda: protocols.uniaxial("x", 1.1), "direction = 'x' is unknown; valid: 'f', 'cf', 'n'"),
        (lambda: ties.build(CUBE, (jm.Shear("x", "x", 0.1),)), "axis and to must differ"),
        (
            lambda: ties.build(jm.box((1.0, 1.0, 1.0), (1, 1, 1)), (jm.Shear("x", "y", np.array([0.1])),)),
            "must be a scalar",
        ),
        (lambda: ties.build(jm.radial_tube(1).mesh, (jm.Shear("r", "z", 0.1),)), "needs Cartesian coordinates"),
        (lambda: jm.specimen((8, 8, 1), grips="rakes", tines=5), "tines = 5 need 10 elements along each side"),
        (lambda: jm.specimen(grips="hooks"), "grips = 'hooks' is unknown"),  # type: ignore[arg-type]
    ],
)
def test_what_is_refused(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
