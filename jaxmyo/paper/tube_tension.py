"""The change of the tube's inner radius over the way up, for other beating tensions: from the exact solution.

T0 of the tube is not given in the paper, so what it says of the inner radius is tried over a range of tensions.
"""

from typing import Any, NamedTuple

import numpy as np

from jaxmyo.paper import exact_tube
from jaxmyo.paper.exact_tube import Muscle
from jaxmyo.paper.homogeneous import CONSTRAINT
from jaxmyo.paper.tube import A_OVER_D, T0_KPA, pressure
from jaxmyo.paper.tube_accuracy import Accuracy

TENSIONS_KPA = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0)
#: From one exact state to the next.
STEP_KPA = 1.0


class Change(NamedTuple):
    """Inner radius of state C at s = ½ less that at s = 0 [mm] at one T0 [kPa], with and without the constraint."""

    T0: float
    with_constraint: float
    without: float


def changes(constants: Any, accuracy: Accuracy) -> list[Change]:
    """For each of `TENSIONS_KPA`. At s = 0 the tube is passive and T0 plays no role. A `SolveError` as in `pair`."""
    by_case = []
    for acting, (rest, half) in zip(CONSTRAINT, accuracy.exact, strict=True):
        radii = {T0_KPA: half.C.ri}
        for end in (TENSIONS_KPA[0], TENSIONS_KPA[-1]):
            near = half
            for T0 in np.linspace(T0_KPA, end, 1 + round(abs(end - T0_KPA) / STEP_KPA))[1:]:
                muscle = Muscle(constants, T0, 1.0, A_OVER_D)
                near = exact_tube.pair(muscle, exact_tube.WEAVE[acting], pressure(1.0), near)
                radii[float(T0)] = near.C.ri
        by_case.append([radii[T0] - rest.C.ri for T0 in TENSIONS_KPA])
    return [Change(*row) for row in zip(TENSIONS_KPA, *by_case, strict=True)]
