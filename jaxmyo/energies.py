"""The scalar energy densities, each written once [kPa = µJ/mm³ of the zero-stress state P].

Stresses and tangents are nowhere written down: the element differentiates these functions, S = 2 ∂W/∂C and 4 ∂²W/∂C∂C.

A **law** is any function `law(C, frame, beta, constants) -> W` of the right Cauchy–Green tensor C (3, 3), the fibre
frame (3, 3; rows f, f⊥, n), the activation β ∈ [0, 1] and a pytree of constants: `lin_yin`, `guccione`. A law of one's
own is one more such function, passed to a scene; it should be stress-free at C = I and β = 0 up to a pressure.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxmyo.constants import Guccione, LinYin
from jaxmyo.invariants import I1, I3, I4, I6, weave_h

Law = Callable[[Array, Array, Array, Any], Array]


class Kind(NamedTuple):
    """What an element is made of: its law, whether it contracts, and whether the weave acts in it."""

    law: Law
    active: bool
    weave: bool


def lin_yin_passive(C: Array, frame: Array, constants: LinYin) -> Array:
    """Passive tissue: C1p (exp Q − 1), Q = C2p (I1−3)² + C3p (I1−3)(I4−1) + C4p (I4−1)² (Lin & Yin 1998) [kPa]."""
    i1, i4 = I1(C) - 3.0, I4(C, frame) - 1.0
    Q = constants.C2p * i1**2 + constants.C3p * i1 * i4 + constants.C4p * i4**2
    return constants.C1p * jnp.expm1(Q)


def lin_yin_active(C: Array, frame: Array, constants: LinYin) -> Array:
    """Change of the fibres' elasticity in full activation (paper, Eq. (Wact)) [kPa].

    C1a (I1−3)(I4−1) + C2a (I1−3)² + C3a (I4−1)² + C4a (I1−3).
    """
    i1, i4 = I1(C) - 3.0, I4(C, frame) - 1.0
    return constants.C1a * i1 * i4 + constants.C2a * i1**2 + constants.C3a * i4**2 + constants.C4a * i1


def lin_yin(C: Array, frame: Array, beta: Array, constants: LinYin) -> Array:
    """The law of the paper, W* = W_pas + β W_act (Eq. (SEF*)) [kPa]."""
    return lin_yin_passive(C, frame, constants) + beta * lin_yin_active(C, frame, constants)


def guccione(C: Array, frame: Array, beta: Array, constants: Guccione) -> Array:
    """A passive law of heart muscle, transversely isotropic: W = ½ C (exp Q − 1) [kPa] (Guccione et al. 1991).

    Q = bf Eff² + bt (Ecc² + Enn² + 2 Ecn²) + 2 bfs (Efc² + Efn²), E = ½ (C − I) along the frame f, f⊥ (c), n.
    It does not depend on the activation beta: the muscle is active by its beating tension βT0 alone.
    """
    E = 0.5 * (frame @ C @ frame.T - jnp.eye(3))
    across = E[1, 1] ** 2 + E[2, 2] ** 2 + 2.0 * E[1, 2] ** 2
    shear = 2.0 * (E[0, 1] ** 2 + E[0, 2] ** 2)
    Q = constants.bf * E[0, 0] ** 2 + constants.bt * across + constants.bfs * shear
    return 0.5 * constants.C * jnp.expm1(Q)


def beating(C: Array, frame: Array, tension: float | Array) -> Array:
    """½ T ln I4: the potential of a Cauchy tension T f⊗f along the deformed fibre; T = β T0 [kPa]."""
    return 0.5 * tension * jnp.log(I4(C, frame))


def incompressibility(C: Array, p: Array) -> Array:
    """−½ p (I3 − 1), with the pressure p [kPa] as the multiplier."""
    return -0.5 * p * (I3(C) - 1.0)


def weave(i4: Array, i6: Array, q: Array, a_over_D: float | Array, softness: float | Array) -> Array:
    """−½ q h(I4, I6) − ⅛ q² / k, with the multiplier q [kPa] of the weave; in the free contraction A only (Eq. (pa)).

    softness = 1/k [1/kPa]: 0 is the paper's exact constraint h = 0; a weave of finite stiffness k stores ½ k h², of
    which this is the perturbed Lagrangian: stationary at q = −2 k h, where it is ½ k h².
    """
    return -0.5 * q * weave_h(i4, i6, a_over_D) - 0.125 * softness * q**2


def frozen_tensions(C: Array, frame: Array, T_f: Array, T_cf: Array) -> Array:
    """½ T_A^f ln I4 + ½ T_A^cf ln I6: the pseudo-active tensions [kPa] of A, acting in C (paper, Eq. (CauchyC))."""
    return 0.5 * T_f * jnp.log(I4(C, frame)) + 0.5 * T_cf * jnp.log(I6(C, frame))
