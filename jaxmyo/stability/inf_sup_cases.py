"""Where the inf-sup constant is measured: cubes, slabs and sectors of a tube, with p and q on patches of all kinds.

Its continuous counterpart explains what comes out. A multiplier that varies like exp(i k·X) feels displacements by

    p: (k1, k2, k3)/|k|,    q: (−½ (π−2) a/D k1, k2, 0)/|k|

along the fibres, across them, and normal to both. Of p that has the length one in every direction, and the constant
falls only because Q1 displacements cannot follow a p of each element: one p per block of 2×2×2 elements is enough. Of q
it vanishes with k along the normal, and p and q are felt alike with k along the fibres, or across them. The constant of
(p, q) in L² is zero in the body itself, so that no patch that shrinks with the elements can keep it. It stays where the
patches of q keep their size while the mesh is refined: one q for the body, for the wall of a tube, or for an eighth.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from jaxmyo.conditions import Symmetry
from jaxmyo.constants import TABLE1
from jaxmyo.energies import lin_yin
from jaxmyo.mesh import Mesh, box
from jaxmyo.patches import blocks, columns
from jaxmyo.scene import Scene
from jaxmyo.scenes import tube_sector
from jaxmyo.stability.inf_sup import InfSup, Patches

#: The a/D of the linearised weave.
A_OVER_D = 0.2


class Row(NamedTuple):
    """One constant: of a body on a mesh of n elements along its edge, with p and q on patches of a kind."""

    body: str
    n: int
    p: str
    q: str
    beta: float
    zero: int
    multipliers: int


def each(mesh: Mesh) -> Patches:
    """One per element."""
    return np.arange(len(mesh.cells))


def eighths(mesh: Mesh) -> Patches:
    """Two patches along each axis, however many elements."""
    assert mesh.grid is not None
    return blocks(mesh, tuple(max(n // 2, 1) for n in mesh.grid))  # type: ignore[arg-type]


def whole(mesh: Mesh) -> Patches:
    """One for the body."""
    return np.zeros(len(mesh.cells), dtype=np.int64)


#: Kinds of patches; those of q in the last rows keep their size, or grow with the mesh along one axis.
KINDS: dict[str, Callable[[Mesh], Patches]] = {
    "element": each,
    "2×2×2 block": blocks,
    "eighth": eighths,
    "body": whole,
    "column along x": lambda mesh: columns(mesh, mesh.coordinates.axes[0]),
    "column along z": lambda mesh: columns(mesh, mesh.coordinates.axes[2]),
}
NONE = "–"
#: (p, q) of the rows; the cure is the pairs of `CURES`.
PAIRS = [
    ("element", NONE),
    (NONE, "element"),
    ("element", "element"),
    ("2×2×2 block", NONE),
    (NONE, "2×2×2 block"),
    ("2×2×2 block", "2×2×2 block"),
    ("2×2×2 block", "column along x"),
    ("2×2×2 block", "column along z"),
    ("element", "body"),
    ("2×2×2 block", "eighth"),
    ("2×2×2 block", "body"),
]
CURES = [("2×2×2 block", "eighth"), ("2×2×2 block", "body")]


def bodies(quick: bool) -> Iterator[tuple[str, int, Scene]]:
    """The bodies and their meshes."""
    held = tuple(Symmetry(axis) for axis in "xyz")
    for n in (2, 4, 6) if quick else (2, 4, 6, 8, 10, 12):
        yield "cube 1×1×1", n, Scene(box((1.0, 1.0, 1.0), (n, n, n)), lin_yin, TABLE1, supports=held)
    for n in (4, 8) if quick else (4, 8, 16):
        yield "slab 1×1×0.1", n, Scene(box((1.0, 1.0, 0.1), (n, n, 1)), lin_yin, TABLE1, supports=held)
    for n in (2, 4) if quick else (2, 4, 6, 8):
        yield "sector of a tube, cylindrical", n, tube_sector((n, n, n), height=4.0)
    for n in (2, 4) if quick else (2, 4, 6, 8):
        yield "sector of a tube, Cartesian", n, tube_sector((n, n, n), height=4.0, cartesian=True)


def measure(quick: bool, done: Callable[[str], None]) -> list[Row]:
    """All rows; done: is told each mesh."""
    rows = []
    for body, n, scene in bodies(quick):
        test = InfSup.of(scene, A_OVER_D)
        for p, q in PAIRS:
            where = [None if kind == NONE else KINDS[kind](scene.mesh) for kind in (p, q)]
            rows.append(Row(body, n, p, q, *test.constant(*where)))
        done(f"inf-sup constants, {body}, n = {n}")
    return rows
