"""Figures of the trade: error against time with the front, and errors by source over the meshes."""

from pathlib import Path
from typing import Any

from matplotlib.ticker import NullFormatter

from jaxmyo.paper import style
from jaxmyo.tradeoff.errors import SOURCES
from jaxmyo.tradeoff.measure import Point
from jaxmyo.tradeoff.trade import Trade

COLOURS = {"float64": "#2166ac", "float32": "#b2182b", "mixed": "#1b7837"}
OF_SOURCES = dict(zip(SOURCES, (("#2166ac", "o"), ("#e08214", "s"), ("#1b7837", "^"), ("#b2182b", "v")), strict=True))
_FLOOR = 1e-16


def draw(path: Path, trade: Trade) -> Path:
    """Two panels as a PNG file."""
    figure, (left, right) = style.figure(12.0, 5.0, 2)
    _front(left, trade)
    _sources(right, trade)
    figure.suptitle(trade.body.title, fontsize=11)
    return style.save(figure, path)


def _front(ax: Any, trade: Trade) -> None:
    for precision, colour in COLOURS.items():
        own = [p for p in trade.every if p.dials.precision == precision]
        for several, marker in ((False, "o"), (True, "D")):
            some = [p for p in own if (p.dials.extrapolated > 1) == several]
            if some:
                label = f"{precision}, extrapolated" if several else precision
                x, y = [p.cpu_seconds for p in some], [trade.error(p) for p in some]
                ax.plot(x, y, marker, ms=4.5, mfc="white" if several else colour, mec=colour, alpha=0.6, label=label)
    front = trade.front
    x, y = [p.cpu_seconds for p in front], [trade.error(p) for p in front]
    ax.plot(x, y, "-", color="black", lw=1.4, drawstyle="steps-post", label="front")
    ax.plot([trade.base.cpu_seconds], [trade.error(trade.base)], "k+", ms=12, label="base")
    name, _ = trade.body.outputs[0]
    ax.set(xscale="log", yscale="log", xlabel="warm solve [CPU s]", ylabel=f"relative error of the {name} [–]")
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.legend(frameon=False, fontsize=8)
    _label(ax, [(x, y, _name(p)) for x, y, p in zip(x, y, front, strict=True)])


def _label(ax: Any, points: list[tuple[float, float, str]]) -> None:
    """Labels left of the front, where there is nothing; the report has those that would lie on the one above."""
    ax.set_xlim(left=0.3 * points[0][0])
    last = float("inf")
    for x, y, label in points:
        height = ax.transData.transform((x, y))[1] / ax.figure.dpi * 72.0  # points, of which the letters have 7
        if last - height > 8.0:
            place = {"xytext": (-4, 0), "textcoords": "offset points", "ha": "right", "va": "center"}
            ax.annotate(label, (x, y), fontsize=7, **place)
            last = height


def _name(point: Point) -> str:
    d = point.dials
    meshes = "+".join(str(d.elements // 2**k) for k in reversed(range(d.extrapolated)))
    return f"{meshes}, {d.tolerance:.0e}" + ("" if d.quadrature == 2 else f", {d.quadrature} pts")


def _sources(ax: Any, trade: Trade) -> None:
    """Each source at its worst over the settings of a mesh; algebra for a tolerance of 1e-4."""
    found: dict[str, dict[int, float]] = {source: {} for source in SOURCES}
    for p in trade.points:
        if not p.converged or p not in trade.every or p.dials.model or p.dials.patches:
            continue
        if p.dials.tolerance not in (1e-4, trade.base.dials.tolerance):
            continue
        for source, value in trade.split(p).items():
            if value is not None and value > _FLOOR:
                at = found[source]
                at[p.dials.elements] = max(at.get(p.dials.elements, 0.0), value)
    labels = {"quadrature": "quadrature, worst", "algebra": "algebra, tolerance 1e-4", "precision": "precision, worst"}
    for source, by_mesh in found.items():
        if by_mesh:
            colour, marker = OF_SOURCES[source]
            n = sorted(by_mesh)
            label = labels.get(source, source)
            ax.plot(n, [by_mesh[k] for k in n], marker=marker, color=colour, lw=1.2, ms=5, label=label)
    ax.set(xscale="log", yscale="log", xlabel="elements along the refined direction", ylabel="part of the error [–]")
    meshes = sorted({n for by_mesh in found.values() for n in by_mesh})
    ax.set_xticks(meshes, labels=list(map(str, meshes)))
    ax.xaxis.set_minor_formatter(NullFormatter())
    if ax.get_legend_handles_labels()[0]:
        ax.legend(frameon=False, fontsize=8)
