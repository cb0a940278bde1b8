"""The paper's figures of the tube, and two of how well the elements do: over the weave's stiffness, over the mesh."""

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from jaxmyo.paper import style, tube_weave
from jaxmyo.paper.exact_tube import Pair, Weave
from jaxmyo.paper.homogeneous import CONSTRAINT
from jaxmyo.paper.sample import activation
from jaxmyo.paper.tube import A_OVER_D, KINDS, T0_KPA, Tube, pressure
from jaxmyo.paper.tube_accuracy import PAPER_ERROR, Accuracy
from jaxmyo.paper.tube_weave import K_KPA, LINE_KPA, WEAVES, SoftWeave
from jaxmyo.scenes.tube import RI, RO

RED, BLUE, GREEN, GREY, PURPLE = "#b2182b", "#2166ac", "#1b7837", "0.45", "#762a83"
BETA = "degree of activation β [–]"


def case(name: str) -> str:
    """What all figures of the tube are for."""
    return f"T0 = {T0_KPA:g} kPa, a/D = {A_OVER_D:g}, constants: {name}"


def pressure_and_tonus(path: Path, name: str, tube: Tube) -> Path:
    """Pressure and beating tension over the cycle, and with the pseudo-active tensions against β, as a PNG file."""
    figure, (left, right) = style.figure(9.6, 4.6, 2)
    beta, up = activation(tube.s), slice(0, tube.ends[1] + 1)
    for ax, x, at in ((left, tube.s, slice(None)), (right, beta, up)):
        ax.plot(x[at], pressure(beta[at]), color=RED, lw=1.6, label="inner pressure P")
        ax.plot(x[at], T0_KPA * beta[at], color=BLUE, lw=1.6, ls="--", label="tonus β T0")
        ax.axhline(0.0, color="0.8", lw=0.8, zorder=0)
        ax.set(ylabel="pressure and tension [kPa]", xlim=(-0.02, 1.04), ylim=(-2.0, 19.0))
    style.curve(right, beta[up], tube.A.T_cf[0, up, 0], GREEN, "s", True, "T_cf of the weave")
    style.curve(right, beta[up], tube.A.T_f[0, up, 0], GREY, "o", True, "T_f of the weave, inner wall", (0, 2))
    style.curve(right, beta[up], tube.A.T_f[0, up, 1], PURPLE, "^", True, "T_f of the weave, outer wall", (1, 2))
    left.set_xlabel("time in the cycle s [–]")
    right.set_xlabel(BETA)
    figure.suptitle(f"Pressure and tonus of the tube, {case(name)}", fontsize=style.LABEL_SIZE)
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    return style.save(figure, path)


def height(path: Path, name: str, tube: Tube) -> Path:
    """Height of the tube under pressure against β, as a PNG file."""
    return _against_beta(path, f"Height of the tube, {case(name)}", "height ratio λz [–]", tube, tube.C.height, GREEN)


def inner_radius(path: Path, name: str, tube: Tube) -> Path:
    """Inner radius of the tube under pressure against β, as a PNG file."""
    return _against_beta(path, f"Inner radius of the tube, {case(name)}", "inner radius [mm]", tube, tube.C.ri, RED)


def outer_radius(path: Path, name: str, tube: Tube) -> Path:
    """Outer radius of the tube under pressure against β, as a PNG file."""
    return _against_beta(path, f"Outer radius of the tube, {case(name)}", "outer radius [mm]", tube, tube.C.ro, BLUE)


def _against_beta(path: Path, title: str, label: str, tube: Tube, values: Any, colour: str) -> Path:
    """values: constraint × time; the way up, with which the way down coincides."""
    figure, (ax,) = style.figure(7.2, 4.6, 1)
    half = tube.ends[1]
    beta = activation(tube.s)[: half + 1]
    for c, acting in enumerate(CONSTRAINT):
        coupling = f"{'with' if acting else 'without'} coupling"
        style.curve(ax, beta, values[c, : half + 1], colour, "o", acting, coupling)
    style.arrow(ax, 1.0, values[1, half], values[0, half], colour)
    ax.set(xlabel=BETA, ylabel=label, xlim=(-0.02, 1.04))
    ax.set_title(title)
    ax.legend(frameon=False)
    return style.save(figure, path)


def weave(path: Path, name: str, soft: Sequence[SoftWeave], lines: Mapping[Weave, Sequence[Pair]], limit: Pair) -> Path:
    """Radii at s = ½ against the stiffness of the weave, as a PNG file.

    lines: the exact states with q uniform and with q at every radius; limit: those of the exact constraint.
    """
    figure, axes = style.figure(9.6, 7.2, 2, 2)
    for ax, (outer, kind) in zip(axes, product((True, False), KINDS), strict=True):
        uniform, local = (tube_weave.radii([pair.of(kind) for pair in lines[w]])[outer] for w in WEAVES)
        ax.plot(LINE_KPA, uniform, color=BLUE, lw=1.4, label="exact, one q for the wall")
        ax.plot(LINE_KPA, local, color=RED, ls="--", lw=1.4, label="exact, its own q at every radius")
        at = limit.of(kind).ro if outer else limit.of(kind).ri
        ax.axhline(at, color=GREEN, lw=1.2, ls=":", label="exact, one q for the wall, k → ∞")
        for mesh, marker, size in zip(soft, ("^", "o"), (5.0, 8.0), strict=True):
            radii = mesh.walls(kind).ro if outer else mesh.walls(kind).ri
            label = f"{mesh.elements} elements, one q in each"
            ax.plot(K_KPA, radii, ls="none", marker=marker, ms=size, mfc="none", mec="k", label=label)
        if kind == "A":
            ax.axhline(RO if outer else RI, color="0.6", lw=0.8, ls="-.", label="undeformed")
        ax.set(xscale="log", ylabel=f"{'outer' if outer else 'inner'} radius [mm]")
        if outer:
            ax.set_title("state A, free contraction" if kind == "A" else f"state C, P = {pressure(1.0):g} kPa")
        else:
            ax.set_xlabel("stiffness k of the weave [kPa]")
    figure.suptitle(f"The tube at s = ½ with a weave of finite stiffness, {case(name)}", fontsize=style.LABEL_SIZE)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    return style.save(figure, path)


def accuracy(path: Path, name: str, found: Accuracy) -> Path:
    """Relative L2 error of the radii at s = ½ against the number of elements, as a PNG file."""
    figure, (ax,) = style.figure(7.2, 4.8, 1)
    n = np.array([tube.elements for tube in found.tubes])
    beyond = 1.5 * n[-1]
    for (i, kind), (c, acting) in product(enumerate(KINDS), enumerate(CONSTRAINT)):
        # The errors with and without the coupling are close: large open symbols around small full ones.
        look = {"marker": "os"[i], "color": (RED, BLUE)[i], "lw": 1.2, "ms": 9 if acting else 5}
        look["mfc"] = "none" if acting else look["color"]
        ax.plot(n, found.raw[:, i, c, 1], **look, label=f"{kind}, {'with' if acting else 'without'} coupling")
        ax.plot([beyond], found.extrapolated[i, c, 1:], **look)
    middle = np.exp(np.log(found.raw[0, :, :, 1]).mean())
    ax.plot(n, middle * (n[0] / n) ** 2.0, color="0.6", lw=1.0, ls="--", label="order 2")
    ax.axhline(PAPER_ERROR, color="0.6", lw=1.0, ls=":", label=f"the paper's {PAPER_ERROR:.0e}")
    ax.set(xscale="log", yscale="log", xlabel="elements through the wall", ylabel="relative L2 error of the radii [–]")
    ax.set_xticks([*n, beyond], [*map(str, n), "extrapolated\nin h²"])
    ax.minorticks_off()
    ax.set_title(f"Error of the tube at s = ½, {case(name)}")
    figure.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    return style.save(figure, path)
