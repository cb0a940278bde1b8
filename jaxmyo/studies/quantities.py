"""Parameters and outputs that have a name here: their units, and how an output is read from a state."""

import re
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxmyo.state import State

#: Units of parameters that scenes and laws have; "–" is a pure number.
PARAMETERS = {
    "T0": "kPa",
    "a_over_D": "–",
    "beta": "–",
    "weave_stiffness": "kPa",
    "stretch": "–",
    **dict.fromkeys(("C1p", "C1a", "C2a", "C3a", "C4a", "C"), "kPa"),
    **dict.fromkeys(("C2p", "C3p", "C4p", "bf", "bt", "bfs"), "–"),
}


class Quantity(NamedTuple):
    """An output: its unit, the function of a state, and whether it tells of the solve and so has no derivative."""

    unit: str
    of: Callable[[State], Array]
    diagnostic: bool = False


def _stretch(i: int) -> Callable[[State], Array]:
    return lambda state: state.mean("stretches")[i]


def _stress(i: int) -> Callable[[State], Array]:
    return lambda state: state.mean("cauchy_fibre")[i, i]


#: Outputs that every state has: volume means of stretches, of Cauchy stresses and of pseudo-active tensions, in (or
#: along) the fibre, cross-fibre and normal directions; the energy of the law; and what says how the state was found.
OUTPUTS = {
    "lambda_f": Quantity("–", _stretch(0)),
    "lambda_cf": Quantity("–", _stretch(1)),
    "lambda_n": Quantity("–", _stretch(2)),
    "sigma_f": Quantity("kPa", _stress(0)),
    "sigma_cf": Quantity("kPa", _stress(1)),
    "sigma_n": Quantity("kPa", _stress(2)),
    "T_f": Quantity("kPa", lambda state: state.mean("T_f")),
    "T_cf": Quantity("kPa", lambda state: state.mean("T_cf")),
    "stored_energy": Quantity("µJ", lambda state: state.stored_energy),
    "residual": Quantity("–", lambda state: state.residual, diagnostic=True),
    "negative_eigenvalues": Quantity("–", lambda state: state.negative_eigenvalues, diagnostic=True),
}

#: What a state is asked for where no outputs are named.
DEFAULT = tuple(OUTPUTS)


def units_of(names: Iterable[str], known: Mapping[str, str], given: Mapping[str, str], what: str) -> dict[str, str]:
    """The unit of each name, given by the user or known; a ValueError that names one without."""
    units = {}
    for name in names:
        unit = given.get(name, known.get(name))
        if unit is None:
            raise ValueError(
                f"units: the unit of the {what} {name!r} is not known; add it, as in units={{{name!r}: 'kPa'}}, or '–' "
                "for a pure number"
            )
        units[name] = unit
    return units


def quotient(over: str, under: str) -> str:
    """The unit of a derivative: of 'kPa' by 'mm', 'kPa/mm'."""
    if over == under:
        return "–"
    if under == "–":
        return over
    return f"{'1' if over == '–' else over}/{f'({under})' if '/' in under else under}"


def plain(unit: str) -> str:
    """The unit in ASCII, as CF conventions for NetCDF have it: '1' for a pure number, 'mm3', 'uJ'."""
    return unit.translate({ord("–"): "1", ord("µ"): "u", ord("³"): "3", ord("²"): "2", ord("·"): " "})


def column(name: str, unit: str) -> str:
    """The name of a column of a CSV file: 'T0_kPa', 'beta'."""
    suffix = re.sub(r"[^A-Za-z0-9]+", "_", plain(unit).replace("/", " per ")).strip("_")
    return name if suffix in ("", "1") else f"{name}_{suffix}"


def is_finite(x: Array) -> Array:
    """Whether all numbers of an output are finite."""
    return jnp.all(jnp.isfinite(x))
