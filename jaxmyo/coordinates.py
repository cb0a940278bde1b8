"""World coordinates θ of a body, as in the paper's Lagrangian formulation: any orthogonal system, right-handed.

Node positions, displacements and the Q1 interpolation are in these coordinates; vectors and tensors are in the local
orthonormal basis e_i = (∂x/∂θ_i) / g_i, with the scale factors g_i = |∂x/∂θ_i|. With Θ in the state P and θ deformed,

    F = diag(g(θ)) · ∂θ/∂Θ · diag(1 / g(Θ)),        dV = g_1 g_2 g_3 dΘ_1 dΘ_2 dΘ_3.

A system of one's own is one function, position(θ) → x.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

Map = Callable[[Any], Array]


@dataclass(frozen=True)
class Coordinates:
    """An orthogonal system of world coordinates.

    name; axes: the three names of the coordinates, "r" for example; units: "mm" or "rad" of each;
    position: θ (3,) ↦ Cartesian x (3,) [mm], right-handed: e_1 × e_2 = e_3;
    scale_factors: θ (3,) ↦ g (3,); if it is not given, |∂x/∂θ_i| by automatic differentiation.
    """

    name: str
    axes: tuple[str, str, str]
    units: tuple[str, str, str]
    position: Map
    scale_factors: Map | None = None

    @property
    def curved(self) -> bool:
        """Whether the scale factors differ from 1."""
        return self is not CARTESIAN

    def g(self, theta: Any) -> Array:
        """Scale factors g_i = |∂x/∂θ_i| (3,) at θ (3,) [mm per unit of θ_i]."""
        if self.scale_factors is not None:
            return self.scale_factors(theta)
        return jnp.sqrt(jnp.sum(jax.jacfwd(self.position)(theta) ** 2, axis=0))

    def by_theta(self, theta: Any) -> Array:
        """∂g_i/∂θ_k (3, 3) at θ (3,)."""
        return jax.jacfwd(self.g)(theta)

    def inside(self, theta: Any) -> Array:
        """Whether θ (3,) is where the coordinates are right-handed: not at a negative radius, for example."""
        if self.scale_factors is not None:
            return jnp.all(self.scale_factors(theta) > 0.0)
        return jnp.linalg.det(jax.jacfwd(self.position)(theta)) > 0.0

    def basis(self, theta: Any) -> Array:
        """The local orthonormal basis at θ (3,) in Cartesian components (3, 3); rows e_1, e_2, e_3."""
        by_theta = jax.jacfwd(self.position)(theta)
        return (by_theta / jnp.sqrt(jnp.sum(by_theta**2, axis=0))[None, :]).T


def evaluate(function: Map, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """A function of each of n points (n, ...), in numbers: also while JAX traces, since meshes are not traced.

    It is compiled once per function and shape.
    """
    return np.asarray(_of_many(function, points.shape)(points))


@lru_cache
def _of_many(function: Map, shape: tuple[int, ...]) -> Map:
    """The compiled function of many points, which also runs while JAX traces."""
    compiled: Map = jax.jit(jax.vmap(function)).lower(jax.ShapeDtypeStruct(shape, float)).compile()
    return compiled


def _cartesian(theta: Array) -> Array:
    return theta


def _ones(theta: Array) -> Array:
    return jnp.ones_like(theta)


def _cylinder(theta: Array) -> Array:
    r, phi, z = theta
    return jnp.stack([r * jnp.cos(phi), r * jnp.sin(phi), z])


def _cylinder_scale(theta: Array) -> Array:
    one = jnp.ones_like(theta[0])
    return jnp.stack([one, theta[0], one])


#: x, y, z [mm].
CARTESIAN = Coordinates("Cartesian", ("x", "y", "z"), ("mm", "mm", "mm"), _cartesian, _ones)

#: r [mm], φ [rad], z [mm] about the z axis; scale factors 1, r, 1.
CYLINDRICAL = Coordinates("cylindrical", ("r", "phi", "z"), ("mm", "rad", "mm"), _cylinder, _cylinder_scale)


@lru_cache
def prolate_spheroidal(focus: float) -> Coordinates:
    """Confocal ellipsoids about the z axis, for a ventricle: λ (through the wall), μ (0 at the apex z > 0), φ [rad].

    x = d sinh λ sin μ cos φ, y = d sinh λ sin μ sin φ, z = d cosh λ cos μ with the focal distance d = `focus` [mm];
    scale factors d (sinh² λ + sin² μ)^½ (twice) and d sinh λ sin μ. Error: a ValueError for a focus that is not > 0.
    """
    if not 0.0 < focus < float("inf"):
        raise ValueError(f"focus = {focus} must be a positive length (mm)")

    def position(theta: Array) -> Array:
        lam, mu, phi = theta
        axial, radial = jnp.cosh(lam) * jnp.cos(mu), jnp.sinh(lam) * jnp.sin(mu)
        return focus * jnp.stack([radial * jnp.cos(phi), radial * jnp.sin(phi), axial])

    def scale_factors(theta: Array) -> Array:
        lam, mu, _ = theta
        meridian = jnp.sqrt(jnp.sinh(lam) ** 2 + jnp.sin(mu) ** 2)
        return focus * jnp.stack([meridian, meridian, jnp.sinh(lam) * jnp.sin(mu)])

    return Coordinates("prolate spheroidal", ("lambda", "mu", "phi"), ("rad", "rad", "rad"), position, scale_factors)
