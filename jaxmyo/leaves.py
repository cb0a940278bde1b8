"""Some of the leaves of a tree, by their positions."""

from collections.abc import Sequence
from typing import Any

import jax


def pick(tree: Any, at: Sequence[int]) -> list[Any]:
    """The leaves at these positions."""
    every = jax.tree.leaves(tree)
    return [every[i] for i in at]


def put(tree: Any, at: Sequence[int], values: Sequence[Any]) -> Any:
    """The tree with other leaves at these positions."""
    leaves, structure = jax.tree.flatten(tree)
    for i, value in zip(at, values, strict=True):
        leaves[i] = value
    return jax.tree.unflatten(structure, leaves)


def true(tree: Any) -> tuple[int, ...]:
    """The positions of the leaves that are true."""
    return tuple(i for i, leaf in enumerate(jax.tree.leaves(tree)) if leaf)
