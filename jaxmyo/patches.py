"""Where the multipliers live: numbers of the patches of elements that share one p, or one q.

One multiplier per element is the Q1–Q0 standard. One per patch has fewer conditions to meet: where one per element
over-determines the body (the weave of a tube with planar ends), or leaves oscillations that do not converge.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmyo import checks
from jaxmyo.mesh import Mesh


def columns(mesh: Mesh, axis: str) -> NDArray[np.int64]:
    """One patch per column of elements along an axis, e.g. "r" through the wall of a tube; the mesh is structured."""
    number = np.arange(len(mesh.cells)).reshape(_grid(mesh))
    across = np.take(number, [0], axis=mesh.axis(axis))
    return _renumbered(np.broadcast_to(across, number.shape).reshape(-1))


def blocks(mesh: Mesh, size: int | tuple[int, int, int] = 2) -> NDArray[np.int64]:
    """One patch per block of size³ elements, or of (n1, n2, n3) (smaller at an end); the mesh is structured."""
    grid = _grid(mesh)
    n1, n2, n3 = checks.counts("size", (size,) * 3 if isinstance(size, int) else size, 3)
    place = np.stack(np.meshgrid(*[np.arange(n) // m for n, m in zip(grid, (n1, n2, n3), strict=True)], indexing="ij"))
    return _renumbered(np.tensordot(np.array([grid[1] * grid[2], grid[2], 1]), place, axes=1).reshape(-1))


def checked(name: str, patches: Any, mesh: Mesh) -> NDArray[np.int64]:
    """The patch of each element (n_elements,), numbered from 0; None: one per element. Errors say what is wrong."""
    n_e = len(mesh.cells)
    if patches is None:
        return np.arange(n_e)
    numbers = np.asarray(patches)
    if numbers.dtype.kind not in "iu":
        raise TypeError(f"{name} must be integers (n_elements,), the patch of each element; got {numbers.dtype}")
    if numbers.shape != (n_e,):
        raise ValueError(
            f"{name} does not cover the elements: shape {numbers.shape}, but the mesh has {n_e} element(s)"
        )
    if (numbers < 0).any():
        e = int(np.argmax(numbers < 0))
        raise ValueError(f"{name} does not cover the elements: element {e} has patch {numbers[e]} (must be ≥ 0)")
    if missing := sorted(set(range(int(numbers.max()) + 1)) - set(numbers.tolist())):
        raise ValueError(f"{name}: patch {missing[0]} has no element; patches are numbered from 0 without gaps")
    return numbers.astype(np.int64)


def _grid(mesh: Mesh) -> tuple[int, int, int]:
    if mesh.grid is None:
        raise ValueError("the mesh is not structured (mesh.grid is None): give the patch of each element as an array")
    return mesh.grid


def _renumbered(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.asarray(np.unique(numbers, return_inverse=True)[1].reshape(-1), dtype=np.int64)
