"""The active thick-walled tube of the paper: radii 2 and 3.5 mm, height 20 mm, fibres around, struts along the axis.

Three scenes of the same element, each modelling what its states require; pressure acts on the face "inner".
The lower end z0 is the plane of symmetry at half height, where there is one.
"""

from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from jaxmyo import checks, patches
from jaxmyo.conditions import Displacement, Planar, Proportional, Symmetry, Tie, Uniform
from jaxmyo.constants import TABLE1
from jaxmyo.coordinates import CYLINDRICAL
from jaxmyo.energies import Law, lin_yin
from jaxmyo.mesh import Mesh, structured
from jaxmyo.scene import Scene

#: Inner and outer radius and height of the paper's tube [mm].
RI, RO, HEIGHT = 2.0, 3.5, 20.0

AROUND, AXIAL = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
Ends = Literal["planar", "free"]


def radial_tube(
    elements: int,
    *,
    Ri: float = RI,
    Ro: float = RO,
    height: float = HEIGHT,
    grading: float = 1.0,
    twist: bool = False,
    law: Law = lin_yin,
    constants: Any = TABLE1,
    fibre: Any = AROUND,
    cross: Any = AXIAL,
    quadrature: int = 2,
    q_patches: Any = "column",
) -> Scene:
    """The tube with `elements` through the wall and everything else tied: u_r(R), u_z = e Z (planar ends).

    One element goes all the way round and from end to end, so that forces and moments are those of the whole tube.
    twist: a rotation u_φ = ψ Z is an unknown too. Ri may be 0, a solid cylinder. grading: size of the outermost element
    over the innermost one [–]; quadrature: Gauss points through the wall; q_patches: "column" is one q for the wall,
    as in the exact solution; else as in `Scene`. Errors: ValueError for Ri ≥ Ro, a negative radius, a height ≤ 0.
    """
    (n,) = checks.counts("elements", (elements,), 1)
    mesh = _mesh((n, 1, 1), Ri, Ro, height, grading, 2.0 * np.pi)
    supports: list[Tie] = [Uniform("r", ("phi", "z")), Proportional("z", "z"), Proportional("phi", "z")]
    if not twist:
        supports.append(Displacement("z1", "phi"))
    if Ri == 0.0:
        supports.append(Displacement("r0", "r"))
    # Nothing varies along φ; along z nothing but a twisted fibre's u_φ, whose strain is uniform too.
    return _scene(mesh, law, constants, fibre, cross, supports, (quadrature, 1, 1), q_patches)


def axisymmetric_tube(
    elements: tuple[int, int],
    *,
    ends: Ends = "planar",
    Ri: float = RI,
    Ro: float = RO,
    height: float = HEIGHT,
    grading: float = 1.0,
    law: Law = lin_yin,
    constants: Any = TABLE1,
    fibre: Any = AROUND,
    cross: Any = AXIAL,
    q_patches: Any = "column",
) -> Scene:
    """The upper half of the tube with (n_r, n_z) elements, u_r(R, Z), u_z(R, Z), no rotation; one element around.

    ends "planar": the end z1 stays plane; "free": it does as it likes. Other arguments as of `radial_tube`.
    """
    n_r, n_z = checks.counts("elements", elements, 2)
    mesh = _mesh((n_r, 1, n_z), Ri, Ro, 0.5 * height, grading, 2.0 * np.pi)
    supports = [Uniform("r", ("phi",)), Uniform("z", ("phi",)), Uniform("phi", ("r", "phi", "z"))]
    held = [Symmetry("z"), Displacement("z0", "phi"), *_ends(ends)]
    return _scene(mesh, law, constants, fibre, cross, [*supports, *held], (2, 1, 2), q_patches)


def tube_sector(
    elements: tuple[int, int, int],
    *,
    ends: Ends = "planar",
    cartesian: bool = False,
    Ri: float = RI,
    Ro: float = RO,
    height: float = HEIGHT,
    grading: float = 1.0,
    law: Law = lin_yin,
    constants: Any = TABLE1,
    fibre: Any = AROUND,
    cross: Any = AXIAL,
    q_patches: Any = "column",
) -> Scene:
    """A quarter of the upper half with (n_r, n_φ, n_z) elements in three dimensions, between symmetry planes.

    cartesian: straight-edged hexahedra in x, y, z (the symmetry planes are the faces phi0, y = 0, and phi1, x = 0)
    instead of hexahedra in r, φ, z. Forces are those of the sector, an eighth of the tube.
    fibre, cross: along e_r, e_φ, e_z, as arrays or as a function of (r, φ, z). Other arguments as of `radial_tube`.
    """
    counts = checks.counts("elements", elements, 3)
    mesh = _mesh((counts[0], counts[1], counts[2]), Ri, Ro, 0.5 * height, grading, 0.5 * np.pi)
    supports: list[Tie] = [Symmetry("z"), *_ends(ends)]
    if not cartesian:
        held = [Symmetry("phi"), Displacement("phi1", "phi")]
        return _scene(mesh, law, constants, fibre, cross, [*supports, *held], (2, 2, 2), q_patches)
    column = patches.columns(mesh, "r") if isinstance(q_patches, str) else q_patches
    held = [Displacement("phi0", "y"), Displacement("phi1", "x")]
    f, f_cross = _in_cartesian(fibre), _in_cartesian(cross)
    straight = mesh.mapped(CYLINDRICAL.position)
    return _scene(straight, law, constants, f, f_cross, [*supports, *held], (2, 2, 2), column)


def _mesh(elements: tuple[int, int, int], Ri: float, Ro: float, height: float, grading: float, angle: float) -> Mesh:
    if not 0.0 <= Ri < Ro < np.inf:
        raise ValueError(f"Ri = {Ri}, Ro = {Ro} must be radii with 0 ≤ Ri < Ro (mm)")
    if not 0.0 < height < np.inf:
        raise ValueError(f"height = {height} must be a positive length (mm)")
    if not 0.01 <= grading <= 100.0:
        raise ValueError(
            f"grading = {grading} is outside [0.01, 100] (–, size of the outermost over the innermost element)"
        )
    t = np.linspace(0.0, 1.0, elements[0] + 1)
    # An analytic map of equal steps, so that errors keep their expansion in 1/n under refinement.
    way = t if grading == 1.0 else np.expm1(t * np.log(grading)) / (grading - 1.0)
    nodes = [
        Ri + (Ro - Ri) * way,
        np.linspace(0.0, angle, elements[1] + 1),
        np.linspace(0.0, height, elements[2] + 1),
    ]
    mesh = structured(nodes, CYLINDRICAL)
    return replace(mesh, faces={**mesh.faces, "inner": mesh.face("r0"), "outer": mesh.face("r1")})


def _ends(ends: Ends) -> list[Tie]:
    return [Planar("z1", "z")] if checks.choice("ends", ends, ["planar", "free"]) == "planar" else []


def _scene(
    mesh: Mesh,
    law: Law,
    constants: Any,
    fibre: Any,
    cross: Any,
    supports: list[Tie],
    quadrature: tuple[int, int, int],
    q_patches: Any,
) -> Scene:
    if isinstance(q_patches, str):
        checks.choice("q_patches", q_patches, ["column"])
        q_patches = patches.columns(mesh, "r")
    return Scene(mesh, law, constants, fibre, cross, tuple(supports), quadrature, q_patches=q_patches)


def _in_cartesian(direction: Any) -> Any:
    """A direction along e_r, e_φ, e_z as a function of the Cartesian position."""

    def at(x: NDArray[np.float64]) -> NDArray[np.float64]:
        r, phi = np.hypot(x[:, 0], x[:, 1]), np.arctan2(x[:, 1], x[:, 0])
        local = direction(np.stack([r, phi, x[:, 2]], axis=1)) if callable(direction) else direction
        local = np.broadcast_to(np.asarray(local, dtype=np.float64), x.shape)
        cos, sin = np.cos(phi), np.sin(phi)
        return np.stack(
            [cos * local[:, 0] - sin * local[:, 1], sin * local[:, 0] + cos * local[:, 1], local[:, 2]], axis=1
        )

    return at
