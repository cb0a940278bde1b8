"""The trilinear hexahedron (Q1): shape functions on the reference cube [−1, 1]³, Gauss quadrature, the faces.

Nodes are in VTK order: the lower face (ζ = −1) counter-clockwise, then the upper face.
"""

import numpy as np
from numpy.typing import NDArray

#: Reference coordinates of the eight nodes (8, 3).
NODES = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], dtype=float
)

#: Nodes of the six faces (6, 4), counter-clockwise seen from outside: ζ = −1, ζ = 1, η = −1, ξ = 1, η = 1, ξ = −1
#: (S1 to S6 of Abaqus).
QUADS = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])


def gauss(*orders: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gauss–Legendre points (n, d) and weights (n,) on [−1, 1]^d, with so many points in each of the d directions."""
    rules = [np.polynomial.legendre.leggauss(order) for order in orders]
    points = np.stack(np.meshgrid(*[x for x, _ in rules], indexing="ij"), axis=-1).reshape(-1, len(orders))
    weights = np.prod(np.stack(np.meshgrid(*[w for _, w in rules], indexing="ij"), axis=-1), axis=-1).reshape(-1)
    return points, weights


def shape(xi: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shape functions at the points xi (n, d): values (n, 2^d), d = 3 for the hexahedron, 2 for its faces."""
    nodes = NODES[: 2 ** xi.shape[1], : xi.shape[1]]
    return np.prod(0.5 * (1 + nodes[None] * xi[:, None]), axis=-1)


def shape_gradient(xi: NDArray[np.float64]) -> NDArray[np.float64]:
    """Derivatives of the shape functions by the reference coordinates at xi (n, d): (n, 2^d, d)."""
    d = xi.shape[1]
    nodes = NODES[: 2**d, :d]
    factors = 0.5 * (1 + nodes[None] * xi[:, None])
    return np.stack(
        [0.5 * nodes[None, :, k] * np.prod(np.delete(factors, k, axis=-1), axis=-1) for k in range(d)], axis=-1
    )
