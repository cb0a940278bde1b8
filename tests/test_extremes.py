"""Random problems over the extremes, and the hand-made equations and the branch that they are held against."""

import json
from pathlib import Path

import jax
import numpy as np
import pytest
import reference as by_hand
import reference_tube
from conftest import jaxmyo_in
from support import BATCH, biaxial

import jaxmyo as jm
from jaxmyo.stability import independent, random_problems, tables
from jaxmyo.stability.problems import Problems, draw
from jaxmyo.stability.random_problems import Outcome, body_of, branch_A, branch_C, muscle_C, muscle_of, outcome
from jaxmyo.stability.reference import End
from jaxmyo.status import Status


@pytest.mark.parametrize("weave", [True, False])
@pytest.mark.parametrize("kind", ["sample", "tube"])
def test_the_tangent_by_hand_is_the_derivative_of_the_residual(kind: str, weave: bool) -> None:
    problems = draw(kind, 6, seed=3)
    problems = problems._replace(constants=np.tile(problems.constants[:1], (6, 1)))
    body = body_of(kind, problems)
    rng = np.random.default_rng(0)
    muscle = muscle_of(problems, weave, body)
    muscle = independent.Muscle(
        muscle.constants, muscle.T0, muscle.beta, muscle.a_over_D, rng.normal(size=body.weight.shape), 3.0 * muscle.T_cf
    )
    size = body.n_u + body.n_p + weave
    z = 0.05 * rng.normal(size=(6, size)) * np.concatenate([np.ones(body.n_u), np.full(size - body.n_u, 100.0)])
    if kind == "tube":
        z[:, : body.n_u - 1] *= np.diff(problems.R).min(axis=1)[:, None]
    pressure = rng.uniform(0.0, 10.0, 6)
    _, K = independent.residual_and_tangent(body, muscle, z, pressure)
    for a in range(size):
        radius = kind == "tube" and a < body.n_u - 1
        step = 1e-6 * np.maximum(np.abs(z[:, a]), 1e-3 * problems.R[:, 1] if radius else 1e-3)
        plus, minus = z.copy(), z.copy()
        plus[:, a] += step
        minus[:, a] -= step
        r = [independent.residual_and_tangent(body, muscle, x, pressure)[0] for x in (plus, minus)]
        slope = (r[0] - r[1]) / (plus[:, a] - minus[:, a])[:, None]
        scale = np.abs(K).max(axis=(1, 2), keepdims=True)[:, :, 0]
        np.testing.assert_allclose(slope / scale, K[:, :, a] / scale, atol=1e-6)


@pytest.mark.parametrize("a_over_D", [0.2, None])
def test_the_branch_of_the_sample_is_that_of_the_scalar_equation(a_over_D: float | None) -> None:
    problems = draw("sample", 40, seed=1)
    constants = np.array([list(by_hand.SETS["table1"].values())] * 40)
    problems = problems._replace(constants=constants, a_over_D=np.full(40, a_over_D or 0.0))
    body = body_of("sample", problems)
    found = branch_A(body, muscle_of(problems, a_over_D is not None, body))
    assert (found.end == End.REACHED).all()
    for i in range(40):
        one = by_hand.free_contraction(by_hand.SETS["table1"], float(problems.T0[i]), a_over_D, float(problems.beta[i]))
        np.testing.assert_allclose(1.0 + found.z[i, :3], one.stretches, atol=1e-8)


def test_the_branch_of_the_tube_ends_at_its_limit_point() -> None:
    """The paper's tube without the weave, loaded straight from the contracted state: 7.22 kPa is the most it bears."""
    n = 1
    problems = draw("tube", n, seed=0)._replace(
        constants=np.array([list(by_hand.SETS["table1"].values())]),
        T0=np.array([15.0]),
        beta=np.ones(n),
        target=np.array([[18.0]]),
        R=np.linspace(2.0, 3.5, 33)[None],
    )
    body = body_of("tube", problems)
    muscle = muscle_of(problems, False, body)
    A = branch_A(body, muscle)
    C = branch_C("tube", body, muscle_C(body, muscle, A.z), A.z, problems, np.arange(1))
    assert (A.end[0], C.end[0]) == (End.REACHED, End.LIMIT_POINT)
    tube = reference_tube.Tube()
    exact = reference_tube.contract(by_hand.SETS["table1"], tube, 15.0, None, 1.0)
    with pytest.raises(reference_tube.LimitPoint) as limit:
        reference_tube.inflate(by_hand.SETS["table1"], tube, exact, 18.0)
    assert 18.0 * C.reached[0] == pytest.approx(limit.value.load, rel=2e-3)
    assert A.z[0, 0] + 2.0 == pytest.approx(exact.ri, rel=1e-3)


@pytest.mark.slow
def test_a_hole_that_closes_ends_the_path() -> None:
    """The nodes inside came out at negative radii, which no Gauss point sees: of no body, though converged."""
    scene = jm.radial_tube(4, Ri=0.073, Ro=2.073)
    A = jm.contract(scene, T0=3.94, a_over_D=0.1936, beta=0.354, throw=False)
    assert A.status == Status.NO_DESCENT
    assert 0.8 < A.reached < 1.0
    inner = scene.mesh.points[:, 0] + np.asarray(A.u)[:, 0]
    assert 0.0 < inner.min() < 0.01


@pytest.mark.slow
def test_a_pressure_does_not_turn_the_inside_of_a_narrow_tube_out() -> None:
    """One step of the whole pressure had a solution with a negative inner radius, a small strain away in the mean."""
    scene = jm.radial_tube(4, Ri=1.5e-3, Ro=2.0015)
    A = jm.contract(scene, T0=0.007, a_over_D=0.2, beta=0.45)
    C = jm.load(A, jm.Pressure("inner", 30.0))
    problems = draw("tube", 1, seed=0)._replace(
        constants=np.array([list(by_hand.SETS["table1"].values())]),
        T0=np.array([0.007]),
        beta=np.array([0.45]),
        a_over_D=np.array([0.2]),
        target=np.array([[30.0]]),
        R=np.linspace(1.5e-3, 2.0015, 5)[None],
    )
    body = body_of("tube", problems)
    muscle = muscle_of(problems, True, body)
    by_steps = branch_A(body, muscle)
    branch = branch_C("tube", body, muscle_C(body, muscle, by_steps.z), by_steps.z, problems, np.arange(1))
    assert branch.end[0] == End.REACHED
    assert np.asarray(C.u)[:, 0].max() == pytest.approx(branch.z[0, 0], rel=1e-7)
    assert branch.z[0, 0] > 0.01


def test_random_problems_of_the_sample() -> None:
    """All converge to the state of the branch from rest. Found by other equations and another method."""
    problems = draw("sample", BATCH, seed=5)
    problems = problems._replace(constants=np.array([list(by_hand.SETS["table1"].values())] * BATCH))
    A, C = biaxial(None, True, problems.T0, problems.a_over_D, problems.beta, *problems.target.T)
    body = body_of("sample", problems)
    muscle = muscle_of(problems, True, body)
    branch = branch_A(body, muscle)
    assert (branch.end == End.REACHED).all()
    assert (A.status == Status.CONVERGED).all()
    z = np.column_stack([A.stretches[:, 0, 0] - 1.0, A.p, A.q])
    assert independent.relative_residual(body, muscle, z, np.zeros(BATCH)).max() < 1e-12
    np.testing.assert_allclose(z[:, :3], branch.z[:, :3], atol=1e-9)
    left = muscle_C(body, muscle, branch.z)
    loaded = branch_C("sample", body, left, branch.z, problems, np.arange(BATCH))
    good = C.status == Status.CONVERGED
    assert (good == (loaded.end == End.REACHED)).all()  # the others leave the range of float64: exp Q
    np.testing.assert_allclose(C.stretches[good, 0, 0] - 1.0, loaded.z[good, :3], atol=1e-9)


def assert_sound(found: Outcome) -> None:
    """No NaN, no state without a status, no residual that others do not find small; no other branch, once β > 0.

    A passive body has no shear stiffness at rest, and several branches start there.
    """
    for state in "AC":
        count = tables.counts(found, state)
        assert count.converged + count.named == count.asked
        assert (count.inexact, count.nan) == (0, 0)
        assert tables.counts(found, state, found.problems.beta > 0.0).wrong == 0


@pytest.mark.slow
@pytest.mark.parametrize("weave", [True, False])
@pytest.mark.parametrize("kind", ["sample", "tube"])
def test_more_random_problems(kind: str, weave: bool) -> None:
    """The few tubes whose load is steeper than float64 resolves are named."""
    found = outcome(kind, weave, 500, seed=7)
    assert_sound(found)
    assert (found.reference_A.end != End.LOST).all()
    for state in "AC":
        count = tables.counts(found, state)
        assert count.missed <= 0.01 * count.solvable
        assert count.beyond == 0


@pytest.mark.slow
def test_random_solids() -> None:
    from jaxmyo.stability.solids import solid_outcome

    found = solid_outcome(200, seed=0)
    assert np.nanmax(found.error_A) < 1e-9
    assert np.nanmax(found.error_C) < 1e-9
    assert not (found.off > 1e-5).any()  # NaN where the branch is not known
    for apart, state in ((found.apart_A, found.A), (found.apart_C, found.C)):
        converged = state.status == jm.Status.CONVERGED
        assert np.isfinite(apart).sum() >= 0.98 * converged.sum()
        assert np.nanmax(apart) < 1e-8
    assert np.isfinite(found.A.u).all()
    assert np.isfinite(found.C.u).all()


@pytest.mark.slow
def test_the_command(tmp_path: Path) -> None:
    run = jaxmyo_in(tmp_path)("stability", "--quick", "--json", "--out", "out")
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert found["inf_sup"]["cube 1×1×1"]["p: element, q: element"] == pytest.approx([0.245, 0.049, 0.026], abs=1e-3)
    assert all((tmp_path / file).stat().st_size > 0 for file in found["files"])
    assert {"report.md", "maps.png", "inf_sup.png"} <= {Path(file).name for file in found["files"]}


@pytest.mark.slow
def test_a_branch_that_is_unstable_from_rest_on_is_followed_where_there_is_no_other() -> None:
    """Passive tissue under a stretch along its fibres: λcf = λn by symmetry, stable across them or not."""
    A = jm.contract(jm.thin_sample(), T0=0.0, beta=0.0, a_over_D=None)
    stretch = np.linspace(0.8, 1.3, 11)
    C = jax.jit(jax.vmap(lambda s: jm.load(A, jm.Stretch("x", s), throw=False)))(stretch)
    assert (np.asarray(C.status) == Status.CONVERGED).all()
    across = np.broadcast_to(stretch[:, None] ** -0.5, (11, 2))
    np.testing.assert_allclose(np.asarray(C.stretches)[:, 0, 0, 1:], across, atol=1e-10)
    assert (np.asarray(C.negative_eigenvalues) > 0).any()


@pytest.mark.slow
@pytest.mark.parametrize("weave", [True, False])
def test_passive_tubes_under_pressures_of_many_moduli(weave: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rest has no stiffness but along the fibres: such loads have to begin gently, on the branch that is stable."""
    numbers = [833, 917, 1431, 2016, 2603, 2661] if weave else [276, 343, 404, 931, 1104, 1245]
    every = draw("tube", 3500 if weave else 1500, 0)
    few = Problems(*(x[numbers] for x in every))
    monkeypatch.setattr(random_problems, "draw", lambda *_: few)
    monkeypatch.setattr(random_problems, "CHUNK", len(numbers))
    found = outcome("tube", weave, len(numbers), 0)
    assert (found.reference_C.end == End.REACHED).all()
    assert (found.C.status == Status.CONVERGED).all()
    assert np.max(found.off_C) < 1e-10
    assert np.max(found.error_C) < 1e-11


@pytest.mark.slow
def test_the_first_step_of_a_load_does_not_pass_a_limit_point(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thin contracted tube whose pressure has a maximum below a thousandth of what is asked for."""
    few = Problems(*(x[[271]] for x in draw("tube", 3500, 0)))
    monkeypatch.setattr(random_problems, "draw", lambda *_: few)
    monkeypatch.setattr(random_problems, "CHUNK", 1)
    found = outcome("tube", True, 1, 0)
    assert found.reference_C.end[0] == End.LIMIT_POINT
    assert found.C.status[0] == Status.LIMIT_POINT
