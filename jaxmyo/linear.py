"""The linearised system: factors, scales, inertia. Dense."""

from typing import NamedTuple

import jax.numpy as jnp
import jax.scipy.linalg as jsl
from jax import Array

from jaxmyo.lagrangian import System


class Scales(NamedTuple):
    """What makes residuals and tangents of different unknowns comparable.

    metric: (n, n) the matrix of ∫ |∂F|² dV [mm³ per unknown²] of the displacements, 0 for multipliers;
    unit: (n,) the change of an unknown that strains its elements by about one (displacements), 1 for multipliers [kPa];
    volume: (n,) the volume of the elements that an unknown touches [mm³].
    """

    metric: Array
    unit: Array
    volume: Array


def scales(system: System) -> Scales:
    """The scales of a system; they depend on the mesh and the ties only."""
    n, n_u = system.size, system.n_u
    own = system.local_u
    weights = system.weight[:, :, None, None]
    local = jnp.einsum("gkia,gkib->gab", weights * system.gradient, system.gradient)
    metric = jnp.zeros((n, n)).at[own[:, :, None], own[:, None, :]].add(local)
    size = jnp.sum(system.weight, axis=1)
    touches = jnp.any(system.gradient != 0.0, axis=(1, 2)).astype(float)
    volume = jnp.zeros(n).at[own].add(size[:, None] * touches)
    volume = volume.at[system.local_multipliers].add(size[:, None])
    diagonal = jnp.where(jnp.arange(n) < n_u, jnp.diagonal(metric), volume)
    return Scales(metric, jnp.sqrt(volume / diagonal), volume)


def modulus(system: System, scale: Scales, K: Array, z: Array) -> Array:
    """The scale of residuals: the largest stress [kPa] by a unit strain of one unknown, or the largest multiplier."""
    n_u = system.n_u
    stiffness = jnp.abs(jnp.diagonal(K) * scale.unit**2 / scale.volume)[:n_u]
    return jnp.max(jnp.concatenate([stiffness, jnp.abs(z[n_u:])])) + jnp.finfo(z.dtype).tiny


def stress_residual(system: System, scale: Scales, r: Array) -> Array:
    """The largest force imbalance as a stress [kPa]: |r_i| · unit_i / volume_i."""
    return jnp.max(jnp.abs(r * scale.unit / scale.volume)[: system.n_u], initial=0.0)


def constraint_residual(system: System, scale: Scales, r: Array) -> Array:
    """The largest patch mean of ½ |I3 − 1| and ½ |h| [–]."""
    return jnp.max(jnp.abs(r / scale.volume)[system.n_u :])


class Factors(NamedTuple):
    """LU factors of K + μ·metric."""

    lu: Array
    pivots: Array

    def solve(self, b: Array) -> Array:
        """The solution x of (K + μ·metric) x = b."""
        return jsl.lu_solve((self.lu, self.pivots), b)

    @property
    def sign(self) -> Array:
        """The sign of the determinant, ±1: it flips where an odd number of modes gain or lose stability."""
        swaps = jnp.sum(self.pivots != jnp.arange(len(self.pivots), dtype=self.pivots.dtype))
        return jnp.prod(jnp.sign(jnp.diagonal(self.lu))) * jnp.where(swaps % 2 == 0, 1.0, -1.0)


def factorise(scale: Scales, K: Array, mu: Array) -> Factors:
    """Factors of K + μ·metric; μ [kPa] stiffens every strain alike, where the tangent itself has no stiffness."""
    return Factors(*jsl.lu_factor(K + mu * scale.metric))


def inertia(system: System, scale: Scales, K: Array, z: Array) -> tuple[Array, Array]:
    """(negative eigenvalues of the second variation on the constraint manifold, zero eigenvalues of the saddle matrix).

    The saddle matrix [[A, Bᵀ], [B, 0]] with m independent constraints has m negative eigenvalues more than A has on the
    kernel of B. It is scaled by a congruence, which leaves the signs. With follower loads, its symmetric part is taken.

    This is the inertia of the discrete body, which holds det F = 1 in the mean of each element only. Deformations that
    vary inside an element feel −½ p (I3 − 1) as it stands, and may count as unstable where the continuous body is
    stable: ½ μ (I1 − 3) at rest does, ½ μ (I1 − 3 − ln I3), the same body with another pressure, does not.
    """
    n_u = system.n_u
    if not n_u:
        return jnp.array(0), jnp.array(system.size)
    G = modulus(system, scale, K, z)
    s = jnp.where(jnp.arange(system.size) < n_u, scale.unit / jnp.sqrt(scale.volume), G / jnp.sqrt(scale.volume))
    scaled = s[:, None] * (0.5 / G * (K + K.T)) * s[None, :]
    eigenvalues = jnp.linalg.eigvalsh(scaled)
    zero = jnp.abs(eigenvalues) <= 1e-12 * system.size
    negative = jnp.sum(~zero & (eigenvalues < 0.0)) - (system.size - n_u)
    return negative, jnp.sum(zero)
