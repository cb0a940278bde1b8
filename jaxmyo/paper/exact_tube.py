"""The exact tube with planar ends: three numbers, no elements.

The wall is incompressible, so the inner radius and the axial stretch give every stretch,

    r² = ri² + (R² − Ri²)/λz,    λθ = r/R,    λr = 1/(λθ λz).

What is left of the Lagrangian is a sum over Gauss points of the package's own densities, a function of ln(ri/Ri), ln λz
and, with the weave, of one q for the whole wall. State A is where its gradient vanishes; in state C the gradient is the
work of the pressure on the inner wall (open ends: it does no work along the axis). Newton's method from a state near by
solves it to round-off. Radii in mm, stresses in kPa.
"""

from functools import partial
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from numpy.typing import NDArray

from jaxmyo import energies
from jaxmyo.compiler import QUICK
from jaxmyo.hexahedron import gauss
from jaxmyo.invariants import weave_h
from jaxmyo.scenes.tube import RI, RO
from jaxmyo.status import SolveError

POINTS = 48
_XI, _W = gauss(POINTS)
#: Gauss points R [mm] through the wall, and weights of ∫ … R dR [mm²].
RADII = 0.5 * (RI + RO) + 0.5 * (RO - RI) * _XI[:, 0]
WEIGHTS = 0.5 * (RO - RI) * _W * RADII

#: The weave: none, one q for the wall, or (of finite stiffness only) its own q at every radius.
Weave = Literal["none", "uniform", "local"]
#: That of a tube with and of one without the constraint.
WEAVE: dict[bool, Weave] = {True: "uniform", False: "none"}


class Wall(NamedTuple):
    """A tube: ri inner radius [mm], height: axial stretch λz [–], q of the weave [kPa] (0 where it is not one q)."""

    ri: float
    height: float
    q: float = 0.0

    def r(self, R: ArrayLike) -> NDArray[np.float64]:
        """Deformed radii [mm] of the radii R [mm]."""
        return np.asarray(np.sqrt(self.ri**2 + (np.asarray(R) ** 2 - RI**2) / self.height))

    @property
    def ro(self) -> float:
        """Outer radius [mm]."""
        return float(self.r(RO))


class Pair(NamedTuple):
    """Free contraction A and the state C under pressure that starts from it."""

    A: Wall
    C: Wall

    def of(self, kind: Literal["A", "C"]) -> Wall:
        """One of the two."""
        return self.A if kind == "A" else self.C


class Muscle(NamedTuple):
    """What drives a tube: constants of the law, T0 [kPa], β [–], a/D [–], softness 1/k of the weave [1/kPa]."""

    constants: Any
    T0: float | Array
    beta: float | Array
    a_over_D: float | Array
    softness: float | Array = 0.0


def pair(muscle: Muscle, weave: Weave, pressure: float, start: Pair) -> Pair:
    """States A and C under an inner pressure [kPa], ends open. A `SolveError` if Newton's method does not settle."""
    A = contract(muscle, weave, start.A)
    return Pair(A, inflate(A, muscle, weave, pressure, start.C))


def contract(muscle: Muscle, weave: Weave, start: Wall) -> Wall:
    """State A, found from a state near by. A `SolveError` if Newton's method does not settle."""
    unknowns = 3 if weave == "uniform" else 2
    return _newton(partial(_step_A, weave=weave), start, unknowns, jax.tree.map(float, muscle))


def inflate(A: Wall, muscle: Muscle, weave: Weave, pressure: float, start: Wall) -> Wall:
    """State C under an inner pressure [kPa], ends open, the tensions of A frozen; found from a state near by.

    A `SolveError` if Newton's method does not settle.
    """
    return _newton(partial(_step_C, weave=weave), start, 2, jax.tree.map(float, muscle), jnp.array(A), float(pressure))


def _newton(step: Any, start: Wall, unknowns: int, *arguments: Any) -> Wall:
    """Newton's method until its correction is round-off."""
    z = np.array([np.log(start.ri / RI), np.log(start.height), start.q])[:unknowns]
    size = np.inf
    for _ in range(50):
        change = np.asarray(step(jnp.asarray(z), *arguments))
        before, size = size, float(np.max(np.abs(change)))
        if not np.isfinite(size) or (size >= before and size < 1e-11):
            break
        z = z + change
    if not size < 1e-11:
        raise SolveError(f"no exact tube was found near ri = {start.ri:g} mm, λz = {start.height:g}", start)
    return Wall(float(RI * np.exp(z[0])), float(np.exp(z[1])), *map(float, z[2:]))


@partial(jax.jit, static_argnames=("weave",), compiler_options=QUICK)
def _step_A(z: Array, muscle: Muscle, weave: Weave) -> Array:
    def lagrangian(z: Array) -> Array:
        def density(squares: Array) -> Array:
            return _tissue(squares, muscle) + _weave(squares, z, muscle, weave)

        return jnp.asarray(WEIGHTS) @ jax.vmap(density)(_squares(z))

    gradient = jax.grad(lagrangian)
    return -jnp.linalg.solve(jax.jacfwd(gradient)(z), gradient(z))


@partial(jax.jit, static_argnames=("weave",), compiler_options=QUICK)
def _step_C(z: Array, muscle: Muscle, A: Array, pressure: Array, weave: Weave) -> Array:
    z_A = jnp.stack([jnp.log(A[0] / RI), jnp.log(A[1]), A[2]])
    T_f, T_cf = jax.vmap(lambda squares: _tensions(squares, z_A, muscle, weave))(_squares(z_A))

    def energy(z: Array) -> Array:
        def density(squares: Array, T_f: Array, T_cf: Array) -> Array:
            frozen = energies.frozen_tensions(jnp.diag(squares), jnp.eye(3), T_f, T_cf)
            return _tissue(squares, muscle) + frozen

        return jnp.asarray(WEIGHTS) @ jax.vmap(density)(_squares(z), T_f, T_cf)

    def imbalance(z: Array) -> Array:
        """Per 2π times the undeformed height; the pressure works through ri dri of each deformed height λz."""
        work = pressure * RI**2 * jnp.exp(2.0 * z[0] + z[1])
        return jax.grad(energy)(z) - jnp.stack([work, jnp.zeros(())])

    return -jnp.linalg.solve(jax.jacfwd(imbalance)(z), imbalance(z))


def _squares(z: Array) -> Array:
    """λθ², λz², λr² (points, 3) of fibre, strut and normal."""
    R2 = jnp.asarray(RADII**2)
    around = (RI**2 * jnp.exp(2.0 * z[0]) + (R2 - RI**2) * jnp.exp(-z[1])) / R2
    axial = jnp.broadcast_to(jnp.exp(2.0 * z[1]), around.shape)
    return jnp.stack([around, axial, 1.0 / (around * axial)], axis=-1)


def _tissue(squares: Array, muscle: Muscle) -> Array:
    """W* + ½ β T0 ln I4 [kPa]."""
    return tissue(jnp.diag(squares), jnp.eye(3), muscle)


def tissue(C: Array, frame: Array, muscle: Muscle) -> Array:
    """W* + ½ β T0 ln I4 [kPa] of C (3, 3) and a fibre frame (rows)."""
    beta = jnp.asarray(muscle.beta)
    law = energies.lin_yin(C, frame, beta, muscle.constants)
    return law + energies.beating(C, frame, beta * jnp.asarray(muscle.T0))


def _q(squares: Array, z: Array, muscle: Muscle, weave: Weave) -> Array:
    if weave == "uniform":
        return z[2]
    return -2.0 / jnp.asarray(muscle.softness) * weave_h(squares[0], squares[1], muscle.a_over_D)


def _weave(squares: Array, z: Array, muscle: Muscle, weave: Weave) -> Array:
    if weave == "none":
        return jnp.zeros(())
    q = _q(squares, z, muscle, weave)
    return energies.weave(squares[0], squares[1], q, muscle.a_over_D, muscle.softness)


def _tensions(squares: Array, z: Array, muscle: Muscle, weave: Weave) -> tuple[Array, Array]:
    """T_A^f, T_A^cf [kPa]."""
    if weave == "none":
        return jnp.zeros(()), jnp.zeros(())
    q = _q(squares, z, muscle, weave)
    by_4, by_6 = jax.grad(energies.weave, argnums=(0, 1))(squares[0], squares[1], q, muscle.a_over_D, muscle.softness)
    return 2.0 * by_4 * squares[0], 2.0 * by_6 * squares[1]
