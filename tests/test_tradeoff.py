"""The trade of speed for accuracy: the front, extrapolation, errors by source, and small runs of the whole chain."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import jaxmyo_in
from hypothesis import given
from hypothesis import strategies as st

from jaxmyo.extrapolation import neville
from jaxmyo.tradeoff import extremes, plan
from jaxmyo.tradeoff.bodies import BODIES
from jaxmyo.tradeoff.dials import Dials
from jaxmyo.tradeoff.errors import Truth, counted, error, extrapolated, finest, split
from jaxmyo.tradeoff.front import STEP, behind, front, pareto
from jaxmyo.tradeoff.measure import Effort, Point, measure
from jaxmyo.tradeoff.report import write as write_report
from jaxmyo.tradeoff.store import Store
from jaxmyo.tradeoff.trade import Trade, effects

FRONT = Path(__file__).parents[1] / "jaxmyo" / "datasets" / "front.json"

numbers = st.floats(min_value=1e-12, max_value=1e3)
clouds = st.lists(st.tuples(numbers, numbers), min_size=1, max_size=40)


def beats(a: tuple[float, float], b: tuple[float, float]) -> bool:
    """At most as slow and at most as wrong, and better in one of the two."""
    return a[0] <= b[0] and a[1] <= b[1] and a != b


@given(clouds)
def test_nothing_beats_the_front_and_the_front_beats_or_equals_all_else(points: list[tuple[float, float]]) -> None:
    on_front = [points[k] for k in pareto(*zip(*points, strict=True))]
    assert not any(beats(p, f) for p in points for f in on_front)
    assert all(any(beats(f, p) or f == p for f in on_front) for p in points)


@given(clouds)
def test_the_front_goes_from_cheap_to_exact(points: list[tuple[float, float]]) -> None:
    on_front = [points[k] for k in pareto(*zip(*points, strict=True))]
    seconds, errors = zip(*on_front, strict=True)
    assert all(np.diff(seconds) > 0.0)
    assert all(np.diff(errors) < 0.0)
    assert seconds[0] == min(s for s, _ in points)
    assert errors[-1] == min(e for _, e in points)


@given(clouds, st.randoms(use_true_random=False))
def test_the_front_does_not_depend_on_the_order(points: list[tuple[float, float]], random: Any) -> None:
    shuffled = list(points)
    random.shuffle(shuffled)
    fronts = [[p[k] for k in pareto(*zip(*p, strict=True))] for p in (points, shuffled)]
    assert fronts[0] == fronts[1]


@given(clouds, numbers, numbers)
def test_another_point_only_takes_points_off_the_front(points: Any, seconds: float, wrong: float) -> None:
    before = {points[k] for k in pareto(*zip(*points, strict=True))}
    more = [*points, (seconds, wrong)]
    after = {more[k] for k in pareto(*zip(*more, strict=True))}
    assert after <= before | {(seconds, wrong)}


def test_the_front_of_some_points() -> None:
    assert pareto([1.0, 2.0, 3.0, 4.0], [4.0, 3.0, 3.5, 1.0]) == [0, 1, 3]
    assert pareto([1.0, 1.0], [2.0, 2.0]) == [0]
    with pytest.raises(ValueError, match="finite"):
        pareto([1.0, np.nan], [1.0, 1.0])
    with pytest.raises(ValueError, match="one length"):
        pareto([1.0], [1.0, 2.0])


def made(elements: int, outputs: tuple[float, float], **given: Any) -> Point:
    dials = {k: given.pop(k) for k in list(given) if k in Dials.__dataclass_fields__}
    known = {"seconds": 2.0 * elements, "cpu_seconds": float(elements), "memory_MB": 100.0 + elements}
    return Point("radial", Dials(elements=elements, **dials), "CONVERGED", outputs, **(known | given))


@given(st.floats(0.5, 2.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_extrapolation_is_exact_for_polynomials_in_the_square_of_h(limit: float, a: float, b: float) -> None:
    values = [(limit + a * h**2 + b * h**4,) for h in (0.25, 0.125, 0.0625)]
    assert neville(values, (0.25, 0.125, 0.0625))[0] == pytest.approx(limit, rel=1e-12)


def test_extrapolations_are_of_meshes_that_differ_in_nothing_else() -> None:
    at = {n: made(n, (1.0 + 1.0 / n**2 + 2.0 / n**4, 2.0)) for n in (4, 8, 16)}
    loose = made(8, (1.5, 2.0), tolerance=1e-4)
    found = {(p.dials.elements, p.dials.extrapolated): p for p in extrapolated([*at.values(), loose])}
    assert set(found) == {(8, 2), (16, 2), (16, 3)}
    assert found[16, 3].outputs == pytest.approx((1.0, 2.0), rel=1e-12)
    assert found[16, 3].cpu_seconds == 28.0
    assert found[16, 3].memory_MB == 116.0
    assert found[16, 3].parts == (at[4], at[8], at[16])


def test_the_finest_meshes_tell_the_truth_by_the_order_that_they_show() -> None:
    points = [made(n, (3.0 + n**-1.5, 1.0 - 0.5 * n**-2.0)) for n in (8, 16, 32)]
    truth = finest(points, Dials(), (8, 16, 32))
    assert truth.outputs == pytest.approx((3.0, 1.0), rel=1e-12)
    assert truth.doubt[0] > 1e-4
    assert truth.doubt[1] < 1e-12
    assert "1.50, 2.00" in truth.source
    with pytest.raises(ValueError, match="did not converge"):
        finest(points[:2], Dials(), (8, 16, 32))
    with pytest.raises(ValueError, match="does not converge"):
        finest([made(n, (1.0 + n, 1.0 + 1.0 / n)) for n in (8, 16, 32)], Dials(), (8, 16, 32))
    turns = finest([made(n, (1.0 + n**-2.0, x)) for n, x in ((8, 1.0), (16, 1.1), (32, 1.0))], Dials(), (8, 16, 32))
    assert turns.outputs == pytest.approx((1.0, 1.0), rel=1e-12)
    assert turns.doubt[1] == pytest.approx(0.1)
    assert turns.source.endswith("2.00, none")


def test_errors_are_told_by_source() -> None:
    """What was put in comes out: discretisation 1e-2, quadrature 1e-3, algebra 1e-4, precision 1e-5."""
    truth = Truth((1.0, 1.0), (0.0, 0.0), "")
    parts = {"discretisation": 1e-2, "quadrature": 1e-3, "algebra": 1e-4, "precision": 1e-5}

    def point(quadrature: int, tolerance: float, precision: Any) -> Point:
        off = parts["discretisation"]
        off += parts["quadrature"] if quadrature == 2 else 0.0
        off += parts["algebra"] if tolerance > 1e-13 else 0.0
        off += parts["precision"] if precision == "float32" else 0.0
        return made(8, (1.0 + off, 1.0), quadrature=quadrature, tolerance=tolerance, precision=precision)

    grid = [point(q, t, p) for q in (2, 4) for t in (1e-13, 1e-4) for p in ("float64", "float32")]
    worst = next(p for p in grid if p.dials == Dials(elements=8, tolerance=1e-4, precision="float32"))
    assert split(worst, grid, truth) == pytest.approx(parts, rel=1e-9)
    assert error(worst, truth) == pytest.approx(sum(parts.values()))
    alone = split(worst, [worst], truth)
    assert alone["quadrature"] is None
    assert alone["precision"] is None


def test_parts_that_cancel_are_counted() -> None:
    truth = Truth((1.0, 1.0), (0.0, 0.0), "")
    plain = made(8, (1.0 - 1e-3, 1.0))
    lucky = made(8, (1.0 - 1e-6, 1.0), tolerance=1e-2)
    assert error(lucky, truth) == pytest.approx(1e-6)
    assert counted(lucky, [plain, lucky], truth) == pytest.approx(1e-3 + (1e-3 - 1e-6))
    assert counted(plain, [plain, lucky], truth) == pytest.approx(1e-3)


def test_what_a_dial_costs_and_buys() -> None:
    base, fine, dear = made(8, (1.01, 1.0)), made(16, (1.0025, 1.0)), made(8, (1.01, 1.0), move=0.1, cpu_seconds=24.0)
    failed = Point("radial", Dials(elements=8, precision="float32"), "SINGULAR")
    trade = Trade(BODIES["radial"], base, Truth((1.0, 1.0), (0.0, 0.0), ""), [base, fine, dear, failed], [])
    assert trade.front == front(trade.every, trade.error) == [base, fine]
    found = {next(iter(e.changes)): e for e in effects(trade)}
    assert set(found) == {"elements", "move"}
    assert found["elements"].errors == pytest.approx(0.25)
    assert found["elements"].seconds == 2.0
    assert found["move"].errors == 1.0
    assert found["move"].behind == behind(dear, trade.front, trade.error) == 3.0


@pytest.mark.parametrize("quick", [True, False])
@pytest.mark.parametrize("body", BODIES)
def test_every_plan_has_its_base_and_scenes(body: str, quick: bool) -> None:
    settings = plan.plan(body, quick)
    base = (plan.QUICK_BASE if quick else plan.BASE)[body]
    assert base in settings
    finest_meshes = (plan.QUICK_FINEST if quick else plan.FINEST).get(body, ())
    assert all(replace(base, elements=n) in settings for n in finest_meshes)
    small = [d for d in settings if d.elements <= 8] if quick else []
    for program in {d.program: d for d in small}.values():
        scene = BODIES[body].scene(program)
        assert {n for n in scene.orders if n > 1} <= {program.quadrature}


def test_the_store_goes_on_where_it_stood(tmp_path: Path) -> None:
    path, versions = tmp_path / "points.jsonl", {"jax": "1"}
    store = Store(path, versions)
    point = made(8, (1.0, 2.0), move=0.1)
    store.keep(point)
    store.keep(Point("radial", Dials(elements=4), "refused: why"))
    again = Store(path, versions)
    assert again.points == store.points
    assert again.of("radial", [point.dials]) == [point]
    assert again.of("block", [point.dials]) == []
    with path.open("a", encoding="utf-8") as file:
        file.write('{"body": "rad')  # a run that was killed while it wrote
    cut = Store(path, versions)
    assert cut.points == store.points
    cut.keep(point)
    assert Store(path, versions).points == [*store.points, point]
    assert Store(path, {"jax": "2"}).points == []


def silent(_: str) -> None:
    pass


def test_float32_is_compared_with_float64_case_by_case(tmp_path: Path) -> None:
    told = {"status": "CONVERGED", "radius": 2.0, "p": 10.0}
    off = told | {"radius": 2.0 * (1.0 + 1e-6), "p": 11.0}
    failed = told | {"status": "SINGULAR"}
    n = len(extremes.CASES)
    found = {"float64": [told] * n, "float32": [off] * (n - 1) + [failed], "mixed": [told] * n}
    path = tmp_path / "extremes.json"
    path.write_text(json.dumps({"versions": {"jax": "1"}, "cases": found}))
    rows = extremes.rows(extremes.measured(path, {"jax": "1"}, silent))
    assert rows[0][:4] == ("0.75", "1", "18", "CONVERGED")
    assert rows[0][4:] == ("CONVERGED", "1.0e-06", "1.0e-01", "CONVERGED", "0.0e+00", "0.0e+00")
    assert rows[-1][4:7] == ("SINGULAR", "–", "–")


def test_a_few_settings_from_end_to_end(tmp_path: Path) -> None:
    """The sample measured in a process of its own, compared with its exact solution, and reported."""
    base = Dials(elements=1)
    asked = [base, replace(base, tolerance=1e-3), replace(base, model="3-D", quadrature=9)]
    points = list(measure("sample", asked, Effort(3, 0.1), silent))
    assert [p.status for p in points[:2]] == ["CONVERGED", "CONVERGED"]
    assert points[2].status.startswith("refused: quadrature = ")
    assert not points[2].converged
    body = BODIES["sample"]
    assert body.exact is not None
    trade = Trade(body, points[0], Truth(body.exact(), (0.0, 0.0), "exact"), points, extrapolated(points))
    assert trade.error(points[0]) == 1e-13  # round-off
    assert 1e-12 < trade.error(points[1]) < 1e-2
    assert points[0].unknowns == 5
    assert points[0].cold_seconds > points[0].seconds > 0.0
    assert points[0].memory_MB > points[0].idle_MB > 50.0
    text = write_report(tmp_path / "report.md", [trade], {"sample": tmp_path / "front.png"}, {"jax": "1"}).read_text()
    assert body.title in text
    assert "tolerance = 0.001" in text
    assert "refused: quadrature" in text


def test_the_front_in_the_package_is_one() -> None:
    data = json.loads(FRONT.read_text(encoding="utf-8"))
    assert set(data["bodies"]) <= set(BODIES)
    for body in data["bodies"].values():
        for front_of in ("on_front", "on_plain_front"):
            some = [s for s in body["settings"] if s[front_of]]
            seconds, errors = ([s[key] for s in some] for key in ("cpu_seconds", "error"))
            assert some
            assert pareto(seconds, errors) == list(range(len(seconds)))


@pytest.mark.slow
def test_the_truth_in_the_package_is_the_exact_one() -> None:
    for name, body in json.loads(FRONT.read_text(encoding="utf-8"))["bodies"].items():
        exact = BODIES[name].exact
        if exact is not None:
            assert body["truth"] == pytest.approx(exact()[0], rel=1e-12)


@pytest.fixture(scope="module")
def radial_points() -> list[Point]:
    """The radial tube: two meshes, two orders, a loose tolerance."""
    base = Dials(elements=8)
    settings = [replace(base, elements=n, tolerance=t) for n in (8, 16) for t in (1e-13, 1e-3)]
    return list(measure("radial", [*settings, replace(base, quadrature=3)], Effort(3, 0.1), silent))


@pytest.mark.slow
def test_the_errors_of_the_radial_tube_obey_known_rates(radial_points: list[Point]) -> None:
    """Discretisation: second order; two Gauss points: fourth; algebra: of the tolerance; extrapolation: fourth."""
    body = BODIES["radial"]
    assert body.exact is not None
    truth = Truth(body.exact(), (0.0, 0.0), "")
    at = {p.dials: p for p in radial_points}
    coarse, fine = (at[Dials(elements=n)] for n in (8, 16))
    assert 3.5 < error(coarse, truth) / error(fine, truth) < 4.5
    parts = split(at[Dials(elements=8, tolerance=1e-3)], radial_points, truth)
    assert parts["quadrature"] is not None
    assert parts["discretisation"] is not None
    assert parts["algebra"] is not None
    assert parts["quadrature"] < parts["discretisation"]
    assert 0.0 < parts["algebra"] < 1e-3
    (both,) = [p for p in extrapolated(radial_points) if p.dials.tolerance == 1e-13]
    assert error(both, truth) < 0.2 * error(fine, truth)


@pytest.mark.slow
def test_the_quick_command(tmp_path: Path) -> None:
    run: Callable[..., Any] = jaxmyo_in(tmp_path)
    done = run("tradeoff", "--quick", "--json", "--out", "out")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert set(result["bodies"]) == set(BODIES)
    for file in result["files"]:
        assert (tmp_path / file).stat().st_size > 0
    for name, body in result["bodies"].items():
        assert body["converged"] >= 2, (name, body["failures"])
        assert body["front"][-1]["error"] <= STEP * body["base"]["error"]
    again = run("tradeoff", "--quick", "--out", "out")
    assert again.returncode == 0, again.stderr
    assert "setting(s)" not in again.stderr  # nothing is measured twice
