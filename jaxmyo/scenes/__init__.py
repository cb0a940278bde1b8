"""Ready scenes: a few lines each on `jaxmyo.scene`."""

from jaxmyo.scenes.thin_sample import thin_sample
from jaxmyo.scenes.tube import axisymmetric_tube, radial_tube, tube_sector

__all__ = ["axisymmetric_tube", "radial_tube", "thin_sample", "tube_sector"]
