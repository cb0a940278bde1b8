"""What several test files share: scenes, and batched solves that are compiled once per session."""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxmyo as jm

#: Every batched solve is padded to this many samples, so that each kind of scene is compiled once.
BATCH = 200

Elements = tuple[int, int, int] | None


@cache
def sample(elements: Elements = None, distortion: float = 0.0) -> jm.Scene:
    """The thin sample, one scene object per kind."""
    return jm.thin_sample(elements=elements, distortion=distortion)


class Fields(NamedTuple):
    """Fields of a batch of states; first axis: the sample."""

    u: Any
    p: Any
    q: Any
    T_f: Any
    T_cf: Any
    cauchy: Any
    stretches: Any
    status: Any
    reached: Any
    residual: Any
    force_residual: Any
    constraint_residual: Any
    negative_eigenvalues: Any


def fields(state: jm.State) -> Fields:
    """The fields of one state."""
    q = jnp.zeros_like(state.p) if state.q is None else state.q
    return Fields(
        state.u,
        state.p,
        q,
        state.T_f,
        state.T_cf,
        state.cauchy,
        state.stretches,
        state.status,
        state.reached,
        state.residual,
        state.force_residual,
        state.constraint_residual,
        state.negative_eigenvalues,
    )


@cache
def _biaxial(elements: Elements, weave: bool) -> Callable[..., tuple[Fields, Fields]]:
    scene = sample(elements)

    def one(T0: Any, a_over_D: Any, beta: Any, l1: Any, l2: Any, constants: Any) -> tuple[Fields, Fields]:
        a = jm.contract(scene, T0=T0, a_over_D=a_over_D if weave else None, beta=beta, constants=constants)
        c = jm.load(a, jm.Stretch("x", l1), jm.Stretch("y", l2))
        return fields(a), fields(c)

    return jax.jit(jax.vmap(one, in_axes=(0, 0, 0, 0, 0, None)))


def biaxial(
    elements: Elements, weave: bool, T0: Any, a_over_D: Any, beta: Any, l1: Any, l2: Any, constants: Any = jm.TABLE1
) -> tuple[Fields, Fields]:
    """State A and state C at prescribed in-plane stretches, for arrays of inputs; constants are common to all."""
    inputs = [np.asarray(v, dtype=float) for v in (T0, a_over_D, beta, l1, l2)]
    n = max(v.size for v in inputs)
    assert n <= BATCH
    padded = [np.resize(np.broadcast_to(v, n), BATCH) for v in inputs]
    a, c = jax.tree.map(np.asarray, _biaxial(elements, weave)(*padded, constants))
    return Fields(*(v[:n] for v in a)), Fields(*(v[:n] for v in c))
