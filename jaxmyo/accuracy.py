"""A solve to a wanted accuracy of one output: `converge(attempt, output, accuracy=1e-4)`.

The first meshes and settings are the cheapest of the measured front (`jaxmyo tradeoff`, `datasets/front.json`) that
were as exact as wanted on a body of that kind. What they give on *this* body is then judged from its own meshes, each
twice as fine as the one before: outputs of Q1–Q0 elements have an expansion in h², whose terms are removed one by one
(Romberg), and the last term that was removed estimates the error. Where the differences of three meshes do not fall as
they should (a corner, a boundary layer, a mesh too coarse), nothing is extrapolated and the observed order is used. The
mesh is refined until the estimate is below the target, or the number of elements at its limit.
"""

import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial
from importlib import resources
from typing import Any

import numpy as np

from jaxmyo import checks
from jaxmyo.extrapolation import neville
from jaxmyo.newton import Settings
from jaxmyo.state import State
from jaxmyo.status import SolveError

#: Targets by name [–].
PRESETS = {"fast": 1e-2, "balanced": 1e-4, "exact": 1e-8}

#: Newton's method ends where its next correction strains the body by less than this times its tolerance.
_STRAIN_PER_TOLERANCE = 1e3
#: The share of the target that Newton's method may use up [–].
_ALGEBRA = 0.1


@dataclass(frozen=True)
class Answer:
    """An output, and how far off it is.

    value: in the output's own unit; discretisation, algebra: its estimated relative error [–] by the meshes and by
    Newton's tolerance; accuracy: what was wanted; state: on the finest mesh; elements, values: the meshes and the
    output on each; order: observed on the last three, None for fewer; extrapolated: whether value is extrapolated to
    h = 0; settings: of the solves; seconds: of everything.
    """

    value: float
    discretisation: float
    algebra: float
    accuracy: float
    state: State = field(repr=False)
    elements: tuple[int, ...]
    values: tuple[float, ...]
    order: float | None
    extrapolated: bool
    settings: Settings = field(repr=False)
    seconds: float

    @property
    def error(self) -> float:
        """The estimated relative error of `value` [–]."""
        return self.discretisation + self.algebra

    @property
    def reached(self) -> bool:
        """Whether the estimate is below the target."""
        return self.error <= self.accuracy

    @property
    def message(self) -> str:
        """What was reached, and if it was not enough, what to try."""
        how = (
            f"{self.value:.10g}, estimated relative error {self.error:.1e} (target {self.accuracy:.0e}), meshes of "
            + (", ".join(map(str, self.elements)) + (", extrapolated" if self.extrapolated else ""))
        )
        if self.reached:
            return how
        if self.algebra > self.accuracy:
            return f"{how}: OUT OF REACH, float64 leaves {self.algebra:.0e}"
        order = "" if self.order is None else f"; the observed order is {self.order:.2g}, smooth bodies have 2"
        return f"{how}: OUT OF REACH with max_elements = {self.elements[-1]}{order}. Try a finer or a graded mesh"

    def __str__(self) -> str:
        return self.message


def converge(
    attempt: Callable[[int, Settings], State],
    output: Callable[[State], Any],
    *,
    accuracy: float | str = "balanced",
    like: str = "radial",
    max_elements: int = 256,
) -> Answer:
    """Compute an output to a relative accuracy, as cheaply as the measured front and the body's own meshes allow.

    attempt: of a number of elements n (per direction, or as you refine) and `Settings`, the state: a scene made with n
    elements and solved with these settings. n may be any integer ≥ 1, and twice n must halve the elements. output: one
    number of the state, in any unit, not 0. accuracy: wanted relative error [–], in [1e-12, 0.1], or "fast" (1e-2),
    "balanced" (1e-4), "exact" (1e-8). like: the body of `datasets/front.json` whose front is begun with.
    max_elements: no mesh is finer.

    The error is an estimate, not a bound; `Answer.reached` says whether it is below the target. Errors: ValueError for
    a target out of range or an output that is no finite number other than 0; SolveError where no mesh has a state.
    """
    started = time.perf_counter()
    if isinstance(accuracy, str):
        accuracy = PRESETS[checks.choice("accuracy", accuracy, list(PRESETS))]
    if not 1e-12 <= accuracy <= 0.1:
        raise ValueError(f"accuracy = {accuracy} is outside [1e-12, 0.1] (–, relative error of the output)")
    if not isinstance(max_elements, int) or max_elements < 2:
        raise ValueError(f"max_elements = {max_elements} must be an integer ≥ 2")
    n, finest, settings = first_setting(accuracy, checks.choice("like", like, list(_fronts())), max_elements)
    algebra = _STRAIN_PER_TOLERANCE * settings.tolerance
    meshes: list[int] = []
    values: list[float] = []
    while True:
        last = 2 * n > max_elements
        try:
            state = attempt(n, settings)
            if not bool(state.converged):
                raise SolveError(partial(getattr, state, "message"), state)
            meshes, values = [*meshes, n], [*values, _number(output, state, n)]
        except SolveError:
            if last:
                raise
            meshes, values = [], []  # of meshes without a gap
        if len(values) > 1:
            value, error, order, extrapolated = extrapolate(values)
            same = values[-1] == values[-2]  # nothing was there to refine
            enough = n >= finest and error <= (accuracy - algebra) * abs(value)
            if same or enough or last or algebra > accuracy:
                break
        elif last:
            raise ValueError(f"max_elements = {max_elements} leaves one mesh that has a state; two are needed")
        n *= 2
    seconds = time.perf_counter() - started
    mine = (value, error / abs(value), algebra, accuracy, state, tuple(meshes), tuple(values), order, extrapolated)
    return Answer(*mine, settings, seconds)


def first_setting(accuracy: float, like: str, max_elements: int) -> tuple[int, int, Settings]:
    """The coarsest and the finest mesh to begin with, and settings: the cheapest of the front that are exact enough."""
    # What every attempt can do, on a path that no body leaves: those of looser paths are of the bodies of the front.
    usual = {"grading": 1.0, "quadrature": 2, "precision": "float64", "steps": 0}
    usual |= {name: getattr(Settings(), name) for name in ("path_tolerance", "move")}
    front = [
        s for s in _fronts()[like]["settings"] if all(s.get(name, value) == value for name, value in usual.items())
    ]
    meshes = 2 if accuracy >= 1e-3 else 3  # two tell little, and their estimate is wide
    enough = [s for s in front if s["extrapolated"] >= meshes - 1]
    best = next((s for s in enough if s["error"] <= accuracy), enough[-1])
    n, meshes = int(best["elements"]), max(meshes, int(best["extrapolated"]))
    n = min(n, 1 << (max_elements.bit_length() - 1))
    coarsest = max(1, n >> (meshes - 1))
    tolerance = max(Settings().tolerance, min(best["tolerance"], _ALGEBRA * accuracy / _STRAIN_PER_TOLERANCE))
    return coarsest, n, Settings(tolerance=tolerance)


def extrapolate(values: list[float]) -> tuple[float, float, float | None, bool]:
    """(value, estimated error, observed order, whether extrapolated) of an output on meshes, each twice as fine.

    With two meshes v₀, v₁ the value is v₁ + (v₁ − v₀)/3 and the error |v₁ − v₀|, three times what is removed, as the
    order is not known; with three or more, of order 2, Romberg's value, and twice the last term that it removed.
    """
    if len(values) < 2:
        return values[-1], math.inf, None, False
    step = values[-1] - values[-2]
    if len(values) == 2:
        return _limit(values), abs(step), None, True
    before = values[-2] - values[-3]
    if step == 0.0:
        return values[-1], 0.0, None, False
    ratio = before / step
    order = math.log2(ratio) if ratio > 0.0 else None
    if order is not None and 1.7 <= order <= 2.3:
        value = _limit(values)
        return value, 2.0 * abs(value - _limit(values[1:])), order, True
    assumed = min(max(order or 0.5, 0.5), 2.0)
    return values[-1], 2.0 * abs(step) / (2.0**assumed - 1.0), order, False


def _limit(values: list[float]) -> float:
    return float(neville(values, [0.5**k for k in range(len(values))]))


@cache
def _fronts() -> dict[str, Any]:
    text = resources.files("jaxmyo").joinpath("datasets/front.json").read_text(encoding="utf-8")
    return dict(json.loads(text)["bodies"])


def _number(output: Callable[[State], Any], state: State, n: int) -> float:
    value = np.asarray(output(state))
    if value.shape != () or not np.isfinite(value) or value == 0.0:
        raise ValueError(
            f"output must be one finite number other than 0, as its error is relative; got {value} with {n} elements"
        )
    return float(value)
