"""The density and its derivatives at many Gauss points at once; the element is that of `jaxmyo.lagrangian`.

    H, θ ─► F ─► C ─► density(C, p, q) ─► ∂, ∂² by automatic differentiation ─► by F ─► by H, θ

The last axes of every array are its lanes, see `jaxmyo.lanes`: the points of an element, the elements, the bodies of a
batch. What is done with the 3 × 3 matrices of a point is written as sums of products of such rows: products of many
small matrices take several times as long.
"""

from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxmyo import entries
from jaxmyo.coordinates import Coordinates
from jaxmyo.lagrangian import density
from jaxmyo.lanes import constant, everywhere, once, total
from jaxmyo.system import Inputs, System

#: Which of the components 11, 22, 33, 12, 13, 23 of C stands where in the tensor, and the indices of each. (Of int32,
#: for paths in float32, where JAX has no int64.)
_VOIGT = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]], dtype="int32")
_FIRST, _SECOND = np.array([[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], dtype="int32")
#: ∂C_11 = 2 F_i1 ∂F_i1, but ∂C_12 = F_i1 ∂F_i2 + F_i2 ∂F_i1.
_TWICE = 1.0 + np.eye(3)


class Place(NamedTuple):
    """What the density depends on beside the unknowns: frame (3, 3, *lanes); T_f, T_cf, material (*lanes); inputs."""

    frame: Array
    T_f: Array
    T_cf: Array
    material: Array
    inputs: Inputs


class Points(NamedTuple):
    """The deformation at Gauss points.

    F: (3, 3, *lanes); in curved coordinates also H (3, 3, *lanes), θ, g(θ) (3, *lanes) and ∂g/∂θ (3, 3, *lanes).
    """

    F: Array
    H: Any = None
    theta: Any = None
    g: Any = None
    by_g: Any = None

    @property
    def lanes(self) -> int:
        """The number of axes of lanes."""
        return self.F.ndim - 2


def at(c: Coordinates, nodes: Array, dN: Array, N: Array, theta: Array, inverse_g: Array) -> Points:
    """The points of elements with nodal displacements nodes (3, 8, *lanes).

    dN: (8, 3, *lanes); N: (8, *lanes); theta, inverse_g: (3, *lanes), see `System`.
    """
    lanes = dN.ndim - 2
    H = total(nodes[:, a, None] * dN[None, a] for a in range(8))
    H = once(H + constant(np.eye(3), lanes) * inverse_g[:, None])
    if not c.curved:
        return Points(H)
    theta = once(theta + total(nodes[:, a] * N[None, a] for a in range(8)))
    g, by_g = (everywhere(f, lanes, theta) for f in (c.g, c.by_theta))
    return Points(g[:, None] * H, H, theta, g, by_g)


def strain(at: Points, m: Array) -> Array:
    """c = (C11, C22, C33, C12, C13, C23, p[, q]) (7 or 8, *lanes); m: (multipliers, *lanes)."""
    C = total(at.F[i][_FIRST] * at.F[i][_SECOND] for i in range(3))
    lanes = jnp.broadcast_shapes(C.shape[1:], m.shape[1:])
    return once(jnp.concatenate([jnp.broadcast_to(x, (len(x), *lanes)) for x in (once(C), m)]))


def together(n_points: int) -> int:
    """How many points of an element are taken at a time, a part of all: the sums over them are written out."""
    return max(k for k in range(1, 10) if n_points % k == 0)


def by_c(system: System, c: Array, place: Place, weight: Array) -> Array:
    """The derivative (7 or 8, *lanes) of the density by c [kPa], times the weight (*lanes) [mm³]."""
    return _derivatives(system, c, place)[0] * weight[None]


def by_c_twice(system: System, c: Array, place: Place, weight: Array) -> tuple[Array, Array]:
    """As `by_c`, and the second derivatives, of each `pair` once (28 or 36, *lanes)."""
    by_c, by_cc = _derivatives(system, c, place, twice=True)
    return once(by_c * weight[None]), once(by_cc * weight[None])


def _derivatives(system: System, c: Array, place: Place, *, twice: bool = False) -> list[Array]:
    """The derivatives of the density by c, and the second ones; of a law that cannot be written out, under `vmap`.

    In forward mode: for so few variables it compiles and runs several times faster than reverse mode.
    """

    def energy(c: Array, at: Place) -> Array:
        return density(system, c, *at)

    lanes = c.ndim - 1
    if program := entries.of_numbers(energy, lanes, c, place):
        first = [entries.derivative(program, i) for i in range(len(c))]
        second = [entries.derivative(f, j) for i, f in enumerate(first) for j in range(i, len(c)) if twice]
        found = entries.at_lanes([*first, *second], lanes, c, place)
        return [jnp.stack(part) for part in (found[: len(c)], found[len(c) :]) if part]

    def at_point(c: Array, at: Place) -> list[Array]:
        def along(a: Array, b: Array) -> Array:
            return jax.jvp(lambda c: jax.jvp(lambda c: energy(c, at), (c,), (a,))[1], (c,), (b,))[1]

        first = jax.jacfwd(energy)(c, at)
        if not twice:
            return [first]
        unit = jnp.eye(len(c), dtype=c.dtype)
        i, j = np.triu_indices(len(c))
        return [first, jax.vmap(along)(unit[i], unit[j])]

    return list(everywhere(at_point, lanes, c, place))


@cache
def pair(n: int) -> NDArray[np.int32]:
    """(n, n): where the derivative by two components of c stands among those of `by_c_twice`."""
    i, j = np.triu_indices(n)
    pair = np.zeros((n, n), "int32")
    pair[i, j] = pair[j, i] = np.arange(len(i))
    return pair


def by_y(at: Points, by_c: Array) -> Array:
    """By H_ik and, as k = 3, by θ_i: (3, 3 or 4, *lanes)."""
    S = by_c[_VOIGT] * constant(_TWICE, at.lanes)
    return _first(at, total(at.F[:, k, None] * S[None, k] for k in range(3)))


def by_y_twice(c: Coordinates, at: Points, by_c: Array, by_cc: Array) -> tuple[Array, Array, Array]:
    """As `by_y`; twice (3, 3 or 4, 3, 3 or 4, *lanes); by y and the multipliers (3, 3 or 4, multipliers, *lanes)."""
    F, twice = at.F, constant(_TWICE, at.lanes)
    S = once(by_c[_VOIGT] * twice)
    by_F = total(F[:, k, None] * S[None, k] for k in range(3))
    # By c and F, then twice by F, in which C is quadratic.
    by_cC = once(by_cc[pair(len(by_c))[:, _VOIGT]] * twice[None])
    by_cF = once(total(F[None, :, k, None] * by_cC[:, None, k] for k in range(3)))

    def by_F_column(n: int) -> Array:  # views of by_cF, where _VOIGT as an index would copy it
        by_C = [by_cF[_VOIGT[k, n]] * _TWICE[k, n] for k in range(3)]
        return total(F[:, k, None, None] * x[None] for k, x in enumerate(by_C))

    by_FF = jnp.stack([by_F_column(n) for n in range(3)], axis=1)
    by_FF = once(by_FF + constant(np.eye(3)[:, None, :, None], at.lanes) * S[None, :, None])
    return _first(at, by_F), *_second(c, at, by_F, by_FF, jnp.moveaxis(by_cF[6:], 0, 2))


def least_J(c: Coordinates, at: Points) -> Array:
    """det F (*lanes); −1 where a coordinate left its range, such as a negative radius."""
    x, y, z = at.F
    J = x[0] * (y[1] * z[2] - y[2] * z[1]) + x[1] * (y[2] * z[0] - y[0] * z[2]) + x[2] * (y[0] * z[1] - y[1] * z[0])
    if c.curved:
        J = jnp.where(everywhere(c.inside, at.lanes, at.theta), J, -1.0)
    return J


def with_lanes(inputs: Inputs, lanes: int) -> Inputs:
    """Of the inputs, what the density depends on; the same at all points, which have so many axes of lanes."""
    none = jnp.zeros(())
    of_density = inputs._replace(T_f=none, T_cf=none, offset=none, loads={}, volumes=none, imbalance=none)
    return jax.tree.map(lambda x: jnp.reshape(x, (*jnp.shape(x), *(1,) * lanes)), of_density)


def _first(at: Points, by_F: Array) -> Array:
    if at.H is None:
        return by_F
    by_theta = total(by_g[None] * at.by_g[i] for i, by_g in enumerate(_by_g(at, by_F)))
    return jnp.concatenate([at.g[:, None] * by_F, by_theta[:, None]], axis=1)


def _by_g(at: Points, by_F: Array) -> list[Array]:
    """By the scale factors g_i, F = diag(g) · H: three (*lanes)."""
    return [total(by_F[i, k] * at.H[i, k] for k in range(3)) for i in range(3)]


def _second(c: Coordinates, at: Points, by_F: Array, by_FF: Array, by_Fm: Array) -> tuple[Array, Array]:
    if at.H is None:
        return by_FF, by_Fm
    pairs = [(i, k) for i in range(3) for k in range(3)]
    F_of_theta = once(at.by_g[:, None] * at.H[:, :, None])  # i k, θ
    by_F_theta = once(total(by_FF[:, :, i, k, None] * F_of_theta[None, None, i, k] for i, k in pairs))
    by_theta = total(F_of_theta[i, k][:, None] * by_F_theta[i, k][None] for i, k in pairs)
    by_gg = everywhere(jax.jacfwd(c.by_theta), at.lanes, at.theta)
    by_theta = by_theta + total(by_g[None, None] * by_gg[i] for i, by_g in enumerate(_by_g(at, by_F)))
    by_H_theta = at.g[:, None, None] * by_F_theta + by_F[:, :, None] * at.by_g[:, None]
    by_HH = at.g[:, None, None, None] * by_FF * at.g[None, None, :, None]
    by_H = jnp.concatenate([by_HH, by_H_theta[:, :, :, None]], axis=3)
    by_theta = jnp.concatenate([jnp.moveaxis(by_H_theta, 2, 0), by_theta[:, :, None]], axis=2)
    of_m = total(F_of_theta[i, k][:, None] * by_Fm[i, k][None] for i, k in pairs)
    by_ym = jnp.concatenate([at.g[:, None, None] * by_Fm, of_m[:, None]], axis=1)
    return once(jnp.concatenate([by_H, by_theta[:, None]], axis=1)), once(by_ym)
