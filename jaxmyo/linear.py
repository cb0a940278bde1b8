"""The linearised system of a small body: dense matrices, all inside JAX. `jaxmyo.sparse` is its like for large ones."""

from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxmyo import element_batches, lagrangian, tiny, tracing
from jaxmyo.system import Inputs, System


class Scales(NamedTuple):
    """What makes residuals and tangents of different unknowns comparable.

    unit: (n,) the change of an unknown that strains its elements by about one (displacements), 1 for multipliers [kPa];
    volume: (n,) the volume of the elements that an unknown touches, or of a cavity [mm³].
    """

    unit: Array
    volume: Array


class At(NamedTuple):
    """The linearised system at one point.

    r: (n,) residual [mN, mN·mm; mm³]; K: the tangent, of a type of its solver's own; stress: the largest force
    imbalance as a stress [kPa]; violation: the largest patch mean of ½ |I3 − 1| and ½ |h|, or relative error of a
    volume [–]; modulus: the largest stress [kPa] by a unit strain of one unknown, or the largest multiplier; least_J:
    the smallest det F [–], or −1 where a hole closed; finite: whether everything is; noise: the relative residual that
    round-off alone may leave.
    """

    r: Array
    K: Any
    stress: Array
    violation: Array
    modulus: Array
    least_J: Array
    finite: Array
    noise: Array

    @property
    def residual(self) -> Array:
        """The larger of (force imbalance as a stress / largest stiffness) and (constraint violation) [–]."""
        return (self.stress / self.modulus).clip(self.violation)

    @classmethod
    def unknown(cls, xp: ModuleType, z: Any, K: Any) -> "At":
        """Before anything was computed, to begin a loop with."""
        one, infinite = xp.array(1.0), xp.array(xp.inf)
        return cls(xp.zeros_like(z), K, infinite, infinite, one, one, xp.array(True), 0.0 * one)


def negligible(xp: ModuleType, x: Any) -> float:
    """What is lost beside 1 in a sum of numbers like x: 1e-13 in float64, 5e-5 in float32."""
    return 450.0 * float(xp.finfo(x.dtype).eps)


def stiffness(xp: ModuleType, scale: Scales, diagonal: Any) -> Any:
    """The largest stress [kPa] by a unit strain of one unknown; diagonal: (n_u,) of the tangent."""
    unit, volume = scale.unit[: len(diagonal)], scale.volume[: len(diagonal)]
    return xp.max(xp.abs(diagonal * unit * (unit / volume)), initial=xp.finfo(diagonal.dtype).tiny)


def summary(xp: ModuleType, system: System, scale: Scales, z: Any, r: Any, diagonal: Any, least_J: Any, K: Any) -> At:
    """What Newton's method asks of a point, with `jax.numpy` or `numpy`; diagonal: (n_u,) of the tangent.

    Displacements of many `unit`s, the length of an element, are known to round-off of so many strains.
    """
    n_u = system.n_u
    weigh = scale.unit / scale.volume
    G = xp.max(xp.abs(z[n_u:]), initial=0.0).clip(stiffness(xp, scale, diagonal))
    rounding = 4.0 * xp.finfo(z.dtype).eps * xp.max(xp.abs(z[:n_u]) / scale.unit[:n_u], initial=1.0)
    return At(
        r=r,
        K=K,
        stress=xp.max(xp.abs(r * weigh)[:n_u], initial=0.0),
        violation=xp.max(xp.abs(r / scale.volume)[n_u:], initial=0.0),
        modulus=G,
        least_J=least_J,
        finite=xp.all(xp.isfinite(r)) & xp.all(xp.isfinite(diagonal)),
        noise=rounding,
    )


def scales(system: System, metric_diagonal: Array) -> Scales:
    """The scales of a small system; metric_diagonal: (n_u,) ∫ |∂F|² dV of each displacement."""
    size = jnp.sum(system.weight, axis=1)
    touches = jnp.any(system.gradient != 0.0, axis=(1, 2)).astype(float)
    volume = jnp.zeros(system.size).at[system.local_u].add(size[:, None] * touches)
    volume = volume.at[system.local_multipliers].add(size[:, None])
    if system.cavities:
        volume = volume.at[-len(system.cavities) :].set(lagrangian.enclosed(system, jnp.zeros_like(system.points)))
    unit = jnp.ones(system.size).at[: system.n_u].set(jnp.sqrt(volume[: system.n_u] / metric_diagonal))
    return Scales(unit, volume)


@jax.jit
def strain_of(system: System, dz: Array) -> tuple[Array, Array]:
    """Root mean square and maximum over the body of |∂F| [–] for a change dz of the unknowns at rest."""
    square = lagrangian.square_of_strain(system, dz)
    return jnp.sqrt(jnp.sum(system.weight * square) / jnp.sum(system.weight)), jnp.sqrt(jnp.max(square))


@jax.jit
def strain_rate(system: System, z: Array, inputs: Inputs, rate: Array, offset_rate: Array) -> Array:
    """Root mean square over the body of |∂F| for the rates of the unknowns and of `Inputs.offset`."""

    def F(z: Array, offset: Array) -> Array:
        return lagrangian.deformation_gradients(system, system.displacements(z, inputs._replace(offset=offset)))

    _, dF = jax.jvp(F, (z, inputs.offset), (rate, offset_rate))
    return jnp.sqrt(jnp.sum(system.weight[:, :, None, None] * dF**2) / jnp.sum(system.weight))


# Batches of LAPACK's calls go one after the other. A batched call of jaxlib 0.10 hands its matrices to XLA's threads,
# and waits for them in one of these threads: as many such calls at a time as there are threads, in one program or in
# several, wait for ever. One after the other they take no more processor time.


@jax.custom_batching.sequential_vmap
def _lu(K: Array) -> tuple[Array, Array, Array]:
    """LU factors (n, n) in one matrix, pivots and permutation (n,)."""
    lu, pivots, permutation = jax.lax.linalg.lu(K)
    return lu, pivots, permutation


@jax.custom_batching.sequential_vmap
def _back(lu: Array, b: Array) -> Array:
    """The solution x (n,) of L U x = b."""
    triangular = partial(jax.lax.linalg.triangular_solve, lu, left_side=True)
    return triangular(triangular(b[:, None], lower=True, unit_diagonal=True), lower=False)[:, 0]


@jax.custom_batching.sequential_vmap
def _tridiagonal(A: Array) -> tuple[Array, Array]:
    """The diagonal (n,) and the one beside it (n − 1,) of a matrix similar to a symmetric one."""
    _, diagonal, beside, _ = jax.lax.linalg.tridiagonal(A)
    return diagonal, beside


class Factors(NamedTuple):
    """LU factors of K + μ·metric, and the sign of its determinant, ±1 (or 0).

    The sign flips where an odd number of modes gain or lose stability.
    """

    lu: Array
    permutation: Array
    sign: Array

    @classmethod
    def of(cls, K: Array) -> "Factors":
        """By LAPACK or its like."""
        lu, pivots, permutation = _lu(K)
        swaps = jnp.sum(pivots != jnp.arange(len(K), dtype=pivots.dtype))
        return cls(lu, permutation, jnp.prod(jnp.sign(jnp.diagonal(lu))) * jnp.where(swaps % 2 == 0, 1.0, -1.0))

    def solve(self, b: Array, accuracy: Any, guess: Array | None = None) -> Array:
        """The solution x of (K + μ·metric) x = b; direct, whatever the accuracy asked for."""
        return _back(self.lu, b[self.permutation])


def _is_tiny(size: int) -> bool:
    return size <= tiny.ROWS


def factors(matrix: Array) -> Factors | tiny.Inverse:
    """Factors, or the inverse of a tiny matrix."""
    return tiny.invert(matrix) if _is_tiny(len(matrix)) else Factors.of(matrix)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Dense:
    """The linear algebra of a system with dense matrices. metric: (n, n) ∫ |∂F|² dV of the displacements."""

    system: System
    scale: Scales
    metric: Array

    xp = jnp
    name = "dense LU"
    inexact = 0.0  # whether the linear systems are solved to the accuracy asked for only
    work: ClassVar[dict[str, Array]] = {}

    @classmethod
    def of(cls, system: System) -> "Dense":
        """With the scales of the system; they depend on the mesh and the ties only."""
        assert system.gradient is not None
        assert system.local_u is not None
        weights, own = system.weight[:, :, None, None], system.local_u
        of_elements = jnp.einsum("gkia,gkib->gab", weights * system.gradient, system.gradient)
        metric = jnp.zeros((system.size, system.size)).at[own[:, :, None], own[:, None, :]].add(of_elements)
        return cls(system, scales(system, jnp.diagonal(metric)[: system.n_u]), metric)

    def at(self, z: Array, inputs: Inputs) -> At:
        """The residual (n,) and the tangent (n, n) at z."""
        return self._at(z, inputs) if tracing.is_traced(z) else _at(self, z, inputs)

    def _at(self, z: Array, inputs: Inputs) -> At:
        # The barrier keeps XLA from fusing, and so repeating, the element's arithmetic into each use of its result.
        r, K, J = jax.lax.optimization_barrier(element_batches.linearised(self.system, z, inputs))
        J = jnp.where(lagrangian.is_folded(self.system, self.system.displacements(z, inputs)), -1.0, J)
        at = summary(jnp, self.system, self.scale, z, r, jnp.diagonal(K)[: self.system.n_u], J, K)
        return at._replace(finite=at.finite & jnp.all(jnp.isfinite(K)))

    def factorise(self, at: At, mu: Array, last: Array) -> Factors | tiny.Inverse:
        """Factors of K + μ·metric; μ [kPa] stiffens every strain alike, where the tangent itself has no stiffness."""
        return factors(at.K + mu * self.metric)

    def nothing(self) -> tuple[Array, Factors | tiny.Inverse]:
        """A tangent and factors to begin a loop with."""
        n = self.system.size
        none = jnp.zeros((n, n))
        if _is_tiny(n):
            return none, tiny.Inverse(none, jnp.zeros(()))
        return none, Factors(none, jnp.zeros(n, dtype="int32"), jnp.zeros(()))

    def strain_of(self, dz: Array) -> tuple[Array, Array]:
        """Root mean square and maximum over the body of |∂F| [–] for a change dz of the unknowns at rest."""
        return strain_of(self.system, dz)

    def rates(self, z: Array, inputs: Inputs, by_t: Inputs, factors: Factors | tiny.Inverse) -> tuple[Array, Array]:
        """dz/dt (n,) along the path whose inputs change by by_t, and the root-mean-square strain rate.

        What does not move at all has the number 0.0 in by_t, and takes no part in the arithmetic.
        """
        rate = -factors.solve(element_batches.rate(self.system, z, inputs, by_t), None)
        return rate, strain_rate(self.system, z, inputs, rate, jnp.broadcast_to(by_t.offset, inputs.offset.shape))

    def inertia(self, at: At, z: Array) -> tuple[Array, Array]:
        """(negative eigenvalues of the second variation on the constraint manifold, zero ones of the saddle matrix).

        The saddle matrix [[A, Bᵀ], [B, 0]] with m independent constraints has m negative eigenvalues more than A has on
        the kernel of B. It is scaled by a congruence, which leaves the signs. With follower loads, its symmetric part
        is taken.

        This is the inertia of the discrete body, which holds det F = 1 in the mean of each element only. Deformations
        that vary inside an element feel −½ p (I3 − 1) as it stands, and may count as unstable where the continuous body
        is stable: ½ μ (I1 − 3) at rest does, ½ μ (I1 − 3 − ln I3), the same body with another pressure, does not.
        """
        n_u, size = self.system.n_u, self.system.size
        if not n_u:
            return jnp.array(0), jnp.array(size)
        root = jnp.sqrt(self.scale.volume)
        s = jnp.where(jnp.arange(size) < n_u, self.scale.unit / root, at.modulus / root)
        matrix = s[:, None] * (0.5 / at.modulus * (at.K + at.K.T)) * s[None, :]
        limits = 1e-12 * size * jnp.array([-1.0, 1.0])
        diagonal, beside = tiny.tridiagonal(matrix) if _is_tiny(size) else _tridiagonal(matrix)
        negative, not_positive = tiny.eigenvalues_below(diagonal, beside, limits)
        return negative - (size - n_u), not_positive - negative


@jax.jit
def _at(dense: Dense, z: Array, inputs: Inputs) -> At:
    return dense._at(z, inputs)
