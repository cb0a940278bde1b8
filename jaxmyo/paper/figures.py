"""The paper's figures of the thin sample."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmyo.paper import style
from jaxmyo.paper.homogeneous import CONSTRAINT
from jaxmyo.paper.sample import A_OVER_D, HALF, T0_KPA, S, Sample

COLOURS = {"f": "#b2182b", "cf": "#2166ac", "cf'": "#1b7837"}
ARROW = 1.2  # the stretch at which arrows show what the coupling does to an active curve
MARKERS = {"f": "o", "cf": "s", "cf'": "^"}


def free_contraction(path: Path, name: str, sample: Sample) -> Path:
    """Stretches of the free contraction over the cycle, β = sin² πs, as a PNG file."""
    figure, axes = style.figure(7.2, 4.6, 1)
    (ax,) = axes
    stretches = sample.free.stretches  # constraint × s × (f, cf, cf')
    for i, direction in enumerate(COLOURS):
        for c, acting in enumerate(CONSTRAINT):
            # Without the constraint the two transverse stretches are the same: their symbols take turns.
            every = (i % 2, 2) if i and not acting else (0, 1)
            label = f"({direction}) {'with' if acting else 'without'} coupling"
            _curve(ax, S, stretches[c, :, i], direction, acting, label, every)
        style.arrow(ax, S[HALF], stretches[1, HALF, i], stretches[0, HALF, i], COLOURS[direction])
    ax.axhline(1.0, color="0.8", lw=0.8, zorder=0)
    ax.set(xlabel="time in the cycle s [–]", ylabel="stretch λ [–]", xlim=(0, 1))
    ax.set_title(f"Free contraction, β = sin² πs, T0 = {T0_KPA:g} kPa, a/D = {A_OVER_D:g}, constants: {name}")
    figure.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    return style.save(figure, path)


def uniaxial(path: Path, name: str, sample: Sample) -> Path:
    """Cauchy stress of the active and the passive uniaxial tests against the stretch, as a PNG file."""
    figure, axes = style.figure(9.6, 5.0, 2)
    for b, (ax, kind) in enumerate(zip(axes, ("active, β = 1", "passive, β = 0"), strict=True)):
        for i, direction in enumerate(("f", "cf")):
            for c, acting in enumerate(CONSTRAINT):
                x, y, unstable = sample.stretch[i, c, b], sample.stress[i, c, b], sample.unstable[i, c, b]
                label = f"({direction}) {'with' if acting else 'without'} coupling" if b == 0 else None
                # The passive curves coincide: their symbols take turns.
                _curve(ax, x, y, direction, acting, label, (4 * c, 8) if b else (0, 4))
                if unstable.any() and acting:
                    ax.plot(x[unstable], y[unstable], color="0.87", lw=11, zorder=0, label="unstable equilibrium")
            if b == 0:
                ends = [np.interp(ARROW, sample.stretch[i, c, b], sample.stress[i, c, b]) for c in (0, 1)]
                style.arrow(ax, ARROW, ends[1], ends[0], COLOURS[direction])
        ax.axhline(0.0, color="0.8", lw=0.8, zorder=0)
        ax.axvline(1.0, color="0.8", lw=0.8, zorder=0)
        ax.set(xlabel="stretch λ in the direction of the test [–]", ylabel="Cauchy stress σ in that direction [kPa]")
        ax.set_title(kind)
    handles, labels = axes[0].get_legend_handles_labels()
    marked = dict(zip(*reversed(axes[1].get_legend_handles_labels()), strict=True))
    figure.suptitle(f"Uniaxial tests, T0 = {T0_KPA:g} kPa, a/D = {A_OVER_D:g}, constants: {name}", fontsize=11)
    figure.legend([*handles, *marked.values()], [*labels, *marked], loc="outside lower center", ncols=3, frameon=False)
    return style.save(figure, path)


def _curve(
    ax: Any,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    direction: str,
    acting: bool,
    label: str | None,
    every: tuple[int, int],
) -> None:
    style.curve(ax, x, y, COLOURS[direction], MARKERS[direction], acting, label, every)
