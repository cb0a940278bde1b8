"""Residual, tangent and rates of batches of small bodies, against those of one body after the other."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import test_coordinates
import test_element
from test_element import residual_of
from test_element_blocks import of, tied

import jaxmyo as jm
from jaxmyo import element_batches, lagrangian, solve
from jaxmyo.lanes import batch_last, everywhere
from jaxmyo.system import Inputs

CASES = {
    "springs": lambda: of(test_element.body(False, "spring")),
    "cylindrical, weave": lambda: of(test_coordinates.body(jm.CYLINDRICAL, True)),
    "ties, materials, 27 points": lambda: tied(True, 3),
}
each = pytest.mark.parametrize("case", ["springs", *(pytest.param(c, marks=pytest.mark.slow) for c in list(CASES)[1:])])


def varied(inputs: Inputs, rng: np.random.Generator, by: float, n: int | None = None) -> Inputs:
    """Inputs, each number of them changed by a part of its own; n: a batch of such."""

    def change(x: Any) -> Any:
        shape = np.shape(x) if n is None else (n, *np.shape(x))
        return jnp.asarray(np.asarray(x) * (1.0 + by * rng.standard_normal(shape)))

    return jax.tree.map(change, inputs)


@each
def test_batches_and_batches_of_batches_are_as_one_by_one(case: str) -> None:
    system, inputs, z = CASES[case]()
    system = jax.tree.map(jnp.asarray, system)
    rng = np.random.default_rng(3)
    zs = jnp.asarray(z * (1.0 + 0.01 * rng.standard_normal((3, 2, len(z)))))
    driven = varied(inputs, rng, 0.01, 2)
    one = jax.jit(element_batches.linearised)
    alone = [[one(system, zs[i, k], jax.tree.map(lambda x, k=k: x[k], driven)) for k in range(2)] for i in range(3)]
    wanted = jax.tree.map(lambda *x: np.stack(x).reshape(3, 2, *np.shape(x[0])), *(a for row in alone for a in row))
    both = jax.vmap(element_batches.linearised, in_axes=(None, 0, 0))
    found = jax.jit(jax.vmap(both, in_axes=(None, 0, None)))(system, zs, driven)
    for name, tolerance in (("r", 1e-12), ("K", 1e-12), ("least_J", 1e-14)):
        exact = getattr(wanted, name)
        np.testing.assert_allclose(getattr(found, name), exact, rtol=0, atol=tolerance * np.abs(exact).max())


@each
def test_rates_of_a_batch_are_the_derivative_of_the_residual(case: str) -> None:
    """Where the bodies of the batch differ in what is driven, in how it is driven, or in both."""
    system, inputs, z = CASES[case]()
    system = jax.tree.map(jnp.asarray, system)
    rng = np.random.default_rng(4)
    z, by_t = jnp.asarray(z), varied(inputs, rng, 1.0)
    several, several_by_t = varied(inputs, rng, 0.01, 2), varied(inputs, rng, 1.0, 2)

    def wanted(inputs: Inputs, by_t: Inputs) -> Any:
        return jax.jvp(lambda inputs: residual_of(system, z, inputs), (inputs,), (by_t,))[1]

    for at, change in ((several, by_t), (inputs, several_by_t), (several, several_by_t)):
        axes = [None if x is y else 0 for x, y in ((at, inputs), (change, by_t))]
        found = jax.jit(jax.vmap(lambda a, b: element_batches.rate(system, z, a, b), in_axes=axes))(at, change)
        exact = np.asarray(jax.vmap(wanted, in_axes=axes)(at, change))
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-12 * np.abs(exact).max())


@each
def test_rates_without_what_does_not_move(case: str) -> None:
    """A leaf 0.0 of the change is as zeros of its shape: half of them, then the others."""
    system, inputs, z = CASES[case]()
    system = jax.tree.map(jnp.asarray, system)
    change, structure = jax.tree.flatten(varied(inputs, np.random.default_rng(5), 1.0))
    for first in (0, 1):
        still = [i % 2 == first for i in range(len(change))]
        by_t, zeros = (
            structure.unflatten([none(x) if s else x for s, x in zip(still, change, strict=True)])
            for none in (lambda x: 0.0, jnp.zeros_like)
        )
        found, exact = (np.asarray(element_batches.rate(system, jnp.asarray(z), inputs, d)) for d in (by_t, zeros))
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-13 * max(1.0, np.abs(exact).max()))


def test_a_hole_that_closes_has_a_volume_ratio_of_minus_one() -> None:
    """At Gauss points whose radius is negative, in the one body of a batch that it is negative in."""
    system, inputs, _ = solve.contraction(jm.radial_tube(4), 1.0, None, 1.0, None, None)
    through = jnp.zeros(system.size).at[0].set(-5.0)  # the inner radius
    J_of = jax.jit(jax.vmap(lambda z: element_batches.linearised(system, z, inputs).least_J))
    J = J_of(jnp.stack([0.0 * through, through]))
    assert float(J[0]) == pytest.approx(1.0, abs=1e-14)
    assert float(J[1]) == -1.0
    assert not np.any(np.asarray(lagrangian.is_folded(system, system.displacements(0.0 * through, inputs))))


def test_lanes() -> None:
    """`everywhere` with axes along which an argument does not vary; `batch_last` in and outside of nested `vmap`s."""
    x, y = jnp.arange(6.0).reshape(1, 2, 1, 3), jnp.arange(20.0).reshape(5, 4, 1)
    assert everywhere(lambda x, y: x * y, 2, x[0], y[0]).shape == (2, 4, 3)
    scaled = batch_last(lambda x, factor: x * factor[None])
    factors = jnp.arange(1.0, 5.0)
    found = jax.vmap(jax.vmap(scaled, in_axes=(0, None)), in_axes=(None, 0))(jnp.ones((3, 2)), factors)
    np.testing.assert_array_equal(found, np.broadcast_to(np.asarray(factors)[:, None, None], (4, 3, 2)))
