"""A left ventricle: a truncated ellipsoid with helical fibres, as a body of revolution and in three dimensions.

Both scenes model the same body with the same supports, so that each is a check of the other. Faces "endo", "epi",
"base"; the cavity is the one of `Pressure("endo", P, ends="closed")` and `Volume("endo", V)`.
"""

from dataclasses import replace
from typing import Any, Literal

import numpy as np

from jaxmyo import checks
from jaxmyo.conditions import Displacement, Tie, Uniform
from jaxmyo.constants import TABLE1
from jaxmyo.ellipsoid import Ventricle, helix_fibres, prolate_mesh, ventricle_mesh
from jaxmyo.energies import Law, lin_yin
from jaxmyo.mesh import Mesh
from jaxmyo.scene import Scene

Base = Literal["sliding", "clamped"]
#: The fibre angle inside and outside [degrees], see `helix_fibres`.
HELIX = (60.0, -60.0)


def axisymmetric_ventricle(
    ventricle: Ventricle,
    elements: tuple[int, int],
    *,
    base: Base = "sliding",
    helix: tuple[float, float] = HELIX,
    law: Law = lin_yin,
    constants: Any = TABLE1,
    q_patches: Any = 1,
    p_patches: Any = None,
) -> Scene:
    """The ventricle as a body of revolution in its prolate coordinates, u_λ(λ, μ), u_μ(λ, μ) and the twist u_φ(λ, μ).

    elements: (through the wall, from the apex to the base); one element goes all the way round, so that forces and
    volumes are those of the whole ventricle. The apex stays on the axis.
    base "sliding": the base stays in its plane and slides on it without friction, the outer rim of the base does not
    turn about the axis (which takes no moment: the twist of the body is told from there); this needs base_z = 0, where
    the base is μ = π/2. base "clamped": the base does not move.
    helix: fibre angle inside and outside [degrees]; q_patches: an integer m is m multipliers q of the weave for each
    column of elements through the wall, each for as many of its elements; otherwise as of `Scene`. Where the fibres
    turn through the wall, h = 0 at every depth leaves a thin wall no motion: with q_patches=None, one q per element, it
    contracts less the finer the mesh, while 1 converges, with a smooth q (`benchmarks/ventricle.py`).
    Errors: a ValueError for a sliding base that is not the equator, and for more q than elements in a column.
    """
    n_wall, n_meridian = checks.counts("elements", elements, 2)
    mesh = prolate_mesh(ventricle, (n_wall, n_meridian, 1))
    mesh = _with_rim(mesh, mesh.face("base"), mesh.face("epi"))
    supports: list[Tie] = [Uniform(axis, ("phi",)) for axis in mesh.coordinates.axes]
    supports.append(Displacement("apex", "mu"))
    if checks.choice("base", base, ["sliding", "clamped"]) == "clamped":
        supports += [Displacement("base", axis) for axis in mesh.coordinates.axes]
    else:
        if ventricle.base_z != 0.0:
            raise ValueError(
                f"base = 'sliding' needs a base at the equator, base_z = 0, since that is a plane μ = const.; got "
                f"base_z = {ventricle.base_z:g} mm. Take base = 'clamped', or ventricle_body"
            )
        supports += [Displacement("base", "mu"), Displacement("rim", "phi")]
    fibre, cross = helix_fibres(ventricle, *helix, coordinates=mesh.coordinates)
    patch = {"p_patches": p_patches, "q_patches": _through_the_wall(q_patches, n_wall, n_meridian)}
    return Scene(mesh, law, constants, fibre, cross, tuple(supports), (2, 2, 1), **patch)


def ventricle_body(
    ventricle: Ventricle,
    elements: tuple[int, int, int],
    *,
    base: Base = "sliding",
    helix: tuple[float, float] = HELIX,
    law: Law = lin_yin,
    constants: Any = TABLE1,
    q_patches: Any = 1,
    p_patches: Any = None,
) -> Scene:
    """The same ventricle in three dimensions and Cartesian coordinates, hexahedra everywhere, also at the apex.

    elements: (through the wall, from the square at the apex to the base, around), as of `ventricle_mesh`.
    base "sliding": the base stays in its plane; three nodes of its outer rim, which move along their radii only, keep
    the body from moving and turning in that plane, which takes no force; "clamped": the base does not move.
    Other arguments as of `axisymmetric_ventricle`.
    """
    counts = checks.counts("elements", elements, 3)
    mesh = ventricle_mesh(ventricle, (counts[0], counts[1], counts[2]))
    supports: list[Tie] = [Displacement("base", "z")]
    if checks.choice("base", base, ["sliding", "clamped"]) == "clamped":
        supports += [Displacement("base", "x"), Displacement("base", "y")]
    else:
        rim = np.intersect1d(mesh.face("base"), mesh.face("epi"))
        x, y = mesh.points[rim, 0], mesh.points[rim, 1]
        held = {"rim+x": rim[np.argmax(x)], "rim-x": rim[np.argmin(x)], "rim+y": rim[np.argmax(y)]}
        points = {name: np.full((1, 4), node) for name, node in held.items()}
        mesh = replace(mesh, faces={**mesh.faces, **points})
        supports += [Displacement("rim+x", "y"), Displacement("rim-x", "y"), Displacement("rim+y", "x")]
    fibre, cross = helix_fibres(ventricle, *helix)
    patch = {"p_patches": p_patches, "q_patches": _through_the_wall(q_patches, counts[0], len(mesh.cells) // counts[0])}
    return Scene(mesh, law, constants, fibre, cross, tuple(supports), **patch)


def _with_rim(mesh: Mesh, base: Any, epi: Any) -> Mesh:
    """The mesh with a face "rim", the nodes that both faces share, each as a quad of one node."""
    nodes = np.intersect1d(base, epi)
    return replace(mesh, faces={**mesh.faces, "rim": np.repeat(nodes[:, None], 4, axis=1)})


def _through_the_wall(q_patches: Any, n_wall: int, n_layer: int) -> Any:
    """Patches (n_elements,) with so many q in each column; elements are numbered layer by layer from the inside."""
    if isinstance(q_patches, bool) or not isinstance(q_patches, int):
        return q_patches
    if not 1 <= q_patches <= n_wall:
        raise ValueError(f"q_patches = {q_patches} must be in [1, {n_wall}], the number of elements through the wall")
    part = np.arange(n_wall) * q_patches // n_wall
    return (part[:, None] * n_layer + np.arange(n_layer)).reshape(-1)
