"""Laws written out number by number, against `vmap`, and what is left to `vmap`."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo import energies, entries
from jaxmyo.invariants import I1, I4
from jaxmyo.lanes import everywhere

LANES = (2, 1, 5)
ROLLERS = (jm.Symmetry("x"), jm.Symmetry("y"), jm.Symmetry("z"))


def of_tensors(C: Any, frame: Any, beta: Any, k: Any) -> Any:
    """What laws are made of beside their invariants [kPa]."""
    E = 0.5 * (C - jnp.eye(3))
    E_f = frame @ E @ frame.T
    a, b, c = jnp.unstack(jnp.stack([E_f[0, 0], E_f[1, 1], E_f[2, 2]]))
    shear = jnp.squeeze(jnp.reshape(E_f, 9)[1:2]) + jnp.transpose(E_f)[0, 2]
    return jnp.where(a > 0.0, jnp.expm1(k * a**2), 0.0) + b * c + beta * shear**2


def of_contractions(C: Any, frame: Any, beta: Any, k: Any) -> Any:
    """Sums and products over whole tensors [kPa]."""
    along = jnp.einsum("i,ij,j", frame[2], C, frame[2]) + jnp.trace(C) + jnp.prod(1.0 + jnp.flip(C[0]))
    return along + jnp.tensordot(C, C) + jnp.sqrt(jnp.linalg.det(C)) * k + beta * jnp.sum(jnp.dot(C, frame[1]) ** 2)


def softplus(C: Any, frame: Any, beta: Any, k: Any) -> Any:
    """With a derivative of its own."""
    return k * jax.nn.softplus(I4(C, frame) - 1.0)


def loop(C: Any, frame: Any, beta: Any, k: Any) -> Any:
    return jax.lax.fori_loop(0, 3, lambda _, W: W * k * (I1(C) - 3.0), 1.0)


def network(C: Any, frame: Any, beta: Any, k: Any) -> Any:
    x = jnp.concatenate([C.reshape(9), jnp.ones(23)])
    return k * jnp.sum(jnp.tanh(jnp.full((32, 32), 0.01) @ x))


def eigenvalues(C: Any, frame: Any, beta: Any, k: Any) -> Any:
    return k * jnp.sum(jnp.linalg.eigvalsh(C) ** 2)


CONSTANTS = {
    "lin_yin": jm.LinYin(C1p=0.3, C2p=1.2, C3p=-0.4, C4p=0.8, C1a=0.5, C2a=1.1, C3a=0.7, C4a=0.2),
    "guccione": jm.Guccione(C=0.9, bf=2.0, bt=1.0, bfs=0.6),
    "tensors": 0.7,
    "contractions": 0.7,
}

WRITTEN = {
    "lin_yin": energies.lin_yin,
    "guccione": energies.guccione,
    "tensors": of_tensors,
    "contractions": of_contractions,
}


def arguments(constants: Any) -> tuple[Any, ...]:
    """C near rest, frames and activations at some points, and constants that are the same at all or some of them."""
    rng = np.random.default_rng(0)
    H = np.eye(3) + 0.1 * rng.standard_normal((*LANES, 3, 3))
    C = np.moveaxis(np.swapaxes(H, -1, -2) @ H, (-2, -1), (0, 1))
    frame = np.moveaxis(np.linalg.qr(rng.standard_normal((*LANES[:2], 1, 3, 3)))[0], (-2, -1), (0, 1))
    constants = jax.tree.map(lambda x: jnp.full((1, 1, LANES[2]), x), constants)
    return jnp.asarray(C), jnp.asarray(frame), jnp.asarray(rng.uniform(size=(2, 1, 1))), constants


@pytest.mark.parametrize("name", WRITTEN)
def test_derivatives_are_those_of_arrays(name: str) -> None:
    law, args = WRITTEN[name], arguments(CONSTANTS[name])
    program = entries.of_numbers(law, 3, *args)
    assert program is not None
    first = [entries.derivative(program, i) for i in range(9)]
    pairs = [(i, j) for i in range(9) for j in range(i, 9)]
    second = [entries.derivative(first[i], j) for i, j in pairs]
    found = np.array(jax.jit(lambda args: entries.at_lanes([program, *first, *second], 3, *args))(args))
    assert found.shape == (1 + 9 + 45, *LANES)

    def at_point(C: Any, *rest: Any) -> tuple[Any, ...]:
        def of_nine(x: Any) -> Any:
            return law(x.reshape(3, 3), *rest)

        x = C.reshape(9)
        return of_nine(x), jax.jacfwd(of_nine)(x), jax.jacfwd(jax.jacfwd(of_nine))(x)

    W, by_C, by_CC = jax.jit(lambda args: everywhere(at_point, 3, *args))(args)
    for own, exact in ((found[0], W), (found[1:10], by_C), (found[10:], np.array([by_CC[i, j] for i, j in pairs]))):
        np.testing.assert_allclose(own, exact, rtol=0, atol=1e-13 * np.abs(exact).max())


def test_what_is_the_same_is_written_once() -> None:
    """I4 is asked for twice; its derivative by itself does not need what else the law computes."""

    def twice(C: Any, frame: Any, beta: Any, k: Any) -> Any:
        return I4(C, frame) ** 2 + beta * jnp.exp(I4(C, frame))

    def once(C: Any, frame: Any, beta: Any, k: Any) -> Any:
        i4 = I4(C, frame)
        return i4**2 + beta * jnp.exp(i4)

    def linear(C: Any, frame: Any, beta: Any, k: Any) -> Any:
        return k * C[0, 0] + jnp.exp(C[1, 1])

    args = arguments(0.7)
    sizes = [len(entries.of_numbers(law, 3, *args).jaxpr.eqns) for law in (twice, once)]  # type: ignore[union-attr]
    assert sizes[0] == sizes[1]
    program = entries.of_numbers(linear, 3, *args)
    assert program is not None
    assert not any(e.primitive.name == "exp" for e in entries.derivative(program, 0).jaxpr.eqns)


@pytest.mark.parametrize("law", [softplus, loop, network, eigenvalues])
def test_what_cannot_be_written_out(law: Any) -> None:
    assert entries.of_numbers(law, 3, *arguments(0.7)) is None


def test_both_ways_come_to_the_same_body() -> None:
    """A law with a derivative of its own, which is left to arrays, and the same one without."""

    @jax.custom_jvp
    def square(x: Any) -> Any:
        return x**2

    square.defjvp(lambda x, dx: (x[0] ** 2, 2.0 * x[0] * dx[0]))

    def law(square: Any, C: Any, frame: Any, beta: Any, k: Any) -> Any:
        return 0.5 * (I1(C) - 3.0) + k * square(I4(C, frame) - 1.0)

    states = []
    for of_square in (square, lambda x: x**2):
        scene = jm.Scene(jm.box((1.0, 1.0, 1.0), (2, 1, 1)), partial(law, of_square), 0.8, supports=ROLLERS)
        A = jm.contract(scene, T0=0.3, a_over_D=None)
        states.append(jm.load(A, jm.Displacement("x1", "x", 0.1)))
    for own, exact in ((states[0].u, states[1].u), (states[0].p, states[1].p)):
        np.testing.assert_allclose(own, exact, rtol=0, atol=1e-12)
