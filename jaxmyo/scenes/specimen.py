"""A square of tissue in a testing machine: what grips do where a homogeneous state is not what is measured.

Fibres along x, struts along y unless said otherwise. The lower face z0 is the plane of symmetry at half thickness, so
that forces (`State.reaction` of a grip) are those of half of the specimen.
"""

from dataclasses import replace
from typing import Any, Literal

import numpy as np

from jaxmyo import checks
from jaxmyo.conditions import Displacement, Symmetry, Tie
from jaxmyo.constants import MEASURED
from jaxmyo.energies import Law, lin_yin
from jaxmyo.mesh import Mesh, box
from jaxmyo.scene import Scene

#: Edge lengths of the specimen along x, y and its half thickness along z [mm].
SIZE = (10.0, 10.0, 0.5)


def specimen(
    elements: tuple[int, int, int] = (16, 16, 2),
    *,
    grips: Literal["clamped", "rakes"] = "clamped",
    tines: int = 4,
    size: tuple[float, float, float] = SIZE,
    law: Law = lin_yin,
    constants: Any = MEASURED,
    fibre: Any = (1.0, 0.0, 0.0),
    cross: Any = (0.0, 1.0, 0.0),
) -> Scene:
    """The specimen between grips, on a mesh of `elements`; `size` [mm], half the thickness along z.

    grips "clamped": the faces x0 and x1 are glued to the jaws, nothing slides or thins there; the machine moves one:
    `load(A, Displacement("x1", "x", 2.0))`. A uniaxial test.
    grips "rakes": on each of the four sides `tines` hooks, each the nodes of one column of elements through the
    thickness, hold the tissue along the pull and let it slide along the side; the faces are "rake x0", "rake x1",
    "rake y0", "rake y1": `load(A, Displacement("rake x1", "x", 1.0), Displacement("rake y1", "y", 1.0))`: biaxial.
    The other arguments are those of `Scene`. ValueError for more tines than fit with an element between them.
    """
    counts = checks.counts("elements", elements, 3)
    mesh = box(size, (counts[0], counts[1], counts[2]))
    supports: list[Tie] = [Symmetry("z")]
    if checks.choice("grips", grips, ["clamped", "rakes"]) == "clamped":
        supports += [Displacement(face, axis) for face in ("x0", "x1") for axis in ("x", "y", "z")]
    else:
        mesh = _with_rakes(mesh, tines, size)
        supports += [Displacement(f"rake {axis}{end}", axis) for axis in "xy" for end in "01"]
    return Scene(mesh, law, constants, fibre, cross, tuple(supports))


def _with_rakes(mesh: Mesh, tines: int, size: tuple[float, float, float]) -> Mesh:
    """The mesh with faces "rake x0" to "rake y1": the quads under the tines, evenly spaced along each side."""
    (n,) = checks.counts("tines", (tines,), 1)
    rakes = {}
    for k, axis in enumerate("xy"):
        side, columns = 1 - k, mesh.grid[1 - k] if mesh.grid else 0
        if 2 * n > columns:
            raise ValueError(f"tines = {n} need {2 * n} elements along each side; there are {columns}")
        held = np.floor((np.arange(n) + 0.5) * columns / n).astype(int)
        for end in "01":
            quads = mesh.face(f"{axis}{end}")
            middle = mesh.points[quads].mean(axis=1)[:, side]
            rakes[f"rake {axis}{end}"] = quads[np.isin((middle / size[side] * columns).astype(int), held)]
    return replace(mesh, faces={**mesh.faces, **rakes})
