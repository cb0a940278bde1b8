"""The one place where jaxmyo touches JAX's global settings.

Importing the package switches on `jax_enable_x64`: the pressure and the weave multiplier of an incompressible body are
found by a saddle-point system that float32 cannot resolve, so that a float32 default would give wrong digits in
silence. Code that shares the process with jaxmyo gets float64 where it asks JAX for the default floating-point type.
Nothing else is changed on import; the persistent compilation cache is set by the command line only.
"""

import jax

jax.config.update("jax_enable_x64", True)
