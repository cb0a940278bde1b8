"""How far the elements are from the exact tube: raw, and extrapolated from nested meshes.

The error of the nodes of Q1–Q0 elements on meshes of one family has an expansion in h²; the polynomial in h² through
the results of three meshes, read off at h = 0, is Richardson's extrapolation.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmyo.extrapolation import neville
from jaxmyo.hexahedron import gauss
from jaxmyo.paper import exact_tube
from jaxmyo.paper.exact_tube import Muscle, Pair, Wall
from jaxmyo.paper.homogeneous import CONSTRAINT
from jaxmyo.paper.sample import activation
from jaxmyo.paper.tube import A_OVER_D, ELEMENTS, ENDS, KINDS, T0_KPA, Kind, Tube, Walls, pressure
from jaxmyo.scenes.tube import RI

#: Elements through the wall, each mesh nested in the next.
MESHES = (ELEMENTS // 2, ELEMENTS, 2 * ELEMENTS)
#: "In all the cases the L2 norm of the error is less than" this.
PAPER_ERROR = 1e-9


@dataclass(frozen=True)
class Accuracy:
    """Relative L2 errors [–] of the radii through the wall, of the states A and C at s = 0 and s = ½.

    tubes: on the meshes, from coarse to fine; exact: constraint × (s = 0, ½) the exact states;
    raw: mesh × kind × constraint × (s = 0, ½), of the elements as they are: the integral over the wall;
    extrapolated: kind × constraint × (s = 0, ½), of the radii at h = 0: the mean over the nodes of the coarsest mesh.
    """

    tubes: Sequence[Tube]
    exact: list[list[Pair]]
    raw: NDArray[np.float64]
    extrapolated: NDArray[np.float64]

    @property
    def orders(self) -> NDArray[np.float64]:
        """Observed orders of convergence at s = ½ between successive meshes: (meshes − 1) × kind × constraint."""
        steps = np.diff(np.log([tube.elements for tube in self.tubes]))
        return np.asarray(-np.diff(np.log(self.raw[..., 1]), axis=0) / steps[:, None, None])


def accuracy(constants: Any, tubes: Sequence[Tube]) -> Accuracy:
    """The errors on nested meshes, given from coarse to fine. A `SolveError` where no exact state is found."""
    cases = [(c, end) for c in range(len(CONSTRAINT)) for end in range(len(ENDS))]
    exact = [_exact(constants, tubes[-1], *case) for case in cases]
    limits = [extrapolate(kind, tubes) for kind in KINDS]
    R = tubes[0].R
    raw = [
        l2_error(tube.R, tube.walls(kind).r[c, tube.ends[end]], pair.of(kind))
        for tube in tubes
        for kind in KINDS
        for (c, end), pair in zip(cases, exact, strict=True)
    ]
    extrapolated = [
        nodal_error(limit[c, end], pair.of(kind).r(R))
        for kind, limit in zip(KINDS, limits, strict=True)
        for (c, end), pair in zip(cases, exact, strict=True)
    ]
    shape = (len(KINDS), len(CONSTRAINT), len(ENDS))
    by_case = [exact[: len(ENDS)], exact[len(ENDS) :]]
    return Accuracy(tubes, by_case, np.reshape(raw, (len(tubes), *shape)), np.reshape(extrapolated, shape))


def _exact(constants: Any, tube: Tube, constraint: int, end: int) -> Pair:
    """The exact states next to those of the elements."""
    near = Pair(*(_as_exact(tube.walls(kind).at(constraint, tube.ends[end])) for kind in KINDS))
    weave = exact_tube.WEAVE[CONSTRAINT[constraint]]
    beta = float(activation(ENDS[end]))
    muscle = Muscle(constants, T0_KPA, beta, A_OVER_D)
    if beta == 0.0:  # without activation a free tube is at rest, and its tangent there is singular
        near = near._replace(A=Wall(RI, 1.0))
        return near._replace(C=exact_tube.inflate(near.A, muscle, weave, pressure(beta), near.C))
    return exact_tube.pair(muscle, weave, pressure(beta), near)


def _as_exact(wall: Walls) -> Wall:
    return Wall(float(wall.ri), float(wall.height), float(wall.q))


def l2_error(R: NDArray[np.float64], r: NDArray[np.float64], wall: Wall) -> float:
    """‖r_h − r‖ / ‖r‖ over the wall, r_h linear in each element; R, r (n + 1,) at the nodes [mm]."""
    xi, w = gauss(4)
    share = 0.5 * (1.0 + xi[:, 0])
    at = R[:-1, None] + np.diff(R)[:, None] * share
    r_h = r[:-1, None] + np.diff(r)[:, None] * share
    weight = np.diff(R)[:, None] * w * at
    true = wall.r(at)
    return float(np.sqrt(np.sum(weight * (r_h - true) ** 2) / np.sum(weight * true**2)))


def nodal_error(r: NDArray[np.float64], exact: NDArray[np.float64]) -> float:
    """‖r − exact‖ / ‖exact‖ of values at nodes."""
    return float(np.linalg.norm(r - exact) / np.linalg.norm(exact))


def extrapolate(kind: Kind, tubes: Sequence[Tube]) -> NDArray[np.float64]:
    """Radii at h = 0 at the nodes of the coarsest mesh: constraint × (s = 0, ½) × node [mm]; Neville's scheme."""
    nested = [tube.elements // tubes[0].elements for tube in tubes]
    values = [tube.walls(kind).r[:, tube.ends, ::every] for tube, every in zip(tubes, nested, strict=True)]
    return neville(values, [1.0 / tube.elements for tube in tubes])
