"""Rows of the CSV files and of the report: the shares that converge, by region, and what does not."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxmyo.stability.random_problems import EQUILIBRIUM, SAME, Outcome
from jaxmyo.stability.reference import End
from jaxmyo.status import Status


class Counts(NamedTuple):
    """Of a batch of states: how many were asked for, converged, ended with a name, and what is wrong with them.

    solvable: the reference reaches the wanted load; missed: of these, not converged; inexact: converged with a residual
    above 1e-9 by the independent equations; wrong: converged to another state than the reference reaches; beyond:
    converged beyond a limit point that the reference stops at, on the same branch; nan: any number not finite.
    """

    asked: int
    converged: int
    named: int
    solvable: int
    missed: int
    inexact: int
    wrong: int
    beyond: int
    nan: int


def counts(outcome: Outcome, state: str, some: NDArray[np.bool_] | None = None) -> Counts:
    """Of the states "A" or "C" of an outcome; some: (n,) which problems. C is asked for where A converged."""
    found, branch = getattr(outcome, state), getattr(outcome, f"reference_{state}")
    error, off = getattr(outcome, f"error_{state}"), getattr(outcome, f"off_{state}")
    asked = np.ones(len(found.status), bool) if state == "A" else outcome.A.status == Status.CONVERGED
    asked = asked if some is None else asked & some
    good, there = found.status == Status.CONVERGED, branch.end == End.REACHED
    beyond = outcome.beyond if state == "C" else np.zeros(len(good), bool)
    elsewhere = good & ~beyond & ~there & (branch.end != End.LOST)
    masks = [
        asked,
        good,
        ~good & np.isin(found.status, [int(s) for s in Status]),
        there,
        there & ~good,
        good & ~(error <= EQUILIBRIUM),
        (good & there & ~(off <= SAME)) | elsewhere,
        beyond,
        ~np.isfinite(found.z).all(axis=1),
    ]
    return Counts(*(int(np.sum(mask & asked)) for mask in masks))


def regions(outcome: Outcome) -> dict[str, NDArray[np.bool_]]:
    """Regions of the problems by one input each: name → (n,) which are in it."""
    p = outcome.problems
    found = {
        "T0 = 0 or β = 0": p.T0 * p.beta == 0.0,
        "0 < βT0 ≤ 5 kPa": (p.T0 * p.beta > 0.0) & (p.T0 * p.beta <= 5.0),
        "5 < βT0 ≤ 60 kPa": (p.T0 * p.beta > 5.0) & (p.T0 * p.beta <= 60.0),
        "60 < βT0 ≤ 500 kPa": p.T0 * p.beta > 60.0,
        "moduli as measured": p.scale == 0.0,
        "moduli × 1e-6 … 1": p.scale < 0.0,
        "moduli × 1 … 1e6": p.scale > 0.0,
    }
    if outcome.kind == "sample":
        most = np.max(np.abs(np.log(p.target)), axis=1)
        edges = [
            ("stretches within 1.3", 0.0, np.log(1.3)),
            ("to 1.8", np.log(1.3), np.log(1.8)),
            ("to 2.5", np.log(1.8), 1.0),
        ]
        return found | {f"{name}": (most > low) & (most <= high) for name, low, high in edges}
    thickness, P = p.R[:, -1] / p.R[:, 0] - 1.0, p.target[:, 0]
    found |= {
        f"P ≤ {b:g} kPa" if a < 0.0 else f"{a:g} < P ≤ {b:g} kPa": (a < P) & (b >= P)
        for a, b in ((-1.0, 5.0), (5.0, 20.0), (20.0, 60.0))
    }
    bounds = [
        (0.0, 0.01, "wall/radius ≤ 0.01"),
        (0.01, 0.1, "0.01 … 0.1"),
        (0.1, 2.0, "0.1 … 2"),
        (2.0, 100.0, "2 … 100"),
        (100.0, 1e5, "> 100"),
    ]
    return found | {
        f"{name} (wall)" if not name.startswith("wall") else name: (a < thickness) & (b >= thickness)
        for a, b, name in bounds
    }


def by_region(outcomes: Iterable[Outcome]) -> list[dict[str, Any]]:
    """One row for each body, state and region."""
    rows = []
    for outcome in outcomes:
        for name, some in {"all": np.ones(len(outcome.A.status), bool), **regions(outcome)}.items():
            for state in "AC":
                of: dict[str, Any] = {"body": outcome.kind, "weave": outcome.weave, "state": state, "region": name}
                rows.append(of | counts(outcome, state, some)._asdict())
    return rows


def statuses(outcomes: Iterable[Outcome]) -> list[dict[str, Any]]:
    """How many states ended with which status, and how the reference's branch ended."""
    rows = []
    for outcome in outcomes:
        for state in "AC":
            found, branch = getattr(outcome, state), getattr(outcome, f"reference_{state}")
            asked = np.ones(len(found.status), bool) if state == "A" else outcome.A.status == Status.CONVERGED
            pairs = np.column_stack([found.status, branch.end])[asked]
            for (status, end), n in zip(*np.unique(pairs, axis=0, return_counts=True), strict=True):
                of: dict[str, Any] = {"body": outcome.kind, "weave": outcome.weave, "state": state}
                rows.append(of | {"status": Status(int(status)).name, "reference": End(int(end)).name, "n": int(n)})
    return rows


def missed(outcomes: Iterable[Outcome]) -> list[dict[str, Any]]:
    """Every problem whose solution exists and is not found, or that converged to another state than the reference's."""
    rows = []
    for outcome in outcomes:
        p = outcome.problems
        for state in "AC":
            found, branch = getattr(outcome, state), getattr(outcome, f"reference_{state}")
            off = getattr(outcome, f"off_{state}")
            asked = np.ones(len(found.status), bool) if state == "A" else outcome.A.status == Status.CONVERGED
            good, there = found.status == Status.CONVERGED, branch.end == End.REACHED
            known = np.isin(branch.end, [End.LIMIT_POINT, End.OVERFLOW, End.CLOSED])
            for i in np.flatnonzero(asked & ((there & ~good) | (good & there & ~(off <= SAME)) | (good & known))):
                rows.append(
                    {
                        "body": outcome.kind,
                        "weave": outcome.weave,
                        "state": state,
                        "number": int(i),
                        "status": Status(int(found.status[i])).name,
                        "reference": End(int(branch.end[i])).name,
                        "reference_reached": float(branch.reached[i]),
                        "beyond_limit_point": bool(outcome.beyond[i]) and state == "C",
                        "T0_kPa": float(p.T0[i]),
                        "beta": float(p.beta[i]),
                        "a_over_D": float(p.a_over_D[i]),
                        "log10_moduli": float(p.scale[i]),
                        "target": " ".join(f"{x:.6g}" for x in p.target[i]),
                        "wall_over_radius": float(p.R[i, -1] / p.R[i, 0] - 1.0) if p.R.shape[1] else "",
                    }
                )
    return rows


def markdown(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table; numbers with four digits."""

    def cell(x: Any) -> str:
        return f"{x:.4g}" if isinstance(x, float) else str(x)

    lines = ["| " + " | ".join(header) + " |", "|" + " --- |" * len(header)]
    return "\n".join([*lines, *("| " + " | ".join(map(cell, row)) + " |" for row in rows)])
