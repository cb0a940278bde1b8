"""The two solves: `contract` (P → A, free contraction) and `load` (A → C, under what state A left behind)."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxmyo import checks, continuation, lagrangian
from jaxmyo.conditions import Condition, Stretch, Tie, Traction
from jaxmyo.lagrangian import Inputs, System
from jaxmyo.newton import Settings
from jaxmyo.scene import Scene
from jaxmyo.state import State
from jaxmyo.status import SolveError
from jaxmyo.ties import Ties

DEFAULT = Settings()


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
    return _solve(scene, system, jnp.zeros(system.size), rest, end, valid, settings, throw, from_rest=True)


def load(state: State, *conditions: Condition, settings: Settings = DEFAULT, throw: bool = True) -> State:
    """State C: the body of a free contraction A under loads, its pseudo-active tensions frozen in (paper, step 2).

    Stationary point over u, p of ∫ W* + ½ βT0 ln I4 + ½ T_A^f ln I4 + ½ T_A^cf ln I6 − ½ p (I3−1) dV less the work of
    the tractions, on the branch that starts at A. conditions: `Stretch`, `Displacement`, `Planar`, `Traction`; what is
    not prescribed is free. throw: as in `contract`.
    """
    if jnp.ndim(state.status):
        raise TypeError(
            f"state is a batch of shape {jnp.shape(state.status)}; load each with jax.vmap, or one by state[i]"
        )
    if not checks.is_traced(state.status) and not bool(state.converged):
        raise ValueError(f"state is not a converged free contraction: {state.message}")
    for c in conditions:
        if not isinstance(c, Tie | Traction):
            raise TypeError(f"a condition must be Stretch, Displacement, Planar, Homogeneous or Traction; got {c!r}")
    scene = state.scene
    tractions = [c for c in conditions if isinstance(c, Traction)]
    ties = scene.kinematics(tuple(c for c in conditions if not isinstance(c, Traction)))
    quads, nominal, cauchy = _tractions(scene, tractions)
    system = lagrangian.build(scene, ties, weave=False, quads=quads)
    end = state.inputs._replace(T_f=state.T_f, T_cf=state.T_cf, offset=ties.offset, nominal=nominal, cauchy=cauchy)
    # At the start of the path the body is just state A: what the ties cannot express of it is an offset that fades.
    u = state.u.reshape(-1)
    z_u = _reduce(ties, u - jnp.where(jnp.isfinite(ties.offset), ties.offset, 0.0))
    held = u - ties.scale * z_u[ties.index] if ties.size else u
    start = end._replace(offset=held, nominal=jnp.zeros_like(nominal), cauchy=jnp.zeros_like(cauchy))
    stretches = [
        checks.within(jnp.asarray(c.value, dtype=float), "stretch") for c in conditions if isinstance(c, Stretch)
    ]
    valid = jnp.all(jnp.stack([checks.tree_is_finite(end), state.converged, *stretches]))
    return _solve(scene, system, jnp.concatenate([z_u, state.p]), start, end, valid, settings, throw, from_rest=False)


def _reduce(ties: Ties, u: Array) -> Array:
    """The unknowns (size,) that fit displacements less the offset (n_dof,) best: a mean over tied nodes."""
    norm = np.bincount(ties.index, ties.scale**2, minlength=ties.size)[: ties.size]
    total = jnp.zeros(max(ties.size, 1)).at[ties.index].add(ties.scale * u)
    return total[: ties.size] / norm


def _tractions(scene: Scene, tractions: Sequence[Traction]) -> tuple[np.ndarray, Array, Array]:
    quads, nominal, cauchy = [np.zeros((0, 4), dtype=int)], [jnp.zeros((0, 3))], [jnp.zeros((0, 3))]
    for c in tractions:
        own = scene.mesh.face(c.face)
        checks.choice("measure", c.measure, ["nominal", "cauchy"])
        name = f"Traction({c.face!r})"
        vector = (
            jnp.asarray(c.vector, dtype=float) if checks.is_traced(c.vector) else checks.concrete(name, c.vector, (3,))
        )
        if vector.shape != (3,):
            raise ValueError(f"{name} must have shape (3,) (kPa); got {vector.shape}")
        on_all = jnp.broadcast_to(vector[None], (len(own), 3))
        quads.append(own)
        nominal.append(on_all if c.measure == "nominal" else jnp.zeros_like(on_all))
        cauchy.append(on_all if c.measure == "cauchy" else jnp.zeros_like(on_all))
    return np.concatenate(quads), jnp.concatenate(nominal), jnp.concatenate(cauchy)


@partial(jax.jit, static_argnames=("settings", "from_rest"))
def _follow(
    system: System, z: Array, start: Inputs, end: Inputs, valid: Array, settings: Settings, from_rest: bool
) -> continuation.Solution:
    return continuation.follow(system, z, start, end, valid, settings, from_rest=from_rest)


def _solve(
    scene: Scene,
    system: System,
    z: Array,
    start: Inputs,
    end: Inputs,
    valid: Array,
    settings: Settings,
    throw: bool,
    *,
    from_rest: bool,
) -> State:
    s = _follow(system, z, start, end, valid, settings, from_rest)
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
