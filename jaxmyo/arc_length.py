"""A branch of states C followed by its arc length: the load may rise and fall, so limit points are passed.

The unknowns are z and the load factor λ together, inputs = begin + λ (end − begin). A step goes along the tangent
(dz/dλ, 1) and is corrected on the plane normal to it (pseudo-arc-length, H. B. Keller 1977), see `jaxmyo.bordered`.

A **limit point** is where dλ/ds changes its sign; it is found by bisection and secants between two states. Where the
count of unstable modes changes and no limit point explains it, branches cross: a **bifurcation**, found by bisection
(the first one, where several lie in one step).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxmyo import checks, progress, tracing
from jaxmyo.bordered import Found, Plane, correct, correct_dense
from jaxmyo.conditions import Condition, Load, Spring
from jaxmyo.continuation import Solution
from jaxmyo.linear import Dense
from jaxmyo.newton import Settings
from jaxmyo.scene import Scene
from jaxmyo.solve import DEFAULT, Problem, as_state, problem
from jaxmyo.sparse import Sparse
from jaxmyo.state import State
from jaxmyo.status import MEANING, SolveError, Status
from jaxmyo.system import System

#: Strain that a change of the load factor by 1 counts as, over the largest strain of a step: the factor of a body that
#: does not move changes by 0.1 per step.
LOAD = 10.0
#: The smallest step, and how near a special point is found, over the largest step [–].
SMALLEST, NEAR = 1e-6, 1e-6


@dataclass(frozen=True)
class Point:
    """A special point of a branch: its load factor λ, and the state there (next to it, for a bifurcation)."""

    load: float
    state: State


@dataclass(frozen=True, repr=False)
class Trace:
    """A branch of states.

    load: (n,) load factors λ, 0 at the start and 1 for the conditions as they were given; states: the n states, a batch
    (`states[i]` is one); limit_points: where λ has an extremum along the branch; bifurcations: where another branch
    crosses; status: CONVERGED where the branch was followed as far as was asked for.
    """

    load: NDArray[np.float64]
    states: State
    limit_points: tuple[Point, ...]
    bifurcations: tuple[Point, ...]
    status: Status

    @property
    def message(self) -> str:
        """How the trace ended, and what it passed."""
        passed = [("limit points", self.limit_points), ("bifurcations", self.bifurcations)]
        said = "".join(
            f"; {name} at {', '.join(f'{100.0 * p.load:.8g} %' for p in points)} of the load"
            for name, points in passed
            if points
        )
        ended = "" if self.status is Status.CONVERGED else f"{self.status.name}: {MEANING[self.status]}. "
        return f"{ended}{len(self.load)} states, the last at {100.0 * self.load[-1]:.8g} % of the load{said}"

    def __repr__(self) -> str:
        return f"Trace: {self.message}"


def trace(
    state: State,
    *conditions: Condition,
    start: State | None = None,
    steps: int = 100,
    move: float = 0.1,
    stop: Callable[[State], bool] | None = None,
    settings: Settings = DEFAULT,
    throw: bool = True,
) -> Trace:
    """Follow the branch of states C of a free contraction A through its limit points, by arc length.

    state, conditions, start: as of `load`. All that the conditions prescribe (loads, motions, volumes) moves with one
    load factor λ, from 0 (the state A, or `start`) towards 1 (the conditions), and back after a limit point. The trace
    ends at λ = 1, where `stop(state)` is true, or after `steps` states, whichever comes first; all its states are
    equilibria to `settings.tolerance`.
    move: the largest step, as a root-mean-square strain of the body [–].
    Errors: ValueError for steps < 1 and for move outside (0, 1], TypeError for a traced state. With throw=True,
    SolveError where a branch cannot be followed further however small the step (its `.state` is the last state); with
    throw=False the status of the trace says so. For use outside of `jit` and `vmap`.
    """
    if tracing.is_traced((state, conditions)):
        raise TypeError("trace follows one branch, outside of jit, vmap and grad")
    if int(steps) != steps or steps < 1:
        raise ValueError(f"steps = {steps} must be an integer ≥ 1 (number of states after the start)")
    if settings.precision != "float64":
        raise ValueError(f'settings.precision = {settings.precision!r}: a trace is in "float64"')
    if not 0.0 < move <= 1.0:
        raise ValueError(f"move = {move:g} is outside (0, 1] (–, the largest strain of a step)")
    old = (state if start is None else start).conditions
    branch = _Branch(state.scene, problem(state, conditions, start), old, float(move), settings)
    watch = progress.Watch(settings.time_limit, settings.progress)
    with watch:
        status = branch.follow(int(steps), stop, watch)
    found = branch.result(status)
    if throw and status is not Status.CONVERGED:
        raise SolveError(found.message, found.states[-1])
    return found


class _Way(NamedTuple):
    """A state and the sense in which the branch goes on from it: +1 where λ rises."""

    found: Found
    sense: float

    @property
    def load(self) -> float:
        return float(self.found.load)

    def rise(self, of_load: float) -> float:
        """dλ/ds, s the strain of the body and LOAD times the load."""
        return self.sense / float(np.hypot(float(self.found.speed), of_load))


class _Branch:
    """A branch while it is followed."""

    def __init__(
        self, scene: Scene, path: Problem, old: tuple[Load | Spring, ...], move: float, settings: Settings
    ) -> None:
        self.scene, self.path, self.old, self.move, self.settings = scene, path, old, move, settings
        self.lin: Any = Dense.of(path.system) if path.system.is_small else Sparse.of(path.system)
        self.of_load = LOAD * move
        n, n_u, volume = path.system.size, path.system.n_u, float(np.sum(np.asarray(path.system.weight)))
        unit, touched = np.asarray(self.lin.scale.unit), np.asarray(self.lin.scale.volume)
        self.weight = np.where(np.arange(n) < n_u, touched / unit**2 / volume, 0.0)
        self.ways: list[_Way] = []
        self.limits: list[Found] = []
        self.bifurcations: list[Found] = []
        self.rejected = 0

    def correct(self, z: Any, load: float, a: Any, c: float, iterations: int | None = None) -> Found:
        as_own = jnp.asarray if self.path.system.is_small else np.asarray
        plane = Plane(as_own(z), as_own(load, dtype=float), as_own(a), as_own(c, dtype=float))
        tolerance = as_own(self.settings.tolerance, dtype=float)
        run = correct_dense if self.path.system.is_small else correct
        ends = self.path.begin, self.path.end
        return run(self.lin, plane, *ends, tolerance, max_iterations=iterations or self.settings.max_iterations)

    def at_fixed_load(self, z: Any, load: float) -> Found:
        return self.correct(z, load, np.zeros(self.path.system.size), 1.0)

    def ahead(self, way: _Way, ds: float) -> tuple[_Way | None, float]:
        """The state a step ds along the tangent, and how far it is from the tangent; None where there is none."""
        step = ds * way.rise(self.of_load)
        rate = np.asarray(way.found.rate)
        guess = np.asarray(way.found.z) + step * rate
        a, c = self.weight * rate * way.sense, self.of_load**2 * way.sense
        found = self.correct(guess, way.load + step, a, c)
        if not bool(found.converged):
            return None, np.inf
        off = float(self.lin.strain_of(found.z - (guess if self.lin.xp is np else jnp.asarray(guess)))[0])
        forward = float(np.sum(a * np.asarray(found.rate))) + c
        return _Way(found, float(np.sign(forward))), off

    def follow(self, steps: int, stop: Callable[[State], bool] | None, watch: progress.Watch) -> Status:
        """Find the states; how that ended."""
        if not bool(self.path.valid):
            self.ways.append(_Way(self._unsolved(Status.INVALID_INPUT), 1.0))
            return Status.INVALID_INPUT
        here = self.at_fixed_load(self._start(), 0.0)
        if not bool(here.converged):
            self.ways.append(_Way(self._unsolved(Status.SINGULAR), 1.0))
            return Status.SINGULAR
        self.ways.append(_Way(here, 1.0))
        ds = self.move
        while len(self.ways) <= steps:
            if watch.is_over:
                return Status.TIME_LIMIT
            way = self.ways[-1]
            to, off = self.ahead(way, ds)
            within = max(0.5 * ds, 0.05 * self.move)
            several = to is not None and self._passes_several(way, to) and ds > 0.01 * self.move
            if to is None or off > within or several:
                self.rejected += 1
                ds *= 0.25
                if ds < SMALLEST * self.move:
                    return Status.BRANCH_LEFT
                continue
            over = way.load < 1.0 <= to.load
            if over:
                part = (1.0 - way.load) / (to.load - way.load)
                last = self.at_fixed_load(np.asarray(way.found.z) + part * np.asarray(to.found.z - way.found.z), 1.0)
                if not bool(last.converged):
                    ds *= 0.5
                    continue
                to = _Way(last, 1.0)
            if not self._look_between(way, to, ds):
                self.rejected += 1
                ds *= 0.25
                continue
            self.ways.append(to)
            progress.LOG.info(
                "  state %d at %.6g %% of the load: residual %.2e, %d iterations",
                len(self.ways),
                100.0 * to.load,
                float(to.found.solution.residual),
                int(to.found.solution.iterations),
            )
            if over or (stop is not None and stop(self.state_of(to.found))):
                break
            ds = float(np.clip(0.5 * within / max(off, 1e-12), 0.25, 2.0)) * ds
            ds = min(ds, self.move)
        return Status.CONVERGED

    def _passes_several(self, way: _Way, to: _Way) -> bool:
        """Whether a limit point and a bifurcation lie in one step."""
        return way.sense != to.sense and abs(_unstable(to.found) - _unstable(way.found)) > 1

    def _look_between(self, way: _Way, to: _Way, ds: float) -> bool:
        """Find what lies between two states; whether they are of one branch."""
        if way.sense != to.sense:
            self.limits.append(self._extremum(way, to, ds))
        elif _unstable(way.found) >= 0 and _unstable(way.found) != _unstable(to.found):
            found = self._crossing(way, to, ds)
            if found is None and ds > SMALLEST * self.move:
                return False
            self.bifurcations.append(found or way.found)
        return True

    def _extremum(self, way: _Way, to: _Way, ds: float) -> Found:
        """The state between two others where dλ/ds = 0: secants (Illinois), the best state that was found."""
        a, b = 0.0, ds
        rise_a, rise_b = way.rise(self.of_load), to.rise(self.of_load)
        best, moved = min((way, to), key=lambda w: abs(w.rise(self.of_load))), ""
        for _ in range(40):
            if b - a <= NEAR * self.move:
                break
            part = rise_a / (rise_a - rise_b)
            s, mid = self._near_part(way, a, b, min(max(part, 0.01), 0.99))
            if mid is None:  # too close to it for two solves with K
                break
            rise = mid.rise(self.of_load)
            if abs(rise) < abs(best.rise(self.of_load)):
                best = mid
            if rise * rise_b > 0.0:  # an end that stays twice counts for half
                b, rise_b, rise_a = s, rise, rise_a * (0.5 if moved == "b" else 1.0)
                moved = "b"
            else:
                a, rise_a, rise_b = s, rise, rise_b * (0.5 if moved == "a" else 1.0)
                moved = "a"
        return best.found

    def _near_part(self, way: _Way, a: float, b: float, part: float) -> tuple[float, _Way | None]:
        """A state at about this part of the steps from a to b, beside those where the tangent is singular; its step."""
        for by in (1.0, 0.9, 1.1, 0.7):
            s = a + min(by * part, 0.995) * (b - a)
            if not self.path.system.is_small:  # factors of its own tell the count of its modes
                self.lin.release()
            found, _off = self.ahead(way, s)
            if found is not None:
                return s, found
        return s, None

    def _crossing(self, way: _Way, to: _Way, ds: float) -> Found | None:
        """The last state found before the count of unstable modes changes; None where the body jumps there.

        Branches that all but meet, as of a body that is not quite symmetric, are told apart so.
        """
        a, b, before, after = 0.0, ds, way.found, to.found
        while b - a > NEAR * self.move:
            s, mid = self._near_part(way, a, b, 0.5)
            if mid is None:  # the tangent is all but singular
                break
            if _unstable(mid.found) == _unstable(way.found):
                a, before = s, mid.found
            else:
                b, after = s, mid.found
        apart = float(self.lin.strain_of(after.z - before.z)[0])
        return before if apart <= 10.0 * (b - a) + 1e-3 * NEAR else None

    def _start(self) -> Any:
        return self.path.z if self.path.system.is_small else np.array(self.path.z)

    def _unsolved(self, status: Status) -> Found:
        found = self.at_fixed_load(self._start(), 0.0)
        nothing = found.solution._replace(
            z=self._start(),
            inputs=self.path.begin,
            status=jnp.array(status),
            negative=jnp.array(-1),
            zero=jnp.array(-1),
        )
        return found._replace(solution=nothing)

    def state_of(self, found: Found) -> State:
        """One state of the branch."""
        s = jax.tree.map(jnp.asarray, found.solution)
        return as_state(self.scene, self.path.system, s, self._conditions(s.reached))

    def _conditions(self, load: Array) -> tuple[Load | Spring, ...]:
        """The loads at a load factor: old ones fade while new ones grow."""
        old, new = jax.tree.map(lambda x: jnp.asarray(x, dtype=float), (self.old, self.path.loads))
        if checks.same_structure(old, new):
            return cast(tuple[Load | Spring, ...], jax.tree.map(lambda a, b: a + load * (b - a), old, new))
        faded, grown = (jax.tree.map(lambda x, by=by: by * x, c) for by, c in ((1.0 - load, old), (load, new)))
        return (*faded, *grown)

    def result(self, status: Status) -> Trace:
        """What was found."""
        changed = [i for i, way in enumerate(self.ways) if _unstable(way.found) != _unstable(self.ways[0].found)]
        solutions = [way.found.solution for way in self.ways]
        if changed:
            until = jnp.asarray(self.ways[changed[0] - 1].load)
            solutions = [s._replace(stable_until=until) if i >= changed[0] else s for i, s in enumerate(solutions)]
        if status is not Status.CONVERGED:
            solutions[-1] = solutions[-1]._replace(status=jnp.array(status))
        stacked = jax.tree.map(lambda *x: jnp.stack([jnp.asarray(v) for v in x]), *solutions)
        system = self.path.system

        def without_system(s: Solution) -> State:
            return replace(as_state(self.scene, system, s, self._conditions(s.reached)), system=cast(System, None))

        states = jax.vmap(without_system)(stacked)
        return Trace(
            load=np.array([way.load for way in self.ways]),
            states=replace(states, system=system),
            limit_points=tuple(Point(float(f.load), self.state_of(f)) for f in self.limits),
            bifurcations=tuple(Point(float(f.load), self.state_of(f)) for f in self.bifurcations),
            status=status,
        )


def _unstable(found: Found) -> int:
    return int(found.solution.negative)
