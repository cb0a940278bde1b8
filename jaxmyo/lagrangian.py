"""From the energy to one element's residual and tangent, through C, by automatic differentiation.

    local unknowns ─► ∂θ/∂Θ, θ ─► F ─► C = FᵀF ─► density(C, p, q) ─► ∂, ∂² in (C, p, q) ─► residual, tangent

The Lagrangian of a body is the sum over elements and Gauss points of weight × density. It is differentiated where it
is small: twice in the six components of C and the multipliers, then carried to the unknowns by the chain rule.
F = diag(g(θ)) · H with H = ∂θ/∂Θ · diag(1/g(Θ)), see `jaxmyo.coordinates`; in Cartesian coordinates H is F.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxmyo import energies, surface, tracing
from jaxmyo.coordinates import Coordinates
from jaxmyo.energies import Kind
from jaxmyo.invariants import I4, I6
from jaxmyo.system import Inputs, System


def density(system: System, c: Array, frame: Array, T_f: Array, T_cf: Array, material: Array, inputs: Inputs) -> Array:
    """The Lagrangian density [kPa] at one point; c = (C11, C22, C33, C12, C13, C23, p[, q]).

    State A has the weave with its multiplier q; state C has the tensions that it left.
    """
    rest = jnp.concatenate([jnp.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]), c[6:]])

    def of_kind(kind: Kind, constants: Any, c: Array) -> Array:
        return _of_kind(system, kind, c, frame, T_f, T_cf, constants, inputs)

    return of_material(system, material, inputs, of_kind, c, rest)


def of_material(
    system: System,
    material: Array,
    inputs: Inputs,
    of_kind: Callable[[Kind, Any, Array], Array],
    deformation: Array,
    rest: Array,
) -> Array:
    """A scalar (kind, constants, deformation) ↦ … of the kind that a point's material is.

    The other kinds are asked at rest: where they do not hold they may overflow, and 0 · ∞ come back in a derivative.
    """
    if len(system.kinds) == 1:
        return of_kind(system.kinds[0], inputs.constants[0], deformation)
    found = jnp.zeros(())
    for k, (kind, constants) in enumerate(zip(system.kinds, inputs.constants, strict=True)):
        here = material == k
        found = jnp.where(here, of_kind(kind, constants, jnp.where(here, deformation, rest)), found)
    return found


def _of_kind(
    system: System, kind: Kind, c: Array, frame: Array, T_f: Array, T_cf: Array, constants: Any, inputs: Inputs
) -> Array:
    C = symmetric(c)
    beta = inputs.beta if kind.active else jnp.zeros_like(inputs.beta)
    W = (
        kind.law(C, frame, beta, constants)
        + energies.beating(C, frame, beta * inputs.T0)
        + energies.incompressibility(C, c[6])
    )
    if not system.weave:
        return W + energies.frozen_tensions(C, frame, T_f, T_cf)
    if not kind.weave:
        return W - 0.5 * c[7] ** 2  # q = 0 [kPa]
    return W + energies.weave(I4(C, frame), I6(C, frame), c[7], inputs.a_over_D, inputs.softness)


def symmetric(c: Array) -> Array:
    """The symmetric (3, 3) tensor of the components 11, 22, 33, 12, 13, 23."""
    return jnp.stack([c[0], c[3], c[4], c[3], c[1], c[5], c[4], c[5], c[2]]).reshape(3, 3)


def strain(coordinates: Coordinates, y: Array) -> Array:
    """(H (9)[, θ (3)], multipliers) ↦ (C (6), multipliers) with C = FᵀF, F = diag(g(θ)) · H."""
    F, rest = y[:9].reshape(3, 3), y[9:]
    if coordinates.curved:
        F, rest = coordinates.g(y[9:12])[:, None] * F, y[12:]
    C = F.T @ F
    return jnp.concatenate([jnp.stack([C[0, 0], C[1, 1], C[2, 2], C[0, 1], C[0, 2], C[1, 2]]), rest])


def variables(c: Coordinates, nodes: Array, dN: Array, N: Array, theta: Array, inverse_g: Array) -> Array:
    """H (9), and in curved coordinates θ (3), at one point of an element with nodal displacements (8, 3)."""
    H = (nodes.T @ dN + jnp.diag(inverse_g)).reshape(9)
    return jnp.concatenate([H, theta + N @ nodes]) if c.curved else H


def kinematics(system: System, u: Array) -> Array:
    """H (9), and in curved coordinates θ (3), at the Gauss points: (n_elements, n_points, 9 or 12); u: (n_nodes, 3)."""
    nodes = u[system.cells]
    H = jnp.einsum("eai,egaj->egij", nodes, system.dN) + system.inverse_g[..., None, :] * jnp.eye(3)[None, None]
    H = H.reshape(*H.shape[:2], 9)
    if not system.coordinates.curved:
        return H
    return jnp.concatenate([H, system.theta + jnp.einsum("ga,eai->egi", system.N, nodes)], axis=-1)


def deformation_gradients(system: System, u: Array) -> Array:
    """F (n_elements, n_points, 3, 3) of the displacements u (n_nodes, 3), from the local basis of P to that at θ."""
    y = kinematics(system, u)
    F = y[..., :9].reshape(*y.shape[:2], 3, 3)
    if system.coordinates.curved:
        F = jax.vmap(jax.vmap(system.coordinates.g))(y[..., 9:])[..., None] * F
    return F


@jax.jit
def is_folded(system: System, u: Array) -> Array:
    """Whether a node left the range of its coordinates, such as for a negative radius, though no Gauss point did.

    A hole has closed there, and the body would go through itself. Nodes that begin at the end of the range, on the axis
    of a solid cylinder, are not looked at.
    """
    if not system.coordinates.curved:
        return jnp.array(False)
    inside = jax.vmap(system.coordinates.inside)
    return jnp.any(inside(system.points) & ~inside(system.points + u))


def square_of_strain(system: System, dz: Array) -> Array:
    """|∂F|² (n_elements, n_points) [–] at rest for a change dz of the unknowns."""
    if system.gradient is not None:
        return jnp.sum(jnp.einsum("egia,ea->egi", system.gradient, dz[system.local_u]) ** 2, axis=-1)
    du = (system.tie_scale * dz[system.tie_index]).reshape(-1, 3)
    if not system.coordinates.curved:  # component by component: four times as fast as a product of small matrices
        nodes, dN, axes = du[system.cells][:, None], system.dN, range(3)
        components: Any = [sum(nodes[..., a, i] * dN[..., a, j] for a in range(8)) for i in axes for j in axes]
        return sum(component**2 for component in components)
    _, dF = jax.jvp(lambda u: deformation_gradients(system, u), (jnp.zeros_like(du),), (du,))
    return jnp.sum(dF**2, axis=(-2, -1))


def element_forces(
    system: System,
    nodes: Array,
    dN: Array,
    weight: Array,
    frame: Array,
    theta: Array,
    inverse_g: Array,
    material: Array,
    multipliers: Array,
    T_f: Array,
    T_cf: Array,
    inputs: Inputs,
) -> tuple[Array, Array]:
    """The first derivatives of an element's Lagrangian by its nodal displacements (8, 3) and its multipliers."""
    c = system.coordinates

    def lagrangian(nodes: Array, multipliers: Array) -> Array:
        def point(dN: Array, N: Array, frame: Array, theta: Array, g: Array, *T: Any) -> Array:
            y = variables(c, nodes, dN, N, theta, g)
            place: Any = (frame, *T, material, inputs)
            return density(system, strain(c, jnp.concatenate([y, multipliers])), *place)

        return weight @ jax.vmap(point)(dN, system.N, frame, theta, inverse_g, T_f, T_cf)

    # In reverse mode, so that its own derivatives by inputs, nodes and fibres cost little, to run and to compile.
    return jax.grad(lagrangian, argnums=(0, 1))(nodes, multipliers)


def residual(system: System, z: Array, inputs: Inputs) -> Array:
    """The derivative of the Lagrangian by the unknowns (n,), less the loads: generalised forces [mN, mN·mm]."""
    s, u = system, system.displacements(z, inputs)

    def element(at: Any) -> tuple[Array, Array]:
        of_element: Any = (*at, inputs)
        return element_forces(system, *of_element)

    geometry = (s.dN, s.weight, s.frame, s.theta, s.inverse_g, s.material)
    every = (u[s.cells], *geometry, z[s.local_multipliers], inputs.T_f, inputs.T_cf)
    if system.is_small:
        forces, by_m = jax.vmap(element)(every)
    else:  # what a derivative needs of each block is computed anew, not kept
        forces, by_m = jax.lax.map(jax.checkpoint(element), every, batch_size=256)
    dofs = (3 * s.cells[:, :, None] + np.arange(3)[None, None]).reshape(-1, 24)
    r = (-inputs.imbalance).at[s.tie_index[dofs]].add(s.tie_scale[dofs] * forces.reshape(-1, 24))
    r = r.at[s.local_multipliers].add(by_m)
    return add_loads(system, z, inputs, r, None)[0]


def enclosed(system: System, u: Any) -> Array:
    """The volumes (n_cavities,) [mm³] of the cavities at displacements u (n_nodes, 3)."""
    each = [surface.enclosed(system.coordinates, wall, system.points + u) for wall in system.cavities]
    return jnp.stack(each) if each else tracing.zeros(0)


def loads(system: System, pressures: Any, inputs: Inputs) -> list[surface.Loads]:
    """The loads, the pressures (n_cavities,) in the cavities among them."""
    return surface.every(system.surfaces, inputs.loads, system.cavities, pressures)


def add_loads(system: System, z: Array, inputs: Inputs, r: Array, K: Array | None) -> tuple[Array, Any]:
    """Less the loads: the residual, and the dense tangent if it is asked for."""
    if not system.n_u:
        return r, K
    u, pressures = system.displacements(z, inputs), system.pressures(z)
    c, theta = system.coordinates, system.points + u
    for kind, nodes, values in loads(system, pressures, inputs):
        at = (c, kind, theta[nodes], system.points[nodes], values)
        dofs = (3 * nodes[:, :, None] + jnp.arange(3)[None, None]).reshape(len(nodes), -1)
        index, scale = system.tie_index[dofs], system.tie_scale[dofs]
        r = r.at[index].add(-scale * surface.forces(*at).reshape(scale.shape))
        if K is not None:
            K_e = surface.tangents(*at)
            K = K.at[index[:, :, None], index[:, None, :]].add(-scale[:, :, None] * K_e * scale[:, None, :])
    for k, wall in enumerate(system.cavities):
        row = system.size - len(system.cavities) + k
        r = r.at[row].add(inputs.volumes[k] - surface.enclosed(c, wall, theta))
        if K is not None:
            dofs = (3 * wall[:, :, None] + jnp.arange(3)[None, None]).reshape(len(wall), -1)
            one = surface.forces(c, "closed", theta[wall], system.points[wall], jnp.ones(len(wall)))
            by_u = -system.tie_scale[dofs] * one.reshape(dofs.shape)
            K = K.at[row, system.tie_index[dofs]].add(by_u).at[system.tie_index[dofs], row].add(by_u)
    return r, K
