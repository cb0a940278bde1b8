"""What the paper says of the sample in words and numbers, each beside the number that comes out here."""

from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from jaxmyo.paper.sample import A_OVER_D, HALF, T0_KPA, Sample
from jaxmyo.paper.table1 import REPRODUCED, Table


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, what it gives for it, what is computed, and whether the two agree."""

    statement: str
    paper: str
    computed: str
    reproduced: bool

    def as_json(self) -> dict[str, Any]:
        """{"statement", "paper", "computed", "reproduced"}."""
        return asdict(self)

    def __str__(self) -> str:
        verdict = "reproduced" if self.reproduced else "NOT reproduced"
        return f"{self.statement}: paper {self.paper}, computed {self.computed}: {verdict}"


def claims(table: Table, sample: Sample) -> list[Claim]:
    """The statements about the thin sample. A printed number is reproduced if it is the computed one, rounded."""
    case = f"T0 = {T0_KPA:g} kPa, a/D = {A_OVER_D:g}"
    acting, absent = (float(sample.free.stretches[c, HALF, 2]) for c in (0, 1))
    thicker = 100.0 * (acting / absent - 1.0)
    passive_gap = float(np.abs(np.diff(sample.stress[:, :, 1], axis=1)).max())
    without = [row for row in table.rows if row.a_over_D is None]
    spread = max(r.sigma22 for r in without) - min(r.sigma22 for r in without)
    falls = all(a.ratio_percent > b.ratio_percent for a, b in pairwise(without))
    end = sample.stress[..., 0, -1]  # direction × constraint, β = 1, stretch 1.3
    ratio_with, ratio_without = (100.0 * float(end[1, c] / end[0, c]) for c in (0, 1))
    return [
        Claim(
            "Table 1 (equibiaxial stretch 1.2, β = 1), 40 entries",
            "two decimals each, % and kPa",
            f"largest difference {table.max_abs_diff:.4f}",
            table.reproduced,
        ),
        _number(f"normal stretch of the free contraction with the constraint ({case})", 1.45, acting),
        _number(f"normal stretch of the free contraction without the constraint (T0 = {T0_KPA:g} kPa)", 1.25, absent),
        Claim(
            f"normal stretch of the free contraction with the constraint over that without it, less one ({case})",
            "16 % (1.45 / 1.25 − 1)",
            f"{thicker:.2f} %",
            round(thicker) == 16,
        ),
        Claim(
            "without the constraint σ22 does not depend on T0 (Table 1: stretch 1.2 both ways)",
            "4.32 kPa at every T0",
            f"{without[0].sigma22:.4f} kPa, spread {spread:.1e} kPa",
            spread < 0.01 and abs(without[0].sigma22 - 4.32) <= REPRODUCED,
        ),
        Claim(
            "without the constraint σ22/σ11 decreases when T0 increases (Table 1: stretch 1.2 both ways)",
            "36.78 to 8.36 %",
            f"{without[0].ratio_percent:.2f} to {without[-1].ratio_percent:.2f} %",
            falls and max(abs(without[i].ratio_percent - x) for i, x in ((0, 36.78), (-1, 8.36))) <= REPRODUCED,
        ),
        Claim(
            f"the passive uniaxial curves are not affected by the constraint (a/D = {A_OVER_D:g})",
            "no difference",
            f"largest difference {passive_gap:.1e} kPa",
            passive_gap < 1e-9,
        ),
        Claim(
            f"active uniaxial tests along f and cf become comparable by the constraint (stretch 1.3, {case})",
            "comparable with it (no number given)",
            f"σ22/σ11 {ratio_with:.0f} % with, {ratio_without:.0f} % without",
            ratio_with > 50.0 > ratio_without,
        ),
    ]


def _number(statement: str, printed: float, computed: float) -> Claim:
    return Claim(statement, f"{printed:.2f}", f"{computed:.5f}", round(computed, 2) == printed)
