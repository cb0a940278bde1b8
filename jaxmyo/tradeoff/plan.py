"""Which settings of which body are measured: one dial at a time around a base, and small grids for the front."""

from dataclasses import replace
from itertools import product
from typing import Any

from jaxmyo.tradeoff.dials import Dials, Precision

TOLERANCES = (1e-13, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2)
_FEW = (1e-13, 1e-8, 1e-4)
_STEPS: list[dict[str, Any]] = [{"move": 0.1}, {"move": 1.0}, {"path_tolerance": 1e-4}, {"path_tolerance": 1e-2}]
_STEPS += [{"steps": n} for n in (16, 32)]

#: The setting that the others of a body are compared with. In three dimensions small bodies run tens of times as long
#: as they need where they are compiled quickly.
BASE = {
    "sample": Dials(elements=1),
    "radial": Dials(elements=16),
    "axisymmetric": Dials(elements=8),
    "sector": Dials(elements=4, compiler="default"),
    "block": Dials(elements=8),
    "helix": Dials(elements=16),
}
QUICK_BASE = {
    "sample": Dials(elements=1),
    "radial": Dials(elements=8),
    "axisymmetric": Dials(elements=4),
    "sector": Dials(elements=2, compiler="default"),
    "block": Dials(elements=4, compiler="default"),
    "helix": Dials(elements=8),
}
#: Meshes, each twice as fine as the one before, whose extrapolation is exact enough where there is no exact solution.
FINEST = {"block": (8, 16, 32)}
QUICK_FINEST = {"block": (4, 8, 16)}


def plan(body: str, quick: bool) -> list[Dials]:
    """The settings of a body; the base is among them."""
    return (_quick if quick else _full)(body)


def _at(base: Dials, *changes: dict[str, Any]) -> list[Dials]:
    return [replace(base, **change) for change in changes]


def _grid(
    base: Dials, elements: tuple[int, ...], orders: tuple[int, ...], precisions: tuple[Precision, ...]
) -> list[Dials]:
    """Every mesh with every quadrature, precision and tolerance."""
    every = product(elements, orders, precisions, TOLERANCES)
    return [replace(base, elements=n, quadrature=q, precision=p, tolerance=t) for n, q, p, t in every]


def _meshes(base: Dials, elements: tuple[int, ...], tolerances: tuple[float, ...] = _FEW) -> list[Dials]:
    return [replace(base, elements=n, tolerance=t) for n, t in product(elements, tolerances)]


def _quick(body: str) -> list[Dials]:
    base = QUICK_BASE[body]
    few = _meshes(base, (base.elements,), (1e-13, 1e-4))
    if body == "radial":
        return [*_meshes(base, (4, 8)), *_at(base, *_STEPS[:2], {"precision": "float32"})]
    if body == "block":
        return [*few, *_meshes(base, (8, 16), (1e-13,))]
    return few


def _full(body: str) -> list[Dials]:
    base = BASE[body]
    if body == "sample":
        small = _meshes(base, (1,), TOLERANCES)
        precise = _at(base, {"precision": "float32"}, {"precision": "mixed"})
        return [*small, *_at(base, *_STEPS), *precise, *_at(base, {"model": "3-D"}, {"model": "3-D", "elements": 2})]
    if body == "radial":
        models: list[dict[str, Any]] = [{"model": name, "elements": 8} for name in ("2-D", "3-D, r φ z", "3-D, x y z")]
        patched: list[dict[str, Any]] = [
            {"patches": "q: one per element"},
            {"patches": "q: pairs along r"},
            {"patches": "p: pairs along r"},
        ]
        return [
            *_grid(base, (4, 8, 16), (1, 2), ("float64", "float32", "mixed")),
            *_grid(base, (32,), (2,), ("float64", "float32", "mixed")),
            *_meshes(base, (64,), TOLERANCES),
            *_at(base, {"quadrature": 3}, {"compiler": "default"}, {"grading": 3.0}),
            *_meshes(replace(base, grading=8.0), (8, 16, 32, 64)),
            *_at(base, *_STEPS, *models, *patched),
        ]
    if body == "axisymmetric":
        return [*_meshes(base, (4, 8, 16)), *_at(base, {"quadrature": 3}, {"precision": "float32"})]
    if body == "sector":
        others: list[dict[str, Any]] = [
            {"solver": "SuperLU"},
            {"solver": "Pardiso, float64"},
            {"patches": "p: blocks"},
            {"quadrature": 1},
            {"precision": "float32"},
            {"precision": "mixed"},
        ]
        grid = [replace(base, elements=n, quadrature=q, tolerance=t) for n, q, t in product((2, 4, 8), (2, 3), _FEW)]
        return [*grid, *_at(base, *_STEPS[:3], *others)]
    if body == "block":
        solvers: list[dict[str, Any]] = [{"solver": s} for s in ("Pardiso, float64", "SuperLU", "multigrid")]
        inner: list[dict[str, Any]] = [{"inner": x} for x in (1e-2, 1e-4, 1e-9)]
        fine = replace(base, elements=16)
        return [
            *_meshes(base, (4, 8, 16), TOLERANCES),
            *_meshes(base, (32,), (1e-13,)),
            *_at(base, {"quadrature": 1}, {"quadrature": 3}, *_STEPS[:4], {"patches": "p: blocks"}, *inner),
            *_at(base, *solvers, {"tangent": "new"}),
            *_at(fine, *solvers, *inner, {"tangent": "new"}),
        ]
    orders = _at(replace(base, elements=8), {"quadrature": 1}, {"quadrature": 3}, {"precision": "float32"})
    return [*_meshes(base, (4, 8, 16, 32), TOLERANCES), *orders, *_at(base, *_STEPS)]
