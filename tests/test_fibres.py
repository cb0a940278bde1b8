"""Fibre fields: every way to give them, made unit vectors and orthogonal; what is refused."""

import re
import warnings
from typing import Any

import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo.fibres import frame
from jaxmyo.hexahedron import gauss, shape

XI = gauss(2, 2, 2)[0]
MESH = jm.box((2.0, 1.0, 1.0), (2, 1, 1))
AT = np.einsum("ga,eai->egi", shape(XI), MESH.points[MESH.cells])  # (2, 8, 3)
Y, Z = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def says(*parts: str) -> str:
    """A pattern that asks for all parts, in any order."""
    return "".join(f"(?=(?s:.*){re.escape(p)})" for p in parts)


def helix(x: np.ndarray) -> np.ndarray:
    """Unit vectors in the plane x, y that turn with x (n, 3)."""
    angle = 0.3 * x[:, 0]
    return np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)


def with_fields(**fields: Any) -> jm.Mesh:
    return jm.Mesh(MESH.points, MESH.cells, MESH.faces, fields=fields)


def supported(mesh: jm.Mesh, fibre: Any, cross: Any) -> jm.Scene:
    supports = (jm.Symmetry("x"), jm.Symmetry("y"), jm.Symmetry("z"))
    return jm.Scene(mesh, jm.lin_yin, jm.TABLE1, fibre, cross, supports)


# ---------------------------------------------------------------------------------------------------- ways to give them


def test_one_for_all_per_element_per_point_and_by_a_function() -> None:
    per_point = helix(AT.reshape(-1, 3)).reshape(AT.shape)
    per_element = helix(MESH.points[MESH.cells].mean(axis=1))
    expected = {
        "function": (helix, per_point),
        "point": (per_point, per_point),
        "element": (per_element, np.broadcast_to(per_element[:, None], AT.shape)),
        "constant": ((1.0, 0.0, 0.0), np.broadcast_to([1.0, 0.0, 0.0], AT.shape)),
    }
    for name, (given, f) in expected.items():
        found = frame(MESH, XI, given, Z)
        np.testing.assert_allclose(found[:, :, 0], f, atol=1e-15, err_msg=name)
        np.testing.assert_allclose(found[:, :, 1], np.broadcast_to(Z, AT.shape), atol=1e-15)
        np.testing.assert_allclose(found[:, :, 2], np.cross(f, Z), atol=1e-15)


def test_nodal_vectors_are_interpolated_and_normalised() -> None:
    nodes = helix(MESH.points)
    inside = np.einsum("ga,eai->egi", shape(XI), nodes[MESH.cells])
    assert np.linalg.norm(inside, axis=-1).max() < 0.999
    f = frame(MESH, XI, nodes, Z)[:, :, 0]
    np.testing.assert_allclose(f, inside / np.linalg.norm(inside, axis=-1, keepdims=True), atol=1e-15)


def test_fields_of_the_mesh_by_name() -> None:
    mesh = with_fields(f=helix(MESH.points), c=np.tile(Z, (2, 1)), T=np.zeros(2))
    np.testing.assert_array_equal(supported(mesh, "f", "c").frame, frame(MESH, XI, mesh.fields["f"], mesh.fields["c"]))
    with pytest.raises(ValueError, match=says("fibre = 'g'", "not a field", "'T', 'c', 'f'")):
        frame(mesh, XI, "g", "c")
    with pytest.raises(ValueError, match=says("fibre = 'f'", "not a field", "none")):
        frame(MESH, XI, "f", Z)
    with pytest.raises(ValueError, match=says("fibre = 'T'", "(2, 3) per element", "(12, 3) per node", "(2,)")):
        frame(mesh, XI, "T", Z)


def test_as_many_nodes_as_elements() -> None:
    """Eight elements on the same eight nodes: not a body, but the question is there."""
    cube = jm.box((1.0, 1.0, 1.0), (1, 1, 1))
    mesh = jm.Mesh(cube.points, np.tile(cube.cells, (8, 1)))
    with pytest.raises(ValueError, match=says("fibre", "(8, 3)", "ambiguous", "(8, 8, 3)")):
        frame(mesh, XI, np.tile(Y, (8, 1)), Z)
    assert frame(mesh, XI, np.tile(Y, (8, 8, 1)), Z).shape == (8, 8, 3, 3)


def test_components_are_along_the_local_unit_vectors() -> None:
    mesh = jm.structured([[1.0, 2.0], [0.0, 1.0], [0.0, 1.0]], jm.CYLINDRICAL)
    nodes = np.tile(Y, (8, 1))  # around, at every node
    np.testing.assert_allclose(frame(mesh, XI, nodes, Z)[:, :, 0], np.broadcast_to(Y, (1, 8, 3)), atol=1e-15)


# ------------------------------------------------------------------------------------------ made unit and orthogonal


def test_rounding_of_a_file_is_silent() -> None:
    f = np.round(helix(MESH.points), 4)
    c = np.round(np.cross(Z, helix(MESH.points)), 4)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = frame(MESH, XI, f, c)
    np.testing.assert_allclose(found @ found.swapaxes(-1, -2), np.broadcast_to(np.eye(3), found.shape), atol=1e-14)


@pytest.mark.parametrize("length", [2.0, 0.99, 1.01])
def test_vectors_of_another_length(length: float) -> None:
    fibre = np.tile([1.0, 0.0, 0.0], (2, 8, 1))
    fibre[1, 5] *= length
    with pytest.warns(UserWarning, match=says("fibre", "unit", "element 1, point 5", f"{length:g}")):
        found = supported(MESH, fibre, Y).frame
    np.testing.assert_array_equal(found, frame(MESH, XI, (1.0, 0.0, 0.0), Y))


def test_vectors_that_are_not_orthogonal() -> None:
    """f stays, f⊥ is turned; the warning says by how much and is the caller's."""
    a = np.radians(80.0)
    with pytest.warns(UserWarning, match=says("not orthogonal", "10°", "element 0, point 0")) as said:
        found = supported(MESH, (1.0, 0.0, 0.0), (np.cos(a), np.sin(a), 0.0)).frame
    assert [w.filename for w in said] == [__file__]
    np.testing.assert_allclose(found, np.broadcast_to(np.eye(3), found.shape), atol=1e-15)


def test_orthogonal_nodal_vectors_stay_so_without_a_warning() -> None:
    """Interpolation alone makes them oblique; that is no fault of the file."""
    f = helix(MESH.points * [5.0, 1.0, 1.0])
    c = np.cross(f, helix(MESH.points[:, [1, 0, 2]] + [3.0, 0.0, 0.0])[:, [2, 0, 1]])
    c /= np.linalg.norm(c, axis=-1, keepdims=True)
    inside = [np.einsum("ga,eai->egi", shape(XI), v[MESH.cells]) for v in (f, c)]
    assert np.abs(np.einsum("egi,egi->eg", *inside)).max() > 1e-2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = frame(MESH, XI, f, c)
    np.testing.assert_allclose(found @ found.swapaxes(-1, -2), np.broadcast_to(np.eye(3), found.shape), atol=1e-14)
    c[7] = f[7] * np.cos(1.5) + np.cross(f[7], c[7]) * np.sin(1.5)
    with pytest.warns(UserWarning, match=says("not orthogonal", "4.06°", "node 7")):
        frame(MESH, XI, f, c)


# ----------------------------------------------------------------------------------------------------------- refused


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf])
def test_vectors_without_a_direction(bad: float) -> None:
    per_element = np.tile(Y, (2, 1))
    per_element[1] = bad
    with pytest.raises(ValueError, match=says("cross", "direction", "not zero", f"{bad:g}", "element 1, point 0")):
        frame(MESH, XI, (1.0, 0.0, 0.0), per_element)
    nodes = np.tile(Y, (12, 1))
    nodes[11] = bad
    with pytest.raises(ValueError, match=says("cross", "direction", "node 11")):
        frame(MESH, XI, (1.0, 0.0, 0.0), nodes)


def test_nodal_vectors_that_cancel() -> None:
    nodes = np.where(MESH.points[:, :1] == 1.0, -1.0, 1.0) * np.array([Y])
    middle = np.zeros((1, 3))
    with pytest.raises(ValueError, match=says("fibre, interpolated,", "not zero", "element 0, point 0")):
        frame(MESH, middle, nodes, Z)


def test_parallel_vectors() -> None:
    cross = np.tile(Z, (2, 8, 1))
    cross[1, 3] = -1.0, 0.0, 1e-9
    with pytest.raises(ValueError, match=says("parallel", "element 1, point 3")):
        frame(MESH, XI, (1.0, 0.0, 0.0), cross)


def test_vectors_that_are_parallel_at_one_node() -> None:
    """Not at the points inside, but that is no orthogonal field."""
    fibre, cross = np.tile(Y, (12, 1)), np.tile(Z, (12, 1))
    cross[4] = Y
    with pytest.warns(UserWarning, match=says("not orthogonal", "90°", "node 4")):
        frame(MESH, XI, fibre, cross)


@pytest.mark.parametrize("value", [object(), [["a", "b", "c"]]], ids=["object", "strings"])
def test_fibre_that_is_no_number(value: Any) -> None:
    with pytest.raises(TypeError, match=says("fibre", "numbers")):
        frame(MESH, XI, value, Z)
