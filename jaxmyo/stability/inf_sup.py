"""The numerical inf-sup test of Chapelle and Bathe (1993), for the pressure p, the multiplier q of the weave, and both.

    β = min over multipliers m of max over displacements u of  b(u, m) / (|u|₁ ‖m‖₀),
    b(u, (p, q)) = ∫ p tr E + q (E22 − ½ (π−2) a/D E11) dV,    |u|₁² = ∫ |∇u|² dV,    ‖(p, q)‖₀² = ∫ p² + q² dV,

both constraints linearised at rest, E = sym ∇u, 1 along the fibre, 2 across. β² is the least eigenvalue of S m = λ M m
with S = B A⁻¹ Bᵀ; A, B and M are those of |u|₁, b and ‖m‖₀. A multiplier that no displacement feels (λ = 0: a redundant
constraint) has no part in β; such modes are counted apart. The constant means something where it is bounded below as
the mesh is refined: then p and q converge with the displacements. Otherwise they may oscillate between elements.

S is made once for one p and one q per element. Fewer multipliers, shared by patches of elements, are a subspace of
those, m = Tᵀ m', so that S' = T S Tᵀ costs nothing more.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from jaxmyo import constraints
from jaxmyo.scene import Scene
from jaxmyo.system import System

#: Eigenvalues below this part of the largest are zero [–].
ZERO = 1e-10

Patches = NDArray[np.int64]


class Constant(NamedTuple):
    """The inf-sup constant [–] without the zero modes, their number, and that of the multipliers."""

    beta: float
    zero: int
    multipliers: int


@dataclass(frozen=True)
class InfSup:
    """S (2 n_e, 2 n_e) [mm³] of one p and one q per element, first all p; volume: (n_e,) of the elements [mm³]."""

    S: NDArray[np.float64]
    volume: NDArray[np.float64]

    @classmethod
    def of(cls, scene: Scene, a_over_D: float = 0.2) -> "InfSup":
        """Of a scene's mesh, fibres and supports. Its own patches have no part in it."""
        system = System.of(scene, scene.kinematics(()), weave=True, surfaces={})
        assert system.gradient is not None
        assert system.local_u is not None
        weight, own, gradient = (np.asarray(x) for x in (system.weight, system.local_u, system.gradient))
        n_e, n_u = len(own), system.n_u
        A, B = np.zeros((n_u, n_u)), np.zeros((2 * n_e, n_u))
        of_elements = np.einsum("eg,egia,egib->eab", weight, gradient, gradient, optimize=True)
        np.add.at(A, (own[:, :, None], own[:, None, :]), of_elements)
        of_p, of_q = constraints.rows_at_rest(system, a_over_D)  # −1 and ½ times the form b
        np.add.at(B, (np.arange(n_e)[:, None], own), -of_p)
        np.add.at(B, (np.arange(n_e, 2 * n_e)[:, None], own), 2.0 * of_q)
        # Dense: 6,084 displacements of 12³ elements are 0.3 GB, and S is full in any case.
        lower = scipy.linalg.cholesky(A, lower=True, overwrite_a=True)
        half = scipy.linalg.solve_triangular(lower, B.T, lower=True)
        return cls(half.T @ half, weight.sum(axis=1))

    def constant(self, p: Patches | None, q: Patches | None) -> Constant:
        """Of p, of q, or of both, on patches (n_e,) of elements; None: without it."""
        n_e = len(self.volume)
        T = scipy.linalg.block_diag(*(_gather(patches, n_e) for patches in (p, q) if patches is not None))
        parts = [np.arange(k * n_e, (k + 1) * n_e) for k, patches in enumerate((p, q)) if patches is not None]
        own = np.concatenate(parts)
        S = T @ self.S[np.ix_(own, own)] @ T.T
        root = np.sqrt(T @ np.tile(self.volume, len(parts)))
        eigenvalues = scipy.linalg.eigvalsh(S / root[:, None] / root[None])
        zero = int(np.sum(eigenvalues <= ZERO * eigenvalues[-1]))
        return Constant(float(np.sqrt(eigenvalues[zero])), zero, len(S))


def _gather(patches: Patches, n_e: int) -> NDArray[np.float64]:
    """(n_patches, n_e): 1 where an element belongs to a patch."""
    T = np.zeros((int(patches.max()) + 1, n_e))
    T[patches, np.arange(n_e)] = 1.0
    return T
