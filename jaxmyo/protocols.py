"""Material tests: the conditions that `load` takes, on the homogeneous sample (fibre x, cross-fibre y, normal z).

Each is a tuple of conditions for the state C of a free contraction A; the passive test is that of A at β = 0:

    A = contract(thin_sample(), T0=5.0, a_over_D=0.2, beta=1.0)
    C = load(A, *equibiaxial(1.2))

Directions are "f", "cf" and "n" (fibre, cross-fibre, normal). Stretches are measured from the zero-stress state P;
directions that are not prescribed are free of stress. `measured` gives the stresses of a state by any measure.
"""

from typing import Literal

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxmyo import checks
from jaxmyo.conditions import Condition, Shear, Stretch, Traction
from jaxmyo.data import AXES, MEASURES, MODES
from jaxmyo.state import State

_AXIS = dict(zip(AXES, "xyz", strict=True))


def biaxial(stretch_f: ArrayLike, stretch_cf: ArrayLike) -> tuple[Condition, ...]:
    """Both in-plane stretches [–] prescribed, in any ratio; the normal is free."""
    return Stretch("x", stretch_f), Stretch("y", stretch_cf)


def equibiaxial(stretch: ArrayLike) -> tuple[Condition, ...]:
    """The same stretch [–] along fibre and cross-fibre."""
    return biaxial(stretch, stretch)


def biaxial_stress(
    stress_f: ArrayLike, stress_cf: ArrayLike, measure: Literal["cauchy", "nominal"] = "nominal"
) -> tuple[Condition, ...]:
    """Both in-plane stresses [kPa] prescribed, per undeformed area (nominal) or per deformed area (cauchy)."""
    none, f, cf = jnp.zeros(()), jnp.asarray(stress_f, dtype=float), jnp.asarray(stress_cf, dtype=float)
    return (
        Traction("x1", jnp.stack([f, none, none]), measure),
        Traction("y1", jnp.stack([none, cf, none]), measure),
    )


def uniaxial(direction: str, stretch: ArrayLike) -> tuple[Condition, ...]:
    """One stretch [–] prescribed, along "f", "cf" or "n"; the other two directions are free."""
    return (Stretch(_AXIS[checks.choice("direction", direction, list(AXES))], stretch),)


def simple_shear(
    mode: str, amount: ArrayLike, stretches: tuple[ArrayLike, ArrayLike] = (1.0, 1.0)
) -> tuple[Condition, ...]:
    """Simple shear "i-j" by `amount` [–]: the faces with normal i are displaced along j and keep their distance.

    F = diag(λ) + amount e_j ⊗ e_i, one of the six modes f-cf, f-n, cf-f, cf-n, n-f, n-cf. stretches: λi, λj [–]; the
    third direction is free of stress, and incompressibility sets its stretch (1 where λi = λj = 1).
    """
    i, j = checks.choice("mode", mode, list(MODES)).split("-")
    held = (Stretch(_AXIS[a], s) for a, s in zip((i, j), stretches, strict=True))
    return (*held, Shear(_AXIS[j], _AXIS[i], amount))


def measured(state: State, measure: str) -> Array:
    """Mean stresses (9,) [kPa] along f, cf, n and in the six modes of shear, along the axes x, y, z of the sample.

    measure: "cauchy" σ, "nominal" P = σ F⁻ᵀ det F (force along j per undeformed area with normal i), "pk2" S = F⁻¹ P.
    Where the state is not homogeneous these are volume means; for the forces of a machine take `State.reaction`.
    """
    checks.choice("measure", measure, list(MEASURES))
    stress = state.mean("second_piola_kirchhoff")
    if measure == "nominal":
        stress = state.mean("F") @ stress
    elif measure == "cauchy":
        stress = state.mean("cauchy")
    modes = [mode.split("-") for mode in MODES]
    sheared = [stress[AXES.index(j), AXES.index(i)] for i, j in modes]
    return jnp.concatenate([jnp.diagonal(stress), jnp.stack(sheared)])
