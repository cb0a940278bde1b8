"""Invariants of the right Cauchy–Green tensor C = FᵀF, and the kinematic constraint h of the collagen weave.

The fibre frame is a (3, 3) array whose rows are the orthonormal reference directions: `frame[0]` the fibre f,
`frame[1]` the cross-fibre f⊥ (the collagen struts), `frame[2]` the normal n. All functions are scalar and pure.
"""

import jax.numpy as jnp
from jax import Array


def I1(C: Array) -> Array:
    """First invariant tr C [–]; 3 at rest."""
    return C[0, 0] + C[1, 1] + C[2, 2]


def I3(C: Array) -> Array:
    """Third invariant det C = J² [–]; 1 for an incompressible deformation."""
    return (
        C[0, 0] * (C[1, 1] * C[2, 2] - C[1, 2] * C[2, 1])
        - C[0, 1] * (C[1, 0] * C[2, 2] - C[1, 2] * C[2, 0])
        + C[0, 2] * (C[1, 0] * C[2, 1] - C[1, 1] * C[2, 0])
    )


def I4(C: Array, frame: Array) -> Array:
    """Squared fibre stretch f · C f = λf² [–]."""
    return _along(frame[0], C)


def I6(C: Array, frame: Array) -> Array:
    """Squared cross-fibre stretch f⊥ · C f⊥ = λcf² [–]."""
    return _along(frame[1], C)


def _along(a: Array, C: Array) -> Array:
    """a · C a, written out: XLA would call a library for a product of matrices, at every point."""
    Ca = [C[i, 0] * a[0] + C[i, 1] * a[1] + C[i, 2] * a[2] for i in range(3)]
    return a[0] * Ca[0] + a[1] * Ca[1] + a[2] * Ca[2]


def weave_h(i4: Array, i6: Array, a_over_D: float | Array) -> Array:
    """Kinematic constraint of the weave, h = 1 − I6^½ + (π − 2)(1 − I4^(−¼)) a/D [–] (paper, Eq. (kcbis)).

    h = 0 while the tissue contracts freely: a fibre that shortens thickens, and its inextensible wrapping draws the
    neighbours together. `a_over_D` ∈ [0, ¼] is the fibre radius over D = 4a + d, with d ≥ 0 the gap between two cells.
    """
    return 1.0 - jnp.sqrt(i6) + (jnp.pi - 2.0) * (1.0 - i4**-0.25) * a_over_D
