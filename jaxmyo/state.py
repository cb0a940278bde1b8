"""A state of a body: the fields of an equilibrium, what it belongs to, and how it was found."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxmyo import checks, outputs
from jaxmyo.energies import weave
from jaxmyo.invariants import I4, I6
from jaxmyo.lagrangian import Inputs, System
from jaxmyo.scene import Scene
from jaxmyo.status import Status, explain

#: The fields at the quadrature points that `State.mean` averages.
FIELDS = ["F", "C", "stretches", "second_piola_kirchhoff", "cauchy", "cauchy_fibre", "T_f", "T_cf"]


def _per_state(function: Callable[..., Any]) -> Callable[..., Any]:
    """Apply a function of one state to every state of a batch (the leading axes that `vmap` gave it)."""

    @wraps(function)
    def apply(self: "State", *arguments: Any) -> Any:
        def mapped(state: "State") -> Any:
            return function(state, *arguments)

        for _ in range(jnp.ndim(self.status)):
            mapped = jax.vmap(mapped)
        return mapped(self)

    return apply


@jax.tree_util.register_dataclass
@dataclass(frozen=True, repr=False)
class State:
    """An equilibrium: the fields, what they belong to, and how they were found. A pytree; every array may be batched.

    scene: the `Scene`; system: the discrete problem; inputs: constants, T0, a/D, β, tensions, loads of this state;
    u: (n_nodes, 3) displacements [mm]; p: (n_elements,) pressure [kPa]; q: (n_elements,) weave multiplier [kPa], None
    without the weave; status: see `Status`; reached: the fraction of the load at which the fields stand (1 if
    converged); residual: relative; force_residual [mN]; constraint_residual [–]; history: relative residuals of the
    last Newton loop, 0 beyond its end; steps, rejected, iterations: counts; negative_eigenvalues: of the second
    variation on the constraint manifold, 0 for a stable state; zero_eigenvalues: of the saddle matrix, > 0 where a mode
    has no stiffness; both −1 where an invalid input kept the solve from starting.
    """

    scene: Scene = field(metadata={"static": True})
    system: System
    inputs: Inputs
    u: Array
    p: Array
    q: Array | None
    status: Array
    reached: Array
    residual: Array
    force_residual: Array
    constraint_residual: Array
    history: Array
    steps: Array
    rejected: Array
    iterations: Array
    negative_eigenvalues: Array
    zero_eigenvalues: Array

    @property
    def converged(self) -> Array:
        """Whether the whole load was reached and the residual is below the tolerance."""
        return self.status == Status.CONVERGED

    @property
    def message(self) -> str:
        """What happened, where, and what to try (of one state: `states[i].message` in a batch)."""
        return explain(self.status, self.reached, self.residual)

    @property
    @_per_state
    def F(self) -> Array:
        """Deformation gradient (n_elements, n_points, 3, 3) [–]."""
        nodes = self.u[self.system.cells]
        return jnp.eye(3)[None, None] + jnp.einsum("eai,egaj->egij", nodes, self.system.dN)

    @property
    @_per_state
    def C(self) -> Array:
        """Right Cauchy–Green tensor FᵀF (n_elements, n_points, 3, 3) [–]."""
        return jnp.swapaxes(self.F, -1, -2) @ self.F

    @property
    @_per_state
    def stretches(self) -> Array:
        """λf, λcf, λn (n_elements, n_points, 3) [–]: stretches along fibre, cross-fibre and normal."""
        return jnp.sqrt(jnp.einsum("egki,egij,egkj->egk", self.system.frame, self.C, self.system.frame))

    @property
    @_per_state
    def second_piola_kirchhoff(self) -> Array:
        """S = 2 ∂W/∂C (n_elements, n_points, 3, 3) [kPa], Cartesian components in the state P."""
        multipliers = jnp.stack([self.p] if self.q is None else [self.p, self.q], axis=-1)
        return outputs.second_piola_kirchhoff(self.system, self.F, multipliers, self.inputs)

    @property
    @_per_state
    def cauchy(self) -> Array:
        """Cauchy stress (n_elements, n_points, 3, 3) [kPa], Cartesian components."""
        return outputs.cauchy(self.F, self.second_piola_kirchhoff)

    @property
    @_per_state
    def cauchy_fibre(self) -> Array:
        """Cauchy stress (n_elements, n_points, 3, 3) [kPa] in deformed fibre axes: fibre, cross-fibre, normal."""
        R = outputs.deformed_frame(self.F, self.system.frame)
        return R @ self.cauchy @ jnp.swapaxes(R, -1, -2)

    @property
    def T_f(self) -> Array:
        """Pseudo-active fibre tension T_A^f = −q h4 I4 (n_elements, n_points) [kPa] (paper, Eq. (T))."""
        return self._tensions[0]

    @property
    def T_cf(self) -> Array:
        """Pseudo-active cross-fibre tension T_A^cf = −q h6 I6 (n_elements, n_points) [kPa]."""
        return self._tensions[1]

    @property
    @_per_state
    def _tensions(self) -> tuple[Array, Array]:
        if self.q is None:
            return self.inputs.T_f, self.inputs.T_cf

        def point(C: Array, frame: Array, q: Array) -> tuple[Array, Array]:
            i4, i6 = I4(C, frame), I6(C, frame)
            by_4, by_6 = jax.grad(weave, argnums=(0, 1))(i4, i6, q, self.inputs.a_over_D)
            return 2.0 * by_4 * i4, 2.0 * by_6 * i6

        return jax.vmap(jax.vmap(point, in_axes=(0, 0, None)))(self.C, self.system.frame, self.q)

    @property
    @_per_state
    def reactions(self) -> Array:
        """Forces (n_nodes, 3) [mN] of the supports on the body; round-off at nodes that are free."""
        return outputs.nodal_forces(self.system, self.F, self.second_piola_kirchhoff, self.u, self.inputs)

    @_per_state
    def reaction(self, face: str) -> Array:
        """Resultant (3,) [mN] of the supports' forces on the nodes of a named face."""
        return jnp.sum(self.reactions[np.unique(self.scene.mesh.face(face))], axis=0)

    def mean(self, name: str) -> Array:
        """Volume mean of a field at the quadrature points by its name, e.g. mean("cauchy"): (3, 3) [kPa]."""
        return self._mean(checks.choice("name", name, FIELDS))

    @_per_state
    def _mean(self, name: str) -> Array:
        return jnp.tensordot(self.system.weight, getattr(self, name), axes=2) / jnp.sum(self.system.weight)

    def __getitem__(self, i: Any) -> "State":
        """One state, or some, of a batch that `vmap` made."""
        if not jnp.ndim(self.status):
            raise TypeError("this is one state, not a batch of states")
        return jax.tree.map(lambda leaf: leaf[i], self)

    def __repr__(self) -> str:
        kind = "A, free contraction" if self.system.weave else "A without weave, or C"
        n_e = len(self.scene.mesh.cells)
        if isinstance(self.status, jax.core.Tracer):
            return f"State ({kind}) of {n_e} element(s), traced"
        if jnp.ndim(self.status):
            names, counts = np.unique(np.asarray(self.status), return_counts=True)
            how = ", ".join(f"{n} {Status(int(s)).name}" for s, n in zip(names, counts, strict=True))
            return f"{np.size(self.status)} states ({kind}) of {n_e} element(s): {how}"
        stretches = ", ".join(f"{float(x):.5f}" for x in self.mean("stretches"))
        return (
            f"State ({kind}) of {n_e} element(s): {self.message}\n"
            f"  beta = {float(self.inputs.beta):g}, T0 = {float(self.inputs.T0):g} kPa; mean stretches {stretches} "
            f"(fibre, cross-fibre, normal)\n"
            f"  {int(self.steps)} steps, {int(self.iterations)} iterations; negative eigenvalues: "
            f"{int(self.negative_eigenvalues)}, zero: {int(self.zero_eigenvalues)}"
        )
