"""Measured curves from a CSV file: units, measures, and what is said of a file that is wrong."""

import warnings
from pathlib import Path

import numpy as np
import pytest

import jaxmyo as jm

HEADER = "protocol,state,stretch_f,stretch_cf,cauchy_f [kPa],cauchy_cf [kPa]\n"


def written(folder: Path, text: str) -> Path:
    path = folder / "curves.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_curves_of_lin_and_yin() -> None:
    data = jm.lin_yin_data()
    assert len(data) == 54
    assert data.protocols == ("passive", "contracted")
    assert np.isfinite(data.stress).sum() == 104
    np.testing.assert_array_equal(data.beta, [p == "contracted" for p in data.protocol])
    np.testing.assert_array_equal(data.stretch[:, 0], data.stretch[:, 1])
    last = data.of("passive").rows([-1])
    assert (last.stretch[0, 0], last.stress[0, 0], last.lines[0]) == (1.34, 28.45, 29)
    assert (data.weight == 1.0).all()


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("kPa", 1.0), ("MPa", 1e3), ("mmHg", 0.133322387415), ("g/cm2", 0.0980665), ("g/cm²", 0.0980665), ("Pa", 1e-3)],
)
def test_units_of_stress(unit: str, factor: float, tmp_path: Path) -> None:
    path = written(tmp_path, f"stretch_f,stretch_cf,nominal_f [{unit}]\n1.1,1.2,2.5\n")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data = jm.read_data(path)
    np.testing.assert_allclose(data.stress[0, 0], 2.5 * factor, rtol=1e-15)
    assert data.measure == ("nominal",)


def test_green_strains_comments_weights_and_free_directions(tmp_path: Path) -> None:
    text = "# a note\ngreen_f, green_cf [-], pk2_f [kPa], weight\n0.22, 0.105, 3.0, 4\n\n0.1,,1.0,\n"
    data = jm.read_data(written(tmp_path, text))
    np.testing.assert_allclose(data.stretch[0], [1.2, 1.1, np.nan], rtol=1e-14)
    np.testing.assert_array_equal(data.weight, [4.0, 1.0])
    np.testing.assert_array_equal(data.lines, [3, 5])
    assert np.isnan(data.stretch[1, 1])
    assert data.protocols == ("test",)


def test_shear_and_control_by_stress(tmp_path: Path) -> None:
    text = (
        "protocol,beta,control,stretch_f,stretch_cf,shear_n-f,nominal_f [kPa],nominal_cf [kPa],nominal_n-f [kPa]\n"
        "shear,0.5,,,,0.3,,,1.2\n"
        "weights,,stress,1.1,1.05,,2.0,1.0,\n"
    )
    data = jm.read_data(written(tmp_path, text))
    np.testing.assert_array_equal(data.stress_controlled, [False, True])
    np.testing.assert_array_equal(data.beta, [0.5, 0.0])
    assert (data.shear[0, 4], data.stress[0, 7]) == (0.3, 1.2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stretch_f,cauchy_f [kPa]\n", "needs a header and at least one row"),
        ("stretch_f,stretch_cf\n1.1,1.1\n", "no column of a stress; add cauchy_f"),
        ("cauchy_f [kPa]\n1.0\n", "no column of a strain; add stretch_f"),
        ("stretch_f,cauchy_f [bar]\n1.1,1\n", "column 'cauchy_f' has the unit 'bar'; valid: kPa, Pa, MPa, mmHg, g/cm²"),
        ("stretch_f,cauchy_f\n1.1,1\n", "column 'cauchy_f' has the unit ''"),
        ("stretch_f [mm],cauchy_f [kPa]\n1.1,1\n", "column 'stretch_f' has no unit"),
        ("lambda_f,cauchy_f [kPa]\n1.1,1\n", "column 'lambda_f' is unknown; valid: protocol"),
        ("stretch_f,stretch_f,cauchy_f [kPa]\n1,1,1\n", "two columns are named 'stretch_f'"),
        (HEADER + "a,passive,1.1,1.1,1.0,1.0\na,passive,0.19,1.1,1.0,1.0\n", "line 3, column .stretch_f.: 0.19 is"),
        (HEADER + "a,passive,1.1,abc,1.0,1.0\n", "line 2, column 'stretch_cf': 'abc' is not a number"),
        (HEADER + "a,passive,1.1,nan,1.0,1.0\n", "line 2, column 'stretch_cf': 'nan' is not a number"),
        (HEADER + "a,asleep,1.1,1.1,1.0,1.0\n", "line 2, column 'state': 'asleep' is unknown; valid: passive, active"),
        (HEADER + "a,passive,1.1,1.1,1.0\n", "line 2: 5 cells, but the header names 6 columns"),
        (HEADER + "a,passive,1.1,1.1,,\n", "line 2: no stress"),
        (HEADER + "a,passive,,,1.0,\n", "line 2: no stretch, Green strain or shear"),
        (HEADER + "a,passive,1.1,,1.0,2.0\n", "line 2: a stress along cf but no stretch"),
        ("stretch_f,stretch_cf,stretch_n,cauchy_f [kPa]\n1,1,1,1\n", "line 2: all three stretches"),
        ("stretch_f,cauchy_f [kPa],nominal_f [kPa]\n1.1,1,1\n", r"stresses of several measures \(cauchy, nominal\)"),
        ("stretch_f,green_f,cauchy_f [kPa]\n1.1,0.1,1\n", "both stretch_f and green_f"),
        ("shear_f-n,shear_n-f,cauchy_f-n [kPa]\n0.1,0.1,1\n", "more than one mode of simple shear"),
        ("stretch_f,shear_f-n,cauchy_n-f [kPa]\n1.0,0.1,1\n", "a shear stress of mode n-f, but no shear_n-f"),
        ("stretch_f,control,pk2_f [kPa]\n1.1,stress,1\n", "control by stress is for cauchy or nominal"),
        ("stretch_f,weight,cauchy_f [kPa]\n1.1,-1,1\n", "line 2, column 'weight': -1 is outside"),
        ("stretch_f,beta,cauchy_f [kPa]\n1.1,1.5,1\n", "line 2, column 'beta': 1.5 is outside"),
        ("stretch_f,state,beta,cauchy_f [kPa]\n1.1,active,1,1\n", "'state' or 'beta', not both"),
    ],
)  # fmt: skip
def test_a_file_that_is_wrong(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message) as error:
        jm.read_data(written(tmp_path, text))
    assert "curves.csv" in str(error.value)


@pytest.mark.parametrize("stress", ["30000", "0.0001"])
def test_a_stress_that_makes_no_sense(stress: str, tmp_path: Path) -> None:
    path = written(tmp_path, f"stretch_f,stretch_cf,cauchy_f [MPa]\n1.1,1.1,{float(stress) / 1e3}\n")
    with pytest.warns(UserWarning, match=r"makes no sense for soft tissue .*Check the units in the header.*MPa"):
        jm.read_data(path)


def test_no_text_and_no_such_protocol(tmp_path: Path) -> None:
    path = tmp_path / "curves.csv"
    path.write_bytes(b"\xff\xfe\x00bad")
    with pytest.raises(ValueError, match="not a text file in UTF-8"):
        jm.read_data(path)
    with pytest.raises(ValueError, match="protocol = 'biaxial' is unknown; valid: 'passive', 'contracted'"):
        jm.lin_yin_data().of("biaxial")
