"""Hexahedral meshes with named faces, regions and fields."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import jax
import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxmyo import checks
from jaxmyo.coordinates import CARTESIAN, Coordinates, evaluate
from jaxmyo.hexahedron import NODES, QUADS, gauss, shape, shape_gradient


@dataclass(frozen=True)
class Mesh:
    """Nodes, hexahedra, the named faces on which supports and loads act, named regions and fields.

    points: (n_nodes, 3) reference coordinates Θ [the units of `coordinates`: mm, rad]; cells: (n_elements, 8) node
    numbers in VTK order; faces: name → (n_quads, 4) node numbers, counter-clockwise seen from outside;
    coordinates: the system that the points are in; grid: elements along each axis, if the mesh is structured (the last
    axis runs fastest); regions: name → numbers of its elements, none or a partition of the elements; fields: name →
    data per node (n_nodes, ...) or per element (n_elements, ...), vectors along the local unit vectors.

    Errors: a ValueError for wrong shapes, non-finite coordinates, node numbers out of range, nodes that no element
    uses, regions that overlap or miss elements, and an element that is inverted or has no volume (det J ≤ 0 at a Gauss
    point or at a corner, a scale factor ≤ 0 at a Gauss point, such as a negative radius).
    """

    points: NDArray[np.float64]
    cells: NDArray[np.int64]
    faces: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    coordinates: Coordinates = CARTESIAN
    grid: tuple[int, int, int] | None = None
    regions: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    fields: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        points = checks.concrete("points", self.points, (None, 3))
        cells = np.asarray(self.cells)
        if cells.ndim != 2 or cells.shape[1] != 8 or cells.dtype.kind not in "iu":
            raise ValueError(
                f"cells must be integers of shape (n, 8), hexahedra in VTK order; got {cells.dtype} of {cells.shape}"
            )
        if not len(cells):
            raise ValueError("cells is empty: a mesh needs at least one hexahedron")
        for name, quads in self.faces.items():
            if np.ndim(quads) != 2 or np.shape(quads)[1] != 4:
                raise ValueError(f"faces[{name!r}] must have shape (n, 4), quads; got {np.shape(quads)}")
        for name, nodes in {"cells": cells, **{f"faces[{k!r}]": np.asarray(v) for k, v in self.faces.items()}}.items():
            if nodes.size and (nodes.min() < 0 or nodes.max() >= len(points)):
                raise ValueError(f"{name} has node numbers {nodes.min()}..{nodes.max()} outside 0..{len(points) - 1}")
        unused = np.setdiff1d(np.arange(len(points)), cells)
        if unused.size:
            raise ValueError(f"{unused.size} node(s) belong to no element, the first is node {unused[0]}; remove them")
        where = np.concatenate([gauss(2, 2, 2)[0], NODES])
        det = np.linalg.det(np.einsum("eai,gaj->egij", points[cells], shape_gradient(where)))
        if (bad := det.min(axis=1) <= 1e-12 * np.abs(det).max(axis=1)).any():
            e = int(np.argmax(bad))
            k = int(np.argmin(det[e]))
            place = f"Gauss point {k}" if k < 8 else f"corner {k - 8} (node {cells[e, k - 8]})"
            raise ValueError(
                f"element {e} is inverted or has no volume: det J = {det[e, k]:.3g} at {place} (must be > 0; "
                f"{int(bad.sum())} such element(s) of {len(cells)}). Check the node order (VTK: lower face "
                "counter-clockwise, then the upper face)."
            )
        if self.coordinates.curved:
            at = np.einsum("ga,eai->egi", shape(gauss(2, 2, 2)[0]), points[cells])
            self._check_coordinates(at)
        if self.grid is not None and int(np.prod(self.grid)) != len(cells):
            raise ValueError(f"grid = {self.grid} does not have {len(cells)} elements")
        fields = {}
        for name, values in self.fields.items():
            fields[name] = np.asarray(values, dtype=np.float64)
            if not fields[name].ndim or len(fields[name]) not in (len(points), len(cells)):
                raise ValueError(
                    f"fields[{name!r}] must have one row per node ({len(points)}) or per element ({len(cells)}); "
                    f"got shape {fields[name].shape}"
                )
        object.__setattr__(self, "regions", _partition(self.regions, len(cells)))
        object.__setattr__(self, "fields", fields)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "cells", cells.astype(np.int64))
        object.__setattr__(self, "faces", {k: np.asarray(v, dtype=np.int64) for k, v in self.faces.items()})

    def _check_coordinates(self, at: NDArray[np.float64]) -> None:
        """Errors for points (n_elements, n_points, 3) where the coordinates are not what they must be."""
        name, axes = self.coordinates.name, self.coordinates.axes
        flat = at.reshape(-1, 3)
        g = evaluate(self.coordinates.g, flat).reshape(at.shape)
        if not (g > 0.0).all():  # also catches NaN
            e, k, i = (int(n) for n in np.argwhere(~(g > 0.0))[0])
            raise ValueError(
                f"element {e} leaves the {name} coordinates: the scale factor of {axes[i]!r} is {g[e, k, i]:.3g} "
                f"(must be > 0) at {at[e, k]}"
            )
        basis = evaluate(self.coordinates.basis, flat).reshape(*at.shape, 3)
        gram = np.abs(basis @ basis.swapaxes(-1, -2) - np.eye(3)).max(axis=(-1, -2))
        right_handed = np.linalg.det(basis) > 0.0
        if (gram > 1e-9).any() or not right_handed.all():
            e, k = (int(n) for n in np.argwhere((gram > 1e-9) | ~right_handed)[0])
            raise ValueError(
                f"the {name} coordinates must be orthogonal and right-handed, e_1 × e_2 = e_3, without negative radii; "
                f"at {at[e, k]} the local unit vectors are {basis[e, k].tolist()}"
            )

    @property
    def extent(self) -> NDArray[np.float64]:
        """Edge lengths (3,) of the bounding box in the world coordinates [mm, rad]."""
        return np.ptp(self.points, axis=0)

    def face(self, name: str) -> NDArray[np.int64]:
        """The quads (n, 4) of a named face."""
        return self.faces[checks.choice("face", name, sorted(self.faces))]

    def region(self, name: str) -> NDArray[np.int64]:
        """The numbers (n,) of the elements of a named region."""
        return self.regions[checks.choice("region", name, sorted(self.regions))]

    def axis(self, name: str) -> int:
        """The number of a coordinate by its name, e.g. 0 for "x" or "r"."""
        return self.coordinates.axes.index(checks.choice("axis", name, list(self.coordinates.axes)))

    def mapped(self, position: Callable[[jax.Array], jax.Array]) -> "Mesh":
        """The same body in Cartesian hexahedra: nodes at position(Θ) [mm], straight edges between them.

        Faces, regions and fields stay as they are; the components of vector fields are not turned.
        """
        return replace(self, points=evaluate(position, self.points), coordinates=CARTESIAN)


def boundary(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """The quads (n, 4) that belong to one hexahedron only, counter-clockwise seen from outside."""
    quads = cells[:, QUADS].reshape(-1, 4)
    _, first, count = np.unique(np.sort(quads, axis=1), axis=0, return_index=True, return_counts=True)
    return np.asarray(quads[np.sort(first[count == 1])])


def _partition(regions: Mapping[str, ArrayLike], n_elements: int) -> dict[str, NDArray[np.int64]]:
    """The regions as sorted numbers; an error if they overlap, miss elements, or name some that are not there."""
    found: dict[str, NDArray[np.int64]] = {}
    owner = np.full(n_elements, -1)
    for i, (name, value) in enumerate(regions.items()):
        numbers = np.asarray(value)
        if numbers.ndim != 1 or (numbers.size and numbers.dtype.kind not in "iu"):
            raise ValueError(f"regions[{name!r}] must be integers (n,); got {numbers.dtype} of {numbers.shape}")
        if numbers.size and (numbers.min() < 0 or numbers.max() >= n_elements):
            raise ValueError(
                f"regions[{name!r}] has element numbers {numbers.min()}..{numbers.max()} outside 0..{n_elements - 1}"
            )
        found[name] = np.unique(numbers.astype(np.int64))
        if (taken := owner[found[name]] >= 0).any():
            e = found[name][np.argmax(taken)]
            raise ValueError(
                f"regions overlap: {int(taken.sum())} element(s) are in {list(found)[owner[e]]!r} and in {name!r}, "
                f"the first is element {e}; an element belongs to one region"
            )
        owner[found[name]] = i
    if found and (missing := owner < 0).any():
        raise ValueError(
            f"regions miss {int(missing.sum())} of {n_elements} element(s), the first is element "
            f"{int(np.argmax(missing))}; regions must cover the mesh: {', '.join(map(repr, found))}"
        )
    return found


def structured(nodes: Sequence[ArrayLike], coordinates: Coordinates = CARTESIAN) -> Mesh:
    """A grid of hexahedra with nodes at the given coordinates along each axis, three increasing lists [mm, rad].

    The faces are named by the axes: x0 (lower end), x1, y0, y1, z0, z1; r0, r1, ... in cylindrical coordinates.
    """
    axes = [checks.concrete(f"nodes[{k}]", n, (None,)) for k, n in enumerate(nodes)]
    for name, along in zip(coordinates.axes, axes, strict=True):
        if len(along) < 2 or (np.diff(along) <= 0.0).any():
            raise ValueError(f"nodes along {name!r} must increase, from at least two; got {along}")
    elements = (len(axes[0]) - 1, len(axes[1]) - 1, len(axes[2]) - 1)
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape([n + 1 for n in elements])
    corner = [
        number[tuple(slice(int(c > 0), n + int(c > 0)) for c, n in zip(node, elements, strict=True))] for node in NODES
    ]
    faces = {}
    for axis, name in enumerate(coordinates.axes):
        for end in (0, 1):
            layer = np.take(number, -end, axis=axis)
            if axis == 1:  # keep (first, second, axis) right-handed
                layer = layer.T
            quads = np.stack([layer[:-1, :-1], layer[1:, :-1], layer[1:, 1:], layer[:-1, 1:]], axis=-1).reshape(-1, 4)
            faces[f"{name}{end}"] = quads if end else quads[:, ::-1]
    return Mesh(points, np.stack(corner, axis=-1).reshape(-1, 8), faces, coordinates, elements)


def box(lengths: tuple[float, float, float], elements: tuple[int, int, int]) -> Mesh:
    """A box [0, Lx] × [0, Ly] × [0, Lz] mm of nx × ny × nz hexahedra; faces x0, x1, y0, y1, z0, z1."""
    lengths_ = checks.concrete("lengths", lengths, (3,))
    if (lengths_ <= 0).any():
        raise ValueError(f"lengths = {lengths} must be positive (mm)")
    checks.counts("elements", elements, 3)
    return structured([np.linspace(0.0, length, n + 1) for length, n in zip(lengths_, elements, strict=True)])


def jitter(mesh: Mesh, amplitude: float, seed: int) -> Mesh:
    """The mesh with its inner nodes displaced at random, by at most `amplitude` of the local element size.

    Nodes on named faces stay. For patch tests: a result that depends on it depends on the mesh.
    """
    rng = np.random.default_rng(seed)
    outer = np.unique(np.concatenate([q.ravel() for q in mesh.faces.values()]))
    size = np.full_like(mesh.points, np.inf)
    for corners in mesh.cells:
        np.minimum.at(size, corners, np.broadcast_to(np.ptp(mesh.points[corners], axis=0), (8, 3)))
    shift = amplitude * size * rng.uniform(-1.0, 1.0, mesh.points.shape)
    shift[outer] = 0.0
    return replace(mesh, points=mesh.points + shift)
