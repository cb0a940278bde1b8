"""What the report of `jaxmyo paper` is composed of: each function makes one section from computed results."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path

from jaxmyo.constants import SETS, LinYin
from jaxmyo.paper import report
from jaxmyo.paper.claims import Claim
from jaxmyo.paper.homogeneous import CONSTRAINT
from jaxmyo.paper.report import Section
from jaxmyo.paper.sample import A_OVER_D, DIRECTIONS, HALF, LAST_STRETCH, T0_KPA, Sample
from jaxmyo.paper.table1 import REPRODUCED, STRETCH, Table

TITLE = (
    "A pseudo active kinematic constraint for a biological living soft tissue (Bourdarias, Gerbi, Ohayon): "
    "the results recomputed"
)


def basis(names: Sequence[str], versions: Mapping[str, str]) -> Section:
    """The sets of constants that were computed with, and the versions of the programs."""
    kpa = ("C1p", "C1a", "C2a", "C3a", "C4a")
    constants = [field.name for field in fields(LinYin)]
    rows = [(name, *(f"{getattr(SETS[name], constant):g}" for constant in constants)) for name in names]
    return Section(
        "Constants and versions",
        text=[
            "The numbers that the paper prints (printed), those that its Table 1 was computed with (table1) and those "
            "that reproduce the measurement behind it, Lin & Yin 1998, Fig. 4 (measured), are not the same. "
            "Every table and figure says which set it was computed with.",
            "λf, λcf, λn: stretches along the fibres, across them in the plane of the sample, and normal to it (the "
            "cf' of the paper). T0: beating tension; β: activation, 0 to 1; a/D: fibre radius over D = 4a + d, with "
            "the gap d between two cells, the parameter of the kinematic constraint. Stresses are Cauchy stresses.",
        ],
        tables=[
            report.Table(
                "Constants of the Lin–Yin law",
                ("set", *(f"{constant} [{'kPa' if constant in kpa else '–'}]" for constant in constants)),
                rows,
            ),
            report.Table("Versions", list(versions), [list(versions.values())], row_headers=0),
        ],
    )


def thin_sample(
    tables: Mapping[str, Table],
    name: str,
    sample: Sample,
    claims: Sequence[Claim],
    free_contraction: Path,
    uniaxial: Path,
) -> Section:
    """The thin sample: Table 1 with every set, and with the set `name` the two figures (PNG files) and the claims."""
    note = unstable_note(sample)
    return Section(
        "Thin sample",
        text=[
            f"The claims and the figures are with the constants '{name}', and with T0 = {T0_KPA:g} kPa and "
            f"a/D = {A_OVER_D:g} where nothing else is said. A printed number counts as reproduced if it is the "
            f"computed one, rounded; an entry of Table 1, if it is within {REPRODUCED} (% or kPa) of the computed one.",
            *([note] if note else []),
        ],
        claims=claims,
        tables=[_of_all_sets(tables), *(_table1(n, tables[n]) for n in _first(name, tables)), _free(name, sample)],
        figures=[(free_contraction, _free_caption(name)), (uniaxial, _uniaxial_caption(name))],
    )


def footer(files: Sequence[Path]) -> str:
    """Where the numbers of the page are in full."""
    return f"Written by jaxmyo paper. The same numbers to 12 digits: {', '.join(file.name for file in files)}."


def unstable_note(sample: Sample) -> str:
    """Which states of the uniaxial tests are unstable equilibria; empty if none is."""
    kinds = [
        f"{kind} along {direction}"
        for i, direction in enumerate(DIRECTIONS)
        for b, kind in enumerate(("active", "passive"))
        if sample.unstable[i, :, b].any()
    ]
    if not kinds:
        return ""
    return (
        f"{sample.unstable.sum()} states of the uniaxial tests ({', '.join(kinds)}) are exact but unstable "
        "equilibria: the law drives the two free stretches apart. They are marked in the figure, and "
        "negative_eigenvalues counts the unstable modes in the CSV file."
    )


def _first(name: str, tables: Mapping[str, Table]) -> list[str]:
    """The names of all tables, this one before the others."""
    return [name, *(other for other in tables if other != name)]


def _of_all_sets(tables: Mapping[str, Table]) -> report.Table:
    return report.Table(
        "Table 1 with each set of constants: how far its 40 entries are from the printed ones",
        ("set", "largest difference [% or kPa]", "largest relative residual [–]", "Table 1"),
        [
            (n, f"{t.max_abs_diff:.4f}", f"{t.residual:.1e}", "reproduced" if t.reproduced else "not reproduced")
            for n, t in tables.items()
        ],
    )


def _table1(name: str, table: Table) -> report.Table:
    rows = []
    for row in table.rows:
        a_over_D = "none" if row.a_over_D is None else f"{row.a_over_D:.2f}"
        ratio = _beside(row.ratio_percent, row.printed_ratio_percent)
        sigma22 = _beside(row.sigma22, row.printed_sigma22)
        rows.append([a_over_D, f"{row.T0:g}", *ratio, *sigma22])
    numbers = [f"{what}, {kind}" for what in ("σ22/σ11 [%]", "σ22 [kPa]") for kind in ("computed", "printed", "diff.")]
    return report.Table(
        f"Table 1 with the constants '{name}': equibiaxial stretch {STRETCH:g}, β = 1; none: no kinematic constraint",
        ("a/D [–]", "T0 [kPa]", *numbers),
        rows,
        row_headers=2,
    )


def _beside(computed: float, printed: float) -> list[str]:
    return [f"{computed:.4f}", f"{printed:.2f}", f"{computed - printed:+.4f}"]


def _free(name: str, sample: Sample) -> report.Table:
    rows = []
    for c, acting in enumerate(CONSTRAINT):
        state = sample.free.at((c, HALF))
        stretches = [f"{stretch:.5f}" for stretch in state.stretches]
        rows.append(["yes" if acting else "no", *stretches, f"{state.T_f:.4f}", f"{state.T_cf:.4f}"])
    return report.Table(
        f"Free contraction at full activation, β = 1, {_case(name)}; T_f, T_cf: pseudo-active tensions",
        ("constraint", "λf [–]", "λcf [–]", "λn [–]", "T_f [kPa]", "T_cf [kPa]"),
        rows,
    )


def _free_caption(name: str) -> str:
    return (
        "Free contraction: stretches [–] along f, cf and cf' over the time s [–] of the cycle, β = sin² πs, "
        f"{_case(name)}. Open symbols: the coupling by the kinematic constraint acts; full symbols: it does not; "
        "arrows from without to with, at s = ½."
    )


def _uniaxial_caption(name: str) -> str:
    return (
        "Uniaxial tests along f and along cf, active (β = 1, left) and passive (β = 0, right): Cauchy stress [kPa] in "
        "the direction of the test against the stretch [–] in it, the other two directions free of stress, "
        f"{_case(name)}. The tests begin at the stretch of the free contraction, or at 1 where that is above 1, and "
        f"end at {LAST_STRETCH:g}. Open symbols: the coupling acts in the free contraction; full symbols: it does not; "
        "arrows from without to with. A grey band marks unstable equilibria."
    )


def _case(name: str) -> str:
    return f"T0 = {T0_KPA:g} kPa, a/D = {A_OVER_D:g}, constants: {name}"
