"""From the energy to one element's residual and tangent, through C, by automatic differentiation.

    local unknowns ─► F = F0 + A·unknowns ─► C = FᵀF ─► density(C, p, q) ─► ∂, ∂² in (C, p, q) ─► residual, tangent

The Lagrangian of a body is the sum over elements and Gauss points of weight × density. It is differentiated where it
is small: twice in the six components of C and the multipliers, then carried to the unknowns by the chain rule.
"""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxmyo import energies
from jaxmyo.energies import Law
from jaxmyo.hexahedron import gauss, shape, shape_gradient
from jaxmyo.invariants import I4, I6
from jaxmyo.scene import Scene
from jaxmyo.ties import Ties


class Inputs(NamedTuple):
    """What a path of states is driven by. Every leaf may change along the path and may be differentiated.

    constants: the law's; T0 [kPa]; a_over_D [–]; beta [–]; T_f, T_cf: (n_elements, n_points) tensions left by state A
    [kPa]; offset: (n_dof,) prescribed displacements [mm]; nominal, cauchy: (n_loaded_quads, 3) tractions [kPa].
    """

    constants: Any
    T0: Array
    a_over_D: Array
    beta: Array
    T_f: Array
    T_cf: Array
    offset: Array
    nominal: Array
    cauchy: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class System:
    """The discrete problem of one state: geometry and bookkeeping, no material parameter and no load.

    The unknown vector is z = [displacements (n_u), p (n_elements), q (n_elements, only with the weave)].

    gradient: (n_elements, n_points, 9, n_local) ∂F/∂(local displacements); weight: (n_elements, n_points) [mm³];
    frame: (n_elements, n_points, 3, 3); local: (n_elements, n_local + multipliers) positions in z;
    dN: (n_elements, n_points, 8, 3) [1/mm]; cells: (n_elements, 8); tie_index, tie_scale: (n_dof,);
    quads: (n_quads, 4) loaded faces; points: (n_nodes, 3) [mm].
    """

    law: Law = field(metadata={"static": True})
    weave: bool = field(metadata={"static": True})
    n_u: int = field(metadata={"static": True})
    gradient: Array
    weight: Array
    frame: Array
    local: Array
    dN: Array
    cells: Array
    tie_index: Array
    tie_scale: Array
    quads: Array
    points: Array

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.n_u + len(self.cells) * self.multipliers

    @property
    def multipliers(self) -> int:
        """Multipliers per element: p, and q where the weave acts."""
        return 2 if self.weave else 1

    @property
    def local_u(self) -> Array:
        """(n_elements, n_local) positions in z of the displacements that each element feels."""
        return self.local[:, : self.local.shape[1] - self.multipliers]

    def displacements(self, z: Array, inputs: Inputs) -> Array:
        """Nodal displacements (n_nodes, 3) [mm] of the unknowns z."""
        if not self.n_u:
            return inputs.offset.reshape(-1, 3)
        return (inputs.offset + self.tie_scale * z[self.tie_index]).reshape(-1, 3)


def build(scene: Scene, ties: Ties, *, weave: bool, quads: np.ndarray | None = None) -> System:
    """The discrete problem of a scene under its ties; `quads` (n, 4) are the faces that carry tractions."""
    mesh = scene.mesh
    n_e = len(mesh.cells)
    xi, w = gauss(scene.quadrature)
    dxi = shape_gradient(xi)
    jacobian = np.einsum("eai,gaj->egij", mesh.points[mesh.cells], dxi)
    dN = np.einsum("gaj,egji->egai", dxi, np.linalg.inv(jacobian))
    # The distinct unknowns of each element, padded to the longest list with columns of zeros.
    dofs = (3 * mesh.cells[:, :, None] + np.arange(3)).reshape(n_e, 24)
    active = ties.scale[dofs] != 0.0
    lists = [np.unique(ties.index[d[a]]) for d, a in zip(dofs, active, strict=True)]
    n_local = max(map(len, lists))
    unknowns = np.zeros((n_e, n_local), dtype=int)
    slots = np.zeros((n_e, 24, n_local))
    for e, own in enumerate(lists):
        unknowns[e, : len(own)] = own
        slots[e, active[e], np.searchsorted(own, ties.index[dofs[e, active[e]]])] = ties.scale[dofs[e, active[e]]]
    # F_ij = Σ_a u_ai ∂N_a/∂X_j + δ_ij
    gradient = np.einsum("egaj,eail->egijl", dN, slots.reshape(n_e, 8, 3, n_local))
    first = ties.size + n_e * np.arange(2 if weave else 1)
    return System(
        law=scene.law,
        weave=weave,
        n_u=ties.size,
        gradient=jnp.asarray(gradient.reshape(n_e, len(w), 9, n_local)),
        weight=jnp.asarray(np.linalg.det(jacobian) * w[None]),
        frame=jnp.asarray(scene.frame),
        local=jnp.asarray(np.concatenate([unknowns, first[None] + np.arange(n_e)[:, None]], axis=1)),
        dN=jnp.asarray(dN),
        cells=jnp.asarray(mesh.cells),
        tie_index=jnp.asarray(ties.index),
        tie_scale=jnp.asarray(ties.scale),
        quads=jnp.asarray(np.zeros((0, 4), dtype=int) if quads is None else quads),
        points=jnp.asarray(mesh.points),
    )


def density(system: System, c: Array, frame: Array, T_f: Array, T_cf: Array, inputs: Inputs) -> Array:
    """The Lagrangian density [kPa] at one point; c = (C11, C22, C33, C12, C13, C23, p[, q]).

    State A has the weave with its multiplier q; state C has the tensions that it left.
    """
    C = symmetric(c)
    W = (
        system.law(C, frame, inputs.beta, inputs.constants)
        + energies.beating(C, frame, inputs.beta * inputs.T0)
        + energies.incompressibility(C, c[6])
    )
    if system.weave:
        return W + energies.weave(I4(C, frame), I6(C, frame), c[7], inputs.a_over_D)
    return W + energies.frozen_tensions(C, frame, T_f, T_cf)


def symmetric(c: Array) -> Array:
    """The symmetric (3, 3) tensor of the components 11, 22, 33, 12, 13, 23."""
    return jnp.stack([c[0], c[3], c[4], c[3], c[1], c[5], c[4], c[5], c[2]]).reshape(3, 3)


def strain(y: Array) -> Array:
    """(F (9), multipliers) ↦ (C (6), multipliers) with C = FᵀF."""
    F = y[:9].reshape(3, 3)
    C = F.T @ F
    return jnp.concatenate([jnp.stack([C[0, 0], C[1, 1], C[2, 2], C[0, 1], C[0, 2], C[1, 2]]), y[9:]])


def deformation_gradients(system: System, z: Array, inputs: Inputs) -> Array:
    """F (n_elements, n_points, 3, 3) of the unknowns z."""
    u = system.displacements(z, inputs)[system.cells]
    return jnp.eye(3)[None, None] + jnp.einsum("eai,egaj->egij", u, system.dN)


def residual(system: System, z: Array, inputs: Inputs) -> Array:
    """The derivative of the Lagrangian by the unknowns (n,), less the tractions: force [mN] per displacement."""
    return _assemble(system, z, inputs, tangent=False)[0]


def residual_and_tangent(system: System, z: Array, inputs: Inputs) -> tuple[Array, Array]:
    """The residual (n,) and its derivative (n, n), dense."""
    return _assemble(system, z, inputs, tangent=True)


def _assemble(system: System, z: Array, inputs: Inputs, *, tangent: bool) -> tuple[Array, Array]:
    F = deformation_gradients(system, z, inputs)
    n_m = system.multipliers
    n_local = system.local_u.shape[1]

    def element(gradient: Array, weight: Array, multipliers: Array, *at_points: Array) -> tuple[Array, Array]:
        # The columns of a point's variables (F, multipliers) by the element's unknowns.
        B = jnp.zeros((*gradient.shape[:1], 9 + n_m, n_local + n_m)).at[:, :9, :n_local].set(gradient)
        B = B.at[:, 9:, n_local:].set(jnp.eye(n_m)[None])

        def point(B: Array, F: Array, frame: Array, T_f: Array, T_cf: Array) -> tuple[Array, Array]:
            y = jnp.concatenate([F.reshape(9), multipliers])

            def of_c(c: Array) -> Array:
                return density(system, c, frame, T_f, T_cf, inputs)

            # Forward mode throughout: for so few variables it compiles and runs several times faster than reverse mode.
            if n_local + n_m <= 6:  # fewer than C has components: differentiate in the element's unknowns themselves
                r = jax.jacfwd(lambda v: of_c(strain(y + B @ v)))
                v = jnp.zeros(n_local + n_m)
                return r(v), jax.jacfwd(r)(v) if tangent else jnp.zeros((0, 0))
            c = strain(y)
            by_c, J = jax.jacfwd(of_c)(c), jax.jacfwd(strain)(y)
            r = by_c @ J @ B
            if not tangent:
                return r, jnp.zeros((0, 0))
            curvature = jax.jacfwd(jax.jacfwd(lambda y: by_c @ strain(y)))(y)
            return r, B.T @ (J.T @ jax.jacfwd(jax.jacfwd(of_c))(c) @ J + curvature) @ B

        r, K = jax.vmap(point)(B, *at_points)
        return weight @ r, jnp.tensordot(weight, K, axes=1)

    r_e, K_e = jax.vmap(element)(
        system.gradient,
        system.weight,
        z[system.local[:, n_local:]],
        F,
        system.frame,
        inputs.T_f,
        inputs.T_cf,
    )
    r = jnp.zeros(system.size).at[system.local].add(r_e)
    K = jnp.zeros((system.size, system.size) if tangent else (0, 0))
    if tangent:
        K = K.at[system.local[:, :, None], system.local[:, None, :]].add(K_e)
    if len(system.quads) and system.n_u:
        r, K = _add_tractions(system, z, inputs, r, K, tangent=tangent)
    return r, K


def _add_tractions(
    system: System, z: Array, inputs: Inputs, r: Array, K: Array, *, tangent: bool
) -> tuple[Array, Array]:
    force = traction_forces(system, system.displacements(z, inputs), inputs)
    dofs = 3 * system.quads[:, :, None] + jnp.arange(3)[None, None]
    dofs = dofs.reshape(len(system.quads), 12)
    index, scale = system.tie_index[dofs], system.tie_scale[dofs]
    r = r.at[index].add(-scale * force.reshape(-1, 12))
    if tangent:
        by_x = jax.vmap(jax.jacfwd(_quad_force))(
            (system.points + system.displacements(z, inputs))[system.quads],
            system.points[system.quads],
            inputs.nominal,
            inputs.cauchy,
        ).reshape(-1, 12, 12)
        K = K.at[index[:, :, None], index[:, None, :]].add(-scale[:, :, None] * by_x * scale[:, None, :])
    return r, K


def traction_forces(system: System, u: Array, inputs: Inputs) -> Array:
    """Nodal forces (n_quads, 4, 3) [mN] of the tractions on the loaded quads at the displacements u (n_nodes, 3)."""
    x = (system.points + u)[system.quads]
    return jax.vmap(_quad_force)(x, system.points[system.quads], inputs.nominal, inputs.cauchy)


def _quad_force(x: Array, X: Array, nominal: Array, cauchy: Array) -> Array:
    xi, w = gauss(2, dimension=2)
    N, dN = jnp.asarray(shape(xi)), jnp.asarray(shape_gradient(xi))

    def area(nodes: Array) -> Array:
        tangents = jnp.einsum("gak,ai->gki", dN, nodes)
        return jnp.linalg.norm(jnp.cross(tangents[:, 0], tangents[:, 1]), axis=-1) * jnp.asarray(w)

    return jnp.einsum("ga,g,i->ai", N, area(X), nominal) + jnp.einsum("ga,g,i->ai", N, area(x), cauchy)
