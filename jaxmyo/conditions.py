"""What is prescribed to a body: ties (supports, prescribed motion), tractions, pressures, springs.

All are small pytrees: their values may be traced (`vmap`, `grad`), their face names and axes are static.
Axes are the names of the body's world coordinates: "x", "y", "z", or "r", "phi", "z"; values along them are in mm
or rad.
"""

from dataclasses import dataclass, field
from typing import Literal

import jax
from jax.typing import ArrayLike


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Displacement:
    """The displacement component `axis` of all nodes of a face is `value` [mm, rad] (Dirichlet)."""

    face: str = field(metadata={"static": True})
    axis: str = field(metadata={"static": True})
    value: ArrayLike = 0.0


def Symmetry(axis: str) -> Displacement:
    """The face at the lower end of an axis (x0, y0 or z0) is a symmetry plane: it does not move along the axis."""
    return Displacement(f"{axis}0", axis, 0.0)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Stretch:
    """The face at the upper end of an axis (x1, y1 or z1) stays plane and moves along it.

    `value` is the stretch [–] of the body between this face and the symmetry plane at the lower end, measured from
    the zero-stress state P: the displacement is (value − 1) × the body's extent along the axis.
    """

    axis: str = field(metadata={"static": True})
    value: ArrayLike


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Planar:
    """The face keeps one common displacement component `axis`, which is an unknown: a frictionless rigid plate."""

    face: str = field(metadata={"static": True})
    axis: str = field(metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Uniform:
    """The displacement component `axis` does not vary along the coordinates `along`: axial symmetry, for example."""

    axis: str = field(metadata={"static": True})
    along: tuple[str, ...] = field(metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Proportional:
    """The displacement component `axis` is one unknown times the coordinate `to` of the state P.

    Proportional("z", "z") with planar cross-sections is generalised plane strain, u_z = e Z;
    Proportional("phi", "z") is a twist, u_φ = ψ Z; a `Displacement` or `Stretch` of an end prescribes it.
    """

    axis: str = field(metadata={"static": True})
    to: str = field(metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Homogeneous:
    """The body deforms as F = diag(λ1, λ2, λ3) along Cartesian axes; the three stretches are the only displacements."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Shear:
    """Simple shear on top of everything else: u_axis of every node, held or free, grows by value × its coordinate `to`.

    `value` is the amount of shear [–] in Cartesian coordinates: Shear("x", "z", 0.3) displaces the faces with normal z
    along x. With `Homogeneous` and the other stretches, F = diag(λ1, λ2, λ3) + value e_axis ⊗ e_to.
    """

    axis: str = field(metadata={"static": True})
    to: str = field(metadata={"static": True})
    value: ArrayLike


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Traction:
    """A traction vector (3,) [kPa = mN/mm²] on a face, its components along the local unit vectors e_i(θ).

    In Cartesian coordinates it is fixed in direction; in curved ones it turns with the point that it acts on.
    measure "nominal": force per area of the zero-stress state P (a dead load, if fixed in direction);
    measure "cauchy": force per deformed area (it follows the area; its tangent is not symmetric).
    """

    face: str = field(metadata={"static": True})
    vector: ArrayLike
    measure: Literal["nominal", "cauchy"] = field(default="nominal", metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Pressure:
    """A pressure [kPa] on a face, pushing into the body, normal to the deformed face: a follower load.

    ends "open": the pressure acts on the face only. Its rim can move, so it is not the gradient of P·V: the tangent is
    not symmetric. A tube with open ends feels no axial thrust.
    ends "closed": the face is the wall of a cavity, closed by flat caps normal to the Cartesian z axis that hang on its
    rim and hand on their thrust. The load is the gradient of P·V, with the volume V = −½ ∮ (x n_x + y n_y) da. Cavities
    cut by symmetry planes are meant, if the planes contain the z axis or are normal to it.
    """

    face: str = field(metadata={"static": True})
    value: ArrayLike
    ends: Literal["open", "closed"] = field(default="open", metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Spring:
    """Elastic surroundings of a face (Robin): the traction −k u per area of P, k = `stiffness` [kPa/mm].

    direction "all": against every displacement u = x − X, energy ½ k |u|² per area;
    direction "normal": against the part along the normal N of the state P, energy ½ k (u · N)² per area.
    """

    face: str = field(metadata={"static": True})
    stiffness: ArrayLike
    direction: Literal["all", "normal"] = field(default="all", metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class BodyForce:
    """A force (3,) [mN/mm³ = kPa/mm] per volume of the zero-stress state P, along the local unit vectors e_i(θ).

    region: the name of a region of the mesh that it acts in, None for the whole body. Gravity along −z is
    BodyForce((0, 0, −1.04e-2)) for tissue of 1.06 g/cm³.
    """

    vector: ArrayLike
    region: str | None = field(default=None, metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Volume:
    """The cavity whose wall is a face encloses `value` [mm³]; the pressure in it is an unknown (volume-driven filling).

    The cavity and its volume are those of a `Pressure` with closed ends. A path that comes to a limit point in pressure
    passes it in volume.
    """

    face: str = field(metadata={"static": True})
    value: ArrayLike


Tie = Displacement | Stretch | Planar | Uniform | Proportional | Homogeneous | Shear
Load = Traction | Pressure | BodyForce
Condition = Tie | Load | Spring | Volume
