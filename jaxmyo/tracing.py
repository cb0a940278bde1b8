"""What is known while Python runs, and what only inside a transformation of JAX.

Of what is known, arrays and flags are made by NumPy: outside of a transformation JAX compiles each of its operations,
for every shape and type, which takes 20 to 50 ms.
"""

from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

T = TypeVar("T")


def is_traced(value: Any) -> bool:
    """Whether the value, or a leaf of it, is only known inside a JAX transformation."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(value))


def is_staged(tree: Any) -> bool:
    """Whether a leaf is unknown while Python runs, as inside jit and vmap, not only carried along by a derivative."""
    seen: list[Any] = []

    @jax.custom_jvp
    def look(*leaves: Any) -> Any:
        seen.append(is_traced(leaves))  # a function with a rule of its own is called with the values
        return leaves

    look.defjvp(lambda primals, tangents: (look(*primals), tangents))
    traced = [leaf for leaf in jax.tree.leaves(tree) if is_traced(leaf)]
    if traced:
        look(*traced)
    return any(seen)


def numpy_for(*values: Any) -> Any:
    """`jax.numpy` where one of the values is traced, otherwise `numpy`."""
    return jnp if is_traced(values) else np


def known(value: Any) -> Any:
    """The value, in NumPy unless it is traced."""
    return value if is_traced(value) else np.asarray(value)


def array(value: Any) -> Array:
    """The value as an array of JAX."""
    return value if is_traced(value) else jax.device_put(value)


def floats(value: Any) -> Array:
    """The value as an array of float64."""
    return jnp.asarray(value, dtype=float) if is_traced(value) else array(np.asarray(value, dtype=np.float64))


def on_device(tree: T) -> T:
    """The tree as arrays of JAX: in one call, unless some leaves are traced, whose batches JAX wants along one axis."""
    return jax.tree.map(jax.device_put, tree) if is_traced(tree) else jax.device_put(tree)


def zeros(*shape: int) -> Array:
    """Zeros of float64."""
    return jax.device_put(np.zeros(shape))


def every(*flags: Any) -> Any:
    """Whether all of some flags are true."""
    xp = numpy_for(flags)
    return xp.all(xp.stack([known(flag) for flag in flags]))
