"""Ready scenes: a few lines each on `jaxmyo.scene`."""

from jaxmyo.scenes.thin_sample import thin_sample

__all__ = ["thin_sample"]
