"""Residual and tangent of a small body, all of its elements at once, and those of a batch of such bodies.

The element is that of `jaxmyo.lagrangian`. Under `vmap` the bodies of a batch are one more axis of lanes, the last, see
`jaxmyo.lanes`: an operation on a matrix of one point becomes a loop over bodies.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxmyo import lagrangian, points
from jaxmyo.lanes import batch_last, once, total
from jaxmyo.leaves import pick, put, true
from jaxmyo.points import Place
from jaxmyo.system import Inputs, System


class Linearised(NamedTuple):
    """The residual r (n,), its derivative K (n, n), and the smallest det F, −1 where a coordinate left its range."""

    r: Array
    K: Array
    least_J: Array


class _Elements(NamedTuple):
    """Displacements, multipliers and geometry of elements, in lanes (points of an element, elements[, bodies]).

    Indices: i displacements; k their derivatives, and the value as k = 3 in curved coordinates; a nodes; b unknowns.
    nodes: (i, a, 1, e); m: (multipliers, 1, e); columns: (k, b, g, e); dN: (a, k, g, e); N: (a, g, e); theta,
    inverse_g: (i, g, e); weight: (g, e); local: (b and multipliers, e), positions among the unknowns of the body.
    """

    nodes: Array
    m: Array
    columns: Array
    dN: Array
    N: Array
    theta: Array
    inverse_g: Array
    weight: Array
    place: Place
    local: Array


def linearised(system: System, z: Array, inputs: Inputs) -> Linearised:
    """Residual and tangent at z."""

    def of_elements(e: _Elements) -> Linearised:
        r_e, K_e, J = _terms(system, e)
        return Linearised(_assembled(system, e, r_e), _assembled(system, e, K_e), jnp.min(J, axis=(0, 1)))

    at = batch_last(of_elements)(_elements(system, z, inputs))
    r, K = lagrangian.add_loads(system, z, inputs, at.r - inputs.imbalance, at.K)
    return Linearised(r, K, at.least_J)


def residual_and_tangent(system: System, z: Array, inputs: Inputs) -> tuple[Array, Array]:
    """The residual (n,) and its derivative (n, n), dense."""
    at = linearised(system, z, inputs)
    return at.r, at.K


def rate(system: System, z: Array, inputs: Inputs, by_t: Inputs) -> Array:
    """The change (n,) of the residual with the inputs, at the same z; with none of those that are 0.0 in by_t."""
    moves = jax.tree.map(lambda dx: type(dx) is not float, by_t)
    by_t = jax.tree.map(lambda x, dx: jnp.broadcast_to(jnp.asarray(dx, x.dtype), x.shape), inputs, by_t)
    of_density = moves._replace(T_f=False, T_cf=False, offset=False, loads={}, volumes=False, imbalance=False)
    in_elements, moving = true((moves.offset, moves.T_f, moves.T_cf, of_density)), true(moves)

    def driven(e: _Elements) -> Any:
        """What the inputs change in elements; it is linear in them."""
        return e.nodes, e.place.T_f, e.place.T_cf, e.place.inputs

    def alike(a: Array, b: Array) -> Array:
        return jnp.broadcast_to(a, jnp.broadcast_shapes(a.shape, b.shape))

    def of_elements(e: _Elements, changes: list[Array]) -> Array:
        def forces(values: list[Array]) -> Array:
            nodes, T_f, T_cf, inputs = put(driven(e), in_elements, values)
            return _forces(system, e._replace(nodes=nodes, place=e.place._replace(T_f=T_f, T_cf=T_cf, inputs=inputs)))

        values = pick(driven(e), in_elements)
        # One of the two may be the same in all bodies.
        values, changes = list(map(alike, values, changes)), list(map(alike, changes, values))
        return _assembled(system, e, jax.jvp(forces, (values,), (changes,))[1])

    # The elements differentiate inside of `batch_last`: their geometry does not change.
    changes = pick(driven(_elements(system, jnp.zeros_like(z), by_t)), in_elements)
    dr = batch_last(of_elements)(_elements(system, z, inputs), changes) - by_t.imbalance

    def loads(values: list[Array]) -> Array:
        return lagrangian.add_loads(system, z, put(inputs, moving, values), jnp.zeros(system.size), None)[0]

    return dr + jax.jvp(loads, (pick(inputs, moving),), (pick(by_t, moving),))[1]


def _elements(system: System, z: Array, inputs: Inputs) -> _Elements:
    assert system.columns is not None
    assert system.local_u is not None
    n_e, n_g = system.weight.shape
    size = points.together(n_g)
    parts = n_g // size  # of an element, each an element of its own

    def in_lanes(x: Array) -> Array:
        """(n_elements, n_points, ...) → (..., size, elements)."""
        x = x.reshape(n_e * parts, size, *x.shape[2:])
        return once(jnp.moveaxis(x, (1, 0), (-2, -1)))

    def of_each(x: Array) -> Array:
        """(n_elements, ...) → (..., 1, elements)."""
        return jnp.moveaxis(jnp.repeat(x, parts, axis=0), 0, -1)[..., None, :]

    nodes = system.displacements(z, inputs)[system.cells]
    place = Place(
        in_lanes(system.frame),
        in_lanes(inputs.T_f),
        in_lanes(inputs.T_cf),
        of_each(system.material),
        points.with_lanes(inputs, 2),
    )
    return _Elements(
        nodes=of_each(nodes.swapaxes(1, 2)),
        m=of_each(z[system.local_multipliers]),
        columns=in_lanes(system.columns),
        dN=in_lanes(system.dN),
        N=in_lanes(jnp.broadcast_to(system.N[None], (n_e, *system.N.shape))),
        theta=in_lanes(system.theta),
        inverse_g=in_lanes(system.inverse_g),
        weight=in_lanes(system.weight),
        place=place,
        local=jnp.repeat(jnp.concatenate([system.local_u, system.local_multipliers], axis=1), parts, axis=0).T,
    )


def _assembled(system: System, e: _Elements, x: Array) -> Array:
    """The sum (n,) or (n, n)[, bodies] of what elements have, (unknowns, e) or (unknowns, unknowns, e)[, bodies]."""
    if system.whole:  # a scatter is a loop over the unknowns
        axes = x.ndim - e.local.ndim + 1
        whole = jnp.sum(x, axis=axes)
        beyond = system.size - len(whole)
        return jnp.pad(whole, [(0, beyond)] * axes + [(0, 0)] * (whole.ndim - axes)) if beyond else whole
    local = e.local.reshape(e.local.shape[:2])  # the same in all bodies
    bodies = x.shape[-(e.local.ndim - 2) :] if e.local.ndim > 2 else ()
    axes = x.ndim - len(bodies) - 1
    index = (local,) if axes == 1 else (local[:, None], local[None])
    return jnp.zeros((*(system.size,) * axes, *bodies)).at[index].add(x)


def _at(system: System, e: _Elements) -> tuple[points.Points, Array]:
    at = points.at(system.coordinates, e.nodes, e.dN, e.N, e.theta, e.inverse_g)
    return at, points.strain(at, e.m)


def _forces(system: System, e: _Elements) -> Array:
    """The derivatives (unknowns, e) of the Lagrangian."""
    at, c = _at(system, e)
    by_c = points.by_c(system, c, e.place, e.weight)
    return _first(system, e, points.by_y(at, by_c), by_c)


def _first(system: System, e: _Elements, by_y: Array, by_c: Array) -> Array:
    n_k, n_g = by_y.shape[1], e.columns.shape[2]
    each = [(k, g) for k in range(n_k) for g in range(n_g)]
    by_u = [total(e.columns[k, own, g] * by_y[i, k, g][None] for k, g in each) for i, own in _slots(system)]
    return jnp.concatenate([once(jnp.concatenate(by_u)), total(by_c[6:, g] for g in range(n_g))])


def _slots(system: System) -> list[tuple[int, slice]]:
    """The components, and which of an element's unknowns move each."""
    ends = np.cumsum(system.slots)
    return [(i, slice(end - n, end)) for i, (end, n) in enumerate(zip(ends, system.slots, strict=True))]


def _terms(system: System, e: _Elements) -> tuple[Array, Array, Array]:
    """The first (unknowns, e) and second (unknowns, unknowns, e) derivatives, and det F."""
    at, c = _at(system, e)
    by_c, by_cc = points.by_c_twice(system, c, e.place, e.weight)
    by_y, by_yy, by_ym = points.by_y_twice(system.coordinates, at, by_c, by_cc)
    n_k, n_g = by_y.shape[1], e.columns.shape[2]
    slots = _slots(system)
    each = [(k, g) for k in range(n_k) for g in range(n_g)]

    def half_of(i: int, own: slice) -> Array:  # i k b
        return total(by_yy[:, :, i, k, None] * e.columns[None, None, k, own] for k in range(n_k))

    half = once(jnp.concatenate([half_of(i, own) for i, own in slots], axis=2))
    with_m = jnp.concatenate([half, by_ym], axis=2)
    rows = [once(total(e.columns[k, own, None, g] * with_m[i, k, None, :, g] for k, g in each)) for i, own in slots]
    upper = jnp.concatenate(rows)
    of_pair = points.pair(len(c))
    by_mm = total(by_cc[:, g][of_pair[6:, 6:]] for g in range(n_g))
    n_u = len(upper)
    lower = jnp.concatenate([jnp.swapaxes(upper[:, n_u:], 0, 1), by_mm], axis=1)
    return _first(system, e, by_y, by_c), jnp.concatenate([upper, lower]), points.least_J(system.coordinates, at)
