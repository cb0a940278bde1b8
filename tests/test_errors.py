"""Bad input: each an error that names the argument, the value and what is valid."""

import re
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import sample

import jaxmyo as jm

SUPPORTS = (jm.Symmetry("x"), jm.Symmetry("y"), jm.Symmetry("z"))


@pytest.fixture(scope="module")
def state() -> jm.State:
    return jm.contract(sample(), T0=5.0, a_over_D=0.2)


@pytest.fixture(scope="module")
def cube() -> jm.Mesh:
    return jm.box((1.0, 1.0, 1.0), (1, 1, 1))


def says(*parts: str) -> str:
    """A pattern that asks for all parts, in any order."""
    return "".join(f"(?=(?s:.*){re.escape(p)})" for p in parts)


# ------------------------------------------------------------------------------------------- scalars of a contraction


@pytest.mark.parametrize(
    ("argument", "value", "parts"),
    [
        ("a_over_D", 0.2501, ("a_over_D", "0.2501", "[0, 0.25]")),
        ("a_over_D", -0.01, ("a_over_D", "-0.01", "[0, 0.25]")),
        ("a_over_D", 1e9, ("a_over_D", "1e+09", "[0, 0.25]")),
        ("beta", 1.5, ("beta", "1.5", "[0, 1]")),
        ("beta", -0.1, ("beta", "-0.1", "[0, 1]")),
        ("T0", -5.0, ("T0", "-5", "[0, inf]", "kPa")),
        ("T0", np.nan, ("T0", "finite", "nan")),
        ("T0", np.inf, ("T0", "finite", "inf")),
        ("beta", np.nan, ("beta", "finite", "nan")),
        ("a_over_D", np.nan, ("a_over_D", "finite", "nan")),
        ("T0", [1.0, 2.0], ("T0", "scalar", "(2,)", "vmap")),
        ("beta", np.zeros((2, 2)), ("beta", "scalar", "(2, 2)", "vmap")),
        ("a_over_D", jnp.array([0.1]), ("a_over_D", "scalar", "(1,)", "vmap")),
    ],
)
def test_scalar_out_of_range(argument: str, value: Any, parts: tuple[str, ...]) -> None:
    arguments = {"T0": 5.0, "a_over_D": 0.2, "beta": 1.0, argument: value}
    with pytest.raises(ValueError, match=says(*parts)):
        jm.contract(sample(), **arguments)


@pytest.mark.parametrize("argument", ["T0", "a_over_D", "beta"])
@pytest.mark.parametrize("value", ["strong", object()], ids=["string", "object"])
def test_scalar_that_is_no_number(argument: str, value: Any) -> None:
    arguments = {"T0": 5.0, "a_over_D": 0.2, "beta": 1.0, argument: value}
    with pytest.raises((TypeError, ValueError), match=says(argument, "number")):
        jm.contract(sample(), **arguments)


@pytest.mark.parametrize("argument", ["T0", "beta"])
def test_none_is_no_number(argument: str) -> None:
    arguments = {"T0": 5.0, "a_over_D": 0.2, "beta": 1.0, argument: None}
    with pytest.raises((TypeError, ValueError), match=argument):
        jm.contract(sample(), **arguments)


def test_traced_scalar_of_wrong_shape() -> None:
    with pytest.raises(ValueError, match=says("T0", "scalar", "(3,)", "vmap")):
        jax.jit(lambda t: jm.contract(sample(), T0=t, a_over_D=0.2).u)(np.ones(3))


def test_the_ends_of_the_ranges_are_valid() -> None:
    for ratio in (0.0, 0.25):
        for beta in (0.0, 1.0):
            assert bool(jm.contract(sample(), T0=0.0, a_over_D=ratio, beta=beta).converged)


def test_scalars_may_be_integers_and_arrays_of_no_dimension() -> None:
    a = jm.contract(sample(), T0=5, a_over_D=np.float32(0.25), beta=1)
    b = jm.contract(sample(), T0=np.array(5.0), a_over_D=jnp.array(0.25), beta=jnp.array(1.0))
    np.testing.assert_array_equal(np.asarray(a.u), np.asarray(b.u))


# ------------------------------------------------------------------------------------------------- constants


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_constants_that_are_not_finite(value: float) -> None:
    bad = jm.LinYin(**{**vars(jm.TABLE1), "C2a": value})
    with pytest.raises(ValueError, match=says("constants", "C2a", "finite", str(value))):
        jm.thin_sample(constants=bad)
    with pytest.raises(ValueError, match=says("constants", "C2a", "finite", str(value))):
        jm.contract(sample(), T0=5.0, a_over_D=0.2, constants=bad)


def test_constants_that_are_no_numbers() -> None:
    with pytest.raises(TypeError, match=says("constants", "C1p", "number", "soft")):
        jm.thin_sample(constants=jm.LinYin(**{**vars(jm.TABLE1), "C1p": "soft"}))


def test_law_that_is_no_function() -> None:
    with pytest.raises(TypeError, match=says("law", "function", "law(C, frame, beta, constants)", "'lin_yin'")):
        jm.thin_sample(law="lin_yin")


# ------------------------------------------------------------------------------------------------------- loads


@pytest.mark.parametrize("value", [0.2, 5.0, 0.1, 0.0, -1.0, 7.5])
@pytest.mark.parametrize("axis", ["x", "z"])
def test_stretch_out_of_range(state: jm.State, axis: Any, value: float) -> None:
    with pytest.raises(ValueError, match=says("Stretch", repr(axis), f"{value:g}", "(0.2, 5)")):
        jm.load(state, jm.Stretch(axis, value))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_stretch_that_is_not_finite(state: jm.State, value: float) -> None:
    with pytest.raises(ValueError, match=says("Stretch", "'x'", "finite")):
        jm.load(state, jm.Stretch("x", value))


def test_stretch_that_is_no_scalar(state: jm.State) -> None:
    with pytest.raises(ValueError, match=says("Stretch", "scalar", "(2,)", "vmap")):
        jm.load(state, jm.Stretch("x", np.ones(2)))


def test_displacement_that_is_not_finite(state: jm.State) -> None:
    with pytest.raises(ValueError, match=says("Displacement", "'x1'", "finite", "nan")):
        jm.load(state, jm.Displacement("x1", "x", np.nan))


def test_displacement_that_is_no_scalar(state: jm.State) -> None:
    with pytest.raises(ValueError, match=says("Displacement", "'x1'", "scalar")):
        jm.load(state, jm.Displacement("x1", "x", np.ones(3)))


@pytest.mark.parametrize(
    "condition",
    [jm.Displacement("x2", "x"), jm.Planar("x2", "x"), jm.Traction("x2", (0.0, 0.0, 0.0))],
    ids=lambda c: type(c).__name__,
)
def test_unknown_face(state: jm.State, condition: Any) -> None:
    with pytest.raises(ValueError, match=says("face", "'x2'", "'x0', 'x1', 'y0', 'y1', 'z0', 'z1'")):
        jm.load(state, condition)


@pytest.mark.parametrize("condition", [jm.Displacement("x1", "X"), jm.Planar("x1", "X")], ids=str)
def test_unknown_axis(state: jm.State, condition: Any) -> None:
    with pytest.raises(ValueError, match=says("axis", "'X'", "'x', 'y', 'z'")):
        jm.load(state, condition)


def test_unknown_axis_of_a_stretch(state: jm.State) -> None:
    with pytest.raises(ValueError, match=says("axis", "'f'", "'x', 'y', 'z'")):
        jm.load(state, jm.Stretch("f", 1.1))


def test_unknown_axis_of_a_symmetry_plane(cube: jm.Mesh) -> None:
    with pytest.raises(ValueError, match=says("axis", "'w'", "'x', 'y', 'z'")):
        jm.Scene(cube, jm.lin_yin, jm.TABLE1, supports=(jm.Symmetry("w"),))


def test_unknown_measure(state: jm.State) -> None:
    with pytest.raises(ValueError, match=says("measure", "'pk1'", "'nominal', 'cauchy'")):
        jm.load(state, jm.Traction("x1", (1.0, 0.0, 0.0), "pk1"))


@pytest.mark.parametrize("vector", [1.0, (1.0, 0.0), np.zeros((2, 3)), [[1.0, 0.0, 0.0]]], ids=str)
def test_traction_of_wrong_shape(state: jm.State, vector: Any) -> None:
    with pytest.raises(ValueError, match=says("Traction", "'x1'", "(3,)")):
        jm.load(state, jm.Traction("x1", vector))


def test_traction_that_is_not_finite(state: jm.State) -> None:
    with pytest.raises(ValueError, match=says("Traction", "'x1'", "finite")):
        jm.load(state, jm.Traction("x1", (1.0, np.nan, 0.0)))


def test_loading_a_batch() -> None:
    A = jm.contract(sample(), T0=5.0, a_over_D=0.2)
    batch = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), A)
    with pytest.raises(TypeError, match=says("state", "batch", "(2,)", "jax.vmap")):
        jm.load(batch, jm.Stretch("x", 1.1))


def test_condition_of_unknown_kind(state: jm.State) -> None:
    with pytest.raises(TypeError, match=says("'x1'", "Stretch", "Traction")):
        jm.load(state, "x1")


def test_support_of_unknown_kind(cube: jm.Mesh) -> None:
    with pytest.raises(TypeError, match=says("supports", "Symmetry")):
        jm.Scene(cube, jm.lin_yin, jm.TABLE1, supports=("x", "y", "z"))


def test_contradicting_loads(state: jm.State) -> None:
    with pytest.raises(ValueError, match=says("contradicts", "Stretch(axis='x', value=1.1)", "Displacement(face='x1'")):
        jm.load(state, jm.Stretch("x", 1.1), jm.Displacement("x1", "x", 0.0))


def test_loading_a_state_that_failed() -> None:
    failed = jm.contract(sample(), T0=200.0, a_over_D=0.2, settings=jm.Settings(max_steps=3), throw=False)
    assert not bool(failed.converged)
    with pytest.raises(ValueError, match=says("state", "converged", "TOO_MANY_STEPS")):
        jm.load(failed, jm.Stretch("x", 1.1))


# ------------------------------------------------------------------------------------------------------ fibres


@pytest.mark.parametrize(
    ("name", "value", "parts"),
    [
        ("fibre", (0.0, 0.0, 0.0), ("fibre", "direction", "not zero", "element 0, point 0")),
        ("fibre", (np.nan, 0.0, 0.0), ("fibre", "direction", "finite", "nan")),
        ("cross", (1.0, 0.0, 0.0), ("fibre", "cross", "parallel", "element 0, point 0")),
        ("fibre", (1.0, 0.0), ("fibre", "shape", "(3,)", "(2,)")),
        ("fibre", np.ones((2, 3)), ("fibre", "shape", "(3,)", "(1, 3)", "(8, 3)", "(1, 8, 3)", "(2, 3)")),
        ("cross", np.ones((1, 4, 3)), ("cross", "shape", "(1, 8, 3)", "(1, 4, 3)")),
        ("cross", 1.0, ("cross", "shape", "(3,)", "()")),
    ],
)
def test_fibres(cube: jm.Mesh, name: str, value: Any, parts: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=says(*parts)):
        jm.Scene(cube, jm.lin_yin, jm.TABLE1, supports=SUPPORTS, **{name: value})


def test_fibre_that_is_no_number(cube: jm.Mesh) -> None:
    with pytest.raises((TypeError, ValueError), match="fibre"):
        jm.Scene(cube, jm.lin_yin, jm.TABLE1, fibre=object(), supports=SUPPORTS)


@pytest.mark.parametrize(
    ("name", "value", "parts"),
    [
        ("fibre", (1.1, 0.0, 0.0), ("fibre", "unit", "element 0", "is 1.1")),
        ("cross", (0.0, 2.0, 0.0), ("cross", "unit", "element 0", "is 2")),
        ("cross", (0.6, 0.8, 0.0), ("fibre", "cross", "orthogonal", "36.9°")),
    ],
)
def test_fibres_that_are_made_orthonormal(cube: jm.Mesh, name: str, value: Any, parts: tuple[str, ...]) -> None:
    """With a warning; `tests/test_fibres.py` says what comes of it."""
    with pytest.warns(UserWarning, match=says(*parts)):
        scene = jm.Scene(cube, jm.lin_yin, jm.TABLE1, supports=SUPPORTS, **{name: value})
    np.testing.assert_allclose(scene.frame @ scene.frame.swapaxes(-1, -2), np.tile(np.eye(3), (1, 8, 1, 1)), atol=1e-14)


def test_one_bad_fibre_among_many_is_found() -> None:
    mesh = jm.box((2.0, 1.0, 1.0), (2, 1, 1))
    fibre = np.tile([1.0, 0.0, 0.0], (2, 8, 1))
    fibre[1, 5] = 0.0
    with pytest.raises(ValueError, match=says("fibre", "not zero", "element 1, point 5")):
        jm.Scene(mesh, jm.lin_yin, jm.TABLE1, fibre=fibre, supports=SUPPORTS)


# ------------------------------------------------------------------------------------------------- mesh and scene


def test_inverted_element(cube: jm.Mesh) -> None:
    with pytest.raises(ValueError, match=says("element 0", "inverted", "det J", "> 0", "VTK")):
        jm.Mesh(cube.points, cube.cells[:, [4, 5, 6, 7, 0, 1, 2, 3]], cube.faces)


def test_one_inverted_element_among_many_is_named() -> None:
    mesh = jm.box((3.0, 1.0, 1.0), (3, 1, 1))
    cells = mesh.cells.copy()
    cells[1] = cells[1][[3, 2, 1, 0, 7, 6, 5, 4]]
    with pytest.raises(ValueError, match=says("element 1", "inverted")):
        jm.Mesh(mesh.points, cells, mesh.faces)


def test_element_without_volume(cube: jm.Mesh) -> None:
    points = cube.points * np.array([1.0, 1.0, 0.0])
    with pytest.raises(ValueError, match=says("element 0", "no volume", "det J")):
        jm.Mesh(points, cube.cells, cube.faces)


def test_element_with_a_corner_pushed_through(cube: jm.Mesh) -> None:
    points = cube.points.copy()
    points[(points == 1.0).all(axis=1)] = 0.2
    with pytest.raises(ValueError, match=says("element 0", "inverted", "det J")):
        jm.Mesh(points, cube.cells, cube.faces)


@pytest.mark.parametrize(
    ("points", "cells", "parts"),
    [
        (np.zeros((8, 2)), np.arange(8)[None], ("points", "(n, 3)", "(8, 2)")),
        (np.full((8, 3), np.nan), np.arange(8)[None], ("points", "finite", "nan")),
        (np.zeros((8, 3)), np.arange(8), ("cells", "(n, 8)")),
        (np.zeros((8, 3)), np.arange(8.0)[None], ("cells", "integers", "float64")),
        (np.zeros((8, 3)), np.arange(1, 9)[None], ("cells", "0..7", "1..8")),
        (np.zeros((8, 3)), np.arange(-1, 7)[None], ("cells", "0..7", "-1..6")),
        (np.zeros((9, 3)), np.arange(8)[None], ("node", "no element", "8")),
    ],
)
def test_mesh_of_wrong_shape(points: Any, cells: Any, parts: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=says(*parts)):
        jm.Mesh(points, cells)


def test_face_with_unknown_nodes(cube: jm.Mesh) -> None:
    with pytest.raises(ValueError, match=says("faces['lid']", "0..7", "9")):
        jm.Mesh(cube.points, cube.cells, {"lid": [[0, 1, 2, 9]]})


@pytest.mark.parametrize(
    ("law", "parts"),
    [
        (lambda C, frame, beta, constants: C, ("law", "(3, 3)", "shape ()")),
        (lambda C, frame, beta, constants: (C[0, 0], C[1, 1]), ("law", "shape ()")),
        (lambda C, frame, beta, constants: jnp.log(C[0, 0] - 1.0), ("law", "finite at rest")),
    ],
    ids=["tensor", "tuple", "infinite"],
)
def test_law_that_is_no_finite_scalar(cube: jm.Mesh, law: Any, parts: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=says(*parts)):
        jm.Scene(cube, law, {}, supports=SUPPORTS)


def test_face_of_wrong_shape(cube: jm.Mesh) -> None:
    with pytest.raises(ValueError, match=says("faces['lid']", "(n, 4)", "(1, 3)")):
        jm.Mesh(cube.points, cube.cells, {"lid": [[0, 1, 2]]})


def test_empty_mesh() -> None:
    with pytest.raises(ValueError, match="cells"):
        jm.Mesh(np.zeros((0, 3)), np.zeros((0, 8), dtype=int))


@pytest.mark.parametrize(
    ("lengths", "elements", "parts"),
    [
        ((1.0, 0.0, 1.0), (1, 1, 1), ("lengths", "positive", "0.0")),
        ((1.0, -2.0, 1.0), (1, 1, 1), ("lengths", "positive", "-2.0")),
        ((1.0, np.nan, 1.0), (1, 1, 1), ("lengths", "finite")),
        ((1.0, 1.0), (1, 1, 1), ("lengths", "(3,)", "(2,)")),
        ((1.0, 1.0, 1.0), (1, 0, 1), ("elements", "integers", "0")),
        ((1.0, 1.0, 1.0), (1, 1), ("elements", "3 integers")),
        ((1.0, 1.0, 1.0), (1, 1, 1.5), ("elements", "integers", "1.5")),
    ],
)
def test_box(lengths: Any, elements: Any, parts: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=says(*parts)):
        jm.box(lengths, elements)


@pytest.mark.parametrize("value", [0, -1, 9, 2.5, "two", None])
def test_quadrature(cube: jm.Mesh, value: Any) -> None:
    with pytest.raises(ValueError, match=says("quadrature", str(value), "[1, 8]")):
        jm.Scene(cube, jm.lin_yin, jm.TABLE1, supports=SUPPORTS, quadrature=value)


def test_quadrature_of_the_thin_sample() -> None:
    with pytest.raises(ValueError, match=says("quadrature", "0", "[1, 8]")):
        jm.thin_sample(elements=(1, 1, 1), quadrature=0)


@pytest.mark.parametrize(
    ("supports", "free"),
    [
        ((), ("translation along x", "rotation about z")),
        (SUPPORTS[:1], ("translation along y", "translation along z", "rotation about x")),
        (SUPPORTS[:2], ("translation along z",)),
        ((jm.Planar("x0", "x"), *SUPPORTS[1:]), ("translation along x",)),
    ],
    ids=["none", "one", "two", "plate"],
)
def test_free_rigid_motion(cube: jm.Mesh, supports: Any, free: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=says("supports", "rigid motion", "Symmetry", *free)):
        jm.Scene(cube, jm.lin_yin, jm.TABLE1, supports=supports)


def test_unknown_face_of_a_support(cube: jm.Mesh) -> None:
    with pytest.raises(ValueError, match=says("face", "'top'", "'z1'")):
        jm.Scene(cube, jm.lin_yin, jm.TABLE1, supports=(*SUPPORTS, jm.Displacement("top", "z")))


@pytest.mark.parametrize("value", [0.9, np.nan], ids=str)
def test_distortion(value: float) -> None:
    """A distortion that turns elements inside out, or is no length at all."""
    with pytest.raises(ValueError, match=r"distortion|amplitude|inverted|finite"):
        jm.thin_sample(elements=(4, 4, 4), distortion=value)


def test_indexing_one_state_is_an_error(state: jm.State) -> None:
    with pytest.raises(TypeError, match="batch"):
        state[0]
