"""Exact solutions without elements: the sample, and a tube whose fibres turn through the wall.

The deformation of both is known but for a few numbers, and what is left of the Lagrangian is a sum over points of the
package's own densities. State A is where its gradient vanishes, state C where it is the work of the load; Newton's
method finds both to round-off from numbers near by. `jaxmyo.paper.exact_tube` does the same for the paper's tube.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxmyo import energies
from jaxmyo.compiler import QUICK
from jaxmyo.hexahedron import gauss
from jaxmyo.invariants import I4, I6
from jaxmyo.paper.exact_tube import Muscle, tissue
from jaxmyo.status import SolveError


def _settle(step: Callable[[Array], Array], near: Any) -> Array:
    """Newton's method until its correction is round-off; near: where it starts. A `SolveError` if it does not."""
    z, size = jnp.asarray(near, dtype=float), np.inf
    for _ in range(50):
        change = step(z)
        before, size = size, float(jnp.max(jnp.abs(change)))
        if not np.isfinite(size) or (size >= before and size < 1e-10):
            break
        z = z + change
    if not size < 1e-10:
        raise SolveError(f"no exact state was found near {np.asarray(near)}", z)
    return z


def _newton_step(imbalance: Callable[[Array], Array], z: Array) -> Array:
    return -jnp.linalg.solve(jax.jacfwd(imbalance)(z), imbalance(z))


def _left(C: Array, frame: Array, q: Array, muscle: Muscle) -> tuple[Array, Array]:
    """T_A^f, T_A^cf [kPa] that a weave with the multiplier q leaves."""
    i4, i6 = I4(C, frame), I6(C, frame)
    by_4, by_6 = jax.grad(energies.weave, argnums=(0, 1))(i4, i6, q, muscle.a_over_D, muscle.softness)
    return 2.0 * by_4 * i4, 2.0 * by_6 * i6


def _in_weave(C: Array, frame: Array, q: Array, muscle: Muscle) -> Array:
    """The Lagrangian density of state A [kPa]."""
    of_weave = energies.weave(I4(C, frame), I6(C, frame), q, muscle.a_over_D, muscle.softness)
    return tissue(C, frame, muscle) + of_weave


class Sample(NamedTuple):
    """A homogeneous sample: stretches (3,) λf, λcf, λn of state A [–]; sigma11 of state C at given stretches [kPa]."""

    stretches: Array
    sigma11: float


def sample(muscle: Muscle, stretch: tuple[float, float], near: tuple[float, float, float]) -> Sample:
    """State A with the weave, and the fibre stress of state C at two stretches, its normal face free of stress.

    near: ln λf, ln λcf and q [kPa] of A, roughly. What of A is left is T_A; σ11 = λf ∂W/∂λf at λn = 1/(λf λcf).
    """
    z = _settle(partial(_sample_step, muscle=_as_floats(muscle)), near)
    sigma = _sample_stress(z, jnp.asarray(stretch), _as_floats(muscle))
    return Sample(jnp.exp(jnp.stack([z[0], z[1], -z[0] - z[1]])), float(sigma))


def _sample_C(log: Array) -> Array:
    return jnp.diag(jnp.exp(2.0 * jnp.stack([log[0], log[1], -log[0] - log[1]])))


@partial(jax.jit, compiler_options=QUICK)
def _sample_step(z: Array, muscle: Muscle) -> Array:
    return _newton_step(jax.grad(lambda z: _in_weave(_sample_C(z[:2]), jnp.eye(3), z[2], muscle)), z)


@partial(jax.jit, compiler_options=QUICK)
def _sample_stress(z: Array, stretch: Array, muscle: Muscle) -> Array:
    left = _left(_sample_C(z[:2]), jnp.eye(3), z[2], muscle)

    def energy(log: Array) -> Array:
        C = _sample_C(log)
        return tissue(C, jnp.eye(3), muscle) + energies.frozen_tensions(C, jnp.eye(3), *left)

    return jax.grad(energy)(jnp.log(stretch))[0]


class Helix(NamedTuple):
    """A tube whose fibres turn linearly through the wall.

    Ri, Ro radii [mm]; inner, outer: the angle of the fibre from e_φ towards e_z at the walls [rad].
    """

    Ri: float
    Ro: float
    inner: float
    outer: float

    def angle(self, R: Any) -> Any:
        """The angle of the fibre at radius R [rad]."""
        return self.inner + (self.outer - self.inner) * (R - self.Ri) / (self.Ro - self.Ri)

    def fibre(self, theta: Any) -> Any:
        """f at coordinates (n, 3), along e_r, e_φ, e_z."""
        a = self.angle(theta[:, 0])
        return np.stack([0.0 * a, np.cos(a), np.sin(a)], axis=1)

    def cross(self, theta: Any) -> Any:
        """f⊥ at coordinates (n, 3), along e_r, e_φ, e_z."""
        a = self.angle(theta[:, 0])
        return np.stack([0.0 * a, -np.sin(a), np.cos(a)], axis=1)


class Twisted(NamedTuple):
    """A deformed tube with planar ends: ri [mm], λz [–], the twist ψ [rad/mm], q of the weave [kPa], 0 in state C."""

    ri: float
    height: float
    twist: float
    q: float = 0.0


POINTS = 48
_XI, _W = gauss(POINTS)


def helix_tube(helix: Helix, muscle: Muscle, pressure: float, near_A: Twisted, near_C: Twisted) -> Twisted:
    """State C under an inner pressure [kPa], open ends free to turn, after a contraction A with one q for the wall.

    r² = ri² + (R² − Ri²)/λz, φ = Φ + ψ Z, z = λz Z: four numbers in state A, three in state C.
    """
    floats, wall = _as_floats(muscle), jnp.asarray(helix)
    z_A = _settle(partial(_helix_step_A, wall=wall, muscle=floats), _logs(helix, near_A))
    load = jnp.asarray(float(pressure))
    step = partial(_helix_step_C, z_A=z_A, wall=wall, muscle=floats, pressure=load)
    z = _settle(step, _logs(helix, near_C)[:3])
    return Twisted(float(helix.Ri * jnp.exp(z[0])), float(jnp.exp(z[1])), float(z[2] / helix.Ro))


def _logs(helix: Helix, tube: Twisted) -> Any:
    return [np.log(tube.ri / helix.Ri), np.log(tube.height), tube.twist * helix.Ro, tube.q]


def _wall(wall: Array) -> tuple[Array, Array, Array]:
    """Radii R (points,) [mm], weights of ∫ … R dR [mm²] and frames (points, 3, 3)."""
    Ri, Ro, inner, outer = wall
    R = 0.5 * (Ri + Ro) + 0.5 * (Ro - Ri) * jnp.asarray(_XI[:, 0])
    a = inner + (outer - inner) * (R - Ri) / (Ro - Ri)
    none, one = jnp.zeros_like(a), jnp.ones_like(a)
    frame = jnp.stack([none, jnp.cos(a), jnp.sin(a), none, -jnp.sin(a), jnp.cos(a), one, none, none], axis=-1)
    return R, 0.5 * (Ro - Ri) * jnp.asarray(_W) * R, frame.reshape(-1, 3, 3)


def _helix_C(z: Array, wall: Array, R: Array) -> Array:
    """C = FᵀF (points, 3, 3) along e_r, e_φ, e_z; its only shear is r ψ."""
    Ri, Ro = wall[0], wall[1]
    r = jnp.sqrt(Ri**2 * jnp.exp(2.0 * z[0]) + (R**2 - Ri**2) * jnp.exp(-z[1]))
    around, axial = r / R, jnp.broadcast_to(jnp.exp(z[1]), R.shape)
    none = jnp.zeros_like(R)
    F = jnp.stack([1.0 / (around * axial), none, none, none, around, r * z[2] / Ro, none, none, axial], axis=-1)
    F = F.reshape(-1, 3, 3)
    return jnp.swapaxes(F, -1, -2) @ F


@partial(jax.jit, compiler_options=QUICK)
def _helix_step_A(z: Array, wall: Array, muscle: Muscle) -> Array:
    R, weights, frame = _wall(wall)

    def lagrangian(z: Array) -> Array:
        return weights @ jax.vmap(lambda C, frame: _in_weave(C, frame, z[3], muscle))(_helix_C(z, wall, R), frame)

    return _newton_step(jax.grad(lagrangian), z)


@partial(jax.jit, compiler_options=QUICK)
def _helix_step_C(z: Array, z_A: Array, wall: Array, muscle: Muscle, pressure: Array) -> Array:
    R, weights, frame = _wall(wall)
    left = jax.vmap(lambda C, frame: _left(C, frame, z_A[3], muscle))(_helix_C(z_A, wall, R), frame)

    def energy(z: Array) -> Array:
        def density(C: Array, frame: Array, T_f: Array, T_cf: Array) -> Array:
            return tissue(C, frame, muscle) + energies.frozen_tensions(C, frame, T_f, T_cf)

        return weights @ jax.vmap(density)(_helix_C(z, wall, R), frame, *left)

    def imbalance(z: Array) -> Array:
        work = pressure * wall[0] ** 2 * jnp.exp(2.0 * z[0] + z[1])  # of the pressure through ri dri, per 2π and height
        return jax.grad(energy)(z) - jnp.stack([work, jnp.zeros(()), jnp.zeros(())])

    return _newton_step(imbalance, z)


def _as_floats(muscle: Muscle) -> Muscle:
    converted: Muscle = jax.tree.map(lambda x: jnp.asarray(float(x)), muscle)
    return converted
