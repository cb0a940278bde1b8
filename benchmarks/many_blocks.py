"""Many small bodies with constants of their own in one call, against a loop over single solves.

256 blocks of 2×2×2 elements, W = ½ µ (I1 − 3) + k (I4 − 1)² with fibres along x, clamped at both x faces and stretched
by 1.2 along x: `contract` and `load` under `jax.jit(jax.vmap(...))`. Warm, the best of three.

    python benchmarks/many_blocks.py [--samples 256] [--n 2]
"""

import argparse
import os
import platform
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec

import jaxmyo as jm
from jaxmyo.invariants import I1, I4

SETTINGS = jm.Settings(tolerance=1e-9, path_tolerance=1e-6)
SINGLE = 10  # samples of the loop
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def law(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    """½ µ (I1 − 3) + k (I4 − 1)² [kPa]."""
    return 0.5 * constants["mu"] * (I1(C) - 3.0) + constants["k"] * (I4(C, frame) - 1.0) ** 2


def stretched(scene: jm.Scene, constants: Any) -> jm.State:
    """The state C of a block with these constants."""
    A = jm.contract(scene, T0=0.0, a_over_D=None, beta=0.0, constants=constants, settings=SETTINGS, throw=False)
    return jm.load(A, jm.Displacement("x1", "x", 0.2), settings=SETTINGS, throw=False)


def timed(batch: Callable[..., Any], constants: Any) -> tuple[Any, float, float]:
    """What a batch finds, the seconds of its first call, and those of the fastest of five more."""
    seconds = []
    for _ in range(6):
        start = time.perf_counter()
        found = jax.block_until_ready(batch(constants))
        seconds.append(time.perf_counter() - start)
    return found, seconds[0], min(seconds[1:])


def main() -> None:
    """Measure and print."""
    jax.config.update("jax_num_cpu_devices", CORES)
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--samples", type=int, default=256, help="blocks")
    parser.add_argument("--n", type=int, default=2, help="elements along an edge")
    options = parser.parse_args()
    n, samples = options.n, options.samples
    clamps = tuple(jm.Displacement(face, axis) for face in ("x0", "x1") for axis in "xyz")
    scene = jm.Scene(jm.box((1.0, 1.0, 1.0), (n, n, n)), law, {"mu": 1.0, "k": 1.0}, supports=clamps)
    rng = np.random.default_rng(0)
    constants = {name: jnp.asarray(rng.uniform(0.3, 3.0, samples)) for name in ("mu", "k")}

    @jax.vmap
    def batch(constants: Any) -> tuple[Any, ...]:
        C = stretched(scene, constants)
        return C.u, C.status, C.force_residual, C.steps, C.rejected, C.iterations

    along = PartitionSpec("cores")
    mesh = Mesh(np.array(jax.devices()), ("cores",))
    split = jax.shard_map(batch, mesh=mesh, in_specs=along, out_specs=along, check_vma=False)
    found, first, one = timed(jax.jit(batch), constants)
    again, first_split, every = timed(jax.jit(split), constants)
    u, status, force, steps, rejected, iterations = found

    single, difference = [], 0.0
    for i in range(min(SINGLE, samples) + 1):  # the first compiles, and is solved again
        j = max(i - 1, 0)
        start = time.perf_counter()
        C = jax.block_until_ready(stretched(scene, {name: values[j] for name, values in constants.items()}))
        single.append(time.perf_counter() - start)
        difference = max(difference, float(np.abs(C.u - u[j]).max()))
    alone = float(np.mean(single[1:]))

    name = platform.processor() or platform.machine()
    print(f"jaxmyo on jax {jax.__version__}, Python {platform.python_version()}, {name}, {CORES} cores")
    print(f"{samples} blocks of {n}³ elements, µ and k in [0.3, 3] kPa, stretch 1.2")
    good = np.asarray(status) == jm.Status.CONVERGED
    calls = {"one device": (one, first), f"{CORES} devices": (every, first_split), "in a loop": (alone * samples, None)}
    for name, (seconds, compiled) in calls.items():
        each = seconds / samples
        print(f"{name + ':':11} {1 / each:8.1f} solves/s ({1e3 * each:.2f} ms each)", end="")
        print(f", first call {compiled:.1f} s" if compiled else f", of {len(single) - 1}; {C.solver}")
    apart = float(np.abs(found[0] - again[0]).max())
    print(f"ratios to the loop {alone * samples / one:.1f}, {alone * samples / every:.1f}; displacements differ by at")
    print(f"most {difference:.1e} mm from those of the loop, by {apart:.1e} mm between one device and {CORES}")
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
