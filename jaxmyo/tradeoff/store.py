"""What was measured, line by line in a file: an interrupted run goes on where it stood."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from jaxmyo.tradeoff.dials import Dials
from jaxmyo.tradeoff.measure import Point


class Store:
    """The file of points, one JSON object a line; the first line says what they were measured with."""

    def __init__(self, path: Path, versions: dict[str, str]) -> None:
        self.path = path
        self.points: list[Point] = []
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        whole = text[: text.rfind("\n") + 1]
        if whole != text:  # the run was killed while it wrote a line
            path.write_text(whole, encoding="utf-8")
        lines = whole.splitlines()
        if lines and json.loads(lines[0]) == versions:
            self.points = [_point(json.loads(line)) for line in lines[1:]]
        else:
            path.write_text(json.dumps(versions) + "\n", encoding="utf-8")

    def of(self, body: str, dials: Sequence[Dials]) -> list[Point]:
        """Those settings that were measured before."""
        return [p for p in self.points if p.body == body and p.dials in dials]

    def keep(self, point: Point) -> None:
        """Append a point."""
        self.points.append(point)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(as_json(point), ensure_ascii=False) + "\n")


def as_json(point: Point) -> dict[str, Any]:
    """A point as plain data."""
    found = asdict(point)
    del found["parts"]
    return found


def _point(found: dict[str, Any]) -> Point:
    outputs = found.pop("outputs")
    dials = Dials(**found.pop("dials"))
    return Point(dials=dials, outputs=None if outputs is None else tuple(outputs), **found)
