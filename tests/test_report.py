"""The report of `jaxmyo paper`: one page that holds all it shows and loads nothing."""

import re
from base64 import b64decode
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import pytest

from jaxmyo.paper.claims import Claim
from jaxmyo.paper.report import Section, Table, write

PNG = b"\x89PNG\r\n\x1a\n <not read, only shown>"


@pytest.fixture(scope="module")
def page(paper_folder: Path, paper_result: dict[str, Any]) -> str:
    return (paper_folder / "all" / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def root(page: str) -> Element:
    """The page is well-formed as XML, which is stricter than HTML."""
    return ElementTree.fromstring(page)


def text(element: Element) -> str:
    return "".join(element.itertext())


def tables(root: Element) -> Iterator[tuple[str, list[list[str]]]]:
    """The caption and the rows of every table; the header is the first row."""
    for table in root.iter("table"):
        yield text(table.find("caption")), [[text(cell) for cell in row] for row in table.iter("tr")]  # type: ignore[arg-type]


def table(root: Element, caption: str) -> list[list[str]]:
    (found,) = [rows for name, rows in tables(root) if name.startswith(caption)]
    return found


def images(root: Element) -> list[bytes]:
    sources = [image.attrib["src"].partition("data:image/png;base64,") for image in root.iter("img")]
    assert all(before == "" and mark for before, mark, _ in sources)
    return [b64decode(data, validate=True) for *_, data in sources]


def assert_self_contained(page: str) -> None:
    root = ElementTree.fromstring(page)
    assert not {"script", "link", "iframe", "object", "embed", "base"} & {element.tag for element in root.iter()}
    assert not re.search(r"https?://|@import|url\(", page)
    for element in root.iter():
        assert not [name for name in element.attrib if name.startswith("on") or name in ("style", "srcset")]
        assert element.attrib.get("src", "data:").startswith("data:")
        assert element.attrib.get("href", "#").startswith("#")


def test_loads_nothing(page: str) -> None:
    assert page.startswith("<!DOCTYPE html>\n")
    assert_self_contained(page)


def test_structure(root: Element) -> None:
    assert len(root.findall(".//h1")) == 1
    assert [text(h2) for h2 in root.iter("h2")] == [
        "Summary",
        "Constants and versions",
        "Thin sample",
        "Active thick-walled tube",
    ]
    ids = [section.attrib["id"] for section in root.iter("section")]
    assert [f"#{name}" for name in ids[1:]] == [a.attrib["href"] for a in root.iter("a")]
    for element in root.iter("table"):
        assert [child.tag for child in element] == ["caption", "thead", "tbody"]
        assert {th.attrib["scope"] for th in element.findall("thead/tr/th")} == {"col"}
        assert {th.attrib["scope"] for th in element.findall("tbody/tr/th")} <= {"row"}
        assert len({len(row) for row in element.iter("tr")}) == 1
    for figure in root.iter("figure"):
        assert [child.tag for child in figure] == ["img", "figcaption"]


def test_every_claim_with_its_verdict(root: Element, paper_result: dict[str, Any]) -> None:
    claims = paper_result["claims"]
    verdict = {True: "reproduced", False: "not reproduced"}
    expected = [[c["statement"], c["paper"], c["computed"], verdict[c["reproduced"]]] for c in claims]
    header = ["claim", "paper", "computed", "verdict"]
    shown = [rows for name, rows in tables(root) if name.startswith("Claims of the paper")]
    assert [rows[0] for rows in shown] == [header, header]
    assert [row for rows in shown for row in rows[1:]] == expected


def test_the_summary_counts(root: Element, paper_result: dict[str, Any]) -> None:
    claims = paper_result["claims"]
    summary = root.find(".//section[@id='summary']")
    assert summary is not None
    paragraph, missed = summary.find("p"), summary.findall("ul/li")
    assert paragraph is not None
    assert text(paragraph) == f"{sum(c['reproduced'] for c in claims)} of {len(claims)} claims reproduced."
    assert [text(item).split(": ")[0] for item in missed] == [c["statement"] for c in claims if not c["reproduced"]]


@pytest.mark.parametrize("name", ["table1", "printed", "measured"])
def test_all_40_entries_of_table_1(root: Element, paper_result: dict[str, Any], name: str) -> None:
    expected = [
        [
            "none" if row["a_over_D"] is None else f"{row['a_over_D']:.2f}",
            f"{row['T0']:.0f}",
            f"{row['ratio_percent']:.4f}",
            f"{row['sigma22']:.4f}",
        ]
        for row in paper_result["table"][name]["rows"]
    ]
    header, *rows = table(root, f"Table 1 with the constants '{name}'")
    assert [header[i] for i in (2, 5)] == ["σ22/σ11 [%], computed", "σ22 [kPa], computed"]
    assert len(rows) == 20
    assert [[row[i] for i in (0, 1, 2, 5)] for row in rows] == expected
    for row in rows:
        for computed, printed, difference in (row[2:5], row[5:8]):
            assert float(difference) == pytest.approx(float(computed) - float(printed), abs=1.01e-4)


def test_constants_and_versions(root: Element, paper_result: dict[str, Any]) -> None:
    header, *rows = table(root, "Constants of the Lin–Yin law")
    assert header[:3] == ["set", "C1p [kPa]", "C2p [–]"]
    assert [row[:3] for row in rows] == [
        ["printed", "0.292", "0.321"],
        ["table1", "0.0292", "3.21"],
        ["measured", "0.292", "3.21"],
    ]
    assert dict(zip(*table(root, "Versions"), strict=True)) == paper_result["versions"]


def test_free_contraction(root: Element) -> None:
    header, acting, absent = table(root, "Free contraction")
    assert header == ["constraint", "λf [–]", "λcf [–]", "λn [–]", "T_f [kPa]", "T_cf [kPa]"]
    assert acting[:4] == ["yes", "0.71837", "0.95894", "1.45166"]
    assert absent == ["no", "0.61749", "1.27258", "1.27258", "0.0000", "0.0000"]


def test_the_figures_are_the_files(root: Element, paper_folder: Path) -> None:
    of_tube = ["pressure", "height", "inner_radius", "outer_radius", "accuracy", "weave"]
    names = ["free_contraction", "uniaxial", *(f"tube_{name}" for name in of_tube)]
    assert images(root) == [(paper_folder / "all" / f"{name}.png").read_bytes() for name in names]
    for name, caption in zip(names, root.iter("figcaption"), strict=True):
        T0 = 15 if name.startswith("tube") else 35
        assert f"T0 = {T0} kPa, a/D = 0.2, constants: table1" in text(caption)


def test_the_tube(root: Element, paper_result: dict[str, Any]) -> None:
    header, *states = table(root, "The tube at s = 0")
    assert header[:6] == ["state", "s [–]", "constraint", "ri [mm]", "ro [mm]", "wall [mm]"]
    cases = {"yes": "with_constraint", "no": "without_constraint"}
    ends = {"0": "s0", "½": "half"}
    assert len(states) == 8
    for kind, s, acting, ri, ro, wall, height, q, *_ in states:
        numbers = paper_result["tube"][cases[acting]][ends[s]][kind]
        assert [ri, ro] == [f"{numbers[name]:.5f}" for name in ("ri_mm", "ro_mm")]
        assert float(wall) == pytest.approx(float(ro) - float(ri), abs=1.5e-5)
        assert height == f"{numbers['height_ratio']:.5f}"
        assert (q == "–") == (kind == "C" or acting == "no")
    exact = {tuple(row[:3]): row[3:] for row in table(root, "The exact tube")[1:]}
    assert [x[:12] for x in exact["C", "½", "yes"][:3]] == ["3.3491537917", "4.7858769907", "0.7058649924"]
    assert exact["A", "½", "yes"][3][:9] == "14.123834"


def test_the_accuracy_of_the_tube(root: Element, paper_result: dict[str, Any]) -> None:
    accuracy = paper_result["tube"]["accuracy"]
    header, *rows = table(root, "Relative L2 error")
    meshes = ["16 elements", "32 elements", "order [–]", "64 elements", "order [–]"]
    assert header == ["state", "constraint", *meshes, "extrapolated"]
    for kind, acting, *cells, extrapolated in rows:
        case = {"yes": "with_constraint", "no": "without_constraint"}[acting]
        errors = [mesh["relative_L2_error"][kind][case] for mesh in accuracy["meshes"]]
        assert [cells[i] for i in (0, 1, 3)] == [f"{error:.2e}" for error in errors]
        assert [cells[i] for i in (2, 4)] == [f"{order[kind][case]:.3f}" for order in accuracy["orders"]]
        assert extrapolated == f"{accuracy['extrapolated_relative_L2_error'][kind][case]:.1e}"
    times = table(root, "Time of these solves")[1:]
    assert [row[:2] for row in times] == [["16", "8"], ["32", "164"], ["64", "8"]]
    assert [row[2:] for row in times] == [
        [f"{mesh['solve_seconds']:.2f}", f"{mesh['total_seconds']:.1f}"] for mesh in accuracy["meshes"]
    ]


def test_unstable_states_are_told(root: Element) -> None:
    assert "120 states of the uniaxial tests (passive along f) are exact but unstable equilibria" in text(root)


HOSTILE = """<script>alert("1")</script> & 'x' &amp; <b class="no"> ]]> <!-- µ − λ"""


def test_text_is_shown_as_it_is(tmp_path: Path) -> None:
    figure = tmp_path / 'a"<b>&.png'
    figure.write_bytes(PNG)
    section = Section(
        HOSTILE,
        text=[HOSTILE],
        tables=[Table(HOSTILE, [HOSTILE, "kPa"], [[HOSTILE, HOSTILE]])],
        figures=[(figure, HOSTILE)],
        claims=[Claim(HOSTILE, HOSTILE, HOSTILE, reproduced=False)],
    )
    path = write(tmp_path / "report.html", HOSTILE, [section], HOSTILE)
    assert path == tmp_path / "report.html"
    page = path.read_text(encoding="utf-8")
    assert_self_contained(page)
    root = ElementTree.fromstring(page)
    assert not list(root.iter("b"))
    assert images(root) == [PNG]
    shown = ("title", "h1", "h2", "p", "caption", "th", "td", "figcaption", "a")
    assert {tag for tag in shown if HOSTILE in [text(element) for element in root.iter(tag)]} == set(shown)
    assert table(root, "Claims")[1] == [HOSTILE, HOSTILE, HOSTILE, "not reproduced"]
    assert [text(item) for item in root.findall(".//section/ul/li")] == [str(section.claims[0])]


def test_claims_of_all_sections_are_counted(tmp_path: Path) -> None:
    good, bad = (Claim("statement", "1", "1", reproduced) for reproduced in (True, False))
    sections = [Section("one", claims=[good, bad]), Section("two"), Section("three", claims=[good])]
    root = ElementTree.parse(write(tmp_path / "report.html", "title", sections, "footer")).getroot()
    assert "2 of 3 claims reproduced." in [text(p) for p in root.iter("p")]
    contents = [text(item) for item in root.findall(".//nav/ul/li")]
    assert contents == ["one: 1 of 2 claims reproduced", "two", "three: 1 of 1 claims reproduced"]


def test_columns_of_numbers_are_aligned(tmp_path: Path) -> None:
    rows = [["a", "0.1", "-1.5e-3", "x"], ["b", "−2", "–", "3"]]
    section = Section("title", tables=[Table("caption", ["name", "x", "y", "z"], rows, row_headers=2)])
    root = ElementTree.parse(write(tmp_path / "report.html", "title", [section], "footer")).getroot()
    for row in root.iter("tr"):
        assert [cell.attrib.get("class") for cell in row] == [None, "number", "number", None]
    assert [[cell.tag for cell in row] for row in root.findall(".//tbody/tr")] == 2 * [["th", "th", "td", "td"]]


@pytest.mark.parametrize("rows", [[["1", "2"], ["3"]], [["1", "2", "3"]]])
def test_rows_have_the_length_of_the_header(tmp_path: Path, rows: list[list[str]]) -> None:
    section = Section("title", tables=[Table("caption", ["x", "y"], rows)])
    with pytest.raises(ValueError, match="zip"):
        write(tmp_path / "report.html", "title", [section], "footer")
