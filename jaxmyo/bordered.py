"""One state of a branch: Newton's method for the unknowns z and the load factor λ together, on a plane.

With the factors of the tangent K, K x = −r and K y = −∂r/∂λ give the corrections dz = x + dλ y with dλ from the plane.
K itself is singular at a limit point, the bordered system is not, and no state comes closer to it than these two solves
can bear.
"""

from types import ModuleType
from typing import Any, NamedTuple, cast

import jax

from jaxmyo import control
from jaxmyo.compiler import lean
from jaxmyo.continuation import Solution
from jaxmyo.linear import At, negligible
from jaxmyo.newton import Linear
from jaxmyo.status import Status
from jaxmyo.system import Inputs


class Found(NamedTuple):
    """A state of the branch.

    z: unknowns; load: λ; rate: dz/dλ; speed: strain of the body per λ; solution: the state; converged: whether it is.
    """

    z: Any
    load: Any
    rate: Any
    speed: Any
    solution: Solution
    converged: Any


class Plane(NamedTuple):
    """The states with ⟨a, z − z₀⟩ + c (λ − λ₀) = 0; z, load: z₀ and λ₀, where the correction starts."""

    z: Any
    load: Any
    a: Any
    c: Any


def _at_load(xp: ModuleType, begin: Inputs, end: Inputs, load: Any) -> Inputs:
    """The inputs at a load factor; exactly the end at 1."""
    return cast(Inputs, jax.tree.map(lambda a, b: xp.where(load == 1.0, b, a + load * (b - a)), begin, end))


class _Trial(NamedTuple):
    z: Any
    load: Any
    by_z: Any  # the next correction
    by_load: Any
    size: Any  # its strain
    rate: Any
    speed: Any
    at: Any
    iteration: Any
    lost: Any


def correct(lin: Linear, plane: Plane, begin: Inputs, end: Inputs, tolerance: Any, max_iterations: int) -> Found:
    """The state on a plane, by Newton's method, to a relative residual of `tolerance`.

    Each correction must be at most half of the one before.
    """
    xp = lin.xp
    by_load = jax.tree.map(lambda a, b: b - a, begin, end)

    def done(s: _Trial) -> Any:
        limit = s.at.noise.clip(tolerance)
        return (s.at.residual <= limit) & (s.size <= 1e5 * limit)

    def keep_going(s: _Trial) -> Any:
        return ~done(s) & ~s.lost & (s.iteration < max_iterations)

    def look(s: _Trial) -> _Trial:
        z, load = s.z + s.by_z, s.load + s.by_load
        inputs = _at_load(xp, begin, end, load)
        at = lin.at(z, inputs)
        factors = lin.factorise(at, negligible(xp, z) * at.modulus, s.size <= 0.03)
        rate, speed = lin.rates(z, inputs, by_load, factors)
        x = -factors.solve(at.r, 1e-4)  # of a sparse body; near a limit point no more can be asked for
        off = xp.sum(plane.a * (z - plane.z)) + plane.c * (load - plane.load)
        d_load = -(off + xp.sum(plane.a * x)) / (plane.c + xp.sum(plane.a * rate))
        dz = x + d_load * rate
        size, _ = lin.strain_of(dz)
        good = at.finite & (at.least_J > 0.0) & xp.isfinite(size) & xp.isfinite(speed)
        shrinks = (size <= 0.5 * s.size) | (size <= 1e5 * at.noise.clip(tolerance))
        return _Trial(z, load, dz, d_load, size, rate, speed, at, s.iteration + 1, ~(good & shrinks))

    one = xp.array(1.0)
    start = _Trial(
        z=plane.z,
        load=plane.load,
        by_z=xp.zeros_like(plane.z),
        by_load=0.0 * one,
        size=xp.inf * one,
        rate=xp.zeros_like(plane.z),
        speed=0.0 * one,
        at=At.unknown(xp, plane.z, lin.nothing()[0]),
        iteration=xp.array(0),
        lost=xp.array(False),
    )
    last = control.loop(keep_going, look, start)
    converged = done(last)
    negative, zero = control.choose(
        converged, lambda: lin.inertia(last.at, last.z), lambda: (xp.array(-1), xp.array(-1))
    )
    solution = Solution(
        z=last.z,
        inputs=_at_load(xp, begin, end, last.load),
        reached=last.load,
        residual=last.at.residual,
        force_residual=xp.max(xp.abs(last.at.r[: lin.system.n_u]), initial=0.0),
        constraint_residual=last.at.violation,
        status=xp.where(converged, Status.CONVERGED, Status.NO_DESCENT),
        steps=xp.array(1),
        rejected=xp.array(0),
        iterations=last.iteration,
        history=xp.zeros(max_iterations + 1),
        negative=negative,
        zero=zero,
        stable_until=one,
        work=lin.work,
    )
    return Found(last.z, last.load, last.rate, last.speed, solution, converged)


correct_dense = lean(correct, "max_iterations")
