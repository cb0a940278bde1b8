"""The path from one state to the next, in activation, load and prescribed motion together.

All inputs move on a straight line from those of a known state (t = 0) to the wanted ones (t = 1). Each load step goes
along the tangent of the path (one linear solve with the tangent that Newton left), then corrects. A step aims at a
bounded strain, is cut back where Newton fails or the body jumps, and grows again where it is easy: this keeps the
solution on the branch that starts at rest, which need not be the only equilibrium nor, far along, a stable one.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxmyo import lagrangian, linear, newton
from jaxmyo.lagrangian import Inputs, System
from jaxmyo.newton import Settings
from jaxmyo.status import Status


class Solution(NamedTuple):
    """The end of a path: the last converged state and what was spent.

    z: unknowns; inputs: the inputs that z belongs to; reached: fraction t of the path; residual: relative residual;
    force_residual [mN], constraint_residual [–]; status: see `Status`; steps, rejected, iterations: counts;
    history: relative residuals of the last Newton loop, 0 beyond its end;
    negative, zero: eigenvalue counts, see `linear.inertia`.
    """

    z: Array
    inputs: Inputs
    reached: Array
    residual: Array
    force_residual: Array
    constraint_residual: Array
    status: Array
    steps: Array
    rejected: Array
    iterations: Array
    history: Array
    negative: Array
    zero: Array


class _Path(NamedTuple):
    t: Array  # of the last converged state; −1 before the start is verified
    z: Array
    r: Array
    K: Array
    rate: Array  # dz/dt along the path
    dt: Array
    limit: Array  # the step that the strain bound allows
    reason: Array  # why the last step was rejected
    residual: Array
    history: Array
    steps: Array
    rejected: Array
    iterations: Array


def between(start: Any, end: Any, t: Array) -> Any:
    """The inputs at the fraction t of the way; exactly the end at t = 1."""
    return jax.tree.map(lambda a, b: jnp.where(t >= 1.0, b, a + t * (b - a)), start, end)


def follow(system: System, z: Array, start: Inputs, end: Inputs, valid: Array, settings: Settings) -> Solution:
    """Follow the equilibrium from z at the inputs `start` to the inputs `end`.

    `valid` is false where an input is out of range: nothing is solved then. The start itself is corrected first (at
    rest, the pressure of a law whose stress is p I there is found so).
    """
    scale = linear.scales(system)
    # An invalid sample of a batch stays at its start, and its own NaN must not come back.
    start, end = jax.tree.map(lambda x: jnp.where(valid | jnp.isfinite(x), x, 0.0), (start, end))

    def tangent_of_path(z: Array, K: Array, t: Array) -> tuple[Array, Array]:
        """dz/dt, and the root-mean-square strain rate of the body, prescribed motion included."""
        _, by_t = jax.jvp(
            lambda t: lagrangian.residual(system, z, between(start, end, t)), (jnp.minimum(t, 1.0 - 1e-9),), (1.0,)
        )
        G = linear.modulus(system, scale, K, z)
        rate = -linear.factorise(scale, K, 1e-9 * G).solve(by_t)
        dF = lagrangian.deformation_gradients(system, rate, _rate(start, end)) - jnp.eye(3)[None, None]
        square = jnp.sum(system.weight[:, :, None, None] * dF**2) / jnp.sum(system.weight)
        return rate, jnp.sqrt(square)

    def keep_going(path: _Path) -> Array:
        return (path.t < 1.0) & (path.steps < settings.max_steps) & (path.dt >= settings.min_step) & valid

    def step(path: _Path) -> _Path:
        at_start = path.t < 0.0
        t = jnp.where(at_start, 0.0, jnp.minimum(path.t + jnp.minimum(path.dt, path.limit), 1.0))
        t = jnp.where(t > 1.0 - settings.min_step, 1.0, t)
        inputs = between(start, end, t)
        guess = path.z + jnp.where(at_start, 0.0, t - path.t) * path.rate
        tolerance = jnp.where(t >= 1.0, settings.tolerance, settings.path_tolerance)
        found = newton.solve(system, scale, guess, inputs, tolerance, settings)
        moved, _ = newton.strain_of(system, found.z - path.z)
        jumped = ~at_start & (moved > 3.0 * settings.move)
        good = (found.status == Status.CONVERGED) & ~jumped
        rate, speed = tangent_of_path(found.z, found.K, t)
        easy = jnp.where(found.iteration <= 4, 10.0, jnp.where(found.iteration <= 7, 2.0, 0.7))
        taken = jnp.where(at_start, 1.0, t - path.t)
        # The strain bound may ask for steps below min_step (a tangent that starts singular); only a failure ends there.
        longer = jnp.where(at_start, 1.0, jnp.maximum(easy * taken, settings.min_step))
        shorter = jnp.where(at_start, 0.0, 0.25 * taken)
        usable = good & jnp.all(jnp.isfinite(rate))
        return _Path(
            t=jnp.where(good, t, path.t),
            z=jnp.where(good, found.z, path.z),
            r=jnp.where(good, found.r, path.r),
            K=jnp.where(good, found.K, path.K),
            rate=jnp.where(good, jnp.where(usable, rate, 0.0), path.rate),
            dt=jnp.where(good, longer, shorter),
            limit=jnp.where(good, settings.move / jnp.maximum(jnp.where(usable, speed, 0.0), 1e-9), path.limit),
            reason=jnp.where(good, Status.TOO_MANY_STEPS, jnp.where(jumped, Status.STEP_TOO_LARGE, found.status)),
            residual=jnp.where(good, found.residual, path.residual),
            history=jnp.where(good, found.history, path.history),
            steps=path.steps + 1,
            rejected=path.rejected + jnp.where(good, 0, 1),
            iterations=path.iterations + found.iteration,
        )

    zero = jnp.array(0)
    first = _Path(
        t=jnp.array(-1.0),
        z=z,
        r=jnp.zeros_like(z),
        K=jnp.zeros((system.size, system.size)),
        rate=jnp.zeros_like(z),
        dt=jnp.array(1.0),
        limit=jnp.array(1.0),
        reason=jnp.array(Status.TOO_MANY_STEPS),
        residual=jnp.array(0.0),
        history=jnp.zeros(settings.max_iterations + 1),
        steps=zero,
        rejected=zero,
        iterations=zero,
    )
    last = jax.lax.while_loop(keep_going, step, first)
    reached = jnp.maximum(last.t, 0.0)
    negative, zeros = linear.inertia(system, scale, last.K, last.z)
    status = jnp.where(last.t >= 1.0, Status.CONVERGED, last.reason)
    return Solution(
        z=last.z,
        inputs=between(start, end, reached),
        reached=reached,
        residual=last.residual,
        force_residual=jnp.max(jnp.abs(last.r[: system.n_u]), initial=0.0),
        constraint_residual=linear.constraint_residual(system, scale, last.r),
        status=jnp.where(valid, status, Status.INVALID_INPUT),
        steps=last.steps,
        rejected=last.rejected,
        iterations=last.iterations,
        history=last.history,
        negative=negative,
        zero=zeros,
    )


def _rate(start: Inputs, end: Inputs) -> Inputs:
    """d(inputs)/dt."""
    return jax.tree.map(lambda a, b: b - a, start, end)
