"""What solves with one sparse symmetric matrix: factorisations with their inertia, and multigrid for large ones.

Pardiso where it is installed (`jaxmyo[fast]`), else SciPy; pyamg for what the factors of either could not hold.
"""

import copy
import sys
from collections.abc import Callable
from functools import cache
from threading import Thread
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from jaxmyo import checks
from jaxmyo.pattern import Pattern

Floats = NDArray[np.float64]

#: Displacements from which on direct factors would need tens of gigabytes [–].
HUGE = 400_000


class Solver(Protocol):
    """Solves with one symmetric matrix at a time, always of the same pattern (the upper triangle in CSR).

    augmentation: the γ, over the stiffness of the body, that suits it; iterations: Krylov iterations that are worth it
    with the matrix of another tangent, and with its own; inertia: (negative eigenvalues, perturbed pivots) of the
    matrix, −1 where they are not known; size: of the factors and of the work to make them, as far as it is known.
    """

    name: str
    augmentation: float
    iterations: tuple[int, int]
    inertia: tuple[int, int]
    size: dict[str, float]

    def factorise(self, data: Floats) -> None:
        """Take the matrix with these entries."""

    def solve(self, b: Floats) -> Floats:
        """The solution of matrix · x = b, or of multigrid an approximation, linear in b."""

    def free(self) -> None:
        """Free the factors."""


def solver(pattern: Pattern, like: Floats, motions: Callable[[], Floats]) -> Solver:
    """The best solver that is installed, for matrices of a pattern.

    like: the entries (nnz,) of a definite matrix with the same units; motions: the rigid ones (n_u, 6).
    """
    kind = chosen(pattern.n_u)
    if kind is _Multigrid:
        return _Multigrid(pattern, motions)
    return _Pardiso(pattern, like) if kind is _Pardiso else _SuperLU(pattern)


def chosen(n_u: int) -> Any:
    """The kind of solver for so many displacements."""
    if n_u > HUGE:
        return _Multigrid
    try:
        _pardiso()
    except ImportError:
        return _SuperLU
    return _Pardiso


class _Pardiso:
    """MKL Pardiso, LDLᵀ; pattern and ordering are analysed once, beside what else goes on before the first matrix."""

    name = "Pardiso"
    augmentation, iterations = 1e4, (20, 60)

    def __init__(self, pattern: Pattern, like: Floats) -> None:
        self._matrix = pattern.matrix(like)
        self._solver = copy.copy(_pardiso())
        self._solver.pt = np.zeros_like(self._solver.pt)
        self._solver.iparm = np.zeros_like(self._solver.iparm)
        for k, value in _IPARM.items():
            self._solver.set_iparm(k, value)
        self._analysis = Thread(target=self._call, args=(11, np.zeros(pattern.n_u)))
        self._analysis.start()
        self.inertia = (0, 0)
        self.size: dict[str, float] = {}

    def factorise(self, data: Floats) -> None:
        self._analysis.join()
        self._matrix.data = data
        self._call(22, np.zeros(len(data)))
        self.inertia = (int(self._solver.get_iparm(23)), int(self._solver.get_iparm(14)))
        self.size = {"factor GB": 8e-9 * self._solver.get_iparm(18), "factor GFLOP": 1e-3 * self._solver.get_iparm(19)}

    def solve(self, b: Floats) -> Floats:
        return self._call(33, b)

    def _call(self, phase: int, b: Floats) -> Floats:
        # Its public methods hash the matrix at every call, to see whether it is the one that was factorised.
        self._solver.set_phase(phase)
        return np.asarray(
            self._solver._call_pardiso(self._matrix, np.asfortranarray(b[: self._matrix.shape[0], None]))
        )[:, 0]

    def free(self) -> None:
        self._analysis.join()
        self._call(0, np.zeros(self._matrix.shape[0]))  # of the factors; pattern and ordering stay

    def __del__(self) -> None:
        if not sys.is_finalizing():
            self._analysis.join()
            self._call(-1, np.zeros(self._matrix.shape[0]))  # free all its memory


@cache
def _pardiso() -> Any:
    """A solver to copy: to find the library takes a fifth of a second."""
    from pypardiso import PyPardisoSolver

    return PyPardisoSolver(mtype=-2)


#: Pardiso: own settings; nested dissection; no refinement; pivots perturbed by 1e-13; scaling and matching for
#: indefinite matrices; two-level parallel factorisation.
_IPARM = {1: 1, 2: 3, 8: 0, 10: 13, 11: 1, 13: 1, 18: -1, 19: -1, 24: 1}


class _SuperLU:
    """SciPy's SuperLU, pivots on the diagonal where it can."""

    name = "SuperLU"
    augmentation, iterations = 1e4, (20, 60)

    def __init__(self, pattern: Pattern) -> None:
        self._pattern = pattern
        self._lu: Any = None
        self.inertia = (0, 0)
        self.size: dict[str, float] = {}

    def factorise(self, data: Floats) -> None:
        self._lu = splu(
            self._pattern.full(data).tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        self.inertia = (int(np.sum(self._lu.U.diagonal() < 0.0)), 0)
        self.size = {"factor GB": 16e-9 * self._lu.nnz}

    def solve(self, b: Floats) -> Floats:
        return np.asarray(self._lu.solve(b))

    def free(self) -> None:
        self._lu = None


class _Multigrid:
    """Smoothed aggregation (pyamg), one V-cycle per solve; its memory grows with the number of unknowns only."""

    name = "multigrid"
    augmentation, iterations = 3.0, (100, 300)  # it is the better, the less the volume is held
    inertia = (-1, -1)

    def __init__(self, pattern: Pattern, motions: Callable[[], Floats]) -> None:
        try:
            import pyamg
        except ModuleNotFoundError as error:
            raise checks.missing(error, f"a body of {pattern.n_u} unknowns needs", "pyamg") from error
        self._build, self._pattern, self._motions = pyamg.smoothed_aggregation_solver, pattern, motions()
        self._cycle: Any = None
        self.size: dict[str, float] = {}

    def factorise(self, data: Floats) -> None:
        matrix = self._pattern.full(data)
        if self._pattern.n_u % 3 == 0:
            matrix = matrix.tobsr((3, 3))
        smoother = ("block_gauss_seidel", {"sweep": "symmetric"})
        self._cycle = self._build(matrix, B=self._motions, presmoother=smoother, postsmoother=smoother)
        self._cycle = self._cycle.aspreconditioner(cycle="V")

    def solve(self, b: Floats) -> Floats:
        return np.asarray(self._cycle @ b)

    def free(self) -> None:
        self._cycle = None
