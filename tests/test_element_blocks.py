"""Blocks of elements, of which large bodies are assembled, against the dense residual and tangent of the same body."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import test_coordinates
import test_element
from test_element import residual_and_tangent_of, residual_of

import jaxmyo as jm
from jaxmyo import solve
from jaxmyo.pattern import BLOCK
from jaxmyo.sparse import Sparse
from jaxmyo.system import Inputs, System

Body = tuple[System, Inputs, np.ndarray]


def of(body: test_element.Body | test_coordinates.Body) -> Body:
    return body.system, body.inputs, body.z


def tied(weave: bool, quadrature: int | tuple[int, int, int] = 2) -> Body:
    """Two materials, one without the weave; unknowns that move several displacements; one p and one q for several
    elements; more elements than one block has."""
    box = jm.box((2.0, 2.0, 1.0), (6, 6, 4))
    x = box.points[box.cells].mean(axis=1)[:, 0]
    regions = {"near": np.flatnonzero(x < 1.0), "far": np.flatnonzero(x > 1.0)}
    mesh = jm.Mesh(box.points, box.cells, box.faces, regions=regions)
    assert len(mesh.cells) > BLOCK
    scar = jm.Material(jm.guccione, jm.Guccione(C=1.0, bf=8.0, bt=3.0, bfs=4.0), active=False, weave=False)
    scene = jm.Scene(
        mesh,
        jm.lin_yin,
        jm.TABLE1,
        supports=(*(jm.Symmetry(a) for a in "xyz"), jm.Uniform("z", ("x", "y")), jm.Planar("y1", "y")),
        regions={"far": scar},
        p_patches=jm.columns(box, "z"),
        q_patches=jm.columns(box, "z"),
        quadrature=quadrature,
    )
    system, inputs, _ = solve.contraction(scene, 20.0, 0.2 if weave else None, 0.7, 50.0 if weave else None, None)
    rng = np.random.default_rng(7)
    T_f, T_cf = rng.uniform(-5.0, 5.0, (2, *system.weight.shape)) * (0.0 if weave else 1.0)
    z = np.concatenate([0.02 * rng.standard_normal(system.n_u), rng.uniform(-3.0, 3.0, system.size - system.n_u)])
    return system, jax.tree.map(jnp.asarray, inputs._replace(T_f=T_f, T_cf=T_cf)), z


CASES: dict[str, Callable[[], Body]] = {
    "weave": lambda: of(test_element.body(True)),
    "tensions": lambda: of(test_element.body(False)),
    "closed pressure": lambda: of(test_element.body(False, "closed")),
    "springs": lambda: of(test_element.body(False, "spring")),
    "cylindrical, weave": lambda: of(test_coordinates.body(jm.CYLINDRICAL, True)),
    "prolate, weave": lambda: of(test_coordinates.body(test_coordinates.PROLATE, True)),
    "prolate, tensions": lambda: of(test_coordinates.body(test_coordinates.PROLATE, False)),
    "ties, materials and patches": lambda: tied(True),
    "3 × 3 × 2 points": lambda: tied(False, (3, 3, 2)),
    "27 points": lambda: tied(True, 3),
    "one point": lambda: tied(True, 1),
}
#: The others take the same ways.
QUICK = {"prolate, tensions", "ties, materials and patches"}
each = pytest.mark.parametrize("case", [pytest.param(c, marks=[] if c in QUICK else pytest.mark.slow) for c in CASES])


@each
def test_blocks_give_the_dense_residual_and_tangent(case: str) -> None:
    system, inputs, z = CASES[case]()
    r, K = (np.asarray(x) for x in residual_and_tangent_of(system, z, inputs))
    lin = Sparse(system)
    at, n_u = lin.at(z, jax.tree.map(np.asarray, inputs)), system.n_u
    A, B = lin.pattern.full(at.K.data).toarray(), at.K.B.toarray()
    if at.K.loads is not None:
        A = A - at.K.loads.toarray()
    scale = np.abs(K).max()
    np.testing.assert_allclose(at.r, r, rtol=0, atol=1e-13 * np.abs(r).max())
    np.testing.assert_allclose(B, K[n_u:, :n_u], rtol=0, atol=1e-14 * scale)
    np.testing.assert_allclose(np.diag(at.K.D), K[n_u:, n_u:], rtol=0, atol=1e-14 * scale)
    np.testing.assert_allclose(A - B.T @ (at.K.W[:, None] * B), K[:n_u, :n_u], rtol=0, atol=1e-10 * scale)
    u = np.asarray(system.displacements(z, inputs))
    forces, least_J = lin.assembly.forces(u, z, jax.tree.map(np.asarray, inputs))
    np.testing.assert_allclose(forces, r, rtol=0, atol=1e-13 * np.abs(r).max())
    assert least_J == pytest.approx(float(at.least_J), abs=1e-14)


@each
def test_rates_are_the_derivative_of_the_dense_residual(case: str) -> None:
    system, inputs, z = CASES[case]()
    rng = np.random.default_rng(8)
    by_t = jax.tree.map(lambda x: jnp.asarray(rng.standard_normal(np.shape(x))) * (1.0 + jnp.abs(x)) * 0.1, inputs)
    _, wanted = jax.jvp(lambda inputs: residual_of(system, z, inputs), (inputs,), (by_t,))
    numbers, changes = (jax.tree.map(np.asarray, x) for x in (inputs, by_t))
    u = np.asarray(system.displacements(z, inputs))
    found = Sparse(system).assembly.rates(u, z, numbers, changes)
    np.testing.assert_allclose(found, np.asarray(wanted), rtol=0, atol=1e-9 * np.abs(wanted).max())
