"""The tube in `jaxmyo paper`: the exact solution against the reference, the accuracy, the claims, and the files.

The solves of the elements are those of the one run of the command.
"""

import csv
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import reference
import reference_tube

import jaxmyo as jm
from jaxmyo.paper import exact_tube, tube_accuracy, tube_tension
from jaxmyo.paper import tube as cycle_of_tube
from jaxmyo.paper.exact_tube import Muscle, Pair, Wall
from jaxmyo.paper.homogeneous import CONSTRAINT
from jaxmyo.paper.tube import Tube, Walls
from jaxmyo.paper.tube_accuracy import Accuracy
from jaxmyo.paper.tube_claims import claims
from jaxmyo.paper.tube_tension import Change

T0, A_OVER_D = 15.0, 0.2
R = np.linspace(2.0, 3.5, 7)
CASES = ("with_constraint", "without_constraint")


@cache
def way_up(
    name: str, a_over_D: float | None, T0: float = T0, k: float | None = None, q_space: Any = "uniform"
) -> tuple[reference_tube.CycleStep, reference_tube.CycleStep]:
    """The reference at s = 0 and s = ½."""
    steps = reference_tube.cycle(
        reference.SETS[name], reference_tube.Tube(), T0, a_over_D, np.linspace(0.0, 0.5, 11), k, q_space
    )
    return steps[0], steps[-1]


def near(wall: reference_tube.Wall, q: float = 0.0) -> Wall:
    """A start that is off by a percent."""
    return Wall(1.01 * wall.ri, 0.99 * wall.lz, 1.01 * q)


def assert_is(found: Wall, expected: reference_tube.Wall) -> None:
    np.testing.assert_allclose([found.ri, found.ro, found.height], [expected.ri, expected.ro, expected.lz], rtol=1e-10)
    np.testing.assert_allclose(found.r(R), expected.r(R), rtol=1e-10)


# ------------------------------------------------------------------------------------------------- the exact solution


@pytest.mark.parametrize("name", ["table1", "printed", "measured"])
@pytest.mark.parametrize("acting", CONSTRAINT)
def test_exact_states(name: str, acting: bool) -> None:
    _, half = way_up(name, A_OVER_D if acting else None)
    muscle, weave = Muscle(jm.SETS[name], T0, 1.0, A_OVER_D), exact_tube.WEAVE[acting]
    found = exact_tube.pair(muscle, weave, 18.0, Pair(near(half.A, half.A.q or 0.0), near(half.C)))
    assert_is(found.A, half.A)
    assert_is(found.C, half.C)
    assert found.A.q == pytest.approx(half.A.q, rel=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("q_space", ["uniform", "local"])
@pytest.mark.parametrize("k", [10.0, 1e4])
def test_exact_states_with_a_soft_weave(q_space: Any, k: float) -> None:
    _, half = way_up("table1", A_OVER_D, T0, k, q_space)
    muscle = Muscle(jm.TABLE1, T0, 1.0, A_OVER_D, 1.0 / k)
    found = exact_tube.pair(muscle, q_space, 18.0, Pair(near(half.A, half.A.q or 0.0), near(half.C)))
    assert_is(found.A, half.A)
    assert_is(found.C, half.C)


def test_passive_tube_under_pressure() -> None:
    rest, _ = way_up("table1", None)
    found = exact_tube.inflate(Wall(2.0, 1.0), Muscle(jm.TABLE1, T0, 0.0, A_OVER_D), "none", 8.0, near(rest.C))
    assert_is(found, rest.C)


def test_no_exact_state_is_an_error() -> None:
    """So far off that exp Q is beyond float64."""
    with pytest.raises(jm.SolveError, match="no exact tube was found near ri = 40 mm"):
        exact_tube.contract(Muscle(jm.TABLE1, T0, 1.0, A_OVER_D), "none", Wall(40.0, 1.0))


def pairs(name: str) -> list[list[Pair]]:
    found = []
    for a_over_D in (A_OVER_D, None):
        steps = way_up(name, a_over_D)
        walls = [[Wall(w.ri, w.lz, getattr(w, "q", None) or 0.0) for w in (step.A, step.C)] for step in steps]
        found.append([Pair(*pair) for pair in walls])
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", ["table1", "printed"])
def test_other_tensions_are_on_the_branch_of_the_cycle(name: str) -> None:
    accuracy = Accuracy([], pairs(name), np.zeros(()), np.zeros(()))
    found = {change.T0: change for change in tube_tension.changes(jm.SETS[name], accuracy)}
    assert list(found) == [5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0]
    for tension in (5.0, 45.0):
        for a_over_D, value in ((A_OVER_D, found[tension].with_constraint), (None, found[tension].without)):
            rest, half = way_up(name, a_over_D, tension)
            assert value == pytest.approx(half.C.ri - rest.C.ri, abs=1e-10)


# ------------------------------------------------------------------------------------------------------- the accuracy


def test_l2_error_of_a_scaled_radius() -> None:
    wall = Wall(3.0, 0.9)
    fine = np.linspace(2.0, 3.5, 2001)
    assert tube_accuracy.l2_error(fine, 1.001 * wall.r(fine), wall) == pytest.approx(1e-3, rel=1e-3)
    coarse = fine[::250]
    assert 1e-5 < tube_accuracy.l2_error(coarse, wall.r(coarse), wall) < 1e-3  # linear between exact nodes


def walls(r: Any, **other: Any) -> Walls:
    """States with radii r (..., n + 1), everything else as in `other` or nothing."""
    shape = np.shape(r)[:-1]
    fields = {name: np.zeros(shape) for name in Walls._fields} | {"r": np.asarray(r), "height": np.ones(shape)}
    return Walls(**fields | {"T_f": np.zeros((*shape, 2)), "T_cf": np.zeros((*shape, 2))} | other)


def made_up(n: int, A: Walls, C: Walls) -> Tube:
    none: Any = None
    return Tube(n, cycle_of_tube.ENDS, np.linspace(2.0, 3.5, n + 1), A, C, (none, none), 1.0, 2.0)


def test_extrapolation_of_a_polynomial_in_h2() -> None:
    tubes = []
    for n in (4, 8, 16):
        nodes = np.linspace(2.0, 3.5, n + 1)
        r = nodes**2 + 3.0 * nodes / n**2 - 5.0 * np.sin(nodes) / n**4
        tubes.append(made_up(n, *2 * [walls(np.broadcast_to(r, (2, 2, n + 1)))]))
    limit = tube_accuracy.extrapolate("C", tubes)
    assert limit.shape == (2, 2, 5)
    np.testing.assert_allclose(limit, np.broadcast_to(tubes[0].R ** 2, limit.shape), rtol=1e-14)


@pytest.fixture(scope="module")
def tube_json(paper_result: dict[str, Any]) -> dict[str, Any]:
    return paper_result["tube"]


def test_the_errors_fall_with_order_two(tube_json: dict[str, Any]) -> None:
    meshes = tube_json["accuracy"]["meshes"]
    assert [mesh["elements"] for mesh in meshes] == [16, 32, 64]
    for kind, case in product("AC", CASES):
        errors = [mesh["relative_L2_error"][kind][case] for mesh in meshes]
        assert errors[0] < 3e-4
        np.testing.assert_allclose([step[kind][case] for step in tube_json["accuracy"]["orders"]], 2.0, atol=0.02)
        np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.02)
    for mesh in meshes:
        assert 0.0 < mesh["solve_seconds"] < mesh["total_seconds"]


def test_extrapolated_the_error_is_less_than_that_of_the_paper(tube_json: dict[str, Any]) -> None:
    for kind, case in product("AC", CASES):
        assert 0.0 < tube_json["accuracy"]["extrapolated_relative_L2_error"][kind][case] < 1e-10


def test_the_elements_are_near_the_reference(tube_json: dict[str, Any]) -> None:
    for case, a_over_D in (("with_constraint", A_OVER_D), ("without_constraint", None)):
        for end, step in zip(("s0", "half"), way_up("table1", a_over_D), strict=True):
            for kind in "AC":
                found, expected = tube_json[case][end][kind], getattr(step, kind)
                radii = [found["ri_mm"], found["ro_mm"]]
                np.testing.assert_allclose(radii, [expected.ri, expected.ro], rtol=1.5e-4)
                assert found["height_ratio"] == pytest.approx(expected.lz, rel=1.5e-4)
            assert tube_json[case][end]["A"]["q_kPa"] == pytest.approx(step.A.q, rel=1e-4, abs=1e-9)
    assert tube_json["up_and_down_mm"] < 1e-11


# --------------------------------------------------------------------------------------------------------- the claims


def verdicts(tube: Tube, error: float = 1e-6, changes: Any = None) -> list[bool]:
    other = [Change(T, 0.1, 0.0) for T in (5.0, 45.0)] if changes is None else changes
    errors = np.full((1, 2, 2, 2), error)
    return [claim.reproduced for claim in claims(tube, Accuracy([tube], [], errors, 1e-3 * errors[0]), other)]


def test_the_claims_follow_the_numbers() -> None:
    """A tube that does all that the paper says, and one that does the opposite."""
    C_good = [[[3.0, 4.0], [2.95, 4.3]], [[3.0, 4.0], [2.9, 3.9]]]  # constraint × time × (inner, outer)
    C_bad = [[[3.0, 4.0], [3.4, 4.0]], [[3.0, 4.0], [3.1, 3.95]]]
    rest, half = np.zeros((2, 2)), np.array([[-0.8, -1.0], [0.0, 0.0]])
    T_good = np.stack([rest, half], axis=1)  # constraint × time × (inner, outer)
    still = walls(np.broadcast_to([2.0, 3.5], (2, 2, 2)))
    heights = np.array([[0.9, 0.7], [0.9, 1.0]])
    good = made_up(1, still._replace(T_f=T_good, T_cf=-T_good), walls(C_good, height=heights))
    bad = made_up(1, still._replace(T_f=T_good[..., ::-1], T_cf=-T_good), walls(C_bad, height=heights[:, ::-1]))
    assert verdicts(_and_down(good), 1e-10) == [True] * 8
    assert verdicts(_and_down(bad), 1e-5) == [False] * 8


def _and_down(tube: Tube) -> Tube:
    """With the state at s = 1, which is that at s = 0."""
    back = [0, 1, 0]
    A, C = (w.at(slice(None), back) for w in (tube.A, tube.C))
    return replace(tube, s=np.array([0.0, 0.5, 1.0]), A=A, C=C)


def test_the_claim_of_the_inner_radius_names_the_tensions(paper_result: dict[str, Any]) -> None:
    (claim,) = [c for c in paper_result["claims"] if "inner radius decreases" in c["statement"]]
    assert not claim["reproduced"]
    assert "by 0.0753 mm with, 0.0038 mm without; at no T0 from 5 to 45 kPa" in claim["computed"]


def test_verdicts_of_table1(paper_result: dict[str, Any]) -> None:
    found = [claim["reproduced"] for claim in paper_result["claims"] if "tube" in claim["statement"]]
    assert found == [True, True, True, False, True, False, False, True]


# ---------------------------------------------------------------------------------------------------------- the files


def test_csv_over_the_cycle(paper_folder: Path, tube_json: dict[str, Any]) -> None:
    with (paper_folder / "all" / "tube.csv").open(encoding="utf-8") as file:
        states = list(csv.DictReader(file))
    assert len(states) == 2 * 41
    units = ("s", "beta", "a_over_D", "constraint", "elements", "set")
    for name in states[0]:
        without = name in units or name.startswith(("height_ratio", "status", "negative_eigen", "relative_residual"))
        assert without != name.endswith(("_mm", "_kPa")), name
    for row in states:
        assert {row["status_A"], row["status_C"]} == {"CONVERGED"}
        assert max(float(row[f"relative_residual_{kind}"]) for kind in "AC") <= 1e-13
        assert (row["q_A_kPa"] == "") == (row["constraint"] == "0")

    def column(name: str) -> np.ndarray:
        return np.array([float(row[name]) for row in states]).reshape(2, 41)

    np.testing.assert_allclose(column("beta"), np.sin(np.pi * column("s")) ** 2, atol=1e-12)
    np.testing.assert_allclose(column("pressure_C_kPa"), 8.0 + 10.0 * column("beta"), atol=1e-10)
    for kind in "AC":
        ri, ro, height = (column(name) for name in (f"ri_{kind}_mm", f"ro_{kind}_mm", f"height_ratio_{kind}"))
        np.testing.assert_allclose(column(f"wall_{kind}_mm"), ro - ri, atol=1e-11)
        np.testing.assert_allclose(ri, ri[:, ::-1], atol=1e-11)
        np.testing.assert_allclose((ro**2 - ri**2) * height, 3.5**2 - 2.0**2, rtol=1e-3)  # the volume
        for case, c in (("with_constraint", 0), ("without_constraint", 1)):
            assert tube_json[case]["half"][kind]["ri_mm"] == pytest.approx(ri[c, 20], rel=1e-11)
    np.testing.assert_array_equal(column("T_cf_inner_kPa")[1], 0.0)
    np.testing.assert_allclose(column("T_cf_inner_kPa"), column("T_cf_outer_kPa"), rtol=1e-9, atol=1e-12)
    q = np.array([float(row["q_A_kPa"]) for row in states[:41]])
    np.testing.assert_allclose(column("T_cf_inner_kPa")[0], 0.5 * q * column("height_ratio_A")[0], rtol=1e-9)


def test_csv_of_the_soft_weave(paper_folder: Path, tube_json: dict[str, Any]) -> None:
    """A q in each element: the same tube as with a q at every radius, which locks when the weave is stiff."""
    with (paper_folder / "all" / "tube_weave.csv").open(encoding="utf-8") as file:
        states = list(csv.DictReader(file))
    assert [float(row["elements"]) for row in states] == [4.0] * 13 + [16.0] * 13
    fine = {float(row["weave_stiffness_kPa"]): row for row in states[13:]}
    for k in (10.0, 1e4):
        _, half = way_up("table1", A_OVER_D, T0, k, "local")
        for kind in "AC":
            radii = [float(fine[k][f"{r}_{kind}_mm"]) for r in ("ri", "ro")]
            np.testing.assert_allclose(radii, [getattr(half, kind).ri, getattr(half, kind).ro], rtol=8e-4)
    assert float(fine[1e6]["ri_A_mm"]) > 1.95


def test_states_for_paraview(paper_folder: Path, tube_json: dict[str, Any]) -> None:
    for case, end, kind in product(CASES, ("s0", "half"), "AC"):
        name = f"tube_{end}_{kind}{'' if case == 'with_constraint' else '_' + case}.vtu"
        mesh = meshio.read(paper_folder / "all" / name)
        expected = tube_json[case][end][kind]
        x = mesh.points + mesh.point_data["displacement_mm"]
        r = np.hypot(x[:, 0], x[:, 1])
        np.testing.assert_allclose([r.min(), r.max()], [expected["ri_mm"], expected["ro_mm"]], rtol=1e-12)
        assert np.ptp(x[:, 2]) == pytest.approx(20.0 * expected["height_ratio"], rel=1e-12)
        assert ("q_kPa" in mesh.cell_data) == ((kind, case) == ("A", "with_constraint"))
        assert len(mesh.cells[0].data) == 32 * 48


# --------------------------------------------------------------------------------------------------------- the errors


def test_a_state_that_is_not_found_is_an_error() -> None:
    found = walls(np.zeros((2, 3)), status=np.array([0, 2]), reached=np.array([1.0, 0.4]))
    with pytest.raises(jm.SolveError, match=r"1 of 2 states were not found; the first, b: NO_DESCENT at 40 %"):
        cycle_of_tube.check(found, ["a", "b"])
    cycle_of_tube.check(found.at(slice(0, 1)), ["a"])
