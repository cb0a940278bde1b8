"""Errors of measured outputs: against the truth, by their source, and of meshes that are extrapolated to h = 0.

The sources are told by settings that differ in one dial, on one and the same mesh:
    discretisation  exact algebra in float64 with the highest quadrature there is, against the truth
    quadrature      against the highest order of the same mesh
    algebra         against the tightest tolerance
    precision       against float64
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxmyo.extrapolation import neville
from jaxmyo.tradeoff.dials import Dials
from jaxmyo.tradeoff.measure import Point

#: Relative errors below this are round-off: they tell nothing of a setting [–].
ROUND_OFF = 1e-13

SOURCES = ("discretisation", "quadrature", "algebra", "precision")


@dataclass(frozen=True)
class Truth:
    """What the outputs of a body are; doubt: how far they may be off themselves, relative [–]; source: in words."""

    outputs: tuple[float, ...]
    doubt: tuple[float, ...]
    source: str


def relative(outputs: Sequence[float], true: Sequence[float]) -> tuple[float, ...]:
    """|x − true| / |true| [–] of each output."""
    return tuple(abs(x - t) / abs(t) for x, t in zip(outputs, true, strict=True))


def error(point: Point, truth: Truth, output: int = 0) -> float:
    """The relative error [–] of an output, not below round-off."""
    assert point.outputs is not None
    return max(relative(point.outputs, truth.outputs)[output], ROUND_OFF)


def counted(point: Point, points: Sequence[Point], truth: Truth, output: int = 0) -> float:
    """The relative error [–] that a setting is answerable for: errors of different sources may cancel by luck.

    The error with exact algebra in float64, plus what algebra and precision change, if that is more than the error.
    """
    by_dials = {p.dials: p for p in points if p.converged}
    d, own = point.dials, error(point, truth, output)
    tight = min((x.tolerance for x in by_dials), default=d.tolerance)
    plain = by_dials.get(_plain(d, tight))
    if plain is None or plain.outputs is None or point.outputs is None:
        return own
    off = abs(point.outputs[output] - plain.outputs[output]) / abs(truth.outputs[output])
    return max(own, error(plain, truth, output) + off) if off > ROUND_OFF else own


def extrapolated(points: Sequence[Point], most: int = 3) -> list[Point]:
    """Extrapolations over two, ... meshes, each twice as fine as the one before, with all other dials the same.

    The error of an output of Q1–Q0 elements on meshes of one family has an expansion in h². The solves follow one
    another: seconds add up, of memory the largest counts.
    """
    by_dials = {p.dials: p for p in points if p.converged}
    found = []
    for dials, point in by_dials.items():
        parts = [point]
        while len(parts) < most and dials.elements % 2 ** len(parts) == 0:
            coarser = by_dials.get(replace(dials, elements=dials.elements // 2 ** len(parts)))
            if coarser is None:
                break
            parts = [coarser, *parts]
            found.append(_joined(parts))
    return found


def _joined(parts: Sequence[Point]) -> Point:
    finest = parts[-1]
    limits = neville([p.outputs or () for p in parts], [1.0 / p.dials.elements for p in parts])
    return replace(
        finest,
        dials=replace(finest.dials, extrapolated=len(parts)),
        outputs=tuple(map(float, limits)),
        seconds=sum(p.seconds for p in parts),
        cpu_seconds=sum(p.cpu_seconds for p in parts),
        cold_seconds=sum(p.cold_seconds for p in parts),
        cold_cpu_seconds=sum(p.cold_cpu_seconds for p in parts),
        memory_MB=max(p.memory_MB for p in parts),
        steps=sum(p.steps for p in parts),
        iterations=sum(p.iterations for p in parts),
        parts=tuple(parts),
    )


def finest(points: Sequence[Point], base: Dials, meshes: Sequence[int]) -> Truth:
    """The truth by extrapolation of three meshes, each twice as fine as the one before, by the order that they show.

    doubt: the difference from the limit that the second order would give. Of an output other than the first that shows
    no order, the truth is what the finest mesh gives, and the doubt its last change.
    """
    by_dials = {p.dials: p for p in points if p.converged}
    missing = [n for n in meshes if replace(base, elements=n) not in by_dials]
    if missing:
        raise ValueError(f"the meshes of {missing} elements did not converge: there is no truth to compare with")
    values = zip(*(by_dials[replace(base, elements=n)].outputs or () for n in meshes), strict=True)
    limits, doubts, orders = [], [], []
    for a, b, c in values:
        ratio = (b - a) / (c - b) if c != b else np.inf
        if ratio > 1.0:
            limits.append(c + (c - b) / (ratio - 1.0))
            doubts.append(abs(limits[-1] - (c + (c - b) / 3.0)) / abs(limits[-1]))
            orders.append(f"{np.log2(ratio):.2f}")
        elif limits:
            limits.append(c)
            doubts.append(abs(c - b) / abs(c))
            orders.append("none")
        else:
            raise ValueError(f"the output on meshes of {tuple(meshes)} elements does not converge: {a}, {b}, {c}")
    shown = ", ".join(orders)
    words = (
        f"extrapolated from {', '.join(map(str, meshes))} elements along an edge, by the orders that they show: {shown}"
    )
    return Truth(tuple(map(float, limits)), tuple(map(float, doubts)), words)


def split(point: Point, points: Sequence[Point], truth: Truth) -> dict[str, float | None]:
    """The error of the first output [–] by source; None where the setting that would tell it was not measured."""
    by_dials = {p.dials: p for p in points if p.converged}
    d = point.dials
    tight = min((x.tolerance for x in by_dials), default=0.0)
    orders = [x.quadrature for x in by_dials if replace(x, quadrature=0) == replace(_plain(d, tight), quadrature=0)]

    def apart(x: Dials, y: Dials) -> float | None:
        a, b = by_dials.get(x), by_dials.get(y)
        if a is None or b is None or a.outputs is None or b.outputs is None:
            return None
        return abs(a.outputs[0] - b.outputs[0]) / abs(truth.outputs[0])

    plain = _plain(d, tight)
    best = replace(plain, quadrature=max(orders, default=d.quadrature))
    exact = by_dials.get(best)
    return {
        "discretisation": None if exact is None else error(exact, truth),
        "quadrature": apart(plain, best) if len(orders) > 1 else None,
        "algebra": apart(d, replace(d, tolerance=tight)),
        "precision": apart(d, replace(d, precision="float64")) if d.precision != "float64" else 0.0,
    }


def _plain(dials: Dials, tolerance: float) -> Dials:
    """The same mesh and quadrature with exact algebra."""
    return replace(dials, tolerance=tolerance, precision="float64")
