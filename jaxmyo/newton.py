"""Newton's method with line search, at fixed inputs: one equilibrium from a start near by.

The equilibrium is a saddle point and need not be a minimum even on the constraint manifold, so no energy is descended.
The line search is Deuflhard's natural monotonicity test instead: with the factors at hand, the *simplified* Newton
correction at the trial point must be smaller than the correction was. It is free of units and of the definiteness of
the tangent, and it rejects trial points where exp Q overflows or an element inverts.

Where the tangent is singular (the Lin–Yin law has no shear stiffness in the zero-stress state), a stiffness
proportional to the residual is added to the matrix. It vanishes with the residual, so the limit is Newton's.
"""

from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax import Array

from jaxmyo import lagrangian, linear
from jaxmyo.lagrangian import Inputs, System
from jaxmyo.status import Status

T = TypeVar("T")


class Settings(NamedTuple):
    """Dials of a solve; the defaults are for float64.

    tolerance: relative residual of the final state, of forces to the largest stiffness and of constraints to 1;
    path_tolerance: the same for the states on the way; max_iterations: Newton iterations per load step;
    max_steps: load steps, rejected ones included; move: largest root-mean-square strain per load step that is aimed at;
    min_step: smallest load step, as a fraction of the load.
    """

    tolerance: float = 1e-13
    path_tolerance: float = 1e-7
    max_iterations: int = 20
    max_steps: int = 200
    move: float = 0.3
    min_step: float = 1e-8


class Iterate(NamedTuple):
    """Newton's iterate: the unknowns, and what is known there.

    z: unknowns; r, K: residual and tangent; factors: of K; delta: the Newton correction from z; size: its
    root-mean-square strain, an estimate of the error of z; alpha: the length of the next trial along delta;
    residual: relative; iteration: number of corrections made; status; history: (max_iterations + 1,) relative
    residuals, 0 beyond the last iteration.
    """

    z: Array
    r: Array
    K: Array
    factors: linear.Factors
    delta: Array
    size: Array
    alpha: Array
    residual: Array
    iteration: Array
    status: Array
    history: Array


def relative_residual(system: System, scale: linear.Scales, z: Array, r: Array, K: Array) -> Array:
    """The larger of (force imbalance as a stress / largest stiffness) and (constraint violation) [–]."""
    force = linear.stress_residual(system, scale, r) / linear.modulus(system, scale, K, z)
    return jnp.maximum(force, linear.constraint_residual(system, scale, r))


def strain_of(system: System, dz: Array) -> tuple[Array, Array]:
    """Root mean square and maximum over the body of |∂F| [–] for a change dz of the unknowns."""
    dF = jnp.einsum("egia,ea->egi", system.gradient, dz[system.local_u])
    square = jnp.sum(dF**2, axis=-1)
    return jnp.sqrt(jnp.sum(system.weight * square) / jnp.sum(system.weight)), jnp.sqrt(jnp.max(square))


def batched_as(x: Array, carry: T) -> T:
    """The same values, batched under `vmap` as the scalar x is.

    The carry of a loop that starts unbatched makes JAX batch the loop's body several times over, at every level of
    nested loops: most of the time of tracing.
    """
    return jax.tree.map(lambda leaf: jnp.where(x == x, leaf, leaf), carry)


def solve(
    system: System,
    scale: linear.Scales,
    z: Array,
    inputs: Inputs,
    tolerance: Array,
    stiffening: Array,
    near: Array,
    settings: Settings,
) -> Iterate:
    """The equilibrium near z. `status` is CONVERGED only if the relative residual is at most `tolerance`.

    stiffening: of the matrix, relative to its largest stiffness; 1e-13 keeps a singular tangent from dividing by zero,
    more bounds the correction (and the tangent of the path) where a mode has no stiffness.

    near: the start is known to be near, so that only full corrections are taken that shrink by half or more. Whatever
    needs damping there is on its way to another equilibrium.

    One loop: look at a trial point, then either take it and find the next correction, or halve the step. The first
    trial is z itself.
    """

    def done(s: Iterate) -> Array:
        return (s.residual <= tolerance) & (s.size <= 1e3 * tolerance)

    def keep_going(s: Iterate) -> Array:
        return ~done(s) & (s.status == Status.CONVERGED) & (s.iteration < settings.max_iterations)

    def look(s: Iterate) -> Iterate:
        begin = s.iteration < 0
        z = s.z + s.alpha * s.delta
        # The barrier keeps XLA from fusing, and so repeating, the element's arithmetic into each use of its result.
        r, K = jax.lax.optimization_barrier(lagrangian.residual_and_tangent(system, z, inputs))
        J = lagrangian.volume_ratios(system, system.displacements(z, inputs))
        admissible = jnp.all(jnp.isfinite(r)) & jnp.all(jnp.isfinite(K)) & jnp.all(J > 0.0)
        simplified, _ = strain_of(system, s.factors.solve(r))
        # A NaN compares as false; round-off may keep a correction of 1e-13 from shrinking.
        shrink = jnp.where(near, 0.5, 1.0 - 0.25 * s.alpha)
        taken = admissible & (begin | (simplified <= shrink * s.size + 1e-13))

        G = linear.modulus(system, scale, K, z)
        factors = linear.factorise(scale, K, 0.1 * linear.stress_residual(system, scale, r) + stiffening * G)
        delta = -factors.solve(r)
        size, largest = strain_of(system, delta)
        residual = relative_residual(system, scale, z, r, K)
        iteration = s.iteration + 1
        further = Iterate(
            z=z,
            r=r,
            K=K,
            factors=factors,
            delta=delta,
            size=size,
            alpha=jnp.minimum(1.0, 0.5 / largest),  # no trial strains an element by more than one half
            residual=residual,
            iteration=iteration,
            status=jnp.where(jnp.isfinite(size), Status.CONVERGED, Status.SINGULAR),
            history=s.history.at[iteration].set(residual),
        )
        lost = begin | near | (s.alpha < 1e-3)
        shorter = s._replace(alpha=0.5 * s.alpha, status=jnp.where(lost, Status.NO_DESCENT, Status.CONVERGED))
        return jax.tree.map(lambda new, old: jnp.where(taken, new, old), further, shorter)

    n = system.size
    nothing = jnp.zeros((n, n))
    start = Iterate(
        z=z,
        r=jnp.zeros(n),
        K=nothing,
        factors=linear.Factors(nothing, jnp.zeros(n, dtype="int32")),
        delta=jnp.zeros(n),
        size=jnp.array(jnp.inf),
        alpha=jnp.array(1.0),
        residual=jnp.array(jnp.inf),
        iteration=jnp.array(-1),
        status=jnp.array(Status.CONVERGED),
        history=jnp.zeros(settings.max_iterations + 1),
    )
    end = jax.lax.while_loop(keep_going, look, batched_as(tolerance, start))
    status = jnp.where((end.status == Status.CONVERGED) & ~done(end), Status.TOO_MANY_ITERATIONS, end.status)
    return end._replace(status=status)
