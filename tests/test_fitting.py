"""Fits of small closed-form problems: bounds, losses, starts, what can be told, and what is refused."""

import json
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from jaxmyo import fitting
from jaxmyo.fitting import Loss, Parameter, Problem
from jaxmyo.fitting.least_squares import solve
from jaxmyo.status import SolveError

T = np.linspace(0.0, 2.0, 21)
TRUTH = {"a": 3.0, "rate": 1.2, "shift": -0.5}


def decay(values: dict[str, Any]) -> Any:
    return values["a"] * jnp.exp(-values["rate"] * T) + values["shift"]


def line(values: dict[str, Any]) -> Any:
    return values["a"] + values["b"] * T


def problem(noise: float = 0.0, seed: int = 0, **options: Any) -> Problem:
    truth = np.asarray(decay(TRUTH))
    observed = truth + noise * np.random.default_rng(seed).normal(size=T.size)
    parameters = (Parameter("a", 1.0, 0.0), Parameter("rate", 0.5, 0.0, 10.0), Parameter("shift", 1.0))
    return Problem(decay, observed, parameters, ("a", "rate", "shift"), **options)


def straight(noise: float = 0.1) -> Problem:
    observed = 1.0 + 2.0 * T + noise * np.random.default_rng(1).normal(size=T.size)
    return Problem(line, observed, (Parameter("a", 0.5), Parameter("b", 1.0)), ("a", "b"))


@pytest.mark.parametrize("staged", [True, False])
def test_noise_free_data_give_the_truth_back(staged: bool) -> None:
    found = fitting.fit(problem(staged=staged))
    for name, value in TRUTH.items():
        assert abs(found.estimates[name].value - value) < 1e-7
        assert found.estimates[name].identifiable
    assert found.rms < 1e-9


def test_a_line_as_in_the_textbook() -> None:
    """Estimates, standard errors, intervals, correlation, AIC and BIC of linear regression."""
    p = straight()
    found = fitting.fit(p)
    exact = stats.linregress(T, p.observed)
    b, a = found.estimates["b"], found.estimates["a"]
    np.testing.assert_allclose([b.value, a.value], [exact.slope, exact.intercept], rtol=1e-6)
    np.testing.assert_allclose([b.standard_error, a.standard_error], [exact.stderr, exact.intercept_stderr], rtol=1e-6)
    half = stats.t.ppf(0.975, T.size - 2) * exact.stderr
    np.testing.assert_allclose([b.low, b.high], [exact.slope - half, exact.slope + half], rtol=1e-6)
    X = np.stack([np.ones_like(T), T], axis=1)
    cov = np.linalg.inv(X.T @ X)
    np.testing.assert_allclose(found.local.correlation[0, 1], cov[0, 1] / np.sqrt(cov[0, 0] * cov[1, 1]), rtol=1e-6)
    r = p.observed - exact.intercept - exact.slope * T
    sd = np.sqrt(np.mean(r**2))
    log_l = stats.norm.logpdf(r, scale=sd).sum()
    np.testing.assert_allclose(found.log_likelihood, log_l, rtol=1e-9)
    np.testing.assert_allclose([found.aic, found.bic], [6 - 2 * log_l, 3 * np.log(T.size) - 2 * log_l], rtol=1e-9)
    given = fitting.log_likelihood(p, {n: e.value for n, e in found.estimates.items()}, sd)
    np.testing.assert_allclose(given, log_l, rtol=1e-9)
    # The profile of a linear problem is exact: the interval ends where it crosses its limit.
    np.testing.assert_allclose(found.profile("b", [b.low, b.high]), found.profile_limit, rtol=1e-6)


def test_the_likelihood_is_a_pure_function() -> None:
    p = problem(0.1)

    def of(theta: Any) -> Any:
        return fitting.log_likelihood(p, {"a": theta[0], "rate": theta[1]}, jnp.exp(theta[2]))

    at = jnp.array([2.0, 1.0, -1.0])
    gradient = jax.jit(jax.grad(of))(at)
    h = 1e-5
    central = [(of(at + h * e) - of(at - h * e)) / (2 * h) for e in jnp.eye(3)]
    np.testing.assert_allclose(gradient, central, rtol=1e-7)
    values = jax.vmap(of)(jnp.stack([at, at.at[1].set(11.0)]))
    assert jnp.isfinite(values[0])
    assert values[1] == -jnp.inf  # rate beyond its bound


def test_weights_and_held_out_groups() -> None:
    p = problem(0.05, groups=("early",) * 10 + ("late",) * 11)
    doubled = Problem(
        lambda v: jnp.concatenate([decay(v), decay(v)]), np.tile(p.observed, 2), p.parameters, p.free,
    )  # fmt: skip
    weighted = Problem(decay, p.observed, p.parameters, p.free, np.full(T.size, 2.0))
    a, b, c = (fitting.fit(q) for q in (p, doubled, weighted))
    for name in TRUTH:
        np.testing.assert_allclose(b.estimates[name].value, a.estimates[name].value, rtol=1e-5)
        np.testing.assert_allclose(c.estimates[name].value, a.estimates[name].value, rtol=1e-5)
        # A common weight is only another unit of variance.
        np.testing.assert_allclose(c.estimates[name].standard_error, a.estimates[name].standard_error, rtol=1e-4)
    out = fitting.held_out(p)
    assert set(out) == {"early", "late"}
    without = Problem(lambda v: decay(v)[10:], p.observed[10:], p.parameters, p.free)
    np.testing.assert_allclose(out["early"].rms, fitting.fit(without).rms, rtol=1e-6)
    assert out["early"].problem.n == 11
    assert out["early"].rms_of("early") > out["early"].rms_of("late")


@pytest.mark.parametrize("loss", ["soft_l1", "huber", "cauchy"])
def test_robust_losses_are_those_of_scipy(loss: str) -> None:
    from scipy.optimize import least_squares

    p = problem(0.02)
    observed = p.observed.copy()
    observed[[3, 8]] += 4.0  # outliers
    p = Problem(decay, observed, p.parameters, p.free)
    found = fitting.fit(p, loss=Loss(loss, 0.1))
    with np.errstate(over="ignore"):
        peer = least_squares(
            lambda y: np.asarray(decay(dict(zip(TRUTH, y, strict=True)))) - observed, list(TRUTH.values()), loss=loss,
            f_scale=0.1, xtol=1e-12, ftol=1e-14, gtol=1e-12,
        )  # fmt: skip
    np.testing.assert_allclose([e.value for e in found.estimates.values()], peer.x, rtol=2e-4)
    assert abs(found.estimates["a"].value - 3.0) < 0.1 < abs(fitting.fit(p).estimates["a"].value - 3.0)


def test_starts_in_one_call() -> None:
    """A function with several minima: the best is found, and the starts that got there are counted."""

    def wave(values: dict[str, Any]) -> Any:
        return jnp.sin(values["w"] * T)

    p = Problem(wave, np.sin(5.0 * T), (Parameter("w", 1.0, 0.0, 20.0),), ("w",))
    alone = fitting.fit(p)
    many = fitting.fit(p, starts=40, spread=2.0)
    assert alone.rms > 0.1
    assert abs(many.estimates["w"].value - 5.0) < 1e-7
    assert 1 <= many.reached < 40
    assert len(many.starts.sum) == 40
    again = fitting.fit(p, starts=40, spread=2.0)
    np.testing.assert_array_equal(many.starts.x, again.starts.x)


def test_what_cannot_be_told() -> None:
    """a · b alone is in the data: the undetermined combination is ln a − ln b, and the intervals do not pretend."""

    def product(values: dict[str, Any]) -> Any:
        return values["a"] * values["b"] * T + values["c"]

    observed = 2.0 * T + 1.0 + 0.01 * np.random.default_rng(0).normal(size=T.size)
    parameters = (Parameter("a", 1.0, 0.0), Parameter("b", 1.5, 0.0), Parameter("c", 0.5))
    found = fitting.fit(Problem(product, observed, parameters, ("a", "b", "c")), profiles=True)
    assert [e.identifiable for e in found.estimates.values()] == [False, False, True]
    (combination,) = found.undetermined
    np.testing.assert_allclose(abs(combination["a"] - combination["b"]), np.sqrt(2.0), rtol=1e-3)
    a, b = found.estimates["a"], found.estimates["b"]
    assert abs(a.value * b.value - 2.0) < 0.02
    assert a.low <= 0.11 * a.value
    assert a.high >= 9.0 * a.value
    assert "not determined" in str(found)


def test_a_parameter_that_runs_to_its_bound() -> None:
    p = Problem(
        line, -1.0 + 2.0 * T + 0.1 * np.sin(9.0 * T), (Parameter("a", 1.0, 0.0), Parameter("b", 1.0)), ("a", "b")
    )
    found = fitting.fit(p, profiles=True)
    a = found.estimates["a"]
    assert 0.0 <= a.value < 1e-8
    assert (a.low, a.identifiable) == (0.0, False)
    assert 0.0 < a.high < 0.2  # of the profile
    part = (found.profile("a", [a.high]) ** 2 - found.rms**2) / (found.profile_limit**2 - found.rms**2)
    np.testing.assert_allclose(np.sqrt(part), 1.0, atol=0.021)


def test_states_that_are_not_found() -> None:
    """NaN predictions push the optimiser back, and never reach the result; where there is nothing else, an error."""

    def partial(values: dict[str, Any]) -> Any:
        return jnp.where(values["a"] < 3.5, line(values), jnp.nan)

    p = straight()
    parameters = (Parameter("a", 3.4), Parameter("b", -1.0))
    found = fitting.fit(Problem(partial, p.observed, parameters, ("a", "b")))
    np.testing.assert_allclose(found.values["a"], fitting.fit(p).values["a"], rtol=1e-6)
    with pytest.raises(SolveError, match="no start of 1 came to values at which every state is found"):
        fitting.fit(Problem(partial, p.observed, (Parameter("a", 5.0), Parameter("b", -1.0)), ("a", "b")))
    out = fitting.log_likelihood(Problem(partial, p.observed, parameters, ("a", "b")), {"a": 4.0}, 1.0)
    assert out == -jnp.inf
    held = Problem(
        lambda v: line(v) + np.where(T < 1.05, 0.0, np.nan),
        p.observed,
        p.parameters,
        p.free,
        groups=("a",) * 11 + ("b",) * 10,
    )
    found = fitting.fit(held.without("b"))
    with pytest.raises(SolveError, match="protocol 'b': 10 of 10 predictions were not found"):
        found.rms_of("b")
    assert json.loads(json.dumps(found.as_json(), allow_nan=False))["rms_of"] == {"a": found.rms_of("a"), "b": None}


def test_descent_by_optax() -> None:
    p = problem(0.05)
    exact = fitting.fit(p)
    whole = fitting.descend(p, steps=800)
    drawn = fitting.descend(p, steps=800, batch=7)
    assert whole.rms < exact.rms * (1.0 + 1e-4)
    assert drawn.rms < exact.rms * 1.1
    with pytest.raises(ValueError, match=r"batch = 22 is outside \[1, 21\]"):
        fitting.descend(p, batch=22)


def test_as_json() -> None:
    p = problem(0.05, about={"law": "decay"})
    found = fitting.fit(p)
    text = json.loads(json.dumps(found.as_json(), allow_nan=False))
    assert list(text)[:3] == ["estimates", "rms", "identifiable"]
    assert set(text["estimates"]["a"]) == {"value", "low", "high"}
    assert text["identifiable"] == dict.fromkeys(TRUTH, True)
    assert text["law"] == "decay"
    # Everything to repeat it: the same observations, bounds and start.
    ends = {
        n: (-np.inf if low is None else low, np.inf if high is None else high)
        for n, (low, high) in text["bounds"].items()
    }
    parameters = tuple(Parameter(n, v, *ends[n]) for n, v in text["start"].items())
    again = fitting.fit(Problem(decay, np.array(text["observed"]), parameters, tuple(text["start"])))
    assert again.values == found.values


def test_units_that_cannot_be() -> None:
    wrong = Problem(lambda v: v["a"] * T, 2e3 * T, (Parameter("a", 1.0, 0.0, 2.0),), ("a",))
    with pytest.warns(UserWarning, match=r"are 1e\+03 times the fitted predictions. Is the unit right\?"):
        fitting.fit(wrong)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p: p.fitting("b"), "free = 'b' is unknown; valid: 'a', 'rate', 'shift'"),
        (lambda p: p.fitting(), "free is empty"),
        (lambda p: p.fitting("a", "a"), "stands twice"),
        (lambda p: p.starting_at(a=-1.0), r"a = -1 is outside its bounds \[0, inf\]"),
        (lambda p: p.starting_at(a=0.0), "a = 0 starts on a bound"),
        (lambda p: p.starting_at(c=1.0), "parameter = 'c' is unknown"),
        (lambda p: p.without("early"), "protocol = 'early' is unknown; valid: 'all'"),
        (lambda p: Problem(decay, [np.nan] * 21, p.parameters, p.free), "observed must be finite; got nan at index"),
        (lambda p: Problem(decay, p.observed, p.parameters, p.free, -np.ones(21)), "weight must be ≥ 0"),
        (lambda p: Problem(decay, p.observed[:3], p.parameters, p.free), "3 free parameters .* need more observations"),
        (lambda p: Parameter("a", 1.0, 2.0, 1.0), "bounds of a: low = 2 is not below high = 1"),
        (lambda p: fitting.fit(p, loss="square"), "loss = 'square' is unknown; valid: 'linear', 'soft_l1'"),
        (lambda p: fitting.fit(p, loss=Loss("huber", -1.0)), "scale = -1.0 must be positive"),
        (lambda p: fitting.fit(p, level=95.0), r"level = 95.0 is outside \(0, 1\)"),
        (lambda p: fitting.fit(p, starts=0), "starts = 0 must be an integer ≥ 1"),
        (lambda p: fitting.held_out(p), "needs two protocols"),
    ],
)
def test_what_is_refused(change: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        change(problem())


def test_the_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "optimistix", None)
    with pytest.raises(ModuleNotFoundError, match=r"a fit needs optimistix.*pip install 'jaxmyo\[fit\]'"):
        fitting.fit(Problem(lambda v: decay(v) + 0.0, problem().observed, problem().parameters, problem().free))


def test_a_batch_is_the_single_solves() -> None:
    p = problem(0.05)
    x = np.array([q.x(q.value) for q in p.fitted])
    data = np.stack([problem(0.05, seed).observed for seed in range(3)])
    batch = solve(p, np.tile(x, (3, 1)), observed=data)
    for i in range(3):
        one = solve(p, x, observed=data[i])
        np.testing.assert_allclose(batch.sum[i], one.sum, rtol=1e-7)
