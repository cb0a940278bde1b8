"""Meshes from files and into files: VTU, XDMF, gmsh's MSH, and Abaqus input files."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmyo import checks
from jaxmyo.formats import Content, abaqus, gmsh, vtk
from jaxmyo.hexahedron import QUADS
from jaxmyo.mesh import Mesh, boundary

#: Suffix → module that reads and writes it.
FORMATS = {".vtu": vtk, ".xdmf": vtk, ".msh": gmsh, ".inp": abaqus}
#: The largest extent of a body is between these [mm], or there is a warning.
EXTENT = (0.5, 1000.0)
#: Cells that a file may have.
_CELLS = ("hexahedron", "quad", "line", "vertex")


def read_mesh(path: str | Path, scale: float = 1.0) -> Mesh:
    """A mesh of hexahedra in Cartesian coordinates from a file, .vtu, .xdmf, .msh (4.1, 2.2) or .inp.

    scale: what a length in the file is in mm, e.g. 1000 for a file in metres.

    Points and elements keep the order of the file. Vertices and lines are ignored, and points that belong to no
    hexahedron and no quad, such as the centres of arcs, are dropped; one of a quad only is an error. Fields on nodes
    and hexahedra are read, NaN where a file has no value; vectors are not scaled.
    Where the names of faces and regions come from, by format:

    .msh: physical surfaces and physical volumes (their number, if they have no name).
    .inp: faces from *SURFACE and from sets of quads; without quads also every *NSET, the boundary quads all of whose
    nodes are in it; regions from sets of hexahedra, those of *SOLID SECTION, else of *ELSET, else of *ELEMENT.
    .vtu, .xdmf: integer data of the cells, quads beside the hexahedra, or data of the nodes, see `jaxmyo.formats.vtk`.

    Quads are turned to be counter-clockwise seen from outside. Regions must be a partition of the elements, or none.

    A UserWarning hints at units if the body is smaller than 0.5 mm or larger than 1 m. Errors: FileNotFoundError;
    ValueError that names the file, for an unknown suffix, cells other than hexahedra (and quads), none of them or some
    twice, coordinates that are not finite, nodes of no hexahedron, faces that are not on the boundary, and whatever
    `Mesh` refuses (elements that are inverted, regions that overlap); ModuleNotFoundError without meshio.
    """
    factor = float(checks.concrete("scale", scale, ()))
    if factor <= 0.0:
        raise ValueError(f"scale = {scale} must be > 0 (mm per length in the file)")
    path, module = _format(path)
    if not path.exists():
        raise FileNotFoundError(f"no file {path}")
    try:
        mesh = _mesh(module.read(path), factor)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    except KeyError as error:
        raise ValueError(f"{path}: refers to {error}, which the file does not define") from error
    largest = float(mesh.extent.max())
    if not EXTENT[0] <= largest <= EXTENT[1]:
        unit, to_mm = ("metres", 1000) if largest < EXTENT[0] else ("micrometres", 0.001)
        warnings.warn(
            f"{path}: the largest extent is {largest:.3g} mm: is it in {unit}? Then read_mesh(path, scale={to_mm})",
            UserWarning,
            stacklevel=2,
        )
    return mesh


def write_mesh(path: str | Path, mesh: Mesh) -> Path:
    """Write a Cartesian mesh with its faces, regions and fields; `read_mesh` gives the same back, but for `grid`.

    The suffix chooses the format: .vtu, .xdmf, .msh (4.1, text), or .inp, which holds no fields.
    Errors: a ValueError for an unknown suffix, other coordinates (write `mesh.mapped(mesh.coordinates.position)`),
    faces that are not on the boundary, names that files do not take, and fields that are no scalars, vectors of three
    or tensors of nine numbers; ModuleNotFoundError without meshio.
    """
    path, module = _format(path)
    if mesh.coordinates.curved:
        raise ValueError(
            f"the mesh is in {mesh.coordinates.name} coordinates, files are in Cartesian ones: write "
            "mesh.mapped(mesh.coordinates.position)"
        )
    for name in (*mesh.faces, *mesh.regions, *mesh.fields):
        if not name or name != name.strip() or set(name) & set('",\n='):
            raise ValueError(f"the name {name!r} cannot be written: no quotes, commas, = or spaces at its ends")
    for name, values in mesh.fields.items():
        if name.partition(":")[0] in ("face", "region", "gmsh"):
            raise ValueError(f"the field {name!r} cannot be written: face, region and gmsh mark what is no field")
        if values.shape[1:] not in ((), (3,), (9,)):
            raise ValueError(f"fields[{name!r}] must have shape (n,), (n, 3) or (n, 9) in a file; got {values.shape}")
    _outward(mesh.cells, mesh.faces)
    if module is abaqus:
        abaqus.write(path, mesh, _sides(mesh))
    else:
        module.write(path, mesh)
    return path


def _format(path: str | Path) -> tuple[Path, Any]:
    path = Path(path)
    if path.suffix not in FORMATS:
        raise ValueError(f"{path}: the suffix {path.suffix!r} is unknown; valid: {', '.join(FORMATS)}")
    return path, FORMATS[path.suffix]


def _mesh(content: Content, scale: float) -> Mesh:
    cells = {kind: nodes for kind, nodes in content.cells.items() if len(nodes)}
    there = ", ".join(f"{len(nodes)} {kind}" for kind, nodes in cells.items()) or "no cells"
    if others := [f"{len(nodes)} {kind}" for kind, nodes in cells.items() if kind not in _CELLS]:
        raise ValueError(f"{', '.join(others)} not supported: only hexahedra of 8 nodes, and quads of 4 as faces")
    if "hexahedron" not in cells:
        raise ValueError(f"there are no hexahedra: {there}")
    hexahedra = cells["hexahedron"]
    own = np.unique(hexahedra)
    if (twice := len(hexahedra) - len(np.unique(np.sort(hexahedra, axis=1), axis=0))) > 0:
        raise ValueError(f"{twice} hexahedra occur twice, perhaps once for each of several groups that overlap")
    if (stray := np.setdiff1d(cells.get("quad", []), own)).size:
        raise ValueError(
            f"{stray.size} node(s) belong to a quad but to no hexahedron, the first is node {stray[0]} (from 0) at "
            f"{content.points[stray[0]]}; remove these quads"
        )
    points = content.points[own]
    if not (finite := np.isfinite(points).all(axis=1)).all():
        k = own[np.argmin(finite)]
        raise ValueError(f"coordinates must be finite; node {k} (from 0) is at {content.points[k]}")
    number = np.full(len(content.points), -1)
    number[own] = np.arange(len(own))
    hexahedra = number[hexahedra]
    faces = _outward(hexahedra, {name: number[quads] for name, quads in content.faces.items()})
    if "quad" not in cells and content.node_sets:
        quads = boundary(hexahedra)
        for name, nodes in content.node_sets.items():
            inside = np.isin(quads, number[nodes]).all(axis=1)
            if name not in faces and inside.any():
                faces[name] = quads[inside]
    fields = {name: values[own] for name, values in content.node_fields.items()} | content.element_fields
    return Mesh(scale * points, hexahedra, faces, regions=content.regions, fields=fields)


def _outward(cells: NDArray[np.int64], faces: Mapping[str, NDArray[np.int64]]) -> dict[str, NDArray[np.int64]]:
    """The faces with their quads counter-clockwise seen from outside; an error if one is not on the boundary."""
    outside = {tuple(sorted(quad)): quad for quad in boundary(cells).tolist()} if faces else {}
    turned = {}
    for name, quads in faces.items():
        own = {tuple(sorted(quad)): quad for quad in quads.tolist()}  # each once
        if missing := [quad for key, quad in own.items() if key not in outside]:
            raise ValueError(
                f"face {name!r}: {len(missing)} of {len(own)} quads are not on the boundary of the hexahedra, the "
                f"first has the nodes {missing[0]} (from 0)"
            )
        right = [quad if quad in _turns(outside[key]) else outside[key] for key, quad in own.items()]
        turned[name] = np.array(right, dtype=np.int64).reshape(-1, 4)
    return turned


def _turns(quad: list[int]) -> list[list[int]]:
    """The quad with each of its nodes as the first."""
    return [quad[k:] + quad[:k] for k in range(4)]


def _sides(mesh: Mesh) -> dict[str, NDArray[np.int64]]:
    """Face → element and row of `QUADS` (n, 2) of each quad."""
    place = {
        tuple(sorted(quad)): (e, k) for e, own in enumerate(mesh.cells[:, QUADS].tolist()) for k, quad in enumerate(own)
    }
    return {name: np.array([place[tuple(sorted(q))] for q in quads.tolist()]) for name, quads in mesh.faces.items()}
