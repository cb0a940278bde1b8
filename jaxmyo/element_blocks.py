"""Residual and tangent of a block of elements at once, for large bodies; the element is that of `jaxmyo.lagrangian`.

The last axis of every array is the elements of the block, the one before it their points, see `jaxmyo.lanes`.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxmyo import points
from jaxmyo.lanes import once, total
from jaxmyo.pattern import UPPER
from jaxmyo.points import Place, Points
from jaxmyo.system import Inputs, System

_I, _J = UPPER
#: The nodes of the rows of the tangent that are computed together: of its columns, only those of these and later nodes.
_ROWS = 4


def _places() -> NDArray[np.int64]:
    """Where the entries `UPPER` are among those that are computed: of each group of rows, a i j b."""
    places: NDArray[np.int64] = np.zeros((8, 3, 3, 8), dtype=int)
    count = 0
    for a in range(0, 8, _ROWS):
        shape = (_ROWS, 3, 3, 8 - a)
        places[a : a + _ROWS, :, :, a:] = count + np.arange(np.prod(shape)).reshape(shape)
        count += int(np.prod(shape))
    return places[_I // 3, _I % 3, _J % 3, _J // 3]


_PLACES = _places()


class Elements(NamedTuple):
    """What is known of a block of N elements, see `System`.

    cells: (8, N); dN: (8, 3, n_points, N); weight: (n_points, N); frame: (3, 3, n_points, N); theta, inverse_g:
    (3, n_points, N); material: (N,); scale: (24, N) of the ties of the nodal displacements.
    """

    cells: Array
    dN: Array
    weight: Array
    frame: Array
    theta: Array
    inverse_g: Array
    material: Array
    scale: Array


class Terms(NamedTuple):
    """The terms of a block of N elements; in NumPy once they are done.

    r: (24, N) forces; K: (300, N) upper triangle of the tangent, rows first, with the augmentation; B: (24,
    multipliers, N) its coupling with p and q; D: (multipliers, N) second derivative by them; r_m: (multipliers, N)
    residual; least_J: the smallest det F.
    """

    r: Any
    K: Any
    B: Any
    D: Any
    r_m: Any
    least_J: Any


def terms(
    system: System, e: Elements, u: Array, m: Array, inputs: Inputs, gamma: Array, inside: tuple[bool, ...]
) -> Terms:
    """The terms of a block. u: (n_nodes, 3); m: (multipliers, N); inputs: with the tensions (n_points, N) of the block.

    inside: the multipliers whose augmentation BᵀWB, W = 1 / (V/γ − D), is added to K.
    """
    r, K, B, D, r_m, least_J = _of_groups(partial(_of_points, u=u, m=m), system, e, inputs)
    K = K[_PLACES] * (e.scale[_I] * e.scale[_J])
    B = once(B * e.scale[:, None])
    for n in range(system.multipliers):
        if inside[n]:
            K = K + B[_I, n] * (B[:, n] / (jnp.sum(e.weight, axis=0) / gamma - D[n])[None])[_J]
    return Terms(e.scale * r, K, B, D, r_m, least_J)


def forces(system: System, e: Elements, u: Array, m: Array, inputs: Inputs) -> tuple[Array, Array, Array]:
    """r (24, N), r_m (multipliers, N) and least_J of `terms` alone."""
    r, r_m, least_J = _of_groups(partial(_first_of_points, u=u, m=m), system, e, inputs)
    return e.scale * r, r_m, least_J


def _of_groups(of_points: Callable[..., Any], system: System, e: Elements, inputs: Inputs) -> Any:
    """The sums over the Gauss points, some at a time, of what a function finds; of the last one, the minimum."""
    n_points = e.weight.shape[0]
    size = points.together(n_points)
    if size == n_points:
        return of_points(system, e, inputs)

    def split(x: Array) -> Array:
        return jnp.moveaxis(x.reshape(*x.shape[:-2], -1, size, x.shape[-1]), -3, 0)

    names = ("dN", "weight", "frame", "theta", "inverse_g")
    groups = (
        {k: split(getattr(e, k)) for k in names},
        system.N.reshape(-1, size, 8),
        split(inputs.T_f),
        split(inputs.T_cf),
    )

    def group(at: Any) -> Any:
        of_e, N, T_f, T_cf = at
        return of_points(replace(system, N=N), e._replace(**of_e), inputs._replace(T_f=T_f, T_cf=T_cf))

    *sums, least = jax.lax.map(group, groups)
    return (*(jnp.sum(x, axis=0) for x in sums), jnp.min(least))


def _of_points(system: System, e: Elements, inputs: Inputs, u: Array, m: Array) -> tuple[Array, ...]:
    """Sums over the points for a block: r (24, N), K of `_PLACES`, B (24, multipliers, N), D, r_m, least_J.

    Indices: i, j displacements; k, l their derivatives; a, b nodes; g points; N elements.
    """
    at, c, place = _at(system, e, inputs, u, m)
    by_c, by_cc = points.by_c_twice(system, c, place, e.weight)
    by_y, by_yy, by_ym = points.by_y_twice(system.coordinates, at, by_c, by_cc)
    G = _gradients(system, e)
    of, each = range(G.shape[1]), range(G.shape[2])
    half = once(total(by_yy[:, :, :, n, None] * G[None, None, None, :, n] for n in of))  # i k j b g N

    def of_rows(a: int) -> Array:
        rows, columns = G[a : a + _ROWS], half[:, :, :, a:]
        return once(total(rows[:, None, n, None, None, g] * columns[None, :, n, :, :, g] for n in of for g in each))

    K = once(jnp.concatenate([of_rows(a).reshape(-1, half.shape[-1]) for a in range(0, 8, _ROWS)]))
    B = once(total(G[:, None, n, None, g] * by_ym[None, :, n, :, g] for n in of for g in each))
    D = jnp.sum(by_cc[np.diagonal(points.pair(len(c)))[6:]], axis=1)
    r, r_m = _at_nodes(system, e, by_y), jnp.sum(by_c[6:], axis=1)
    J = jnp.min(points.least_J(system.coordinates, at))
    return r, K, B.reshape(24, *B.shape[2:]), D, r_m, J


def _first_of_points(system: System, e: Elements, inputs: Inputs, u: Array, m: Array) -> tuple[Array, ...]:
    """Sums over the points for a block: r (24, N), r_m (multipliers, N), and least_J."""
    at, c, place = _at(system, e, inputs, u, m)
    by_c = points.by_c(system, c, place, e.weight)
    J = jnp.min(points.least_J(system.coordinates, at))
    return _at_nodes(system, e, points.by_y(at, by_c)), jnp.sum(by_c[6:], axis=1), J


def _at(system: System, e: Elements, inputs: Inputs, u: Array, m: Array) -> tuple[Points, Array, Place]:
    """The Gauss points of a block, c there, and the place of each."""
    nodes = u.T[:, e.cells][:, :, None]
    at = points.at(system.coordinates, nodes, e.dN, system.N.T[:, :, None], e.theta, e.inverse_g)
    place = Place(e.frame, inputs.T_f, inputs.T_cf, e.material[None], points.with_lanes(inputs, 2))
    return at, points.strain(at, m[:, None]), place


def _gradients(system: System, e: Elements) -> Array:
    """∂H_ik/∂(displacement i of node a), and as k = 3 that of θ_i: (8, 3 or 4, n_points, N)."""
    if not system.coordinates.curved:
        return e.dN
    N = jnp.broadcast_to(system.N.T[:, None, :, None], (8, 1, *e.weight.shape))
    return once(jnp.concatenate([e.dN, N], axis=1))


def _at_nodes(system: System, e: Elements, by_y: Array) -> Array:
    """The forces (24, N) by what the points have."""
    G = _gradients(system, e)
    of_nodes = total(G[:, None, k, g] * by_y[None, :, k, g] for k in range(G.shape[1]) for g in range(G.shape[2]))
    return of_nodes.reshape(24, -1)
