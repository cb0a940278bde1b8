"""The sparse solver against the dense one: the same states, whatever ties, loads, multipliers and coordinates."""

from collections.abc import Callable, Iterator
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo import factor, multigrid, saddle, solve, sparse
from jaxmyo.conditions import BodyForce, Volume


def neo_hookean(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    """½ μ (I1 − 3) + ½ k (I4 − 1)² [kPa]; no stress at rest but a pressure."""
    i4 = frame[0] @ C @ frame[0]
    return 0.5 * constants["mu"] * (jnp.trace(C) - 3.0) + 0.5 * constants["k"] * (i4 - 1.0) ** 2


SOFT = {"mu": 10.0, "k": 5.0}
SYMMETRIES = (jm.Symmetry("x"), jm.Symmetry("y"), jm.Symmetry("z"))


def block(**options: Any) -> jm.Scene:
    mesh = jm.box((1.0, 1.2, 0.8), (3, 2, 2))
    return jm.Scene(mesh, neo_hookean, **({"constants": SOFT, "supports": SYMMETRIES} | options))


def weave_and_stretch(q_patches: Any = None, p_patches: Any = None) -> list[jm.State]:
    mesh = jm.box((10.0, 10.0, 1.0), (3, 3, 2))
    patches = {"q_patches": q_patches(mesh) if q_patches else None, "p_patches": p_patches(mesh) if p_patches else None}
    scene = jm.Scene(mesh, jm.lin_yin, jm.TABLE1, supports=SYMMETRIES, **patches)
    A = jm.contract(scene, T0=5.0, a_over_D=0.2)
    return [A, jm.load(A, jm.Stretch("x", 1.1), jm.Traction("y1", (0.0, 0.5, 0.0)))]


def follower_loads() -> list[jm.State]:
    scene = block(supports=(*SYMMETRIES, jm.Spring("y1", 3.0, direction="normal")))
    A = jm.contract(scene, T0=4.0, a_over_D=None)
    loads = (jm.Pressure("z1", 2.0), jm.Traction("x1", (3.0, 0.5, 0.0), measure="cauchy"), BodyForce((1.0, 0.0, -2.0)))
    return [A, jm.load(A, *loads)]


def tube_in_its_coordinates() -> list[jm.State]:
    tube = jm.tube_sector((3, 2, 2), q_patches="column")
    A = jm.contract(tube, T0=5.0, a_over_D=0.2)
    return [A, jm.load(A, jm.Pressure("inner", 4.0))]


def filled_tube() -> list[jm.State]:
    tube = jm.axisymmetric_tube((3, 3), law=neo_hookean, constants=SOFT)
    A = jm.contract(tube, T0=0.0, a_over_D=None)
    first = jm.load(A, Volume("inner", 1.3 * float(A.cavity_volume("inner"))))
    return [A, first, jm.load(A, Volume("inner", 1.5 * float(A.cavity_volume("inner"))), start=first)]


CASES: dict[str, Callable[[], list[jm.State]]] = {
    "one q per element": weave_and_stretch,
    "one q per column": lambda: weave_and_stretch(lambda mesh: jm.columns(mesh, "z")),
    "p and q in blocks": lambda: weave_and_stretch(lambda mesh: jm.blocks(mesh), lambda mesh: jm.columns(mesh, "z")),
    "follower loads, springs and body forces": follower_loads,
    "curved coordinates": tube_in_its_coordinates,
    "a cavity of prescribed volume": filled_tube,
}


@pytest.fixture(params=["Pardiso", "SuperLU", "multigrid"])
def solver(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """All that solve with a sparse matrix, in turn."""
    if request.param == "SuperLU":
        monkeypatch.setattr(factor, "chosen", lambda n_u: factor._SuperLU)
    elif request.param == "multigrid":
        pytest.importorskip("pyamg")
        monkeypatch.setattr(factor, "HUGE", 0)
        monkeypatch.setattr(multigrid, "COARSEST", 10)
    else:
        pytest.importorskip("pypardiso")
    sparse.forget()
    yield request.param
    sparse.forget()


@pytest.fixture(scope="module")
def dense() -> dict[str, list[jm.State]]:
    return {}


#: Where the dense solve of reference takes longest.
LONG = {
    "one q per element",
    "one q per column",
    "curved coordinates",
    "p and q in blocks",
    "a cavity of prescribed volume",
}


@pytest.mark.parametrize("case", [pytest.param(c, marks=[pytest.mark.slow] if c in LONG else []) for c in CASES])
def test_states_are_those_of_the_dense_solver(
    case: str, solver: str, dense: dict[str, list[jm.State]], monkeypatch: pytest.MonkeyPatch
) -> None:
    if case not in dense:
        dense[case] = CASES[case]()
    monkeypatch.setattr(solve, "LARGE", 0)
    for state, reference in zip(CASES[case](), dense[case], strict=True):
        assert (state.solver, reference.solver) == (solver, "dense LU")
        assert state.converged
        assert float(state.residual) <= 1e-13
        for name in ("u", "p", "q", "cavity_pressures", "T_f", "T_cf"):
            if getattr(reference, name) is not None:
                np.testing.assert_allclose(getattr(state, name), getattr(reference, name), atol=2e-9, err_msg=name)
        unstable = -1 if solver == "multigrid" else int(reference.negative_eigenvalues)
        assert int(state.negative_eigenvalues) == unstable


@pytest.mark.parametrize(("beyond", "negative"), [(1e-9, 1), (-1e-9, 0)])
def test_single_precision_gives_way_where_it_cannot_tell_the_inertia(
    beyond: float, negative: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pypardiso")
    monkeypatch.setattr(solve, "LARGE", 0)
    of_block = sparse.Sparse.of(jm.contract(block(), T0=0.0, a_over_D=None).system)
    pattern, metric = of_block.pattern, of_block._metric
    data = metric.copy()  # all but singular
    data[pattern.diagonal] -= (1.0 + beyond) * np.linalg.eigvalsh(pattern.full(metric).toarray())[0]
    solver = factor.solver(pattern, metric, of_block._rigid)
    solver.factorise(data)
    single = solver.size["factor GB"]
    assert solver.inertia == (negative, 0)
    assert solver.size["factor GB"] == 2.0 * single
    assert not solver.sharpen()
    x = np.linspace(0.0, 1.0, pattern.n_u)
    np.testing.assert_allclose(solver.solve(pattern.full(data) @ x), x, atol=1e-4)


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_constants_in_another_unit_of_stress(unit: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """The augmentation goes by the stiffness of the body, whatever that is."""
    monkeypatch.setattr(solve, "LARGE", 0)
    sparse.forget()
    soft = block()
    hard = block(constants={name: unit * value for name, value in SOFT.items()})
    states = [jm.load(jm.contract(s, T0=0.0, a_over_D=None), jm.Stretch("x", 1.2)) for s in (soft, hard)]
    np.testing.assert_allclose(states[1].u, states[0].u, atol=1e-11)
    np.testing.assert_allclose(states[1].p / unit, states[0].p, rtol=1e-9)
    sparse.forget()


def test_near_the_equilibrium_newton_keeps_the_factorised_tangent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its residual is that of a full assembly all the same; what derivatives ask for is the tangent of the state."""
    monkeypatch.setattr(solve, "LARGE", 0)
    sparse.forget()
    state = jm.load(jm.contract(block(), T0=0.0, a_over_D=None), jm.Stretch("x", 1.2))
    assert int(state.work["residuals"]) >= 1
    lin = sparse._known[-1]
    assert lin._known is not None
    z, inputs, at = lin._known
    assert not np.array_equal(at.K.z, z)
    anew = sparse.Sparse(lin.system).at(z, inputs)
    np.testing.assert_allclose(at.r, anew.r, atol=1e-13)
    assert float(at.least_J) == pytest.approx(float(anew.least_J), abs=1e-14)
    assert float(at.residual) <= 1e-13
    np.testing.assert_allclose(lin.tangent(z, inputs).B.toarray(), anew.K.B.toarray(), atol=1e-14)
    sparse.forget()


@pytest.mark.parametrize("most", [4, 6])
def test_krylov_iterations_go_on_as_long_as_they_gain(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Few at a time, for their memory, take several rounds, and no other load steps.

    With six, the last round of a solve gains little, and is all that was missing.
    """
    pytest.importorskip("pyamg")
    monkeypatch.setattr(solve, "LARGE", 0)
    monkeypatch.setattr(factor, "HUGE", 0)
    monkeypatch.setattr(multigrid, "COARSEST", 10)

    def stretched(iterations: tuple[int, int]) -> jm.State:
        sparse.forget()
        monkeypatch.setattr(factor.Multigrid, "iterations", iterations)
        monkeypatch.setattr(saddle, "ROUNDS", (1, 1))
        return jm.load(jm.contract(block(), T0=0.0, a_over_D=None), jm.Stretch("x", 1.2))

    many, few = stretched((30, 200)), stretched((most, most))
    assert int(few.work["inner solves"]) > int(many.work["inner solves"])
    assert (int(few.steps), int(few.rejected)) == (int(many.steps), 0)
    np.testing.assert_allclose(few.u, many.u, atol=1e-11)
    sparse.forget()
