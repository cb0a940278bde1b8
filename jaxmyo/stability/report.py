"""The report of `jaxmyo stability` in Markdown, and its summary as one object."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxmyo.stability import checkerboard, inf_sup_cases, tables
from jaxmyo.stability.checkerboard import Sheet
from jaxmyo.stability.inf_sup_cases import CURES, PAIRS, Row
from jaxmyo.stability.maps import Map
from jaxmyo.stability.random_problems import SAME, Outcome
from jaxmyo.stability.solids import SolidOutcome
from jaxmyo.status import Status

CAPTIONS = {
    "inf_sup": "The inf-sup constants. Bold: the patches that keep it.",
    "checkerboards": "p and q of one sheet. The colours end where those of the columns to the right do.",
    "roughness": "What alternates between neighbouring patches.",
    "maps": "Maps of the extremes: the status at each point.",
}
#: Fields of the sheet whose convergence is measured.
FIELDS = ["p", "q", "T_f", "T_cf", "cauchy", "cauchy_C"]


class Results(NamedTuple):
    """Everything that was measured."""

    rows: list[Row]
    sheets: list[Sheet]
    maps: list[Map]
    outcomes: list[Outcome]
    solids: SolidOutcome | None


def summary(results: Results) -> dict[str, Any]:
    """The object of --json: numbers, and None where one does not exist."""
    constants: dict[str, dict[str, list[float]]] = {}
    for row in results.rows:
        constants.setdefault(row.body, {}).setdefault(f"p: {row.p}, q: {row.q}", []).append(row.beta)
    problems = []
    for outcome in results.outcomes:
        of_states = {state: tables.counts(outcome, state)._asdict() for state in "AC"}
        residuals = {k: float(np.nanmax(getattr(outcome, f"error_{k}"), initial=0.0)) for k in "AC"}
        problems.append({"body": outcome.kind, "weave": outcome.weave, **of_states, "largest_residual": residuals})
    return {
        "inf_sup": constants,
        "zero_modes": sum(row.zero for row in results.rows),
        "checkerboards": sheet_rows(results.sheets),
        "orders": _orders(results.sheets),
        "maps": {m.name: {"converged": m.converged, "statuses": _names(m.status)} for m in results.maps},
        "random": problems,
        "solids": None if results.solids is None else _solids(results.solids),
    }


def _solids(s: SolidOutcome) -> dict[str, Any]:
    return {
        "n": len(s.A.status),
        "A": _names(s.A.status),
        "C": _names(s.C.status[s.A.status == Status.CONVERGED]),
        "largest_residual": {k: float(np.nanmax(e, initial=0.0)) for k, e in (("A", s.error_A), ("C", s.error_C))},
        "known": int(np.isfinite(s.off).sum()),
        "wrong": int((s.off > SAME).sum()),
        "by_finer_steps": {
            k: {"known": int(np.isfinite(a).sum()), "elsewhere": int((a > SAME).sum())}
            for k, a in (("A", s.apart_A), ("C", s.apart_C))
        },
    }


def in_words(found: dict[str, Any]) -> list[str]:
    """The summary in lines."""
    lines = []
    for body, of in found["inf_sup"].items():
        cure = "p: {}, q: {}".format(*CURES[0])
        both = "p: element, q: element"
        lines.append(f"inf-sup constant of (p, q), {body}: {_row(of[both])} per element; {_row(of[cure])} with {cure}")
    for one in found["random"]:
        for state, weave in [(state, "with" if one["weave"] else "without") for state in "AC"]:
            c = one[state]
            lines.append(
                f"{one['body']} {weave} weave, state {state}: {c['converged']} of {c['asked']} converge "
                f"({c['solvable']} have a solution), {c['missed']} missed, {c['inexact']} inexact, {c['wrong']} wrong, "
                f"{c['beyond']} beyond a limit point, {c['nan']} with NaN; "
                f"largest residual {one['largest_residual'][state]:.1e}"
            )
    if s := found["solids"]:
        lines.append(f"solids: A {s['A']}, C {s['C']}; largest residuals {s['largest_residual']}; {s['wrong']} wrong")
        finer = ", ".join(
            f"{x['elsewhere']} of {x['known']} states {k} elsewhere" for k, x in s["by_finer_steps"].items()
        )
        lines.append(f"solids, by paths of steps a sixth as long: {finer}")
    lines += [f"map {name}: {100.0 * m['converged']:.1f} % converge" for name, m in found["maps"].items()]
    return lines


def write(path: Path, results: Results, pictures: Sequence[Path]) -> Path:
    """The report as a Markdown file beside its figures."""
    pages = {p.stem: f"![{CAPTIONS[p.stem]}]({p.name})\n\n*{CAPTIONS[p.stem]}*" for p in pictures}
    found = summary(results)
    parts = ["# Stability", *(f"- {line}" for line in in_words(found)), ""]
    parts += ["## The inf-sup test", _prose(inf_sup_cases.__doc__), _constants(results.rows), pages["inf_sup"]]
    parts += ["## Checkerboards", _prose(checkerboard.__doc__), _sheets(results.sheets), _convergence(results.sheets)]
    parts += [pages["checkerboards"], pages["roughness"], "## Extremes", pages["maps"], _maps(results.maps)]
    parts += [
        "## Random problems",
        _COUNTED,
        _regions(results.outcomes),
        "### How they end",
        _statuses(results.outcomes),
    ]
    parts += ["### A solution exists, or is another one, and was not found", _missed(results.outcomes)]
    path.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    return path


_COUNTED = (
    "asked: problems with a start; solvable: the branch from rest, followed by strain in equations made by hand, "
    "reaches the wanted load; missed: solvable, and not converged; inexact: converged with a relative residual above "
    "1e-9 in those equations; wrong: converged to another state; beyond: converged beyond a limit point of the branch, "
    "which the path in the load stepped over, to a state on the same curve."
)


def sheet_rows(sheets: Sequence[Sheet]) -> list[dict[str, Any]]:
    """One row for each sheet."""
    return [
        {
            "patches": s.kind,
            "n": s.n,
            "status": Status(s.status).name,
            "alternating_p_kPa": s.rough_p,
            "alternating_q_kPa": s.rough_q,
            "mean_T_cf_kPa": float(s.T_cf.mean()),
            "negative_eigenvalues": s.negative_eigenvalues,
        }
        for s in sheets
    ]


def map_rows(found: Sequence[Map]) -> list[dict[str, Any]]:
    """One row for each point of each map."""
    rows = []
    for m in found:
        for i, x in enumerate(m.x.values):
            for j, y in enumerate(m.y.values):
                error = "" if m.error is None else float(m.error[i, j])
                of: dict[str, Any] = {
                    "map": m.name,
                    "x_name": m.x.name,
                    "x": float(x),
                    "y_name": m.y.name,
                    "y": float(y),
                }
                rows.append(of | {"status": Status(int(m.status[i, j])).name, "error": error})
    return rows


def _names(status: Any) -> dict[str, int]:
    values, n = np.unique(status, return_counts=True)
    return {Status(int(s)).name: int(k) for s, k in zip(values, n, strict=True)}


def _row(values: Sequence[float]) -> str:
    return ", ".join(f"{x:.3f}" for x in values)


def _prose(docstring: str | None) -> str:
    assert docstring is not None
    return docstring.strip()


def _constants(rows: Sequence[Row]) -> str:
    parts = []
    for body in dict.fromkeys(row.body for row in rows):
        of_body = [row for row in rows if row.body == body]
        ns = list(dict.fromkeys(row.n for row in of_body))
        lines = []
        for p, q in PAIRS:
            own = {row.n: row for row in of_body if (row.p, row.q) == (p, q)}
            lines.append([p, q, *(f"{own[n].beta:.4f}" for n in ns), sum(own[n].zero for n in ns)])
        table = tables.markdown(["p", "q", *(f"n = {n}" for n in ns), "zero modes"], lines)
        parts.append(f"### {body}\n\n{table}")
    return "\n\n".join(parts)


def _sheets(sheets: Sequence[Sheet]) -> str:
    rows = sheet_rows(sheets)
    return tables.markdown(list(rows[0]), [list(row.values()) for row in rows])


def _orders(sheets: Sequence[Sheet]) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for kind in checkerboard.KINDS:
        own = [s for s in sheets if s.kind == kind]
        found[kind] = {}
        for field in FIELDS:
            differences, order = checkerboard.orders(own, field)
            found[kind][field] = {"differences": differences, "order": order if np.isfinite(order) else None}
    return found


def _convergence(sheets: Sequence[Sheet]) -> str:
    rows = []
    for kind, fields in _orders(sheets).items():
        for field, of in fields.items():
            order = "–" if of["order"] is None else f"{of['order']:.2f}"
            rows.append([kind, field, ", ".join(f"{d:.1e}" for d in of["differences"]) or "–", order])
    header = ["patches", "field", "relative L2 difference of each mesh from the next", "order"]
    return tables.markdown(header, rows)


def _maps(found: Sequence[Map]) -> str:
    rows = []
    for m in found:
        error = "" if m.error is None else f"{float(np.nanmax(m.error)):.1e}"
        rows.append(
            [m.title, f"{100.0 * m.converged:.1f}", ", ".join(f"{n} {k}" for k, n in _names(m.status).items()), error]
        )
    return tables.markdown(["map", "% converge", "statuses", "largest error of a stretch"], rows)


def _regions(outcomes: Sequence[Outcome]) -> str:
    rows = tables.by_region(outcomes)
    header = [*rows[0], "% of solvable"]
    return tables.markdown(
        header,
        [
            [*row.values(), f"{100.0 * (1.0 - row['missed'] / row['solvable']):.2f}" if row["solvable"] else "–"]
            for row in rows
            if row["asked"]
        ],
    )


def _statuses(outcomes: Sequence[Outcome]) -> str:
    rows = tables.statuses(outcomes)
    return tables.markdown(list(rows[0]), [list(row.values()) for row in rows])


def _missed(outcomes: Sequence[Outcome]) -> str:
    rows = tables.missed(outcomes)
    return tables.markdown(list(rows[0]), [list(row.values()) for row in rows]) if rows else "None."
