"""Files of gmsh (.msh): 4.1 and 2.2 are read, as text or binary; 4.1 is written, as text.

Read here and not through meshio, which takes data for the elements in their order in the file, whatever their numbers:
gmsh gives fibres to the hexahedra, not to the quads before them.
"""

import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmyo.formats import Content, nodal
from jaxmyo.mesh import Mesh

#: Element types: number → name and number of nodes.
_TYPES = {
    1: ("line", 2),
    2: ("triangle", 3),
    3: ("quad", 4),
    4: ("tetra", 4),
    5: ("hexahedron", 8),
    6: ("wedge", 6),
    7: ("pyramid", 5),
    8: ("line3", 3),
    9: ("triangle6", 6),
    10: ("quad9", 9),
    11: ("tetra10", 10),
    12: ("hexahedron27", 27),
    13: ("wedge18", 18),
    14: ("pyramid14", 14),
    15: ("vertex", 1),
    16: ("quad8", 8),
    17: ("hexahedron20", 20),
    18: ("wedge15", 15),
    19: ("pyramid13", 13),
}


class _Numbers:
    """Numbers of a section, one after the other, from text or binary."""

    def __init__(self, data: bytes, text: bool) -> None:
        self.data, self.text, self.at = data, text, 0
        self.words = data.split() if text else []

    def take(self, kind: str, n: int) -> NDArray[Any]:
        """n numbers: "i" int32, "u" uint64, "d" float64."""
        if self.text:
            words = self.words[self.at : self.at + n]
            self.at += n
            if len(words) < n:
                raise ValueError("the file ends too early")
            return np.array(words, dtype=np.float64 if kind == "d" else np.int64)
        dtype = {"i": "<i4", "u": "<u8", "d": "<f8"}[kind]
        found = np.frombuffer(self.data, dtype, n, self.at)
        self.at += found.nbytes
        return found if kind == "d" else found.astype(np.int64)

    def one(self, kind: str) -> int:
        return int(self.take(kind, 1)[0])


class _Elements:
    """Types, labels, nodes and physical groups of the elements, as they come."""

    def __init__(self) -> None:
        self.labels: dict[str, list[NDArray[np.int64]]] = {}
        self.nodes: dict[str, list[NDArray[np.int64]]] = {}
        self.groups: dict[str, list[list[int]]] = {}  # one list of groups per element

    def add(self, kind: str, labels: NDArray[np.int64], nodes: NDArray[np.int64], groups: list[list[int]]) -> None:
        self.labels.setdefault(kind, []).append(labels)
        self.nodes.setdefault(kind, []).append(nodes)
        self.groups.setdefault(kind, []).extend(groups)


def read(path: Path) -> Content:
    """The mesh of a file. Faces are physical surfaces (of quads), regions physical volumes.

    A group without a name is called by its number. Views on nodes and elements are fields. Errors: a ValueError for
    other versions and element types.
    """
    sections = _sections(path.read_bytes())
    version, mode, _ = sections["MeshFormat"][0].split()[:3]
    if version not in (b"4.1", b"2.2", b"2"):
        raise ValueError(f"MSH version {version.decode()} is not supported; save it as 4.1 or 2.2")
    text = mode == b"0"
    if not text and not np.frombuffer(sections["MeshFormat"][0].split(b"\n", 1)[1], "<i4", 1)[0] == 1:
        raise ValueError("binary MSH with the other byte order is not supported")
    numbers = {s: _Numbers(data[0], text) for s, data in sections.items()}
    names = {}
    for dim, tag, name in re.findall(r'(\d) +(\d+) +"(.*)"', sections.get("PhysicalNames", [b""])[0].decode()):
        names[int(dim), int(tag)] = name
    elements = _Elements()
    if version == b"4.1":
        labels, points = _nodes_4(numbers["Nodes"])
        _elements_4(numbers["Elements"], _entities(numbers["Entities"]) if "Entities" in numbers else {}, elements)
    else:
        labels, points = _nodes_2(sections["Nodes"][0], text)
        _elements_2(sections["Elements"][0], text, elements)
    order = np.argsort(labels, kind="stable")
    content = Content(points, {})
    for kind, nodes in elements.nodes.items():
        content.cells[kind] = _places(labels, order, np.concatenate(nodes))
    for kind, dim, sets in (("quad", 2, content.faces), ("hexahedron", 3, content.regions)):
        members: dict[int, list[int]] = {}
        for k, groups in enumerate(elements.groups.get(kind, [])):
            for tag in groups:
                members.setdefault(tag, []).append(k)
        for tag, own in sorted(members.items()):
            which = np.array(own, dtype=np.int64)
            sets[names.get((dim, tag), str(tag))] = content.cells["quad"][which] if dim == 2 else which
    hexahedra = np.concatenate(elements.labels.get("hexahedron", [np.zeros(0, dtype=np.int64)]))
    for section, found, own_labels in (
        ("NodeData", content.node_fields, labels),
        ("ElementData", content.element_fields, hexahedra),
    ):
        for data in sections.get(section, []):
            name, tags, values = _view(data, text)
            row = {int(tag): k for k, tag in enumerate(tags)}
            there = [(k, row[tag]) for k, tag in enumerate(own_labels.tolist()) if tag in row]
            if there:
                full = np.full((len(own_labels), *values.shape[1:]), np.nan)
                full[[k for k, _ in there]] = values[[k for _, k in there]]
                found[name] = full
    return content


def write(path: Path, mesh: Mesh) -> None:
    """MSH 4.1 as text: each face a physical surface of its own, each region a physical volume, fields as views."""
    n_n, n_e = len(mesh.points), len(mesh.cells)
    owner = np.zeros(n_e, dtype=np.int64)  # number of the region, from 1; 0 if there are none
    for k, elements in enumerate(mesh.regions.values()):
        owner[elements] = k + 1
    starts = [0, *(np.flatnonzero(np.diff(owner)) + 1).tolist(), n_e]
    volumes = list(pairwise(starts))  # one entity per run: the order of the elements stays
    lines = ["$MeshFormat", "4.1 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(mesh.faces) + len(mesh.regions))]
    lines += [f'2 {k + 1} "{name}"' for k, name in enumerate(mesh.faces)]
    lines += [f'3 {k + 1} "{name}"' for k, name in enumerate(mesh.regions)]
    lines += ["$EndPhysicalNames", "$Entities", f"0 0 {len(mesh.faces)} {len(volumes)}"]
    limits = " ".join(map(repr, [*mesh.points.min(axis=0).tolist(), *mesh.points.max(axis=0).tolist()]))
    lines += [f"{k + 1} {limits} 1 {k + 1} 0" for k in range(len(mesh.faces))]
    for k, (start, _) in enumerate(volumes):
        lines.append(f"{k + 1} {limits} {f'1 {owner[start]}' if owner[start] else '0'} 0")
    lines += ["$EndEntities", "$Nodes", f"1 {n_n} 1 {n_n}", f"3 1 0 {n_n}", *(str(k + 1) for k in range(n_n))]
    lines += [" ".join(map(repr, x)) for x in mesh.points.tolist()]
    total = n_e + sum(map(len, mesh.faces.values()))
    lines += ["$EndNodes", "$Elements", f"{len(volumes) + len(mesh.faces)} {total} 1 {total}"]
    for k, (start, end) in enumerate(volumes):
        lines.append(f"3 {k + 1} 5 {end - start}")
        lines += _rows(start + 1, mesh.cells[start:end] + 1)
    label = n_e + 1
    for k, quads in enumerate(mesh.faces.values()):
        lines.append(f"2 {k + 1} 3 {len(quads)}")
        lines += _rows(label, quads + 1)
        label += len(quads)
    lines.append("$EndElements")
    for name, values in mesh.fields.items():
        rows = values.reshape(len(values), -1)
        section = "NodeData" if nodal(mesh, name) else "ElementData"
        lines += [f"${section}", "1", f'"{name}"', "1", "0.0", "3", "0", str(rows.shape[1]), str(len(rows))]
        lines += [f"{k + 1} " + " ".join(map(repr, row)) for k, row in enumerate(rows.tolist())]
        lines.append(f"$End{section}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _rows(first: int, nodes: NDArray[np.int64]) -> list[str]:
    return [" ".join(map(str, [first + k, *row])) for k, row in enumerate(nodes.tolist())]


def _sections(data: bytes) -> dict[str, list[bytes]]:
    """What stands between $Name and $EndName; views may come more than once."""
    found: dict[str, list[bytes]] = {}
    at = 0
    while (match := re.compile(rb"\$(\w+)[ \r]*\n").search(data, at)) is not None:
        end = data.find(b"$End" + match[1], match.end())
        if end < 0:
            raise ValueError(f"the section ${match[1].decode()} does not end")
        found.setdefault(match[1].decode(), []).append(data[match.end() : end])
        at = end + 4 + len(match[1])
    if missing := [s for s in ("MeshFormat", "Nodes", "Elements") if s not in found]:
        raise ValueError(f"not a mesh of gmsh: no section ${missing[0]}")
    return found


def _entities(n: _Numbers) -> dict[tuple[int, int], list[int]]:
    """(Dimension, entity) → its physical groups."""
    groups = {}
    for dim, count in enumerate(n.take("u", 4).tolist()):
        for _ in range(count):
            tag = n.one("i")
            n.take("d", 6 if dim else 3)
            groups[dim, tag] = [abs(int(g)) for g in n.take("i", n.one("u"))]
            if dim:
                n.take("i", n.one("u"))
    return groups


def _nodes_4(n: _Numbers) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    blocks = n.take("u", 4)[0]
    labels, points = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))]
    for _ in range(blocks):
        dim, _, parametric = n.take("i", 3).tolist()
        count, width = n.one("u"), 3 + (dim if parametric else 0)
        labels.append(n.take("u", count))
        points.append(n.take("d", count * width).reshape(count, width)[:, :3])
    return np.concatenate(labels), np.concatenate(points)


def _elements_4(n: _Numbers, groups: dict[tuple[int, int], list[int]], elements: _Elements) -> None:
    for _ in range(n.take("u", 4)[0]):
        dim, entity, number = n.take("i", 3).tolist()
        kind, width = _type(number)
        count = n.one("u")
        rows = n.take("u", count * (1 + width)).reshape(count, 1 + width)
        elements.add(kind, rows[:, 0], rows[:, 1:], [groups.get((dim, entity), [])] * count)


def _nodes_2(data: bytes, text: bool) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    count, rest = data.split(b"\n", 1)
    if text:
        rows = np.array(rest.split(), dtype=np.float64).reshape(int(count), 4)
        return rows[:, 0].astype(np.int64), rows[:, 1:]
    records = np.frombuffer(rest, [("label", "<i4"), ("x", "<f8", 3)], int(count))
    return records["label"].astype(np.int64), records["x"].astype(np.float64)


def _elements_2(data: bytes, text: bool, elements: _Elements) -> None:
    count, rest = data.split(b"\n", 1)
    n, done = _Numbers(rest, text), 0
    while done < int(count):
        if text:
            label, number, tags = n.take("i", 3).tolist()
            kind, width = _type(number)
            row = np.concatenate([[label], n.take("i", tags + width)])[None]
        else:
            number, own, tags = n.take("i", 3).tolist()
            kind, width = _type(number)
            row = n.take("i", own * (1 + tags + width)).reshape(own, -1)
        groups = [[g] if g else [] for g in np.abs(row[:, 1]).tolist()] if tags else [[]] * len(row)
        elements.add(kind, row[:, 0], row[:, 1 + tags :], groups)
        done += len(row)


def _type(number: int) -> tuple[str, int]:
    if number not in _TYPES:
        raise ValueError(f"elements of gmsh's type {number} are not supported, only hexahedra of 8 nodes")
    return _TYPES[number]


def _places(labels: NDArray[np.int64], order: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.int64]:
    """The numbers from 0 of nodes with these labels."""
    place = order[np.minimum(np.searchsorted(labels, wanted, sorter=order), len(labels) - 1)]
    if (bad := labels[place] != wanted).any():
        raise ValueError(f"an element refers to the node {wanted[bad][0]}, which the file does not have")
    return place


def _view(data: bytes, text: bool) -> tuple[str, NDArray[np.int64], NDArray[np.float64]]:
    """Name, labels and values, (n,) or (n, components)."""
    lists = []
    for _ in range(3):
        count, data = data.split(b"\n", 1)
        *items, data = data.split(b"\n", int(count))
        lists.append([item.strip().decode() for item in items])
    width, n = int(lists[2][1]), int(lists[2][2])
    if text:
        rows = np.array(data.split(), dtype=np.float64).reshape(n, 1 + width)
        labels, values = rows[:, 0].astype(np.int64), rows[:, 1:]
    else:
        records = np.frombuffer(data, [("label", "<i4"), ("values", "<f8", (width,))], n)
        labels, values = records["label"].astype(np.int64), records["values"].astype(np.float64)
    return lists[0][0].strip('"'), labels, values[:, 0] if width == 1 else values
