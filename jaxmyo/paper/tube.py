"""The active thick-walled tube of the paper over its cycle, with and without the constraint of the weave.

The paper gives the radii, the height, β(s) = sin² πs and P(s) = 8 + 10 sin² πs kPa. It does not give T0 and a/D of the
tube: `T0_KPA` and `A_OVER_D` are a choice.
"""

import time
from dataclasses import dataclass
from functools import partial
from threading import Lock
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from jaxmyo.compiler import QUICK
from jaxmyo.conditions import Pressure
from jaxmyo.cycle import Cycle, cycle
from jaxmyo.paper.homogeneous import CONSTRAINT, constants_as_arrays
from jaxmyo.paper.sample import HALF, REST, S, activation
from jaxmyo.scene import Scene
from jaxmyo.scenes.tube import HEIGHT, radial_tube
from jaxmyo.state import State
from jaxmyo.status import SolveError, Status, explain

T0_KPA = 15.0
A_OVER_D = 0.2
#: Elements through the wall of the tube whose cycle is reported.
ELEMENTS = 32
#: Size of the outermost element over the innermost one: the fields vary most at the inner wall.
GRADING = 8.0

#: Free contraction, and under the inner pressure.
Kind = Literal["A", "C"]
KINDS: tuple[Kind, Kind] = ("A", "C")
#: No activation and full activation: the two ends of the way up.
ENDS = S[[REST, HALF]]
#: Solves run one at a time, so that their seconds are those of a solve.
_SOLVING = Lock()


def pressure(beta: Any) -> Any:
    """The inner pressure [kPa] at the activation β, in phase with it: 8 + 10 β."""
    return 8.0 + 10.0 * beta


class Walls(NamedTuple):
    """The numbers of states of the tube; all fields have the same leading axes.

    r: radii (..., n + 1) of the nodes [mm]; height: over that of the state P [–]; q of the weave [kPa], 0 without it;
    T_f, T_cf: (..., 2) pseudo-active tensions [kPa] at the Gauss points next to the inner and to the outer wall;
    residual: relative; reached, status, negative: as of a `State`.
    """

    r: Any
    height: Any
    q: Any
    T_f: Any
    T_cf: Any
    residual: Any
    reached: Any
    status: Any
    negative: Any

    @property
    def ri(self) -> NDArray[np.float64]:
        """Inner radius [mm]."""
        return np.asarray(self.r[..., 0])

    @property
    def ro(self) -> NDArray[np.float64]:
        """Outer radius [mm]."""
        return np.asarray(self.r[..., -1])

    @property
    def thickness(self) -> NDArray[np.float64]:
        """Thickness of the wall [mm]."""
        return self.ro - self.ri

    def at(self, *index: Any) -> "Walls":
        """Some of the states, by an index of the leading axes."""
        return Walls(*(field[index] for field in self))


@dataclass(frozen=True)
class Tube:
    """The cycle of the tube on one mesh, all states converged.

    elements: through the wall; s: times (n_s,) [–]; R: radii (n + 1,) of the nodes in the state P [mm]; A, C: the
    states, with leading axes constraint (with, without) × time; cycles: what they are the numbers of, as arrays of
    NumPy; solve_s: seconds of the two solves; total_s: with what comes before, most of it compilation.
    """

    elements: int
    s: NDArray[np.float64]
    R: NDArray[np.float64]
    A: Walls
    C: Walls
    cycles: tuple[Cycle, Cycle]
    solve_s: float
    total_s: float

    def walls(self, kind: Kind) -> Walls:
        """The states A or C."""
        return self.A if kind == "A" else self.C

    def state(self, kind: Kind, constraint: int, k: int) -> State:
        """One state with all its fields."""
        found = self.cycles[constraint]
        return (found.A if kind == "A" else found.C)[k]

    @property
    def ends(self) -> tuple[int, int]:
        """Where s = 0 and s = ½ are among the times."""
        rest, half = (int(np.flatnonzero(self.s == s)[0]) for s in ENDS)
        return rest, half

    @property
    def residual(self) -> float:
        """The largest relative residual of a state."""
        return max(float(self.walls(kind).residual.max()) for kind in KINDS)

    @property
    def up_and_down(self) -> float:
        """The largest difference [mm] between the radii at s and at 1 − s, where β is the same."""
        return max(float(np.abs(self.walls(kind).r - self.walls(kind).r[:, ::-1]).max()) for kind in KINDS)


def tube(constants: Any, elements: int = ELEMENTS, s: NDArray[np.float64] = S) -> Tube:
    """The cycle at the times s on a mesh of so many elements, with a set of constants of the Lin–Yin law.

    A `SolveError` if one of the states is not found.
    """
    arrays = constants_as_arrays(constants)
    before_s, solve_s, began = 0.0, 0.0, time.perf_counter()
    scene = radial_tube(elements, grading=GRADING)
    found = []
    for acting in CONSTRAINT:
        program = _cycle.lower(arrays, scene=scene, s=tuple(s), acting=acting).compile()
        before_s += time.perf_counter() - began
        with _SOLVING:
            began = time.perf_counter()
            found.append(jax.block_until_ready(program(arrays)))
            solve_s += time.perf_counter() - began
        began = time.perf_counter()
    # In NumPy, where cutting and joining needs no compilation.
    (A, C, cycle_with), (A_without, C_without, cycle_without) = jax.tree.map(np.asarray, found)
    A, C = (Walls(*map(np.stack, zip(*pair, strict=True))) for pair in ((A, A_without), (C, C_without)))
    for kind, walls in zip(KINDS, (A, C), strict=True):
        cases = [f"{'with' if acting else 'without'} the constraint, s = {t:g}" for acting in CONSTRAINT for t in s]
        check(walls, [f"{elements} elements, state {kind} {case}" for case in cases])
    R = along_wall(scene.mesh.points[:, 0])
    return Tube(elements, s, R, A, C, (cycle_with, cycle_without), solve_s, before_s + solve_s)


@partial(jax.jit, static_argnames=("scene", "s", "acting"), compiler_options=QUICK)
def _cycle(constants: Any, scene: Scene, s: tuple[float, ...], acting: bool) -> tuple[Walls, Walls, Cycle]:
    found = traced_cycle(scene, np.array(s), constants, A_OVER_D if acting else None)
    return numbers(found.A), numbers(found.C), found


def traced_cycle(
    scene: Scene,
    s: NDArray[np.float64],
    constants: Any,
    a_over_D: float | None,
    weave_stiffness: ArrayLike | None = None,
) -> Cycle:
    """The cycle of the paper at the times s, inside `jax.jit`; a status instead of errors. Stiffness in kPa."""

    def beta(t: float) -> float:
        return float(activation(np.array(t)))

    return cycle(
        scene,
        s,
        T0=T0_KPA,
        a_over_D=a_over_D,
        beta=beta,
        loads=lambda t: [Pressure("inner", pressure(beta(t)))],
        weave_stiffness=weave_stiffness,
        constants=constants,
        throw=False,
    )


def numbers(state: State) -> Walls:
    """The numbers of a state of a tube, or of a batch of them."""
    radii = jnp.asarray(state.scene.mesh.points[:, 0])
    return Walls(
        r=along_wall(state.u[..., 0]) + along_wall(radii).reshape((1,) * jnp.ndim(state.status) + (-1,)),
        height=1.0 + state.u[..., -1, 2] / HEIGHT,
        q=jnp.zeros_like(state.residual) if state.q is None else state.q[..., 0],
        T_f=jnp.stack([state.T_f[..., 0, 0], state.T_f[..., -1, -1]], axis=-1),
        T_cf=jnp.stack([state.T_cf[..., 0, 0], state.T_cf[..., -1, -1]], axis=-1),
        residual=state.residual,
        reached=state.reached,
        status=state.status,
        negative=state.negative_eigenvalues,
    )


def along_wall(at_nodes: Any) -> Any:
    """Of values (..., n_nodes) those of one line of nodes through the wall (..., n + 1)."""
    return at_nodes[..., ::4]


def check(walls: Walls, what: list[str]) -> None:
    """A `SolveError` that names the first state that was not found. what: a name for each state."""
    status = np.ravel(walls.status)
    failed = np.flatnonzero(status != Status.CONVERGED)
    if failed.size:
        k = int(failed[0])
        message = explain(status[k], np.ravel(walls.reached)[k], np.ravel(walls.residual)[k])
        raise SolveError(f"{failed.size} of {status.size} states were not found; the first, {what[k]}: {message}", None)
