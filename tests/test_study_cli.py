"""`jaxmyo study`, as a user runs it; it goes on with what is there, and says what it does not understand."""

import csv
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Command, jaxmyo_in

from jaxmyo import cli

GRID = ("study", "--a-over-D", "0:0.2:3", "--T0", "5:35:4", "--out", "study")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("study")


@pytest.fixture(scope="module")
def run(folder: Path) -> Command:
    return jaxmyo_in(folder)


@pytest.fixture(scope="module")
def first(run: Command) -> dict[str, Any]:
    done = run(*GRID, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_object_of_json(first: dict[str, Any]) -> None:
    assert first["axes"]["a_over_D"] == [0.0, 0.1, 0.2]
    assert first["axes"]["T0"] == [5.0, 15.0, 25.0, 35.0]
    assert first["fixed"] == {"beta": 1.0}
    assert (first["samples"], first["converged"], first["status_names"]) == (12, 12, {"0": "CONVERGED"})
    assert first["failures"] == "every sample converged"
    assert (first["units"]["T0"], first["units"]["sigma11"], first["units"]["lambda_f"]) == ("kPa", "kPa", "–")
    corner = {name: x[2][3] for name, x in first["outputs"].items()}
    assert [round(corner[name], 5) for name in ("lambda_f", "lambda_cf", "lambda_n")] == [0.71837, 0.95894, 1.45166]
    assert corner["sigma11"] == pytest.approx(38.957, abs=1e-3)  # Table 1 of the paper, stretched to 1.2 both ways
    assert corner["sigma22"] == pytest.approx(24.252, abs=1e-3)
    assert np.max(first["outputs"]["residual"]) < 1e-12
    assert [Path(file).name for file in first["files"]] == ["study.csv", "study.nc", "study.png"]


def test_files(first: dict[str, Any], folder: Path) -> None:
    with (folder / "study" / "study.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:4] == ["a_over_D", "T0_kPa", "beta", "lambda_f"]
    assert [float(row["sigma22_kPa"]) for row in rows] == np.ravel(first["outputs"]["sigma22"]).tolist()
    assert (folder / "study" / "study.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / "study" / "study.nc").read_bytes().startswith(b"CDF\x02")


@pytest.mark.slow
def test_another_run_goes_on(first: dict[str, Any], folder: Path, run: Command) -> None:
    """In another process, with other hashes of Python's: the same study, nothing is computed."""
    chunk = folder / "study" / "chunk-000000.npz"
    before = chunk.stat().st_mtime_ns
    os.environ["PYTHONHASHSEED"] = "7"
    try:
        done = run(*GRID)
    finally:
        del os.environ["PYTHONHASHSEED"]
    assert done.returncode == 0, done.stderr
    assert "Study of 12 samples (grid: a_over_D 3 × T0 4), 12 converged" in done.stdout
    assert chunk.stat().st_mtime_ns == before


def test_the_folder_of_another_study(first: dict[str, Any], run: Command) -> None:
    done = run(*GRID, "--set", "measured")
    assert done.returncode == 1
    assert "out = study has another study; it differs in:\n  scenes, 0, constants" in done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--T0", "a"), "--T0: 'a' is neither START:STOP:N (as 0:0.25:6) nor a number"),
        (("--T0", "1:60"), "'1:60' is neither START:STOP:N"),
        (("--T0", "1:60:0"), "'1:60:0' must have START < STOP and N ≥ 1"),
        (("--T0", "60:1:5"), "'60:1:5' must have START < STOP and N ≥ 1"),
        (("--T0", "nan"), "'nan' is not finite"),
        (("--T0=-1",), "--T0[0] = -1 is outside [0, inf] (kPa"),
        (("--a-over-D", "0:0.3:4"), "--a-over-D[3] = 0.3 is outside [0, 0.25]"),
        (("--beta", "2"), "--beta[0] = 2 is outside [0, 1]"),
        (("--stretch", "9", "1"), "--stretch = 9 is outside (0.2, 5)"),
        (("--stretch", "x", "1"), "'x' is no number"),
        (("--set", "mine"), "invalid choice: 'mine'"),
    ],
)
def test_what_is_not_understood(arguments: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main(["study", *arguments])
    assert caught.value.code == 2
    assert message in capsys.readouterr().err


def test_a_folder_that_cannot_be(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    assert cli.main(["study", "--out", str(tmp_path / "file")]) == 1
    assert "/file: cannot write" in capsys.readouterr().err
