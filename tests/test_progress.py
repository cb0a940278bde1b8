"""What a solve tells while it runs: log lines, a progress bar, the time limit."""

import logging
import re
from collections.abc import Callable
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo import progress, solve, sparse

STEP = re.compile(r"^  step (\d+) to (\S+) % of the path: (\w+), residual (\S+), (\d+) iterations$")
ITERATION = re.compile(r"^    iteration +(\d+)  residual (\S+)  step length (\S+)  correction (\S+?)(  refused)?$")


def neo_hookean(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    return 0.5 * constants["mu"] * (jnp.trace(C) - 3.0 - jnp.log(jnp.linalg.det(C)))


@cache
def scene() -> jm.Scene:
    supports = (jm.Symmetry("x"), jm.Symmetry("y"), jm.Symmetry("z"))
    return jm.Scene(jm.box((1.0, 1.0, 1.0), (2, 1, 1)), neo_hookean, {"mu": 10.0}, supports=supports)


def contract(**options: Any) -> jm.State:
    return jm.contract(scene(), T0=8.0, a_over_D=None, **options)


@pytest.fixture(params=[pytest.param("dense", marks=pytest.mark.slow), "sparse"])
def kind(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Small bodies are solved by dense matrices, large ones by sparse ones."""
    monkeypatch.setattr(solve, "LARGE", 0 if request.param == "sparse" else 1000)
    sparse.forget()
    return request.param


def assert_same(a: jm.State, b: jm.State) -> None:
    np.testing.assert_allclose(np.asarray(a.u), np.asarray(b.u), rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.asarray(a.p), np.asarray(b.p), rtol=0, atol=1e-11)
    for name in ("steps", "rejected", "iterations", "status", "negative_eigenvalues"):
        assert int(getattr(a, name)) == int(getattr(b, name)), name


def test_a_line_per_step_and_per_iteration(kind: str, caplog: pytest.LogCaptureFixture) -> None:
    quiet = contract()
    assert not caplog.records
    caplog.set_level(logging.INFO, "jaxmyo")
    state = contract()
    assert_same(state, quiet)
    assert (state.solver == "dense LU") == (kind == "dense")
    assert {(r.name, r.levelname) for r in caplog.records} == {("jaxmyo", "INFO")}
    steps = [m for r in caplog.records if (m := STEP.match(r.getMessage()))]
    iterations = [m for r in caplog.records if (m := ITERATION.match(r.getMessage()))]
    assert len(steps) + len(iterations) == len(caplog.records)
    assert [int(m[1]) for m in steps] == list(range(1, int(state.steps) + 1))
    assert sum(int(m[5]) for m in steps) == int(state.iterations)
    assert {m[3] for m in steps} <= {"CONVERGED", "BRANCH_LEFT"}
    assert sum(m[3] != "CONVERGED" for m in steps) == int(state.rejected)
    at = [float(m[2]) for m in steps]
    assert at == sorted(at)
    assert at[-1] == 100.0
    np.testing.assert_allclose(float(steps[-1][4]), float(state.residual), rtol=0.01)
    # Iteration 0 looks at the start of a step; all that follow are its corrections.
    assert len(iterations) == int(state.iterations) + int(state.steps)
    assert {float(m[3]) for m in iterations} == {1.0}
    final = [float(m[2]) for m in iterations[-int(steps[-1][5]) - 1 :]]
    np.testing.assert_allclose(final, np.asarray(state.history)[: len(final)], rtol=0.01)


def test_refused_steps_say_why(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """A step that left the branch is BRANCH_LEFT, one whose iterations ran out TOO_MANY_ITERATIONS."""
    monkeypatch.setattr(solve, "LARGE", 0)
    caplog.set_level(logging.INFO, "jaxmyo")
    found = []
    for settings in (jm.Settings(move=0.02), jm.Settings(move=0.3, max_iterations=2)):
        caplog.clear()
        state = contract(settings=settings, throw=False)
        refused = [m[3] for r in caplog.records if (m := STEP.match(r.getMessage())) and m[3] != "CONVERGED"]
        assert len(refused) == int(state.rejected) > 0
        found.append(set(refused))
    assert found[0] == {"BRANCH_LEFT"}
    assert "TOO_MANY_ITERATIONS" in found[1]


@pytest.mark.usefixtures("kind")
def test_a_bar_if_it_is_wanted(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("tqdm")
    quiet = contract()
    assert capsys.readouterr() == ("", "")
    state = contract(settings=jm.Settings(progress=True))
    out, err = capsys.readouterr()
    assert out == ""
    assert "100 %" in err
    assert f"step {int(state.steps)}, residual" in err
    assert_same(state, quiet)


@pytest.mark.usefixtures("kind")
def test_a_time_limit() -> None:
    """The state is the last one that was found; without `throw` its status says so."""
    none = jm.Settings(time_limit=0.0)
    with pytest.raises(jm.SolveError, match=re.escape("TIME_LIMIT at 0 % of the load")) as failure:
        contract(settings=none)
    assert isinstance(failure.value.state, jm.State)
    for state in (failure.value.state, contract(settings=none, throw=False)):
        assert int(state.status) == jm.Status.TIME_LIMIT
        assert not state.converged
        assert float(state.reached) == 0.0
        assert "time limit passed" in state.message
        np.testing.assert_array_equal(np.asarray(state.u), 0.0)
    assert_same(contract(settings=jm.Settings(time_limit=1e4)), contract())


@pytest.mark.usefixtures("kind")
def test_a_time_limit_on_the_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """After eight steps: an equilibrium, at the activation that was reached."""
    looks = iter(range(1000))
    monkeypatch.setattr(progress.Watch, "is_over", property(lambda self: next(looks) >= 8))
    state = contract(settings=jm.Settings(time_limit=1.0, move=0.02), throw=False)
    assert int(state.status) == jm.Status.TIME_LIMIT
    assert int(state.steps) == 8
    reached = float(state.reached)
    assert 0.0 < reached < 1.0
    np.testing.assert_allclose(float(state.inputs.beta), reached, rtol=1e-12)
    assert float(state.residual) < 1e-6
    # λ f of ½ μ (I1 − 3) under a tension T along the fibre: μ (λ² − 1/λ) + T = 0.
    along = np.asarray(state.stretches)[..., 0]
    np.testing.assert_allclose(10.0 * (along**2 - 1.0 / along), -8.0 * reached, rtol=1e-4)


@pytest.mark.parametrize("options", [{"time_limit": 1.0}, {"progress": True}], ids=["time limit", "bar"])
def test_neither_inside_jit(options: dict[str, Any]) -> None:
    run: Callable[[float], Any] = jax.jit(
        lambda T0: jm.contract(scene(), T0=T0, a_over_D=None, settings=jm.Settings(**options)).u
    )
    with pytest.raises(ValueError, match="outside of jit and vmap"):
        run(8.0)
