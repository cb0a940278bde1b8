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

    z: unknowns; inputs: the inputs that z belongs to; reached: fraction of the load; residual: relative residual;
    force_residual [mN], constraint_residual [–]; status: see `Status`; steps, rejected, iterations: counts;
    history: relative residuals of the last Newton loop, 0 beyond its end;
    negative, zero: eigenvalue counts, see `linear.inertia`; −1 where nothing was solved.
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
    speed: Array  # root-mean-square strain of the body per t, along the tangent
    sign: Array  # of the determinant of the tangent
    dt: Array
    reason: Array  # why the last step was rejected
    residual: Array
    history: Array
    steps: Array
    rejected: Array
    iterations: Array


def between(start: Any, end: Any, fraction: Array) -> Any:
    """The inputs at a fraction of the way; exactly the end at 1."""
    return jax.tree.map(lambda a, b: jnp.where(fraction >= 1.0, b, a + fraction * (b - a)), start, end)


def follow(
    system: System, z: Array, start: Inputs, end: Inputs, valid: Array, from_rest: Array, settings: Settings
) -> Solution:
    """Follow the equilibrium from z at the inputs `start` to the inputs `end`.

    `valid` is false where an input is out of range: nothing is solved then. The start itself is corrected first (at
    rest, the pressure of a law whose stress is p I there is found so). from_rest: soft tissue moves like a root of the
    load near rest, so the load then grows like t³.
    """
    scale = linear.scales(system)
    # An invalid sample of a batch stays at its start, and its own NaN must not come back.
    start, end = jax.tree.map(lambda x: jnp.where(valid | jnp.isfinite(x), x, 0.0), (start, end))

    def inputs_at(t: Array) -> Inputs:
        return between(start, end, fraction(t))

    def fraction(t: Array) -> Array:
        return jnp.where((t >= 1.0) | ~from_rest, t, 0.01 * t + 0.99 * t**3)

    def tangent_of_path(found: newton.Iterate, t: Array) -> tuple[Array, Array]:
        """dz/dt, and the root-mean-square strain rate of the body, prescribed motion included."""
        _, by_t = jax.jvp(
            lambda t: lagrangian.residual(system, found.z, inputs_at(t)), (jnp.minimum(t, 1.0 - 1e-9),), (1.0,)
        )
        rate = -found.factors.solve(by_t)
        _, dF = jax.jvp(
            lambda z, t: lagrangian.deformation_gradients(system, system.displacements(z, inputs_at(t))),
            (found.z, jnp.minimum(t, 1.0 - 1e-9)),
            (rate, 1.0),
        )
        square = jnp.sum(system.weight[:, :, None, None] * dF**2) / jnp.sum(system.weight)
        return rate, jnp.sqrt(square)

    def keep_going(path: _Path) -> Array:
        return (path.t < 1.0) & (path.steps < settings.max_steps) & (path.dt >= settings.min_step) & valid

    def step(path: _Path) -> _Path:
        at_start, first_step = path.t < 0.0, path.t <= 0.0
        t = jnp.where(at_start, 0.0, path.t + path.dt)
        t = jnp.where(t + 0.2 * path.dt >= 1.0, 1.0, t)  # rather a longer last step than one more
        taken = jnp.where(at_start, 0.0, t - path.t)
        guess = path.z + taken * path.rate
        tolerance = jnp.where(t >= 1.0, settings.tolerance, settings.path_tolerance)
        stiffening = jnp.where(at_start, 1e-4, 1e-13)
        found = newton.solve(system, scale, guess, inputs_at(t), tolerance, stiffening, ~first_step, settings)
        # Stay on the branch: the correction must be small, beside the step along the tangent or beside the strain a
        # step may make.
        aimed = path.speed * taken
        off, _ = newton.strain_of(system, found.z - guess)
        near = off <= jnp.maximum(0.5 * aimed, 0.05 * settings.move)
        # A tangent that changed sign has passed a bifurcation, or left the branch beside one: come closer to see which.
        passed = (found.factors.sign != path.sign) & (aimed > 0.05 * settings.move)
        good = (found.status == Status.CONVERGED) & ((near & ~passed) | at_start)
        rate, speed = tangent_of_path(found, t)
        known = jnp.all(jnp.isfinite(rate))
        rate, speed = jnp.where(known, rate, 0.0), jnp.where(known, speed, 0.0)
        # Aim at half of the correction that is accepted.
        growth = jnp.clip(0.5 * jnp.maximum(0.5 * aimed, 0.05 * settings.move) / jnp.maximum(off, 1e-12), 0.1, 10.0)
        growth = jnp.where(found.iteration > 8, jnp.minimum(growth, 1.0), growth)
        next_dt = jnp.minimum(jnp.where(at_start, 1.0, growth * taken), settings.move / jnp.maximum(speed, 1e-9))
        retry = jnp.where(at_start, 0.0, 0.25 * taken)
        return _Path(
            t=jnp.where(good, t, path.t),
            z=jnp.where(good, found.z, path.z),
            r=jnp.where(good, found.r, path.r),
            K=jnp.where(good, found.K, path.K),
            rate=jnp.where(good, rate, path.rate),
            speed=jnp.where(good, speed, path.speed),
            sign=jnp.where(good, found.factors.sign, path.sign),
            # Only a failure ends the path: a tangent that starts almost singular may well ask for a tiny step.
            dt=jnp.where(good, jnp.maximum(next_dt, settings.min_step), retry),
            reason=jnp.where(
                good,
                Status.TOO_MANY_STEPS,
                jnp.where(found.status == Status.CONVERGED, Status.BRANCH_LEFT, found.status),
            ),
            residual=jnp.where(good, found.residual, path.residual),
            history=jnp.where(good, found.history, path.history),
            steps=path.steps + 1,
            rejected=path.rejected + jnp.where(good, 0, 1),
            iterations=path.iterations + jnp.maximum(found.iteration, 0),  # −1: the guess itself was refused
        )

    zero = jnp.array(0)
    first = _Path(
        t=jnp.array(-1.0),
        z=z,
        r=jnp.zeros_like(z),
        K=jnp.zeros((system.size, system.size)),
        rate=jnp.zeros_like(z),
        speed=jnp.array(0.0),
        sign=jnp.array(0.0),
        dt=jnp.array(1.0),
        reason=jnp.array(Status.TOO_MANY_STEPS),
        residual=jnp.array(0.0),
        history=jnp.zeros(settings.max_iterations + 1),
        steps=zero,
        rejected=zero,
        iterations=zero,
    )
    last = jax.lax.while_loop(keep_going, step, newton.batched_as(valid, first))
    reached = fraction(jnp.maximum(last.t, 0.0))
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
        negative=jnp.where(valid, negative, -1),
        zero=jnp.where(valid, zeros, -1),
    )
