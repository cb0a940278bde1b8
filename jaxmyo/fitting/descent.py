"""Descent by optax's optimisers: for losses that are too large for a Jacobian, or that are drawn at random."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxmyo import checks
from jaxmyo.compiler import QUICK
from jaxmyo.fitting import least_squares
from jaxmyo.fitting.fit import Fit, described
from jaxmyo.fitting.least_squares import Found, Loss
from jaxmyo.fitting.problem import Problem


def descend(
    problem: Problem,
    optimiser: Any = None,
    *,
    steps: int = 500,
    batch: int | None = None,
    seed: int = 0,
    loss: Loss | str = "linear",
    level: float = 0.95,
) -> Fit:
    """The problem by gradients of the mean square: an optimiser of optax, default `optax.adam(0.05)`, so many steps.

    batch: observations drawn at random for each step (a stochastic loss), None for all; the derivatives come by
    reverse mode, one linear solve per state. The intervals are those at the end, which an optimiser of first order only
    comes near: finish with `fit` where that can be afforded.
    """
    (steps,) = checks.counts("steps", (steps,), 1)
    try:
        import optax
    except ModuleNotFoundError as error:
        raise checks.missing(error, "descend needs", "'jaxmyo[fit]'") from error
    if batch is not None and not 1 <= batch <= problem.n:
        raise ValueError(f"batch = {batch} is outside [1, {problem.n}] (observations with a weight)")
    optimiser = optax.adam(0.05) if optimiser is None else optimiser
    chosen = least_squares.check_loss(Loss(loss) if isinstance(loss, str) else loss)
    x = np.array([p.x(p.value) for p in problem.fitted])
    residual = least_squares.residual_of(problem, x, chosen)
    used = np.flatnonzero(np.asarray(problem.weight) > 0.0)

    def mean_square(x: Array, drawn: Array) -> Array:
        return jnp.mean(residual(x)[drawn] ** 2)

    def step(carry: tuple[Array, Any], key: Array) -> tuple[tuple[Array, Any], Array]:
        x, state = carry
        drawn = jnp.asarray(used) if batch is None else jax.random.choice(key, used, (batch,), replace=False)
        value, gradient = jax.value_and_grad(mean_square)(x, drawn)
        with jax.numpy_dtype_promotion("standard"):  # optax counts its steps in int32
            change, state = optimiser.update(gradient, state, x)
        return (optax.apply_updates(x, change), state), value

    keys = jax.random.split(jax.random.key(seed), steps)
    start = (jnp.asarray(x), optimiser.init(jnp.asarray(x)))
    if problem.staged:
        run = partial(jax.jit, compiler_options=QUICK)(lambda start: jax.lax.scan(step, start, keys)[0][0])
        end = np.asarray(run(start))
    else:
        for key in keys:
            start, _ = step(start, key)
        end = np.asarray(start[0])
    found = least_squares.solve(problem, end, chosen, max_steps=1)
    every = Found(*(np.asarray(field)[None] for field in found))
    return described(problem, found, every, chosen, level, seed, 0.0)
