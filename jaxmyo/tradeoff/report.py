"""The report as Markdown: of each body the truth, the front, errors by source, and what each dial costs and buys."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from jaxmyo.tradeoff.errors import SOURCES
from jaxmyo.tradeoff.measure import Point
from jaxmyo.tradeoff.output import described
from jaxmyo.tradeoff.trade import Effect, Trade, effects

_HOW = """Each group of settings that shares a compiled program is measured in a process of its own, one process at a
time. *Warm* is both states of the body, A and C, with the code compiled and patterns and factors forgotten; *wall* is
the median by the clock, *CPU* the least of all cores together, which other programs disturb less: fronts and ratios are
of CPU seconds. *Cold* is the first solve of the process with all that is compiled, nothing kept from before. Memory is
the most that the process held. Small bodies run as one program, compiled by `jaxmyo.compiler.QUICK` unless the dial
`compiler` says "default", which takes two or three times as long and runs faster, in three dimensions much faster.
Settings of one program take turns."""


_SINGLES = ("wall / radius", "β", "kPa inside", "float64", "float32", "radius", "p", "mixed", "radius", "p")


def write(
    path: Path,
    found: Sequence[Trade],
    pictures: dict[str, Path],
    versions: dict[str, str],
    singles: Sequence[Sequence[str]] = (),
) -> Path:
    """The report beside its pictures; singles: the rows of `extremes`."""
    parts = ["# Speed for accuracy, measured", ", ".join(f"{k} {v}" for k, v in versions.items()) + ".", _HOW]
    for trade in found:
        parts += _section(trade, pictures[trade.body.name])
    parts += _precision(found)
    if singles:
        parts += [
            "**Thin walls and states near rest**: the radial tube of 4 elements; relative difference from float64 of "
            "the outer radius and of the mean pressure p of state C.",
            _table(_SINGLES, singles),
        ]
    path.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    return path


def _section(trade: Trade, picture: Path) -> Iterable[str]:
    names = [f"{n} = {x:.10g} {u}" for (n, u), x in zip(trade.body.outputs, trade.truth.outputs, strict=True)]
    doubt = max(trade.truth.doubt)
    yield f"## {trade.body.title}"
    yield f"{', '.join(names)}; {trade.truth.source}." + (f" In doubt by {doubt:.1e}." if doubt else "")
    yield f"![Error against time]({picture.name})"
    yield f"**The front**: nothing measured is both faster and closer to the {trade.body.outputs[0][0]}."
    yield _table(
        ("error", "CPU s", "wall s", "cold CPU s", "MB", "unknowns", "setting"),
        [
            (
                f"{trade.error(p):.1e}",
                f"{p.cpu_seconds:.3g}",
                f"{p.seconds:.3g}",
                f"{p.cold_cpu_seconds:.0f}",
                f"{p.memory_MB:.0f}",
                str(p.unknowns),
                described(p),
            )
            for p in trade.front
        ],
    )
    yield (
        f"**What each dial costs and buys** beside the base ({described(trade.base)}: error "
        f"{trade.error(trade.base):.1e}, {trade.base.cpu_seconds:.3g} CPU s, {trade.base.memory_MB:.0f} MB). *Behind* "
        "is the CPU time over that of the cheapest setting of the front that is as exact."
    )
    yield _table(
        ("dial", "error", "error ×", "CPU ×", "memory ×", "behind", "in words"),
        [
            (
                ", ".join(f"{k.replace('_', ' ')} = {v}" for k, v in e.changes.items()),
                f"{e.error:.1e}",
                f"{e.errors:.3g}",
                f"{e.seconds:.2f}",
                f"{e.memory:.2f}",
                f"{e.behind:.1f}",
                _words(e),
            )
            for e in effects(trade)
        ],
    )
    if failed := [p for p in trade.points if not p.converged]:
        yield "**What did not come out**"
        yield _table(
            ("setting", "status"),
            [(_changes(p, trade), p.status.replace("|", "/")) for p in failed],
        )
    yield "**Errors by source** (relative, of the first output)"
    yield _table(
        ("setting", "all", *SOURCES),
        [(described(p), f"{trade.error(p):.1e}", *map(_part, trade.split(p).values())) for p in _spread(trade)],
    )


def _spread(trade: Trade) -> list[Point]:
    """The settings that are told by source: meshes, orders and precisions at a tight and a loose tolerance."""
    tight = trade.base.dials.tolerance
    own = [p for p in trade.every if p.dials.extrapolated == 1 and not p.dials.model and not p.dials.patches]
    usual = [p for p in own if (p.dials.path_tolerance, p.dials.move, p.dials.steps) == (1e-7, 0.3, 0)]
    plain = [p for p in usual if not p.dials.solver and not p.dials.inner and p.dials.tangent == "reused"]
    return [p for p in plain if p.dials.tolerance in (tight, 1e-4) and p.dials.compiler == trade.base.dials.compiler]


def _changes(point: Point, trade: Trade) -> str:
    return ", ".join(f"{k} = {v}" for k, v in point.dials.changed(trade.base.dials).items())


def _words(e: Effect) -> str:
    """What a change does, in words."""
    costs = e.seconds > 1.15 or e.memory > 1.15
    saves = e.seconds < 0.87 or e.memory < 0.87
    if 0.8 <= e.errors <= 1.25:
        return (
            "costs, and buys nothing" if e.seconds > 1.15 else "saves time at the same error" if saves else "no matter"
        )
    if e.errors < 0.8:
        return f"buys a factor of {1 / e.errors:.3g}" + (
            f" for {e.seconds:.2g} times the time" if costs else " for nothing"
        )
    return f"loses a factor of {e.errors:.3g}" + (
        f" for {e.seconds:.2g} times the time" if saves else " and saves nothing"
    )


def _part(value: float | None) -> str:
    return "–" if value is None else f"{value:.1e}"


def _precision(found: Sequence[Trade]) -> Iterable[str]:
    """float32 and mixed beside float64, over all bodies."""
    rows = []
    for trade in found:
        by_dials = {p.dials: p for p in trade.every}
        for point in trade.points:
            d = point.dials
            if d.precision == "float64" or d.tolerance != trade.base.dials.tolerance:
                continue
            full = by_dials.get(type(d)(**{**vars(d), "precision": "float64"}))
            if full is None:
                continue
            good = point.converged
            rows.append(
                (
                    trade.body.name,
                    described(point),
                    f"{trade.error(full):.1e}",
                    f"{trade.error(point):.1e}" if good else "–",
                    _part(trade.split(point)["precision"]) if good else "–",
                    f"{point.cpu_seconds / full.cpu_seconds:.2f}" if good else "–",
                    point.status.replace("|", "/"),
                )
            )
    if rows:
        yield "## float32, float64, mixed"
        yield _table(("body", "setting", "error in float64", "its error", "of precision", "CPU ×", "status"), rows)


def _table(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    lines = ["| " + " | ".join(header) + " |", "|" + " --- |" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(map(str, row)) + " |" for row in rows])
