"""What is prescribed to a body: supports, prescribed displacements and stretches, tractions.

All are small pytrees: their values may be traced (`vmap`, `grad`), their face names and axes are static.
Axes are the Cartesian directions "x", "y", "z".
"""

from dataclasses import dataclass, field
from typing import Literal

import jax
from jax.typing import ArrayLike

Axis = Literal["x", "y", "z"]
AXES = ("x", "y", "z")


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Displacement:
    """The displacement component `axis` of all nodes of a face is `value` [mm] (Dirichlet)."""

    face: str = field(metadata={"static": True})
    axis: Axis = field(metadata={"static": True})
    value: ArrayLike = 0.0


def Symmetry(axis: Axis) -> Displacement:
    """The face at the lower end of an axis (x0, y0 or z0) is a symmetry plane: it does not move along the axis."""
    return Displacement(f"{axis}0", axis, 0.0)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Stretch:
    """The face at the upper end of an axis (x1, y1 or z1) stays plane and moves along it.

    `value` is the stretch [–] of the body between this face and the symmetry plane at the lower end, measured from
    the zero-stress state P: the displacement is (value − 1) × the body's extent along the axis.
    """

    axis: Axis = field(metadata={"static": True})
    value: ArrayLike


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Planar:
    """The face keeps one common displacement component `axis`, which is an unknown: a frictionless rigid plate."""

    face: str = field(metadata={"static": True})
    axis: Axis = field(metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Homogeneous:
    """The body deforms as F = diag(λ1, λ2, λ3) along the axes; the three stretches are the only displacements."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Traction:
    """A traction vector (3,) [kPa = mN/mm²] on a face, fixed in direction.

    measure "nominal": force per area of the zero-stress state P (a dead load);
    measure "cauchy": force per deformed area (it follows the area; its tangent is not symmetric).
    """

    face: str = field(metadata={"static": True})
    vector: ArrayLike
    measure: Literal["nominal", "cauchy"] = field(default="nominal", metadata={"static": True})


Tie = Displacement | Stretch | Planar | Homogeneous
Condition = Tie | Traction
