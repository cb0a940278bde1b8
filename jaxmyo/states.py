"""The two solves: `contract` (P → A, free contraction) and `load` (A → C, under what state A left behind)."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxmyo import checks, continuation, lagrangian, outputs
from jaxmyo.conditions import Condition, Stretch, Traction
from jaxmyo.energies import weave
from jaxmyo.invariants import I4, I6
from jaxmyo.lagrangian import Inputs, System
from jaxmyo.newton import Settings
from jaxmyo.scene import Scene
from jaxmyo.status import SolveError, Status, explain
from jaxmyo.ties import Ties

DEFAULT = Settings()


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class State:
    """An equilibrium: the fields, what they belong to, and how they were found. A pytree; every array may be batched.

    scene: the `Scene`; system: the discrete problem; inputs: constants, T0, a/D, β, tensions, loads of this state;
    u: (n_nodes, 3) displacements [mm]; p: (n_elements,) pressure [kPa]; q: (n_elements,) weave multiplier [kPa], None
    without the weave; status: see `Status`; reached: the fraction of the load at which the fields stand (1 if
    converged); residual: relative; force_residual [mN]; constraint_residual [–]; history: relative residuals of the
    last Newton loop, 0 beyond its end; steps, rejected, iterations: counts; negative_eigenvalues: of the second
    variation on the constraint manifold, 0 for a stable state; zero_eigenvalues: of the saddle matrix, > 0 where a mode
    has no stiffness.
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
        """What happened, where, and what to try."""
        return explain(self.status, self.reached, self.residual)

    @property
    def F(self) -> Array:
        """Deformation gradient (n_elements, n_points, 3, 3) [–]."""
        nodes = self.u[self.system.cells]
        return jnp.eye(3)[None, None] + jnp.einsum("eai,egaj->egij", nodes, self.system.dN)

    @property
    def C(self) -> Array:
        """Right Cauchy–Green tensor FᵀF (n_elements, n_points, 3, 3) [–]."""
        return jnp.swapaxes(self.F, -1, -2) @ self.F

    @property
    def stretches(self) -> Array:
        """λf, λcf, λn (n_elements, n_points, 3) [–]: stretches along fibre, cross-fibre and normal."""
        return jnp.sqrt(jnp.einsum("egki,egij,egkj->egk", self.system.frame, self.C, self.system.frame))

    @property
    def second_piola_kirchhoff(self) -> Array:
        """S = 2 ∂W/∂C (n_elements, n_points, 3, 3) [kPa], Cartesian components in the state P."""
        multipliers = jnp.stack([self.p] if self.q is None else [self.p, self.q], axis=-1)
        return outputs.second_piola_kirchhoff(self.system, self.F, multipliers, self.inputs)

    @property
    def cauchy(self) -> Array:
        """Cauchy stress (n_elements, n_points, 3, 3) [kPa], Cartesian components."""
        return outputs.cauchy(self.F, self.second_piola_kirchhoff)

    @property
    def cauchy_fibre(self) -> Array:
        """Cauchy stress (n_elements, n_points, 3, 3) [kPa] in deformed fibre axes: fibre, cross-fibre, normal."""
        R = outputs.deformed_frame(self.F, self.system.frame)
        return R @ self.cauchy @ jnp.swapaxes(R, -1, -2)

    @property
    def T_f(self) -> Array:
        """Pseudo-active fibre tension T_A^f = −q h4 I4 (n_elements, n_points) [kPa] (paper, Eq. (T)); 0 without weave."""
        return self._tensions[0]

    @property
    def T_cf(self) -> Array:
        """Pseudo-active cross-fibre tension T_A^cf = −q h6 I6 (n_elements, n_points) [kPa]; 0 without weave."""
        return self._tensions[1]

    @property
    def _tensions(self) -> tuple[Array, Array]:
        if self.q is None:
            return self.inputs.T_f, self.inputs.T_cf

        def point(C: Array, frame: Array, q: Array) -> tuple[Array, Array]:
            i4, i6 = I4(C, frame), I6(C, frame)
            by_4, by_6 = jax.grad(weave, argnums=(0, 1))(i4, i6, q, self.inputs.a_over_D)
            return 2.0 * by_4 * i4, 2.0 * by_6 * i6

        return jax.vmap(jax.vmap(point, in_axes=(0, 0, None)))(self.C, self.system.frame, self.q)

    @property
    def reactions(self) -> Array:
        """Forces (n_nodes, 3) [mN] of the supports on the body; round-off at nodes that are free."""
        return outputs.nodal_forces(self.system, self.F, self.second_piola_kirchhoff, self.u, self.inputs)

    def reaction(self, face: str) -> Array:
        """Resultant (3,) [mN] of the supports' forces on the nodes of a named face."""
        return jnp.sum(self.reactions[np.unique(self.scene.mesh.face(face))], axis=0)

    def mean(self, values: Array) -> Array:
        """Volume mean of a field (n_elements, n_points, ...)."""
        return jnp.tensordot(self.system.weight, values, axes=2) / jnp.sum(self.system.weight)


def contract(
    scene: Scene,
    *,
    T0: ArrayLike,
    a_over_D: ArrayLike | None,
    beta: ArrayLike = 1.0,
    constants: Any = None,
    settings: Settings = DEFAULT,
    throw: bool = True,
) -> State:
    """State A: the free contraction of the body from its zero-stress state P, no load (paper, step 1).

    Stationary point over u, p (and q) of ∫ W* + ½ βT0 ln I4 − ½ p (I3−1) − ½ q h dV, on the branch that starts at rest.

    T0: beating tension [kPa], ≥ 0; a_over_D ∈ [0, ¼] with the weave's constraint h = 0, None without it;
    beta ∈ [0, 1]: activation; constants: instead of the scene's.
    With throw=True a solve that fails raises `SolveError`; with throw=False, and inside `jit` or `vmap`, the status
    says so. Errors: ValueError or TypeError for an input out of its range.
    """
    ties = scene.kinematics(())
    use = scene.constants if constants is None else checks.finite_tree("constants", constants)
    T0_, beta_ = checks.scalar("T0", T0, "T0"), checks.scalar("beta", beta, "beta")
    a_over_D_ = checks.scalar("a_over_D", 0.0 if a_over_D is None else a_over_D, "a_over_D")
    system = lagrangian.build(scene, ties, weave=a_over_D is not None)
    valid = (
        checks.within(T0_, "T0")
        & checks.within(beta_, "beta")
        & checks.within(a_over_D_, "a_over_D")
        & checks.tree_is_finite(use)
    )
    tensions, none = jnp.zeros(system.weight.shape), jnp.zeros((0, 3))
    end = Inputs(use, T0_, a_over_D_, beta_, tensions, tensions, ties.offset, none, none)
    rest = end._replace(beta=jnp.zeros_like(beta_))
    return _solve(scene, system, jnp.zeros(system.size), rest, end, valid, settings, throw)


def load(state: State, *conditions: Condition, settings: Settings = DEFAULT, throw: bool = True) -> State:
    """State C: the body of a free contraction A under loads, its pseudo-active tensions frozen in (paper, step 2).

    Stationary point over u, p of ∫ W* + ½ βT0 ln I4 + ½ T_A^f ln I4 + ½ T_A^cf ln I6 − ½ p (I3−1) dV less the work of
    the tractions, on the branch that starts at A. conditions: `Stretch`, `Displacement`, `Planar`, `Traction`; what is
    not prescribed is free. throw: as in `contract`.
    """
    if not checks.is_traced(state.status) and not bool(jnp.all(state.status == Status.CONVERGED)):
        raise ValueError(f"state is not a converged free contraction: {state.message}")
    scene = state.scene
    tractions = [c for c in conditions if isinstance(c, Traction)]
    ties = scene.kinematics(tuple(c for c in conditions if not isinstance(c, Traction)))
    quads, nominal, cauchy = _tractions(scene, tractions)
    system = lagrangian.build(scene, ties, weave=False, quads=quads)
    end = state.inputs._replace(T_f=state.T_f, T_cf=state.T_cf, offset=ties.offset, nominal=nominal, cauchy=cauchy)
    # At the start of the path the body is just state A: what the ties cannot express of it is an offset that fades.
    u = state.u.reshape(-1)
    z_u = _reduce(ties, u)
    held = u - ties.scale * z_u[ties.index] if ties.size else u
    start = end._replace(offset=held, nominal=jnp.zeros_like(nominal), cauchy=jnp.zeros_like(cauchy))
    stretches = [checks.within(jnp.asarray(c.value, dtype=float), "stretch") for c in conditions if isinstance(c, Stretch)]
    valid = jnp.all(jnp.stack([checks.tree_is_finite(end), state.converged, *stretches]))
    return _solve(scene, system, jnp.concatenate([z_u, state.p]), start, end, valid, settings, throw)


def _reduce(ties: Ties, u: Array) -> Array:
    """The unknown displacements (size,) that fit the full ones (n_dof,) best: a mean over the nodes tied together."""
    norm = np.bincount(ties.index, ties.scale**2, minlength=ties.size)[: ties.size]
    total = jnp.zeros(max(ties.size, 1)).at[ties.index].add(ties.scale * (u - ties.offset))
    return total[: ties.size] / norm


def _tractions(scene: Scene, tractions: Sequence[Traction]) -> tuple[np.ndarray, Array, Array]:
    quads, nominal, cauchy = [np.zeros((0, 4), dtype=int)], [jnp.zeros((0, 3))], [jnp.zeros((0, 3))]
    for c in tractions:
        own = scene.mesh.face(c.face)
        checks.choice("measure", c.measure, ["nominal", "cauchy"])
        vector = checks.finite_tree(f"Traction({c.face!r})", c.vector)
        if isinstance(vector, list | tuple):
            vector = jnp.stack(vector)
        if vector.shape != (3,):
            raise ValueError(f"Traction({c.face!r}): vector must have shape (3,) (kPa); got {vector.shape}")
        on_all = jnp.broadcast_to(vector[None], (len(own), 3))
        quads.append(own)
        nominal.append(on_all if c.measure == "nominal" else jnp.zeros_like(on_all))
        cauchy.append(on_all if c.measure == "cauchy" else jnp.zeros_like(on_all))
    return np.concatenate(quads), jnp.concatenate(nominal), jnp.concatenate(cauchy)


@partial(jax.jit, static_argnames="settings")
def _follow(
    system: System, z: Array, start: Inputs, end: Inputs, valid: Array, settings: Settings
) -> continuation.Solution:
    return continuation.follow(system, z, start, end, valid, settings)


def _solve(
    scene: Scene, system: System, z: Array, start: Inputs, end: Inputs, valid: Array, settings: Settings, throw: bool
) -> State:
    s = _follow(system, z, start, end, valid, settings)
    n_e = len(system.cells)
    state = State(
        scene=scene,
        system=system,
        inputs=s.inputs,
        u=system.displacements(s.z, s.inputs),
        p=s.z[system.n_u : system.n_u + n_e],
        q=s.z[system.n_u + n_e :] if system.weave else None,
        status=s.status,
        reached=s.reached,
        residual=s.residual,
        force_residual=s.force_residual,
        constraint_residual=s.constraint_residual,
        history=s.history,
        steps=s.steps,
        rejected=s.rejected,
        iterations=s.iterations,
        negative_eigenvalues=s.negative,
        zero_eigenvalues=s.zero,
    )
    if throw and not checks.is_traced(s.status) and not bool(state.converged):
        raise SolveError(state.message, state)
    return state
