"""`jaxmyo.paper`: Table 1 from the element in one batched solve, and the comparison with the paper."""

from dataclasses import replace

import numpy as np
import pytest
import reference

import jaxmyo as jm
from jaxmyo.paper import Table, output, table1
from jaxmyo.paper.table1 import REPRODUCED

TABLES: dict[str, Table] = {}


def table(name: str) -> Table:
    if name not in TABLES:
        TABLES[name] = table1(jm.SETS[name])
    return TABLES[name]


@pytest.mark.slow
def test_the_printed_table_is_the_one_of_the_reference() -> None:
    rows = [(r.a_over_D, r.T0, r.printed_ratio_percent, r.printed_sigma22) for r in table("table1").rows]
    assert rows == [tuple(row) for row in reference.PRINTED_TABLE]


def test_the_set_of_table_1_reproduces_it() -> None:
    found = table("table1")
    assert found.reproduced
    assert found.max_abs_diff <= REPRODUCED == 0.0056
    assert found.max_abs_diff == pytest.approx(0.0054, abs=5e-5)
    for row in found.rows:
        assert abs(row.ratio_percent - row.printed_ratio_percent) <= REPRODUCED
        assert abs(row.sigma22 - row.printed_sigma22) <= REPRODUCED
        assert row.ratio_percent == pytest.approx(100.0 * row.sigma22 / row.sigma11, rel=1e-14)
        assert row.negative_eigenvalues == 0
    assert found.residual <= 1e-13


@pytest.mark.slow
@pytest.mark.parametrize(("name", "difference"), [("printed", 5.0933), ("measured", 5.7042)])
def test_the_other_sets_do_not(name: str, difference: float) -> None:
    assert not table(name).reproduced
    assert table(name).max_abs_diff == pytest.approx(difference, abs=5e-5)
    assert table(name).residual <= 1e-13


def test_rows_as_json() -> None:
    found = table("table1").as_json()
    assert list(found) == ["max_abs_diff", "rows"]
    assert all(list(row) == ["a_over_D", "T0", "ratio_percent", "sigma22"] for row in found["rows"])
    assert [(row["a_over_D"], row["T0"]) for row in found["rows"]] == [
        (a, T0) for a in (0.10, 0.15, 0.20, None) for T0 in (5, 15, 25, 35, 45)
    ]


def test_free_contraction_behind_the_table() -> None:
    by_case = {(row.a_over_D, row.T0): row.lambda_A for row in table("table1").rows}
    np.testing.assert_array_equal(np.round(by_case[0.20, 35.0], 5), [0.71837, 0.95894, 1.45166])
    np.testing.assert_array_equal(np.round(by_case[None, 35.0], 5), [0.61749, 1.27258, 1.27258])


def test_no_number_from_a_state_that_was_not_found() -> None:
    with pytest.raises(jm.SolveError, match=r"state A of a/D = 0.1, T0 = 5 kPa: INVALID_INPUT"):
        table1(replace(jm.TABLE1, C1p=np.nan))


def test_csv_rows_have_units_and_no_missing_number() -> None:
    rows = list(output.table_rows({"table1": table("table1")}))
    assert len(rows) == 20
    assert {"T0_kPa", "sigma11_kPa", "sigma22_kPa", "ratio_percent", "negative_eigenvalues"} <= set(rows[0])
    for row in rows:
        assert (row["a_over_D"] is None) == (row["constraint"] == 0)
        assert all(value is not None for key, value in row.items() if key != "a_over_D")


def test_a_number_that_is_not_finite_is_not_written(tmp_path) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ValueError, match="not finite"):
        output.write_csv(tmp_path / "x.csv", [{"a_kPa": np.nan}])
