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
    ids=str,
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
