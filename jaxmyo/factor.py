"""Sparse symmetric factorisations with their inertia: Pardiso where it is installed (`jaxmyo[fast]`), else SciPy."""

from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from jaxmyo.assembly import Pattern

Floats = NDArray[np.float64]


class Solver(Protocol):
    """Factors of one symmetric matrix at a time, always of the same pattern (the upper triangle in CSR)."""

    name: str
    inertia: tuple[int, int]

    def factorise(self, data: Floats) -> None:
        """Factorise the matrix with these entries; `inertia` is then (negative eigenvalues, perturbed pivots)."""

    def solve(self, b: Floats) -> Floats:
        """The solution of matrix · x = b."""


def solver(pattern: Pattern) -> Solver:
    """The best solver that is installed, for matrices of a pattern."""
    try:
        return _Pardiso(pattern)
    except ImportError:
        return _SuperLU(pattern)


class _Pardiso:
    """MKL Pardiso, LDLᵀ; pattern and ordering are analysed once."""

    name = "Pardiso"

    def __init__(self, pattern: Pattern) -> None:
        from pypardiso import PyPardisoSolver

        self._matrix = pattern.matrix(np.zeros(pattern.nnz))
        self._solver = PyPardisoSolver(mtype=-2)
        for k, value in _IPARM.items():
            self._solver.set_iparm(k, value)
        self._phase = 12  # analysis and factorisation
        self.inertia = (0, 0)

    def factorise(self, data: Floats) -> None:
        self._matrix.data = data
        self._call(self._phase, np.zeros(len(data)))
        self._phase = 22  # factorisation
        self.inertia = (int(self._solver.get_iparm(23)), int(self._solver.get_iparm(14)))

    def solve(self, b: Floats) -> Floats:
        return self._call(33, b)

    def _call(self, phase: int, b: Floats) -> Floats:
        # Its public methods hash the matrix at every call, to see whether it is the one that was factorised.
        self._solver.set_phase(phase)
        return np.asarray(
            self._solver._call_pardiso(self._matrix, np.asfortranarray(b[: self._matrix.shape[0], None]))
        )[:, 0]


#: Pardiso: own settings; nested dissection; no refinement; pivots perturbed by 1e-13; scaling and matching for
#: indefinite matrices; two-level parallel factorisation.
_IPARM = {1: 1, 2: 3, 8: 0, 10: 13, 11: 1, 13: 1, 24: 1}


class _SuperLU:
    """SciPy's SuperLU, pivots on the diagonal where it can."""

    name = "SuperLU"

    def __init__(self, pattern: Pattern) -> None:
        self._pattern = pattern
        self._lu: Any = None
        self.inertia = (0, 0)

    def factorise(self, data: Floats) -> None:
        upper = self._pattern.matrix(data)
        matrix = (upper + sp.triu(upper, 1).T).tocsc()
        self._lu = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        self.inertia = (int(np.sum(self._lu.U.diagonal() < 0.0)), 0)

    def solve(self, b: Floats) -> Floats:
        return np.asarray(self._lu.solve(b))
