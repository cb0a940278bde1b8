"""Linear systems with the saddle matrix of a large body, by Krylov iterations with factors of a matrix like it.

With p on one element, A + BᵀWB has the pattern of A, and one factorisation of it solves the saddle system

    [A  Bᵀ] [u]   [a]
    [B   D] [m] = [b]        u = Â⁻¹ (a + BᵀW b),  m = W (B u − b),   Â = A + BᵀWB,  W = (V/γ − D)⁻¹

up to a remainder of 1/γ, which a few Krylov iterations on the saddle system itself remove. The residual that counts is
always that of the saddle system.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, gcrotmk
from threadpoolctl import ThreadpoolController

from jaxmyo import factor
from jaxmyo.pattern import Floats, Pattern
from jaxmyo.system import Inputs

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


def solve(
    K: Tangent,
    pattern: Pattern,
    data: Floats,
    by: Factored,
    s: Floats,
    b: Floats,
    accuracy: float,
    guess: Floats | None,
) -> tuple[Floats, float, int]:
    """The solution x (n,) of a saddle system, its relative residual, and the number of iterations.

    data: (nnz,) upper triangle of the augmented matrix, that of K or a stiffer one; by: the preconditioner, of K or of
    a tangent like it; s: (n,) scales, residuals are measured as s · b; accuracy: the relative residual that is aimed
    at; guess: of x.
    """
    n_u, n_m, count = pattern.n_u, len(K.W), 0
    upper, diagonal = pattern.matrix(data), data[pattern.diagonal]
    lower = upper.T

    def apply(x: Floats) -> Floats:
        u, m, P = x[:n_u], x[n_u : n_u + n_m], x[n_u + n_m :]
        Bu = K.B @ u
        forces = upper @ u + lower @ u - diagonal * u + K.B.T @ (m - K.W * Bu) + P @ K.walls
        if K.loads is not None:
            forces -= K.loads @ u
        return np.concatenate([forces, Bu + K.D * m, K.walls @ u])

    def precondition(r: Floats) -> Floats:
        nonlocal count
        count += 1
        return by.solve(r / s) / s

    with _BLAS.limit(limits=1):  # its threads only wait for each other here
        A = LinearOperator((len(b), len(b)), lambda y: s * apply(s * y), dtype=float)
        P = LinearOperator((len(b), len(b)), precondition, dtype=float)
        most, start = by.factors.iterations[by.K is K], None if guess is None else guess / s
        y, _ = gcrotmk(A, s * b, x0=start, rtol=accuracy, atol=0.0, maxiter=1, m=most, k=0, M=P)
        size = factor.norm(s * b)
        return s * y, float(factor.norm(A @ y - s * b) / size) if size else 0.0, count
