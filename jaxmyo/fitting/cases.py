"""What `jaxmyo fit` fits: a CSV file, the curves of Lin and Yin, Table 1 of the paper. Each gives a report."""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from jaxmyo import checks
from jaxmyo.constants import LAND_PASSIVE, MEASURED, PRINTED
from jaxmyo.data import Data, lin_yin_data, read_data
from jaxmyo.energies import guccione
from jaxmyo.energies import lin_yin as lin_yin_law
from jaxmyo.fitting import figures
from jaxmyo.fitting.fit import Fit, fit, unfitted
from jaxmyo.fitting.least_squares import Loss
from jaxmyo.fitting.parameters import names_of
from jaxmyo.fitting.problem import Problem
from jaxmyo.fitting.sample import columns_of, felt, sample_problem
from jaxmyo.fitting.table1 import ROUNDING, rounding_intervals, table1_problem

LAWS: dict[str, Any] = {"lin-yin": (lin_yin_law, MEASURED), "guccione": (guccione, LAND_PASSIVE)}
PASSIVE = ("C1p", "C2p", "C3p", "C4p")
ACTIVE = ("C1a", "C2a", "C3a", "C4a")
T0_KPA, A_OVER_D = 0.6, 0.2
#: Starts of the fit to Table 1, the printed constants among them, and steps of each: its valley is long.
TABLE1_STARTS, TABLE1_STEPS = 25, 300


@dataclass(frozen=True)
class Report:
    """What a command prints and writes."""

    text: str
    as_json: dict[str, Any]
    files: tuple[Path, ...]


def of_file(options: argparse.Namespace) -> Report:
    """The fit of a law to a CSV file."""
    data = read_data(options.data)
    law, constants = LAWS[options.law]
    free, fix = _values(options.free), _values(options.fix)
    given = {name: value for name, value in (free | fix).items() if value is not None}
    T0, a_over_D = given.pop("T0", options.T0), given.pop("a_over_D", options.a_over_D)
    constants = replace(constants, **{n: given.pop(n) for n in names_of(constants) if n in given})
    known = [*names_of(constants), "T0", *([] if a_over_D is None else ["a_over_D"])]
    for name in fix:
        checks.choice("fix", name.partition("[")[0], known)
    problem = sample_problem(
        data,
        law,
        constants,
        T0=T0,
        a_over_D=a_over_D,
        free=[n for n in free or felt(data, law, constants) if n not in fix],
        per_protocol=_names(options.per_protocol),
    ).starting_at(**given)
    problem = problem.fitting(*(n for n in problem.free if n not in fix))  # of one protocol
    found = fit(
        problem,
        starts=1 if options.starts is None else options.starts,
        seed=options.seed,
        loss=Loss(options.loss, options.loss_scale),
        profiles=True,
    )
    title = f"{Path(options.data).name}, law {options.law}: {_brief(found)}"
    picture = figures.data_and_fit(options.out / "fit.png", data, found, title)
    return Report(str(found), found.as_json(), (picture,))


def lin_yin(options: argparse.Namespace) -> Report:
    """Lin & Yin 1998, Fig. 4: nothing fitted, T0 alone without and with the weave, a/D, passive constants, all."""
    data = lin_yin_data()
    absent = sample_problem(data, T0=T0_KPA, free=["T0"])
    woven = sample_problem(data, T0=T0_KPA, a_over_D=A_OVER_D, free=["T0"])
    fits = {
        "T0, no weave": fit(absent.without("passive"), profiles=True),
        "T0, a/D = 0.2": fit(woven.without("passive"), profiles=True),
        "T0 and a/D": fit(woven.without("passive").fitting("T0", "a_over_D"), profiles=True),
        "passive constants": fit(absent.without("contracted").fitting(*PASSIVE), profiles=True),
        "all constants, no weave": fit(absent.fitting(*PASSIVE, *ACTIVE, "T0"), profiles=True),
        "all constants, T0 and a/D": fit(woven.fitting(*PASSIVE, *ACTIVE, "T0", "a_over_D"), profiles=True),
    }
    rms = unfitted_rms(data, absent)
    whole = fits["all constants, T0 and a/D"]
    lines = [f"Lin & Yin 1998, Fig. 4. The set 'measured' with T0 = {T0_KPA} kPa, no weave, nothing fitted:"]
    lines += [f"  rms {value:.3f} kPa: {name}" for name, value in rms.items()]
    for name, found in fits.items():
        lines += ["", f"{name}:", str(found)]
    result = whole.as_json() | {
        "nothing_fitted": {"set": "measured", "T0_kPa": T0_KPA, "rms_kPa": rms},
        "fits": {name: {k: found.as_json()[k] for k in _BRIEF} for name, found in fits.items()},
    }
    title = f"Lin & Yin 1998, Fig. 4; all constants, T0 and a/D: {_brief(whole)}"
    picture = figures.data_and_fit(options.out / "fit.png", data, whole, title)
    return Report("\n".join(lines), result, (picture,))


def table1(options: argparse.Namespace) -> Report:
    """Which constants Table 1 was computed with: all 8 from its 40 entries."""
    starts = TABLE1_STARTS if options.starts is None else options.starts
    found = fit(table1_problem(), starts=starts, seed=options.seed, max_steps=TABLE1_STEPS)
    intervals, allowed = rounding_intervals(found)
    largest = float(np.abs(found.residuals).max())
    lines = [
        str(found),
        f"  largest residual {largest:.4f} (rounding of the print: {ROUNDING})",
        f"  values for which every entry is within {allowed:.4f} of the printed one, beside those of the text:",
    ]
    lines += [
        f"  {n} in [{low:.4f}, {high:.4f}]; printed {getattr(PRINTED, n)}" for n, (low, high) in intervals.items()
    ]
    first = float(np.sqrt(found.starts.sum[0] / found.problem.n))
    lines.append(f"  the start at the printed constants ended at rms {first:.4g}")
    result = found.as_json() | {
        "largest_residual": largest,
        "rounding": {n: {"low": low, "high": high} for n, (low, high) in intervals.items()},
        "rounding_allowed": allowed,
        "rms_of_starts": np.sqrt(found.starts.sum / found.problem.n).tolist(),
    }
    title = f"Table 1: all 8 constants fitted to 40 entries, rms {found.rms:.4f}"
    picture = figures.residuals(options.out / "fit.png", found, title, ROUNDING)
    return Report("\n".join(lines), result, (picture,))


_BRIEF = ("estimates", "rms", "identifiable", "standard_errors", "fixed", "undetermined", "aic", "bic", "rms_of")


def unfitted_rms(data: Data, problem: Problem) -> dict[str, float]:
    """Of each protocol and direction [kPa], at the values of the problem."""
    off = unfitted(problem) - problem.observed
    row, what = columns_of(data)
    rms = {}
    for protocol in data.protocols:
        for k, direction in enumerate(("fibre", "cross-fibre")):
            mine = (np.array(data.protocol)[row] == protocol) & (what == k)
            rms[f"{protocol}, {direction}"] = float(np.sqrt(np.mean(off[mine] ** 2)))
    return rms


def _brief(found: Fit) -> str:
    return f"rms {found.rms:.3g} {found.problem.unit}, {len(found.estimates)} parameters"


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _values(text: str | None) -> dict[str, float | None]:
    """NAME[=VALUE],... as name → value, None where there is none."""
    values: dict[str, float | None] = {}
    for item in _names(text or ""):
        name, _, value = item.partition("=")
        try:
            values[name.strip()] = float(value) if value else None
        except ValueError as error:
            raise ValueError(f"{item!r} is not NAME or NAME=NUMBER") from error
    return values
