"""Named parameters of a fit, their bounds, and the free variables x that the bounds are made of.

The optimiser moves x ∈ ℝ: value = low + exp x where there is a lower bound, high − exp x for an upper one, a logistic
function for two, and scale · x for none. So no bound is ever passed, and a constant that must be positive is fitted by
its logarithm. A parameter that runs to its bound stops beside it, at `EDGE`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

#: Bounds of the parameters that the package knows; others are unbounded. Q of the Lin–Yin law must grow with strain.
_POSITIVE = (0.0, np.inf)
BOUNDS = {"a_over_D": (0.0, 0.25)} | dict.fromkeys(("T0", "C1p", "C2p", "C4p", "C", "bf", "bt", "bfs"), _POSITIVE)
UNITS = {"T0": "kPa", "a_over_D": "–", "C1p": "kPa", "C2p": "–", "C3p": "–", "C4p": "–", "C": "kPa"}
UNITS |= {"C1a": "kPa", "C2a": "kPa", "C3a": "kPa", "C4a": "kPa", "bf": "–", "bt": "–", "bfs": "–"}

#: The x, from that of the middle or of the start, at which a parameter has come to its bound.
EDGE = {"both": 8.0, "low": 20.0, "high": 20.0}


@dataclass(frozen=True)
class Parameter:
    """A number with a name: the value it starts from (or has, if it is fixed), its bounds, its unit.

    ValueError for a value outside of its bounds (ends excluded for a free one), for bounds in the wrong order.
    """

    name: str
    value: float
    low: float = -np.inf
    high: float = np.inf
    unit: str = ""

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"bounds of {self.name}: low = {self.low:g} is not below high = {self.high:g}")
        if not np.isfinite(self.value) or not self.low <= self.value <= self.high:
            raise ValueError(f"{self.name} = {self.value:g} is outside its bounds [{self.low:g}, {self.high:g}]")

    @property
    def base(self) -> str:
        """The name without the protocol that it belongs to: T0 of "T0[contracted]"."""
        return self.name.partition("[")[0]

    @property
    def scale(self) -> float:
        """The size of the start: what x = 1 stands for, if there is no bound; its distance from one bound."""
        if self.kind in ("low", "high"):
            return abs(self.value - (self.low if self.kind == "low" else self.high)) or 1.0
        return abs(self.value) or 1.0

    @property
    def kind(self) -> str:
        """Which bounds there are: "both", "low", "high" or "none"."""
        low, high = np.isfinite(self.low), np.isfinite(self.high)
        return "both" if low and high else "low" if low else "high" if high else "none"

    def x(self, value: float) -> float:
        """The x of a value inside the bounds; ValueError on a bound, which no x stands for."""
        if not self.low < value < self.high:
            raise ValueError(
                f"{self.name} = {value:g} starts on a bound of ({self.low:g}, {self.high:g}); start inside, or fix it"
            )
        if self.kind == "both":
            t = (value - self.low) / (self.high - self.low)
            return float(np.log(t / (1.0 - t)))
        if self.kind == "low":
            return float(np.log(value - self.low))
        return float(np.log(self.high - value)) if self.kind == "high" else value / self.scale

    def far(self, value: float) -> tuple[float, float]:
        """What data must tell a value apart from for it to count as identified.

        Its two bounds; a tenth of it and tenfold (of the start, if that is more), as measured from one bound; 0 and
        twofold (of the start, if that is more) without bounds.
        """
        if self.kind == "both":
            edge = 1e-3 * (self.high - self.low)
            return self.low + edge, self.high - edge
        if self.kind == "low":
            part = value - self.low
            return self.low + 0.1 * part, self.low + 10.0 * max(part, self.scale)
        if self.kind == "high":
            part = self.high - value
            return self.high - 10.0 * max(part, self.scale), self.high - 0.1 * part
        part = max(abs(value), self.scale)
        return value - part, value + part


def values_at(x: Any, kinds: tuple[str, ...], low: Any, high: Any, scale: Any, xp: ModuleType = jnp) -> list[Any]:
    """The values (k) of parameters at x (k,); kinds: of each, see `Parameter.kind`; scale: `Parameter.scale`."""
    made = []
    for i, kind in enumerate(kinds):
        if kind == "both":
            part = 1.0 / (1.0 + xp.exp(-xp.clip(x[i], -EDGE[kind], EDGE[kind])))
            made.append(low[i] + (high[i] - low[i]) * part)
        elif kind == "none":
            made.append(scale[i] * x[i])
        else:
            middle = xp.log(scale[i])
            part = xp.exp(xp.clip(x[i], middle - EDGE[kind], middle + 10.0 * EDGE[kind]))
            made.append(low[i] + part if kind == "low" else high[i] - part)
    return made


def names_of(constants: Any) -> list[str]:
    """The names of the leaves of a pytree of constants: fields, keys, positions joined by dots."""

    def word(key: Any) -> str:
        return str(next(getattr(key, a) for a in ("name", "key", "idx") if hasattr(key, a)))

    return [".".join(map(word, path)) for path, _ in jax.tree_util.tree_flatten_with_path(constants)[0]]


def parameters_of(
    values: Mapping[str, float], bounds: Mapping[str, tuple[float, float]], per_protocol: Mapping[str, Sequence[str]]
) -> tuple[Parameter, ...]:
    """Parameters of these names and values; those of `per_protocol` once for each of its protocols."""
    for kind, names in (("bounds", bounds), ("per_protocol", per_protocol)):
        if unknown := sorted(set(names) - set(values)):
            raise ValueError(f"{kind}: {', '.join(unknown)} unknown; the parameters are {', '.join(values)}")
    made = []
    for name, value in values.items():
        low, high = bounds.get(name, BOUNDS.get(name, (-np.inf, np.inf)))
        for full in [f"{name}[{p}]" for p in per_protocol.get(name, ())] or [name]:
            made.append(Parameter(full, float(value), float(low), float(high), UNITS.get(name, "")))
    return tuple(made)
