"""One HTML page that holds everything it shows: tables, figures, and claims with their verdicts.

`write` takes sections that are strings throughout, already formatted; it knows nothing of what they report. The page
opens offline: the figures are inside, as PNG data, and nothing is loaded from elsewhere. It is well-formed XML too.
"""

from base64 import b64encode
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from jaxmyo.paper.claims import Claim

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #111; }
h1, h2 { line-height: 1.25; }
h2 { margin-top: 2.5rem; border-bottom: 1px solid #bbb; }
table { border-collapse: collapse; margin: 1.5rem 0; font-variant-numeric: tabular-nums; }
caption, figcaption { text-align: left; font-size: 0.9rem; color: #444; padding: 0.3rem 0; }
th, td { padding: 0.2rem 0.7rem; text-align: left; vertical-align: top; border-bottom: 1px solid #ddd; }
thead th { border-bottom: 2px solid #888; }
tbody th { font-weight: normal; }
.number { text-align: right; }
.yes { color: #176117; }
.no { color: #a01010; font-weight: bold; }
figure { margin: 2rem 0; }
img { max-width: 100%; height: auto; }
footer { margin-top: 3rem; font-size: 0.9rem; color: #444; }
@media print {
  body { font-size: 10pt; max-width: none; margin: 0; padding: 0; }
  th, td { padding: 0.1rem 0.4rem; }
  tr, figure { break-inside: avoid; }
  h2, caption { break-after: avoid; }
}
"""


@dataclass(frozen=True)
class Table:
    """Cells already formatted, units in the header. The first `row_headers` cells of a row say what it is of."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    row_headers: int = 1


@dataclass(frozen=True)
class Section:
    """A part of the report. text: paragraphs, not HTML; figures: PNG files with their captions.

    Shown in the order text, claims, tables, figures.
    """

    title: str
    text: Sequence[str] = ()
    tables: Sequence[Table] = ()
    figures: Sequence[tuple[Path, str]] = ()
    claims: Sequence[Claim] = ()


def write(path: Path, title: str, sections: Sequence[Section], footer: str) -> Path:
    """The report as an HTML file; a summary of all claims comes before the sections."""
    parts = [_summary(sections), *(_section(number, section) for number, section in enumerate(sections, 1))]
    page = f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8"/>
<meta name="viewport" content="width=device-width"/>
<title>{escape(title)}</title>
<style>{STYLE}</style>
</head>
<body>
<h1>{escape(title)}</h1>
{_lines(parts)}
<footer>{_element("p", footer)}</footer>
</body>
</html>
"""
    path.write_text(page, encoding="utf-8")
    return path


def _summary(sections: Sequence[Section]) -> str:
    """How many claims are reproduced, in all and by section, and which are not."""
    every = [claim for section in sections for claim in section.claims]
    missed = [_element("li", str(claim)) for claim in every if not claim.reproduced]
    contents = []
    for number, section in enumerate(sections, 1):
        count = f": {_count(section.claims)}" if section.claims else ""
        contents.append(f'<li><a href="#section-{number}">{escape(section.title)}</a>{count}</li>')
    parts = [_element("h2", "Summary"), _element("p", f"{_count(every)}.")]
    if missed:
        parts.append(f"<ul>\n{_lines(missed)}\n</ul>")
    parts.append(f"<nav>\n<ul>\n{_lines(contents)}\n</ul>\n</nav>")
    return f'<section id="summary">\n{_lines(parts)}\n</section>'


def _count(claims: Sequence[Claim]) -> str:
    return f"{sum(claim.reproduced for claim in claims)} of {len(claims)} claims reproduced"


def _section(number: int, section: Section) -> str:
    parts = [
        _element("h2", section.title),
        *(_element("p", paragraph) for paragraph in section.text),
        *([_claims(section.claims)] if section.claims else []),
        *(_table(table) for table in section.tables),
        *(_figure(path, caption) for path, caption in section.figures),
    ]
    return f'<section id="section-{number}">\n{_lines(parts)}\n</section>'


def _claims(claims: Sequence[Claim]) -> str:
    rows = []
    for claim in claims:
        kind, verdict = ("yes", "reproduced") if claim.reproduced else ("no", "not reproduced")
        cells = [
            _element("th", claim.statement, 'scope="row"'),
            _element("td", claim.paper),
            _element("td", claim.computed),
            _element("td", verdict, f'class="{kind}"'),
        ]
        rows.append("".join(cells))
    header = [_element("th", name, 'scope="col"') for name in ("claim", "paper", "computed", "verdict")]
    return _grid("Claims of the paper", "".join(header), rows)


def _table(table: Table) -> str:
    align = ['class="number"' if all(map(_is_number, cells)) else "" for cells in zip(*table.rows, strict=True)]
    header = [_element("th", name, 'scope="col"', a) for name, a in zip(table.header, align, strict=True)]
    rows = []
    for row in table.rows:
        cells = list(zip(row, align, strict=True))
        of_row = [_element("th", cell, 'scope="row"', a) for cell, a in cells[: table.row_headers]]
        rows.append("".join(of_row + [_element("td", cell, a) for cell, a in cells[table.row_headers :]]))
    return _grid(table.caption, "".join(header), rows)


def _grid(caption: str, header: str, rows: Sequence[str]) -> str:
    """A table from rows of cells that are HTML already."""
    body = _lines(f"<tr>{row}</tr>" for row in rows)
    head = f"<thead>\n<tr>{header}</tr>\n</thead>"
    return f"<table>\n{_element('caption', caption)}\n{head}\n<tbody>\n{body}\n</tbody>\n</table>"


def _figure(path: Path, caption: str) -> str:
    data = b64encode(path.read_bytes()).decode("ascii")
    image = f'<img alt="{escape(path.stem.replace("_", " "))}" src="data:image/png;base64,{data}"/>'
    return f"<figure>\n{image}\n{_element('figcaption', caption)}\n</figure>"


def _element(tag: str, text: str, *attributes: str) -> str:
    """An element around text that is not HTML yet; empty attributes are left out."""
    return f"<{' '.join(filter(None, (tag, *attributes)))}>{escape(text)}</{tag}>"


def _is_number(cell: str) -> bool:
    """Whether a cell is a number, or the dash in the place of one."""
    try:
        float(cell.replace("−", "-"))
    except ValueError:
        return cell in ("", "–")
    return True


def _lines(parts: Iterable[str]) -> str:
    return "\n".join(parts)
