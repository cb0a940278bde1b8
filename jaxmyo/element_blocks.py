"""Residual and tangent of a block of elements at once, for large bodies; the element is that of `jaxmyo.lagrangian`.

    nodes ─► H, θ ─► F ─► C ─► density(C, p, q) ─► ∂, ∂² by automatic differentiation ─► by F ─► by H, θ ─► by nodes

The last axis of every array is the elements of the block, or the Gauss points of all of them, and what is done with
their 3 × 3 matrices is written as sums of products of such rows: XLA makes vector loops of them, while products of many
small matrices take several times as long.
"""

import operator
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial, reduce
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.experimental.layout import Layout, with_layout_constraint

from jaxmyo.lagrangian import density
from jaxmyo.pattern import UPPER
from jaxmyo.system import Inputs, System

_I, _J = UPPER
#: Which of the components 11, 22, 33, 12, 13, 23 of C stands where in the tensor, and the indices of each.
_VOIGT = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
_COMPONENTS = np.array([[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
#: ∂C_11 = 2 F_i1 ∂F_i1, but ∂C_12 = F_i1 ∂F_i2 + F_i2 ∂F_i1.
_TWICE = 1.0 + np.eye(3)


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


class _Points(NamedTuple):
    """The P = n_points · N Gauss points.

    F: (3, 3, P); in curved coordinates also H (3, 3, P), θ (3, P), g(θ) (3, P) and ∂g/∂θ (3, 3, P).
    """

    F: Array
    H: Any = None
    theta: Any = None
    g: Any = None
    by_g: Any = None


def terms(
    system: System, e: Elements, u: Array, m: Array, inputs: Inputs, gamma: Array, inside: tuple[bool, ...]
) -> Terms:
    """The terms of a block. u: (n_nodes, 3); m: (multipliers, N); inputs: with the tensions (n_points, N) of the block.

    inside: the multipliers whose augmentation BᵀWB, W = 1 / (V/γ − D), is added to K.
    """
    r, K, B, D, r_m, least_J = _of_groups(partial(_of_points, u=u, m=m), system, e, inputs)
    K = K[8 * (3 * _I + _J % 3) + _J // 3] * (e.scale[_I] * e.scale[_J])
    B = _separate(B * e.scale[:, None])
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
    size = max(k for k in range(1, 10) if n_points % k == 0)  # the sums over them are written out
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
    """Sums over the points for a block: r (24, N), K (576, N) of a i j b, B (24, multipliers, N), D, r_m, least_J.

    Indices: i, j displacements; k, l their derivatives; a, b nodes; g points; N elements.
    """
    at, c, place = _points(system, e, u, m, inputs)
    first = _derivative(system, inputs)
    both = jax.vmap(lambda *at: (first(*at), jax.jacfwd(first)(*at)), in_axes=-1, out_axes=-1)
    weight = e.weight.reshape(-1)
    twice = _TWICE[:, :, None] * weight[None, None]
    by_c, by_cc = both(c, *place)
    by_c, by_cc = _separate(by_c) * weight[None], _separate(by_cc)
    S = _separate(by_c[_VOIGT] * _TWICE[:, :, None])
    by_F = _sum(at.F[:, k, None] * S[None, k] for k in range(3))
    # By the components of C and F, then twice by F, in which C is quadratic.
    by_cF = _separate(by_cc[:, _VOIGT] * twice[None])
    by_cF = _separate(_sum(by_cF[:, k, None] * at.F[None, :, k, None] for k in range(3)))
    by_CF = _separate(by_cF[_VOIGT] * _TWICE[:, :, None, None, None])
    by_FF = _sum(at.F[:, k, None, None, None] * by_CF[None, k] for k in range(3))
    by_FF = _separate(by_FF + np.eye(3)[:, None, :, None, None] * S[None, :, None])
    by_Cm = _separate(by_cc[:, 6:][_VOIGT] * twice[:, :, None])
    by_Fm = _sum(at.F[:, k, None, None] * by_Cm[None, k] for k in range(3))
    by_yy, by_ym = _second(system, at, by_F, by_FF, by_Fm)

    shape = e.weight.shape
    points, multipliers = range(shape[0]), range(system.multipliers)
    G = _gradients(system, e)  # a k g N
    of = range(G.shape[1])
    M = by_yy.reshape(*by_yy.shape[:-1], *shape)  # i k j l g N
    half = _separate(_sum(M[:, :, :, n, None] * G[None, None, None, :, n] for n in of))  # i k j b g N
    K = _separate(_sum(G[:, None, None, None, n, g] * half[None, :, n, :, :, g] for n in of for g in points))
    M_m = by_ym.reshape(*by_ym.shape[:-1], *shape)  # i k m g N
    B = _separate(_sum(G[:, None, n, None, g] * M_m[None, :, n, :, g] for n in of for g in points))
    D = jnp.stack([jnp.sum((weight * by_cc[6 + n, 6 + n]).reshape(shape), axis=0) for n in multipliers])
    r = _at_nodes(system, e, _first(at, by_F))
    return r, K.reshape(576, -1), B.reshape(24, *B.shape[2:]), D, _of_multipliers(by_c, e), _least_J(system, at)


def _first_of_points(system: System, e: Elements, inputs: Inputs, u: Array, m: Array) -> tuple[Array, ...]:
    """Sums over the points for a block: r (24, N), r_m (multipliers, N), and least_J."""
    at, c, place = _points(system, e, u, m, inputs)
    by_c = _rows(jax.vmap(_derivative(system, inputs), in_axes=-1, out_axes=-1)(c, *place)) * e.weight.reshape(1, -1)
    S = by_c[_VOIGT] * _TWICE[:, :, None]
    by_F = _sum(at.F[:, k, None] * S[None, k] for k in range(3))
    return _at_nodes(system, e, _first(at, by_F)), _of_multipliers(by_c, e), _least_J(system, at)


def _points(system: System, e: Elements, u: Array, m: Array, inputs: Inputs) -> tuple[_Points, Array, tuple[Any, ...]]:
    """The Gauss points, c (6 + multipliers, P) there, and the place: frame, tensions and material of each."""
    nodes = u.T[:, e.cells]
    H = (
        _sum(nodes[:, a, None, None] * e.dN[None, a] for a in range(8))
        + np.eye(3)[:, :, None, None] * e.inverse_g[:, None]
    )
    H = _separate(H.reshape(3, 3, -1))
    at = _Points(H)
    if system.coordinates.curved:
        theta = e.theta + _sum(nodes[:, a, None] * system.N[None, :, a, None] for a in range(8))
        theta = theta.reshape(3, -1)
        g, by_g = (_evaluated(f, theta) for f in (system.coordinates.g, system.coordinates.by_theta))
        at = _Points(g[:, None] * H, H, theta, g, by_g)
    first, second = _COMPONENTS
    C = _sum(at.F[i][first] * at.F[i][second] for i in range(3))
    c = _separate(jnp.concatenate([_separate(C), _at_points(m, e)]))
    tensions = (inputs.T_f.reshape(-1), inputs.T_cf.reshape(-1))
    return at, c, (e.frame.reshape(3, 3, -1), *tensions, _at_points(e.material, e))


def _derivative(system: System, inputs: Inputs) -> Callable[..., Array]:
    """(c, frame, T_f, T_cf, material) of a point ↦ the derivative of the density by c [kPa]."""

    def energy(c: Array, frame: Array, T_f: Array, T_cf: Array, material: Array) -> Array:
        return density(system, c, frame, T_f, T_cf, material, inputs)

    # Forward mode: for so few variables it compiles and runs several times faster than reverse mode.
    return jax.jacfwd(energy)


def _first(at: _Points, by_F: Array) -> Array:
    """Derivatives (3, 3 or 4, P) by H_ik and, as k = 3, θ_i of what has these by F."""
    if at.H is None:
        return by_F
    by_theta = _sum(_sum(by_F[i, k] * at.H[i, k] for k in range(3))[None] * at.by_g[i] for i in range(3))
    return jnp.concatenate([at.g[:, None] * by_F, by_theta[:, None]], axis=1)


def _second(system: System, at: _Points, by_F: Array, by_FF: Array, by_Fm: Array) -> tuple[Array, Array]:
    """As `_first`, second derivatives: (3, 3 or 4, 3, 3 or 4, P), and with the multipliers (3, 3 or 4, …, P)."""
    if at.H is None:
        return by_FF, by_Fm
    pairs = [(i, k) for i in range(3) for k in range(3)]
    F_of_theta = _separate(at.by_g[:, None] * at.H[:, :, None])  # i k, θ
    by_F_theta = _separate(_sum(by_FF[:, :, i, k, None] * F_of_theta[None, None, i, k] for i, k in pairs))
    by_theta = _sum(F_of_theta[i, k][:, None] * by_F_theta[i, k][None] for i, k in pairs)
    by_gg = _evaluated(jax.jacfwd(system.coordinates.by_theta), at.theta)
    by_theta = by_theta + _sum(_sum(by_F[i, k] * at.H[i, k] for k in range(3))[None, None] * by_gg[i] for i in range(3))
    by_H_theta = at.g[:, None, None] * by_F_theta + by_F[:, :, None] * at.by_g[:, None]
    by_HH = at.g[:, None, None, None] * by_FF * at.g[None, None, :, None]
    by_H = jnp.concatenate([by_HH, by_H_theta[:, :, :, None]], axis=3)
    by_theta = jnp.concatenate([by_H_theta.transpose(2, 0, 1, 3), by_theta[:, :, None]], axis=2)
    of_m = _sum(F_of_theta[i, k][:, None] * by_Fm[i, k][None] for i, k in pairs)
    by_ym = jnp.concatenate([at.g[:, None, None] * by_Fm, of_m[:, None]], axis=1)
    return _separate(jnp.concatenate([by_H, by_theta[:, None]], axis=1)), _separate(by_ym)


def _gradients(system: System, e: Elements) -> Array:
    """∂H_ik/∂(displacement i of node a), and as k = 3 that of θ_i: (8, 3 or 4, n_points, N)."""
    if not system.coordinates.curved:
        return e.dN
    N = jnp.broadcast_to(system.N.T[:, None, :, None], (8, 1, *e.weight.shape))
    return _separate(jnp.concatenate([e.dN, N], axis=1))


def _at_nodes(system: System, e: Elements, by_y: Array) -> Array:
    """The forces (24, N) by what the points have."""
    G = _gradients(system, e)
    by_y = by_y.reshape(*by_y.shape[:-1], *e.weight.shape)
    of_nodes = _sum(G[:, None, k, g] * by_y[None, :, k, g] for k in range(G.shape[1]) for g in range(G.shape[2]))
    return of_nodes.reshape(24, -1)


def _of_multipliers(by_c: Array, e: Elements) -> Array:
    """The derivatives (multipliers, N) by p and q."""
    return jnp.sum(by_c[6:].reshape(-1, *e.weight.shape), axis=1)


def _least_J(system: System, at: _Points) -> Array:
    """The smallest det F, or −1 where a coordinate left its range, such as a negative radius."""
    a, b, c = at.F
    J = a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    if system.coordinates.curved:
        J = jnp.where(_evaluated(system.coordinates.inside, at.theta), J, -1.0)
    return jnp.min(J)


def _evaluated(function: Any, theta: Array) -> Array:
    """A function of θ (3,) at the points θ (3, P)."""
    return _rows(jax.vmap(function, in_axes=-1, out_axes=-1)(theta))


def _at_points(x: Array, e: Elements) -> Array:
    """What elements (…, N) have, at their Gauss points (…, P)."""
    return jnp.broadcast_to(x[..., None, :], (*x.shape[:-1], *e.weight.shape)).reshape(*x.shape[:-1], -1)


def _sum(terms: Iterator[Array]) -> Array:
    """The sum of some terms, in one loop over its entries."""
    return reduce(operator.add, terms)


def _separate(x: Array) -> Array:
    """x, computed once: XLA would compute it anew in each loop that needs it."""
    return _rows(jax.lax.optimization_barrier(x))


def _rows(x: Array) -> Array:
    """x, in memory as its axes say: what `vmap` made may have its last axis first there."""
    return with_layout_constraint(x, Layout(tuple(range(x.ndim))))
