"""The measured trade as a table (CSV), as data and as text."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from jaxmyo.paper.output import write_csv
from jaxmyo.tradeoff.errors import relative
from jaxmyo.tradeoff.measure import Point
from jaxmyo.tradeoff.trade import Trade, effects


def write_table(path: Path, found: Sequence[Trade]) -> Path:
    """Every setting of every body, failed ones with their status."""
    return write_csv(path, (row for trade in found for row in rows(trade)))


def rows(trade: Trade) -> Iterator[dict[str, Any]]:
    """One row per setting: its dials, outputs, errors in all and by source, seconds, memory."""
    on_front = {p.dials for p in trade.front}
    compared = {p.dials for p in trade.every}
    for point in (*trade.points, *trade.extrapolated):
        yield {
            "body": point.body,
            **asdict(point.dials),
            "status": point.status,
            "on_front": int(point.dials in on_front),
            **_outputs(trade, point),
            **_errors(trade, point if point.dials in compared else None),
            "seconds": point.seconds,
            "cpu_seconds": point.cpu_seconds,
            "repeats": point.repeats,
            "cold_seconds": point.cold_seconds,
            "cold_cpu_seconds": point.cold_cpu_seconds,
            "memory_MB": point.memory_MB,
            "idle_MB": point.idle_MB,
            "unknowns": point.unknowns,
            "steps": point.steps,
            "iterations": point.iterations,
            "linear_solver": point.solver,
        }


def _outputs(trade: Trade, point: Point) -> dict[str, Any]:
    values = point.outputs or (None, None)
    found: dict[str, Any] = {}
    for k, ((name, unit), value) in enumerate(zip(trade.body.outputs, values, strict=True), start=1):
        found |= {f"output_{k}": f"{name} [{unit}]", f"value_{k}": value}
    return found


def _errors(trade: Trade, point: Point | None) -> dict[str, Any]:
    if point is None or point.outputs is None:
        return dict.fromkeys(("error_1", "error_2", "discretisation", "quadrature", "algebra", "precision"))
    first, second = relative(point.outputs, trade.truth.outputs)
    sources: dict[str, Any] = trade.split(point) if point.dials.extrapolated == 1 else {}
    none: dict[str, Any] = dict.fromkeys(("discretisation", "quadrature", "algebra", "precision"))
    return {"error_1": first, "error_2": second, **(none | sources)}


def summary(found: Sequence[Trade]) -> dict[str, Any]:
    """Of each body: the truth, the base, the front, and what each dial costs and buys."""
    return {
        t.body.name: {
            "title": t.body.title,
            "outputs": [
                {"name": n, "unit": u, "truth": x} for (n, u), x in zip(t.body.outputs, t.truth.outputs, strict=True)
            ],
            "truth_is": t.truth.source,
            "measured": len(t.points),
            "converged": sum(p.converged for p in t.points),
            "failures": [
                {"dials": p.dials.changed(t.base.dials), "status": p.status} for p in t.points if not p.converged
            ],
            "base": t.data(t.base),
            "front": [t.data(p) for p in t.front],
            "dials": [
                {
                    "changes": e.changes,
                    "error": e.error,
                    "error_ratio": e.errors,
                    "seconds_ratio": e.seconds,
                    "memory_ratio": e.memory,
                    "behind_front": e.behind,
                }
                for e in effects(t)
            ],
        }
        for t in found
    }


def as_text(trade: Trade) -> str:
    """The front of a body, a line each."""
    lines = [f"{trade.body.title}: front of CPU seconds and error of the {trade.body.outputs[0][0]}"]
    lines += [
        f"  {trade.error(p):8.1e}  {p.cpu_seconds:8.3g} s  {p.memory_MB:6.0f} MB  {described(p)}" for p in trade.front
    ]
    return "\n".join(lines)


def described(point: Point) -> str:
    """A setting in words: meshes, quadrature, precision, tolerance, and what is unusual."""
    d = point.dials
    meshes = " + ".join(str(d.elements // 2**k) for k in reversed(range(d.extrapolated)))
    unit = "element" if meshes == "1" else "elements, extrapolated" if d.extrapolated > 1 else "elements"
    words = [f"{meshes} {unit}", f"tolerance {d.tolerance:.0e}"]
    usual = type(d)()
    for name, value in d.changed(usual).items():
        if name not in ("elements", "extrapolated", "tolerance"):
            words.append(f"{name.replace('_', ' ')} {value}")
    return ", ".join(words)
