"""Ready scenes: a few lines each on `jaxmyo.scene`."""

from jaxmyo.scenes.specimen import specimen
from jaxmyo.scenes.thin_sample import thin_sample
from jaxmyo.scenes.tube import axisymmetric_tube, radial_tube, tube_sector
from jaxmyo.scenes.ventricle import axisymmetric_ventricle, ventricle_body

__all__ = [
    "axisymmetric_tube",
    "axisymmetric_ventricle",
    "radial_tube",
    "specimen",
    "thin_sample",
    "tube_sector",
    "ventricle_body",
]
