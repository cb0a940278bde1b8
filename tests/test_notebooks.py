"""The notebooks run, print what their text says that they print, and write the pictures that it shows."""

import re
from pathlib import Path

import jupytext
import matplotlib.pyplot as plt
import pytest

FOLDER = Path(__file__).parent.parent / "notebooks"


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [file.stem for file in sorted(FOLDER.glob("*.md"))],
)
def test_notebook(
    name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pictures").mkdir()
    plt.switch_backend("Agg")
    cells = jupytext.read(FOLDER / f"{name}.md").cells
    code = [cell.source for cell in cells if cell.cell_type == "code"]
    text = "\n".join(cell.source for cell in cells if cell.cell_type == "markdown")
    assert code
    names: dict[str, object] = {}
    for source in code:
        exec(source, names)
    plt.close("all")
    printed = capsys.readouterr().out.splitlines()
    said = re.findall(r"^    (.*)$", text, re.M)
    assert said
    assert [line for line in said if line not in printed] == []
    shown = {Path(path).name for path in re.findall(r"!\[[^]]*\]\((.*?)\)", text)}
    assert shown == {file.name for file in (tmp_path / "pictures").iterdir()}
    for picture in shown:
        assert (FOLDER / "pictures" / picture).stat().st_size < 150_000
