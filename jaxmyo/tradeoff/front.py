"""The Pareto front: settings that no other one beats in both time and error; and the file that the package reads."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jaxmyo.tradeoff.measure import Point


def pareto(seconds: ArrayLike, errors: ArrayLike) -> list[int]:
    """Positions of the points on the front, from the cheapest to the most exact.

    A point is on it if no other one is at most as slow and at most as wrong, and better in one of the two; of equal
    points the first is.
    """
    cost, wrong = np.asarray(seconds, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    if cost.ndim != 1 or cost.shape != wrong.shape:
        raise ValueError(f"seconds and errors must be of one length; got shapes {cost.shape} and {wrong.shape}")
    if not (np.isfinite(cost).all() and np.isfinite(wrong).all()):
        raise ValueError("seconds and errors must be finite")
    front: list[int] = []
    for k in np.lexsort((np.arange(len(cost)), wrong, cost)):
        if not front or wrong[k] < wrong[front[-1]]:
            front.append(int(k))
    return front


#: A setting must be so much more exact than the one before it on the front [–]: less is not worth another setting.
STEP = 1.1


def front(points: Sequence[Point], error: Callable[[Point], float]) -> list[Point]:
    """The points on the front of (CPU seconds of a warm solve, error), without those that are hardly more exact."""
    good = [p for p in points if p.converged]
    found: list[Point] = []
    for k in pareto([p.cpu_seconds for p in good], [error(p) for p in good]):
        if not found or error(good[k]) * STEP < error(found[-1]):
            found.append(good[k])
    return found


def behind(point: Point, on_front: Sequence[Point], error: Callable[[Point], float]) -> float:
    """CPU seconds of a point over those of the cheapest setting of the front that is as exact [–]; 1 if none is."""
    as_exact = [p.cpu_seconds for p in on_front if error(p) <= error(point)]
    return point.cpu_seconds / min(as_exact, default=point.cpu_seconds)


def as_data(point: Point, errors: Sequence[float]) -> dict[str, Any]:
    """A setting for `datasets/front.json`; errors: of the outputs."""
    d = point.dials
    return {
        "elements": d.elements,
        "extrapolated": d.extrapolated,
        "grading": d.grading,
        "quadrature": d.quadrature,
        "precision": d.precision,
        "tolerance": d.tolerance,
        "path_tolerance": d.path_tolerance,
        "move": d.move,
        "steps": d.steps,
        "error": errors[0],
        "errors": list(errors),
        "seconds": point.seconds,
        "cpu_seconds": point.cpu_seconds,
        "cold_seconds": point.cold_seconds,
        "cold_cpu_seconds": point.cold_cpu_seconds,
        "memory_MB": point.memory_MB,
    }


def write(path: Path, fronts: dict[str, dict[str, Any]], versions: dict[str, str]) -> Path:
    """The fronts of bodies, by name: {"outputs", "truth", "settings"}; and what they were measured with."""
    path.write_text(
        json.dumps({"versions": versions, "bodies": fronts}, indent=1, ensure_ascii=False, allow_nan=False) + "\n",
        encoding="utf-8",
    )
    return path
