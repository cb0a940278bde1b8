"""Ties: full = offset + scale · reduced[index], against maps made by hand, and the rigid motions they leave."""

from typing import Any

import jax
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo import ties

LENGTHS = (2.0, 3.0, 1.0)


@pytest.fixture(scope="module")
def mesh() -> jm.Mesh:
    return jm.box(LENGTHS, (2, 1, 1))


def matrix(built: ties.Ties) -> np.ndarray:
    """The map (n_dof, size) from the unknowns to all displacements."""
    M = np.zeros((built.scale.size, max(built.size, 1)))
    M[np.arange(built.scale.size), built.index] = built.scale
    return M[:, : built.size]


def span(*columns: np.ndarray) -> np.ndarray:
    """The projector onto the columns: it does not depend on their order."""
    Q, _ = np.linalg.qr(np.stack(columns, axis=1))
    return Q @ Q.T


def assert_spans(built: ties.Ties, columns: list[np.ndarray]) -> None:
    assert built.size == len(columns)
    Q, _ = np.linalg.qr(matrix(built))
    np.testing.assert_allclose(Q @ Q.T, span(*columns), atol=1e-13)


def unit(mesh: jm.Mesh, nodes: Any, axis: int) -> np.ndarray:
    """One where a component of some nodes is, zero elsewhere."""
    full = np.zeros(mesh.points.shape)
    full[nodes, axis] = 1.0
    return full.ravel()


def singles(mesh: jm.Mesh, held: list[tuple[np.ndarray, int]]) -> list[np.ndarray]:
    """A column for every component that is not in `held`, a list of (nodes, axis)."""
    fixed = {(int(n), axis) for nodes, axis in held for n in np.flatnonzero(nodes)}
    return [unit(mesh, n, axis) for n in range(len(mesh.points)) for axis in range(3) if (n, axis) not in fixed]


def on(mesh: jm.Mesh, axis: int, value: float) -> np.ndarray:
    return mesh.points[:, axis] == value


def test_no_condition_leaves_every_displacement_free(mesh: jm.Mesh) -> None:
    built = ties.build(mesh, ())
    np.testing.assert_array_equal(matrix(built), np.eye(36))
    np.testing.assert_array_equal(np.asarray(built.offset), 0.0)


def test_displacement_fixes_the_component_of_a_face(mesh: jm.Mesh) -> None:
    built = ties.build(mesh, (jm.Displacement("x1", "y", 0.7),))
    at = on(mesh, 0, 2.0)
    assert_spans(built, singles(mesh, [(at, 1)]))
    np.testing.assert_array_equal(np.asarray(built.offset), 0.7 * unit(mesh, at, 1))


def test_symmetry_fixes_the_normal_component_of_the_lower_face(mesh: jm.Mesh) -> None:
    for axis, name in enumerate("xyz"):
        built = ties.build(mesh, (jm.Symmetry(name),))
        assert_spans(built, singles(mesh, [(on(mesh, axis, 0.0), axis)]))
        np.testing.assert_array_equal(np.asarray(built.offset), 0.0)


def test_stretch_moves_the_upper_face_by_the_extent(mesh: jm.Mesh) -> None:
    built = ties.build(mesh, (jm.Stretch("y", 1.2),))
    at = on(mesh, 1, 3.0)
    assert_spans(built, singles(mesh, [(at, 1)]))
    np.testing.assert_allclose(np.asarray(built.offset), 0.2 * 3.0 * unit(mesh, at, 1), rtol=1e-15)


def test_planar_ties_one_component_of_a_face_together(mesh: jm.Mesh) -> None:
    built = ties.build(mesh, (jm.Planar("x1", "x"),))
    at = on(mesh, 0, 2.0)
    assert_spans(built, [*singles(mesh, [(at, 0)]), unit(mesh, at, 0)])
    np.testing.assert_array_equal(np.asarray(built.offset), 0.0)


def test_two_plates_with_common_nodes_are_one(mesh: jm.Mesh) -> None:
    built = ties.build(mesh, (jm.Planar("x1", "z"), jm.Planar("z1", "z")))
    at = on(mesh, 0, 2.0) | on(mesh, 2, 1.0)
    assert_spans(built, [*singles(mesh, [(at, 2)]), unit(mesh, at, 2)])


def test_a_plate_that_is_moved_is_a_displacement(mesh: jm.Mesh) -> None:
    at = on(mesh, 0, 2.0)
    for conditions in (
        (jm.Planar("x1", "x"), jm.Displacement("x1", "x", 0.3)),
        (jm.Displacement("x1", "x", 0.3), jm.Planar("x1", "x")),
    ):
        built = ties.build(mesh, conditions)
        assert_spans(built, singles(mesh, [(at, 0)]))
        np.testing.assert_allclose(np.asarray(built.offset), 0.3 * unit(mesh, at, 0), rtol=1e-15)


def test_homogeneous_leaves_three_stretches(mesh: jm.Mesh) -> None:
    built = ties.build(mesh, (jm.Homogeneous(),))
    columns = []
    for axis in range(3):
        full = np.zeros(mesh.points.shape)
        full[:, axis] = mesh.points[:, axis]
        columns.append(full.ravel())
    assert_spans(built, columns)


def test_homogeneous_with_prescribed_stretches(mesh: jm.Mesh) -> None:
    built = ties.build(mesh, (jm.Homogeneous(), jm.Stretch("x", 1.1), jm.Displacement("z1", "z", -0.2)))
    assert built.size == 1
    expected = mesh.points * np.array([0.1, 0.0, -0.2])
    np.testing.assert_allclose(np.asarray(built.offset).reshape(-1, 3), expected, atol=1e-15)
    np.testing.assert_allclose(matrix(built)[:, 0].reshape(-1, 3)[:, [0, 2]], 0.0, atol=0)


def test_everything_prescribed_leaves_no_unknown(mesh: jm.Mesh) -> None:
    conditions = (jm.Homogeneous(), *(jm.Stretch(a, s) for a, s in (("x", 1.25), ("y", 0.8), ("z", 1.0))))
    built = ties.build(mesh, conditions)
    assert built.size == 0
    expected = mesh.points * np.array([0.25, -0.2, 0.0])
    np.testing.assert_allclose(np.asarray(built.offset).reshape(-1, 3), expected, atol=1e-15)


def test_prescribed_values_may_be_traced(mesh: jm.Mesh) -> None:
    def offset(stretch: Any) -> Any:
        return ties.build(mesh, (jm.Symmetry("x"), jm.Stretch("x", stretch))).offset

    by_stretch = np.asarray(jax.jacfwd(offset)(1.1))
    np.testing.assert_allclose(by_stretch, 2.0 * unit(mesh, on(mesh, 0, 2.0), 0), rtol=1e-15)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (jm.Displacement("x1", "x", 0.1), jm.Displacement("x1", "x", 0.2)),
        (jm.Stretch("x", 1.1), jm.Displacement("x1", "x", 0.3)),
        (jm.Symmetry("x"), jm.Displacement("x0", "x", 0.3)),
        (jm.Displacement("y0", "x", 0.1), jm.Displacement("x1", "x", 0.2)),
    ],
    ids=str,
)
def test_conditions_that_contradict_each_other_are_both_named(mesh: jm.Mesh, first: Any, second: Any) -> None:
    with pytest.raises(ValueError, match="contradict") as error:
        ties.build(mesh, (first, second))
    assert str(first) in str(error.value)
    assert str(second) in str(error.value)


def test_conditions_that_agree_are_accepted(mesh: jm.Mesh) -> None:
    built = ties.build(mesh, (jm.Stretch("x", 1.5), jm.Displacement("x1", "x", 1.0), jm.Displacement("x1", "x", 1.0)))
    np.testing.assert_allclose(np.asarray(built.offset), unit(mesh, on(mesh, 0, 2.0), 0), rtol=1e-15)


def test_a_homogeneous_body_cannot_move_its_symmetry_plane(mesh: jm.Mesh) -> None:
    assert ties.build(mesh, (jm.Homogeneous(), jm.Symmetry("x"))).size == 3
    with pytest.raises(ValueError, match="another tie"):
        ties.build(mesh, (jm.Homogeneous(), jm.Displacement("x0", "x", 0.1)))


def test_a_plate_across_a_homogeneous_body_contradicts_it(mesh: jm.Mesh) -> None:
    assert ties.build(mesh, (jm.Homogeneous(), jm.Planar("x1", "x"))).size == 3
    with pytest.raises(ValueError, match="another tie"):
        ties.build(mesh, (jm.Homogeneous(), jm.Planar("x1", "y")))


# -------------------------------------------------------------------------------------------------- rigid motions

TRANSLATIONS = {f"translation along {a}" for a in "xyz"}
ROTATIONS = {f"rotation about {a}" for a in "xyz"}


@pytest.mark.parametrize(
    ("conditions", "free"),
    [
        ((), TRANSLATIONS | ROTATIONS),
        ((jm.Symmetry("x"),), {"translation along y", "translation along z", "rotation about x"}),
        ((jm.Symmetry("x"), jm.Symmetry("y")), {"translation along z"}),
        ((jm.Symmetry("x"), jm.Symmetry("y"), jm.Symmetry("z")), set()),
        ((jm.Symmetry("x"), jm.Symmetry("z")), {"translation along y"}),
        (
            (jm.Planar("x1", "x"),),
            {"translation along x", "translation along y", "translation along z", "rotation about x"},
        ),
        ((jm.Homogeneous(),), set()),
        (tuple(jm.Displacement("x0", a) for a in "xyz"), set()),
        (tuple(jm.Displacement("x0", a) for a in "xy"), {"translation along z"}),
        ((jm.Stretch("z", 1.3),), {"translation along x", "translation along y", "rotation about z"}),
    ],
    ids=lambda x: str(sorted(x) if isinstance(x, set) else x),
)
def test_rigid_motions_that_stay_free_are_named(mesh: jm.Mesh, conditions: Any, free: set[str]) -> None:
    assert len(ties.rigid_motions(mesh, ties.build(mesh, conditions), ())) == len(free)
    assert set(ties.rigid_motions(mesh, ties.build(mesh, conditions), ())) == free


def test_rigid_motions_do_not_depend_on_size_or_place() -> None:
    for scale in (1e-6, 1.0, 1e6):
        mesh = jm.box((scale, 10.0 * scale, 0.1 * scale), (2, 2, 1))
        shifted = jm.Mesh(mesh.points + 100.0 * scale, mesh.cells, mesh.faces)
        for body in (mesh, shifted):
            built = ties.build(body, (jm.Symmetry("x"), jm.Symmetry("y")))
            assert ties.rigid_motions(body, built, ()) == ["translation along z"]


# ----------------------------------------------------------------------------------------- uniform and proportional


def test_uniform_ties_the_nodes_of_each_line(mesh: jm.Mesh) -> None:
    """u_x may vary with x alone: three planes, three unknowns. The other components stay free."""
    built = ties.build(mesh, (jm.Uniform("x", ("y", "z")),))
    planes = [unit(mesh, on(mesh, 0, x), 0) for x in (0.0, 1.0, 2.0)]
    every = np.ones(len(mesh.points), dtype=bool)
    assert_spans(built, [*planes, *singles(mesh, [(every, 0)])])
    np.testing.assert_array_equal(np.asarray(built.offset), 0.0)


def test_uniform_along_one_axis(mesh: jm.Mesh) -> None:
    """One unknown u_z for every line along y."""
    built = ties.build(mesh, (jm.Uniform("z", ("y",)),))
    lines = [unit(mesh, on(mesh, 0, x) & on(mesh, 2, z), 2) for x in (0.0, 1.0, 2.0) for z in (0.0, 1.0)]
    assert_spans(built, [*lines, *singles(mesh, [(np.ones(len(mesh.points), dtype=bool), 2)])])


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_uniform_along_all_axes_is_one_unknown(mesh: jm.Mesh, axis: str) -> None:
    every, k = np.ones(len(mesh.points), dtype=bool), "xyz".index(axis)
    built = ties.build(mesh, (jm.Uniform(axis, ("x", "y", "z")),))
    assert_spans(built, [unit(mesh, every, k), *singles(mesh, [(every, k)])])
    held = ties.build(mesh, (jm.Uniform(axis, ("x", "y", "z")), jm.Displacement("x0", axis, 0.3)))
    assert_spans(held, singles(mesh, [(every, k)]))
    np.testing.assert_allclose(np.asarray(held.offset), 0.3 * unit(mesh, every, k), rtol=1e-15)


def test_uniform_ties_survive_any_place_and_size() -> None:
    """Lines are found by their coordinates: also where these are large against the mesh, and unequal by round-off."""
    for shift, scale in ((0.0, 1e-6), (1e3, 1.0), (-7.3, 1e6)):
        mesh = jm.box((1.0, 1.0, 1.0), (3, 2, 2))
        noise = 1e-15 * np.random.default_rng(1).uniform(-1.0, 1.0, mesh.points.shape)
        moved = jm.Mesh(scale * (mesh.points + shift + max(1.0, abs(shift)) * noise), mesh.cells, mesh.faces)
        assert ties.build(moved, (jm.Uniform("x", ("y", "z")),)).size == 4 + 2 * len(mesh.points)


def test_proportional_is_one_unknown_times_a_coordinate(mesh: jm.Mesh) -> None:
    every = np.ones(len(mesh.points), dtype=bool)
    for axis, to in (("z", "z"), ("y", "x")):
        k = "xyz".index(axis)
        full = np.zeros(mesh.points.shape)
        full[:, k] = mesh.points[:, "xyz".index(to)]
        built = ties.build(mesh, (jm.Proportional(axis, to),))
        assert_spans(built, [full.ravel(), *singles(mesh, [(every, k)])])
        np.testing.assert_array_equal(np.asarray(built.offset), 0.0)


@pytest.fixture(scope="module")
def sector() -> jm.Mesh:
    """A quarter of a tube, 2 ≤ r ≤ 3 mm, 4 mm high, 2×2×2 elements."""
    return jm.structured([np.linspace(2.0, 3.0, 3), np.linspace(0.0, 0.5 * np.pi, 3), np.linspace(0.0, 4.0, 3)], POLAR)


POLAR = jm.CYLINDRICAL
WALL = jm.Uniform("r", ("phi", "z"))


def test_generalised_plane_strain_of_a_tube(sector: jm.Mesh) -> None:
    """u_r(R), u_z = e Z, u_φ = ψ Z: a radius per shell, one stretch, one twist."""
    built = ties.build(sector, (WALL, jm.Proportional("z", "z"), jm.Proportional("phi", "z")))
    Z = sector.points[:, 2]
    stretch, twist = np.zeros(sector.points.shape), np.zeros(sector.points.shape)
    stretch[:, 2], twist[:, 1] = Z, Z
    shells = [unit(sector, on(sector, 0, r), 0) for r in (2.0, 2.5, 3.0)]
    assert_spans(built, [*shells, stretch.ravel(), twist.ravel()])


@pytest.mark.parametrize(
    ("condition", "offset"),
    [
        (jm.Stretch("z", 1.2), (0.0, 0.0, 0.2)),
        (jm.Displacement("z1", "z", -0.4), (0.0, 0.0, -0.1)),
        (jm.Displacement("z1", "phi", 0.6), (0.0, 0.15, 0.0)),
        (jm.Displacement("z1", "phi"), (0.0, 0.0, 0.0)),
    ],
    ids=str,
)
def test_a_prescribed_end_prescribes_the_whole(sector: jm.Mesh, condition: Any, offset: Any) -> None:
    """What the end does is done in proportion to Z everywhere, and the unknown is gone."""
    built = ties.build(sector, (WALL, jm.Proportional("z", "z"), jm.Proportional("phi", "z"), condition))
    assert built.size == 4
    expected = sector.points[:, 2:] * np.array(offset)
    np.testing.assert_allclose(np.asarray(built.offset).reshape(-1, 3), expected, atol=1e-15)


def test_prescribed_ends_may_be_traced(sector: jm.Mesh) -> None:
    def offset(angle: Any) -> Any:
        return ties.build(sector, (jm.Proportional("phi", "z"), jm.Displacement("z1", "phi", angle))).offset

    by_angle = np.asarray(jax.jacfwd(offset)(0.3)).reshape(-1, 3)
    np.testing.assert_allclose(by_angle[:, 1], sector.points[:, 2] / 4.0, rtol=1e-15)
    np.testing.assert_array_equal(by_angle[:, [0, 2]], 0.0)


def test_a_symmetry_plane_where_nothing_moves_holds_nothing(sector: jm.Mesh) -> None:
    """At Z = 0 the axial displacement e Z is zero anyway."""
    assert ties.build(sector, (jm.Proportional("z", "z"), jm.Symmetry("z"))).size == 2 * len(sector.points) + 1


def test_a_plate_over_lines_that_are_uniform(sector: jm.Mesh) -> None:
    """Planar ties the lines that meet its face, whole lines; here all shells at the end z1, hence at every height."""
    built = ties.build(sector, (WALL, jm.Planar("z1", "r")))
    every = np.ones(len(sector.points), dtype=bool)
    assert_spans(built, [unit(sector, every, 0), *singles(sector, [(every, 0)])])
    outer = ties.build(sector, (jm.Uniform("r", ("z",)), jm.Planar("r1", "r")))
    lines = [unit(sector, on(sector, 0, r) & on(sector, 1, a), 0) for r in (2.0, 2.5) for a in sector.points[:9:3, 1]]
    assert_spans(outer, [unit(sector, on(sector, 0, 3.0), 0), *lines, *singles(sector, [(every, 0)])])


def test_a_displacement_of_one_line_moves_the_line(sector: jm.Mesh) -> None:
    built = ties.build(sector, (jm.Uniform("r", ("phi", "z")), jm.Displacement("r0", "r", 0.2)))
    inner = on(sector, 0, 2.0)
    np.testing.assert_allclose(np.asarray(built.offset), 0.2 * unit(sector, inner, 0), rtol=1e-15)
    at_end = ties.build(sector, (jm.Uniform("r", ("z",)), jm.Displacement("z1", "r", 0.2)))
    np.testing.assert_allclose(np.asarray(at_end.offset).reshape(-1, 3)[:, 0], 0.2, rtol=1e-15)


@pytest.mark.parametrize(
    "conditions",
    [
        (jm.Uniform("z", ("phi",)), jm.Proportional("z", "z")),
        (jm.Proportional("z", "z"), jm.Uniform("z", ("phi",))),
        (jm.Proportional("phi", "z"), jm.Proportional("phi", "r")),
        (jm.Uniform("r", ("phi",)), jm.Uniform("r", ("z",))),
    ],
    ids=str,
)
def test_a_component_is_tied_as_a_whole_only_once(sector: jm.Mesh, conditions: Any) -> None:
    with pytest.raises(ValueError, match=r"contradicts .*both tie u_") as error:
        ties.build(sector, conditions)
    assert str(conditions[1]) in str(error.value)


@pytest.mark.parametrize(
    ("conditions", "words"),
    [
        ((jm.Proportional("z", "z"), jm.Displacement("r1", "z", 0.1)), "does not move that face along z"),
        ((jm.Proportional("r", "r"), jm.Displacement("z1", "r", 0.1)), "as a whole"),
        ((jm.Proportional("phi", "z"), jm.Displacement("phi1", "phi", 0.1)), "does not move that face along phi"),
        ((jm.Proportional("z", "r"), jm.Displacement("z1", "z", 0.1)), "as a whole"),
        ((jm.Proportional("z", "z"), jm.Displacement("z0", "z", 0.1)), "does not move that face along z"),
        ((jm.Proportional("z", "z"), jm.Planar("r1", "z")), "not plane along z"),
    ],
    ids=str,
)
def test_a_face_cannot_be_moved_against_a_proportional_tie(sector: jm.Mesh, conditions: Any, words: str) -> None:
    with pytest.raises(ValueError, match=f"contradicts another tie.*{words}") as error:
        ties.build(sector, conditions)
    assert str(conditions[1]) in str(error.value)


def test_an_uneven_face_may_be_held(sector: jm.Mesh) -> None:
    """Zero is the one displacement that a face can have as a whole: u_z = e Z = 0 for all Z on r1 is e = 0."""
    built = ties.build(sector, (jm.Proportional("z", "z"), jm.Displacement("r1", "z")))
    assert built.size == 2 * len(sector.points)
    np.testing.assert_array_equal(np.asarray(built.offset), 0.0)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (jm.Displacement("z1", "phi", 0.1), jm.Displacement("z1", "phi", 0.2)),
        (jm.Stretch("z", 1.1), jm.Displacement("z1", "z", 0.3)),
        (jm.Displacement("r0", "r", 0.1), jm.Displacement("z1", "r", 0.2)),
    ],
    ids=str,
)
def test_conflicts_through_a_tie_name_both(sector: jm.Mesh, first: Any, second: Any) -> None:
    tied = WALL, jm.Proportional("z", "z"), jm.Proportional("phi", "z")
    with pytest.raises(ValueError, match="contradict") as error:
        ties.build(sector, (*tied, first, second))
    assert str(first) in str(error.value)
    assert str(second) in str(error.value)


@pytest.fixture(scope="module")
def middle() -> jm.Mesh:
    """A box with z from −1 to 1."""
    mesh = jm.box((1.0, 1.0, 2.0), (1, 1, 1))
    return jm.Mesh(mesh.points - np.array([0.0, 0.0, 1.0]), mesh.cells, mesh.faces)


def test_ends_that_move_in_proportion_agree(middle: jm.Mesh) -> None:
    ends = jm.Displacement("z0", "z", -0.1), jm.Displacement("z1", "z", 0.1)
    built = ties.build(middle, (jm.Proportional("z", "z"), *ends))
    np.testing.assert_allclose(np.asarray(built.offset).reshape(-1, 3)[:, 2], 0.1 * middle.points[:, 2], rtol=1e-15)


def test_ends_that_move_against_the_proportion_conflict(middle: jm.Mesh) -> None:
    """u_z = e Z cannot move both ends up."""
    ends = jm.Displacement("z0", "z", 0.1), jm.Displacement("z1", "z", 0.1)
    with pytest.raises(ValueError, match="contradict"):
        ties.build(middle, (jm.Proportional("z", "z"), *ends))


@pytest.mark.parametrize(
    ("condition", "name"),
    [
        (jm.Uniform("x", ("r",)), "x"),
        (jm.Uniform("r", ("theta",)), "theta"),
        (jm.Proportional("r", "x"), "x"),
        (jm.Proportional("y", "r"), "y"),
        (jm.Planar("z1", "x"), "x"),
        (jm.Stretch("x", 1.1), "x"),
    ],
    ids=str,
)
def test_names_that_the_coordinates_do_not_have(sector: jm.Mesh, condition: Any, name: str) -> None:
    with pytest.raises(ValueError, match=f"'{name}' is unknown; valid: .*'"):
        ties.build(sector, (condition,))


def test_homogeneous_is_cartesian(sector: jm.Mesh) -> None:
    with pytest.raises(ValueError, match=r"Homogeneous\(\) needs Cartesian.*cylindrical"):
        ties.build(sector, (jm.Homogeneous(),))


# --------------------------------------------------------------------------------- rigid motions in curved coordinates


def ring(elements: int, angle: float = 2.0 * np.pi, r: float = 2.0) -> jm.Mesh:
    nodes = [np.linspace(r, r + 1.5, 3), np.linspace(0.0, angle, elements + 1), np.linspace(0.0, 4.0, 3)]
    return jm.structured(nodes, POLAR)


def free_motions(mesh: jm.Mesh, *conditions: Any) -> list[str]:
    return sorted(ties.rigid_motions(mesh, ties.build(mesh, conditions), ()))


def named(*motions: str) -> list[str]:
    """E.g. "tx", "rz"."""
    return sorted({"t": "translation along ", "r": "rotation about "}[m[0]] + m[1] for m in motions)


@pytest.mark.parametrize(
    ("conditions", "free"),
    [
        ((), ("tx", "ty", "tz", "rx", "ry", "rz")),
        ((jm.Symmetry("z"),), ("tx", "ty", "rz")),
        ((jm.Symmetry("phi"),), ("tx", "tz", "ry")),
        ((jm.Symmetry("phi"), jm.Symmetry("z")), ("tx",)),
        ((jm.Symmetry("phi"), jm.Displacement("phi1", "phi")), ("tz",)),
        ((jm.Symmetry("phi"), jm.Displacement("phi1", "phi"), jm.Symmetry("z")), ()),
        ((jm.Displacement("r0", "r"), jm.Symmetry("z")), ("rz",)),
        ((jm.Displacement("r0", "r"), jm.Displacement("r0", "phi")), ("tz",)),
        ((jm.Uniform("z", ("phi",)),), ("tx", "ty", "tz", "rz")),
        ((WALL, jm.Proportional("z", "z"), jm.Proportional("phi", "z")), ()),
    ],
    ids=str,
)
def test_rigid_motions_of_a_sector(sector: jm.Mesh, conditions: Any, free: tuple[str, ...]) -> None:
    """Their names are Cartesian, and do not depend on how many elements there are."""
    assert free_motions(sector, *conditions) == named(*free)
    assert free_motions(ring(4, 0.5 * np.pi), *conditions) == named(*free)


def test_half_a_tube_between_two_planes_slides_along_them() -> None:
    """Both planes are y = 0: they leave what moves within that plane."""
    planes = jm.Symmetry("phi"), jm.Displacement("phi1", "phi")
    assert free_motions(ring(4, np.pi), *planes) == named("tx", "tz", "ry")
    assert free_motions(ring(4, np.pi), *planes, jm.Symmetry("z")) == named("tx")


AXISYMMETRIC = tuple(jm.Uniform(a, ("phi",)) for a in ("r", "z", "phi"))


@pytest.mark.parametrize(
    ("elements", "r"),
    [
        (1, 2.0),
        (2, 2.0),
        (3, 2.0),
        (4, 2.0),
        (8, 2.0),
        (1, 0.0),
    ],
)
def test_rigid_motions_of_an_axisymmetric_body_are_two(elements: int, r: float) -> None:
    """A turn about the axis and a shift along it, whatever the number of elements around; supports remove them."""
    mesh = ring(elements, r=r)
    assert free_motions(mesh, *AXISYMMETRIC, jm.Displacement("z0", "phi"), jm.Symmetry("z")) == []
    assert len(free_motions(mesh, *AXISYMMETRIC, jm.Displacement("z0", "phi"))) == 1
    assert len(free_motions(mesh, *AXISYMMETRIC, jm.Symmetry("z"))) == 1
    assert len(free_motions(mesh, *AXISYMMETRIC)) == 2


@pytest.mark.parametrize("elements", [1, 2, 8])
def test_the_shift_along_the_axis_is_named(elements: int) -> None:
    assert free_motions(ring(elements), *AXISYMMETRIC, jm.Displacement("z0", "phi")) == named("tz")


@pytest.mark.parametrize("elements", [1, 2, 8])
def test_the_turn_about_the_axis_is_named(elements: int) -> None:
    assert free_motions(ring(elements), *AXISYMMETRIC, jm.Symmetry("z")) == named("rz")


def test_one_element_around_has_no_translation_across_the_axis() -> None:
    """Its nodes, all at one place of the circle, could shift along x; the element between them would be strained."""
    mesh = ring(1)
    free = ties.rigid_motions(mesh, ties.build(mesh, ()), ())
    assert len(free) == 2
    assert "translation along x" not in free
    assert ties.rigid_motions(mesh, ties.build(mesh, (jm.Symmetry("z"), jm.Symmetry("phi"))), ()) == []


def test_springs_count_as_supports(sector: jm.Mesh) -> None:
    none = ties.build(sector, ())
    assert ties.rigid_motions(sector, none, (jm.Spring("r1", 1.0),)) == []
    in_plane = ties.rigid_motions(sector, none, (jm.Spring("z0", 1.0, "normal"),))
    assert sorted(in_plane) == named("tx", "ty", "rz")
    assert ties.rigid_motions(sector, none, (jm.Spring("z0", 1.0, "normal"), jm.Spring("phi0", 1.0))) == []


def test_a_spring_of_no_stiffness_holds_nothing(sector: jm.Mesh) -> None:
    assert len(ties.rigid_motions(sector, ties.build(sector, ()), (jm.Spring("r1", 0.0),))) == 6
