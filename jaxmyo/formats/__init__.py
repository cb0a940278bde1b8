"""File formats of meshes. Each module reads a file as it is into a `Content`; `jaxmyo.mesh_io` makes a mesh of it."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from jaxmyo.mesh import Mesh


@dataclass
class Content:
    """What a file holds; node and element numbers from 0, in the order of the file.

    cells: type → (n, nodes of one cell), under the names of meshio ("hexahedron", "quad", "tetra", ...); faces: name →
    quads (n, 4), oriented as in the file; regions: name → numbers of hexahedra; node_sets: name → numbers of nodes;
    node_fields (n_nodes, ...), element_fields (n_hexahedra, ...): name → data, NaN where the file has none.
    """

    points: NDArray[np.float64]
    cells: dict[str, NDArray[np.int64]]
    faces: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    regions: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    node_sets: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    node_fields: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    element_fields: dict[str, NDArray[np.float64]] = field(default_factory=dict)


def nodal(mesh: Mesh, name: str) -> bool:
    """Whether a field of the mesh is one per node (also if there are as many nodes as elements)."""
    return len(mesh.fields[name]) == len(mesh.points)
