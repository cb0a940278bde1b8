"""Springs that hold a body: what they leave free, and what they give way to."""

import re
from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq
from test_element import residual_and_tangent_of
from test_surface import quarter

import jaxmyo as jm
from jaxmyo import surface
from jaxmyo.system import Inputs, System


@pytest.fixture
def cube() -> jm.Mesh:
    return jm.box((1.0, 1.0, 1.0), (1, 1, 1))


def neo_hookean(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    return 0.5 * constants["mu"] * (jnp.trace(C) - 3.0 - jnp.log(jnp.linalg.det(C)))


def supported(mesh: jm.Mesh, *supports: Any) -> jm.Scene:
    return jm.Scene(mesh, neo_hookean, {"mu": 10.0}, supports=supports)


def test_springs_may_be_the_only_supports(cube: jm.Mesh) -> None:
    s = supported(cube, jm.Spring("x0", 1.0))
    assert s.kinematics(()).size == 24
    assert s.springs == (jm.Spring("x0", 1.0),)
    normal = tuple(jm.Spring(face, 1.0, "normal") for face in ("x0", "y0", "z0"))
    assert supported(cube, *normal).kinematics(()).size == 24


@pytest.mark.parametrize(
    ("supports", "free"),
    [
        ((jm.Spring("x0", 1.0, "normal"),), ("translation along y", "translation along z", "rotation about x")),
        ((jm.Spring("z1", 1.0, "normal"),), ("translation along x", "translation along y", "rotation about z")),
        (
            (jm.Spring("z1", 1.0, "normal"), jm.Spring("z0", 1.0, "normal")),
            ("translation along x", "translation along y", "rotation about z"),
        ),
        ((jm.Spring("z1", 1.0, "normal"), jm.Symmetry("x")), ("translation along y",)),
    ],
    ids=str,
)
def test_normal_springs_on_flat_faces_leave_motions_that_are_named(
    cube: jm.Mesh, supports: Any, free: tuple[str, ...]
) -> None:
    with pytest.raises(ValueError, match="leave a rigid motion free") as error:
        supported(cube, *supports)
    found = re.findall(r"translation along \w|rotation about \w", str(error.value))
    assert sorted(found) == sorted(free)


def test_normal_springs_around_a_tube_leave_what_keeps_its_surface() -> None:
    with pytest.raises(ValueError, match="leave a rigid motion free") as error:
        supported(quarter(), jm.Spring("r1", 1.0, "normal"))
    found = re.findall(r"translation along \w|rotation about \w", str(error.value))
    assert sorted(found) == ["rotation about z", "translation along z"]


def test_springs_around_a_tube_and_on_its_end_hold_it() -> None:
    assert supported(quarter(), jm.Spring("r1", 1.0, "normal"), jm.Spring("z0", 1.0)).kinematics(()).size == 90


@cache
def block_on_springs() -> jm.Scene:
    """A block 2 × 1 × 1 mm on normal springs k = 4 kPa/mm at x0; its face x1 is to be pulled."""
    slabs = jm.Uniform("x", ("y", "z")), jm.Proportional("y", "y"), jm.Proportional("z", "z")
    return supported(jm.box((2.0, 1.0, 1.0), (1, 1, 1)), *slabs, jm.Spring("x0", 4.0, "normal"))


def assert_pulled(u: np.ndarray, P: float) -> None:
    """P A = k u A at x0, and μ (λ − λ⁻²) = P in the block."""
    X = block_on_springs().mesh.points
    stretch = brentq(lambda s: 10.0 * (s - s**-2) - P, 0.3, 3.0, xtol=1e-15)
    np.testing.assert_allclose(u[X[:, 0] == 0.0, 0], P / 4.0, rtol=1e-11)
    np.testing.assert_allclose(u[X[:, 0] == 2.0, 0], P / 4.0 + 2.0 * (stretch - 1.0), rtol=1e-11)
    np.testing.assert_allclose(u[:, 1:], (stretch**-0.5 - 1.0) * X[:, 1:], rtol=0, atol=1e-11)


@pytest.mark.parametrize("P", [12.0, -6.0])
def test_a_block_on_springs(P: float) -> None:
    """Newton in numpy, on the residual and the tangent of the package."""
    s = block_on_springs()
    quads, loads = surface.build(s.mesh, (*s.springs, jm.Traction("x1", (P, 0.0, 0.0))))
    system = System.of(s, s.kinematics(()), weave=False, surfaces=quads)
    none, zero = jnp.zeros(system.weight.shape), jnp.zeros(())
    inputs = Inputs((s.constants,), *[zero] * 4, none, none, jnp.zeros(24), loads, jnp.zeros(0), jnp.zeros(system.size))
    z = np.zeros(system.size)
    for _ in range(12):
        r, K = (np.asarray(v) for v in residual_and_tangent_of(system, z, inputs))
        z = z - np.linalg.solve(K, r)
    assert np.abs(r).max() <= 1e-12
    assert_pulled(np.asarray(system.displacements(jnp.asarray(z), inputs)), P)


@pytest.mark.slow
def test_a_block_on_springs_from_rest() -> None:
    rest = jm.contract(block_on_springs(), T0=0.0, a_over_D=None)
    for P in (12.0, -6.0):
        state = jm.load(rest, jm.Traction("x1", (P, 0.0, 0.0)))
        assert_pulled(np.asarray(state.u), P)
        assert int(state.negative_eigenvalues) == 0
        np.testing.assert_allclose(np.asarray(state.reactions), 0.0, atol=1e-10)
