"""Newton's method with line search, at fixed inputs: one equilibrium from a start near by.

The equilibrium is a saddle point and need not be a minimum even on the constraint manifold, so no energy is descended.
The line search is Deuflhard's natural monotonicity test instead: with the factors at hand, the *simplified* Newton
correction at the trial point must be smaller than the correction was. It is free of units and of the definiteness of
the tangent, and it rejects trial points where exp Q overflows or an element inverts.

Where the tangent is singular (the Lin–Yin law has no shear stiffness in the zero-stress state), a stiffness
proportional to the residual is added to the matrix. It vanishes with the residual, so the limit is Newton's.
"""

from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax import Array

from jaxmyo import control, progress, tracing
from jaxmyo.linear import At, negligible
from jaxmyo.status import Status
from jaxmyo.system import Inputs

#: The linear algebra of a system: `Dense` inside JAX, `Sparse` outside.
Linear = Any

#: What `Settings.precision` may be.
PRECISIONS = ["float64", "mixed", "float32"]

T = TypeVar("T")


class Settings(NamedTuple):
    """Dials of a solve; the defaults are for float64.

    tolerance: relative residual of the final state, of forces to the largest stiffness and of constraints to 1, or
    what round-off leaves where that is more (displacements of many element sizes);
    path_tolerance: the same for the states on the way; max_iterations: Newton iterations per load step;
    max_steps: load steps, rejected ones included; move: largest root-mean-square strain per load step that is aimed at;
    min_step: smallest load step, as a fraction of the load;
    time_limit: seconds after which a solve ends with the state that it has, None for no limit; progress: show a bar
    (tqdm). Both, and the lines that the logger "jaxmyo" writes at level INFO, are for solves outside `jit` and `vmap`;
    precision: of a small body, "float32" for the whole path (its tolerances are then at least 1e-5), "mixed" for the
    path in float32 and the last correction in float64, see `jaxmyo.single_precision` (inside `jit` and `vmap`, curved
    coordinates take XLA minutes to compile, unless XLA_FLAGS has --xla_cpu_use_fusion_emitters=false).
    """

    tolerance: float = 1e-13
    path_tolerance: float = 1e-7
    max_iterations: int = 20
    max_steps: int = 200
    move: float = 0.3
    min_step: float = 1e-8
    time_limit: float | None = None
    progress: bool = False
    precision: str = "float64"


#: Those settings that may be traced: they do not shape the program of a solve.
NUMBERS = ("tolerance", "path_tolerance", "max_steps", "move", "min_step")


class Iterate(NamedTuple):
    """Newton's iterate: the unknowns, and what is known there.

    z: unknowns; at: the linearised system there; factors: of its tangent; delta: the Newton correction from z; size:
    its root-mean-square strain, an estimate of the error of z; blur: the strain that round-off and an inexact solve
    may leave in it; alpha: the length of the next trial along delta; iteration: number of corrections made; status;
    history: (max_iterations + 1,) relative residuals, 0 beyond the last iteration.
    """

    z: Array
    at: At
    factors: Any
    delta: Array
    size: Array
    blur: Array
    alpha: Array
    iteration: Array
    status: Array
    history: Array


class Target(NamedTuple):
    """How near Newton's method is to come, and from where.

    tolerance: relative residual; stiffening: of the matrix, relative to its largest stiffness; 1e-13 keeps a singular
    tangent from dividing by zero, more bounds the correction (and the tangent of the path) where a mode has no
    stiffness; near: the start is known to be near, so that only full corrections are taken that shrink by half or more.
    Whatever needs damping there is on its way to another equilibrium.
    """

    tolerance: Array
    stiffening: Array
    near: Array


def batched_as(x: Array, carry: T) -> T:
    """The same values, batched under `vmap` as the scalar x is.

    The carry of a loop that starts unbatched makes JAX batch the loop's body several times over, at every level of
    nested loops: most of the time of tracing.
    """
    if not tracing.is_traced(x):
        return carry
    return jax.tree.map(lambda leaf: jnp.where(x == x, leaf, leaf), carry)


def solve(lin: Linear, z: Array, inputs: Inputs, target: Target, settings: Settings) -> Iterate:
    """The equilibrium near z, at fixed inputs; CONVERGED only if the relative residual is at most the tolerance."""

    def further(s: Iterate) -> Iterate:
        return look(lin, s, inputs, target, settings)

    start = batched_as(target.tolerance, begin(lin, z, lin.nothing(), settings))
    return ended(lin, control.loop(lambda s: goes_on(s, target, settings), further, start), target)


def begin(lin: Linear, z: Array, nothing: tuple[Any, Any], settings: Settings) -> Iterate:
    """Before the first look. nothing: any tangent and factors, to begin a loop with."""
    xp = lin.xp
    K, factors = nothing
    one, infinite = xp.array(1.0), xp.array(xp.inf)
    return Iterate(
        z=z,
        at=At.unknown(xp, z, K),
        factors=factors,
        delta=xp.zeros_like(z),
        size=infinite,
        blur=0.0 * one,
        alpha=one,
        iteration=xp.array(-1),
        status=xp.array(Status.CONVERGED),
        history=xp.zeros(settings.max_iterations + 1),
    )


def _done(s: Iterate, target: Target) -> Array:
    limit = s.at.noise.clip(target.tolerance)
    return (s.at.residual <= limit) & (s.size <= 1e3 * limit)


def goes_on(s: Iterate, target: Target, settings: Settings) -> Array:
    """Whether there is more to look at."""
    return ~_done(s, target) & (s.status == Status.CONVERGED) & (s.iteration < settings.max_iterations)


def ended(lin: Linear, s: Iterate, target: Target) -> Iterate:
    """The last iterate, with its status."""
    missed = (s.status == Status.CONVERGED) & ~_done(s, target)
    return s._replace(status=lin.xp.where(missed, Status.TOO_MANY_ITERATIONS, s.status))


def look(lin: Linear, s: Iterate, inputs: Inputs, target: Target, settings: Settings) -> Iterate:
    """Look at a trial point, then either take it and find the next correction, or halve the step.

    The first trial is the start itself.
    """
    xp = lin.xp
    first = s.iteration < 0
    z = s.z + s.alpha * s.delta
    at = lin.at(z, inputs)
    admissible = at.finite & (at.least_J > 0.0)
    guess = control.choose(first, lambda: s.delta, lambda: s.factors.solve(at.r, 1e-1))
    simplified, _ = lin.strain_of(guess)
    # A NaN compares as false; round-off may keep a tiny correction from shrinking.
    shrink = xp.where(target.near, 0.5, 1.0 - 0.25 * s.alpha)
    taken = admissible & (first | (simplified <= shrink * s.size + s.blur))
    if not tracing.is_traced(z):
        progress.iteration(s.iteration + 1, at, s.alpha, simplified, bool(taken))

    def further() -> Iterate:
        factors = lin.factorise(at, 0.1 * at.stress + target.stiffening * at.modulus, s.size <= 0.03)
        # As exact as Newton's method can use; where it has arrived, the correction only tells the error.
        limit = at.noise.clip(target.tolerance)
        useful = xp.maximum(0.1 * at.residual, 0.1 * limit / xp.maximum(at.residual, limit))
        accuracy = xp.where(at.residual <= limit, 0.1, xp.clip(useful, 1e-9, 1e-2))
        delta = -factors.solve(at.r, accuracy, guess)
        size, largest = lin.strain_of(delta)
        with_stress = size + xp.max(xp.abs(delta[lin.system.n_u :]), initial=0.0) / at.modulus
        iteration = s.iteration + 1
        return Iterate(
            z=z,
            at=at,
            factors=factors,
            delta=delta,
            size=size,
            blur=negligible(xp, z) + lin.inexact * accuracy * with_stress,
            alpha=xp.minimum(1.0, 0.5 / largest),  # no trial strains an element by more than one half
            iteration=iteration,
            status=xp.where(xp.isfinite(size), Status.CONVERGED, Status.SINGULAR),
            history=control.put(s.history, iteration, at.residual),
        )

    def shorter() -> Iterate:
        lost = first | target.near | (s.alpha < 1e-3)
        return s._replace(alpha=0.5 * s.alpha, status=xp.where(lost, Status.NO_DESCENT, Status.CONVERGED))

    return control.choose(taken, further, shorter)
