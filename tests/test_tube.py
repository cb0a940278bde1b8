"""The active tube by elements against its exact solution: radial, axisymmetric and spatial scenes."""

import re
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest
import reference
import reference_tube as exact

import jaxmyo as jm

SET = reference.SETS["table1"]
BODY = exact.Tube()
T0, A_OVER_D = 15.0, 0.2
WEAVE = [pytest.param(None, marks=pytest.mark.slow), A_OVER_D]
N = (16, 32, 64)  # elements through the wall
GRADED = 8.0  # outer elements are larger; at the inner wall strains are
PASSIVE, ACTIVE = jm.Pressure("inner", 8.0), jm.Pressure("inner", 18.0)  # the loads at s = 0 and s = ½


class States(NamedTuple):
    """By elements or exact: A with β = 1; C0, passive at 8 kPa; C with β = 1 at 18 kPa, reached from C0."""

    A: Any
    C0: Any
    C: Any


@cache
def solution(a_over_D: float | None) -> States:
    rest = exact.contract(SET, BODY, T0, a_over_D, 0.0)
    C0 = exact.inflate(SET, BODY, rest, 8.0)
    A = exact.contract(SET, BODY, T0, a_over_D, 1.0)
    return States(A, C0, exact.inflate(SET, BODY, A, 18.0, start=C0))


def solve(scene: jm.Scene, a_over_D: float | None) -> States:
    A = jm.contract(scene, T0=T0, a_over_D=a_over_D)
    C0 = jm.load(jm.contract(scene, T0=T0, a_over_D=a_over_D, beta=0.0), PASSIVE)
    return States(A, C0, jm.load(A, ACTIVE, start=C0))


@cache
def radial(n: int, a_over_D: float | None, grading: float = 1.0) -> States:
    return solve(jm.radial_tube(n, grading=grading), a_over_D)


def side_by_side(function: Callable[..., Any], arguments: Iterable[Any]) -> list[Any]:
    """The results for each argument, two at a time: most of the time is that of the compiler."""
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(function, arguments))


def levels(a_over_D: float | None, grading: float = 1.0) -> dict[int, States]:
    return dict(zip(N, side_by_side(lambda n: radial(n, a_over_D, grading), N), strict=True))


# ---------------------------------------------------------------------------------------------------- measuring


def nodes(state: jm.State) -> tuple[Any, Any]:
    """Θ and θ of the nodes, each (n_r + 1, n_φ + 1, n_z + 1, 3)."""
    mesh = state.scene.mesh
    assert mesh.grid is not None
    shape = (*(n + 1 for n in mesh.grid), 3)
    return mesh.points.reshape(shape), (mesh.points + np.asarray(state.u)).reshape(shape)


def radii(state: jm.State) -> tuple[Any, Any]:
    """R and r of the nodes along the wall [mm]."""
    before, after = nodes(state)
    return before[:, 0, 0, 0], after[:, 0, 0, 0]


def height_ratio(state: jm.State) -> float:
    before, after = nodes(state)
    return float(after[0, 0, -1, 2] / before[0, 0, -1, 2])


def gauss(R: Any) -> tuple[Any, Any, Any]:
    """Gauss points along each element of the wall: local coordinate (8,), R and weights × R (n, 8)."""
    x, w = np.polynomial.legendre.leggauss(8)
    x, w = 0.5 * (1.0 + x), 0.5 * w
    at = R[:-1, None] + np.diff(R)[:, None] * x
    return x, at, np.diff(R)[:, None] * w * at


def l2_error(state: jm.State, wall: exact.Wall) -> float:
    """Relative L2 error of r, linear between the nodes, over the undeformed wall."""
    R, r = radii(state)
    x, at, weight = gauss(R)
    error = r[:-1, None] + np.diff(r)[:, None] * x - wall.r(at)
    return float(np.sqrt(np.sum(weight * error**2) / np.sum(weight * wall.r(at) ** 2)))


def orders(errors: Any) -> Any:
    """Orders of convergence between meshes, each twice as fine as the one before."""
    errors = np.asarray(errors)
    return np.log2(errors[:-1] / errors[1:])


def assert_second_order(errors: Any, pairs: int = 1) -> None:
    """On the `pairs` finest pairs of meshes."""
    found = orders(errors)[-pairs:]
    assert ((found >= 1.9) & (found <= 2.1)).all(), (errors, found)


def extrapolated(values: Any) -> Any:
    """Richardson's value from meshes each twice as fine as the one before: errors have an expansion in h²."""
    values = list(values)
    for k in range(1, len(values)):
        values = [(4**k * fine - coarse) / (4**k - 1) for coarse, fine in pairwise(values)]
    return values[0]


def extrapolated_radii(states: list[jm.State]) -> tuple[Any, Any]:
    """R and extrapolated r at the nodes of the first mesh, which all meshes have."""
    R, _ = radii(states[0])
    steps = [(len(radii(s)[0]) - 1) // (len(R) - 1) for s in states]
    for s, step in zip(states, steps, strict=True):
        np.testing.assert_allclose(radii(s)[0][::step], R, rtol=1e-14)
    return R, extrapolated([radii(s)[1][::step] for s, step in zip(states, steps, strict=True)])


def says(*parts: str) -> str:
    """A pattern that asks for all parts, in any order."""
    return "".join(f"(?=(?s:.*){re.escape(p)})" for p in parts)


def pressure_named(message: str) -> float:
    """The last converged pressure [kPa] that a message of a failed solve names."""
    (found,) = re.findall(r"Pressure\('inner'\) (-?[\d.e+-]+) kPa", message)
    return float(found)


# -------------------------------------------------------------------------------------------- radial convergence


@pytest.mark.slow
@pytest.mark.parametrize("a_over_D", WEAVE)
@pytest.mark.parametrize(("grading", "pairs"), [(1.0, 1), (GRADED, 2)])
def test_radii_converge_at_second_order(a_over_D: float | None, grading: float, pairs: int) -> None:
    """Equal elements are coarse at the inner wall, where strains are large: their order shows on the finer meshes."""
    states, wall = levels(a_over_D, grading), solution(a_over_D)
    for name, bound in (("A", 5e-5), ("C0", 1e-5), ("C", 1e-5)):
        errors = [l2_error(getattr(states[n], name), getattr(wall, name)) for n in N]
        assert_second_order(errors, pairs)
        assert errors[-1] < bound


@pytest.mark.slow
@pytest.mark.parametrize("a_over_D", WEAVE)
def test_multipliers_tensions_and_height_converge_at_second_order(a_over_D: float | None) -> None:
    """p by its means over the elements, the tensions at the quadrature points."""
    states, wall = levels(a_over_D, GRADED), solution(a_over_D)
    for name in ("A", "C"):
        e = getattr(wall, name)
        found: dict[str, list[float]] = {"height": [], "p": []}
        for n in N:
            s = getattr(states[n], name)
            found["height"].append(abs(height_ratio(s) - e.lz))
            _, at, weight = gauss(radii(s)[0])
            mean, volume = np.average(e.p(at), axis=1, weights=weight), weight.sum(axis=1)
            p = np.asarray(s.p)
            found["p"].append(float(np.sqrt(np.sum(volume * (p - mean) ** 2) / np.sum(volume * mean**2))))
            if a_over_D is None:
                assert s.q is None
                assert not np.asarray(s.T_f).any()
                assert not np.asarray(s.T_cf).any()
                continue
            at = np.asarray(s.system.theta)[..., 0]
            for field in ("T_f", "T_cf"):
                error = np.abs(np.asarray(getattr(s, field)) - getattr(e, field)(at)).max()
                found.setdefault(field, []).append(float(error))
            if name == "A":
                assert s.q.shape == (1,)
                found.setdefault("q", []).append(abs(float(s.q[0]) - e.q))
        for errors in found.values():
            assert_second_order(errors, 2)


def assert_extrapolates(states: list[States], a_over_D: float | None) -> None:
    wall = solution(a_over_D)
    for name in ("A", "C"):
        e, meshes = getattr(wall, name), [getattr(s, name) for s in states]
        R, r = extrapolated_radii(meshes)
        assert np.linalg.norm(r - e.r(R)) < 1e-9 * np.linalg.norm(e.r(R))
        assert abs(extrapolated([height_ratio(s) for s in meshes]) - e.lz) < 1e-9


@pytest.mark.parametrize("a_over_D", WEAVE)
def test_extrapolation_reaches_1e_9(a_over_D: float | None) -> None:
    """From 16, 32 and 64 elements, graded towards the inner wall."""
    assert_extrapolates(list(levels(a_over_D, GRADED).values()), a_over_D)


@pytest.mark.slow
@pytest.mark.parametrize("a_over_D", WEAVE)
def test_extrapolation_from_equal_elements(a_over_D: float | None) -> None:
    assert_extrapolates([radial(8, a_over_D), *levels(a_over_D).values(), radial(128, a_over_D)], a_over_D)


@pytest.mark.parametrize(
    ("a_over_D", "name", "ri", "ro", "height"),
    [
        (A_OVER_D, "C0", 3.4244, 4.6118, 0.8646),
        (None, "C0", 3.4244, 4.6118, 0.8646),
        (A_OVER_D, "C", 3.3492, 4.7859, 0.7059),
        (None, "C", 3.4206, 4.4639, 1.0030),
    ],
)
def test_figures_of_the_tube(a_over_D: float | None, name: str, ri: float, ro: float, height: float) -> None:
    """To all digits given, at s = 0 (C0) and s = ½ (C)."""
    states = [getattr(s, name) for s in levels(a_over_D, GRADED).values()]
    _, r = extrapolated_radii(states)
    assert abs(r[0] - ri) <= 5e-5
    assert abs(r[-1] - ro) <= 5e-5
    assert abs(extrapolated([height_ratio(s) for s in states]) - height) <= 5e-5


def test_grading_is_a_map_that_nests() -> None:
    """Elements grow outwards, and every node of a mesh is one of the mesh twice as fine."""
    coarse, fine = (jm.radial_tube(n, grading=GRADED).mesh.points[::4, 0] for n in N[:2])
    np.testing.assert_allclose(fine[::2], coarse, rtol=1e-15)
    size = np.diff(coarse)
    np.testing.assert_allclose(size[1:] / size[:-1], GRADED ** (1 / 16), rtol=1e-12)
    np.testing.assert_allclose(coarse[[0, -1]], [2.0, 3.5], rtol=1e-15)


# ------------------------------------------------------------------------------------------- global equilibrium


def sections(state: jm.State) -> tuple[float, float]:
    """Axial force ∫ σzz da on a section across [mN], and hoop force per height ∫ σθθ dr of one wall [mN/mm].

    Sums over the quadrature points of the whole tube, with dv = weight × det F: da = dv / height, dr dz = dv / 2πr.
    """
    before, after = nodes(state)
    height = after[0, 0, -1, 2] - after[0, 0, 0, 2]
    dv = np.asarray(state.system.weight) * np.linalg.det(np.asarray(state.F))
    R = np.asarray(state.system.theta)[..., 0]
    r = np.interp(R, before[:, 0, 0, 0], after[:, 0, 0, 0])
    sigma = np.asarray(state.cauchy)
    axial = np.sum(dv * sigma[..., 2, 2]) / height
    return float(axial), float(np.sum(dv * sigma[..., 1, 1] / (2.0 * np.pi * r)) / height)


@pytest.mark.slow
@pytest.mark.parametrize("a_over_D", WEAVE)
def test_open_ends_carry_no_force(a_over_D: float | None) -> None:
    for state, P in zip(radial(16, a_over_D), (0.0, 8.0, 18.0), strict=True):
        axial, hoop = sections(state)
        ri = radii(state)[1][0]
        assert abs(axial) < 1e-9
        np.testing.assert_allclose(hoop, P * ri, rtol=1e-11, atol=1e-10)
        np.testing.assert_allclose(np.asarray(state.reaction("z1")), 0.0, atol=1e-9)


@cache
def closed(P: float) -> jm.State:
    return jm.load(radial(16, A_OVER_D).A, jm.Pressure("inner", P, ends="closed"), throw=False)


def test_closed_ends_carry_the_thrust() -> None:
    state, e = closed(7.0), exact.inflate(SET, BODY, solution(A_OVER_D).A, 7.0, "closed")
    assert bool(state.converged)
    axial, hoop = sections(state)
    ri = radii(state)[1][0]
    np.testing.assert_allclose(axial, np.pi * ri**2 * 7.0, rtol=1e-11)
    np.testing.assert_allclose(hoop, 7.0 * ri, rtol=1e-11)
    assert l2_error(state, e) < 2e-4
    assert abs(height_ratio(state) - e.lz) < 5e-4
    opened = exact.inflate(SET, BODY, solution(A_OVER_D).A, 7.0)
    assert abs(e.lz - opened.lz) > 0.01


# -------------------------------------------------------------------------------------------------- limit points


def limit(a_over_D: float | None, ends: Any) -> float:
    with pytest.raises(exact.LimitPoint) as caught:
        exact.inflate(SET, BODY, solution(a_over_D).A, 18.0, ends)
    return caught.value.load


def assert_stopped(state: jm.State, P: float) -> None:
    """A failed solve says so, and hands out the last converged state."""
    assert not bool(state.converged)
    assert int(state.status) == jm.Status.LIMIT_POINT
    np.testing.assert_allclose(float(state.reached), P / 18.0, rtol=1e-6)
    for field in (state.u, state.p, state.T_f, state.cauchy, state.residual):
        assert np.isfinite(np.asarray(field)).all()
    ri = radii(state)[1][0]
    np.testing.assert_allclose(sections(state)[1], P * ri, rtol=1e-5)  # the states on the way are found to 1e-7


@pytest.mark.slow
def test_limit_point_without_the_weave() -> None:
    """Loaded straight from A the pressure turns back; the message names the greatest one, which converges."""
    np.testing.assert_allclose(limit(None, "open"), 7.220144, atol=5.1e-7)
    states = [jm.load(radial(n, None).A, ACTIVE, throw=False) for n in N]
    found = [pressure_named(s.message) for s in states]
    errors = np.abs(np.array(found) - 7.220144)
    assert (errors < 1e-3 * 7.220144).all()
    assert_second_order(errors, 2)
    assert abs(extrapolated(found) - 7.220144) < 2e-6
    assert_stopped(states[0], found[0])
    with pytest.raises(jm.SolveError, match=r"^LIMIT_POINT at .* \(a limit point\): .*jaxmyo.trace") as caught:
        jm.load(radial(16, None).A, ACTIVE)
    assert pressure_named(str(caught.value)) == found[0]
    assert_stopped(caught.value.state, found[0])


def test_limit_point_with_closed_ends() -> None:
    np.testing.assert_allclose(limit(A_OVER_D, "closed"), 7.911045, atol=5.1e-7)
    state = closed(18.0)
    P = pressure_named(state.message)
    assert abs(P - 7.911045) < 1e-3 * 7.911045
    assert_stopped(state, P)


# ------------------------------------------------------------------------------------------ the space of q, soft weave


@pytest.mark.parametrize(
    "scene",
    [
        lambda: jm.radial_tube(3, q_patches=None),
        lambda: jm.radial_tube(16, q_patches=None, grading=GRADED),
        lambda: jm.axisymmetric_tube((16, 2), q_patches=None),
        lambda: jm.tube_sector((16, 2, 1), q_patches=None),
    ],
    ids=["3", "16", "axisymmetric", "sector"],
)
def test_a_q_per_element_is_redundant(scene: Callable[[], jm.Scene]) -> None:
    parts = "constraints are", "independent", "multipliers q", "jaxmyo.columns(mesh", "q_patches", "weave_stiffness"
    with pytest.raises(ValueError, match=says(*parts)) as caught:
        jm.contract(scene(), T0=T0, a_over_D=A_OVER_D)
    assert re.search("over-determined|redundant", str(caught.value))


@pytest.mark.slow
def test_a_q_per_element_of_a_soft_weave() -> None:
    """Against the exact solution whose q varies through the wall, q = −2 k h, states A and C."""
    k = 20.0
    rest, A = (exact.contract(SET, BODY, T0, A_OVER_D, beta, k, "local") for beta in (0.0, 1.0))
    C = exact.inflate(SET, BODY, A, 18.0, start=exact.inflate(SET, BODY, rest, 8.0))

    def errors(n: int) -> list[float]:
        scene = jm.radial_tube(n, grading=GRADED, q_patches=None)
        passive, a = (jm.contract(scene, T0=T0, a_over_D=A_OVER_D, beta=b, weave_stiffness=k) for b in (0.0, 1.0))
        assert a.q is not None
        assert a.q.shape == (n,)
        c = jm.load(a, ACTIVE, start=jm.load(passive, PASSIVE))
        _, at, weight = gauss(radii(a)[0])
        q = np.average(A.q_at(at), axis=1, weights=weight)
        assert np.ptp(q) > 1.0
        return [l2_error(a, A), l2_error(c, C), abs(height_ratio(a) - A.lz), float(np.abs(np.asarray(a.q) - q).max())]

    for error in np.array(side_by_side(errors, N[:2])).T:
        assert_second_order(error)


def test_a_stiff_weave_tends_to_the_constraint() -> None:
    """Like 1/k, with the slope of the exact solution; q uniform."""
    hard, wall = radial(16, A_OVER_D).A, solution(A_OVER_D).A
    q, height = [], []
    for k in (1e3, 1e4, 1e5):
        soft = jm.contract(hard.scene, T0=T0, a_over_D=A_OVER_D, weave_stiffness=k)
        e = exact.contract(SET, BODY, T0, A_OVER_D, 1.0, k)
        assert soft.q is not None
        assert hard.q is not None
        q.append(k * float(soft.q[0] - hard.q[0]))
        height.append(k * (height_ratio(soft) - height_ratio(hard)))
        np.testing.assert_allclose(q[-1], k * (e.q - wall.q), rtol=0.02)
        np.testing.assert_allclose(height[-1], k * (e.lz - wall.lz), rtol=0.02)
    np.testing.assert_allclose(q[2], q[1], rtol=4e-3)
    np.testing.assert_allclose(height[2], height[1], rtol=4e-3)
    assert abs(q[2] - q[1]) < 0.2 * abs(q[1] - q[0])


# --------------------------------------------------------------------------------------- the other scenes of the tube


def assert_same(state: jm.State, wall: jm.State) -> None:
    """The state of a three-dimensional scene with planar ends is that of the radial scene, at every point."""
    before, after = nodes(state)
    R, r = radii(wall)
    np.testing.assert_allclose(before[:, 0, 0, 0], R, rtol=1e-15)
    np.testing.assert_allclose(after[..., 0], np.broadcast_to(r[:, None, None], after.shape[:3]), rtol=0, atol=1e-9)
    np.testing.assert_allclose(after[..., 1], before[..., 1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(after[..., 2], before[..., 2] * height_ratio(wall), rtol=0, atol=1e-9)
    n = len(R) - 1
    p = np.asarray(state.p).reshape(n, -1)
    np.testing.assert_allclose(p, np.broadcast_to(np.asarray(wall.p)[:, None], p.shape), rtol=0, atol=1e-9)
    if wall.q is not None:
        assert state.q is not None
        np.testing.assert_allclose(np.asarray(state.q), float(wall.q[0]), rtol=0, atol=1e-9)
    for field in ("T_f", "T_cf"):
        found = np.asarray(getattr(state, field)).reshape(n, p.shape[1], 2, -1)  # the first points are the radial ones
        expected = np.asarray(getattr(wall, field)).reshape(n, 1, 2, 1)
        np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), rtol=0, atol=1e-9)


def assert_hoop_moment(state: jm.State, wall: jm.State) -> None:
    """Reactions of the planes φ = 0 and π/2 are conjugate to φ: ∓ ∫ σθθ r dr dz [mN·mm] over half of the height."""
    dv = np.asarray(wall.system.weight) * np.linalg.det(np.asarray(wall.F))
    moment = 0.5 * np.sum(dv * np.asarray(wall.cauchy)[..., 1, 1]) / (2.0 * np.pi)
    np.testing.assert_allclose(float(state.reaction("phi0")[1]), -moment, rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(float(state.reaction("phi1")[1]), moment, rtol=1e-9, atol=1e-8)


@pytest.fixture(scope="module")
def spatial() -> tuple[jm.Scene, jm.Scene]:
    return jm.axisymmetric_tube((16, 2)), jm.tube_sector((16, 2, 1))


@pytest.mark.slow
@pytest.mark.parametrize("a_over_D", [A_OVER_D, None])
def test_scenes_with_planar_ends_agree_with_the_radial_one(spatial: Any, a_over_D: float | None) -> None:
    axisymmetric, sector = side_by_side(lambda scene: solve(scene, a_over_D), spatial)
    for around, part, wall in zip(axisymmetric, sector, radial(16, a_over_D), strict=True):
        assert_same(around, wall)
        assert_same(part, wall)
        assert_hoop_moment(part, wall)


@pytest.mark.slow
@pytest.mark.parametrize("a_over_D", WEAVE)
def test_straight_edges_converge_at_second_order(a_over_D: float | None) -> None:
    """Cartesian hexahedra, a polygon around: to the radial scene of the same radial mesh."""
    walls = radial(4, a_over_D)
    found: list[list[float]] = []
    for around in (2, 4, 8):
        states = solve(jm.tube_sector((4, around, 1), cartesian=True), a_over_D)
        row = []
        for state, wall in zip((states.A, states.C), (walls.A, walls.C), strict=True):
            _, after = nodes(state)
            r = np.hypot(after[..., 0], after[..., 1])
            row += [np.abs(r - radii(wall)[1][:, None, None]).max(), abs(height_ratio(state) - height_ratio(wall))]
        if a_over_D is not None:
            row.append(float(np.abs(np.mean(np.asarray(states.A.T_cf)) - np.mean(np.asarray(walls.A.T_cf)))))
        found.append(row)
    for errors in np.array(found).T:
        assert_second_order(errors)
        assert errors[-1] < 0.01


@pytest.mark.slow
def test_free_ends() -> None:
    """Far from its free end the tube is the one with planar ends, under the axial force of the pressure near the end.

    The wall is no cylinder there: the pressure on it has the axial resultant π P (ri² at the end − ri² half-way).
    At half height the deformed radii are within 3e-4 mm (A) and 1.5e-3 mm (C) of those of the planar tube.
    """
    scene, planar = jm.axisymmetric_tube((8, 20), ends="free"), jm.radial_tube(8)
    # Without any shear stiffness at rest, the free rim needs a little activation on its way.
    way = jm.load(jm.contract(scene, T0=T0, a_over_D=None, beta=0.01), PASSIVE)
    for a_over_D in (None, A_OVER_D):
        passive = jm.contract(scene, T0=T0, a_over_D=a_over_D, beta=0.0)
        A = jm.contract(scene, T0=T0, a_over_D=a_over_D)
        C = jm.load(A, ACTIVE, start=jm.load(passive, PASSIVE, start=way))
        wall = radial(8, a_over_D).A
        before, after = nodes(A)
        assert np.abs(after[:, 0, 0, 0] - radii(wall)[1]).max() < 3e-4
        assert abs(after[0, 0, 1, 2] / before[0, 0, 1, 2] - height_ratio(wall)) < 4e-4
        assert np.ptp(after[:, 0, -1, 2]) > 0.05  # the end does not stay plane
        if a_over_D is not None:
            T_cf = np.asarray(A.T_cf).reshape(8, 20, 2, 2)[:, 0].mean(axis=-1)
            np.testing.assert_allclose(T_cf, np.asarray(wall.T_cf), rtol=0, atol=0.01)
        before, after = nodes(C)
        thrust = np.pi * 18.0 * (after[0, 0, -1, 0] ** 2 - after[0, 0, 0, 0] ** 2)
        force = float(C.reaction("z0")[2])
        np.testing.assert_allclose(force, thrust, rtol=1e-9)
        assert abs(thrust) > 20.0
        held = jm.Stretch("z", after[0, 0, 1, 2] / before[0, 0, 1, 2])
        rest = jm.load(jm.contract(planar, T0=T0, a_over_D=a_over_D, beta=0.0), held, PASSIVE)
        far = jm.load(jm.contract(planar, T0=T0, a_over_D=a_over_D), held, ACTIVE, start=rest)
        assert np.abs(after[:, 0, 0, 0] - radii(far)[1]).max() < 1.5e-3
        np.testing.assert_allclose(-float(far.reaction("z1")[2]), force, rtol=0.03)


# -------------------------------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("make", "parts"),
    [
        (lambda: jm.radial_tube(4, Ri=-1.0), ("Ri = -1.0", "0 ≤ Ri < Ro", "mm")),
        (lambda: jm.radial_tube(4, Ri=4.0), ("Ri = 4.0", "Ro = 3.5", "0 ≤ Ri < Ro")),
        (lambda: jm.axisymmetric_tube((4, 2), Ri=3.5), ("Ri = 3.5", "Ro = 3.5", "0 ≤ Ri < Ro")),
        (lambda: jm.tube_sector((4, 2, 1), Ro=-3.5), ("Ro = -3.5", "0 ≤ Ri < Ro")),
        (lambda: jm.radial_tube(4, Ro=np.nan), ("Ro = nan", "0 ≤ Ri < Ro")),
        (lambda: jm.radial_tube(4, height=0.0), ("height = 0.0", "positive", "mm")),
        (lambda: jm.radial_tube(4, height=-20.0), ("height = -20.0", "positive", "mm")),
        (lambda: jm.axisymmetric_tube((4, 2), height=np.nan), ("height = nan", "positive", "mm")),
        (lambda: jm.radial_tube(0), ("elements", "0", "≥ 1")),
        (lambda: jm.radial_tube(-3), ("elements", "-3", "≥ 1")),
        (lambda: jm.radial_tube(2.5), ("elements", "2.5", "≥ 1")),
        (lambda: jm.axisymmetric_tube((4, 0)), ("elements", "(4, 0)", "2 integers ≥ 1")),
        (lambda: jm.axisymmetric_tube((4, 2, 1)), ("elements", "(4, 2, 1)", "2 integers ≥ 1")),
        (lambda: jm.tube_sector((4, -1, 1)), ("elements", "(4, -1, 1)", "3 integers ≥ 1")),
        (lambda: jm.radial_tube(4, grading=0.0), ("grading = 0.0", "[0.01, 100]")),
        (lambda: jm.radial_tube(4, grading=np.nan), ("grading = nan", "[0.01, 100]")),
        (lambda: jm.axisymmetric_tube((4, 2), ends="open"), ("ends = 'open'", "'planar', 'free'")),
        (lambda: jm.tube_sector((4, 2, 1), ends="closed"), ("ends = 'closed'", "'planar', 'free'")),
        (lambda: jm.radial_tube(4, q_patches="row"), ("q_patches = 'row'", "'column'")),
        (lambda: jm.radial_tube(4, q_patches=[0, 0, 0]), ("q_patches does not cover", "(3,)", "4 element")),
        (lambda: jm.radial_tube(4, q_patches=[0, 0, -1, 0]), ("q_patches does not cover", "element 2", "-1")),
        (lambda: jm.radial_tube(4, q_patches=[0, 0, 2, 2]), ("q_patches", "patch 1 has no element")),
        (lambda: jm.tube_sector((2, 2, 1), cartesian=True, q_patches=[0]), ("q_patches does not cover", "4 element")),
    ],
)
def test_bad_scene(make: Callable[[], jm.Scene], parts: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=says(*parts)):
        make()


@pytest.mark.parametrize(
    ("condition", "parts"),
    [
        (jm.Pressure("iner", 8.0), ("face = 'iner'", "'inner'", "'outer'", "'z1'")),
        (jm.Spring("rim", 8.0), ("face = 'rim'", "'inner'", "'outer'", "'z1'")),
        (jm.Pressure("inner", 8.0, ends="shut"), ("ends = 'shut'", "'open', 'closed'")),  # type: ignore[arg-type]
        (jm.Pressure("inner", np.nan), ("Pressure('inner')", "finite", "nan")),
        (jm.Pressure("inner", [1.0, 2.0]), ("Pressure('inner')", "scalar", "(2,)")),
        (jm.Spring("outer", -1.0), ("Spring('outer')", "-1.0", "≥ 0", "kPa/mm")),
        (jm.Spring("outer", 1.0, direction="radial"), ("direction = 'radial'", "'all', 'normal'")),  # type: ignore[arg-type]
    ],
)
def test_bad_condition(condition: Any, parts: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=says(*parts)):
        jm.load(radial(16, A_OVER_D).A, condition)


def test_bad_spring_of_a_scene() -> None:
    scene = radial(16, A_OVER_D).A.scene
    with pytest.raises(ValueError, match=says("face = 'rim'", "'outer'")):
        jm.Scene(scene.mesh, scene.law, scene.constants, supports=(*scene.supports, jm.Spring("rim", 1.0)))


@pytest.mark.parametrize("k", [0.0, -2.0, np.inf, np.nan])
def test_bad_weave_stiffness(k: float) -> None:
    with pytest.raises(ValueError, match="weave_stiffness"):
        jm.contract(radial(16, A_OVER_D).A.scene, T0=T0, a_over_D=A_OVER_D, weave_stiffness=k)


def test_starts_of_another_kind() -> None:
    coarse, fine = radial(16, A_OVER_D), radial(32, A_OVER_D)
    with pytest.raises(ValueError, match=says("start", "same scene")):
        jm.load(coarse.A, ACTIVE, start=fine.C)
    with pytest.raises(ValueError, match=says("start", "weave", "a_over_D")):
        jm.contract(coarse.A.scene, T0=T0, a_over_D=None, start=coarse.A)
