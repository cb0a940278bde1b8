"""What the figures have in common. Open symbols: the coupling by the weave acts; full symbols: it does not."""

from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

DPI = 200
LABEL_SIZE = 11


def figure(width: float, height: float, columns: int, rows: int = 1) -> tuple[Figure, list[Any]]:
    """A figure of so many inches, and its axes row by row."""
    new = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(new)
    axes = list(new.subplots(rows, columns, squeeze=False).flat)
    for ax in axes:
        ax.spines[["top", "right"]].set_visible(False)
        ax.title.set_fontsize(LABEL_SIZE)
    return new, axes


def curve(
    ax: Any,
    x: NDArray[Any],
    y: NDArray[Any],
    colour: str,
    marker: str,
    acting: bool,
    label: str | None,
    every: tuple[int, int] = (0, 1),
) -> None:
    """A line with symbols at every so many points: open if the coupling acts."""
    face = "white" if acting else colour
    ax.plot(x, y, color=colour, lw=1.2, marker=marker, ms=5.5, mfc=face, mec=colour, markevery=every, label=label)


def arrow(ax: Any, x: float, start: float, end: float, colour: str) -> None:
    """From the curve without the coupling to the one with it, as in the paper."""
    style = {"arrowstyle": "->", "color": colour, "lw": 1.4, "shrinkA": 6, "shrinkB": 6}
    ax.annotate("", (x, end), (x, start), arrowprops=style)


def save(figure: Figure, path: Path) -> Path:
    """The figure as a PNG file."""
    figure.savefig(path, dpi=DPI, metadata={"Software": "jaxmyo"})
    return path
