"""All that is known of one body: points, extrapolations, truth, front, and what each dial costs and buys."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from jaxmyo.tradeoff import errors, plan
from jaxmyo.tradeoff.bodies import BODIES, Body
from jaxmyo.tradeoff.dials import Dials
from jaxmyo.tradeoff.errors import Truth
from jaxmyo.tradeoff.front import as_data, behind, front
from jaxmyo.tradeoff.measure import Effort, Point, measure
from jaxmyo.tradeoff.store import Store


@dataclass(frozen=True)
class Trade:
    """One body: base, the setting that others are compared with; points as measured; extrapolated: made of them."""

    body: Body
    base: Point
    truth: Truth
    points: list[Point]
    extrapolated: list[Point]

    @cached_property
    def every(self) -> list[Point]:
        """Measured and extrapolated points that have an error; those that the truth was made of have none."""
        good = [p for p in (*self.points, *self.extrapolated) if p.converged]
        if self.body.exact is not None:
            return good
        own = max(p.dials.elements for p in good)
        return [p for p in good if p.dials.elements < own]

    @cached_property
    def front(self) -> list[Point]:
        """From the cheapest to the most exact, among the settings that a solve has arguments for."""
        return front(self._asked_for, self.error)

    @cached_property
    def plain_front(self) -> list[Point]:
        """The same, of even meshes with two Gauss points, in float64 by the usual path: what suits every body."""
        usual = Dials()
        kept = ("grading", "quadrature", "precision", "path_tolerance", "move", "steps")
        some = [p for p in self._asked_for if all(getattr(p.dials, k) == getattr(usual, k) for k in kept)]
        return front(some, self.error)

    @property
    def _asked_for(self) -> list[Point]:
        plain = [p for p in self.every if not (p.dials.solver or p.dials.inner or p.dials.tangent == "new")]
        compiler = self.base.dials.compiler
        return [p for p in plain if not p.dials.model and not p.dials.patches and p.dials.compiler == compiler]

    def error(self, point: Point, output: int = 0) -> float:
        """Relative error of an output [–], without the luck of parts that cancel."""
        return errors.counted(point, self.every, self.truth, output)

    def data(self, point: Point) -> dict[str, Any]:
        """A point for `datasets/front.json`."""
        errors_of = [self.error(point, k) for k in range(len(self.body.outputs))]
        fronts = {"on_front": self.front, "on_plain_front": self.plain_front}
        return as_data(point, errors_of) | {name: any(p is point for p in f) for name, f in fronts.items()}

    @property
    def settings(self) -> list[Point]:
        """The points of both fronts, from the cheapest on."""
        both = {p.dials: p for p in (*self.front, *self.plain_front)}
        return sorted(both.values(), key=lambda p: p.cpu_seconds)

    def split(self, point: Point) -> dict[str, float | None]:
        """The error by source."""
        return errors.split(point, self.every, self.truth)


@dataclass(frozen=True)
class Effect:
    """What a change of dials does beside the base: ratios of error, CPU seconds, memory; behind: see `front.behind`."""

    changes: dict[str, Any]
    point: Point
    error: float
    errors: float
    seconds: float
    memory: float
    behind: float


def trade(name: str, quick: bool, store: Store, say: Callable[[str], None]) -> Trade:
    """Measure a body, but for what the store has; ValueError where its base or its truth did not come out."""
    body, wanted = BODIES[name], plan.plan(name, quick)
    base = (plan.QUICK_BASE if quick else plan.BASE)[name]
    known = {p.dials for p in store.of(name, wanted)}
    effort = Effort(5, 0.5) if quick else Effort()
    for point in measure(name, [d for d in wanted if d not in known], effort, say):
        store.keep(point)
    points = store.of(name, wanted)
    of_base = next(p for p in points if p.dials == base)
    if not of_base.converged:
        raise ValueError(f"{name}: the base setting did not converge: {of_base.status}")
    return Trade(body, of_base, _truth(body, name, base, points, quick), points, errors.extrapolated(points))


def _truth(body: Body, name: str, base: Dials, points: Sequence[Point], quick: bool) -> Truth:
    if body.exact is not None:
        exact = body.exact()
        return Truth(exact, (0.0,) * len(exact), "exact: a few numbers and Gauss quadrature, no elements")
    return errors.finest(points, base, (plan.QUICK_FINEST if quick else plan.FINEST)[name])


def effects(found: Trade) -> list[Effect]:
    """Every setting that differs from the base in one dial, or in the model and its mesh, or is extrapolated."""
    base, on_front = found.base, found.front
    usual = found.error(base)
    result = []
    for point in found.every:
        changes = point.dials.changed(base.dials)
        if len(changes) != 1 and set(changes) != {"model", "elements"}:
            continue
        own = found.error(point)
        ratios = own / usual, point.cpu_seconds / base.cpu_seconds, point.memory_MB / base.memory_MB
        result.append(Effect(changes, point, own, *ratios, behind(point, on_front, found.error)))
    return sorted(result, key=lambda e: (next(iter(e.changes)), str(next(iter(e.changes.values())))))
