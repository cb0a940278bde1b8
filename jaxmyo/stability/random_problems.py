"""Thousands of random problems: each converges to the equilibrium of its branch, or says by name why it does not.

What the package finds is held against `independent`, hand-made equations of the same discrete bodies (is it an
equilibrium?), and against `reference`, which follows the branch from rest in small steps (is it the right one, and was
there one to find?).
"""

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxmyo.compiler import LONG
from jaxmyo.conditions import Pressure, Stretch
from jaxmyo.constants import LinYin
from jaxmyo.scene import Scene
from jaxmyo.scenes import radial_tube, thin_sample
from jaxmyo.solve import contract, load
from jaxmyo.stability import independent, reference
from jaxmyo.stability.independent import Array, Body, Muscle
from jaxmyo.stability.problems import WALL, Problems, draw
from jaxmyo.stability.reference import Drive, End
from jaxmyo.state import State
from jaxmyo.status import Status

#: Problems that are solved in one call.
CHUNK = 500
#: The residual that counts as an equilibrium, and the difference of stretches that counts as the same one [–].
EQUILIBRIUM, SAME = 1e-9, 1e-5


class Found(NamedTuple):
    """What the package says of a batch of states: z (n, N) as in `independent`; status (n,); residual (n,)."""

    z: Array
    status: NDArray[np.int64]
    residual: Array


class Outcome(NamedTuple):
    """A batch of problems, with the states A and C of the package and of the reference.

    error_A, error_C: relative residuals of the found states by the independent equations, NaN where there is none;
    off_A, off_C: the largest difference of a stretch from the reference, NaN where one of the two has none; a
    state C is only asked for where the reference has a state A and the package found the same; beyond: (n,) whether C
    is on the branch of the reference, but beyond a limit point, which the package stepped over.
    """

    kind: str
    weave: bool
    problems: Problems
    A: Found
    C: Found
    reference_A: reference.Branch
    reference_C: reference.Branch
    error_A: Array
    error_C: Array
    off_A: Array
    off_C: Array
    beyond: NDArray[np.bool_]


def outcome(kind: str, weave: bool, n: int, seed: int) -> Outcome:
    """n random problems of a kind, "sample" or "tube", with or without the weave, solved and verified."""
    problems = draw(kind, n, seed)
    A, C = solve(kind, weave, problems)
    body = body_of(kind, problems)
    muscle, none = muscle_of(problems, weave, body), np.zeros(n)
    ref_A = branch_A(body, muscle)
    error_A, off_A = _held_against(body, muscle, none, A, ref_A, None)
    same = np.flatnonzero((off_A <= SAME) & (ref_A.end == End.REACHED))
    left = muscle_C(body, muscle, ref_A.z)
    ref_C = branch_C(kind, body, left, ref_A.z, problems, same)
    fixed = (0, 1) if kind == "sample" else ()
    pressure = none if kind == "sample" else problems.target[:, 0]
    error_C, off_C = _held_against(body, left, pressure, C, ref_C, fixed)
    beyond = _beyond(kind, body, left, ref_A.z, problems, C, ref_C)
    return Outcome(kind, weave, problems, A, C, ref_A, ref_C, error_A, error_C, off_A, off_C, beyond)


def solve(kind: str, weave: bool, problems: Problems) -> tuple[Found, Found]:
    """The states A and C of the package."""
    run = _program(kind, weave)
    parts = []
    for some in _chunks(len(problems.T0)):
        few = Problems(*(x[some] for x in problems))
        parts.append(jax.tree.map(np.asarray, run(few)))
    n = len(problems.T0)
    A, C = jax.tree.map(lambda *x: np.concatenate(x)[:n], *parts)
    return Found(*A), Found(*C)


def _chunks(n: int) -> Iterator[NDArray[np.int64]]:
    """Numbers of problems, always as many: the last ones begin anew, so that one compiled program serves."""
    for first in range(0, n, CHUNK):
        yield np.arange(first, first + CHUNK) % n


@cache
def _program(kind: str, weave: bool) -> Callable[[Problems], Any]:
    scene = thin_sample() if kind == "sample" else radial_tube(WALL)

    def one(x: Problems) -> tuple[Found, Found]:
        constants = LinYin(*(x.constants[k] for k in range(8)))
        how: Any = {"constants": constants, "beta": x.beta, "T0": x.T0, "a_over_D": x.a_over_D if weave else None}
        if kind == "tube":
            how["points"] = _moved(scene, x)
        A = contract(scene, **how, throw=False)
        target = x.target
        conditions: list[Any] = (
            [Stretch("x", target[0]), Stretch("y", target[1])] if kind == "sample" else [Pressure("inner", target[0])]
        )
        C = load(A, *conditions, throw=False)
        return _found(kind, scene, x, A), _found(kind, scene, x, C)

    return jax.jit(jax.vmap(one), compiler_options=LONG)


def _moved(scene: Scene, x: Problems) -> Any:
    """The nodes of the tube with the radii and the height of a problem."""
    old = scene.mesh.points
    layer = np.searchsorted(np.unique(old[:, 0]), old[:, 0])
    return jnp.stack([x.R[layer], jnp.asarray(old[:, 1]), x.H * (old[:, 2] / old[:, 2].max())], axis=1)


def _found(kind: str, scene: Scene, x: Problems, state: State) -> Found:
    if kind == "sample":
        u = state.mean("stretches") - 1.0
    else:
        r = np.unique(scene.mesh.points[:, 0], return_index=True)[1]
        top = int(np.argmax(scene.mesh.points[:, 2]))
        u = jnp.concatenate([state.u[r, 0], state.u[top, 2:] / x.H])
    z = jnp.concatenate([u, state.p] if state.q is None else [u, state.p, state.q])
    return Found(z, state.status, state.residual)  # type: ignore[arg-type]


# ------------------------------------------------------------------------------------------------ by hand


def body_of(kind: str, problems: Problems) -> Body:
    """The bodies of the hand-made equations."""
    return independent.sample(len(problems.T0)) if kind == "sample" else independent.tube(problems.R, problems.H)


def muscle_of(problems: Problems, weave: bool, body: Body) -> Muscle:
    """What drives the states A."""
    none = np.zeros(body.weight.shape)
    return Muscle(problems.constants, problems.T0, problems.beta, problems.a_over_D if weave else None, none, none)


def muscle_C(body: Body, muscle: Muscle, z_A: Array) -> Muscle:
    """What drives the states C: the tensions of the states A, and no weave."""
    T_f, T_cf = independent.tensions(body, muscle, z_A)
    return Muscle(muscle.constants, muscle.T0, muscle.beta, None, T_f, T_cf)


def branch_A(body: Body, muscle: Muscle) -> reference.Branch:
    """Free contraction from rest, the activation growing."""
    n = len(muscle.T0)
    none, size = np.zeros(n), body.n_u + body.n_p + (muscle.a_over_D is not None)
    return reference.follow(body, np.zeros((n, size)), Drive(muscle.at(none), none), Drive(muscle, none))


def branch_C(
    kind: str,
    body: Body,
    left: Muscle,
    z_A: Array,
    problems: Problems,
    some: NDArray[np.int64],
    *,
    past_limits: bool = False,
) -> reference.Branch:
    """The loaded states of `some` problems, from their states A; the others have none (NaN, End.LOST).

    Both stretches of a sample are prescribed: the third is 1/(λ1 λ2), and p = λ3 ∂W/∂λ3 leaves no stress normal to it.
    """
    n, size = len(problems.T0), body.n_u + body.n_p
    z, reached, end = np.full((n, size), np.nan), np.zeros(n), np.full(n, int(End.LOST))
    few, driven, target, none = body[some], left[some], problems.target[some], np.zeros(len(some))
    if kind == "tube":
        ends = Drive(driven, none), Drive(driven, target[:, 0])
        z[some], reached[some], end[some] = reference.follow(few, z_A[some, :size], *ends, past_limits=past_limits)
        return reference.Branch(z, reached, end)
    z[some] = np.column_stack([target - 1.0, 1.0 / np.prod(target, axis=1) - 1.0, none])
    with np.errstate(all="ignore"):
        z[some, 3] = independent.residual_and_tangent(few, driven, z[some], none)[0][:, 2] / np.prod(target, axis=1)
    finite = np.isfinite(z[some, 3])
    end[some], reached[some] = np.where(finite, End.REACHED, End.OVERFLOW), finite
    return reference.Branch(z, reached, end)


def _beyond(
    kind: str, body: Body, left: Muscle, z_A: Array, problems: Problems, C: Found, branch: reference.Branch
) -> NDArray[np.bool_]:
    found = np.zeros(len(C.status), bool)
    some = np.flatnonzero((C.status == Status.CONVERGED) & (branch.end == End.LIMIT_POINT))
    if some.size:
        through = branch_C(kind, body, left, z_A, problems, some, past_limits=True)
        off = np.max(np.abs(body.stretches(C.z) - body.stretches(through.z)), axis=(1, 2))
        found[some] = (off[some] <= SAME) & (through.end[some] == End.REACHED)
    return found


def _held_against(
    body: Body, muscle: Muscle, pressure: Array, found: Found, branch: reference.Branch, fixed: Any
) -> tuple[Array, Array]:
    """The residuals of the found states, and how far their stretches are off the reference's; NaN where not found."""
    good = found.status == Status.CONVERGED
    free = np.ones(body.n_u, bool)
    free[list(fixed or ())] = False
    error, off = np.full(len(good), np.nan), np.full(len(good), np.nan)
    at = np.flatnonzero(good)
    with np.errstate(all="ignore"):
        error[at] = independent.relative_residual(body[at], muscle[at], found.z[at], pressure[at], free)
        difference = np.abs(body.stretches(found.z) - body.stretches(branch.z))
    both = good & (branch.end == End.REACHED)
    off[both] = np.max(difference, axis=(1, 2))[both]
    return error, off
