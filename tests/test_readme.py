"""The examples of the README run, and print what they say."""

import re
from pathlib import Path

import numpy as np
import pytest


@pytest.mark.slow
def test_examples_of_the_readme(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # one of them writes a file
    text = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")
    examples = re.findall(r"^```python\n(.*?)^```", text, re.S | re.M)
    assert len(examples) == 7
    exec("\n".join(examples), {})
    printed = capsys.readouterr().out
    assert "mean stretches 0.71837, 0.95894, 1.45166" in printed
    numbers = np.array(re.findall(r"\d+\.\d*(?:e[+-]\d+)?", printed), float)
    for stress in (38.95775, 24.25157):  # [kPa], along and across the fibres
        assert np.abs(numbers - stress).min() < 2e-5
    assert "1000 CONVERGED" in printed
    assert "Study of 60 samples (grid: a_over_D 6 × T0 10), 60 converged" in printed
    assert "C1p = 0.3658" in printed
    names = {"tube.pvd", "C.npz", "study", *(f"tube_{k:04d}.vtu" for k in range(5))}
    assert {file.name for file in (tmp_path / "out").iterdir()} == names
