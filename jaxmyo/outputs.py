"""Fields of a state, from its displacements and multipliers: stresses, stretches, nodal forces."""

import jax
import jax.numpy as jnp
from jax import Array

from jaxmyo import lagrangian
from jaxmyo.lagrangian import Inputs, System


def second_piola_kirchhoff(system: System, F: Array, multipliers: Array, inputs: Inputs) -> Array:
    """S = 2 ∂W/∂C (n_elements, n_points, 3, 3) [kPa], with the pressure and the pseudo-active part.

    F: (n_elements, n_points, 3, 3); multipliers: (n_elements, 1 or 2), p and q.
    """

    def point(F: Array, frame: Array, T_f: Array, T_cf: Array, multipliers: Array) -> Array:
        c = lagrangian.strain(jnp.concatenate([F.reshape(9), multipliers]))
        by_c = jax.jacfwd(lambda c: lagrangian.density(system, c, frame, T_f, T_cf, inputs))(c)
        # A component off the diagonal of C stands twice in W, so its derivative is 2 ∂W/∂C12 already.
        return lagrangian.symmetric(by_c[:6] * jnp.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0]))

    points = jax.vmap(point, in_axes=(0, 0, 0, 0, None))
    return jax.vmap(points)(F, system.frame, inputs.T_f, inputs.T_cf, multipliers)


def cauchy(F: Array, S: Array) -> Array:
    """σ = F S Fᵀ / det F (..., 3, 3) [kPa], Cartesian components."""
    return F @ S @ jnp.swapaxes(F, -1, -2) / jnp.linalg.det(F)[..., None, None]


def deformed_frame(F: Array, frame: Array) -> Array:
    """Rows: the deformed fibre F f / |F f|, the part of F f⊥ normal to it, and their cross product (..., 3, 3)."""
    f = jnp.einsum("...ij,...j->...i", F, frame[..., 0, :])
    f = f / jnp.linalg.norm(f, axis=-1, keepdims=True)
    n = jnp.cross(f, jnp.einsum("...ij,...j->...i", F, frame[..., 1, :]))
    n = n / jnp.linalg.norm(n, axis=-1, keepdims=True)
    return jnp.stack([f, jnp.cross(n, f), n], axis=-2)


def nodal_forces(system: System, F: Array, S: Array, u: Array, inputs: Inputs) -> Array:
    """Forces (n_nodes, 3) [mN] that supports exert on the nodes: internal forces less the tractions."""
    per_element = jnp.einsum("eg,egij,egaj->eai", system.weight, F @ S, system.dN)
    forces = jnp.zeros(system.points.shape).at[system.cells].add(per_element)
    if len(system.quads):
        forces = forces.at[system.quads].add(-lagrangian.traction_forces(system, u, inputs))
    return forces
