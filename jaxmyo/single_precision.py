"""The path of a small body in float32: half the memory and less time, and, with "mixed", the accuracy of float64.

A state in float32 has five to six digits where the body is well-conditioned, fewer in thin walls and near limit points
(`jaxmyo tradeoff` measures it). Its residual is computed in float64 all the same, so that the state tells its error.
"mixed" corrects that state in float64; where float32 did not get through, the path goes on in float64.
"""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from jaxmyo import continuation
from jaxmyo.continuation import Route, Solution
from jaxmyo.linear import Dense
from jaxmyo.newton import NUMBERS, Settings
from jaxmyo.status import Status

#: The relative residual that a path in float32 aims at, unless `Settings.tolerance` is larger [–].
TOLERANCE = 1e-5


def follow(exact: Dense, z: Array, route: Route, settings: Settings) -> tuple[Solution, Array]:
    """As `continuation.follow` with `Dense`, inside `jit`; settings.precision is "float32" or "mixed"."""
    rough = _in_float32(exact, z, route, settings)
    begin = route.moving_at(jnp, rough.reached)
    if settings.precision == "float32":
        at = exact.at(rough.z, route.inputs(begin))
        negative, zero = exact.inertia(at, rough.z)
        known: dict[str, Any] = {
            "negative": jnp.where(route.valid, negative, -1),
            "zero": jnp.where(route.valid, zero, -1),
        }
        force = jnp.max(jnp.abs(at.r[: exact.system.n_u]), initial=0.0)
        known |= {"residual": at.residual, "force_residual": force, "constraint_residual": at.violation}
        return rough._replace(inputs=route.inputs(begin), **known), at.K
    # A start that is not known in float32, such as one with constants of 1e40, is left to float64 alone.
    usable = jnp.all(jnp.isfinite(rough.z)) & (rough.steps > rough.rejected)
    z, begin = jax.tree.map(lambda a, b: jnp.where(usable, a, b), (rough.z, begin), (z, route.start))
    route = replace(route, start=begin, from_rest=route.from_rest & ~usable)
    s, K = continuation.follow(exact, z, route, settings)
    reached = jnp.where(usable, rough.reached, 0.0)
    first = jnp.where(usable, rough.stable_until, 1.0)
    then = jnp.where(s.stable_until >= 1.0, 1.0, reached + (1.0 - reached) * s.stable_until)
    reached = jnp.where(s.status == Status.CONVERGED, 1.0, reached + (1.0 - reached) * s.reached)
    spent: Any = {name: getattr(rough, name) + getattr(s, name) for name in ("steps", "rejected", "iterations")}
    return s._replace(reached=reached, stable_until=jnp.where(first < 1.0, first, then), **spent), K


def _in_float32(exact: Dense, z: Array, route: Route, settings: Settings) -> Solution:
    """The solution with all arithmetic in float32; its numbers are of JAX's float64 and int64 again."""
    numbers: dict[str, Any] = {name: jnp.asarray(getattr(settings, name)) for name in NUMBERS}
    for name in ("tolerance", "path_tolerance"):
        numbers[name] = jnp.maximum(numbers[name], TOLERANCE)
    numbers = jax.tree.map(_narrow, numbers)
    lin, z, route = jax.tree.map(_narrow, (exact, z, route))
    with jax.enable_x64(False):
        solution, _ = continuation.follow(lin, z, route, settings._replace(**numbers))
    return jax.tree.map(_wide, solution)


def _narrow(x: Any) -> Array:
    """In float32 or int32; a number out of the range of float32 becomes infinite."""
    narrow = {"f": "float32", "i": "int32"}.get(x.dtype.kind, x.dtype)
    return jax.lax.convert_element_type(x, narrow)


def _wide(x: Array) -> Array:
    wide = {"f": "float64", "i": "int64"}.get(x.dtype.kind, x.dtype)
    return jax.lax.convert_element_type(x, wide)
