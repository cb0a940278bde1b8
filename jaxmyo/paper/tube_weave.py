"""The tube with a weave of finite stiffness k that has its own q in each element, against one q for the wall.

With planar ends and struts along the axis, det F = 1 and h = 0 at every radius would leave the tube no deformation at
all (λf = 1). One q per element is that condition as soon as there are three elements: the stiffer such a weave, the
less the tube contracts. The paper's constraint is one q for the wall.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxmyo.compiler import QUICK
from jaxmyo.paper import exact_tube
from jaxmyo.paper.exact_tube import Muscle, Pair, Wall, Weave
from jaxmyo.paper.homogeneous import constants_as_arrays
from jaxmyo.paper.tube import (
    A_OVER_D,
    ENDS,
    GRADING,
    KINDS,
    T0_KPA,
    Kind,
    Walls,
    check,
    numbers,
    pressure,
    traced_cycle,
)
from jaxmyo.scene import Scene
from jaxmyo.scenes.tube import radial_tube

#: Elements through the wall.
MESHES = (4, 16)
#: Stiffness k of the weave [kPa]; its energy is ½ k h².
K_KPA = np.logspace(0.0, 6.0, 13)
#: The same for the exact solutions, with one q for the wall and with q at every radius.
LINE_KPA = np.logspace(0.0, 6.0, 49)
WEAVES: tuple[Weave, Weave] = ("uniform", "local")


@dataclass(frozen=True)
class SoftWeave:
    """States A and C at s = ½ for each stiffness `K_KPA`, one q per element, all converged; elements: in the wall."""

    elements: int
    A: Walls
    C: Walls

    def walls(self, kind: Kind) -> Walls:
        """The states A or C."""
        return self.A if kind == "A" else self.C


def soft_weave(constants: Any, elements: int) -> SoftWeave:
    """The tube of so many elements, each with its own q. A `SolveError` if one of the states is not found."""
    scene = radial_tube(elements, grading=GRADING, q_patches=np.arange(elements))
    found: tuple[Walls, Walls] = jax.tree.map(np.asarray, _states(constants_as_arrays(constants), K_KPA, scene=scene))
    for kind, walls in zip(KINDS, found, strict=True):
        check(walls, [f"{elements} elements, weave of {k:g} kPa, state {kind} at s = 0.5" for k in K_KPA])
    return SoftWeave(elements, *found)


@partial(jax.jit, static_argnames=("scene",), compiler_options=QUICK)
def _states(constants: Any, stiffness: Array, scene: Scene) -> tuple[Walls, Walls]:
    def one(k: Array) -> tuple[Walls, Walls]:
        found = traced_cycle(scene, ENDS, constants, A_OVER_D, k)
        return numbers(found.A).at(1), numbers(found.C).at(1)

    # One after the other: the states are small, and `vmap` would take longer to compile than they take to solve.
    return jax.lax.map(one, stiffness)


def lines(constants: Any, weave: Weave, without: Pair) -> list[Pair]:
    """The exact states at s = ½ for each stiffness `LINE_KPA`, from those without the constraint."""
    found, near = [], without
    for k in LINE_KPA:
        muscle = Muscle(constants, T0_KPA, 1.0, A_OVER_D, 1.0 / k)
        near = exact_tube.pair(muscle, weave, pressure(1.0), near)
        found.append(near)
    return found


def radii(states: list[Wall]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Inner and outer radii [mm] of exact states."""
    return np.array([wall.ri for wall in states]), np.array([wall.ro for wall in states])
