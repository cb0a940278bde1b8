"""What solves with one sparse symmetric matrix: factorisations with their inertia, and multigrid for large ones.

Pardiso where it is installed (`jaxmyo[fast]`), else SciPy; pyamg for what the factors of either could not hold.
"""

import ctypes
import sys
from collections.abc import Callable
from functools import cache
from threading import Thread, current_thread
from typing import Any, Protocol

import numpy as np
from scipy.sparse.linalg import splu

from jaxmyo import mkl
from jaxmyo.multigrid import Multigrid
from jaxmyo.pattern import Floats, Pattern

#: Displacements from which on direct factors would need tens of gigabytes [–].
HUGE = 400_000


def norm(x: Floats) -> float:
    """The length of a vector; not by BLAS, since its threads and those of Pardiso would wait for each other."""
    return float(np.sqrt(np.sum(x * x)))


class Solver(Protocol):
    """Solves with one symmetric matrix at a time, always of the same pattern (the upper triangle in CSR).

    augmentation: the γ, over the stiffness of the body, that suits it; iterations: Krylov iterations that are worth it
    with the matrix of another tangent, and with its own; size: of the factors and of the work to make them, as far as
    it is known.
    """

    name: str
    augmentation: float
    iterations: tuple[int, int]
    size: dict[str, float]

    @property
    def inertia(self) -> tuple[int, int]:
        """(negative eigenvalues, perturbed pivots) of the matrix, −1 where they are not known."""

    def factorise(self, data: Floats) -> None:
        """Take the matrix with these entries."""

    def solve(self, b: Floats) -> Floats:
        """The solution of matrix · x = b, or of multigrid an approximation, linear in b."""

    def sharpen(self) -> bool:
        """Make the factors more exact, from now on; False if they are as exact as they get."""

    def free(self) -> None:
        """Free the factors."""


def solver(pattern: Pattern, like: Floats, motions: Callable[[], Floats]) -> Solver:
    """The best solver that is installed, for matrices of a pattern.

    like: the entries (nnz,) of a definite matrix with the same units; motions: the rigid ones (n_u, 6).
    """
    kind = chosen(pattern.n_u)
    if kind is Multigrid:
        return Multigrid(pattern, motions)
    return _Pardiso(pattern, like) if kind is _Pardiso else _SuperLU(pattern)


def chosen(n_u: int) -> Any:
    """The kind of solver for so many displacements."""
    if n_u > HUGE:
        return Multigrid
    try:
        _pardiso()
    except ImportError:
        return _SuperLU
    return _Pardiso


class _Pardiso:
    """MKL Pardiso, LDLᵀ; pattern and ordering are analysed once, beside what else goes on before the first matrix.

    The factors are of single precision, half the size and made and applied twice as fast: Krylov iterations make up for
    it. Where they would not, or where the inertia could be another one, they are of double precision from then on.
    """

    name = "Pardiso"
    augmentation, iterations = 3e3, (20, 60)

    def __init__(self, pattern: Pattern, like: Floats) -> None:
        self._matrix, self._like = pattern.matrix(like), like
        self._ia, self._ja = (x.astype(np.int32) + 1 for x in (self._matrix.indptr, self._matrix.indices))
        self.size: dict[str, float] = {}
        self._begin(np.float32)

    def _begin(self, dtype: type[np.floating[Any]]) -> None:
        """Analyse the pattern, for factors of that precision."""
        self._pt, self._iparm = np.zeros(64, dtype=np.intp), np.zeros(64, dtype=np.int32)
        self._iparm[np.array(list(_IPARM)) - 1] = list(_IPARM.values())
        self._iparm[27] = dtype is np.float32
        self._iparm[9] = 6 if dtype is np.float32 else 13  # pivots are perturbed by 10⁻ᵏ
        self._dtype, self._inertia, self._is_sure = dtype, (0, 0), True
        self._values = self._like.astype(dtype)
        self._analysis = Thread(target=self._call, args=(11,))
        self._analysis.start()

    def factorise(self, data: Floats) -> None:
        self._analysis.join()
        self._matrix.data, self._values = data, data.astype(self._dtype)
        self._call(22)
        self._inertia, self._is_sure = (int(self._iparm[22]), int(self._iparm[13])), self._dtype is np.float64
        self.size = {
            "factor GB": 1e-9 * self._values.itemsize * self._iparm[17],
            "factor GFLOP": 1e-3 * self._iparm[18],
        }

    @property
    def inertia(self) -> tuple[int, int]:
        if not self._is_sure and (self._inertia[1] or not self._deviation() <= 0.5):
            self.sharpen()
        self._is_sure = True
        return self._inertia

    def _deviation(self) -> float:
        """The spectral radius of I − M⁻¹A, M the product of the factors: less than 1, they have the inertia of A."""
        upper = self._matrix
        diagonal, radius = upper.diagonal(), 0.0
        x = np.random.default_rng(0).normal(size=len(diagonal))
        for _ in range(3):
            x = x / norm(x)
            x = x - self.solve(upper @ x + upper.T @ x - diagonal * x)
            radius = norm(x)
        return radius

    def sharpen(self) -> bool:
        if self._dtype is np.float64:
            return False
        self._call(-1)
        self._begin(np.float64)
        self.factorise(self._matrix.data)
        return True

    def solve(self, b: Floats) -> Floats:
        return self._call(33, b.astype(self._dtype)).astype(np.float64)

    def _call(self, phase: int, b: Any = None) -> Any:
        """One phase of Pardiso."""
        # The methods of pypardiso know double precision only, and hash the matrix at every call.
        n, none = len(self._ia) - 1, np.zeros(1, dtype=np.int32)
        b = np.zeros(n, dtype=self._dtype) if b is None else b
        x, one, error = np.zeros_like(b), np.ones(1, dtype=np.int32), np.zeros(1, dtype=np.int32)
        kind, which, size = (np.array([k], dtype=np.int32) for k in (-2, phase, n))
        counts, matrix = (self._pt, one, one, kind, which, size), (self._values, self._ia, self._ja, none)
        arrays = (*counts, *matrix, one, self._iparm, none, b, x, error)
        _pardiso()(*(ctypes.c_void_p(a.ctypes.data) for a in arrays))
        if error[0]:
            raise RuntimeError(f"Pardiso failed with its error {error[0]} in phase {phase}")
        return x

    def free(self) -> None:
        self._analysis.join()
        self._call(0)  # of the factors; pattern and ordering stay

    def __del__(self) -> None:
        if not sys.is_finalizing():
            if self._analysis is not current_thread():  # which may have held the last reference
                self._analysis.join()
            self._call(-1)  # free all its memory


@cache
def _pardiso() -> Any:
    """The function of MKL; ImportError where it is not installed."""
    function = mkl.library()["pardiso"]  # each access makes another, with its own result type
    function.restype = None
    return function


#: Pardiso: own settings; nested dissection; no refinement; scaling and matching for indefinite matrices; two-level
#: parallel factorisation.
_IPARM = {1: 1, 2: 3, 8: 0, 11: 1, 13: 1, 18: -1, 19: -1, 24: 1}


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

    def sharpen(self) -> bool:
        return False

    def free(self) -> None:
        self._lu = None
