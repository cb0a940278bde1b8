"""Fields of a state, from its displacements and multipliers: stresses, stretches, nodal forces."""

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from jaxmyo import lagrangian, surface
from jaxmyo.coordinates import CARTESIAN
from jaxmyo.energies import Kind, weave
from jaxmyo.invariants import I4, I6
from jaxmyo.system import Inputs, System


@jax.jit
def second_piola_kirchhoff(system: System, F: Array, multipliers: Array, inputs: Inputs) -> Array:
    """S = 2 ∂W/∂C (n_elements, n_points, 3, 3) [kPa], with the pressure and the pseudo-active part.

    F: (n_elements, n_points, 3, 3); multipliers: (n_elements, 1 or 2), p and q.
    """

    def point(F: Array, frame: Array, T_f: Array, T_cf: Array, multipliers: Array, material: Array) -> Array:
        c = lagrangian.strain(CARTESIAN, jnp.concatenate([F.reshape(9), multipliers]))
        by_c = jax.jacfwd(lambda c: lagrangian.density(system, c, frame, T_f, T_cf, material, inputs))(c)
        # A component off the diagonal of C stands twice in W, so its derivative is 2 ∂W/∂C12 already.
        return lagrangian.symmetric(by_c[:6] * jnp.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0]))

    points = jax.vmap(point, in_axes=(0, 0, 0, 0, None, None))
    return jax.vmap(points)(F, system.frame, inputs.T_f, inputs.T_cf, multipliers, system.material)


@jax.jit
def stored_energy(system: System, F: Array, inputs: Inputs) -> Array:
    """∫ W dV [µJ], W the law of each element's material at the activation of the state; F as above."""

    def point(F: Array, frame: Array, material: Array) -> Array:
        def law(kind: Kind, constants: Any, C: Array) -> Array:
            return kind.law(C, frame, inputs.beta if kind.active else jnp.zeros_like(inputs.beta), constants)

        return lagrangian.of_material(system, material, inputs, law, F.T @ F, jnp.eye(3))

    W = jax.vmap(jax.vmap(point, in_axes=(0, 0, None)))(F, system.frame, system.material)
    return jnp.sum(system.weight * W)


def cauchy(F: Array, S: Array) -> Array:
    """σ = F S Fᵀ / det F (..., 3, 3) [kPa], along the local unit vectors."""
    return F @ S @ jnp.swapaxes(F, -1, -2) / jnp.linalg.det(F)[..., None, None]


def deformed_frame(F: Array, frame: Array) -> Array:
    """Rows: the deformed fibre F f / |F f|, the part of F f⊥ normal to it, and their cross product (..., 3, 3)."""
    f = jnp.einsum("...ij,...j->...i", F, frame[..., 0, :])
    f = f / jnp.linalg.norm(f, axis=-1, keepdims=True)
    n = jnp.cross(f, jnp.einsum("...ij,...j->...i", F, frame[..., 1, :]))
    n = n / jnp.linalg.norm(n, axis=-1, keepdims=True)
    return jnp.stack([f, jnp.cross(n, f), n], axis=-2)


def green_lagrange(F: Array, frame: Array) -> Array:
    """E = ½ (FᵀF − 1) (..., 3, 3) [–] along the rows of the frame of P: fibre, cross-fibre, normal."""
    along = F @ jnp.swapaxes(frame, -1, -2)
    return 0.5 * (jnp.swapaxes(along, -1, -2) @ along - jnp.eye(3)[(None,) * (F.ndim - 2)])


@jax.jit
def tensions(system: System, u: Array, q: Array, inputs: Inputs) -> tuple[Array, Array]:
    """Pseudo-active tensions (T_A^f, T_A^cf) = (−q h4 I4, −q h6 I6), each (n_elements, n_points) [kPa] (Eq. (T)).

    u: (n_nodes, 3); q: (n_q,) [kPa].
    """

    def point(F: Array, frame: Array, q: Array) -> tuple[Array, Array]:
        C = F.T @ F
        i4, i6 = I4(C, frame), I6(C, frame)
        by_4, by_6 = jax.grad(weave, argnums=(0, 1))(i4, i6, q, inputs.a_over_D, inputs.softness)
        return 2.0 * by_4 * i4, 2.0 * by_6 * i6

    F = lagrangian.deformation_gradients(system, u)
    of_element = q[system.local_multipliers[:, 1] - system.n_u - system.n_p]
    return jax.vmap(jax.vmap(point, in_axes=(0, 0, None)))(F, system.frame, of_element)


@jax.jit
def nodal_forces(system: System, u: Array, S: Array, pressures: Array, inputs: Inputs) -> Array:
    """Forces (n_nodes, 3) that supports exert on the nodes, internal forces less the loads.

    They are conjugate to the world coordinates: mN for a length, a moment [mN·mm] for an angle.
    """
    F, pull = jax.vjp(lambda u: lagrangian.deformation_gradients(system, u), u)
    (internal,) = pull(system.weight[..., None, None] * (F @ S))
    theta = system.points + u
    loads = lagrangian.loads(system, pressures, inputs)
    return internal - surface.nodal_forces(system.coordinates, loads, theta, system.points)
