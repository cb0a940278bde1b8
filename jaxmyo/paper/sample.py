"""The thin sample of the paper: free contraction over the cycle, and uniaxial tests (its figures 'free' and 'uni')."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxmyo.compiler import QUICK
from jaxmyo.conditions import Stretch
from jaxmyo.paper.homogeneous import (
    CONSTRAINT,
    Point,
    constants_as_arrays,
    contractions,
    join,
    point,
    solved,
    worst,
)
from jaxmyo.solve import load
from jaxmyo.state import State

T0_KPA = 35.0
A_OVER_D = 0.2
#: Times s of the cycle [–]; β(s) = sin² πs.
S = np.linspace(0.0, 1.0, 41)
#: Index of s = ½, full activation, and of s = 0, no activation.
HALF, REST = 20, 0
#: The uniaxial tests end at this stretch; they begin at the stretch of state A, or at 1 if that is larger.
LAST_STRETCH = 1.3
N_STRETCHES = 61
#: The directions and the activations of the uniaxial tests, in the order of the arrays.
DIRECTIONS = ("f", "cf")
BETAS = (1.0, 0.0)


def activation(s: NDArray[np.float64]) -> NDArray[np.float64]:
    """β(s) = sin² πs [–]."""
    return np.asarray(np.sin(np.pi * s) ** 2)


@dataclass(frozen=True)
class Sample:
    """The states behind the two figures of the sample, all converged; T0 = 35 kPa, a/D = 0.2.

    free: (2, 41) states A, with and without the constraint, at the times `S`; uniaxial: (2, 2, 2, 61) states C by
    direction (f, cf), with and without the constraint, β (1, 0) and stretch; residual: the largest relative one.
    """

    free: Point
    uniaxial: Point
    residual: float

    @property
    def stretch(self) -> NDArray[np.float64]:
        """The stretch [–] in the direction of the uniaxial test, (2, 2, 2, 61)."""
        return np.stack([self.uniaxial.stretches[i, ..., i] for i in range(len(DIRECTIONS))])

    @property
    def stress(self) -> NDArray[np.float64]:
        """The Cauchy stress [kPa] in the direction of the uniaxial test, (2, 2, 2, 61)."""
        return np.stack([self.uniaxial.sigma[i, ..., i] for i in range(len(DIRECTIONS))])

    @property
    def unstable(self) -> NDArray[np.bool_]:
        """Which states of the uniaxial tests are unstable equilibria, (2, 2, 2, 61)."""
        return np.asarray(self.uniaxial.negative > 0)


def sample(constants: Any) -> Sample:
    """The free contraction and the uniaxial tests with a set of constants of the Lin–Yin law, as batched solves.

    A `SolveError` if one of the states is not found.
    """
    n = len(S)
    A = contractions(constants_as_arrays(constants), np.full(n, T0_KPA), np.full(n, A_OVER_D), activation(S))
    free, uniaxial = _states(A)
    kinds = ["with the constraint" if c else "without the constraint" for c in CONSTRAINT]
    of_free = [f"state A at s = {s:g} {kind}" for kind in kinds for s in S]
    of_uniaxial = [
        f"state C at beta = {beta:g} {kind}, point {k + 1} of {N_STRETCHES} of the uniaxial test along {direction}"
        for direction in DIRECTIONS
        for kind in kinds
        for beta in BETAS
        for k in range(N_STRETCHES)
    ]
    free = solved(free, of_free).shaped(2, len(S))
    uniaxial = solved(uniaxial, of_uniaxial).shaped(2, 2, 2, N_STRETCHES)
    return Sample(free, uniaxial, worst(free, uniaxial))


@partial(jax.jit, compiler_options=QUICK)
def _states(free: State) -> tuple[Point, Point]:
    """States A: constraint × β; states C: direction × constraint × (β = 1, 0) × stretch; each as one leading axis."""
    n = len(S)
    # Each of the four contractions that the tests start from, once per stretch.
    starts = np.repeat([HALF, REST, n + HALF, n + REST], N_STRETCHES)
    start = jax.tree.map(lambda leaf: leaf[starts], free)
    way = jnp.tile(jnp.linspace(0.0, 1.0, N_STRETCHES), 4)

    def test(axis: str) -> Point:
        first = jnp.minimum(jax.vmap(lambda A: A.stretches[0, 0, "xyz".index(axis)])(start), 1.0)
        stretches = first + (LAST_STRETCH - first) * way
        return jax.vmap(lambda A, stretch: point(load(A, Stretch(axis, stretch), throw=False)))(start, stretches)

    return jax.vmap(point)(free), join(test("x"), test("y"))
