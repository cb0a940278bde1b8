"""A cycle of contraction: the states A and C along s, each from the one before."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from numpy.typing import NDArray

from jaxmyo import checkpoint, checks, files, lagrangian, outputs, sparse, surface, tracing
from jaxmyo.compiler import lean
from jaxmyo.conditions import Condition, Load, Spring, Tie, Volume
from jaxmyo.continuation import Route, Solution
from jaxmyo.newton import Settings
from jaxmyo.scene import Scene
from jaxmyo.solve import DEFAULT, as_state, contraction, follow, held, loading, unknowns
from jaxmyo.state import State
from jaxmyo.status import SolveError, Status
from jaxmyo.system import Inputs, System
from jaxmyo.ties import Ties


class Cycle(NamedTuple):
    """The states of a cycle: s (n,) [–], and the n states A and C as two batches (`cycle.C[i]` is one state)."""

    s: NDArray[np.float64]
    A: State
    C: State


def cycle(
    scene: Scene,
    s: ArrayLike,
    *,
    T0: ArrayLike,
    a_over_D: ArrayLike | None,
    beta: Callable[[float], ArrayLike],
    loads: Callable[[float], Sequence[Condition]],
    weave_stiffness: ArrayLike | None = None,
    constants: Any = None,
    out: str | Path | None = None,
    settings: Settings = DEFAULT,
    throw: bool = True,
) -> Cycle:
    """States A and C at the times s (n,) of a cycle.

    beta(s): activation, a number; loads(s): what `load` is given, the same kinds of conditions at every s, for example
    `lambda s: [Pressure("inner", 8.0 + 10.0 * sin(pi * s) ** 2)]`. The first A is found from rest and the first C from
    it, so the cycle best starts passive; each further state from the one before: A in activation, C in loads, tensions
    and activation together. Where the direct loading of an A would pass a limit point, the cycle stays on the branch it
    came along. Other arguments as in `contract`; with throw=True the first state that is not found is a `SolveError`,
    with throw=False its status says so, and the next step starts from the last state that was found.
    """
    times = checks.concrete("s", s, (None,))
    if not times.size:
        raise ValueError("s is empty: a cycle needs at least one time")
    betas = _stack(*(checks.scalar(f"beta({t:g})", beta(float(t)), "beta") for t in times))
    every = [tuple(loads(float(t))) for t in times]
    for t, conditions in zip(times, every, strict=True):
        if not checks.same_structure(conditions, every[0]):
            raise ValueError(f"loads({t:g}) are of other kinds or faces than loads({times[0]:g}): {conditions}")
        for c in conditions:
            if not isinstance(c, Condition):
                raise TypeError(f"loads({t:g}) must be conditions as `load` is given; got {c!r}")
    stacked, finite = checks.finite_or_zero(jax.tree.map(_stack, *every))
    system_A, inputs, valid = contraction(scene, T0, a_over_D, betas[0], weave_stiffness, constants)
    on_faces = tuple(c for c in every[0] if not isinstance(c, Tie | Volume))
    surfaces, unloaded = surface.build(scene.mesh, (*scene.springs, *jax.tree.map(lambda _: 0.0, on_faces)))
    walls, _ = surface.cavities(scene.mesh, every[0])
    system_C = loading(scene, _ties(scene, every[0]), surfaces, walls, every[0])

    def of_one(conditions: tuple[Condition, ...], beta: Array) -> _Step:
        on_faces = (c for c in conditions if not isinstance(c, Tie | Volume))
        loads = surface.build(scene.mesh, (*scene.springs, *on_faces))[1]
        return _Step(beta, _ties(scene, conditions).offset, loads, surface.cavities(scene.mesh, conditions)[1])

    plan = jax.vmap(of_one)(stacked, jnp.asarray(betas))
    valid = valid & finite & checks.within(plan.beta, "beta").all()
    problem = _Problem(system_A, system_C, inputs, unloaded, plan, valid)
    if out is not None:
        if tracing.is_traced(problem):
            raise TypeError("out is for a cycle outside of jit, vmap and grad")
        own = checkpoint.identity(
            scene,
            s=times,
            inputs=inputs,
            weave=str(system_A.weave),
            beta=plan.beta,
            loads=(plan._replace(beta=jnp.zeros(0)), problem.unloaded, str(jax.tree.structure(every[0]))),
            settings=str(settings._replace(progress=False, time_limit=None)),
        )
        found_A, found_C = _run_kept(problem, settings, Path(out), own)
    else:
        run = _run if system_A.is_small and system_C.is_small else _run_on_host
        found_A, found_C = run(problem, settings)
    A = _states(scene, system_A, found_A, ())
    C = _states(scene, system_C, found_C, tuple(c for c in stacked if not isinstance(c, Tie | Volume)))
    if throw and not tracing.is_traced(found_C.status):
        for name, states in (("A", A), ("C", C)):
            if not bool(jnp.all(states.converged)):
                k = int(np.argmin(np.asarray(states.converged)))
                raise _not_found(f"state {name} at s = {times[k]:g}", states[k])
    return Cycle(times, A, C)


def _not_found(which: str, state: State) -> SolveError:
    return SolveError(lambda: f"{which}: {state.message}", state)


class _Step(NamedTuple):
    """What a step of the cycle prescribes."""

    beta: Array
    offset: Array
    loads: dict[str, Array]
    volumes: Array


class _At(NamedTuple):
    """Where the last step ended: the unknowns of A and C and the inputs that they belong to."""

    z_A: Array
    inputs_A: Inputs
    z_C: Array
    inputs_C: Inputs
    begun: Array  # whether there is a state C


class _Problem(NamedTuple):
    """What all steps share: inputs of a state A, β apart; unloaded: the springs and no other load."""

    system_A: System
    system_C: System
    inputs: Inputs
    unloaded: dict[str, Array]
    plan: _Step  # of all steps
    valid: Array


def _steps(
    problem: _Problem, settings: Settings
) -> tuple[_At, Callable[[_At, _Step], tuple[_At, tuple[Solution, Solution]]]]:
    """Where the cycle starts, and one step of it."""
    system_A, system_C, inputs, unloaded, plan, valid = problem

    def step(at: _At, now: _Step) -> tuple[_At, tuple[Solution, Solution]]:
        end = inputs._replace(beta=now.beta)
        A = follow(
            system_A,
            at.z_A,
            Route.between(at.inputs_A, end, valid, from_rest=~at.begun, from_A=jnp.array(False)),
            settings,
        )
        found = A.status == Status.CONVERGED
        u = system_A.displacements(A.z, A.inputs)
        T_f, T_cf = inputs.T_f, inputs.T_cf
        if system_A.weave:
            T_f, T_cf = outputs.tensions(system_A, u, A.z[system_A.n_u + system_A.n_p :], A.inputs)
        end = A.inputs._replace(T_f=T_f, T_cf=T_cf, offset=now.offset, loads=now.loads)
        end = end._replace(volumes=now.volumes, imbalance=at.inputs_C.imbalance)
        # The first C starts at A without load.
        z_u = unknowns(system_C, u.reshape(-1), now.offset)
        no_pressure = jnp.zeros(len(system_C.cavities))
        z_first = jnp.concatenate([z_u, A.z[system_A.n_u : system_A.n_u + system_A.n_p], no_pressure])
        first = end._replace(
            offset=held(system_C, u.reshape(-1), z_u), loads=unloaded, volumes=lagrangian.enclosed(system_C, u)
        )
        z, begin = jax.tree.map(
            lambda before, new: jnp.where(at.begun, before, new), (at.z_C, at.inputs_C), (z_first, first)
        )
        route = Route.between(begin, end, valid & found, from_rest=jnp.array(False), from_A=jnp.array(False))
        C = follow(system_C, z, route, settings)
        zero = jnp.maximum(C.zero, A.zero) if system_A.weave else C.zero
        C = C._replace(status=jnp.where(found, C.status, A.status), zero=zero)  # as in `load`
        return _At(A.z, A.inputs, C.z, C.inputs, at.begun | found), (A, C)

    rest = inputs._replace(beta=jnp.zeros(()))
    nothing = inputs._replace(offset=plan.offset[0], loads=unloaded, volumes=plan.volumes[0])
    nothing = nothing._replace(imbalance=jnp.zeros(system_C.size))
    start = _At(jnp.zeros(system_A.size), rest, jnp.zeros(system_C.size), nothing, jnp.array(False))
    return start, step


def _in_one(problem: _Problem, settings: Settings) -> tuple[Solution, Solution]:
    """The solutions A and C of all steps, in one program."""
    start, step = _steps(problem, settings)
    return jax.lax.scan(step, start, problem.plan)[1]


_run = lean(_in_one, "settings")


def _run_on_host(problem: _Problem, settings: Settings) -> tuple[Solution, Solution]:
    """The same, step by step."""
    at, step = _steps(problem, settings)
    found = []
    for k in range(len(problem.plan.beta)):
        at, both = step(at, jax.tree.map(lambda x, k=k: x[k], problem.plan))
        found.append(both)
    return jax.tree.map(lambda *x: jnp.stack(x), *found)


def _one_step(problem: _Problem, at: _At, now: _Step, settings: Settings) -> tuple[_At, tuple[Solution, Solution]]:
    """One step, as one program."""
    return _steps(problem, settings)[1](at, now)


_one = lean(_one_step, "settings")


def _run_kept(problem: _Problem, settings: Settings, path: Path, own: dict[str, str]) -> tuple[Solution, Solution]:
    """The same, each step kept in a file; those that are in it are not solved again."""
    found = checkpoint.read(path, own, problem.inputs.constants)
    small = problem.system_A.is_small and problem.system_C.is_small
    at, step = _steps(problem, settings)
    if found:
        A, C = found[-1]
        begun = any(int(a.status) == Status.CONVERGED for a, _ in found)
        at = _At(A.z, A.inputs, C.z, C.inputs, jnp.array(begun))
    in_time = True
    for k in range(len(found), len(problem.plan.beta)):
        now = jax.tree.map(lambda x, k=k: x[k], problem.plan)
        if not small:  # the factors that a run has kept are none of another run's
            sparse.forget_factors()
        at, both = _one(problem, at, now, settings=settings) if small else step(at, now)
        found.append(both)
        late = any(int(solution.status) == Status.TIME_LIMIT for solution in both)
        in_time = in_time and not late  # what the next run, with more time, finds otherwise is not kept
        if in_time:
            checkpoint.write(path, own, found)
    files.remove_parts(path.parent, path.name)
    return checkpoint.stacked(found)


def _stack(*values: ArrayLike) -> Any:
    """The values of all times, in NumPy unless one is traced."""
    xp = tracing.numpy_for(values)
    return xp.stack([xp.asarray(v, dtype=float) for v in values])


def _ties(scene: Scene, conditions: Sequence[Condition]) -> Ties:
    return scene.kinematics(tuple(c for c in conditions if isinstance(c, Tie | Spring)))


def _states(scene: Scene, system: System, found: Solution, conditions: tuple[Load | Spring, ...]) -> State:
    """A batch of states that share one system."""
    states = jax.vmap(lambda s, c: replace(as_state(scene, system, s, c), system=cast(System, None)))(found, conditions)
    return replace(states, system=system)
