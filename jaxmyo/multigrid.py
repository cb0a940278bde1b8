"""Algebraic multigrid for what direct factors could not hold: its memory grows with the number of unknowns only.

The levels are those of smoothed aggregation (pyamg). What is done in a cycle is all products of sparse matrices and
vectors, in single precision: Chebyshev's iteration smooths, preconditioned by the blocks on the diagonal.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, eigs

from jaxmyo import checks, mkl
from jaxmyo.pattern import Floats, Pattern

DEGREE = 6  # of a smoothing polynomial
SMOOTHED = 0.02  # smallest eigenvalue that it damps, over the largest
LARGER = 1.1  # than it is computed, the largest may be: it is found to some percent
COARSEST = 300  # unknowns that are solved for directly

Singles = NDArray[np.float32]


class Multigrid:
    """Smoothed aggregation, one V-cycle per solve; a `factor.Solver`."""

    name = "multigrid"
    augmentation, iterations = 10.0, (30, 200)  # it is the better, the less the volume is held
    inertia = (-1, -1)

    def __init__(self, pattern: Pattern, motions: Callable[[], Floats]) -> None:
        try:
            import pyamg
        except ModuleNotFoundError as error:
            raise checks.missing(error, f"a body of {pattern.n_u} unknowns needs", "pyamg") from error
        self._build, self._pattern, self._motions = pyamg.smoothed_aggregation_solver, pattern, motions()
        self._levels: list[_Level] = []
        self._coarsest: Singles = np.zeros((0, 0), np.float32)
        self.size: dict[str, float] = {}

    def factorise(self, data: Floats) -> None:
        self.free()
        matrix = self._pattern.full(data)
        if self._pattern.n_u % 3 == 0:
            matrix = matrix.tobsr((3, 3))
        none: dict[str, Any] = dict.fromkeys(("presmoother", "postsmoother", "improve_candidates"))
        *levels, last = self._build(matrix, B=self._motions, max_coarse=COARSEST, **none).levels
        self._levels = [_Level(level) for level in levels]
        self._coarsest = np.linalg.pinv(last.A.toarray(), hermitian=True).astype(np.float32)

    def solve(self, b: Floats) -> Floats:
        return self._cycle(b.astype(np.float32), 0).astype(np.float64)

    def _cycle(self, b: Singles, k: int) -> Singles:
        if k == len(self._levels):
            return self._coarsest @ b
        level = self._levels[k]
        x = level.smoothed(b)
        x += level.prolongation @ self._cycle(level.restriction @ (b - level.matrix @ x), k + 1)
        x += level.smoothed(b - level.matrix @ x)
        return x

    def sharpen(self) -> bool:
        return False

    def free(self) -> None:
        self._levels = []


class _Level:
    """The matrix of a level, the smoother, and the way to the next level and back."""

    def __init__(self, level: Any) -> None:
        from pyamg.util.utils import get_block_diag

        size = level.A.blocksize[0] if level.A.format == "bsr" else 1
        blocks = get_block_diag(level.A, size, inv_flag=True)
        count = len(blocks)
        self.matrix, self.prolongation, self.restriction = map(_multiplying, (level.A, level.P, level.P.T))
        inverse = sp.bsr_matrix((blocks, np.arange(count), np.arange(count + 1)), shape=level.A.shape)
        self._by_blocks = _multiplying(inverse)

        def scaled(x: Any) -> Any:
            return (self._by_blocks @ (self.matrix @ x.astype(np.float32).ravel())).astype(np.float64)

        operator = LinearOperator(level.A.shape, scaled, dtype=np.float64)
        start = np.random.default_rng(0).normal(size=level.A.shape[0])
        (largest,) = np.abs(eigs(operator, 1, tol=0.05, v0=start, return_eigenvectors=False))
        self._range = (SMOOTHED * LARGER * largest, LARGER * largest)

    def smoothed(self, b: Singles) -> Singles:
        """An approximate solution x of matrix · x = b, all but right in what is not smooth.

        Chebyshev's iteration: Y. Saad, Iterative Methods for Sparse Linear Systems (2003), algorithm 12.1.
        """
        low, high = self._range
        middle, half = 0.5 * (high + low), 0.5 * (high - low)
        rho, r = half / middle, b
        d = np.float32(1.0 / middle) * (self._by_blocks @ b)
        x = d.copy()
        for _ in range(DEGREE - 1):
            last, rho = rho, 1.0 / (2.0 * middle / half - rho)
            r = r - self.matrix @ d
            d = np.float32(rho * last) * d + np.float32(2.0 * rho / half) * (self._by_blocks @ r)
            x += d
        return x


def symmetric(pattern: Pattern, data: Floats) -> Callable[[Floats], Any]:
    """The product of the symmetric matrix with these entries, in single precision, and vectors (n_u,)."""
    single = data.astype(np.float32)
    try:
        product = mkl.Matrix(pattern.matrix(single), symmetric=True).__matmul__
    except ImportError:
        product = pattern.product(single)
    return lambda u: product(u.astype(np.float32))


def _multiplying(matrix: Any) -> Any:
    """A matrix that multiplies vectors of single precision, by all cores where MKL is installed."""
    if matrix.format == "bsr" and matrix.blocksize[0] != matrix.blocksize[1]:
        matrix = matrix.tocsr()
    try:
        return mkl.Matrix(matrix)
    except ImportError:
        return matrix.astype(np.float32)
