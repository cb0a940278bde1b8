"""The command `jaxmyo fit` on a file of one's own, and what it says of bad input."""

import json
from pathlib import Path

import numpy as np
import pytest

from jaxmyo import cli

STRETCHES = (1.1, 1.15, 1.2, 1.25)


@pytest.fixture(autouse=True)
def without_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cli, "use_compilation_cache", lambda: None)


def curves(folder: Path) -> Path:
    """Equibiaxial passive curves of C1p = 0.4 kPa, C4p = 1 and the rest as measured, in MPa."""
    rows = ["protocol,stretch_f,stretch_cf,cauchy_f [MPa],cauchy_cf [MPa]"]
    for s in STRETCHES:
        l2 = s * s
        x, y = 2.0 * l2 + l2**-2 - 3.0, l2 - 1.0
        e = 0.4 * np.exp(3.21 * x * x - 2.6 * x * y + y * y)
        w1, w4 = e * (6.42 * x - 2.6 * y), e * (-2.6 * x + 2.0 * y)
        cf = 2.0 * w1 * (l2 - l2**-2)
        f = cf + 2.0 * w4 * l2
        rows.append(f"equi,{s},{s},{float(f) / 1e3!r},{float(cf) / 1e3!r}")
    path = folder / "curves.csv"
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


@pytest.mark.slow
def test_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    command = ["fit", str(curves(tmp_path)), "--free", "C1p=0.3,C4p", "--json", "--out", str(out)]
    assert cli.main(command) == 0
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    assert result == json.loads((out / "fit.json").read_text(encoding="utf-8"))
    assert set(result["estimates"]) == {"C1p", "C4p"} == set(result["identifiable"])
    assert abs(result["estimates"]["C1p"]["value"] - 0.4) < 1e-6
    assert abs(result["estimates"]["C4p"]["value"] - 1.0) < 1e-6
    assert result["start"] == {"C1p": 0.3, "C4p": 2.01}
    assert (out / "fit.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert "Written: " in captured.err


@pytest.mark.slow
def test_values_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """T0 starts at the value it is given, two rows are enough for one constant, and the others are fixed."""
    path = tmp_path / "two.csv"
    path.write_text("\n".join(curves(tmp_path).read_text(encoding="utf-8").split("\n")[:3]), encoding="utf-8")
    command = ["fit", str(path), "--json", "--out", str(tmp_path / "out"), "--fix", "C4p=1"]
    assert cli.main([*command, "--free", "C1p=0.3,T0=0.6"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["start"] == {"C1p": 0.3, "T0": 0.6}
    assert result["fixed"]["C4p"] == 1.0
    assert abs(result["estimates"]["C1p"]["value"] - 0.4) < 1e-6
    assert not result["identifiable"]["T0"]  # passive curves do not feel it


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["no.csv"], "no.csv: No such file or directory"),
        (["{file}", "--free", "C9p"], "free = 'C9p' is unknown; valid: 'C1p'"),
        (["{file}", "--fix", "C9p"], "'C9p' is unknown; valid: 'C1p'"),
        (["{file}", "--free", "C1p=high"], "'C1p=high' is not NAME or NAME=NUMBER"),
        (["{file}", "--starts", "0"], "starts = 0 must be an integer ≥ 1"),
        (["{file}", "--T0", "-1"], "T0 = -1 is outside [0, inf]"),
    ],
)
def test_what_is_refused(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    filled = [a.format(file=curves(tmp_path)) for a in arguments]
    assert cli.main(["fit", *filled, "--out", str(tmp_path / "out")]) == 1
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.out == ""


@pytest.mark.parametrize(
    "arguments",
    [
        ["lin-yin", "--free", "C1p"],
        ["lin-yin", "--starts", "5"],
        ["table1", "--T0", "1"],
        ["table1", "--law", "guccione"],
    ],
)
def test_the_cases_of_the_paper_are_fitted_as_they_stand(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as exit_:
        cli.main(["fit", *arguments])
    assert exit_.value.code == 2
    assert f"{arguments[1]} is for a file of data; {arguments[0]} is fitted as it stands" in capsys.readouterr().err
