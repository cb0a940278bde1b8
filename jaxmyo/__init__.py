"""jaxmyo: large deformation of living soft tissue by mixed finite elements on JAX.

Units everywhere: mm, kPa, mN (energies in µJ). Importing the package enables float64 in JAX, see `jaxmyo.precision`.
"""

from jaxmyo import precision  # noqa: F401  isort: skip  (first: it enables float64 before any array is made)
from jaxmyo.conditions import Displacement, Homogeneous, Planar, Stretch, Symmetry, Traction
from jaxmyo.constants import MEASURED, PRINTED, SETS, TABLE1, LinYin
from jaxmyo.energies import lin_yin
from jaxmyo.mesh import Mesh, box
from jaxmyo.newton import Settings
from jaxmyo.scene import Scene
from jaxmyo.scenes import thin_sample
from jaxmyo.solve import contract, load
from jaxmyo.state import State
from jaxmyo.status import SolveError, Status

__all__ = [
    "MEASURED",
    "PRINTED",
    "SETS",
    "TABLE1",
    "Displacement",
    "Homogeneous",
    "LinYin",
    "Mesh",
    "Planar",
    "Scene",
    "Settings",
    "SolveError",
    "State",
    "Status",
    "Stretch",
    "Symmetry",
    "Traction",
    "box",
    "contract",
    "lin_yin",
    "load",
    "thin_sample",
]
