"""jaxmyo: large deformation of living soft tissue by mixed finite elements on JAX.

Units everywhere: mm, kPa, mN (energies in µJ). Importing the package enables float64 in JAX, see `jaxmyo.precision`.
"""

from jaxmyo import precision  # noqa: F401  isort: skip  (first: it enables float64 before any array is made)
from jaxmyo.accuracy import Answer, converge
from jaxmyo.arc_length import Trace, trace
from jaxmyo.conditions import (
    BodyForce,
    Displacement,
    Homogeneous,
    Planar,
    Pressure,
    Proportional,
    Shear,
    Spring,
    Stretch,
    Symmetry,
    Traction,
    Uniform,
    Volume,
)
from jaxmyo.constants import LAND_ACTIVE, LAND_PASSIVE, MEASURED, PRINTED, SETS, TABLE1, Guccione, LinYin
from jaxmyo.coordinates import CARTESIAN, CYLINDRICAL, Coordinates, prolate_spheroidal
from jaxmyo.cycle import Cycle, cycle
from jaxmyo.data import Data, lin_yin_data, read_data
from jaxmyo.ellipsoid import Ventricle, helix_fibres, prolate_mesh, ventricle_mesh
from jaxmyo.energies import guccione, lin_yin
from jaxmyo.export import write_series, write_vtu
from jaxmyo.mesh import Mesh, box, structured
from jaxmyo.mesh_io import read_mesh, write_mesh
from jaxmyo.newton import Settings
from jaxmyo.patches import blocks, columns
from jaxmyo.restart import load_state, save_state
from jaxmyo.scene import Material, Scene
from jaxmyo.scenes import (
    axisymmetric_tube,
    axisymmetric_ventricle,
    radial_tube,
    specimen,
    thin_sample,
    tube_sector,
    ventricle_body,
)
from jaxmyo.solve import contract, load
from jaxmyo.state import State
from jaxmyo.status import SolveError, Status
from jaxmyo.studies import Sample, Study, load_study, saltelli_sample, sobol_sample, study

__all__ = [
    "CARTESIAN",
    "CYLINDRICAL",
    "LAND_ACTIVE",
    "LAND_PASSIVE",
    "MEASURED",
    "PRINTED",
    "SETS",
    "TABLE1",
    "Answer",
    "BodyForce",
    "Coordinates",
    "Cycle",
    "Data",
    "Displacement",
    "Guccione",
    "Homogeneous",
    "LinYin",
    "Material",
    "Mesh",
    "Planar",
    "Pressure",
    "Proportional",
    "Sample",
    "Scene",
    "Settings",
    "Shear",
    "SolveError",
    "Spring",
    "State",
    "Status",
    "Stretch",
    "Study",
    "Symmetry",
    "Trace",
    "Traction",
    "Uniform",
    "Ventricle",
    "Volume",
    "axisymmetric_tube",
    "axisymmetric_ventricle",
    "blocks",
    "box",
    "columns",
    "contract",
    "converge",
    "cycle",
    "guccione",
    "helix_fibres",
    "lin_yin",
    "lin_yin_data",
    "load",
    "load_state",
    "load_study",
    "prolate_mesh",
    "prolate_spheroidal",
    "radial_tube",
    "read_data",
    "read_mesh",
    "saltelli_sample",
    "save_state",
    "sobol_sample",
    "specimen",
    "structured",
    "study",
    "thin_sample",
    "trace",
    "tube_sector",
    "ventricle_body",
    "ventricle_mesh",
    "write_mesh",
    "write_series",
    "write_vtu",
]
