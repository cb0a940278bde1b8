"""What the data can tell: standard errors, correlations, undetermined combinations, profiles.

Everything is taken in the free variables x of `parameters` (logarithms of what must be positive, relative sizes of the
rest), so that intervals respect the bounds. Errors are independent and Gaussian with the variance s²/weight,
s² = Σ w r²/(n − k); with a robust loss the residuals and derivatives are those through the loss, an approximation.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from jaxmyo.fitting.least_squares import Found, Loss, solve, values_of
from jaxmyo.fitting.parameters import EDGE
from jaxmyo.fitting.problem import Problem

#: A combination of the x is undetermined if its standard error is above this: a factor e, or 100 %.
UNDETERMINED = 1.0


@dataclass(frozen=True)
class Local:
    """The linearised problem at the estimate. k free parameters, n observations with a weight.

    sd: s [unit of the observations]; covariance: (k, k) of x; errors: (k,) standard errors of x; correlation: (k, k);
    combinations: (k, k), rows are orthonormal directions of x from the best determined to the worst (the right singular
    vectors of the Jacobian), spread: (k,) the standard error along each, inf where no observation depends on it.
    """

    sd: float
    covariance: NDArray[np.float64]
    errors: NDArray[np.float64]
    correlation: NDArray[np.float64]
    combinations: NDArray[np.float64]
    spread: NDArray[np.float64]


def units_of_x(problem: Problem, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """The x (k,) that one unit of the combinations is: 1 for a logarithm, the estimate (100 %) without bounds."""
    return np.array([max(abs(v), 0.1) if p.kind == "none" else 1.0 for p, v in zip(problem.fitted, x, strict=True)])


def local(problem: Problem, found: Found, variance: float | None = None) -> Local:
    """The uncertainty at a minimum, from the Jacobian there; variance: s², instead of that of the residuals."""
    k = len(problem.free)
    s2 = float(found.sum) / (problem.n - k) if variance is None else variance
    unit = units_of_x(problem, found.x)
    _, singular, rows = np.linalg.svd(found.jacobian * unit, full_matrices=False)
    least = 1e-12 * max(float(singular[0]), 1e-100)
    spread = np.where(singular > least, np.sqrt(s2) / np.maximum(singular, least), np.inf)
    large = np.where(np.isfinite(spread), spread, 1e12)  # what is not determined at all
    covariance = (unit[:, None] * rows.T * large**2) @ (rows * unit)
    errors = np.sqrt(np.diagonal(covariance))
    outer = np.maximum(errors[:, None] * errors, np.finfo(float).tiny)
    correlation = np.clip(covariance / outer, -1.0, 1.0)
    np.fill_diagonal(correlation, 1.0)
    return Local(float(np.sqrt(s2)), covariance, errors, correlation, rows, spread)


def undetermined(problem: Problem, at: Local) -> list[dict[str, float]]:
    """The combinations of parameters that the data do not determine, as coefficients of ln or relative changes."""
    rows = at.combinations[at.spread > UNDETERMINED]
    return [{name: float(c) for name, c in zip(problem.free, row, strict=True) if abs(c) > 0.05} for row in rows]


def wald(problem: Problem, x: NDArray[np.float64], errors: NDArray[np.float64], level: float) -> NDArray[np.float64]:
    """Confidence intervals (k, 2) of the values: x ± t · standard error, taken back to the values."""
    t = float(stats.t.ppf(0.5 + 0.5 * level, problem.n - len(problem.free)))
    ends = np.sort(np.stack([values_of(problem, x + side * t * errors) for side in (-1.0, 1.0)], axis=1), axis=1)
    for i, p in enumerate(problem.fitted):  # what came to a bound is there
        beside = EDGE.get(p.kind, np.inf)
        span = np.exp(-beside) * (p.high - p.low if p.kind == "both" else p.scale)
        ends[i, 0] = p.low if ends[i, 0] - p.low <= 1.01 * span else ends[i, 0]
        ends[i, 1] = p.high if p.high - ends[i, 1] <= 1.01 * span or ends[i, 1] > 1e100 else ends[i, 1]
    return ends


def threshold(problem: Problem, found: Found, level: float) -> float:
    """The sum of squares above which a value is rejected: (1 + F/(n − k)) of the least one, likelihood ratio."""
    dof = problem.n - len(problem.free)
    return float(found.sum) * (1.0 + float(stats.f.ppf(level, 1, dof)) / dof)


def profiled(problem: Problem, found: Found, loss: Loss, i: int, x: float) -> Found:
    """The best fit with the i-th free variable held at x, from the estimate of the others.

    Where a state is not found, the sum of squares is of the others and of what stands for it, far above.
    """
    at, held = np.array(found.x), np.arange(len(found.x)) == i
    at[i] = x
    return solve(problem, at, loss, held=held)


def intervals(
    problem: Problem, found: Found, errors: NDArray[np.float64], loss: Loss, level: float, profiles: bool
) -> tuple[NDArray[np.float64], list[bool]]:
    """Confidence intervals (k, 2) of the values, and whether the data tell each apart from both ends of `far`.

    Those from the Jacobian are good enough where they are far inside of `Parameter.far`. Elsewhere, with profiles, the
    parameter is held at that end and the others are fitted again (profile likelihood, Raue et al. 2009): if the data
    reject the end at the level, the interval ends where the profile crosses the threshold. Where the end is not
    rejected (or, without profiles, is inside the interval) the interval ends at the bound, or at `far`, and the
    parameter is not identifiable.
    """
    limit = threshold(problem, found, level)
    estimates, ends = values_of(problem, found.x), wald(problem, found.x, errors, level)
    told = np.ones(ends.shape, dtype=bool)
    for i, p in enumerate(problem.fitted):
        for side, far in enumerate(p.far(estimates[i])):
            reach, way = abs(_x_inside(p, ends[i, side]) - found.x[i]), abs(p.x(far) - found.x[i])
            if way > 3.0 * reach:
                continue
            beyond = (far - estimates[i]) * (1 if side else -1) <= 0.0  # the estimate has come to its bound
            if profiles:
                told[i, side] = not beyond and profiled(problem, found, loss, i, p.x(far)).sum > limit
                if told[i, side]:
                    ends[i, side] = _crossing(problem, found, loss, i, p.x(far), limit)
            else:
                told[i, side] = not beyond and way > reach
            if not told[i, side]:
                bound = (p.low, p.high)[side]
                ends[i, side] = bound if np.isfinite(bound) else far
    return ends, [bool(low and high) for low, high in told]


def _crossing(problem: Problem, found: Found, loss: Loss, i: int, far: float, limit: float) -> float:
    """The value between the estimate and a rejected x where the profile is at the limit, to 2 % of it in √(S − S0).

    By regula falsi (Illinois) for √(S − S0) by the value, a straight line where the profile is a parabola; by x, what
    came to a bound is far away. Each fit starts from the last one that was not rejected.
    """
    least, near = float(found.sum), found
    goal = float(np.sqrt(limit - least))

    def height(fitted: Found) -> float:
        return float(np.sqrt(max(float(fitted.sum) - least, 0.0))) - goal

    end = np.array(found.x)
    end[i] = far
    inner, outer = (float(values_of(problem, x)[i]) for x in (found.x, end))
    below, above, last = -goal, height(profiled(problem, found, loss, i, far)), 0.0
    for _ in range(40):
        value = inner + (outer - inner) * float(np.clip(below / (below - above), 0.05, 0.95))
        fitted = profiled(problem, near, loss, i, problem.fitted[i].x(value))
        off = height(fitted)
        if abs(off) < 0.02 * goal:
            return value
        if off < 0.0:
            inner, below, near = value, off, fitted
            above *= 0.5 if last < 0.0 else 1.0
        else:
            outer, above = value, off
            below *= 0.5 if last > 0.0 else 1.0
        last = off
    return outer  # which the data reject


def _x_inside(p: Any, value: float) -> float:
    """x of a value that may be on a bound."""
    return p.x(value) if p.low < value < p.high else np.inf
