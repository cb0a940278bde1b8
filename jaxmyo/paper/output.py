"""CSV files: one row per state, the unit in the column's name, and what says how far each state can be trusted."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jaxmyo.files import write_rows
from jaxmyo.paper.homogeneous import CONSTRAINT, Point
from jaxmyo.paper.sample import A_OVER_D, BETAS, DIRECTIONS, N_STRETCHES, T0_KPA, S, Sample, activation
from jaxmyo.paper.table1 import STRETCH, Table


def write_csv(path: Path, rows: Iterable[Mapping[str, Any]]) -> Path:
    """Rows under the keys of the first one; numbers to 12 digits, None as an empty cell."""
    return write_rows(path, [{key: _cell(value) for key, value in row.items()} for row in rows])


def table_rows(tables: Mapping[str, Table]) -> Iterator[dict[str, Any]]:
    """Table 1 of each set beside the printed one; `constraint` is 0 and `a_over_D` empty without the constraint."""
    for name, table in tables.items():
        for row in table.rows:
            yield {
                "set": name,
                "constraint": int(row.a_over_D is not None),
                "a_over_D": row.a_over_D,
                "T0_kPa": row.T0,
                "stretch": STRETCH,
                "sigma11_kPa": row.sigma11,
                "sigma22_kPa": row.sigma22,
                "sigma22_paper_kPa": row.printed_sigma22,
                "ratio_percent": row.ratio_percent,
                "ratio_paper_percent": row.printed_ratio_percent,
                "lambda_f_A": row.lambda_A[0],
                "lambda_cf_A": row.lambda_A[1],
                "lambda_n_A": row.lambda_A[2],
                "negative_eigenvalues": row.negative_eigenvalues,
                "relative_residual": row.residual,
            }


def free_contraction_rows(name: str, sample: Sample) -> Iterator[dict[str, Any]]:
    """State A over the cycle; lambda_n is the paper's cf'."""
    for c, constraint in enumerate(CONSTRAINT):
        for k, (s, beta) in enumerate(zip(S, activation(S), strict=True)):
            state = sample.free.at((c, k))
            yield {"set": name, "constraint": int(constraint), "s": s, "beta": beta, **_columns(state)}


def uniaxial_rows(name: str, sample: Sample) -> Iterator[dict[str, Any]]:
    """State C of the uniaxial tests along `direction`, the other two directions free of stress."""
    for i, direction in enumerate(DIRECTIONS):
        for c, constraint in enumerate(CONSTRAINT):
            for b, beta in enumerate(BETAS):
                for k in range(N_STRETCHES):
                    state = sample.uniaxial.at((i, c, b, k))
                    case = {"set": name, "direction": direction, "constraint": int(constraint), "beta": beta}
                    yield {**case, "stretch": sample.stretch[i, c, b, k], **_columns(state)}


def _columns(state: Point) -> dict[str, Any]:
    return {
        "T0_kPa": T0_KPA,
        "a_over_D": A_OVER_D,
        "lambda_f": state.stretches[0],
        "lambda_cf": state.stretches[1],
        "lambda_n": state.stretches[2],
        "sigma11_kPa": state.sigma[0],
        "sigma22_kPa": state.sigma[1],
        "sigma33_kPa": state.sigma[2],
        "T_f_kPa": state.T_f,
        "T_cf_kPa": state.T_cf,
        "negative_eigenvalues": state.negative,
        "zero_eigenvalues": state.zero,
        "relative_residual": state.residual,
    }


def _cell(value: Any) -> str:
    if value is None or isinstance(value, str):
        return value or ""
    if isinstance(value, int | np.integer):
        return str(value)
    if not np.isfinite(value):
        raise ValueError(f"a number to be written is not finite: {value}")
    return f"{float(value):.12g}"
