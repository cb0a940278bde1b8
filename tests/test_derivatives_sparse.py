"""Derivatives through sparse solves, whose factors live outside JAX: against differences, and against dense ones."""

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo import factor, multigrid, solve, sparse
from jaxmyo.invariants import I1, I3, I4
from jaxmyo.mesh import jitter
from jaxmyo.status import SingularError

STEP = 0.01

#: The fibres are tilted against the struts on purpose: that these are made normal to them has derivatives, too.
pytestmark = pytest.mark.filterwarnings("ignore:fibre and cross are not orthogonal")


@pytest.fixture
def sparse_only(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Every body is a large one, or even one for multigrid."""
    sparse.forget()
    monkeypatch.setattr(solve, "LARGE", 0)
    if request.param == "multigrid":
        pytest.importorskip("pyamg")
        monkeypatch.setattr(factor, "HUGE", 0)
        monkeypatch.setattr(multigrid, "COARSEST", 10)
    yield
    sparse.forget()


def law(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    stiff = constants["k"] * (1.0 + beta) * (I4(C, frame) - 1.0) ** 2
    return 0.5 * constants["mu"] * (I1(C) - 3.0 - jnp.log(I3(C))) + stiff


MESH = jitter(jm.box((1.0, 1.0, 1.0), (2, 2, 1)), 0.1, seed=0)
SCENE = jm.Scene(MESH, law, {"mu": 3.0, "k": 2.0}, supports=tuple(jm.Symmetry(axis) for axis in "xyz"))
#: Follower pressure makes the tangent unsymmetric; a weave of finite stiffness, an own law, nodes and fibres.
INPUTS = {
    "T0": jnp.array(1.1),
    "beta": jnp.array(0.7),
    "a_over_D": jnp.array(0.15),
    "weave_stiffness": jnp.array(20.0),
    "constants": {"mu": jnp.array(3.0), "k": jnp.array(2.0)},
    "points": jnp.asarray(MESH.points),
    "fibre": jnp.broadcast_to(jnp.array([0.9, 0.3, 0.1]), (len(MESH.cells), 3)),
    "stretch": jnp.array(1.05),
    "pressure": jnp.array(0.2),
}
rng = np.random.default_rng(0)
#: A direction among the inputs.
ALONG = jax.tree.map(lambda x: jnp.asarray(0.05 * np.abs(x).mean() * rng.uniform(-1.0, 1.0, np.shape(x))), INPUTS)


def output(x: Any, way: tuple[Any, Any] | None = None) -> Any:
    """Of a state C: reaction, tension, energy and volume in one number. way: the loads of a state that it starts from.

    In the same order as the loads of C: the stretch [–] and the pressure [kPa].
    """
    own = {name: value for name, value in x.items() if name not in ("stretch", "pressure")}
    if "fibre" in own:
        own["fibre"] = own["fibre"] / jnp.linalg.norm(own["fibre"], axis=1, keepdims=True)
    A = jm.contract(SCENE, **own)

    def loaded(stretch: Any, pressure: Any, start: jm.State | None = None) -> jm.State:
        return jm.load(A, jm.Stretch("x", stretch), jm.Pressure("z1", pressure, ends="open"), start=start)

    C = loaded(x["stretch"], x["pressure"], None if way is None else loaded(*way))
    assert (C.solver == "dense LU") == (solve.LARGE > 0)
    return C.reaction("x1")[0] + 0.1 * A.T_cf[1, 3] + C.stored_energy + 0.2 * C.cauchy[0, 1, 2, 2] + C.u[4, 1]


def moved(x: Any, h: float) -> Any:
    """The inputs x, gone some way along the direction."""
    return jax.tree.map(lambda x, d: x + h * d, x, {name: ALONG[name] for name in x})


def richardson(values: Any) -> Any:
    wide, narrow = ((values(h) - values(-h)) / (2.0 * h) for h in (STEP, 0.5 * STEP))
    return (4.0 * narrow - wide) / 3.0


def dot(a: Any, b: Any) -> Any:
    return sum(map(jnp.vdot, jax.tree.leaves(a), jax.tree.leaves(b)))


@pytest.mark.parametrize("sparse_only", ["direct"], indirect=True)
@pytest.mark.slow
def test_some_inputs(sparse_only: None) -> None:
    """What costs little to compile: constants and loads, with the weave as an exact constraint."""
    check({name: INPUTS[name] for name in ("T0", "a_over_D", "constants", "stretch", "pressure")})


@pytest.mark.parametrize("sparse_only", ["direct"], indirect=True)
@pytest.mark.slow
def test_a_load_that_starts_from_another_one(sparse_only: None) -> None:
    """The way to a state has no part in its derivatives, though the way itself changes with the inputs."""
    x = {name: INPUTS[name] for name in ("T0", "a_over_D", "constants", "stretch", "pressure")}

    def by_steps(x: Any) -> Any:
        return output(x, (0.5 * (1.0 + x["stretch"]), 0.5 * x["pressure"]))

    gradient, other = jax.grad(output)(x), jax.grad(by_steps)(x)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9), other, gradient)
    along = {name: ALONG[name] for name in x}
    np.testing.assert_allclose(jax.jvp(by_steps, (x,), (along,))[1], dot(gradient, along), rtol=1e-9)
    assert jax.grad(lambda pressure: output(x, (x["stretch"], pressure)))(0.1) == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("sparse_only", ["direct"], indirect=True)
def test_second_derivatives_of_a_load_that_starts_from_another_one(sparse_only: None) -> None:
    """By every kind of input, those that change the mesh among them."""

    def product(way: Any) -> Any:
        return jax.jvp(jax.grad(lambda x: output(x, way and way(x))), (INPUTS,), (ALONG,))

    found = product(lambda x: (0.5 * (1.0 + x["stretch"]), 0.5 * x["pressure"]))
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-8), found, product(None))


@pytest.mark.slow
@pytest.mark.parametrize("sparse_only", ["direct", "multigrid"], indirect=True)
def test_every_kind_of_input(sparse_only: None) -> None:
    check(INPUTS)


def check(x: Any) -> None:
    """Differences to 1e-7, forward against reverse to 1e-10."""
    along = {name: ALONG[name] for name in x}
    gradient = jax.grad(output)(x)
    _, forward = jax.jvp(output, (x,), (along,))
    np.testing.assert_allclose(forward, dot(gradient, along), rtol=1e-10)
    np.testing.assert_allclose(richardson(lambda h: output(moved(x, h))), forward, rtol=1e-7)


@pytest.mark.slow
def test_second_derivatives_and_the_dense_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """Gradient and Hessian-vector product: sparse = dense to 1e-8, and differences to 1e-5."""

    def product(x: Any) -> tuple[Any, Any]:
        return jax.jvp(jax.grad(output), (x,), (ALONG,))

    dense = product(INPUTS)
    monkeypatch.setattr(solve, "LARGE", 0)
    sparse.forget()
    found = product(INPUTS)
    for name in INPUTS:
        for a, b in zip(found, dense, strict=True):
            jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-8), a[name], b[name])
    slope = richardson(lambda h: dot(jax.grad(output)(moved(INPUTS, h)), ALONG))
    np.testing.assert_allclose(dot(found[1], ALONG), slope, rtol=1e-5)
    sparse.forget()


@pytest.mark.slow
def test_through_a_cycle(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of all states of a cycle by T0, activation, constants and loads: differences to 1e-7, the dense gradient to 1e-8.

    The tangents of all steps are remembered until then.
    """
    x = {
        name: INPUTS[name] for name in ("T0", "beta", "a_over_D", "weave_stiffness", "constants", "stretch", "pressure")
    }

    def over_all(x: Any) -> Any:
        cycle = jm.cycle(
            SCENE,
            [0.0, 0.5, 1.0],
            **{name: x[name] for name in ("T0", "a_over_D", "weave_stiffness", "constants")},
            beta=lambda s: x["beta"] * s,
            loads=lambda s: [
                jm.Stretch("x", 1.0 + (x["stretch"] - 1.0) * s),
                jm.Pressure("z1", x["pressure"] * s, ends="open"),
            ],
        )
        assert (cycle.C.solver == "dense LU") == (solve.LARGE > 0)
        return jnp.array([0.3, -0.5, 1.0]) @ (
            cycle.C.u[:, 4, 1] + 0.1 * cycle.C.cauchy[:, 0, 1, 2, 2] + cycle.A.T_cf[:, 1, 3]
        )

    dense = jax.grad(over_all)(x)
    monkeypatch.setattr(solve, "LARGE", 0)
    sparse.forget()
    gradient = jax.grad(over_all)(x)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-8), gradient, dense)
    along = {name: ALONG[name] for name in x}
    slope = dot(gradient, along)
    np.testing.assert_allclose(jax.jvp(over_all, (x,), (along,))[1], slope, rtol=1e-10)
    np.testing.assert_allclose(richardson(lambda h: over_all(moved(x, h))), slope, rtol=1e-7)
    sparse.forget()


@pytest.mark.parametrize("sparse_only", ["direct"], indirect=True)
def test_where_there_is_none(sparse_only: None) -> None:
    """At rest nothing resists shear, which is an error; what failed has derivatives 0 and a status, or raises."""
    passive = jm.Scene(MESH, jm.lin_yin, jm.TABLE1, supports=SCENE.supports)

    def corner(T0: Any, beta: Any, throw: bool = False) -> tuple[Any, Any]:
        A = jm.contract(passive, T0=T0, a_over_D=None, beta=beta, throw=throw)
        return A.u[4, 1], A.status

    at_rest = jm.contract(passive, T0=1.0, a_over_D=None, beta=0.0)
    assert (at_rest.negative_eigenvalues, at_rest.zero_eigenvalues) == (0, 1)
    with pytest.raises(SingularError, match=r"no derivative: its tangent has \d+ mode\(s\) without stiffness"):
        jax.grad(corner, argnums=1, has_aux=True)(1.0, 0.0)
    for T0 in (-1.0, np.nan):
        slopes, status = jax.grad(corner, argnums=(0, 1), has_aux=True)(T0, 0.5)
        assert status == jm.Status.INVALID_INPUT
        assert slopes == (0.0, 0.0)
        with pytest.raises(jm.SolveError, match="INVALID_INPUT"):
            jax.grad(lambda T0: corner(T0, 0.5, throw=True)[0])(T0)


@pytest.mark.parametrize("sparse_only", ["direct"], indirect=True)
def test_next_to_where_there_is_none(sparse_only: None) -> None:
    """Rest is found singular after a state close by, whose factors are not; and next to rest nothing is made up."""
    passive = jm.Scene(MESH, jm.lin_yin, jm.TABLE1, supports=SCENE.supports)

    def corner(beta: Any) -> Any:
        return jm.contract(passive, T0=1.0, a_over_D=None, beta=beta).u[4, 1]

    assert abs(jax.grad(corner)(1e-3) - 1.0) < 0.1
    with pytest.raises(SingularError, match="no derivative: its tangent has 1 mode"):
        jax.grad(corner)(0.0)
    with pytest.raises(SingularError, match=r"no derivative that could be found: .* all but singular"):
        jax.grad(corner)(1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("large", [1000, 0])
def test_cavities(large: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The pressure at a volume by that volume and by the stiffness, and back: dP/dV · dV/dP = 1."""
    monkeypatch.setattr(solve, "LARGE", large)
    sparse.forget()
    tube = jm.axisymmetric_tube((3, 3), law=law, constants={"mu": 10.0, "k": 1.0})

    def pressure(volume: Any, mu: Any) -> Any:
        A = jm.contract(tube, T0=0.0, a_over_D=None, constants={"mu": mu, "k": 1.0})
        return jm.load(A, jm.Volume("inner", volume)).cavity_pressures[0]

    def volume(pressure: Any, mu: Any) -> Any:
        A = jm.contract(tube, T0=0.0, a_over_D=None, constants={"mu": mu, "k": 1.0})
        return jm.load(A, jm.Pressure("inner", pressure, ends="closed")).cavity_volume("inner")

    V = 1.2 * np.pi * 2.0**2 * 10.0  # the upper half of the tube, one element all the way round
    P, (by_V, by_mu) = jax.value_and_grad(pressure, argnums=(0, 1))(V, 10.0)
    back, (by_P, V_by_mu) = jax.value_and_grad(volume, argnums=(0, 1))(float(P), 10.0)
    np.testing.assert_allclose(back, V, rtol=1e-9)
    np.testing.assert_allclose(by_P * by_V, 1.0, rtol=1e-7)
    np.testing.assert_allclose(V_by_mu, -by_mu / by_V, rtol=1e-7)
    step = 0.01
    np.testing.assert_allclose(by_mu, (pressure(V, 10.0 + step) - pressure(V, 10.0 - step)) / (2.0 * step), rtol=1e-6)
    sparse.forget()
