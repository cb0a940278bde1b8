"""Random problems of the thin sample and the radial tube over the extremes of what may be asked.

T0 ∈ [0, 500] kPa, a/D ∈ [0, ¼], β ∈ [0, 1], stretches ∈ [0.4, 2.5], pressures ∈ [0, 60] kPa, walls from Ri/(Ro − Ri) =
1000 to 1e-4, each of the three sets of constants with its moduli times 10^±6. Half of the problems are of the
measured size of the constants, half of them are of a small T0, and some of 0: what people mostly ask is not to be lost
among the extremes. Seeds are fixed: the same problems each time.
"""

from dataclasses import astuple
from typing import NamedTuple

import numpy as np

from jaxmyo.constants import SETS
from jaxmyo.stability.independent import Array

#: Elements through the wall of the random tubes.
WALL = 2
#: Which constants are moduli, in kPa: all but the exponents of Q.
MODULI = np.array([1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0])


class Problems(NamedTuple):
    """A batch of n problems. constants: (n, 8); scale: (n,) log10 of the factor of the moduli; T0, beta, a_over_D (n,).

    target: (n, 2) prescribed stretches along and across the fibres of a sample, (n, 1) inner pressure [kPa] of a tube;
    R: (n, m + 1) radii of a tube's nodes [mm], H: (n,) height [mm].
    """

    constants: Array
    scale: Array
    T0: Array
    beta: Array
    a_over_D: Array
    target: Array
    R: Array
    H: Array


def draw(kind: str, n: int, seed: int) -> Problems:
    """n random problems of a kind, "sample" or "tube"."""
    rng = np.random.default_rng([seed, n, len(kind)])
    sets = np.array([astuple(c) for c in SETS.values()], dtype=float)
    scale = np.where(rng.random(n) < 0.5, 0.0, rng.uniform(-6.0, 6.0, n))
    constants = sets[rng.integers(len(sets), size=n)] * np.where(MODULI > 0.0, 10.0 ** scale[:, None], 1.0)
    T0 = np.where(rng.random(n) < 0.5, 10.0 ** rng.uniform(-3.0, np.log10(500.0), n), rng.uniform(0.0, 500.0, n))
    T0[rng.random(n) < 0.03] = 0.0
    beta = np.where(rng.random(n) < 0.3, 1.0, rng.uniform(0.0, 1.0, n))
    beta[rng.random(n) < 0.03] = 0.0
    a_over_D = rng.uniform(0.0, 0.25, n)
    edge = rng.random(n)
    a_over_D[edge < 0.04], a_over_D[edge > 0.96] = 0.0, 0.25
    if kind == "sample":
        target = rng.uniform(0.4, 2.5, (n, 2))
        target[rng.random(n) < 0.3] = rng.uniform(0.8, 1.3, 2)
        return Problems(constants, scale, T0, beta, a_over_D, target, np.zeros((n, 0)), np.ones(n))
    pressure = np.where(rng.random(n) < 0.5, rng.uniform(0.0, 60.0, n), 10.0 ** rng.uniform(-2.0, np.log10(60.0), n))
    thickness = 10.0 ** np.where(rng.random(n) < 0.5, rng.uniform(-3.0, 0.0, n), rng.uniform(-1.0, 4.0, n))
    Ri = 2.0 * np.minimum(1.0, 1.0 / thickness)
    R = Ri[:, None] * (1.0 + thickness[:, None] * np.linspace(0.0, 1.0, WALL + 1))
    return Problems(constants, scale, T0, beta, a_over_D, pressure[:, None], R, np.full(n, 20.0))
