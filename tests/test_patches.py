"""Patches of elements that share a multiplier, and the constraints that they pose: are they independent?"""

import re
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from support import sample
from test_element import central, residual_of

import jaxmyo as jm
from jaxmyo import constraints, patches
from jaxmyo.system import Inputs, System

# ----------------------------------------------------------------------------------------------------- who shares


def middles(mesh: jm.Mesh) -> np.ndarray:
    """The middle of each element, in units of the elements: (n_elements, 3) integers from 0."""
    size = mesh.extent / np.array(mesh.grid)
    return np.floor((mesh.points[mesh.cells].mean(axis=1) - mesh.points.min(axis=0)) / size).astype(int)


def assert_shared(numbers: np.ndarray, key: np.ndarray) -> None:
    """Two elements have one patch exactly if they have one key; numbers run from 0 without gaps."""
    assert numbers.dtype == np.int64
    np.testing.assert_array_equal(numbers[:, None] == numbers[None, :], (key[:, None] == key[None, :]).all(axis=-1))
    assert sorted(set(numbers.tolist())) == list(range(len(np.unique(key, axis=0))))


GRIDS = [(2, 2, 2), (4, 3, 1), (5, 3, 2), (1, 1, 1), (3, 5, 7)]


@pytest.mark.parametrize("grid", GRIDS, ids=str)
def test_columns(grid: tuple[int, int, int]) -> None:
    mesh = jm.box((2.0, 3.0, 5.0), grid)
    for k, axis in enumerate("xyz"):
        assert_shared(jm.columns(mesh, axis), np.delete(middles(mesh), k, axis=1))


@pytest.mark.parametrize("grid", GRIDS, ids=str)
def test_blocks(grid: tuple[int, int, int]) -> None:
    """2×2×2 elements; what an odd number leaves is a smaller block at the end."""
    mesh = jm.box((2.0, 3.0, 5.0), grid)
    assert_shared(jm.blocks(mesh), middles(mesh) // 2)
    sizes = np.bincount(jm.blocks(mesh))
    assert sizes.max() == np.prod(np.minimum(grid, 2))
    assert sizes[-1] == np.prod([2 - n % 2 for n in grid])


def test_columns_through_the_wall_of_a_tube() -> None:
    mesh = jm.structured([[2.0, 3.0, 4.0, 5.0], [0.0, 0.5, 1.0], [0.0, 2.0, 4.0]], jm.CYLINDRICAL)
    assert_shared(jm.columns(mesh, "r"), middles(mesh)[:, 1:])
    with pytest.raises(ValueError, match=r"axis = 'x' is unknown; valid: 'r', 'phi', 'z'"):
        jm.columns(mesh, "x")


def test_a_mesh_that_is_not_structured_has_no_columns() -> None:
    mesh = jm.box((1.0, 1.0, 1.0), (2, 1, 1))
    loose = jm.Mesh(mesh.points, mesh.cells, mesh.faces)
    for make in (lambda: jm.columns(loose, "x"), lambda: jm.blocks(loose)):
        with pytest.raises(ValueError, match=r"not structured \(mesh.grid is None\).*as an array"):
            make()


# --------------------------------------------------------------------------------------------------------- checked


@pytest.fixture(scope="module")
def row() -> jm.Mesh:
    return jm.box((4.0, 1.0, 1.0), (4, 1, 1))


def test_patches_that_are_not_given_are_one_per_element(row: jm.Mesh) -> None:
    np.testing.assert_array_equal(patches.checked("p_patches", None, row), [0, 1, 2, 3])


@pytest.mark.parametrize("numbers", [[0, 0, 1, 1], (1, 0, 1, 0), np.array([2, 1, 0, 0], dtype=np.uint8), [0] * 4])
def test_patches_of_any_order(row: jm.Mesh, numbers: Any) -> None:
    got = patches.checked("p_patches", numbers, row)
    np.testing.assert_array_equal(got, numbers)
    assert got.dtype == np.int64


@pytest.mark.parametrize(
    ("numbers", "error", "words"),
    [
        ([0, 0, 1], ValueError, r"q_patches does not cover the elements: shape \(3,\), but the mesh has 4"),
        ([[0, 0], [1, 1]], ValueError, r"q_patches does not cover the elements: shape \(2, 2\)"),
        (0, ValueError, r"q_patches does not cover the elements: shape \(\)"),
        ([0, 1, -1, 0], ValueError, r"q_patches does not cover the elements: element 2 has patch -1 \(must be ≥ 0\)"),
        ([0, 2, 2, 0], ValueError, r"q_patches: patch 1 has no element.*from 0 without gaps"),
        ([1, 1, 2, 2], ValueError, r"q_patches: patch 0 has no element"),
        ([0.0, 0.0, 1.0, 1.0], TypeError, r"q_patches must be integers \(n_elements,\).*float64"),
        ([True, False, True, False], TypeError, r"q_patches must be integers.*bool"),
        ("column", TypeError, r"q_patches must be integers"),
    ],
    ids=str,
)
def test_patches_that_make_no_sense(row: jm.Mesh, numbers: Any, error: Any, words: str) -> None:
    with pytest.raises(error, match=words):
        patches.checked("q_patches", numbers, row)
    with pytest.raises(error, match=words):
        jm.Scene(row, jm.lin_yin, jm.TABLE1, supports=(jm.Spring("x0", 1.0),), q_patches=numbers)


# ------------------------------------------------------------------------------------------- multipliers of a state


@pytest.mark.slow
def test_a_state_has_one_multiplier_per_patch_and_meets_each_in_the_mean() -> None:
    """A radial tube of 4 shells: p on pairs of them, q on the wall."""
    scene = jm.radial_tube(4)
    pairs = jm.Scene(
        scene.mesh,
        scene.law,
        scene.constants,
        scene.fibre,
        scene.cross,
        scene.supports,
        scene.quadrature,
        p_patches=[1, 1, 0, 0],
        q_patches=scene.q_patches,
    )
    state = jm.contract(pairs, T0=5.0, a_over_D=0.2)
    assert state.p.shape == (2,)
    assert state.q is not None
    assert state.q.shape == (1,)
    C, T_f, T_cf = (np.asarray(f) for f in jax.jit(lambda s: (s.C, s.T_f, s.T_cf))(state))
    weight = np.asarray(state.system.weight)
    i3 = np.linalg.det(C) - 1.0
    h = reference.constraint(np.sqrt(C[..., 1, 1]), np.sqrt(C[..., 2, 2]), 0.2)  # fibres around, struts along z
    for own in ([2, 3], [0, 1]):
        assert abs(np.sum((weight * i3)[own])) <= 1e-12 * weight[own].sum()
    assert abs(np.sum(weight * h)) <= 1e-12 * weight.sum()
    for values in ((weight * i3).sum(axis=1), (weight * h).sum(axis=1)):  # not in each element
        assert (np.abs(values) > 1e-6 * weight.sum(axis=1)).all()
    # q is one number for the wall: T_cf = ½ q I6^½ and T_f = −¼ (π − 2) q I4^(−¼) a/D.
    q = float(state.q[0])
    np.testing.assert_allclose(T_cf, 0.5 * q * np.sqrt(C[..., 2, 2]), rtol=1e-13)
    np.testing.assert_allclose(T_f, -0.05 * (np.pi - 2.0) * q * C[..., 1, 1] ** -0.25, rtol=1e-13)
    assert abs(float(state.p[0] - state.p[1])) > 1e-3


# -------------------------------------------------------------------------------------------- independent constraints

SYMMETRY = jm.Symmetry("x"), jm.Symmetry("y"), jm.Symmetry("z")


def neo_hookean(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    return 0.5 * constants["mu"] * (jnp.trace(C) - 3.0 - jnp.log(jnp.linalg.det(C)))


def boxed(elements: tuple[int, int, int], *supports: Any, **arguments: Any) -> jm.Scene:
    mesh = jm.box((1.0, 1.0, 1.0), elements)
    return jm.Scene(mesh, neo_hookean, {"mu": 10.0}, supports=supports, **arguments)


def fixed_all_round(axes: str = "xyz") -> tuple[jm.Displacement, ...]:
    return tuple(jm.Displacement(f"{a}{end}", k) for a in "xyz" for end in (0, 1) for k in axes)


def built(scene: jm.Scene, weave: bool) -> System:
    return System.of(scene, scene.kinematics(()), weave=weave, surfaces={})


def check(scene: jm.Scene, a_over_D: float | None = 0.2, *, soft: bool = False) -> None:
    constraints.check_at_rest(scene, built(scene, a_over_D is not None), a_over_D, soft=soft)


@pytest.mark.parametrize("a_over_D", [0.0, 0.1, 0.25, None])
def test_the_thin_sample_poses_independent_constraints(a_over_D: float | None) -> None:
    """With a/D = 0 the weave is inextensible struts, h = 1 − λcf: one condition like any other."""
    check(sample(), a_over_D)
    check(sample((2, 2, 2), 0.2), a_over_D)


def test_a_tube_with_one_q_per_element_is_over_determined() -> None:
    scene = jm.radial_tube(3, q_patches=None)
    with pytest.raises(ValueError, match="the constraints are over-determined") as error:
        check(scene)
    message = str(error.value)
    assert "incompressibility (3 pressures p) and the weave (3 multipliers q) are 6 conditions" in message
    assert "on 5 displacements, and only 5 of them are independent (of incompressibility alone: 3)" in message
    assert 'q_patches=jaxmyo.columns(mesh, "r")' in message
    assert "a finite weave_stiffness [kPa]" in message
    assert "p_patches" not in message
    check(scene, soft=True)
    check(scene, None)
    check(jm.radial_tube(3))


def test_a_tube_that_cannot_move_is_locked() -> None:
    """Two shells: 4 independent conditions on 4 displacements; the only state is the rest, whatever the fibres do."""
    scene = jm.radial_tube(2, q_patches=None)
    with pytest.raises(ValueError, match=r"locking the body.* are 4 conditions on 4 displacements"):
        check(scene)
    check(scene, soft=True)
    check(jm.radial_tube(2))


def test_contract_refuses_redundant_constraints() -> None:
    with pytest.raises(ValueError, match="the constraints are over-determined"):
        jm.contract(jm.radial_tube(3, q_patches=None), T0=1.0, a_over_D=0.2)
    with pytest.raises(ValueError, match="the constraints are over-determined"):  # a traced a/D counts as 0.2
        jax.eval_shape(lambda a: jm.contract(jm.radial_tube(3, q_patches=None), T0=1.0, a_over_D=a).u, 0.2)


def test_a_homogeneous_body_of_two_elements_is_redundant() -> None:
    """Both elements ask the same of the three stretches."""
    with pytest.raises(ValueError, match="the constraints are redundant") as error:
        check(boxed((2, 1, 1), jm.Homogeneous()), None)
    assert "are 2 conditions on 3 displacements, and only 1 of them are independent" in str(error.value)
    assert "p_patches=jaxmyo.blocks(mesh)" in str(error.value)
    assert "q_patches" not in str(error.value)
    check(boxed((2, 1, 1), jm.Homogeneous(), p_patches=[0, 0], q_patches=[0, 0]))


def test_a_body_in_a_rigid_shell() -> None:
    """All surface nodes fixed: the total volume is given, so the elements' conditions are one too many, at least."""
    with pytest.raises(ValueError, match=r"over-determined.*8 conditions on 3 displacements"):
        check(boxed((2, 2, 2), *fixed_all_round()), None)
    with pytest.raises(ValueError, match=r"redundant.*only 26 of them are independent"):
        check(boxed((3, 3, 3), *fixed_all_round("x"), jm.Symmetry("y"), jm.Symmetry("z"), *normals()), None)
    check(boxed((2, 2, 2), *SYMMETRY))


def normals() -> tuple[jm.Displacement, ...]:
    """The upper faces do not move along their normals."""
    return tuple(jm.Displacement(f"{a}1", a) for a in "xyz")


def test_a_body_of_which_every_node_is_prescribed_is_let_be() -> None:
    """Nothing is unknown but p, which does no harm."""
    scene = boxed((1, 1, 1), *fixed_all_round())
    assert scene.kinematics(()).size == 0
    check(scene, None)
    check(scene, 0.2)


def test_one_element_that_is_fully_determined_is_no_locked_mesh() -> None:
    """A homogeneous sample of one free stretch has as many conditions as displacements."""
    scene = boxed((1, 1, 1), jm.Homogeneous(), jm.Stretch("x", 1.1), jm.Stretch("y", 1.1))
    assert scene.kinematics(()).size == 1
    check(scene, None)


def test_where_the_rank_is_dear_the_conditions_are_counted() -> None:
    scene = boxed((18, 18, 18), jm.Homogeneous())
    with pytest.raises(ValueError, match=r"over-determined.*5832 pressures p.* 11664 conditions on 3"):
        check(scene)


RANKED = [
    pytest.param(lambda: jm.radial_tube(3, q_patches=None), True, id="tube-3-q"),
    pytest.param(lambda: jm.radial_tube(3), True, id="tube-1-q"),
    pytest.param(lambda: boxed((2, 2, 2), *fixed_all_round()), False, id="shell"),
    pytest.param(
        lambda: boxed((3, 3, 3), *fixed_all_round("x"), jm.Symmetry("y"), jm.Symmetry("z"), *normals()),
        False,
        id="slip",
    ),
]


def inputs_of(scene: jm.Scene, system: System, softness: float = 0.0) -> Inputs:
    none, zero = jnp.zeros(system.weight.shape), jnp.zeros(())
    offset = jnp.zeros(system.points.size)
    constants, soft = scene.constants, jnp.array(softness)
    return Inputs(
        (constants,), zero, jnp.array(0.2), zero, soft, none, none, offset, {}, jnp.zeros(0), jnp.zeros(system.size)
    )


@pytest.mark.parametrize(("make", "weave"), RANKED)
def test_the_rank_against_differences_of_the_residual(make: Any, weave: bool) -> None:
    """The rows of p and q by the displacements at rest, their rank in numpy; the message gives it, or there is none."""
    scene = make()
    system = built(scene, weave)
    inputs, rest = inputs_of(scene, system), np.zeros(system.size)
    u = np.zeros(system.n_u)

    def rows(u: np.ndarray) -> np.ndarray:
        z = rest.copy()
        z[: system.n_u] = u
        return np.asarray(residual_of(system, z, inputs))[system.n_u :]

    B = central(rows, u, 1e-5)
    rank = np.linalg.matrix_rank(B, tol=1e-7 * np.linalg.norm(B, 2))
    rank_p = np.linalg.matrix_rank(B[: system.n_p], tol=1e-7 * np.linalg.norm(B, 2))
    try:
        check(scene, 0.2 if weave else None)
    except ValueError as error:
        numbers = re.search(r"only (\d+) of them are independent \(of incompressibility alone: (\d+)\)", str(error))
        assert numbers is not None
        assert [int(n) for n in numbers.groups()] == [rank, rank_p]
        assert rank < len(B) or rank == system.n_u
    else:
        assert rank == len(B) < system.n_u


def test_a_failure_says_so_where_its_constraints_are_redundant() -> None:
    """A sentence; or nothing, if the failure has another reason: a soft weave is no constraint."""
    scene = jm.radial_tube(3, q_patches=None)
    system = jax.tree.map(jnp.asarray, built(scene, True))
    z = jnp.zeros(system.size)
    said = constraints.at_failure(system, z, inputs_of(scene, system))
    assert said == " There the 6 constraints are redundant: only 5 of them are independent of each other."
    assert constraints.at_failure(system, z, inputs_of(scene, system, softness=0.1)) == ""
