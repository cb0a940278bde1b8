"""The path from one state to the next, in activation, load and prescribed motion together.

All inputs move on a straight line from those of a known state (t = 0) to the wanted ones (t = 1). Each load step goes
along the tangent of the path (one linear solve with the tangent that Newton left), then corrects. A step aims at a
bounded strain, is cut back where Newton fails or the body jumps, and grows again where it is easy: this keeps the
solution on the branch that starts at rest, which need not be the only equilibrium nor, far along, a stable one.
"""

from dataclasses import dataclass, field, replace
from types import ModuleType
from typing import Any, NamedTuple

import jax
from jax import Array

from jaxmyo import control, leaves, newton, path_queue, progress, tracing
from jaxmyo.linear import At, negligible
from jaxmyo.newton import Iterate, Linear, Settings, Target
from jaxmyo.status import Status
from jaxmyo.system import Inputs

#: The root-mean-square strain from which on a body has moved [–].
MOVED = 1e-3
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


class Path(NamedTuple):
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


class End(NamedTuple):
    """Where a path ended: its last state, and what was spent; see `Solution`."""

    t: Array
    z: Array
    at: At
    gentle: Array
    stable: Array
    status: Array
    history: Array
    steps: Array
    rejected: Array
    iterations: Array


class Step(NamedTuple):
    """A load step: to t, `taken` from the last state, with a guess of the unknowns there.

    moving: the inputs there that move, see `Route`; target: of Newton's method.
    """

    t: Array
    taken: Array
    guess: Array
    moving: list[Array]
    target: Target


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Route:
    """What a path goes along: a straight line between two inputs.

    start: of the leaves of the inputs that may differ at its ends, where it starts; moving: their positions, the others
    have no part in what goes along the path; end: all inputs where it ends; valid: false where an input is out of its
    range: nothing is solved then; from_rest: soft tissue moves like a root of the load near rest, so the load then
    grows like t³; from_A: the path starts at a state A, which followed its own branch from rest.
    """

    start: list[Array]
    end: Inputs
    valid: Array
    from_rest: Array
    from_A: Array
    moving: tuple[int, ...] = field(metadata={"static": True})

    @classmethod
    def between(cls, start: Inputs, end: Inputs, valid: Any, *, from_rest: Any, from_A: Any) -> "Route":
        """Leaves that are one and the same object do not move."""
        moving = leaves.true(jax.tree.map(lambda a, b: a is not b, start, end))
        return cls(leaves.pick(start, moving), end, valid, from_rest, from_A, moving)

    def ends(self) -> list[tuple[Array, Array]]:
        """Of each leaf that moves."""
        return list(zip(self.start, leaves.pick(self.end, self.moving), strict=True))

    def moving_at(self, xp: ModuleType, fraction: Any) -> list[Array]:
        """Those that move, at a fraction of the way; exactly the end at 1."""
        return [xp.where(fraction >= 1.0, b, a + fraction * (b - a)) for a, b in self.ends()]

    def inputs(self, moving: list[Array]) -> Inputs:
        """All inputs, with these values of those that move."""
        inputs: Inputs = leaves.put(self.end, self.moving, moving)
        return inputs


class Task(NamedTuple):
    """A path from the unknowns z along a route."""

    lin: Linear
    z: Array
    route: Route


def follow(lin: Linear, z: Array, route: Route, settings: Settings) -> tuple[Solution, Any]:
    """Follow the equilibrium from z along a route: the solution, and the tangent there.

    The start itself is corrected first (at rest, the pressure of a law whose stress is p I there is found so). A path
    that comes to nothing begins anew more gently: its load was many times what stiffness there is at its start.
    """
    xp = lin.xp
    # An invalid sample of a batch stays at its start, and its own NaN must not come back.
    known = z, route.start, route.end
    z, start, end = jax.tree.map(lambda x: xp.where(route.valid | xp.isfinite(x), x, 0.0), known)
    task = Task(lin, z, replace(route, start=start, end=end))
    if tracing.is_traced(z):
        numbers = {name: getattr(settings, name) for name in newton.NUMBERS}

        def walk(task: Task, numbers: dict[str, Any]) -> Walk:
            return Walk(task, settings._replace(**numbers), None)

        found = path_queue.followed(walk, task, numbers)
    else:
        with progress.Watch(settings.time_limit, settings.progress) as watch:
            found = path_queue.alone(Walk(task, settings, watch))
    return Walk(task, settings, None).solution(found)


@dataclass(frozen=True)
class Walk:
    """The steps of a path; watch: of a path outside of JAX's transformations."""

    task: Task
    settings: Settings
    watch: progress.Watch | None

    @property
    def lin(self) -> Linear:
        """The linear algebra of the body."""
        return self.task.lin

    @property
    def route(self) -> Route:
        """What the path goes along."""
        return self.task.route

    @property
    def valid(self) -> Array:
        """Whether all inputs are in their ranges."""
        return self.route.valid

    def begin(self) -> Path:
        """Before the start is verified."""
        xp, z = self.lin.xp, self.task.z
        none, one = xp.array(0), xp.array(1.0)
        return Path(
            t=-one,
            z=z,
            at=At.unknown(xp, z, self.lin.nothing()[0]),
            rate=xp.zeros_like(z),
            speed=0.0 * one,
            pace=_Pace((0.0 * one, 0.0 * one), (0.0 * one, 0.0 * one)),
            sign=0.0 * one,
            stable=one,
            dt=one,
            gentle=xp.array(False),
            reason=xp.array(Status.SINGULAR),
            history=xp.zeros(self.settings.max_iterations + 1),
            steps=none,
            rejected=none,
            iterations=none,
        )

    def goes_on(self, path: Path) -> Array:
        """Whether there is a step to take."""
        s = self.settings
        further = (path.t < 1.0) & (path.steps < s.max_steps) & (path.dt >= s.min_step) & self.valid
        return further & (self.watch is None or not self.watch.is_over)

    def aim(self, path: Path) -> Step:
        """The next step."""
        xp, settings = self.lin.xp, self.settings
        at_start, first_step = path.t < 0.0, path.t <= 0.0
        # Else the start, corrected, is the end.
        differ = [xp.any(a != b) for a, b in self.route.ends()]
        moves = xp.any(xp.stack(differ)) if differ else xp.array(False)
        t = xp.where(at_start, xp.where(moves, 0.0, 1.0), path.t + path.dt)
        t = xp.where(t + 0.2 * path.dt >= 1.0, 1.0, t)  # rather a longer last step than one more
        taken = xp.where(at_start, 0.0, t - path.t)
        # Near rest there may be no stiffness, and the first step has no meaning; a state A that moved knows its way.
        # A start that the user gives may be unstable, and its branch end where a stable one begins.
        moved = self.route.from_A & ~at_start & (self.lin.strain_of(path.z)[0] > MOVED)
        target = Target(
            tolerance=xp.where(t >= 1.0, settings.tolerance, settings.path_tolerance),
            stiffening=xp.where(at_start & moves, 1e-4, negligible(xp, path.z)),
            near=~first_step | moved,
        )
        moving = self.route.moving_at(xp, self._fraction(t, path.gentle))
        return Step(t, taken, path.z + taken * path.rate, moving, target)

    def arrive(self, path: Path, step: Step, found: Iterate) -> Path:
        """The path after a step, which is taken or shortened."""
        lin, xp, settings = self.lin, self.lin.xp, self.settings
        at_start, first_step, gentle = path.t < 0.0, path.t <= 0.0, path.gentle
        t, taken = step.t, step.taken
        # Stay on the branch: the correction must be small, beside the step along the tangent or beside the strain a
        # step may make.
        aimed = path.speed * taken
        off, _ = lin.strain_of(found.z - step.guess)
        near = off <= xp.maximum(0.5 * aimed, 0.05 * settings.move)
        # A tangent that changed sign has passed a bifurcation, or left the branch beside one: come closer to see which,
        # and to know the load.
        known = (found.status == Status.CONVERGED) & (near | at_start)
        sign = control.choose(known, lambda: found.factors.sign, lambda: path.sign)
        before = self._fraction(xp.maximum(path.t, 0.0), gentle)
        far = (aimed > 0.05 * settings.move) | (self._fraction(t, gentle) - before > 0.01)
        # Several branches may begin at rest, where soft tissue has no stiffness, and one that changes the sign is
        # unstable: it is taken only if a path that begins gently finds no other.
        passed = (sign != path.sign) & (far | (first_step & ~gentle))
        good = known & (~passed | at_start)
        if self.watch is not None:
            status = Status(int(found.status)).name if good or found.status else "BRANCH_LEFT"
            self.watch.step(path.steps + 1, t if good else path.t, status, found.at.residual, found.iteration)
        spent = path._replace(
            steps=path.steps + 1,
            iterations=path.iterations + xp.maximum(found.iteration, 0),  # −1: the guess itself was refused
        )

        def further() -> Path:
            nothing = xp.zeros_like(found.z), xp.array(0.0)
            rate, speed = control.choose(t < 1.0, lambda: self._tangent(found, t, gentle), lambda: nothing)
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

        def again() -> Path:
            failed = xp.where(found.status == Status.CONVERGED, Status.BRANCH_LEFT, found.status)
            retry = xp.where(at_start, 0.0, 0.25 * taken)
            shorter = spent._replace(dt=retry, reason=failed, rejected=path.rejected + 1)
            counts = {name: getattr(shorter, name) for name in ("steps", "rejected", "iterations", "reason")}
            anew = self.begin()._replace(gentle=xp.array(True), **counts)
            early = (retry < settings.min_step) & (before < EARLY) & ~at_start & ~gentle
            return control.choose(early, lambda: anew, lambda: shorter)

        return control.choose(good, further, again)

    def end(self, path: Path) -> End:
        """What is kept of a path that does not go on."""
        xp = self.lin.xp
        beyond = path.pace.to_limit(xp, path.t, path.speed)
        ended = xp.where(beyond <= NEAR_LIMIT, Status.LIMIT_POINT, path.reason)
        over = Status.TIME_LIMIT if self.watch is not None and self.watch.is_over else ended
        status = xp.where(path.t >= 1.0, Status.CONVERGED, over)
        kept = {name: getattr(path, name) for name in End._fields if name != "status"}
        return End(status=status, **kept)

    def solution(self, end: End) -> tuple[Solution, Any]:
        """The end of the path as a solution, and the tangent there."""
        lin, xp, valid = self.lin, self.lin.xp, self.valid
        reached = self._fraction(xp.maximum(end.t, 0.0), end.gentle)
        negative, zeros = lin.inertia(end.at, end.z)
        solution = Solution(
            z=end.z,
            inputs=self.route.inputs(self.route.moving_at(xp, reached)),
            reached=reached,
            residual=end.at.residual,
            force_residual=xp.max(xp.abs(end.at.r[: lin.system.n_u]), initial=0.0),
            constraint_residual=end.at.violation,
            status=xp.where(valid, end.status, Status.INVALID_INPUT),
            steps=end.steps,
            rejected=end.rejected,
            iterations=end.iterations,
            history=end.history,
            negative=xp.where(valid, negative, -1),
            zero=xp.where(valid, zeros, -1),
            stable_until=xp.where(end.stable >= 1.0, 1.0, self._fraction(end.stable, end.gentle)),
            work=lin.work,
        )
        return solution, end.at.K

    def inputs(self, step: Step) -> Inputs:
        """All inputs at a step."""
        return self.route.inputs(step.moving)

    def _linear_part(self, gentle: Array) -> Array:
        xp = self.lin.xp
        return xp.where(gentle, 1e-4, xp.where(self.route.from_rest, 0.01, 1.0))

    def _fraction(self, t: Array, gentle: Array) -> Array:
        """The part of the load at t."""
        c = self._linear_part(gentle)
        return self.lin.xp.where(t >= 1.0, t, c * t + (1.0 - c) * t**3)

    def _tangent(self, found: Iterate, t: Array, gentle: Array) -> tuple[Array, Array]:
        """dz/dt, and the root-mean-square strain rate of the body, prescribed motion included."""
        lin, xp = self.lin, self.lin.xp
        c = self._linear_part(gentle)
        slope = c + 3.0 * (1.0 - c) * t**2  # of `_fraction`
        still = jax.tree.map(lambda _: 0.0, self.route.end)
        by_t = leaves.put(still, self.route.moving, [slope * (b - a) for a, b in self.route.ends()])
        inputs = self.route.inputs(self.route.moving_at(xp, self._fraction(t, gentle)))
        rate, speed = lin.rates(found.z, inputs, by_t, found.factors)
        known = xp.all(xp.isfinite(rate)) & (t < 1.0)
        return xp.where(known, rate, 0.0), xp.where(known, speed, 0.0)
