"""The command `jaxmyo`, as a user runs it: in a process of its own, with a cache directory of its own."""

import csv
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo import cli
from jaxmyo.paper import command
from jaxmyo.paper.table1 import Row, Table

SAMPLE_CSV = ["table1.csv", "free_contraction.csv", "uniaxial.csv"]
STATES = [
    f"tube_{end}_{kind}{case}.vtu" for case in ("", "_without_constraint") for end in ("s0", "half") for kind in "AC"
]
PICTURES = [
    "free_contraction.png",
    "uniaxial.png",
    "tube_pressure.png",
    "tube_height.png",
    "tube_inner_radius.png",
    "tube_outer_radius.png",
    "tube_accuracy.png",
    "tube_weave.png",
]
FILES = [*SAMPLE_CSV, "tube.csv", "tube_weave.csv", *STATES, *PICTURES, "report.html"]


def compiled(folder: Path) -> dict[str, int]:
    """Name and size of every program in the compilation cache."""
    return {file.name: file.stat().st_size for file in (folder / "cache" / "jaxmyo").glob("*-cache")}


@pytest.fixture(scope="module")
def after_first(paper_folder: Path, paper_run: subprocess.CompletedProcess[str]) -> dict[str, int]:
    return compiled(paper_folder)


@pytest.fixture(scope="module")
def second(
    run_jaxmyo: Callable[..., subprocess.CompletedProcess[str]], after_first: dict[str, int]
) -> subprocess.CompletedProcess[str]:
    """A second run, of one set."""
    return run_jaxmyo("paper", "--set", "measured", "--out", "one")


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_json_on_stdout(paper_result: dict[str, Any]) -> None:
    keys = ["table", "free_contraction", "uniaxial", "claims", "tube", "files", "versions", "seconds"]
    assert list(paper_result) == keys
    assert list(paper_result["table"]) == ["printed", "table1", "measured"]
    for table in paper_result["table"].values():
        assert set(table) == {"max_abs_diff", "rows"}
        assert len(table["rows"]) == 20
        assert all(set(row) == {"a_over_D", "T0", "ratio_percent", "sigma22"} for row in table["rows"])
    differences = {name: round(table["max_abs_diff"], 4) for name, table in paper_result["table"].items()}
    assert differences == {"printed": 5.0933, "table1": 0.0054, "measured": 5.7042}
    assert {"python", "jaxmyo", "jax", "jaxlib", "numpy", "matplotlib", "meshio"} == set(paper_result["versions"])
    assert paper_result["seconds"] > 0.0


def test_free_contraction_to_all_digits(paper_result: dict[str, Any]) -> None:
    free = paper_result["free_contraction"]
    assert (free["set"], free["T0_kPa"], free["a_over_D"], free["beta"], free["s"]) == ("table1", 35.0, 0.2, 1.0, 0.5)
    keys = ("lambda_f", "lambda_cf", "lambda_n")
    assert [round(free["with_constraint"][k], 5) for k in keys] == [0.71837, 0.95894, 1.45166]
    assert [round(free["without_constraint"][k], 5) for k in keys] == [0.61749, 1.27258, 1.27258]
    assert free["with_constraint"]["T_cf_kPa"] > 0.0 > free["with_constraint"]["T_f_kPa"]
    assert free["without_constraint"]["T_cf_kPa"] == free["without_constraint"]["T_f_kPa"] == 0.0


def test_claims_say_what_is_not_reproduced(paper_result: dict[str, Any]) -> None:
    verdicts = [(claim["paper"], claim["reproduced"]) for claim in paper_result["claims"]]
    assert ("1.45", True) in verdicts
    assert ("1.25", False) in verdicts
    assert any(paper.startswith("16 %") and not reproduced for paper, reproduced in verdicts)


def test_prose_and_progress_on_stderr(paper_run: subprocess.CompletedProcess[str]) -> None:
    for text in (
        "done: figures",
        "done: tube of 32 elements",
        "about the tube",
        "table1: largest difference 0.0054, reproduces it",
        "NOT reproduced",
        "unstable",
    ):
        assert text in paper_run.stderr


def test_files(paper_folder: Path, paper_result: dict[str, Any]) -> None:
    assert [Path(file) for file in paper_result["files"]] == [Path("all") / name for name in FILES]
    assert sorted(p.name for p in (paper_folder / "all").iterdir()) == sorted(FILES)
    for name in PICTURES:
        data = (paper_folder / "all" / name).read_bytes()
        assert data[:8] == b"\x89PNG\r\n\x1a\n"
        width, height = struct.unpack(">II", data[16:24])
        assert width >= 1200
        assert height >= 800
        assert len(data) > 50_000


def test_csv_files(paper_folder: Path, paper_result: dict[str, Any]) -> None:
    table, free, uniaxial = (rows(paper_folder / "all" / name) for name in SAMPLE_CSV)
    assert (len(table), len(free), len(uniaxial)) == (60, 82, 488)
    state = {"T0_kPa", "lambda_f", "lambda_cf", "lambda_n", "sigma11_kPa", "sigma22_kPa", "T_f_kPa", "T_cf_kPa"}
    trust = {"negative_eigenvalues", "relative_residual"}
    assert {"set", "constraint", "a_over_D", "T0_kPa", "sigma22_kPa", "sigma22_paper_kPa"} | trust <= set(table[0])
    assert state | trust | {"s", "beta", "zero_eigenvalues"} <= set(free[0])
    assert state | trust | {"direction", "constraint", "beta", "stretch"} <= set(uniaxial[0])
    assert [{row["set"] for row in r} for r in (table, free, uniaxial)] == [set(jm.SETS), {"table1"}, {"table1"}]
    for row in [*table, *free, *uniaxial]:
        missing = {key for key, value in row.items() if value == ""}
        assert missing == ({"a_over_D"} if row["constraint"] == "0" and "ratio_percent" in row else set())
        assert np.isfinite([float(v) for k, v in row.items() if v and k not in ("set", "direction")]).all()
        assert float(row["relative_residual"]) <= 1e-13


def test_free_contraction_over_the_cycle(paper_folder: Path, paper_result: dict[str, Any]) -> None:
    free = rows(paper_folder / "all" / "free_contraction.csv")
    stretches = np.array([[float(row[f"lambda_{k}"]) for k in ("f", "cf", "n")] for row in free]).reshape(2, 41, 3)
    beta = np.array([float(row["beta"]) for row in free]).reshape(2, 41)
    s = np.array([float(row["s"]) for row in free]).reshape(2, 41)
    np.testing.assert_allclose(beta, np.sin(np.pi * s) ** 2, rtol=0, atol=1e-12)
    np.testing.assert_allclose(stretches.prod(axis=2), 1.0, rtol=0, atol=1e-11)
    np.testing.assert_allclose(stretches, stretches[:, ::-1], rtol=0, atol=1e-10)
    np.testing.assert_allclose(stretches[:, 0], 1.0, rtol=0, atol=1e-10)
    lf, lcf = stretches[0, :, 0], stretches[0, :, 1]
    np.testing.assert_allclose(lcf, 1 + (np.pi - 2) * (1 - lf**-0.5) * 0.2, rtol=0, atol=1e-11)
    np.testing.assert_allclose(stretches[1, :, 1], stretches[1, :, 2], rtol=0, atol=1e-10)


def test_uniaxial_tests(paper_folder: Path, paper_result: dict[str, Any]) -> None:
    states = rows(paper_folder / "all" / "uniaxial.csv")

    def column(name: str) -> np.ndarray:
        return np.array([float(row[name]) for row in states]).reshape(2, 2, 2, 61)

    stretch, sigma11, sigma22 = column("stretch"), column("sigma11_kPa"), column("sigma22_kPa")
    np.testing.assert_allclose(column("sigma33_kPa"), 0.0, rtol=0, atol=1e-9)
    np.testing.assert_allclose(sigma22[0], 0.0, rtol=0, atol=1e-9)
    np.testing.assert_allclose(sigma11[1], 0.0, rtol=0, atol=1e-9)
    np.testing.assert_allclose(stretch[0], column("lambda_f")[0], rtol=0, atol=1e-11)
    np.testing.assert_allclose(stretch[1], column("lambda_cf")[1], rtol=0, atol=1e-11)
    np.testing.assert_allclose(stretch[..., -1], 1.3, rtol=0, atol=1e-12)
    # The tests begin at the free contraction, free of stress; without the weave λcf > 1 there, and they begin at 1.
    np.testing.assert_allclose(stretch[:, 0, 0, 0], [0.71837, 0.95894], rtol=0, atol=5e-6)
    np.testing.assert_allclose(stretch[:, 1, 0, 0], [0.61749, 1.0], rtol=0, atol=5e-6)
    np.testing.assert_allclose(stretch[:, :, 1, 0], 1.0, rtol=0, atol=1e-10)
    np.testing.assert_allclose([sigma11[0, :, 0, 0], sigma11[0, :, 1, 0]], 0.0, rtol=0, atol=1e-9)
    # Passive curves do not know the constraint.
    np.testing.assert_allclose(sigma11[0, 0, 1], sigma11[0, 1, 1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(sigma22[1, 0, 1], sigma22[1, 1, 1], rtol=0, atol=1e-12)
    # Passive and stretched along the fibre: exact, and unstable.
    negative = column("negative_eigenvalues")
    assert (negative[0, :, 1, 1:] == 1).all()
    assert negative.sum() == 120 == paper_result["uniaxial"]["unstable_states"]


def test_a_table_as_text() -> None:
    row = Row(0.2, 35.0, 62.2512, 24.2513, 38.957, (0.71837, 0.95894, 1.45166), 62.25, 24.25, 1e-15, 0)
    without = replace(row, a_over_D=None, sigma22=4.3, printed_sigma22=4.32)
    assert command.format_table("measured", Table((row, without), 1e-15)).splitlines() == [
        "Table 1 with the constants 'measured' (equibiaxial stretch 1.2, beta = 1)",
        "            T0 |    sigma22/sigma11 [%]    |       sigma22 [kPa]      ",
        "     a/D [kPa] |  computed printed    diff |  computed printed    diff",
        "    0.20    35 |   62.2512   62.25 +0.0012 |   24.2513   24.25 +0.0013",
        "    none    35 |   62.2512   62.25 +0.0012 |    4.3000    4.32 -0.0200",
        "largest difference 0.0200; largest relative residual 1.0e-15",
    ]


def test_a_run_keeps_its_compiled_code(after_first: dict[str, int]) -> None:
    assert max(after_first.values()) > 100_000


@pytest.mark.slow
def test_one_set_as_a_table_on_stdout(paper_folder: Path, second: subprocess.CompletedProcess[str]) -> None:
    assert second.returncode == 0, second.stderr
    assert second.stdout.startswith("Table 1 with the constants 'measured'")
    assert second.stdout.count("largest difference") == 1
    assert "largest difference 5.7042" in second.stdout
    for name in ("table1.csv", "free_contraction.csv", "tube.csv"):
        assert {row["set"] for row in rows(paper_folder / "one" / name)} == {"measured"}


@pytest.mark.slow
def test_the_second_run_finds_the_compiled_code(
    paper_folder: Path, after_first: dict[str, int], second: subprocess.CompletedProcess[str]
) -> None:
    """Also with other constants: a run that missed a program would have left another one."""
    assert second.returncode == 0, second.stderr
    assert compiled(paper_folder) == after_first


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["paper", "--set", "lin-yin"], "invalid choice: 'lin-yin'"),
        ([], "the following arguments are required: COMMAND"),
        (["tube"], "invalid choice: 'tube'"),
    ],
)
def test_usage_errors(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as error:
        cli.main(arguments)
    assert error.value.code == 2
    assert message in capsys.readouterr().err


@pytest.fixture
def without_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cli, "use_compilation_cache", lambda: None)


@pytest.mark.usefixtures("without_cache")
def test_out_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    assert cli.main(["paper", "--out", str(tmp_path / "file" / "sub")]) == 1
    captured = capsys.readouterr()
    assert captured.err == f"--out {tmp_path / 'file' / 'sub'}: cannot write there (Not a directory)\n"
    assert captured.out == ""


@pytest.mark.usefixtures("without_cache")
@pytest.mark.parametrize("missing", ["tqdm", "meshio"])
def test_a_missing_extra_is_named(
    missing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    assert cli.main(["paper", "--out", str(tmp_path)]) == 1
    assert f"needs {missing}, which is not installed: pip install 'jaxmyo[paper]'" in capsys.readouterr().err


@pytest.mark.usefixtures("without_cache")
@pytest.mark.parametrize(
    ("arguments", "sets", "shown"),
    [([], ["printed", "table1", "measured"], "table1"), (["--set", "measured"], ["measured"], "measured")],
)
def test_the_sets_that_are_asked_for(
    arguments: list[str], sets: list[str], shown: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []

    def solve(names: list[str], name: str, progress: Any) -> None:
        asked.extend([names, name])
        raise jm.SolveError("enough", None)

    monkeypatch.setattr(command, "_solve", solve)
    assert cli.main(["paper", "--out", str(tmp_path), *arguments]) == 1
    assert asked == [sets, shown]


@pytest.mark.usefixtures("without_cache")
def test_a_failed_solve_is_a_message_and_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(constants: Any) -> None:
        raise jm.SolveError("NO_DESCENT at 40 % of the load", None)

    monkeypatch.setattr(command, "table1", fail)
    monkeypatch.setattr(command, "sample", fail)
    assert cli.main(["paper", "--json", "--out", str(tmp_path)]) == 1
    captured = capsys.readouterr()
    assert "NO_DESCENT at 40 % of the load" in captured.err
    assert captured.out == ""
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def jax_cache_settings() -> Iterator[None]:
    names = [
        "jax_compilation_cache_dir",
        "jax_persistent_cache_min_compile_time_secs",
        "jax_persistent_cache_min_entry_size_bytes",
    ]
    before = {name: getattr(jax.config, name) for name in names}
    jax.config.update("jax_compilation_cache_dir", None)
    yield
    for name, value in before.items():
        jax.config.update(name, value)


def cache_setting() -> str | None:
    return jax.config.jax_compilation_cache_dir


@pytest.mark.usefixtures("jax_cache_settings")
def test_cache_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    cli.use_compilation_cache()
    assert cache_setting() is None
    assert "Compiled code is not kept" in capsys.readouterr().err

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cli.use_compilation_cache()
    assert cache_setting() == str(tmp_path / "jaxmyo")

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "other"))
    cli.use_compilation_cache()
    assert cache_setting() == str(tmp_path / "jaxmyo")
