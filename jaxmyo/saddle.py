"""Linear systems with the saddle matrix of a large body, by Krylov iterations with factors of a matrix like it.

With p on one element, A + BᵀWB has the pattern of A, and one factorisation of it solves the saddle system

    [A  Bᵀ] [u]   [a]
    [B   D] [m] = [b]        u = Â⁻¹ (a + BᵀW b),  m = W (B u − b),   Â = A + BᵀWB,  W = (V/γ − D)⁻¹

up to a remainder of 1/γ, which a few Krylov iterations on the saddle system itself remove. The residual that counts is
always that of the saddle system.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, gcrotmk
from threadpoolctl import ThreadpoolController

from jaxmyo import factor
from jaxmyo.pattern import Floats
from jaxmyo.system import Inputs

SINGLE = 1e-4  # relative residual that Krylov iterations in single precision reach [–]
ROUNDS = 1, 10  # of them that are worth it, with a preconditioner of another tangent, and with its own

Product = Callable[[Floats], Floats]

_BLAS = ThreadpoolController().select(internal_api="openblas")


@dataclass(frozen=True, eq=False)
class Tangent:
    """The saddle matrix at one state z, under some inputs.

    data: (nnz,) upper triangle of A + BᵀWB; loads: (n_u, n_u) derivative of the loads, which A leaves out, or None;
    B: (n_m, n_u); D, W: (n_m,); walls: (n_cavities, n_u) coupling with the pressures in cavities; diagonal: (n_u,) of A
    less the loads.
    """

    z: Floats
    inputs: Inputs
    data: Floats
    loads: sp.csr_matrix | None
    B: sp.csr_matrix
    D: Floats
    W: Floats
    walls: Floats
    diagonal: Any

    @property
    def bytes(self) -> int:
        """Of its largest parts."""
        return self.data.nbytes + self.B.data.nbytes + self.B.indices.nbytes


@dataclass(frozen=True, eq=False)
class Factored:
    """Factors of the augmented matrix of a tangent K, which solve its saddle system up to a remainder of 1/γ.

    by_walls: (n_u, n_cavities) Â⁻¹ of the coupling with the pressures in cavities; held: directions in which the
    volumes of the cavities hold a body back that is unstable at its pressures.
    """

    K: Tangent
    factors: factor.Solver
    by_walls: Floats
    held: int

    @classmethod
    def of(cls, K: Tangent, factors: factor.Solver) -> "Factored":
        """With the factors that a solver now has, of K."""
        if not len(K.walls):
            return cls(K, factors, K.walls.T, 0)
        by_walls = np.stack([factors.solve(w) for w in K.walls], 1)
        S = K.walls @ by_walls
        return cls(K, factors, by_walls, int(np.sum(np.linalg.eigvalsh(0.5 * (S + S.T)) < 0.0)))

    def solve(self, b: Floats) -> Floats:
        """All but the solution x (n,) of the saddle system K x = b."""
        K, n_u = self.K, len(self.by_walls)
        m, P = b[n_u : n_u + len(K.W)], b[n_u + len(K.W) :]
        u = self.factors.solve(b[:n_u] + K.B.T @ (K.W * m))
        in_cavities = np.linalg.solve(K.walls @ self.by_walls, K.walls @ u - P)
        u -= self.by_walls @ in_cavities
        return np.concatenate([u, K.W * (K.B @ u - m), in_cavities])


def augmented(K: Tangent, times: Product) -> Product:
    """The product of the elements' part of K and (u, m), by that of Â and u."""

    def product(x: Floats) -> Floats:
        u, m = x[: len(x) - len(K.W)], x[len(x) - len(K.W) :]
        Bu = K.B @ u
        return np.concatenate([times(u) + K.B.T @ (m - K.W * Bu), Bu + K.D * m])

    return product


def solve(
    K: Tangent,
    of_elements: Product,
    single: Product | None,
    by: Factored,
    s: Floats,
    b: Floats,
    accuracy: float,
    guess: Floats | None,
) -> tuple[Floats, float, int]:
    """The solution x (n,) of a saddle system, its relative residual, and the number of iterations.

    of_elements: the product of the elements' part of K, or of a stiffer matrix, and (u, m); by: the preconditioner, of
    K or of a tangent like it; s: (n,) scales, residuals are measured as s · b; accuracy: the relative residual that is
    aimed at; guess: of x; single: as of_elements, but cheap and of single precision, where of_elements is matrix-free.
    """
    most, count = by.factors.iterations[by.K is K], 0

    def precondition(r: Any) -> Any:
        nonlocal count
        count += 1
        return by.solve(r / s) / s

    with _BLAS.limit(limits=1):  # its threads only wait for each other here
        A, M = _operator(K, of_elements, s, np.float64), LinearOperator((len(b), len(b)), precondition, dtype=float)
        start = np.zeros(len(b)) if guess is None else guess / s
        r = s * b if guess is None else s * b - A @ start
        aim, left = accuracy * factor.norm(s * b), factor.norm(r)
        if aim == 0.0:
            return np.zeros_like(b), 0.0, 0
        if left > aim:
            if single is not None:
                M = _in_rounds(_operator(K, single, s, np.float32), M, most, aim / left)
                most = ROUNDS[by.K is K]
            y, _ = gcrotmk(A, r, rtol=0.0, atol=aim, maxiter=1, m=most, k=0, M=M)
            start, left = start + y, factor.norm(r - A @ y)
        return s * start, left * accuracy / aim, count


def _operator(K: Tangent, of_elements: Product, s: Floats, dtype: Any) -> LinearOperator:
    """s · K · s."""
    n_u, end = len(s) - len(K.walls) - len(K.W), len(s) - len(K.walls)

    def product(y: Any) -> Any:
        x = s * y
        f = np.concatenate([of_elements(x[:end]), K.walls @ x[:n_u]])
        f[:n_u] += x[end:] @ K.walls
        if K.loads is not None:
            f[:n_u] -= K.loads @ x[:n_u]
        return (s * f).astype(dtype)

    return LinearOperator((len(s), len(s)), product, dtype=dtype)


def _in_rounds(A: LinearOperator, M: LinearOperator, most: int, accuracy: float) -> LinearOperator:
    """The preconditioner of a matrix-free solve: each of its iterations is a round of them in single precision.

    A: the matrix in single precision, with which an iteration costs as little as its preconditioner M; most: of them.
    """
    left = 1.0

    def solution(r: Any) -> Any:
        nonlocal left
        size, aim = factor.norm(r), min(max(0.5 * accuracy / left, SINGLE), 0.1)
        left *= aim
        y, _ = gcrotmk(A, (r / size).astype(np.float32), rtol=aim, atol=0.0, maxiter=1, m=most, k=0, M=M)
        return size * y.astype(np.float64)

    return LinearOperator(A.shape, solution, dtype=np.float64)
