"""A support that is moved by a load: as if it had not been there, and the motion given."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo import solve, sparse

CLAMP = tuple(jm.Displacement("x0", a) for a in "xyz")
OTHER = tuple(jm.Displacement("x1", a) for a in "xyz")


def neo_hookean(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    return 0.5 * constants["mu"] * (jnp.trace(C) - 3.0 - jnp.log(jnp.linalg.det(C)))


def bar(supports: Any) -> jm.State:
    mesh = jm.box((2.0, 1.0, 1.0), (3, 2, 1))
    scene = jm.Scene(mesh, neo_hookean, {"mu": 10.0}, supports=supports)
    return jm.contract(scene, T0=0.0, a_over_D=None)


def assert_same(a: jm.State, b: jm.State) -> None:
    np.testing.assert_allclose(np.asarray(a.u), np.asarray(b.u), rtol=0, atol=1e-10)
    np.testing.assert_allclose(np.asarray(a.p), np.asarray(b.p), rtol=0, atol=1e-9)
    for face in ("x0", "x1"):
        np.testing.assert_allclose(np.asarray(a.reaction(face)), np.asarray(b.reaction(face)), rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "large", [pytest.param(1000, id="dense", marks=pytest.mark.slow), pytest.param(0, id="sparse")]
)
def test_a_clamp_that_moves(large: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """One axis of a clamped face is moved, the others stay; the same with the motion given instead of the support."""
    monkeypatch.setattr(solve, "LARGE", large)
    sparse.forget()
    motion = (jm.Displacement("x1", "x", 0.3), jm.Displacement("x1", "z", 0.2))
    moved = jm.load(bar((*CLAMP, *OTHER)), *motion)
    u = np.asarray(moved.u)
    for face, where in (("x0", [0.0, 0.0, 0.0]), ("x1", [0.3, 0.0, 0.2])):
        nodes = np.unique(moved.scene.mesh.face(face))
        np.testing.assert_array_equal(u[nodes], np.broadcast_to(where, (len(nodes), 3)))
    assert np.abs(np.asarray(moved.reaction("x1"))).max() > 1.0
    np.testing.assert_allclose(np.asarray(moved.reactions).sum(axis=0), 0.0, atol=1e-9)
    given = jm.load(bar((*CLAMP, OTHER[1])), *motion)
    assert_same(moved, given)


@pytest.mark.slow
def test_a_symmetry_plane_and_a_support_moved_by_their_own_value() -> None:
    """A plane that moves carries the body along; a support that is prescribed where it is stays."""
    at_rest = bar((jm.Symmetry("x"), jm.Symmetry("y"), jm.Symmetry("z")))
    stays = jm.load(at_rest, jm.Displacement("x0", "x", 0.0))
    np.testing.assert_allclose(np.asarray(stays.u), 0.0, atol=1e-13)
    carried = jm.load(at_rest, jm.Displacement("x0", "x", 0.7))
    np.testing.assert_allclose(np.asarray(carried.u)[:, 0], 0.7, rtol=0, atol=1e-11)
    np.testing.assert_allclose(np.asarray(carried.cauchy), 0.0, atol=1e-9)


@pytest.mark.slow
def test_the_support_holds_again_without_its_motion() -> None:
    """From a state with a moved support to one without: back at rest."""
    at_rest = bar((*CLAMP, *OTHER))
    moved = jm.load(at_rest, jm.Displacement("x1", "x", 0.3), jm.Displacement("x1", "z", 0.2))
    back = jm.load(at_rest, start=moved)
    np.testing.assert_allclose(np.asarray(back.u), 0.0, atol=1e-11)
