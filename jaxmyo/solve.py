"""The two solves: `contract` (P → A, free contraction) and `load` (A → C, under what state A left behind)."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxmyo import checks, constraints, factor, fibres, lagrangian, surface, tracing
from jaxmyo.conditions import Condition, Load, Spring, Stretch, Tie, Volume
from jaxmyo.continuation import Route, Solution
from jaxmyo.energies import Kind
from jaxmyo.hexahedron import gauss, shape_gradient
from jaxmyo.implicit import follow
from jaxmyo.linear import Dense
from jaxmyo.newton import Settings
from jaxmyo.scene import Scene
from jaxmyo.sparse import Sparse
from jaxmyo.state import State
from jaxmyo.status import SolveError, Status
from jaxmyo.system import Geometry, Inputs, System
from jaxmyo.ties import Ties, projected

DEFAULT = Settings()

#: Displacements from which on the solves are sparse [–]: their programs are compiled in a fraction of the time, and of
#: single solves dense ones of that size take longer.
LARGE = 400


def contract(
    scene: Scene,
    *,
    T0: ArrayLike,
    a_over_D: ArrayLike | None,
    beta: ArrayLike = 1.0,
    weave_stiffness: ArrayLike | None = None,
    constants: Any = None,
    points: ArrayLike | None = None,
    fibre: ArrayLike | None = None,
    cross: ArrayLike | None = None,
    start: State | None = None,
    settings: Settings = DEFAULT,
    throw: bool = True,
) -> State:
    """State A: the free contraction of the body from its zero-stress state P, no load (paper, step 1).

    Stationary point over u, p (and q) of ∫ W* + ½ βT0 ln I4 − ½ p (I3−1) − ½ q h dV, on the branch that starts at rest.

    T0: beating tension [kPa], ≥ 0; a_over_D ∈ [0, ¼] with the weave's constraint h = 0, None without it;
    beta ∈ [0, 1]: activation; weave_stiffness: a finite stiffness k [kPa] of the weave, energy ½ k h², instead of the
    exact constraint (−⅛ q²/k is added); constants: instead of the scene's; points: (n_nodes, 3) coordinates Θ of the
    nodes [mm, rad], fibre and cross: arrays as of `Scene`, instead of the scene's, for derivatives by them and batches
    over them; start: another state A of this scene that the path starts from, instead of rest (inside `jit` and
    `vmap`, where a start that failed raises nothing, the state has its status).
    With throw=True a solve that fails raises `SolveError`; with throw=False, and inside `jit` or `vmap`, the status
    says so. Errors: ValueError or TypeError for an input out of its range, ValueError for redundant constraints.
    """
    geometry, has_volume = _geometry(scene, points, fibre, cross)
    system, end, valid = contraction(scene, T0, a_over_D, beta, weave_stiffness, constants, geometry)
    valid = valid & has_volume
    begin = end._replace(beta=tracing.zeros())
    p = _pressure_at_rest(scene, begin)
    z = tracing.numpy_for(p).concatenate([np.zeros(system.n_u), p, np.zeros(system.n_q)])
    if start is not None:
        _check_start(scene, start, "start")
        if (start.q is None) != (a_over_D is None):
            raise ValueError("start must have the weave if a_over_D is given, and be without it if a_over_D is None")
        u = start.u.reshape(-1)
        multipliers = [start.p] if start.q is None else [start.p, start.q]
        z, begin = jnp.concatenate([unknowns(system, u, end.offset), *multipliers]), start.inputs
        valid = valid & start.converged
    no, from_rest = tracing.array(np.bool_(False)), tracing.array(np.bool_(start is None))
    route = Route.between(begin, end, valid, from_rest=from_rest, from_A=no)
    found = _solve(scene, system, z, route, (), settings, throw)
    if start is None:
        return found
    return replace(found, status=_unless_failed(found.status, start))


def load(
    state: State, *conditions: Condition, start: State | None = None, settings: Settings = DEFAULT, throw: bool = True
) -> State:
    """State C: the body of a free contraction A under loads, its pseudo-active tensions frozen in (paper, step 2).

    Stationary point over u, p of ∫ W* + ½ βT0 ln I4 + ½ T_A^f ln I4 + ½ T_A^cf ln I6 − ½ p (I3−1) dV less the work of
    the loads. conditions: ties such as `Stretch` and `Displacement` (of a face and axis that a support holds: it moves
    the support), `Traction`, `Pressure`, `BodyForce`, `Spring`, `Volume`; what is not prescribed is free. The path
    starts at the state A without load, or at `start`, another state C of this scene (the next step of a cycle): loads,
    tensions and activation then move together from those of `start` to the new ones, and what `start` was held by
    fades. A body can have several states C under one load; where the path starts decides which is found.
    throw: as in `contract`. Inside `jit` and `vmap`, where a state that failed raises nothing, C has its status.
    """
    system, z, begin, end, valid, loads = problem(state, conditions, start)
    origin = state if start is None else start
    no, from_A = tracing.array(np.bool_(False)), tracing.array(np.bool_(start is None))
    route = Route.between(begin, end, valid, from_rest=no, from_A=from_A)
    found = _solve(state.scene, system, z, route, loads, settings, throw)
    status = _unless_failed(found.status, origin, state)
    # Tensions that a singular state left have no derivative, however stiff the body has become under its load.
    zero = jnp.maximum(found.zero_eigenvalues, state.zero_eigenvalues) if state.system.weave else found.zero_eigenvalues
    return replace(found, status=status, zero_eigenvalues=zero)


class Problem(NamedTuple):
    """A path of states C: its system, the unknowns at its start, the inputs at its start and end, and its loads.

    valid: whether all inputs are in their ranges.
    """

    system: System
    z: Array
    begin: Inputs
    end: Inputs
    valid: Array
    loads: tuple[Load | Spring, ...]


def problem(state: State, conditions: tuple[Condition, ...], start: State | None) -> Problem:
    """The path that `load` follows."""
    if jnp.ndim(state.status):
        raise TypeError(
            f"state is a batch of shape {jnp.shape(state.status)}; load each with jax.vmap, or one by state[i]"
        )
    _check_start(state.scene, state, "state")
    if start is not None:
        _check_start(state.scene, start, "start")
    for c in conditions:
        if not isinstance(c, Condition):
            raise TypeError(
                "a condition must be Stretch, Displacement, Planar, Uniform, Proportional, Homogeneous, Shear, "
                f"Traction, Pressure, BodyForce, Volume or Spring; got {c!r}"
            )
    conditions, finite = checks.finite_or_zero(conditions)
    scene, origin = state.scene, state if start is None else start
    loads = tuple(c for c in conditions if not isinstance(c, Tie | Volume))
    walls, volumes = surface.cavities(scene.mesh, conditions)
    geometry = state.system.geometry
    ties = scene.kinematics(tuple(c for c in conditions if isinstance(c, Tie | Spring)), geometry and geometry.points)
    surfaces, before, after = _changing_loads(scene, origin.conditions, loads)
    traced = (origin.status, state.status, conditions)
    system = loading(scene, ties, surfaces, walls, traced, state.system)
    none = tracing.zeros(system.size)
    end = state.inputs._replace(T_f=state.T_f, T_cf=state.T_cf, offset=ties.offset, loads=after, volumes=volumes)
    end = end._replace(imbalance=none)
    # At the start of the path the body is where it was: what the ties cannot express of that is an offset that fades.
    u = tracing.known(origin.u).reshape(-1)
    z_u = unknowns(system, u, ties.offset)
    begin = origin.inputs._replace(T_f=origin.T_f, T_cf=origin.T_cf, offset=held(system, u, z_u), loads=before)
    begin = begin._replace(volumes=lagrangian.enclosed(system, origin.u), imbalance=none)
    stretches = [checks.within(c.value, "stretch") for c in conditions if isinstance(c, Stretch)]
    good = (finite, state.converged, origin.converged, surface.springs_are_valid(after))
    valid = tracing.every(checks.tree_is_finite(end), *good, *stretches)
    same = len(origin.cavity_pressures) == len(walls)
    parts = [z_u, origin.p, origin.cavity_pressures if same else np.zeros(len(walls))]
    z = tracing.numpy_for(parts).concatenate(parts)
    if start is not None:
        at_start = jax.lax.stop_gradient((system, z, begin))  # where a path begins has no part in derivatives
        begin = begin._replace(imbalance=residual(*at_start))
    return Problem(system, z, begin, end, valid, loads)


def contraction(
    scene: Scene,
    T0: ArrayLike,
    a_over_D: ArrayLike | None,
    beta: ArrayLike,
    weave_stiffness: ArrayLike | None,
    own: Any,
    geometry: Geometry | None = None,
) -> tuple[System, Inputs, Any]:
    """The problem of a state A: system, inputs, and whether the inputs are in their ranges."""
    constants = scene.constants_of_kinds(own)
    T0_, beta_ = checks.scalar("T0", T0, "T0"), checks.scalar("beta", beta, "beta")
    a_over_D_ = checks.scalar("a_over_D", 0.0 if a_over_D is None else a_over_D, "a_over_D")
    valid = checks.within(T0_, "T0") & checks.within(beta_, "beta") & checks.within(a_over_D_, "a_over_D")
    softness = tracing.zeros()
    if weave_stiffness is not None:
        k = checks.scalar("weave_stiffness", weave_stiffness, "weave_stiffness")
        stiff = checks.within(k, "weave_stiffness")
        softness, valid = 1.0 / jnp.where(stiff, k, 1.0), valid & stiff
    ties = scene.kinematics((), geometry and geometry.points)
    surfaces, springs = surface.build(scene.mesh, scene.springs)
    large = _is_large(ties, T0_, beta_, a_over_D_, constants, geometry)
    kinds: Any = {"weave": a_over_D is not None, "surfaces": surfaces, "large": large}
    system = System.of(scene, ties, **kinds, geometry=geometry)
    at_rest = System.of(scene, scene.kinematics(()), **kinds) if tracing.is_traced(geometry) else system
    constraints.check_at_rest(scene, at_rest, a_over_D, soft=weave_stiffness is not None)
    system = tracing.on_device(system)
    tensions, none = tracing.zeros(*system.weight.shape), tracing.zeros(system.size)
    inputs = Inputs(
        constants, T0_, a_over_D_, beta_, softness, tensions, tensions, ties.offset, springs, tracing.zeros(0), none
    )
    return system, inputs, valid & checks.tree_is_finite(constants) & surface.springs_are_valid(springs)


def _pressure_at_rest(scene: Scene, inputs: Inputs) -> Any:
    """p (n_p,) [kPa] that leaves a law no mean stress at rest, p = ⅓ tr 2 ∂W/∂C: μ for ½ μ (I1 − 3)."""
    _, first = np.unique(scene.p_patches, return_index=True)
    return tracing.known(_pressures_at_rest(scene.kinds, inputs.beta, inputs.constants))[scene.material[first]]


@partial(jax.jit, static_argnums=0)
def _pressures_at_rest(kinds: tuple[Kind, ...], beta: Array, constants: tuple[Any, ...]) -> Array:
    rest = jnp.eye(3)
    of_kinds = [
        2.0 / 3.0 * jnp.trace(jax.grad(kind.law)(rest, rest, beta, own))
        for kind, own in zip(kinds, constants, strict=True)
    ]
    return jnp.stack(of_kinds)


def loading(
    scene: Scene,
    ties: Ties,
    surfaces: dict[str, np.ndarray],
    walls: Sequence[np.ndarray],
    traced: Any,
    like: System | None = None,
) -> System:
    """The system of a state C, dense if any of its inputs is traced; walls: of cavities of prescribed volume.

    like: the system of another state of the body, whose geometry may not be the scene's, if there is one.
    """
    geometry = like.geometry if like else None
    kinds: Any = {"weave": False, "surfaces": surfaces, "cavities": walls, "large": _is_large(ties, traced, geometry)}
    system = System.of(scene, ties, **kinds, geometry=geometry, like=like)
    if not tracing.is_traced((geometry, ties.scale)):
        constraints.check_at_rest(scene, system, None, soft=False)
    return tracing.on_device(system)


def _geometry(
    scene: Scene, points: ArrayLike | None, fibre: ArrayLike | None, cross: ArrayLike | None
) -> tuple[Geometry | None, Any]:
    """What takes the place of the scene's nodes and fibres, if anything does, and whether it can.

    Concrete values are checked as those of a scene are. Traced ones that are no geometry are replaced by the scene's.
    """
    if points is None and fibre is None and cross is None:
        return None, np.True_
    mesh = scene.mesh
    if points is None:
        points = mesh.points
    if tracing.is_traced(points):
        if jnp.shape(points) != mesh.points.shape:
            raise ValueError(f"points must have shape {mesh.points.shape}; got {jnp.shape(points)}")
    else:
        points = checks.concrete("points", points, (len(mesh.points), 3))
        replace(mesh, points=points)  # its checks
    f = scene.frame[:, :, 0] if fibre is None else fibre
    c = scene.frame[:, :, 1] if cross is None else cross
    xi, _ = gauss(*scene.orders)
    if not tracing.is_traced((points, f, c)):
        return Geometry(points, fibres.frame(mesh, xi, f, c)), np.True_  # type: ignore[arg-type]
    frame, good = fibres.traced_frame(mesh, xi, f, c)
    jacobian = jnp.einsum("eai,gaj->egij", jnp.asarray(points)[mesh.cells], shape_gradient(gauss(2, 2, 2)[0]))
    good = good & jnp.all(jnp.linalg.det(jacobian) > 0.0)
    return Geometry(jnp.where(good, points, mesh.points), jnp.where(good, frame, scene.frame)), good


def _is_large(ties: Ties, *inputs: Any) -> bool:
    """Whether the body is solved by sparse factors: it has many unknowns, and is not inside jit or vmap."""
    return ties.size > LARGE and not tracing.is_staged((ties.offset, inputs))


def unknowns(system: System, u: Array, offset: Array) -> Array:
    """The unknown displacements (n_u,) that fit u (n_dof,) best: a mean over tied nodes."""
    u, offset = tracing.known(u), tracing.known(offset)
    xp = tracing.numpy_for(u, offset)
    free = u - xp.where(xp.isfinite(offset), offset, 0.0)
    return tracing.array(projected(free[:, None], system.tie_index, system.tie_scale, system.n_u)[: system.n_u, 0])


def held(system: System, u: Array, z_u: Array) -> Array:
    """The offset (n_dof,) with which the unknowns z_u stand for exactly the displacements u (n_dof,)."""
    index, scale, u, z_u = (tracing.known(x) for x in (system.tie_index, system.tie_scale, u, z_u))
    return tracing.array(u - scale * z_u[index] if system.n_u else u)


def _changing_loads(
    scene: Scene, old: tuple[Load | Spring, ...], new: tuple[Load | Spring, ...]
) -> tuple[dict[str, np.ndarray], dict[str, Array], dict[str, Array]]:
    """The loaded quads, and their values before and after: old loads fade while new ones grow."""
    if checks.same_structure(old, new):  # the same loads with other values
        surfaces, after = surface.build(scene.mesh, (*scene.springs, *new))
        return surfaces, surface.build(scene.mesh, (*scene.springs, *old))[1], after
    faded, unborn = (jax.tree.map(lambda x: 0.0 * tracing.known(x), c) for c in (old, new))
    surfaces, after = surface.build(scene.mesh, (*scene.springs, *faded, *new))
    return surfaces, surface.build(scene.mesh, (*scene.springs, *old, *unborn))[1], after


def _check_start(scene: Scene, state: State, name: str) -> None:
    if not isinstance(state, State):
        raise TypeError(f"{name} must be a State; got {state!r}")
    if state.scene is not scene:
        raise ValueError(f"{name} must be a state of the same scene")
    # In NumPy: inside jit JAX's own comparison would be traced, though the state is not.
    if not tracing.is_traced(state.status) and not np.all(np.asarray(state.status) == Status.CONVERGED):
        raise ValueError(f"{name} is not converged: {state.message}")


@jax.jit
def _dense_residual(system: System, z: Array, inputs: Inputs) -> Array:
    return lagrangian.residual(system, z, inputs)


def residual(system: System, z: Array, inputs: Inputs) -> Array:
    """The residual (n,) at z."""
    if system.is_small:
        return _dense_residual(system, z, inputs)
    return jnp.asarray(Sparse.of(system).at(np.asarray(z), inputs).r)


def _solve(
    scene: Scene,
    system: System,
    z: Array,
    route: Route,
    conditions: Sequence[Load | Spring],
    settings: Settings,
    throw: bool,
) -> State:
    s = follow(system, z, route, settings)
    state = as_state(scene, _fixed(system, s.status), s, tuple(conditions))
    if throw and not tracing.is_traced(s.status) and not bool(state.converged):
        raise SolveError(lambda: state.message + constraints.at_failure(system, s.z, s.inputs), state)
    return state


def _unless_failed(status: Array, *origins: State) -> Array:
    """The status of a state, or that of the last of its origins that failed: under jit nothing stops at one."""
    for origin in origins:
        if tracing.is_traced(origin.status):
            status = jnp.where(origin.converged, status, origin.status)
    return status


def _fixed(system: System, status: Array) -> System:
    """The system, without derivatives by nodes and fibres where a solve failed."""

    def fixed(x: Any) -> Any:
        moves = tracing.is_traced(x) and jnp.issubdtype(x.dtype, jnp.inexact)
        return jnp.where(status != Status.CONVERGED, jax.lax.stop_gradient(x), x) if moves else x

    return jax.tree.map(fixed, system) if system.own_geometry else system


def as_state(scene: Scene, system: System, s: Solution, conditions: tuple[Load | Spring, ...]) -> State:
    """The end of a path as a state."""
    z = tracing.known(s.z)
    to_p, to_q = system.n_u + system.n_p, system.n_u + system.n_p + system.n_q
    p, q, in_cavities = (tracing.array(part) for part in (z[system.n_u : to_p], z[to_p:to_q], z[to_q:]))
    return State(
        scene=scene,
        system=system,
        inputs=s.inputs,
        conditions=conditions,
        u=system.displacements(s.z, s.inputs),
        p=p,
        q=q if system.weave else None,
        cavity_pressures=in_cavities,
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
        stable_until=s.stable_until,
        work=s.work,
        solver=Dense.name if system.is_small else factor.chosen(system.n_u).name,
    )
