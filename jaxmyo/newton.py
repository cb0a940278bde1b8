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
    """Newton's iterate: unknowns, residual, tangent, the strain of the last correction, and how it went.

    history: (max_iterations + 1,) relative residuals, 0 beyond the last iteration.
    """

    z: Array
    r: Array
    K: Array
    correction: Array
    residual: Array
    iteration: Array
    status: Array
    history: Array


class _Trial(NamedTuple):
    """A point of the line search; rejected trials may hold anything, and are not used."""

    alpha: Array
    z: Array
    r: Array
    K: Array
    accepted: Array


def relative_residual(system: System, scale: linear.Scales, z: Array, r: Array, K: Array) -> Array:
    """The larger of (force imbalance as a stress / largest stiffness) and (constraint violation) [–]."""
    force = linear.stress_residual(system, scale, r) / linear.modulus(system, scale, K, z)
    return jnp.maximum(force, linear.constraint_residual(system, scale, r))


def strain_of(system: System, dz: Array) -> tuple[Array, Array]:
    """Root mean square and maximum over the body of |∂F| [–] for a change dz of the unknowns."""
    own = system.local[:, : system.local.shape[1] - system.multipliers]
    dF = jnp.einsum("egia,ea->egi", system.gradient, dz[own])
    square = jnp.sum(dF**2, axis=-1)
    return jnp.sqrt(jnp.sum(system.weight * square) / jnp.sum(system.weight)), jnp.sqrt(jnp.max(square))


def batched_as(x: Array, carry: T) -> T:
    """The same values, batched under `vmap` as the scalar x is.

    The carry of a loop that starts unbatched makes JAX batch the loop's body several times over, at every level of
    nested loops: most of the time of tracing.
    """
    return jax.tree.map(lambda leaf: jnp.where(x == x, leaf, leaf), carry)


def solve(
    system: System, scale: linear.Scales, z: Array, inputs: Inputs, tolerance: Array, settings: Settings
) -> Iterate:
    """The equilibrium near z. `status` is CONVERGED only if the relative residual is at most `tolerance`."""

    def evaluate(z: Array) -> tuple[Array, Array]:
        return lagrangian.residual_and_tangent(system, z, inputs)

    def admissible(z: Array, r: Array, K: Array) -> Array:
        """Whether the energy is finite and no Gauss point is turned inside out."""
        J = jnp.linalg.det(lagrangian.deformation_gradients(system, z, inputs))
        return jnp.all(jnp.isfinite(r)) & jnp.all(jnp.isfinite(K)) & jnp.all(J > 0.0)

    def done(s: Iterate) -> Array:
        # The quadratic rate makes the error of the iterate about the square of its last correction.
        return (s.residual <= tolerance) & (s.correction <= jnp.sqrt(tolerance))

    def keep_going(s: Iterate) -> Array:
        return ~done(s) & (s.status == Status.CONVERGED) & (s.iteration < settings.max_iterations)

    def iterate(s: Iterate) -> Iterate:
        floor = 1e-13 * linear.modulus(system, scale, s.K, s.z)
        factors = linear.factorise(scale, s.K, 0.1 * linear.stress_residual(system, scale, s.r) + floor)
        delta = -factors.solve(s.r)
        size, largest = strain_of(system, delta)

        def search(trial: _Trial) -> _Trial:
            alpha = 0.5 * trial.alpha
            z = s.z + alpha * delta
            r, K = evaluate(z)
            simplified, _ = strain_of(system, factors.solve(r))
            # A NaN compares as false; round-off may keep a correction of 1e-13 from shrinking.
            smaller = simplified <= (1.0 - 0.25 * alpha) * size + 1e-13
            return _Trial(alpha, z, r, K, smaller & admissible(z, r, K))

        # No trial strains an element by more than one half. (The loop halves before it looks.)
        first = jnp.minimum(1.0, 0.5 / largest)
        trial = jax.lax.while_loop(
            lambda trial: ~trial.accepted & (trial.alpha > 1e-3) & jnp.isfinite(size),
            search,
            _Trial(2.0 * first, s.z, s.r, s.K, first < 0.0),
        )
        failed = jnp.where(jnp.isfinite(size), Status.NO_DESCENT, Status.SINGULAR)
        residual = relative_residual(system, scale, trial.z, trial.r, trial.K)
        return Iterate(
            z=trial.z,
            r=trial.r,
            K=trial.K,
            correction=trial.alpha * size,
            residual=residual,
            iteration=s.iteration + 1,
            status=jnp.where(trial.accepted, Status.CONVERGED, failed),
            history=s.history.at[s.iteration + 1].set(residual),
        )

    r, K = evaluate(z)
    residual = relative_residual(system, scale, z, r, K)
    start = Iterate(
        z=z,
        r=r,
        K=K,
        correction=jnp.array(jnp.inf),
        residual=residual,
        iteration=jnp.array(0),
        status=jnp.where(admissible(z, r, K), Status.CONVERGED, Status.NO_DESCENT),
        history=jnp.zeros(settings.max_iterations + 1).at[0].set(residual),
    )
    end = jax.lax.while_loop(keep_going, iterate, batched_as(residual, start))
    status = jnp.where((end.status == Status.CONVERGED) & ~done(end), Status.TOO_MANY_ITERATIONS, end.status)
    return end._replace(status=status)
