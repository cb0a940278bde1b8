"""The thin sample of living myocardium of the paper: 1.0 × 1.0 × 0.1 cm³, fibres along x, struts along y."""

from typing import Any

from jaxmyo.conditions import Homogeneous, Symmetry
from jaxmyo.constants import TABLE1
from jaxmyo.energies import Law, lin_yin
from jaxmyo.mesh import box, jitter
from jaxmyo.scene import Scene

#: Edge lengths of the sample along x (fibre), y (cross-fibre) and z (normal) [mm].
LENGTHS = (10.0, 10.0, 1.0)


def thin_sample(
    *,
    law: Law = lin_yin,
    constants: Any = TABLE1,
    elements: tuple[int, int, int] | None = None,
    distortion: float = 0.0,
    quadrature: int | None = None,
) -> Scene:
    """The sample as a scene; fibre along x, cross-fibre along y, normal along z.

    elements=None models what a homogeneous state requires: one element whose only displacements are the three
    stretches, one Gauss point. elements=(nx, ny, nz) models a body on that mesh, held by three symmetry planes, with
    2×2×2 Gauss points; distortion displaces its inner nodes by up to that fraction of an element (a patch test).
    """
    if elements is None:
        return Scene(
            box(LENGTHS, (1, 1, 1)),
            law,
            constants,
            supports=(Homogeneous(),),
            quadrature=1 if quadrature is None else quadrature,
        )
    mesh = box(LENGTHS, elements)
    mesh = jitter(mesh, distortion, seed=0) if distortion else mesh
    supports = (Symmetry("x"), Symmetry("y"), Symmetry("z"))
    return Scene(mesh, law, constants, supports=supports, quadrature=2 if quadrature is None else quadrature)
