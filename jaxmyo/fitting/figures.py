"""A figure of data and fit: a panel per protocol, stress against strain, open symbols for what was measured."""

from pathlib import Path
from typing import Any

import numpy as np

from jaxmyo.data import AXES, MODES, Data
from jaxmyo.fitting.fit import Fit
from jaxmyo.fitting.sample import columns_of
from jaxmyo.paper import style

COLOURS = ("#b2182b", "#2166ac", "#1b7837", "#762a83", "#e08214", "#01665e", "#c51b7d", "#4d4d4d", "#8c510a")
MARKERS = "osD^v<>ph"


def data_and_fit(path: Path, data: Data, found: Fit, title: str) -> Path:
    """The measured numbers, and the predictions of the fit, as a PNG file."""
    row, what = columns_of(data)
    names = list(data.protocols)
    n_columns = min(len(names), 3)
    figure, axes = style.figure(
        4.6 * n_columns, 4.2 * -(-len(names) // n_columns), n_columns, -(-len(names) // n_columns)
    )
    of_row = np.array(data.protocol)[row]
    for name, ax in zip(names, axes, strict=False):
        for k in np.unique(what[of_row == name]):
            at = np.flatnonzero((of_row == name) & (what == k))
            x, label = _abscissa(data, row[at], int(k))
            order = np.argsort(x)
            observed, predicted = found.problem.observed[at], np.asarray(found.found.predicted)[at]
            colour = COLOURS[int(k) % len(COLOURS)]
            ax.plot(x, observed, MARKERS[int(k) % 9], color=colour, mfc="white", ms=4.5, label=f"{label}, measured")
            ax.plot(x[order], predicted[order], "-", color=colour, lw=1.4, label=f"{label}, fit")
        measure = "/".join(dict.fromkeys(m for m, p in zip(data.measure, data.protocol, strict=True) if p == name))
        sheared = not np.isnan(data.shear[np.array(data.protocol) == name]).all()
        ax.set(
            xlabel="amount of shear [–]" if sheared else "stretch along the direction [–]",
            ylabel={"cauchy": "Cauchy", "nominal": "nominal", "pk2": "second Piola–Kirchhoff"}.get(measure, measure)
            + " stress [kPa]",
        )
        ax.set_title(f"{name}: rms {found.rms_of(name):.3g} {found.problem.unit}")
        ax.legend(frameon=False, fontsize=9)
    for ax in axes[len(names) :]:
        ax.set_visible(False)
    figure.suptitle(title, fontsize=11)
    return style.save(figure, path)


def _abscissa(data: Data, rows: Any, k: int) -> tuple[Any, str]:
    """Against what an observation is drawn, and what it is called; k: which of 9 stresses and 3 stretches."""
    if k >= 9:
        return data.stress[rows, k - 9], f"stretch {AXES[k - 9]}"
    if k >= 3:
        return data.shear[rows, k - 3], MODES[k - 3]
    shear = data.shear[rows]
    if not np.isnan(shear).all():
        return np.nansum(shear, axis=1), f"normal stress {AXES[k]}"
    return data.stretch[rows, k], {"f": "fibre", "cf": "cross-fibre", "n": "normal"}[AXES[k]]


def residuals(path: Path, found: Fit, title: str, limit: float) -> Path:
    """Every residual in the order of the observations, with a limit on both sides, as a PNG file."""
    figure, axes = style.figure(7.2, 3.8, 1)
    (ax,) = axes
    groups = np.array(found.problem.groups)
    for g, colour in zip(dict.fromkeys(found.problem.groups), COLOURS, strict=False):
        at = np.flatnonzero(groups == g)
        ax.plot(at + 1, found.residuals[at], "o", color=colour, mfc="white", label=g)
    for side in (-1, 1):
        ax.axhline(side * limit, color="0.6", lw=0.8, ls="--", label=f"± {limit:g}: rounding" if side > 0 else None)
    ax.axhline(0.0, color="0.8", lw=0.8, zorder=0)
    ax.set(xlabel="entry", ylabel=f"fitted less printed [{found.problem.unit}]")
    ax.set_title(title)
    ax.legend(frameon=False, fontsize=9, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return style.save(figure, path)
