"""Strong ellipticity of the material: whether a band of localised deformation costs energy, in every direction.

A plane wave, or a band, of normal N in P and amplitude m changes F by m ⊗ N. With A = ∂²W/∂F∂F of the full density of
the state (law, beating tension, pressure, weave or frozen tensions) it costs ½ m·Q(N) m, Q_ik(N) = A_iJkL N_J N_L, the
acoustic tensor. An incompressible material has amplitudes m ⟂ F⁻ᵀN only: for these the pressure does not count.
The material is strongly elliptic where the least eigenvalue of Q(N) on that plane is positive for all N (for example
Ogden, *Non-linear Elastic Deformations*, 1984, § 6.2); where it is not, a finer mesh finds finer bands.

In a state A the weave is a constraint that holds in the mean of a patch of elements, so amplitudes with ∂h/∂F : m ⊗ N
≠ 0 are not excluded here; q is held. This is a lower bound of a weave that holds at every point, exactly (amplitudes
are excluded) or with a stiffness k (k (∂h/∂F : m ⊗ N)² is added): what is positive here is so there.
"""

from functools import partial
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxmyo import lagrangian, tracing
from jaxmyo.coordinates import CARTESIAN
from jaxmyo.energies import Kind
from jaxmyo.system import Inputs, System

#: Directions on a half sphere that are looked at, and bands of them from each of which the best one is refined.
DIRECTIONS, BANDS = 256, 8
#: Newton steps of the refinement; width [rad] of the differences that it takes its derivatives from.
STEPS, WIDTH = 10, 1e-3
_STENCIL = np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [1, -1], [-1, 1], [-1, -1]], dtype=np.float64)
#: Gauss points at a time.
BLOCK = 128


def _half_sphere() -> np.ndarray:
    """(DIRECTIONS, 3) unit vectors, evenly spread over a half sphere (Fibonacci's lattice); Q(−N) = Q(N)."""
    k = np.arange(DIRECTIONS) + 0.5
    z, phi = 1.0 - k / DIRECTIONS, np.pi * (1.0 + np.sqrt(5.0)) * k
    return np.stack([np.sqrt(1.0 - z**2) * np.cos(phi), np.sqrt(1.0 - z**2) * np.sin(phi), z], axis=1)


_SPHERE = _half_sphere()


class _Material(NamedTuple):
    """What of a system its density needs."""

    kinds: tuple[Kind, ...]
    weave: bool


def weakest(system: System, F: Array, multipliers: Array, inputs: Inputs) -> tuple[Array, Array]:
    """The least eigenvalue (n_elements, n_points) [kPa] over all N, and its N (n_elements, n_points, 3) in P.

    F: (n_elements, n_points, 3, 3); multipliers: (n_elements, 1 or 2), p and q.
    """
    shape = F.shape[:2]
    of_elements = (multipliers, system.material)
    repeated = (jnp.broadcast_to(x[:, None], (*shape, *x.shape[1:])) for x in of_elements)
    places = (F, system.frame, inputs.T_f, inputs.T_cf, *repeated)
    points = [x.reshape(-1, *x.shape[2:]) for x in places]
    none: Any = jnp.zeros(0)
    shared = inputs._replace(T_f=none, T_cf=none, offset=none, loads={}, volumes=none, imbalance=none)
    material, n = _Material(system.kinds, system.weave), len(points[0])
    if tracing.is_traced((points, shared)):
        found = jax.lax.map(lambda at: _of_point(material, shared, *at), points, batch_size=BLOCK)
    else:  # in blocks of one size, so that one program serves all bodies
        padded = np.resize(np.arange(n), (-(-n // BLOCK), BLOCK))
        blocks = [_of_block(material, shared, *(x[ids] for x in points)) for ids in padded]
        found = jax.tree.map(lambda *x: jnp.concatenate(x)[:n], *blocks)
    return found[0].reshape(shape), found[1].reshape(*shape, 3)


def _of_point(material: _Material, inputs: Inputs, *at: Array) -> tuple[Array, Array]:
    return least(at[0], moduli(cast(System, material), inputs, *at))


@partial(jax.jit, static_argnums=0)
def _of_block(material: _Material, inputs: Inputs, *at: Array) -> tuple[Array, Array]:
    return jax.vmap(lambda *one: _of_point(material, inputs, *one))(*at)


def moduli(
    system: System,
    inputs: Inputs,
    F: Array,
    frame: Array,
    T_f: Array,
    T_cf: Array,
    multipliers: Array,
    material: Array,
) -> Array:
    """A_iJkL = ∂²W/∂F_iJ ∂F_kL (3, 3, 3, 3) [kPa] of the density at a point, multipliers held."""

    def of_c(c: Array) -> Array:
        return lagrangian.density(system, c, frame, T_f, T_cf, material, inputs)

    def c_of(F: Array) -> Array:
        return lagrangian.strain(CARTESIAN, jnp.concatenate([F, multipliers]))

    x = F.reshape(9)
    by_c, J = jax.jacfwd(of_c)(c_of(x)), jax.jacfwd(c_of)(x)
    curvature = jax.jacfwd(jax.jacfwd(lambda x: by_c @ c_of(x)))(x)
    return (J.T @ jax.jacfwd(jax.jacfwd(of_c))(c_of(x)) @ J + curvature).reshape(3, 3, 3, 3)


def least(F: Array, A: Array) -> tuple[Array, Array]:
    """The least eigenvalue [kPa] of the acoustic tensor over all N (3,) and amplitudes m ⟂ F⁻ᵀN, and its N.

    The best direction of each band of the half sphere is refined by Newton's method; a step that leads up is not taken.
    """
    of = partial(_least_of, F, A)
    sphere = jnp.asarray(_SPHERE)
    values = jax.vmap(of)(sphere).reshape(BANDS, -1)
    best = jnp.argmin(values, axis=1)
    starts = sphere.reshape(BANDS, -1, 3)[jnp.arange(BANDS), best], values[jnp.arange(BANDS), best]

    def refine(at: tuple[Array, Array], nothing: None) -> tuple[tuple[Array, Array], None]:
        N, value = at
        along = _plane(N)

        def moved(x: Array) -> tuple[Array, Array]:
            M = N[None] + x @ along
            M = M / jnp.sqrt(jnp.sum(M**2, axis=1, keepdims=True))
            return M, jax.vmap(of)(M)

        _, f = moved(WIDTH * jnp.asarray(_STENCIL))
        g = jnp.stack([f[0] - f[1], f[2] - f[3]]) / (2.0 * WIDTH)
        xx, yy = (f[0] - 2.0 * value + f[1]) / WIDTH**2, (f[2] - 2.0 * value + f[3]) / WIDTH**2
        xy = (f[4] - f[5] - f[6] + f[7]) / (4.0 * WIDTH**2)
        # A Hessian that is not positive definite is shifted until it is.
        shift = jnp.maximum(0.0, -1.5 * _smaller_eigenvalue(xx, yy, xy)) + 1e-9 * jnp.max(jnp.abs(A))
        xx, yy = xx + shift, yy + shift
        det = jnp.maximum(xx * yy - xy**2, jnp.finfo(f.dtype).tiny)
        step = jnp.stack([xy * g[1] - yy * g[0], xy * g[0] - xx * g[1]]) / det
        step = step * jnp.minimum(1.0, 0.1 / jnp.maximum(jnp.sqrt(jnp.sum(step**2)), 1e-30))
        to, found = moved(jnp.stack([step, 0.25 * step]))  # the shorter one where the quadratic model overshoots
        best = jnp.argmin(found)
        down = found[best] < value
        return (jnp.where(down, to[best], N), jnp.where(down, found[best], value)), nothing

    def refined(start: tuple[Array, Array]) -> tuple[Array, Array]:
        return jax.lax.scan(refine, start, None, length=STEPS)[0]

    N, values = jax.vmap(refined)(starts)
    best = jnp.argmin(values)
    return values[best], N[best]


def _least_of(F: Array, A: Array, N: Array) -> Array:
    """The least eigenvalue [kPa] of Q(N) on the plane normal to F⁻ᵀN."""
    # F⁻ᵀ det F has the cross products of the columns of F as columns.
    n = N[0] * jnp.cross(F[:, 1], F[:, 2]) + N[1] * jnp.cross(F[:, 2], F[:, 0]) + N[2] * jnp.cross(F[:, 0], F[:, 1])
    m = _plane(n)
    NN = N[:, None] * N[None]
    Q = jnp.sum(A * NN[None, :, None, :], axis=(1, 3))
    mQm = jnp.sum(m[:, None, :, None] * m[None, :, None, :] * Q[None, None], axis=(2, 3))
    return _smaller_eigenvalue(mQm[0, 0], mQm[1, 1], 0.5 * (mQm[0, 1] + mQm[1, 0]))


def _smaller_eigenvalue(xx: Array, yy: Array, xy: Array) -> Array:
    """Of a symmetric matrix [[xx, xy], [xy, yy]]."""
    return 0.5 * (xx + yy) - jnp.sqrt(0.25 * (xx - yy) ** 2 + xy**2)


def _plane(n: Array) -> Array:
    """Two orthonormal vectors, rows (2, 3), normal to n (3,), which need not be of unit length."""
    axis = (jnp.arange(3) == jnp.argmin(jnp.abs(n))).astype(n.dtype)
    a = jnp.cross(n, axis)
    b = jnp.cross(n, a)
    both = jnp.stack([a, b])
    return both / jnp.sqrt(jnp.sum(both**2, axis=1, keepdims=True))
