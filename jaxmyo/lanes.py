"""Arithmetic on many small arrays at once: their batches are the last axes, the *lanes*.

XLA makes vector loops of operations on rows of lanes. Left to itself, `vmap` puts the batch first, and what are then
small matrices, one after the other, take up to ten times as long.
"""

import operator
from collections.abc import Callable, Iterator
from functools import reduce
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.experimental.layout import Layout, with_layout_constraint


def batch_last(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function of arrays with any number of lanes, such that `vmap` makes a batch one more axis of lanes.

    Along it, arrays that are the same in all of the batch have the length 1.
    """

    def run(*args: Any) -> Any:
        # A rule of `vmap` runs later, when the arithmetic of a path in float32 may have ended.
        wide = jnp.result_type(float) == "float64"
        of_lanes = jax.custom_batching.custom_vmap(function)

        @of_lanes.def_vmap
        def batched(size: int, is_batched: Any, *args: Any) -> tuple[Any, Any]:
            def last(x: Array, batched: bool) -> Array:
                return jnp.moveaxis(x, 0, -1) if batched else x[..., None]

            with jax.enable_x64(wide):
                found = of_lanes(*jax.tree.map(last, args, tuple(is_batched)))
                found = jax.tree.map(lambda x: jnp.moveaxis(x, -1, 0), found)
            return found, jax.tree.map(lambda x: True, found)

        return of_lanes(*args)

    return run


def everywhere(function: Callable[..., Any], lanes: int, *args: Any) -> Any:
    """A function without lanes, at all of them; args: (..., *lanes), with as many axes of lanes."""
    leaves, structure = jax.tree.flatten(args)
    sizes = [x.shape[x.ndim - lanes :] for x in leaves]
    every = jnp.broadcast_shapes(*sizes)
    leaves = [
        x.reshape(*x.shape[: x.ndim - lanes], *(n for n in own if n > 1)) for x, own in zip(leaves, sizes, strict=True)
    ]

    def mapped(*leaves: Any) -> Any:
        return function(*jax.tree.unflatten(structure, leaves))

    for axis, n in enumerate(every):
        if n > 1:
            mapped = jax.vmap(mapped, in_axes=tuple(-1 if own[axis] > 1 else None for own in sizes), out_axes=-1)
    long = sum(n > 1 for n in every)
    return jax.tree.map(lambda x: rows(x.reshape(*x.shape[: x.ndim - long], *every)), mapped(*leaves))


def total(terms: Iterator[Array]) -> Array:
    """The sum of some terms, in one loop over its entries."""
    return reduce(operator.add, terms)


def once(x: Array) -> Array:
    """x, computed once: XLA would compute it anew in each loop that needs it."""
    return rows(jax.lax.optimization_barrier(x))


def rows(x: Array) -> Array:
    """x, in memory as its axes say: what `vmap` made may have its last axis first there."""
    return with_layout_constraint(x, Layout(tuple(range(x.ndim))))


def constant(x: np.ndarray, lanes: int) -> np.ndarray:
    """x with axes for lanes."""
    return x.reshape(*x.shape, *(1,) * lanes)
