"""The sparsity pattern of a large body, found once, and where the entries of each element stand in it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

BLOCK = 64  # elements whose terms are computed together, and added together

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Rows and columns of the upper triangle of an element's matrix (24, 24), rows first.
UPPER = np.triu_indices(24)
_I, _J = UPPER


@dataclass(frozen=True)
class Pattern:
    """The upper triangle, in CSR, of the displacements that share an element (or a patch), and where entries stand.

    positions: (n_blocks, 300, BLOCK) of the upper triangles of the elements' matrices, nnz for entries of prescribed
    displacements and of no element; twice: flat positions there of pairs of nodal displacements that are one unknown;
    keys: (nnz,) row · n_u + column.
    """

    n_u: int
    indptr: Ints
    indices: NDArray[np.int32]
    keys: Ints
    positions: NDArray[np.int32]
    twice: Ints

    @property
    def nnz(self) -> int:
        """Number of entries."""
        return len(self.keys)

    @property
    def diagonal(self) -> Ints:
        """Positions of the diagonal."""
        return self.indptr[:-1]

    def matrix(self, data: NDArray[Any]) -> sp.csr_matrix:
        """The upper triangle with these entries."""
        return sp.csr_matrix((data, self.indices, self.indptr), shape=(self.n_u, self.n_u))

    def product(self, data: NDArray[Any]) -> Callable[[NDArray[Any]], NDArray[Any]]:
        """The product of the symmetric matrix with these entries and vectors (n_u,)."""
        upper, diagonal = self.matrix(data), data[self.diagonal]
        lower = upper.T
        return lambda u: upper @ u + lower @ u - diagonal * u

    def full(self, data: Floats) -> sp.csr_matrix:
        """Both triangles."""
        upper = self.matrix(data)
        return (upper + sp.triu(upper, 1).T).tocsr()

    def find(self, rows: NDArray[Any], columns: NDArray[Any]) -> Ints:
        """Positions of entries of the upper triangle."""
        return np.searchsorted(self.keys, rows.astype(np.int64) * self.n_u + columns)

    def add_upper(self, data: Floats, blocks: slice, K: Floats) -> None:
        """Add the upper triangles (n_blocks, 300, BLOCK) of the matrices of some blocks to the data (nnz + 1,)."""
        if len(self.twice):
            size = K[0].size
            first, last = np.searchsorted(self.twice, [size * blocks.start, size * blocks.stop])
            K = K.copy()
            K.reshape(-1)[self.twice[first:last] - size * blocks.start] *= 2.0
        np.add.at(data, self.positions[blocks].reshape(-1), K.reshape(-1))


def in_blocks(x: NDArray[Any], n_blocks: int, fill: Any = None) -> NDArray[Any]:
    """Values (n, ...) of the elements in blocks, (n_blocks, ..., BLOCK).

    Blocks are filled up with that value, or with repetitions of the last element.
    """
    missing = n_blocks * BLOCK - len(x)
    rest = np.repeat(x[-1:], missing, axis=0) if fill is None else np.full((missing, *x.shape[1:]), fill, x.dtype)
    blocks = np.concatenate([x, rest]).reshape(n_blocks, BLOCK, *x.shape[1:])
    return np.ascontiguousarray(np.moveaxis(blocks, 1, -1))


def same_components() -> tuple[Ints, Ints, Ints, Ints]:
    """Where an upper triangle (300,) couples one component i at two nodes a and b: positions, i, a and b."""
    upper = np.flatnonzero(_I % 3 == _J % 3)
    return upper, _I[upper] % 3, _I[upper] // 3, _J[upper] // 3


#: Where the diagonal stands in the upper triangle (300,).
DIAGONAL = np.flatnonzero(_I == _J)


def distinct(keys: Ints) -> tuple[Ints, NDArray[np.int32]]:
    """The distinct keys (n,), sorted, and which of them each is, as of `np.unique`.

    Keys of a mesh are mostly in order as they come: the stable sort, which merges ordered runs, is ten times as fast.
    """
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    first = np.concatenate([[True], ordered[1:] != ordered[:-1]])
    which = np.empty(len(keys), dtype=np.int32)
    which[order] = np.cumsum(first, dtype=np.int32) - 1
    return ordered[first], which


def pattern(
    cells: Ints, tie_index: Ints, tie_scale: Floats, n_u: int, patches: list[sp.csr_matrix], n_blocks: int
) -> Pattern:
    """The pattern of a body; patches: incidence (n_patches, n_u) of patches of several elements, which couple too."""
    # Pairs of nodes first: there are far fewer of them than pairs of displacements.
    a, b = np.triu_indices(8)
    low, high = np.minimum(cells[:, a], cells[:, b]), np.maximum(cells[:, a], cells[:, b])
    n_nodes = len(tie_index) // 3
    pairs, pair_of = distinct((low * n_nodes + high).reshape(-1))
    first, second = np.divmod(pairs, n_nodes)
    rows = np.broadcast_to((3 * first)[:, None, None] + np.arange(3)[:, None], (len(pairs), 3, 3)).reshape(-1)
    columns = np.broadcast_to((3 * second)[:, None, None] + np.arange(3), (len(pairs), 3, 3)).reshape(-1)
    moves = (tie_scale[rows] != 0.0) & (tie_scale[columns] != 0.0)
    i, j = tie_index[rows], tie_index[columns]
    keys = np.where(moves, np.minimum(i, j) * n_u + np.maximum(i, j), n_u * n_u)
    further = [sp.triu(p.T @ p).tocoo() for p in patches]
    every = np.concatenate([keys, *(f.row.astype(np.int64) * n_u + f.col for f in further)])
    found, at = distinct(every)
    if len(found) and found[-1] == n_u * n_u:
        found = found[:-1]
    at = at[: len(keys)]
    # Position of the pair of displacements (node a, component i; node b, component j) of each element, by the place of
    # the pair of nodes and of the pair of components in it, which is transposed where the second node comes first.
    number = np.zeros((8, 8), dtype=np.int64)
    number[a, b] = number[b, a] = np.arange(len(a))
    number = number[_I // 3, _J // 3]
    within = np.stack([3 * (_I % 3) + _J % 3, 3 * (_J % 3) + _I % 3]).astype(np.int32)
    at = np.append(at, np.full(9, len(found), dtype=np.int32))  # the pair of nodes of no element
    pair = in_blocks((9 * pair_of).reshape(len(cells), -1), n_blocks, len(keys))
    swapped = in_blocks(cells[:, a] > cells[:, b], n_blocks, False)
    positions = np.empty((n_blocks, len(_I), BLOCK), dtype=np.int32)
    for k in range(n_blocks):
        where = pair[k][number] + np.where(swapped[k][number], within[1][:, None], within[0][:, None])
        np.take(at, where, out=positions[k])
    twice = np.zeros(0, dtype=np.int64)
    if np.count_nonzero(tie_scale) > n_u:  # some unknowns move several nodal displacements
        same = tie_index[3 * cells[:, _I // 3] + _I % 3] == tie_index[3 * cells[:, _J // 3] + _J % 3]
        same = in_blocks(same & (_I != _J), n_blocks, False)
        twice = np.flatnonzero((same & (positions < len(found))).reshape(-1))
    indptr = np.searchsorted(found, np.arange(n_u + 1) * n_u)
    return Pattern(n_u, indptr, (found % max(n_u, 1)).astype(np.int32), found, positions, twice)
