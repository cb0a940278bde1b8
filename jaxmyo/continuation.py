"""The path from one state to the next, in activation, load and prescribed motion together.

All inputs move on a straight line from those of a known state (t = 0) to the wanted ones (t = 1). Each load step goes
along the tangent of the path (one linear solve with the tangent that Newton left), then corrects. A step aims at a
bounded strain, is cut back where Newton fails or the body jumps, and grows again where it is easy: this keeps the
solution on the branch that starts at rest, which need not be the only equilibrium nor, far along, a stable one.
"""

from types import ModuleType
from typing import Any, NamedTuple

import jax
from jax import Array

from jaxmyo import control, newton, progress, tracing
from jaxmyo.linear import At, negligible
from jaxmyo.newton import Linear, Settings
from jaxmyo.status import Status
from jaxmyo.system import Inputs

#: A path that ends so near to the limit point that its last states tell, in t, has come to it.
NEAR_LIMIT = 1e-6

#: A path that ends before this part of its load begins anew, with a load that grows more gently.
EARLY = 1e-3


class Solution(NamedTuple):
    """The end of a path: the last converged state and what was spent.

    z: unknowns; inputs: the inputs that z belongs to; reached: fraction of the load; residual: relative residual;
    force_residual [mN], constraint_residual [–]; status: see `Status`; steps, rejected, iterations: counts;
    history: relative residuals of the last Newton loop, 0 beyond its end;
    negative, zero: eigenvalue counts, see `linear.Dense.inertia`; −1 where nothing was solved;
    stable_until: fraction of the load before the determinant of the tangent first changed its sign, 1 if it did not;
    work: of a sparse solve, its counts and seconds.
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
    stable_until: Array
    work: dict[str, Array]


class _Pace(NamedTuple):
    """Two states on the way, each of at most half of the speed that the path had later.

    Near a limit point t* the body moves like (t* − t)^½, so its speed grows beyond all bounds and 1/speed² falls
    linearly to 0: two states tell t*.
    """

    t: tuple[Array, Array]
    speed: tuple[Array, Array]

    def after(self, xp: ModuleType, t: Array, speed: Array) -> "_Pace":
        """With one more state."""
        (t_0, t_1), (v_0, v_1) = self
        slower, twice = speed < v_1, speed >= 2.0 * v_1

        def kept(new: Array, newer: Array, old: Array) -> Array:
            return xp.where(slower, newer, xp.where(twice, new, old))

        return _Pace((kept(t_1, t, t_0), kept(t, t, t_1)), (kept(v_1, speed, v_0), kept(speed, speed, v_1)))

    def to_limit(self, xp: ModuleType, t: Array, speed: Array) -> Array:
        """How far the limit point is from the state at t; infinite where the path does not come to one."""
        latest = speed >= 2.0 * self.speed[1]
        t_0, v_0 = (xp.where(latest, x[1], x[0]) for x in self)
        ratio = (speed / v_0.clip(1e-30)) ** 2
        return xp.where((v_0 > 0.0) & (ratio >= 3.9), (t - t_0) / (ratio - 1.0).clip(1e-30), xp.inf)


class _Path(NamedTuple):
    t: Array  # of the last converged state; −1 before the start is verified
    z: Array
    at: At
    rate: Array  # dz/dt along the path
    speed: Array  # root-mean-square strain of the body per t, along the tangent
    pace: _Pace
    sign: Array  # of the determinant of the tangent
    stable: Array  # the last t before it first changed
    dt: Array
    gentle: Array  # whether the path began anew
    reason: Array  # why the last step was rejected
    history: Array
    steps: Array
    rejected: Array
    iterations: Array


def between(xp: ModuleType, start: Any, end: Any, fraction: Any) -> Any:
    """The inputs at a fraction of the way; exactly the end at 1."""
    return jax.tree.map(lambda a, b: xp.where(fraction >= 1.0, b, a + fraction * (b - a)), start, end)


def _differ(xp: ModuleType, start: Any, end: Any) -> Any:
    differ = [xp.any(a != b) for a, b in zip(jax.tree.leaves(start), jax.tree.leaves(end), strict=True)]
    return xp.any(xp.stack(differ))


def follow(
    lin: Linear, z: Array, start: Inputs, end: Inputs, valid: Array, from_rest: Array, settings: Settings
) -> tuple[Solution, Any]:
    """Follow the equilibrium from z at the inputs `start` to the inputs `end`: the solution, and the tangent there.

    `valid` is false where an input is out of range: nothing is solved then. The start itself is corrected first (at
    rest, the pressure of a law whose stress is p I there is found so). from_rest: soft tissue moves like a root of the
    load near rest, so the load then grows like t³. A path that comes to nothing begins anew more gently: its load was
    many times what stiffness there is at its start.
    """
    xp = lin.xp
    # An invalid sample of a batch stays at its start, and its own NaN must not come back.
    z, start, end = jax.tree.map(lambda x: xp.where(valid | xp.isfinite(x), x, 0.0), (z, start, end))

    def linear_part(gentle: Array) -> Array:
        return xp.where(gentle, 1e-4, xp.where(from_rest, 0.01, 1.0))

    def fraction(t: Array, gentle: Array) -> Array:
        c = linear_part(gentle)
        return xp.where(t >= 1.0, t, c * t + (1.0 - c) * t**3)

    def inputs_at(t: Array, gentle: Array) -> Inputs:
        return between(xp, start, end, fraction(t, gentle))

    def tangent_of_path(found: newton.Iterate, t: Array, gentle: Array) -> tuple[Array, Array]:
        """dz/dt, and the root-mean-square strain rate of the body, prescribed motion included."""
        c = linear_part(gentle)
        slope = c + 3.0 * (1.0 - c) * t**2  # of `fraction`
        by_t = jax.tree.map(lambda a, b: slope * (b - a), start, end)
        rate, speed = lin.rates(found.z, inputs_at(t, gentle), by_t, found.factors)
        known = xp.all(xp.isfinite(rate)) & (t < 1.0)
        return xp.where(known, rate, 0.0), xp.where(known, speed, 0.0)

    moves = _differ(xp, start, end)  # else the start, corrected, is the end
    traced = tracing.is_traced(z)
    watch = progress.Watch(settings.time_limit, settings.progress)

    def keep_going(path: _Path) -> Array:
        further = (path.t < 1.0) & (path.steps < settings.max_steps) & (path.dt >= settings.min_step) & valid
        return further & (traced or not watch.is_over)

    def step(path: _Path) -> _Path:
        at_start, first_step, gentle = path.t < 0.0, path.t <= 0.0, path.gentle
        t = xp.where(at_start, xp.where(moves, 0.0, 1.0), path.t + path.dt)
        t = xp.where(t + 0.2 * path.dt >= 1.0, 1.0, t)  # rather a longer last step than one more
        taken = xp.where(at_start, 0.0, t - path.t)
        guess = path.z + taken * path.rate
        tolerance = xp.where(t >= 1.0, settings.tolerance, settings.path_tolerance)
        stiffening = xp.where(at_start & moves, 1e-4, negligible(xp, z))
        found = newton.solve(lin, guess, inputs_at(t, gentle), tolerance, stiffening, ~first_step, settings)
        # Stay on the branch: the correction must be small, beside the step along the tangent or beside the strain a
        # step may make.
        aimed = path.speed * taken
        off, _ = lin.strain_of(found.z - guess)
        near = off <= xp.maximum(0.5 * aimed, 0.05 * settings.move)
        # A tangent that changed sign has passed a bifurcation, or left the branch beside one: come closer to see which,
        # and to know the load.
        known = (found.status == Status.CONVERGED) & (near | at_start)
        sign = control.choose(known, lambda: found.factors.sign, lambda: path.sign)
        before = fraction(xp.maximum(path.t, 0.0), gentle)
        far = (aimed > 0.05 * settings.move) | (fraction(t, gentle) - before > 0.01)
        # Several branches may begin at rest, where soft tissue has no stiffness, and one that changes the sign is
        # unstable: it is taken only if a path that begins gently finds no other.
        passed = (sign != path.sign) & (far | (first_step & ~gentle))
        good = known & (~passed | at_start)
        if not traced:
            status = Status(int(found.status)).name if good or found.status else "BRANCH_LEFT"
            watch.step(path.steps + 1, t if good else path.t, status, found.at.residual, found.iteration)
        spent = path._replace(
            steps=path.steps + 1,
            iterations=path.iterations + xp.maximum(found.iteration, 0),  # −1: the guess itself was refused
        )

        def further() -> _Path:
            nothing = xp.zeros_like(found.z), xp.array(0.0)
            rate, speed = control.choose(t < 1.0, lambda: tangent_of_path(found, t, gentle), lambda: nothing)
            # Aim at half of the correction that is accepted.
            within = xp.maximum(0.5 * aimed, 0.05 * settings.move)
            growth = xp.clip(0.5 * within / xp.maximum(off, 1e-12), 0.1, 10.0)
            growth = xp.where(found.iteration > 8, xp.minimum(growth, 1.0), growth)
            next_dt = xp.minimum(xp.where(at_start, 1.0, growth * taken), settings.move / xp.maximum(speed, 1e-9))
            return spent._replace(
                t=t,
                z=found.z,
                at=found.at,
                rate=rate,
                speed=speed,
                pace=path.pace.after(xp, t, speed),
                sign=sign,
                stable=xp.where((path.stable >= 1.0) & (sign != path.sign) & ~at_start, path.t, path.stable),
                # Only a failure ends the path: a tangent that starts almost singular may well ask for a tiny step.
                dt=xp.maximum(next_dt, settings.min_step),
                reason=xp.array(Status.TOO_MANY_STEPS),
                history=found.history,
            )

        def again() -> _Path:
            failed = xp.where(found.status == Status.CONVERGED, Status.BRANCH_LEFT, found.status)
            retry = xp.where(at_start, 0.0, 0.25 * taken)
            shorter = spent._replace(dt=retry, reason=failed, rejected=path.rejected + 1)
            counts = {name: getattr(shorter, name) for name in ("steps", "rejected", "iterations", "reason")}
            anew = first._replace(gentle=xp.array(True), **counts)
            early = (retry < settings.min_step) & (before < EARLY) & ~at_start & ~gentle
            return control.choose(early, lambda: anew, lambda: shorter)

        return control.choose(good, further, again)

    none, one = xp.array(0), xp.array(1.0)
    first = _Path(
        t=-one,
        z=z,
        at=At.unknown(xp, z, lin.nothing()[0]),
        rate=xp.zeros_like(z),
        speed=0.0 * one,
        pace=_Pace((0.0 * one, 0.0 * one), (0.0 * one, 0.0 * one)),
        sign=0.0 * one,
        stable=one,
        dt=one,
        gentle=xp.array(False),
        reason=xp.array(Status.SINGULAR),
        history=xp.zeros(settings.max_iterations + 1),
        steps=none,
        rejected=none,
        iterations=none,
    )
    with watch:
        last = control.loop(keep_going, step, newton.batched_as(valid, first))
    reached = fraction(xp.maximum(last.t, 0.0), last.gentle)
    negative, zeros = lin.inertia(last.at, last.z)
    beyond = last.pace.to_limit(xp, last.t, last.speed)
    ended = xp.where(beyond <= NEAR_LIMIT, Status.LIMIT_POINT, last.reason)
    over = Status.TIME_LIMIT if not traced and watch.is_over else ended
    status = xp.where(last.t >= 1.0, Status.CONVERGED, over)
    solution = Solution(
        z=last.z,
        inputs=between(xp, start, end, reached),
        reached=reached,
        residual=last.at.residual,
        force_residual=xp.max(xp.abs(last.at.r[: lin.system.n_u]), initial=0.0),
        constraint_residual=last.at.violation,
        status=xp.where(valid, status, Status.INVALID_INPUT),
        steps=last.steps,
        rejected=last.rejected,
        iterations=last.iterations,
        history=last.history,
        negative=xp.where(valid, negative, -1),
        zero=xp.where(valid, zeros, -1),
        stable_until=xp.where(last.stable >= 1.0, 1.0, fraction(last.stable, last.gentle)),
        work=lin.work,
    )
    return solution, last.at.K
