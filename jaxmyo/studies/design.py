"""Where a study evaluates: a grid, or a sample of points, over named parameters.

Both kinds of design have: kind, how the points came about; axes, name → values, in the order of the dimensions; fixed,
the parameters with one value; dims, name and length of each dimension of the result; points, the coordinates of flat
indices, of which the last dimension runs fastest.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxmyo import checks

Numbers = NDArray[np.float64]


@dataclass(frozen=True)
class Grid:
    """Every combination of the values of each axis. A number instead of an axis is a parameter that stays."""

    values: Mapping[str, ArrayLike]
    kind: str = field(default="grid", init=False)
    axes: dict[str, Numbers] = field(init=False, repr=False)
    fixed: dict[str, float] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        _set_axes(self, "axes", self.values)

    @property
    def dims(self) -> dict[str, int]:
        """The axes."""
        return {name: len(values) for name, values in self.axes.items()}

    def points(self, index: NDArray[np.int64]) -> dict[str, Numbers]:
        """Coordinates (n,) of the points of these indices, by name."""
        if not self.axes:
            return _fixed(self, len(index))
        every = np.unravel_index(index, tuple(self.dims.values()))
        return {name: x[i] for (name, x), i in zip(self.axes.items(), every, strict=True)} | _fixed(self, len(index))


@dataclass(frozen=True)
class Sample:
    """Points one by one: name → coordinates (n,), all of one length. A number is a parameter that stays.

    `sobol_sample` and `saltelli_sample` draw such points; measured or hand-made ones are as good.
    """

    values: Mapping[str, ArrayLike]
    kind: str = "points"
    axes: dict[str, Numbers] = field(init=False, repr=False)
    fixed: dict[str, float] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        _set_axes(self, "sample", self.values)
        lengths = {name: len(x) for name, x in self.axes.items()}
        if len(set(lengths.values())) != 1:
            raise ValueError(f"sample: its coordinates must be arrays of one length; they have {lengths or 'none'}")

    @property
    def dims(self) -> dict[str, int]:
        """One dimension, "sample"."""
        return {"sample": len(next(iter(self.axes.values())))}

    def points(self, index: NDArray[np.int64]) -> dict[str, Numbers]:
        """Coordinates (n,) of the points of these indices, by name."""
        return {name: x[index] for name, x in self.axes.items()} | _fixed(self, len(index))


Design = Grid | Sample


def sobol_sample(ranges: Mapping[str, Any], n: int, seed: int = 0) -> Sample:
    """n = 2^m points of a scrambled Sobol sequence, uniform in the ranges (name → (low, high); a number stays).

    Owen 1998, J Complexity 14:466–489, by `scipy.stats.qmc.Sobol`.
    """
    low, high, fixed = _box(ranges)
    x = _scaled(_unit_points(len(low), n, seed), low, high)
    return Sample({**dict(zip(low, x.T, strict=True)), **fixed}, "sobol")


def saltelli_sample(ranges: Mapping[str, Any], n: int, seed: int = 0) -> Sample:
    """The (d + 2) n points from which `Study.sobol_indices` estimates variances; n = 2^m, d ranges.

    Two independent samples A and B (n points each), then for each parameter A with that parameter from B (Saltelli et
    al. 2010, Comput Phys Commun 181:259–270). Ranges as in `sobol_sample`.
    """
    low, high, fixed = _box(ranges)
    d = len(low)
    unit = _unit_points(2 * d, n, seed)
    A, B = unit[:, :d], unit[:, d:]
    blocks = [A, B]
    for i in range(d):
        mixed = A.copy()
        mixed[:, i] = B[:, i]
        blocks.append(mixed)
    x = _scaled(np.concatenate(blocks), low, high)
    return Sample({**dict(zip(low, x.T, strict=True)), **fixed}, "saltelli")


def as_design(axes: Any) -> Design:
    """A mapping is a grid."""
    if isinstance(axes, Grid | Sample):
        return axes
    if not isinstance(axes, Mapping):
        raise TypeError(f"axes must be a mapping from names of parameters to values, or a Sample; got {axes!r}")
    return Grid(axes)


def size(design: Design) -> int:
    """The number of points."""
    return int(np.prod(list(design.dims.values()), dtype=np.int64))


def _set_axes(design: Design, what: str, values: Mapping[str, ArrayLike]) -> None:
    axes: dict[str, Numbers] = {}
    fixed: dict[str, float] = {}
    if not values:
        raise ValueError(f"{what} is empty: name at least one parameter")
    for name, given in values.items():
        if not isinstance(name, str) or not name.isidentifier():
            raise ValueError(f"{what}: the name of a parameter must be a word, as 'T0'; got {name!r}")
        full = f"{what}[{name!r}]"
        x = checks.concrete(full, given, () if np.ndim(given) == 0 else (None,))
        if not x.size:
            raise ValueError(f"{full} is empty: give at least one value")
        check_range(full, name, x)
        if x.ndim:
            axes[name] = x.copy()
            axes[name].flags.writeable = False
        else:
            fixed[name] = float(x)
    object.__setattr__(design, "axes", axes)
    object.__setattr__(design, "fixed", fixed)


def check_range(full: str, name: str, values: Numbers) -> None:
    """A ValueError for a value outside of the range that `checks.RANGES` has for this parameter."""
    if name not in checks.RANGES:
        return
    low, high = np.argmin(values), np.argmax(values)
    for i in (int(low), int(high)):
        where = f"{full}[{i}]" if values.ndim else full
        checks.number(where, values.flat[i], name)


def _box(ranges: Mapping[str, Any]) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
    """Lower ends, upper ends, and the parameters that stay."""
    low: dict[str, float] = {}
    high: dict[str, float] = {}
    fixed: dict[str, float] = {}
    for name, given in ranges.items():
        full = f"ranges[{name!r}]"
        if np.ndim(given) == 0:
            fixed[name] = float(checks.concrete(full, given, ()))
            continue
        ends = checks.concrete(full, given, (2,))
        if not ends[0] < ends[1]:
            raise ValueError(f"{full} = {given} must be (low, high) with low < high")
        check_range(full, name, ends)
        low[name], high[name] = map(float, ends)
    if not low:
        raise ValueError("ranges is empty: give (low, high) of at least one parameter")
    return low, high, fixed


def _unit_points(d: int, n: int, seed: int) -> Numbers:
    from scipy.stats import qmc  # half a second to import

    if isinstance(n, bool) or int(n) != n or n < 1 or int(n) & (int(n) - 1):
        raise ValueError(f"n = {n} must be a power of 2 (the balance of a Sobol sequence), as 1024")
    return np.asarray(qmc.Sobol(d, seed=np.random.default_rng(seed)).random(int(n)))


def _scaled(unit: Numbers, low: dict[str, float], high: dict[str, float]) -> Numbers:
    a, b = np.array(list(low.values())), np.array(list(high.values()))
    return a + (b - a) * unit


def _fixed(design: Design, n: int) -> dict[str, Numbers]:
    return {name: np.full(n, value) for name, value in design.fixed.items()}
