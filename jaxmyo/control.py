"""Loops and choices that run inside JAX where values are traced, and in plain Python where they are not.

The solves are written once. A small body runs as one compiled program, also under `vmap`; a large one, whose sparse
factors live outside JAX, runs the same code step by step.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxmyo.tracing import is_traced

T = TypeVar("T")


def loop(keep_going: Callable[[T], Array], step: Callable[[T], T], start: T) -> T:
    """`while keep_going(state): state = step(state)`."""
    if is_traced(start):
        return jax.lax.while_loop(keep_going, step, start)
    with np.errstate(all="ignore"):  # as inside JAX: what is not finite is found and refused
        while bool(keep_going(start)):
            start = step(start)
    return start


def choose(condition: Any, new: Callable[[], T], old: Callable[[], T]) -> T:
    """`new() if condition else old()`; both are computed where the condition is traced."""
    if is_traced(condition):
        return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new(), old())
    return new() if bool(condition) else old()


def put(x: Any, i: Any, value: Any) -> Any:
    """A copy of x with x[i] = value."""
    if isinstance(x, Array):
        return jnp.where(jnp.arange(len(x)) == i, value, x)  # in a batch, x.at[i] is a loop over its samples
    x = x.copy()
    x[i] = value
    return x
