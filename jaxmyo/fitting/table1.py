"""Table 1 of the paper as data: which constants was it computed with?

The 40 printed entries (20 ratios σ22/σ11 [%], 20 stresses σ22 [kPa]) are the observations, all 8 constants are free.
Errors are not Gaussian but of rounding to two decimals, so that the intervals come from linear programs: the values for
which no entry is further from its printed number than rounding (or than the best fit leaves) allows.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray
from scipy.optimize import linprog

from jaxmyo.conditions import Stretch
from jaxmyo.constants import PRINTED, LinYin
from jaxmyo.fitting.fit import Fit
from jaxmyo.fitting.least_squares import values_of
from jaxmyo.fitting.parameters import parameters_of
from jaxmyo.fitting.problem import Problem
from jaxmyo.paper.homogeneous import SAMPLE, join, without_q
from jaxmyo.paper.table1 import A_OVER_D, PRINTED_RATIO_PERCENT, PRINTED_SIGMA22_KPA, STRETCH, T0_KPA
from jaxmyo.solve import contract, load
from jaxmyo.state import State

#: Half a unit of the last printed digit [% or kPa].
ROUNDING = 0.005


def table1_problem(start: LinYin = PRINTED) -> Problem:
    """The fit of the constants of the Lin–Yin law to the 40 entries, from the constants that the paper prints."""
    values = {name: float(v) for name, v in vars(start).items()}
    observed = np.concatenate([np.ravel(PRINTED_RATIO_PERCENT), np.ravel(PRINTED_SIGMA22_KPA)])
    n = observed.size // 2
    return Problem(
        _entries,
        observed,
        parameters_of(values, {}, {}),
        tuple(values),
        groups=("ratio",) * n + ("sigma22",) * n,
        unit="% or kPa",
        about={"law": "lin_yin", "data": "Table 1 of the paper, ratios then stresses, rows a/D then none"},
    )


def _entries(values: Mapping[str, Array]) -> Array:
    """The 40 entries [%, kPa], in the order of the printed table; NaN where a state was not found."""
    constants = LinYin(**values)
    cases = [(a, T0) for a in A_OVER_D if a is not None for T0 in T0_KPA]

    def acting(a_over_D: Array, T0: Array) -> State:
        return contract(SAMPLE, T0=T0, a_over_D=a_over_D, constants=constants, throw=False)

    def absent(T0: Array) -> State:
        return contract(SAMPLE, T0=T0, a_over_D=None, constants=constants, throw=False)

    without = jax.vmap(absent)(jnp.array(T0_KPA))
    woven = jax.vmap(lambda a, T0: without_q(acting(a, T0)))(*jnp.array(cases).T)
    A = join(_with_system(woven, without, len(cases)), without)

    def entry(A: State) -> Array:
        C = load(A, Stretch("x", STRETCH), Stretch("y", STRETCH), throw=False)
        sigma = jnp.diagonal(C.mean("cauchy"))
        return jnp.where(C.converged, jnp.stack([100.0 * sigma[1] / sigma[0], sigma[1]]), jnp.nan)

    return jax.vmap(entry)(A).T.reshape(-1)


def _with_system(woven: State, without: State, n: int) -> State:
    return replace(woven, system=jax.tree.map(lambda leaf: jnp.repeat(leaf[:1], n, axis=0), without.system))


def rounding_intervals(found: Fit) -> tuple[dict[str, tuple[float, float]], float]:
    """name → (low, high) of the constants that print the same table, and the distance [% or kPa] that is allowed.

    Linear programs around the estimate: |r + J dx| ≤ allowed for every entry, with the least that any values reach, or
    the rounding `ROUNDING` where that is more (the least that fits may be above it, by a misprint for example).
    """
    r, J, k = found.residuals, np.asarray(found.found.jacobian), len(found.estimates)
    unit = np.maximum(np.abs(J).max(axis=0), 1e-12)
    J = J / unit

    def program(cost: NDArray[np.float64], allowed: float | None) -> Any:
        """Minimise cost · (dx, t) subject to |r + J dx| ≤ t, t fixed where a distance is allowed."""
        ones = np.ones((len(r), 1))
        rows = np.block([[J, -ones], [-J, -ones]])
        bounds = [(None, None)] * k + [(0.0, None) if allowed is None else (allowed, allowed)]
        solved = linprog(cost, A_ub=rows, b_ub=np.concatenate([-r, r]), bounds=bounds)
        if not solved.success:
            raise RuntimeError(f"the interval of rounding was not found: {solved.message}")
        return solved.x

    least = float(program(np.append(np.zeros(k), 1.0), None)[-1])
    allowed = max(ROUNDING, least * (1.0 + 1e-6))
    intervals = {}
    for i, name in enumerate(found.estimates):
        ends = []
        for sign in (1.0, -1.0):
            dx = program(sign * np.eye(k + 1)[i], allowed)[:k] / unit
            ends.append(float(values_of(found.problem, found.found.x + dx)[i]))
        intervals[name] = (min(ends), max(ends))
    return intervals, allowed
