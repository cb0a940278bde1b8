"""A fit: the estimates with their intervals, how well they fit, and what the data can tell of them."""

import warnings
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmyo import checks
from jaxmyo.fitting import uncertainty
from jaxmyo.fitting.least_squares import Found, Loss, check_loss, solve, values_of
from jaxmyo.fitting.problem import Problem
from jaxmyo.status import SolveError

#: Starts whose sum of squares is the least one, to this, got there [–].
SAME = 1e-6
#: A ratio of observed to predicted stresses that suggests another unit [–].
STRANGE = 50.0


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter: value, confidence interval, standard error (all in its unit), and whether data determine it.

    The standard error is to first order; the interval, which respects the bounds, is not symmetric where there are any.
    """

    value: float
    low: float
    high: float
    standard_error: float
    identifiable: bool
    unit: str

    def __str__(self) -> str:
        told = "" if self.identifiable else "  (not identifiable)"
        return f"{self.value:.6g} [{self.low:.4g}, {self.high:.4g}] {self.unit}{told}"


@dataclass(frozen=True, eq=False)
class Fit:
    """What `fit` found.

    problem; estimates: name → `Estimate`, of the free parameters; level: of the intervals [–]; found: the minimum in
    the free variables x, with residuals and Jacobian; local: covariance, correlations and combinations there; starts:
    of each start its end, `Found` with a leading axis; loss; seed, spread: of the random starts.
    """

    problem: Problem
    estimates: dict[str, Estimate]
    level: float
    found: Found
    local: uncertainty.Local
    starts: Found
    loss: Loss
    seed: int
    spread: float

    @property
    def values(self) -> dict[str, float]:
        """All parameters by name, the fitted and the fixed ones."""
        return {p.name: p.value for p in self.problem.parameters} | {n: e.value for n, e in self.estimates.items()}

    @property
    def residuals(self) -> NDArray[np.float64]:
        """Predicted less observed (n,), without weights [unit of the observations]; also where the weight is 0."""
        return np.asarray(self.found.predicted - self.problem.observed)

    @property
    def rms(self) -> float:
        """√(Σ w r² / Σ w) [unit of the observations]."""
        return _rms(self.residuals, self.problem.weight)

    def rms_of(self, group: str) -> float:
        """The same for the observations of one protocol, also one that was held out.

        SolveError where a state of it was not found, as may happen to one that was held out.
        """
        checks.choice("protocol", group, list(dict.fromkeys(self.problem.groups)))
        mine = np.array(self.problem.groups) == group
        if missed := int((~np.isfinite(self.residuals[mine])).sum()):
            raise SolveError(f"protocol {group!r}: {missed} of {mine.sum()} predictions were not found", self.found)
        weight = np.asarray(self.problem.weight)[mine]
        return _rms(self.residuals[mine], weight if weight.any() else np.ones_like(weight))

    @property
    def log_likelihood(self) -> float:
        """The largest ln L of Gaussian errors, with sd² = Σ w r² / n."""
        used = np.asarray(self.problem.weight)[np.asarray(self.problem.weight) > 0.0]
        sum_ = float(np.sum(self.problem.weight * np.nan_to_num(self.residuals) ** 2))
        n = self.problem.n
        least = max(sum_, np.finfo(float).tiny)
        return -0.5 * n * (np.log(2.0 * np.pi * least / n) + 1.0) + 0.5 * float(np.sum(np.log(used)))

    @property
    def aic(self) -> float:
        """Akaike's criterion 2 (k + 1) − 2 ln L; the lower of two models of the same data is the better one."""
        return 2.0 * (len(self.estimates) + 1) - 2.0 * self.log_likelihood

    @property
    def bic(self) -> float:
        """The Bayesian criterion (k + 1) ln n − 2 ln L; k + 1, for the standard deviation is estimated too."""
        return (len(self.estimates) + 1) * float(np.log(self.problem.n)) - 2.0 * self.log_likelihood

    @property
    def undetermined(self) -> list[dict[str, float]]:
        """The combinations of parameters that the data leave open, by name → coefficient.

        Of ln values where there are bounds, of relative changes elsewhere.
        """
        return uncertainty.undetermined(self.problem, self.local)

    @property
    def reached(self) -> int:
        """How many of the starts ended at this minimum."""
        sums = np.where(self.starts.converged, self.starts.sum, np.inf)
        return int((sums <= float(self.found.sum) * (1.0 + SAME) + 1e-20).sum())

    def profile(self, name: str, values: Any) -> NDArray[np.float64]:
        """√(Σ w r² / Σ w) (m,) of the best fits with a parameter held at values (m,); profile likelihood.

        NaN never: an error names a value at which a state was not found. `profile_limit` is what the level rejects.
        """
        i = list(self.problem.free).index(checks.choice("name", name, list(self.problem.free)))
        values = checks.concrete("values", values, (None,))
        at = [self.problem.fitted[i].x(float(v)) for v in values]
        found = [uncertainty.profiled(self.problem, self.found, self.loss, i, x) for x in at]
        for v, f in zip(values, found, strict=True):
            if not np.isfinite(f.predicted[np.asarray(self.problem.weight) > 0.0]).all():
                raise SolveError(f"profile: with {name} = {v:g} a state was not found", f)
        return np.sqrt(np.array([float(f.sum) for f in found]) / float(np.sum(self.problem.weight)))

    @property
    def profile_limit(self) -> float:
        """The profile above which a value is rejected at the level of the fit."""
        limit = uncertainty.threshold(self.problem, self.found, self.level)
        return float(np.sqrt(limit / np.sum(self.problem.weight)))

    def __str__(self) -> str:
        lines = [
            f"Fit of {len(self.estimates)} parameters to {self.problem.n} observations: rms {self.rms:.4g} "
            f"{self.problem.unit}, AIC {self.aic:.1f}, BIC {self.bic:.1f}"
        ]
        width = max(map(len, self.estimates))
        lines += [f"  {name:<{width}} = {e}" for name, e in self.estimates.items()]
        fixed = {p.name: p.value for p in self.problem.parameters if p.name not in self.estimates}
        if fixed:
            lines.append("  fixed: " + ", ".join(f"{n} = {v:g}" for n, v in fixed.items()))
        if len(self.starts.sum) > 1:
            lines.append(f"  {self.reached} of {len(self.starts.sum)} starts got there")
        for combination in self.undetermined:
            terms = " ".join(f"{c:+.2f} {n}" for n, c in combination.items())
            lines.append(f"  not determined: {terms} (of ln values where there are bounds, else of relative changes)")
        lines.append(f"  intervals: {100 * self.level:g} %, independent Gaussian errors")
        return "\n".join(lines)

    def as_json(self) -> dict[str, Any]:
        """Everything needed to repeat it; starts with {"estimates": ..., "rms": x, "identifiable": ...}."""
        p = self.problem
        packages = ("jaxmyo", "jax", "jaxlib", "numpy", "scipy", "optimistix")
        off, groups = self.residuals, np.array(p.groups)
        return {
            "estimates": {n: {"value": e.value, "low": e.low, "high": e.high} for n, e in self.estimates.items()},
            "rms": self.rms,
            "identifiable": {n: e.identifiable for n, e in self.estimates.items()},
            "unit": p.unit,
            "level": self.level,
            "converged": bool(self.found.converged),
            "standard_errors": {n: e.standard_error for n, e in self.estimates.items()},
            "correlation": self.local.correlation.tolist(),
            "undetermined": self.undetermined,
            "fixed": {q.name: q.value for q in p.parameters if q.name not in p.free},
            "start": {q.name: q.value for q in p.fitted},
            "bounds": {q.name: [b if np.isfinite(b) else None for b in (q.low, q.high)] for q in p.fitted},
            "rms_of": {
                g: None if np.isnan(off[g == groups]).any() else self.rms_of(g) for g in dict.fromkeys(p.groups)
            },
            "aic": self.aic,
            "bic": self.bic,
            "log_likelihood": self.log_likelihood,
            "loss": self.loss._asdict(),
            "starts": {"n": len(self.starts.sum), "reached": self.reached, "seed": self.seed, "spread": self.spread},
            "observed": p.observed.tolist(),
            "predicted": [float(v) if np.isfinite(v) else None for v in self.found.predicted],
            "weight": np.asarray(p.weight).tolist(),
            **dict(p.about or {}),
            "versions": {name: version(name) for name in packages},
        }


def fit(
    problem: Problem,
    *,
    starts: int = 1,
    spread: float = 1.0,
    seed: int = 0,
    loss: Loss | str = "linear",
    level: float = 0.95,
    profiles: bool = False,
    max_steps: int = 200,
) -> Fit:
    """Least squares by Levenberg–Marquardt, from the values of the problem and from starts − 1 random ones.

    All starts run as one vmapped call. spread: the standard deviation of the random starts in the free variables: of
    ln values where there is a bound, relative to the value elsewhere; loss: a name of `Loss`, or one with its scale;
    level: of the confidence intervals; profiles: intervals and identifiability of badly determined parameters from the
    profile likelihood, some tens of fits, instead of the Jacobian alone; max_steps: of each start.

    Errors: SolveError if no start ends with every state found; ValueError for values out of range. A UserWarning if
    the fit is the best that was found but no minimum, and if the observations are far from any prediction in size.
    """
    if int(starts) != starts or starts < 1:
        raise ValueError(f"starts = {starts} must be an integer ≥ 1")
    chosen = check_loss(Loss(loss) if isinstance(loss, str) else loss)
    if not 0.0 < level < 1.0:
        raise ValueError(f"level = {level} is outside (0, 1) (–, of the confidence intervals)")
    first = np.array([p.x(p.value) for p in problem.fitted])
    if starts == 1:
        one = solve(problem, first, chosen, max_steps=max_steps)
        every = Found(*(np.asarray(field)[None] for field in one))
    else:
        far = spread * np.random.default_rng(seed).normal(size=(starts - 1, len(first)))
        every = solve(problem, np.concatenate([first[None], first + far]), chosen, max_steps=max_steps)
    used = np.asarray(problem.weight) > 0.0
    complete = np.isfinite(every.predicted[:, used]).all(axis=1) & np.isfinite(every.sum)
    if not complete.any():
        raise SolveError(
            f"fit: no start of {starts} came to values at which every state is found. Start nearer, fix more "
            "parameters, give bounds, or take more starts",
            every,
        )
    best = int(np.argmin(np.where(complete, every.sum, np.inf)))
    found = Found(*(field[best] for field in every))
    if not found.converged:
        warnings.warn(
            f"fit: no minimum after {int(found.iterations)} steps; the values are the best that were found (more "
            "steps: max_steps; fewer free parameters)",
            stacklevel=2,
        )
    _check_size(problem, found)
    return described(problem, found, every, chosen, level, seed, spread, profiles)


def described(
    problem: Problem,
    found: Found,
    every: Found,
    loss: Loss,
    level: float,
    seed: int,
    spread: float,
    profiles: bool = False,
) -> Fit:
    """What a minimum tells; every: the ends of all starts; the rest as of `fit`."""
    local = uncertainty.local(problem, found)
    values = values_of(problem, found.x)
    intervals, told = uncertainty.intervals(problem, found, local.errors, loss, level, profiles)
    slopes = _slopes(problem, found.x)
    estimates = {
        name: Estimate(
            value=float(values[i]),
            low=float(intervals[i, 0]),
            high=float(intervals[i, 1]),
            standard_error=float(abs(slopes[i]) * local.errors[i]),
            identifiable=told[i],
            unit=problem.fitted[i].unit,
        )
        for i, name in enumerate(problem.free)
    }
    return Fit(problem, estimates, level, found, local, every, loss, seed, spread)


def _slopes(problem: Problem, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """d value / dx (k,), by central differences of a closed form."""
    h = 1e-6
    return (values_of(problem, x + h) - values_of(problem, x - h)) / (2.0 * h)


def held_out(problem: Problem, **options: Any) -> dict[str, Fit]:
    """For each protocol the fit without it; `rms_of(protocol)` is how well the others predict it (cross-validation).

    options: of `fit`. ValueError for a single protocol.
    """
    groups = list(dict.fromkeys(problem.groups))
    if len(groups) < 2:
        raise ValueError(f"held_out needs two protocols or more; there is {groups[0]!r} alone")
    return {g: fit(problem.without(g), **options) for g in groups}


def unfitted(problem: Problem) -> NDArray[np.float64]:
    """The predictions (n,) at the values of the problem, nothing fitted; NaN where a state was not found."""
    x = np.array([p.x(p.value) for p in problem.fitted])
    return np.asarray(solve(problem, x, held=np.ones(len(x), dtype=bool)).predicted)


def _rms(residuals: NDArray[np.float64], weight: Any) -> float:
    return float(np.sqrt(np.sum(weight * np.nan_to_num(residuals) ** 2) / np.sum(weight)))


def _check_size(problem: Problem, found: Found) -> None:
    """A warning for observations that are another size than every prediction: a unit that is wrong."""
    used = np.asarray(problem.weight) > 0.0
    observed, predicted = problem.observed[used], found.predicted[used]
    sizes = [float(np.sqrt(np.mean(v**2))) for v in (observed, predicted)]
    if min(sizes) > 0.0 and not 1.0 / STRANGE < sizes[0] / sizes[1] < STRANGE:
        warnings.warn(
            f"fit: the observations (rms {sizes[0]:.3g} {problem.unit}) are {sizes[0] / sizes[1]:.3g} times the fitted "
            "predictions. Is the unit right?",
            stacklevel=3,
        )
