"""Paths in float32: what they are good for, that "mixed" is as exact as float64, and what cannot be had."""

from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import sample

import jaxmyo as jm

FLOAT32, MIXED = jm.Settings(precision="float32"), jm.Settings(precision="mixed")


@cache
def contracted(precision: str, T0: float = 35.0) -> jm.State:
    return jm.contract(jm.thin_sample(), T0=T0, a_over_D=0.2, settings=jm.Settings(precision=precision))


def test_float32_has_six_digits_and_tells_its_residual() -> None:
    single, double = contracted("float32"), contracted("float64")
    np.testing.assert_allclose(single.mean("stretches"), double.mean("stretches"), rtol=2e-6)
    assert single.u.dtype == single.residual.dtype == jnp.float64
    assert 1e-10 < float(single.residual) < 1e-5  # computed in float64, not what float32 took it for
    assert single.status.dtype == double.status.dtype
    assert int(single.negative_eigenvalues) == int(double.negative_eigenvalues)


def test_mixed_is_as_exact_as_float64() -> None:
    mixed, double = contracted("mixed"), contracted("float64")
    assert float(mixed.residual) <= 1e-13
    np.testing.assert_allclose(mixed.u, double.u, rtol=1e-12)
    np.testing.assert_allclose(np.asarray(mixed.q), np.asarray(double.q), rtol=1e-11)


@pytest.mark.slow
def test_the_derivative_of_a_mixed_state_is_that_of_float64() -> None:
    def stretch(T0: Any, settings: jm.Settings) -> Any:
        return jm.contract(jm.thin_sample(), T0=T0, a_over_D=0.2, settings=settings).mean("stretches")[0]

    found, expected = (jax.grad(stretch)(20.0, settings) for settings in (MIXED, jm.Settings()))
    np.testing.assert_allclose(found, expected, rtol=1e-10)


@pytest.mark.slow
def test_a_batch_has_the_status_of_each() -> None:
    scene = jm.thin_sample()

    def one(T0: Any) -> jm.State:
        return jm.contract(scene, T0=T0, a_over_D=0.2, settings=MIXED)

    states = jax.jit(jax.vmap(one))(jnp.array([1.0, 35.0, -1.0, jnp.nan]))
    assert [jm.Status(int(s)).name for s in states.status] == [
        "CONVERGED",
        "CONVERGED",
        "INVALID_INPUT",
        "INVALID_INPUT",
    ]
    assert bool(jnp.all(jnp.isfinite(states.u)))


@pytest.mark.slow
def test_mixed_goes_on_in_float64_where_float32_ends() -> None:
    """exp Q overflows float32 at this stretch, not float64."""
    stretches = jm.Stretch("x", 2.75), jm.Stretch("y", 1.0)
    rest = jm.contract(jm.thin_sample(), T0=1.0, a_over_D=None)
    assert not bool(jm.load(rest, *stretches, settings=FLOAT32, throw=False).converged)
    mixed, double = (jm.load(rest, *stretches, settings=s) for s in (MIXED, jm.Settings()))
    assert float(mixed.residual) <= 1e-13
    np.testing.assert_allclose(mixed.mean("cauchy")[:2, :2], double.mean("cauchy")[:2, :2], rtol=1e-10)
    assert float(mixed.reached) == 1.0


def test_errors() -> None:
    with pytest.raises(ValueError, match=r"settings\.precision = 'half' is unknown.*'float64', 'mixed', 'float32'"):
        jm.contract(jm.thin_sample(), T0=1.0, a_over_D=0.2, settings=jm.Settings(precision="half"))
    with pytest.raises(ValueError, match="is for bodies that are solved by dense factors"):
        jm.contract(sample((8, 8, 8)), T0=1.0, a_over_D=0.2, settings=MIXED)
    with pytest.raises(ValueError, match="time_limit"):
        jm.contract(jm.thin_sample(), T0=1.0, a_over_D=0.2, settings=MIXED._replace(time_limit=1.0))
