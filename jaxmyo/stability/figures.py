"""The figures of `jaxmyo stability`."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Patch

from jaxmyo.paper import style
from jaxmyo.stability.checkerboard import CURE, KINDS, Sheet
from jaxmyo.stability.inf_sup_cases import CURES, NONE, PAIRS, Row
from jaxmyo.stability.maps import Map
from jaxmyo.status import Status

#: A colour for each status: what converges is green, and the rest are as far apart as may be.
COLOURS = ["#7fbf7b", "#404040", "#d73027", "#fdae61", "#4575b4", "#984ea3", "#a65628", "#f781bf", "#ffd92f", "#17becf"]


def inf_sup(path: Path, rows: Sequence[Row]) -> Path:
    """The constants over the number of elements along an edge, a panel for each body."""
    bodies = list(dict.fromkeys(row.body for row in rows))
    figure, axes = style.figure(5.2 * len(bodies), 4.8, len(bodies))
    for ax, body in zip(axes, bodies, strict=True):
        for k, (p, q) in enumerate(PAIRS):
            own = [row for row in rows if (row.body, row.p, row.q) == (body, p, q)]
            cure = (p, q) in CURES
            label = ", ".join(f"{name}: {kind}" for name, kind in (("p", p), ("q", q)) if kind != NONE)
            line = {"lw": 2.4, "ls": "-"} if cure else {"lw": 1.2, "ls": "--" if q == NONE or p == NONE else "-"}
            ax.loglog([r.n for r in own], [r.beta for r in own], marker="o", ms=4, color=f"C{k}", label=label, **line)
        ax.set(title=body, xlabel="elements along an edge n [–]", ylabel="inf-sup constant [–]")
        ticks = sorted({row.n for row in rows if row.body == body})
        ax.set_xticks(ticks, [str(n) for n in ticks])
        ax.minorticks_off()
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right center", fontsize=8)
    return style.save(figure, path)


def checkerboards(path: Path, sheets: Sequence[Sheet]) -> Path:
    """p and q of the sheet on a mesh that shows its elements, one column for each kind of patches."""
    n = sorted({s.n for s in sheets})[:2][-1]
    figure, axes = style.figure(3.6 * len(KINDS), 6.4, len(KINDS), 2)
    chosen = [next(s for s in sheets if (s.kind, s.n) == (kind, n)) for kind in KINDS]
    for row, name in enumerate("pq"):
        # The range of the columns to the right: what goes beyond it oscillates.
        smooth = np.concatenate([getattr(s, name).ravel() for s in chosen[1:]])
        low, high = np.percentile(smooth, [1.0, 99.0])
        for ax, one in zip(axes[row * len(KINDS) :], chosen, strict=False):
            image = ax.imshow(getattr(one, name).T, origin="lower", extent=(0, 10, 0, 10), vmin=low, vmax=high)
            figure.colorbar(image, ax=ax, shrink=0.8, extend="both")
            ax.set_title(f"{name} [kPa], {one.kind}", fontsize=9)
            ax.set(xlabel="x [mm]", ylabel="y [mm]")
    figure.suptitle(f"Contracted sheet of {n} × {n} elements, fibres that turn by up to 60°", fontsize=11)
    return style.save(figure, path)


def roughness(path: Path, sheets: Sequence[Sheet]) -> Path:
    """What alternates in p and q over the number of elements."""
    figure, axes = style.figure(9.6, 4.2, 2)
    for ax, name in zip(axes, "pq", strict=True):
        for kind in KINDS:
            own = [s for s in sheets if s.kind == kind]
            values = [getattr(s, f"rough_{name}") for s in own]
            if max(values) > 1e-12:  # one q has nothing to alternate with
                ax.loglog([s.n for s in own], values, marker="o", lw=2.2 if kind == CURE else 1.2, label=kind)
        ax.set(title=f"alternating part of {name}", xlabel="elements along an edge n [–]", ylabel="rms [kPa]")
        ticks = sorted({s.n for s in sheets})
        ax.set_xticks(ticks, [str(n) for n in ticks])
        ax.minorticks_off()
        ax.legend(fontsize=8)
    return style.save(figure, path)


def status_maps(path: Path, maps: Sequence[Map]) -> Path:
    """A status at each point of every map."""
    columns = 3
    figure, axes = style.figure(5.2 * columns, 4.0 * -(-len(maps) // columns), columns, -(-len(maps) // columns))
    colours, norm = ListedColormap(COLOURS), BoundaryNorm(np.arange(-0.5, len(COLOURS)), len(COLOURS))
    seen = sorted({int(s) for m in maps for s in np.unique(m.status)})
    for ax, one in zip(axes, maps, strict=False):
        ax.pcolormesh(one.x.values, one.y.values, one.status.T, cmap=colours, norm=norm)
        for axis, scale in ((one.x, ax.set_xscale), (one.y, ax.set_yscale)):
            if axis.log:
                scale("log")
            elif np.ptp(axis.values) > 0.0 and axis.values[0] == 0.0 and axis.values[1] < 1e-2:
                scale("symlog", linthresh=axis.values[1])
        ax.set_title(f"{one.title}\n{100.0 * one.converged:.1f} % converge", fontsize=8.5)
        ax.set(xlabel=f"{one.x.name} [{one.x.unit}]", ylabel=f"{one.y.name} [{one.y.unit}]")
    for ax in axes[len(maps) :]:
        ax.axis("off")
    figure.legend(
        handles=[Patch(color=COLOURS[s], label=Status(s).name) for s in seen],
        loc="outside lower center",
        ncols=min(len(seen), 5),
    )
    return style.save(figure, path)
