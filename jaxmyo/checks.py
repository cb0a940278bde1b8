"""Checks at the border: a message names the argument, the value, and what is valid.

Under `jit`, `vmap` and `grad` values are not known while Python runs. There the same limits are applied inside the
computation (`within`), and the solve returns the status INVALID_INPUT for the samples that break them.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from numpy.typing import NDArray

from jaxmyo.tracing import every, floats, is_traced, known, numpy_for

#: Valid closed ranges of the inputs that every scene has.
RANGES = {
    "beta": (0.0, 1.0, "–, the degree of activation"),
    "T0": (0.0, float("inf"), "kPa, the beating tension"),
    "a_over_D": (0.0, 0.25, "–, fibre radius over D = 4a + d; ¼ is where neighbouring cells touch"),
    "stretch": (0.2, 5.0, "–, deformed over reference length"),
    "weave_stiffness": (0.0, float("inf"), "kPa, the stiffness k of the weave; None for the exact constraint"),
}
_OPEN = {"stretch", "weave_stiffness"}  # ranges whose ends are excluded


def concrete(name: str, value: Any, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    """A finite float64 NumPy array of the given shape (None: any length), or an error that names the argument."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} must be numbers of shape {_shape(shape)}; got {value!r}") from error
    if array.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True)):
        raise ValueError(f"{name} must have shape {_shape(shape)}; got {array.shape}")
    if not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise ValueError(f"{name} must be finite; got {array[where]} at index {where}")
    return array


def scalar(name: str, value: ArrayLike, kind: str) -> Array:
    """The value as a float64 scalar inside `RANGES[kind]`; traced values pass and are judged by `within`."""
    if is_traced(value):
        if jnp.ndim(value) != 0:
            raise ValueError(f"{name} must be a scalar; got shape {jnp.shape(value)}. Use jax.vmap for many values.")
        return floats(value)
    return floats(number(name, value, kind))


def number(name: str, value: Any, kind: str) -> float:
    """The value as a number inside `RANGES[kind]`; nothing traced, no JAX."""
    low, high, unit = RANGES[kind]
    if np.ndim(value) != 0:
        raise ValueError(f"{name} must be a scalar; got shape {np.shape(value)}. Use jax.vmap for many values.")
    number = float(concrete(name, value, ()))
    if not (low < number < high if kind in _OPEN else low <= number <= high):
        brackets = "()" if kind in _OPEN else "[]"
        raise ValueError(f"{name} = {number:g} is outside {brackets[0]}{low:g}, {high:g}{brackets[1]} ({unit})")
    return number


def within(value: Any, kind: str) -> Any:
    """The same limits as `scalar`, as a flag that may be traced."""
    low, high, _ = RANGES[kind]
    value = known(value)
    inside = (low < value) & (value < high) if kind in _OPEN else (low <= value) & (value <= high)
    return inside & numpy_for(value).isfinite(value)


def finite_tree(name: str, tree: Any) -> Any:
    """A pytree of finite float64 arrays; the message names the leaf that is not."""

    def check(path: Any, leaf: Any) -> Array:
        if is_traced(leaf):
            return floats(leaf)
        full = name + jax.tree_util.keystr(path)
        try:
            array = np.asarray(leaf, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise TypeError(f"{full} must be a number or an array of numbers; got {leaf!r}") from error
        if not np.isfinite(array).all():
            raise ValueError(f"{full} must be finite; got {leaf}")
        return floats(array)

    return jax.tree_util.tree_map_with_path(check, tree)


def tree_is_finite(tree: Any) -> Any:
    """Whether every number of a pytree is finite, as a flag that may be traced."""
    leaves = jax.tree.leaves(tree)
    return every(True, *(numpy_for(leaf).isfinite(leaf).all() for leaf in leaves))


def finite_or_zero(tree: Any) -> tuple[Any, Any]:
    """A pytree with 0 for every traced number that is not finite, and whether all of the traced ones are finite.

    In a derivative, 0 · NaN would come back.
    """
    traced = [leaf for leaf in jax.tree.leaves(tree) if is_traced(leaf)]
    if not traced:
        return tree, np.True_
    clean = jax.tree.map(lambda x: jnp.where(jnp.isfinite(x), x, 0.0) if is_traced(x) else x, tree)
    return clean, tree_is_finite(traced)


def counts(name: str, value: Any, n: int) -> tuple[int, ...]:
    """n integers ≥ 1, or an error that names the argument."""
    if np.shape(value) != (n,) or any(int(v) != v or v < 1 for v in value):
        raise ValueError(f"{name} = {value} must be {n} integers ≥ 1")
    return tuple(int(v) for v in value)


def same_structure(a: Any, b: Any) -> bool:
    """Whether two pytrees have the same structure, static fields included."""
    return bool(jax.tree.structure(a) == jax.tree.structure(b))  # type: ignore[operator]


def choice(name: str, value: str, valid: list[str]) -> str:
    """The value, if it is one of the valid names."""
    if not isinstance(value, str) or value not in valid:
        raise ValueError(f"{name} = {value!r} is unknown; valid: {', '.join(map(repr, valid))}")
    return value


def missing(error: ModuleNotFoundError, what_needs: str, install: str) -> ModuleNotFoundError:
    """The error for an optional package that is not there: who needs it, and how pip installs it."""
    message = f"{what_needs} {error.name}, which is not installed: pip install {install}"
    return ModuleNotFoundError(message, name=error.name)


def _shape(shape: tuple[int | None, ...]) -> str:
    return str(tuple("n" if n is None else n for n in shape)).replace("'", "") if shape else "() (a scalar)"
