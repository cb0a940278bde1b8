"""Measured curves: a CSV with named columns and units, read with checks that say line and column.

The header names what a column holds, and its unit in brackets, e.g. `stretch_f, stretch_cf, cauchy_f [kPa]`:

| column | holds |
| --- | --- |
| `protocol` | a name; rows of one name belong together (one test), default "test" |
| `state` or `beta` | passive or active, or the activation β ∈ [0, 1]; default passive |
| `stretch_f`, `stretch_cf`, `stretch_n` | stretches [–] along fibre, cross-fibre, normal, from the zero-stress state |
| `green_f`, `green_cf`, `green_n` | Green strains E = ½ (λ² − 1) [–] instead |
| `shear_f-cf`, ... (six modes i-j) | amount of simple shear [–]: the faces with normal i are displaced along j |
| `cauchy_f`, `nominal_f` or `pk2_f`; of `cf`; of the six modes | stresses: force per deformed, per undeformed area, S |
| `control` | stretch or stress: what the machine prescribes, default stretch |
| `weight` | of the squared residuals of the row [–], default 1 |

A cell may be empty. A direction without stretch is free of stress, or has the stress that the machine prescribes
(`control` stress); then the stretches of the row are the measurement. In simple shear the faces i and j keep
their distance (stretch 1) unless a stretch says otherwise. Strains have the unit – ("[-]" or none); stresses need one.
"""

import csv
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmyo import checks

#: Directions: fibre, cross-fibre, normal; the axes x, y, z of the sample.
AXES = ("f", "cf", "n")
#: Simple shear i-j: the faces with normal i are displaced along j.
MODES = ("f-cf", "f-n", "cf-f", "cf-n", "n-f", "n-cf")
#: Stress measures; a stress of mode i-j is the component along j on the area with normal i.
MEASURES = ("cauchy", "nominal", "pk2")
#: kPa per unit.
UNITS = {"kPa": 1.0, "Pa": 1e-3, "MPa": 1e3, "mmHg": 0.133322387415, "g/cm²": 0.0980665, "N/cm²": 10.0}
#: Largest stresses that are no surprise in soft tissue [kPa]; outside, a unit is probably wrong.
USUAL = (1e-2, 2e4)


@dataclass(frozen=True, eq=False)
class Data:
    """n measured states. Arrays are float64, NaN where a cell is empty.

    protocol: n names; beta: (n,) activation [–]; stretch: (n, 3) along f, cf, n [–]; shear: (n, 6) amounts of the
    `MODES` [–]; stress: (n, 9) of f, cf, n and the six modes [kPa]; measure: n names of `MEASURES`; stress_controlled:
    (n,); weight: (n,) [–]; lines: (n,) of the file, for messages.
    """

    protocol: tuple[str, ...]
    beta: NDArray[np.float64]
    stretch: NDArray[np.float64]
    shear: NDArray[np.float64]
    stress: NDArray[np.float64]
    measure: tuple[str, ...]
    stress_controlled: NDArray[np.bool_]
    weight: NDArray[np.float64]
    lines: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.protocol)

    @property
    def protocols(self) -> tuple[str, ...]:
        """The names of the protocols, in the order of the file."""
        return tuple(dict.fromkeys(self.protocol))

    def rows(self, which: Any) -> "Data":
        """Some of the rows, by a mask (n,) or an index."""
        at = np.arange(len(self))[which]
        pick: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        picked: dict[str, Any] = {
            k: tuple(v[i] for i in at) if isinstance(v, tuple) else v[at] for k, v in pick.items()
        }
        return Data(**picked)

    def of(self, *protocols: str) -> "Data":
        """The rows of some protocols. ValueError for a name that there is not."""
        for name in protocols:
            checks.choice("protocol", name, list(self.protocols))
        return self.rows(np.isin(np.array(self.protocol), protocols))

    def as_json(self) -> dict[str, Any]:
        """Everything, as lists; None for an empty cell."""

        def plain(x: Any) -> Any:
            if isinstance(x, list | tuple):
                return [plain(v) for v in x]
            return None if isinstance(x, float) and np.isnan(x) else x

        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {k: plain(v if isinstance(v, tuple) else v.tolist()) for k, v in values.items()}


def lin_yin_data() -> Data:
    """Lin & Yin 1998, Fig. 4: equibiaxial extension of rabbit myocardium, Cauchy stress [kPa]; 104 measured stresses.

    Protocols "passive" and "contracted" (full contracture, β = 1). Provenance: `jaxmyo/datasets/README.md`.
    """
    with resources.as_file(resources.files("jaxmyo") / "datasets" / "lin_yin_1998_fig4.csv") as path:
        return read_data(path)


def read_data(path: str | Path) -> Data:
    """The CSV file of measured curves, see the module. Comment lines start with #.

    Errors: a ValueError that names file, line and column for missing or unknown columns and units, for what is not a
    number, for stretches outside (0.2, 5), for rows without a measurement or with contradictory cells. A UserWarning
    for stresses whose size suggests another unit.
    """
    path = Path(path)
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            numbered = [(i, line) for i, line in enumerate(file, 1) if line.strip() and not line.startswith("#")]
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: not a text file in UTF-8 ({error})") from error
    if len(numbered) < 2:
        raise ValueError(f"{path}: needs a header and at least one row of data")
    header, *body = csv.reader(line for _, line in numbered)
    columns = _columns(path, header)
    rows = []
    for (line, _), cells in zip(numbered[1:], body, strict=True):
        if len(cells) != len(header):
            raise ValueError(f"{path}, line {line}: {len(cells)} cells, but the header names {len(header)} columns")
        rows.append(_Row(path, line, columns, [c.strip() for c in cells]).read())
    data = _collect(rows)
    _check_size(path, data, header)
    return data


def _columns(path: Path, header: Iterable[str]) -> dict[int, tuple[str, float]]:
    """Position → (name, factor to the package's unit) of the columns."""
    known = ["protocol", "state", "beta", "control", "weight"]
    strains = [f"{kind}_{a}" for kind in ("stretch", "green") for a in AXES] + [f"shear_{m}" for m in MODES]
    stresses = [f"{measure}_{c}" for measure in MEASURES for c in (*AXES, *MODES)]
    found: dict[int, tuple[str, float]] = {}
    for i, text in enumerate(header):
        name, _, unit = text.strip().partition("[")
        name, unit = name.strip(), unit.rstrip("] ").strip().replace("2", "²").replace("^", "")
        if name not in known + strains + stresses:
            raise ValueError(
                f"{path}: column {text.strip()!r} is unknown; valid: {', '.join(known)}, stretch_f, green_f, "
                "cauchy_f [unit], nominal_f [unit], pk2_f [unit] (also of cf and n), shear_i-j and cauchy_i-j [unit] "
                f"with i-j of {', '.join(MODES)}"
            )
        if name in (n for n, _ in found.values()):
            raise ValueError(f"{path}: two columns are named {name!r}")
        if name in stresses:
            if unit not in UNITS:
                raise ValueError(f"{path}: column {name!r} has the unit {unit!r}; valid: {', '.join(UNITS)}")
            found[i] = name, UNITS[unit]
        else:
            if unit not in ("", "-", "–", "1"):
                raise ValueError(f"{path}: column {name!r} has no unit (–); got {unit!r}")
            found[i] = name, 1.0
    names = {name for name, _ in found.values()}
    if not names & set(strains):
        raise ValueError(f"{path}: no column of a strain; add stretch_f and stretch_cf (or green_f, ..., shear_f-cf)")
    if not names & set(stresses):
        raise ValueError(f"{path}: no column of a stress; add cauchy_f [kPa] and cauchy_cf [kPa] (or nominal_, pk2_)")
    if {"state", "beta"} <= names:
        raise ValueError(f"{path}: give a column 'state' or 'beta', not both")
    return found


class _Row:
    """One line of the file while it is read."""

    def __init__(self, path: Path, line: int, columns: Mapping[int, tuple[str, float]], cells: list[str]) -> None:
        self.at = f"{path}, line {line}"
        self.line = line
        self.cells = {name: (cells[i], factor) for i, (name, factor) in columns.items()}

    def number(self, name: str, low: float = -np.inf, high: float = np.inf) -> float:
        """The number in a cell, in the package's unit, NaN if there is none; low and high are excluded."""
        text, factor = self.cells.get(name, ("", 1.0))
        if not text:
            return np.nan
        try:
            value = factor * float(text)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise ValueError(f"{self.at}, column {name!r}: {text!r} is not a number")
        if not low < value < high:
            raise ValueError(f"{self.at}, column {name!r}: {text} is outside ({low:g}, {high:g})")
        return value

    def word(self, name: str, default: str, valid: tuple[str, ...] = ()) -> str:
        text = self.cells.get(name, ("", 1.0))[0] or default
        if valid and text not in valid:
            raise ValueError(f"{self.at}, column {name!r}: {text!r} is unknown; valid: {', '.join(valid)}")
        return text

    def read(self) -> dict[str, Any]:
        low, high, _ = checks.RANGES["stretch"]
        stretch = np.full(3, np.nan)
        for k, a in enumerate(AXES):
            direct = self.number(f"stretch_{a}", low, high)
            green = self.number(f"green_{a}", 0.5 * (low**2 - 1.0), 0.5 * (high**2 - 1.0))
            if not np.isnan(direct) and not np.isnan(green):
                raise ValueError(f"{self.at}: both stretch_{a} and green_{a}; leave one empty")
            stretch[k] = direct if np.isnan(green) else np.sqrt(1.0 + 2.0 * green)
        shear = np.array([self.number(f"shear_{m}", -3.0, 3.0) for m in MODES])
        by_measure = {m: np.array([self.number(f"{m}_{c}") for c in (*AXES, *MODES)]) for m in MEASURES}
        used = [m for m, v in by_measure.items() if not np.isnan(v).all()]
        if len(used) > 1:
            raise ValueError(f"{self.at}: stresses of several measures ({', '.join(used)}); one per row")
        if not used:
            raise ValueError(f"{self.at}: no stress; every row needs at least one")
        measure, stress = used[0], by_measure[used[0]]
        control = self.word("control", "stretch", ("stretch", "stress"))
        self.check(stretch, shear, stress, measure, control)
        state = {"passive": 0.0, "active": 1.0}[self.word("state", "passive", ("passive", "active"))]
        beta, weight = self.number("beta", -1e-12, 1.0 + 1e-12), self.number("weight", -1e-300)
        return {
            "protocol": self.word("protocol", "test"),
            "beta": state if np.isnan(beta) else min(max(beta, 0.0), 1.0),
            "stretch": stretch,
            "shear": shear,
            "stress": stress,
            "measure": measure,
            "stress_controlled": control == "stress",
            "weight": 1.0 if np.isnan(weight) else weight,
            "lines": self.line,
        }

    def check(
        self, stretch: NDArray[Any], shear: NDArray[Any], stress: NDArray[Any], measure: str, control: str
    ) -> None:
        """Errors for cells that contradict each other."""
        sheared = np.flatnonzero(~np.isnan(shear))
        if sheared.size > 1:
            raise ValueError(f"{self.at}: more than one mode of simple shear in a row")
        if not sheared.size and np.isnan(stretch).all():
            raise ValueError(f"{self.at}: no stretch, Green strain or shear; every row needs at least one")
        for k in np.flatnonzero(~np.isnan(stress[3:])):
            if k not in sheared:
                raise ValueError(f"{self.at}: a shear stress of mode {MODES[k]}, but no shear_{MODES[k]}")
        if np.isfinite(stretch).all():
            raise ValueError(f"{self.at}: all three stretches; the tissue is incompressible, leave one empty")
        if control == "stress":
            if sheared.size or measure == "pk2" or not np.isnan(stretch[2]):
                raise ValueError(f"{self.at}: control by stress is for cauchy or nominal stresses along f and cf")
            return
        loaded = np.isnan(stretch) & (np.nan_to_num(stress[:3]) != 0.0)
        if loaded.any() and not sheared.size:
            a = AXES[int(np.argmax(loaded))]
            raise ValueError(
                f"{self.at}: a stress along {a} but no stretch; a free direction has none (or control = stress)"
            )


def _collect(rows: list[dict[str, Any]]) -> Data:
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    arrays: dict[str, Any] = {k: tuple(v) if isinstance(v[0], str) else np.array(v) for k, v in columns.items()}
    return Data(**arrays)


def _check_size(path: Path, data: Data, header: Iterable[str]) -> None:
    largest = float(np.nanmax(np.abs(data.stress)))
    if largest > 0.0 and not USUAL[0] < largest < USUAL[1]:
        warnings.warn(
            f"{path}: the largest stress is {largest:.3g} kPa, which makes no sense for soft tissue (usual: "
            f"{USUAL[0]:g} to {USUAL[1]:g} kPa). Check the units in the header: {', '.join(h.strip() for h in header)}",
            stacklevel=3,
        )
