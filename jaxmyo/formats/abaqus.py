"""Abaqus input files (.inp): one part, with nodes, elements, sets and element surfaces."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jaxmyo.formats import Content
from jaxmyo.hexahedron import QUADS
from jaxmyo.mesh import Mesh

#: Element types: pattern → name and number of nodes (0: not read any further).
_TYPES = {
    r"C3D8\w*": ("hexahedron", 8),
    r"(S|M3D|SFM3D|R3D|CPS|CPE|CAX)4\w*": ("quad", 4),
    r"(T2D2|T3D2|B21|B31|B33)H?": ("line", 2),
    r"C3D4\w*": ("tetra", 0),
    r"C3D10\w*": ("tetra10", 0),
    r"C3D5\w*": ("pyramid", 0),
    r"C3D6\w*": ("wedge", 0),
    r"C3D15\w*": ("wedge15", 0),
    r"C3D20\w*": ("hexahedron20", 0),
    r"C3D27\w*": ("hexahedron27", 0),
}
_Card = tuple[str, dict[str, str], list[list[str]]]


def read(path: Path) -> Content:
    """The part of an input file.

    Faces: *SURFACE of sides of elements, and element sets of quads (S4, M3D4, SFM3D4, ...). Regions: the element sets
    of the *SOLID SECTIONs; if there are none, every *ELSET of hexahedra; if there is none, the sets of *ELEMENT.
    Node sets: *NSET. Sets that the file marks as internal are used by its surfaces only.
    Errors: a ValueError for moved instances, assemblies of several parts, and *INCLUDE.
    """
    cards = _cards(path)
    words = [c[0] for c in cards]
    if "INCLUDE" in words or words.count("PART") > 1 or any(w == "INSTANCE" and rows for w, _, rows in cards):
        raise ValueError("*INCLUDE, several parts and moved instances are not supported; write one part, one file")
    rows = [row for word, _, data in cards if word == "NODE" for row in data]
    number = {int(row[0]): k for k, row in enumerate(rows)}
    if len(number) < len(rows):
        raise ValueError(f"{len(rows) - len(number)} node label(s) occur twice")
    if any(len(row) != 4 for row in rows):
        raise ValueError("nodes must have a label and three coordinates")
    content = Content(np.array([[float(x) for x in row[1:]] for row in rows]).reshape(-1, 3), {})

    cells: dict[str, list[list[int]]] = {}
    place: dict[int, tuple[str, int]] = {}  # element label → type and number
    elements: dict[str, list[int]] = {}  # set → element labels; names are in upper case: Abaqus ignores it
    nodes: dict[str, list[int]] = {}
    names: dict[str, str] = {}  # as the file spells them
    internal: set[str] = set()

    def collect(sets: dict[str, list[int]], name: str, labels: list[int]) -> None:
        names.setdefault(name.upper(), name)
        sets.setdefault(name.upper(), []).extend(labels)

    for word, options, data in cards:
        if word == "NODE" and "NSET" in options:
            collect(nodes, options["NSET"], [int(row[0]) for row in data])
        elif word == "ELEMENT":
            kind, n = next(
                (t for pattern, t in _TYPES.items() if re.fullmatch(pattern, options["TYPE"].upper())),
                (options["TYPE"], 0),
            )
            own = cells.setdefault(kind, [])
            for row in data:
                if n and len(row) != n + 1:
                    raise ValueError(f"element {row[0]} of type {options['TYPE']} has {len(row) - 1} nodes, not {n}")
                if int(row[0]) in place:
                    raise ValueError(f"the element label {row[0]} occurs twice")
                place[int(row[0])] = kind, len(own)
                own.append([number[int(node)] for node in row[1 : n + 1]])
            if "ELSET" in options:
                collect(elements, options["ELSET"], [int(row[0]) for row in data])
        elif word in ("NSET", "ELSET"):
            sets = nodes if word == "NSET" else elements
            collect(sets, options[word], _labels(data, "GENERATE" in options, sets))
            if "INTERNAL" in options:
                internal.add(options[word].upper())
    content.cells = {kind: np.array(own, dtype=np.int64).reshape(len(own), -1) for kind, own in cells.items() if own}
    content.node_sets = {
        names[s]: np.array([number[k] for k in labels]) for s, labels in nodes.items() if s not in internal
    }

    def numbers(labels: list[int], kind: str) -> NDArray[np.int64]:
        return np.array([place[k][1] for k in labels if place[k][0] == kind], dtype=np.int64)

    for s, labels in elements.items():
        if s not in internal and (quads := numbers(labels, "quad")).size:
            content.faces[names[s]] = content.cells["quad"][quads]
    for source in ("SOLID SECTION", "ELSET", "ELEMENT"):  # the first one that says anything
        named = [o["ELSET"].upper() for word, o, _ in cards if word == source and "ELSET" in o]
        solids = {names[s]: numbers(elements[s], "hexahedron") for s in named if s not in internal}
        if regions := {name: hexahedra for name, hexahedra in solids.items() if hexahedra.size}:
            content.regions = regions
            break
    for word, options, data in cards:
        if word == "SURFACE" and options.get("TYPE", "ELEMENT").upper() == "ELEMENT":
            found = []
            for row in data:
                if len(row) < 2:
                    raise ValueError(f"surface {options['NAME']!r}: {row[0]} has no side, S1 to S6")
                who, side = row[:2]
                labels = [int(who)] if who.isdigit() else elements[who.upper()]
                if re.fullmatch("S[1-6]", side.upper()):
                    corners = content.cells["hexahedron"][numbers(labels, "hexahedron")]
                    found.append(corners[:, QUADS[int(side[1]) - 1]])
                else:  # the side of a shell
                    found.append(content.cells["quad"][numbers(labels, "quad")])
            content.faces[options["NAME"]] = np.concatenate(found)
    return content


def write(path: Path, mesh: Mesh, sides: dict[str, NDArray[np.int64]]) -> None:
    """One part: C3D8 elements, regions as *ELSET, faces as *SURFACE of sides of elements.

    sides: face → (n, 2), element and row of `QUADS` of each quad. There is no place for fields: a ValueError.
    """
    if mesh.fields:
        raise ValueError(
            f"an Abaqus file cannot hold the fields {', '.join(map(repr, mesh.fields))}: write .vtu, .xdmf or .msh"
        )
    lines = ["*NODE", *(f"{k + 1}, " + ", ".join(map(repr, x)) for k, x in enumerate(mesh.points.tolist()))]
    lines += ["*ELEMENT, TYPE=C3D8"]
    lines += [", ".join(map(str, [e + 1, *c])) for e, c in enumerate((mesh.cells + 1).tolist())]
    for name, elements in mesh.regions.items():
        labels = [str(e + 1) for e in elements]
        lines += [f"*ELSET, ELSET={name}", *(", ".join(labels[k : k + 8]) for k in range(0, len(labels), 8))]
    for name, pairs in sides.items():
        lines += [f"*SURFACE, NAME={name}, TYPE=ELEMENT", *(f"{e + 1}, S{k + 1}" for e, k in pairs)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _cards(path: Path) -> list[_Card]:
    """Keyword, options and data rows of each block; a line that ends with a comma goes on in the next."""
    cards: list[_Card] = []
    goes_on = False
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        line = line.strip()
        if not line or line.startswith("**"):
            continue
        if line.startswith("*"):
            word, *options = (part.strip() for part in line[1:].split(","))
            pairs = (option.partition("=") for option in options)
            cards.append((word.upper(), {k.strip().upper(): v.strip() for k, _, v in pairs}, []))
            goes_on = False
        elif cards:
            row = [x.strip() for x in line.rstrip(",").split(",")]
            keyword, _, data = cards[-1]
            if goes_on and keyword == "ELEMENT":
                data[-1] += row
            else:
                data.append(row)
            goes_on = line.endswith(",")
    return cards


def _labels(data: list[list[str]], generate: bool, sets: dict[str, list[int]]) -> list[int]:
    if generate:
        ranges = [[int(x) for x in row] for row in data]
        return [k for first, last, *step in ranges for k in range(first, last + 1, *step)]
    found: list[int] = []
    for item in (x for row in data for x in row if x):
        found += [int(item)] if item.isdigit() else sets[item.upper()]
    return found
