"""VTU and XDMF files, through meshio. Faces are quads beside the hexahedra; names are those of integer cell data.

"face:NAME" is not 0 on the quads of a face, "region:NAME" on the hexahedra of a region. What other programs write is
read too: numbers in "face" (on quads), "region" (on hexahedra) and "gmsh:physical" (on both) are names, "1", "2", ...;
0 is none. Data of the points called "face:NAME" are a set of nodes, which gives a face in a file without quads.
"""

from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree.ElementTree import ParseError

import numpy as np
from numpy.typing import NDArray

from jaxmyo import checks
from jaxmyo.formats import Content, nodal
from jaxmyo.mesh import Mesh

#: Integer data of cells that number what they mark.
TAGS = {"face": ("face",), "region": ("region",), "gmsh:physical": ("face", "region")}


def read(path: Path) -> Content:
    """The only grid of the file."""
    meshio = _meshio(path)
    try:
        raw = meshio.read(path)
    except (SystemExit, meshio.ReadError, ParseError) as error:  # meshio leaves the program where it finds no mesh
        raise ValueError(f"meshio cannot read this file: {error}") from error
    content = Content(np.asarray(raw.points, dtype=np.float64), {})
    for block in raw.cells:
        before = [content.cells[block.type]] if block.type in content.cells else []
        content.cells[block.type] = np.concatenate([*before, np.asarray(block.data, dtype=np.int64)])
    for name, values in raw.point_data.items():
        if name.startswith("face:"):
            content.node_sets[name.removeprefix("face:")] = np.flatnonzero(values)
        else:
            content.node_fields[name] = np.asarray(values, dtype=np.float64)
    for name, by_type in raw.cell_data_dict.items():
        on_quads, on_hexahedra = by_type.get("quad"), by_type.get("hexahedron")
        kind, _, own = name.partition(":")
        kinds = TAGS.get(name) or ((kind,) if kind in ("face", "region") else ())
        own = "" if name in TAGS else own
        if "face" in kinds:
            for face, numbers in _sets(on_quads, own).items():
                content.faces[face] = content.cells["quad"][numbers]
        if "region" in kinds:
            content.regions |= _sets(on_hexahedra, own)
        if not kinds and name != "gmsh:geometrical" and on_hexahedra is not None:
            content.element_fields[name] = np.asarray(on_hexahedra, dtype=np.float64)
    return content


def write(path: Path, mesh: Mesh) -> None:
    """Hexahedra, quads, and what belongs to them; XDMF holds its numbers as text, in one file."""
    meshio = _meshio(path)
    quads = np.concatenate([np.zeros((0, 4), dtype=np.int64), *mesh.faces.values()])
    _, first = np.unique(np.sort(quads, axis=1), axis=0, return_index=True)
    quads = quads[np.sort(first)]  # each once, also if it is in several faces
    cells = [("hexahedron", mesh.cells)] + ([("quad", quads)] if len(quads) else [])
    number = {tuple(sorted(q)): k for k, q in enumerate(quads.tolist())}
    on_cells: dict[str, list[NDArray[Any]]] = {}
    points = {name: v for name, v in mesh.fields.items() if nodal(mesh, name)}
    for name, values in mesh.fields.items():
        if not nodal(mesh, name):
            on_cells[name] = [values, np.full((len(quads), *values.shape[1:]), np.nan)]
    for name, elements in mesh.regions.items():
        on_cells[f"region:{name}"] = [_mask(len(mesh.cells), elements), _mask(len(quads), [])]
    for name, own in mesh.faces.items():
        numbers = [number[tuple(sorted(q))] for q in own.tolist()]
        on_cells[f"face:{name}"] = [_mask(len(mesh.cells), []), _mask(len(quads), numbers)]
    data = {name: blocks[: len(cells)] for name, blocks in on_cells.items()}
    options = {"data_format": "XML"} if path.suffix == ".xdmf" else {}
    meshio.write(path, meshio.Mesh(mesh.points, cells, points, data), file_format=path.suffix[1:], **options)


def _meshio(path: Path) -> ModuleType:
    try:
        import meshio

        if path.suffix == ".xdmf":
            import_module("h5py")  # meshio reads and writes no XDMF without it
    except ModuleNotFoundError as error:
        raise checks.missing(error, f"{path.suffix} files need", "'jaxmyo[mesh]'") from error
    return meshio


def _mask(n: int, numbers: Any) -> NDArray[np.int32]:
    mask = np.zeros(n, dtype=np.int32)
    mask[np.asarray(numbers, dtype=np.int64)] = 1
    return mask


def _sets(values: NDArray[Any] | None, name: str) -> dict[str, NDArray[np.int64]]:
    """The cells whose value is not 0, under the name; or under their value, if no name is given."""
    if values is None or values.ndim != 1:
        return {}
    values = values.astype(np.int64)
    sets = {name: values != 0} if name else {str(k): values == k for k in np.unique(values) if k}
    return {s: np.flatnonzero(mask) for s, mask in sets.items() if mask.any()}
