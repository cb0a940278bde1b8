"""Newton and continuation: quadratic rate, the traps of the law, and loads without a solution."""

from functools import cache
from typing import Any

import numpy as np
import pytest
import reference
from support import biaxial, sample

import jaxmyo as jm

#: One step as long as it takes, so that Newton starts far from the root and its rate can be seen.
ONE_STEP = jm.Settings(move=10.0)


@cache
def contracted(name: str, T0: float, a_over_D: float | None, beta: float) -> jm.State:
    return jm.contract(sample(), T0=T0, a_over_D=a_over_D, beta=beta, constants=jm.SETS[name])


def tractions(along: float, across: float, measure: Any = "nominal") -> tuple[jm.Traction, jm.Traction]:
    return jm.Traction("x1", (along, 0.0, 0.0), measure), jm.Traction("y1", (0.0, across, 0.0), measure)


def both(l1: float, l2: float) -> tuple[jm.Stretch, jm.Stretch]:
    return jm.Stretch("x", l1), jm.Stretch("y", l2)


def assert_finite(state: jm.State) -> None:
    for field in ("u", "p", "residual", "force_residual", "constraint_residual", "reached", "cauchy", "history"):
        assert np.isfinite(np.asarray(getattr(state, field))).all(), field


# ------------------------------------------------------------------------------------------------- quadratic rate


@pytest.mark.parametrize("conditions", [both(1.2, 1.2), both(1.3, 1.3), both(1.3, 0.9), both(0.85, 1.25)], ids=str)
def test_newton_converges_quadratically(conditions: Any) -> None:
    """The order log(e3/e2) / log(e2/e1) of the last residuals above round-off is near 2."""
    state = jm.load(contracted("measured", 0.6, 0.2, 1.0), *conditions, settings=ONE_STEP)
    history = np.asarray(state.history)
    e = history[history > 1e-13]
    assert e.size >= 4
    assert e[0] > 0.02  # far from the root
    assert (e[-2:] / e[-3:-1] ** 2 < 1e4).all()
    order = np.log(e[-1] / e[-2]) / np.log(e[-2] / e[-3])
    assert 1.7 < order < 2.5
    assert float(state.residual) <= 1e-13


def test_history_ends_with_the_residual_of_the_state() -> None:
    state = jm.load(contracted("measured", 0.6, 0.2, 1.0), *both(1.2, 1.2))
    history = np.trim_zeros(np.asarray(state.history), "b")
    assert history[-1] == float(state.residual)
    assert (np.diff(history) < 0.0).all()
    assert history.size - 1 <= int(state.iterations)


# ---------------------------------------------------------------------------------------------------------- traps


@pytest.mark.parametrize("name", ["table1", "measured", "printed"])
@pytest.mark.parametrize(
    "stretches", [(1.2, 1.2), (1.3, 0.8), (0.8, 1.3), (1.001, 1.0), (1.0, 1.001), (1.0, 1.0)], ids=str
)
def test_passive_stretches_from_rest_where_nothing_resists_shear(name: str, stretches: tuple[float, float]) -> None:
    state = jm.load(contracted(name, 35.0, None, 0.0), *both(*stretches))
    exact = reference.loaded_stretch(reference.SETS[name], 35.0, 0.0, 0.0, 0.0, *stretches)
    assert float(state.residual) <= 1e-13
    sigma = np.asarray(state.cauchy)[0, 0]
    np.testing.assert_allclose(sigma, np.diag(exact.sigma), rtol=0, atol=1e-9 * (1.0 + np.abs(exact.sigma).max()))


@pytest.mark.parametrize("name", ["table1", "measured"])
@pytest.mark.parametrize("measure", ["nominal", "cauchy"])
@pytest.mark.parametrize("load", [(5.0, 2.0), (2.0, 5.0), (0.05, 0.02), (5.0, 5.0)], ids=str)
def test_passive_tractions_from_rest_where_nothing_resists_shear(
    name: str, measure: Any, load: tuple[float, float]
) -> None:
    state = jm.load(contracted(name, 35.0, None, 0.0), *tractions(*load, measure))
    exact = reference.loaded_mixed(reference.SETS[name], 35.0, 0.0, 0.0, 0.0, (1.0, 1.0, 1.0), measure, load)
    assert float(state.residual) <= 1e-13
    np.testing.assert_allclose(np.asarray(state.stretches)[0, 0], exact.stretches, rtol=0, atol=1e-9)


@pytest.mark.parametrize("a_over_D", [None, 0.0, 0.2, 0.25])
def test_contraction_to_the_strongest_tension(a_over_D: float | None) -> None:
    """Full activation at 200 kPa from rest, where the solution leaves like a root of beta."""
    for name in ("table1", "measured", "printed"):
        state = contracted(name, 200.0, a_over_D, 1.0)
        exact = reference.free_contraction(reference.SETS[name], 200.0, a_over_D, 1.0)
        np.testing.assert_allclose(np.asarray(state.stretches)[0, 0], exact.stretches, rtol=0, atol=1e-11)


@pytest.mark.parametrize("stretch", [2.0, 3.0, 4.9])
def test_exponential_growth_never_returns_nan(stretch: float) -> None:
    """At 3 the energy is 1e107 kPa and a solution; at 4.9 exp Q is beyond float64, so there is no answer to find."""
    state = jm.load(contracted("measured", 0.6, 0.2, 1.0), *both(stretch, stretch), throw=False)
    assert_finite(state)
    if stretch < 4.0:
        assert state.status == jm.Status.CONVERGED
        exact = reference.loaded_stretch(reference.SETS["measured"], 0.6, 1.0, 0.0, 0.0, stretch, stretch)
        np.testing.assert_allclose(float(state.cauchy[0, 0, 0, 0]), exact.sigma[0], rtol=1e-9)
    else:
        assert status_name(state) in {s.name for s in jm.Status} - {"CONVERGED", "INVALID_INPUT"}
        assert 0.0 < float(state.reached) < 1.0
        assert float(state.residual) <= 1e-6


def status_name(state: jm.State) -> str:
    return jm.Status(int(state.status)).name


def test_trial_steps_that_invert_an_element_are_rejected() -> None:
    """Squeezed to a quarter in one call, the element is turned inside out by a full Newton step."""
    state = jm.load(contracted("measured", 0.6, 0.2, 1.0), *both(0.5, 0.5), settings=ONE_STEP)
    assert float(state.residual) <= 1e-13
    assert (np.linalg.det(np.asarray(state.F)) > 0.99).all()


# ------------------------------------------------------------------------------------- loads without a solution

#: (set, T0, a/D, beta), measure, (along, across) kPa, the load factor where the branch folds.
FOLDS = [
    (("measured", 35.0, 0.12541, 0.1), "cauchy", (18.290, 4.0295), 0.34261),
    (("table1", 35.0, 0.2, 0.1), "cauchy", (5.0, 2.0), 0.90861),
    (("table1", 35.0, 0.2, 0.1), "nominal", (20.0, 10.0), 0.23205),
    (("table1", 35.0, 0.1, 0.5), "nominal", (20.0, 10.0), 0.59317),
    (("measured", 35.0, 0.2, 0.1), "nominal", (5.0, 2.0), 0.82096),
    (("measured", 35.0, 0.2, 0.5), "nominal", (20.0, 10.0), 0.65233),
]


@pytest.mark.parametrize(("case", "measure", "load", "fold"), FOLDS, ids=str)
def test_a_load_beyond_a_fold_ends_at_the_fold(case: Any, measure: Any, load: Any, fold: float) -> None:
    name, T0, a_over_D, beta = case
    constants = reference.SETS[name]
    a = reference.free_contraction(constants, T0, a_over_D, beta)
    with pytest.raises(reference.BranchEnds):
        reference.loaded_mixed(constants, T0, beta, a.T_f, a.T_cf, a.stretches, measure, load)
    state = jm.load(contracted(*case), *tractions(*load, measure), throw=False)
    assert state.status == jm.Status.LIMIT_POINT
    assert not bool(state.converged)
    assert abs(float(state.reached) - fold) <= 1e-3
    assert_finite(state)
    assert float(state.residual) <= 1e-6
    # The fields are an equilibrium: that of the load that was reached.
    l1, l2, _ = np.asarray(state.stretches)[0, 0]
    there = reference.loaded_stretch(constants, T0, beta, a.T_f, a.T_cf, l1, l2)
    carried = (there.sigma if measure == "cauchy" else there.nominal)[:2]
    np.testing.assert_allclose(carried, float(state.reached) * np.array(load), rtol=1e-4)


def test_a_failed_load_says_where_and_what_to_try() -> None:
    case, measure, load, fold = FOLDS[2]
    state = jm.load(contracted(*case), *tractions(*load, measure), throw=False)
    assert status_name(state) in state.message
    assert f"{100.0 * fold:.2f}"[:4] in state.message
    assert "residual" in state.message
    assert "try" in state.message
    assert "smaller load" in state.message


def test_a_failed_load_raises_with_the_last_state() -> None:
    case, measure, load, fold = FOLDS[2]
    with pytest.raises(jm.SolveError, match=r"at 23\.2\d* % of the load.*[Tt]ry") as error:
        jm.load(contracted(*case), *tractions(*load, measure))
    state = error.value.state
    assert isinstance(state, jm.State)
    assert abs(float(state.reached) - fold) <= 1e-3
    assert_finite(state)


def test_the_last_state_of_a_failed_load_does_not_pass_for_a_contraction() -> None:
    case, measure, load, _ = FOLDS[2]
    state = jm.load(contracted(*case), *tractions(*load, measure), throw=False)
    with pytest.raises(ValueError, match="state"):
        jm.load(state, *both(1.0, 1.0))


def test_too_few_steps_are_reported() -> None:
    few = jm.Settings(max_steps=3)
    state = jm.contract(sample(), T0=200.0, a_over_D=0.2, settings=few, throw=False)
    assert state.status == jm.Status.TOO_MANY_STEPS
    assert 0.0 < float(state.reached) < 1.0
    assert int(state.steps) == 3
    assert_finite(state)
    assert "max_steps" in state.message


# ------------------------------------------------------------------------------------------------------- batches

GOOD = {
    "T0": [5.0, 35.0, 0.6, 100.0, 20.0, 5.0],
    "a_over_D": [0.1, 0.2, 0.25, 0.0, 0.15, 0.1],
    "beta": [1.0, 0.5, 0.1, 0.9, 0.0, 1.0],
    "l1": [1.2, 1.1, 0.9, 1.2, 1.1, 1.0],
    "l2": [1.2, 1.0, 1.1, 0.9, 1.2, 1.0],
}


@pytest.mark.parametrize(
    ("name", "value", "of_a", "of_c"),
    [
        ("T0", np.nan, "INVALID_INPUT", "INVALID_INPUT"),
        ("T0", -1.0, "INVALID_INPUT", "INVALID_INPUT"),
        ("T0", np.inf, "INVALID_INPUT", "INVALID_INPUT"),
        ("a_over_D", 0.26, "INVALID_INPUT", "INVALID_INPUT"),
        ("a_over_D", -1e-9, "INVALID_INPUT", "INVALID_INPUT"),
        ("beta", 1.0001, "INVALID_INPUT", "INVALID_INPUT"),
        ("beta", np.nan, "INVALID_INPUT", "INVALID_INPUT"),
        ("l1", 5.0, "CONVERGED", "INVALID_INPUT"),
        ("l2", 0.2, "CONVERGED", "INVALID_INPUT"),
        ("l2", np.nan, "CONVERGED", "INVALID_INPUT"),
        ("l1", 4.9, "CONVERGED", None),
    ],
)
def test_a_bad_sample_is_flagged_and_its_neighbours_are_not_touched(
    name: str, value: float, of_a: str, of_c: str | None
) -> None:
    good_a, good_c = biaxial(None, True, **GOOD, constants=jm.MEASURED)
    bad = {key: list(values) for key, values in GOOD.items()}
    bad[name][2] = value
    if value == 4.9:
        bad["l2"][2] = value
    a, c = biaxial(None, True, **bad, constants=jm.MEASURED)
    assert jm.Status(a.status[2]).name == of_a
    assert of_c is None or jm.Status(c.status[2]).name == of_c
    assert c.status[2] != jm.Status.CONVERGED
    others = [0, 1, 3, 4, 5]
    for got, expected in ((a, good_a), (c, good_c)):
        assert (got.status[others] == jm.Status.CONVERGED).all()
        for field in ("u", "p", "cauchy"):
            values, before = getattr(got, field)[others], getattr(expected, field)[others]
            np.testing.assert_allclose(values, before, rtol=1e-12, atol=1e-12)
    for field in ("u", "p", "reached"):
        assert np.isfinite(getattr(c, field)).all(), field


def test_a_batch_agrees_with_one_solve_at_a_time() -> None:
    a, c = biaxial(None, True, **GOOD, constants=jm.MEASURED)
    for i in range(6):
        one = contracted("measured", GOOD["T0"][i], GOOD["a_over_D"][i], GOOD["beta"][i])
        np.testing.assert_allclose(a.u[i], np.asarray(one.u), rtol=0, atol=1e-11)
        loaded = jm.load(one, *both(GOOD["l1"][i], GOOD["l2"][i]))
        np.testing.assert_allclose(c.u[i], np.asarray(loaded.u), rtol=0, atol=1e-11)
