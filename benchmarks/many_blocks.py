"""Many small bodies with constants of their own in one call, against a loop over single solves.

256 blocks of 2×2×2 elements, W = ½ µ (I1 − 3) + k (I4 − 1)² with fibres along x, clamped at both x faces and stretched
by 1.2 along x: `contract` and `load` under `jax.jit(jax.vmap(...))`. Warm, the best of three.

    python benchmarks/many_blocks.py [--samples 256] [--n 2]
"""

import argparse
import os
import platform
import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxmyo as jm
from jaxmyo.invariants import I1, I4

SETTINGS = jm.Settings(tolerance=1e-9, path_tolerance=1e-6)
SINGLE = 10  # samples of the loop


def law(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    """½ µ (I1 − 3) + k (I4 − 1)² [kPa]."""
    return 0.5 * constants["mu"] * (I1(C) - 3.0) + constants["k"] * (I4(C, frame) - 1.0) ** 2


def stretched(scene: jm.Scene, constants: Any) -> jm.State:
    """The state C of a block with these constants."""
    A = jm.contract(scene, T0=0.0, a_over_D=None, beta=0.0, constants=constants, settings=SETTINGS, throw=False)
    return jm.load(A, jm.Displacement("x1", "x", 0.2), settings=SETTINGS, throw=False)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--samples", type=int, default=256, help="blocks")
    parser.add_argument("--n", type=int, default=2, help="elements along an edge")
    options = parser.parse_args()
    n, samples = options.n, options.samples
    clamps = tuple(jm.Displacement(face, axis) for face in ("x0", "x1") for axis in "xyz")
    scene = jm.Scene(jm.box((1.0, 1.0, 1.0), (n, n, n)), law, {"mu": 1.0, "k": 1.0}, supports=clamps)
    rng = np.random.default_rng(0)
    constants = {name: jnp.asarray(rng.uniform(0.3, 3.0, samples)) for name in ("mu", "k")}

    @jax.jit
    @jax.vmap
    def batch(constants: Any) -> tuple[Any, ...]:
        C = stretched(scene, constants)
        return C.u, C.status, C.force_residual, C.steps, C.rejected, C.iterations

    seconds = []
    for _ in range(4):
        start = time.perf_counter()
        u, status, force, steps, rejected, iterations = jax.block_until_ready(batch(constants))
        seconds.append(time.perf_counter() - start)
    together = min(seconds[1:]) / samples

    single, difference = [], 0.0
    for i in range(min(SINGLE, samples) + 1):  # the first compiles, and is solved again
        j = max(i - 1, 0)
        start = time.perf_counter()
        C = jax.block_until_ready(stretched(scene, {name: values[j] for name, values in constants.items()}))
        single.append(time.perf_counter() - start)
        difference = max(difference, float(np.abs(C.u - u[j]).max()))
    alone = float(np.mean(single[1:]))

    name = platform.processor() or platform.machine()
    print(f"jaxmyo on jax {jax.__version__}, Python {platform.python_version()}, {name}, {os.cpu_count()} cores")
    print(f"{samples} blocks of {n}³ elements, µ and k in [0.3, 3] kPa, stretch 1.2")
    good = np.asarray(status) == jm.Status.CONVERGED
    print(f"one call:  {1 / together:8.1f} solves/s ({1e3 * together:.2f} ms each), first call {seconds[0]:.1f} s")
    print(f"in a loop: {1 / alone:8.1f} solves/s ({1e3 * alone:.2f} ms each), of {len(single) - 1}; {C.solver}")
    print(f"ratio {alone / together:.1f}; displacements differ by at most {difference:.1e} mm")
    print(f"converged: {good.mean():.1%}; largest force residual {float(np.max(np.asarray(force)[good])):.1e} mN")
    for status_ in sorted(set(np.asarray(status)[~good].tolist())):
        print(f"  {jm.Status(status_).name}: {int((np.asarray(status) == status_).sum())}")
    split = int((np.asarray(steps - rejected) > 2).sum())
    print(
        f"steps of a block, one of them at the unloaded state: {int(steps.min())} to {int(steps.max())}, rejected "
        f"{int(rejected.max())} at most; iterations {int(iterations.min())} to {int(iterations.max())}; "
        f"{split} block(s) took the load in more than one step"
    )


if __name__ == "__main__":
    main()
