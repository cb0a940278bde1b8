"""A cycle of the tube in one program, against a loop over `contract` and `load`, the first thing that one would write.

100 steps, states A and C at each, 32 elements through the wall, T0 = 15 kPa, with the weave (a/D = 0.2) and without.
Seconds are warm, the best of three, in one run: `python benchmarks/tube_cycle.py`.
"""

import math
import os
import platform
import time
from collections.abc import Callable
from importlib.metadata import version

import jax
import numpy as np

import jaxmyo as jm

STEPS = 100
S = np.linspace(0.0, 1.0, STEPS + 1)
TUBE = jm.radial_tube(32)


def beta(s: float) -> float:
    """Activation [–]."""
    return min(math.sin(math.pi * s) ** 2, 1.0)


def loads(s: float) -> list[jm.Pressure]:
    """Inner pressure [kPa]."""
    return [jm.Pressure("inner", 8.0 + 10.0 * beta(s))]


def in_one_program(a_over_D: float | None) -> np.ndarray:
    """Inner radii of the states C [mm], by `jaxmyo.cycle`."""
    cycle = jm.cycle(TUBE, S, T0=15.0, a_over_D=a_over_D, beta=beta, loads=loads)
    return np.asarray(cycle.C.u[:, 0, 0]) + 2.0


def in_a_loop(a_over_D: float | None) -> np.ndarray:
    """The same, state by state."""
    A, C, radii = None, None, []
    for s in S:
        A = jm.contract(TUBE, T0=15.0, a_over_D=a_over_D, beta=beta(float(s)), start=A)
        C = jm.load(A, *loads(float(s)), start=C)
        radii.append(float(C.u[0, 0]) + 2.0)
    return np.array(radii)


def seconds(function: Callable[[float | None], np.ndarray], a_over_D: float | None) -> tuple[float, float, np.ndarray]:
    """(first call, best of three more, result)."""
    times = []
    for _ in range(4):
        start = time.perf_counter()
        result = function(a_over_D)
        times.append(time.perf_counter() - start)
    return times[0], min(times[1:]), result


def main() -> None:
    """Measure and print."""
    print(
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, jax {version('jax')}, {jax.devices()}"
    )
    print(f"{STEPS} steps, {len(TUBE.mesh.cells)} elements; seconds")
    print(f"{'weave':>6} {'cycle: first':>13} {'warm':>7} {'loop: warm':>11} {'ratio':>6} {'ri differ [mm]':>15}")
    for a_over_D in (0.2, None):
        first, warm, radii = seconds(in_one_program, a_over_D)
        _, loop, same = seconds(in_a_loop, a_over_D)
        difference = np.abs(radii - same).max()
        name = "no" if a_over_D is None else f"{a_over_D:g}"
        print(f"{name:>6} {first:13.1f} {warm:7.3f} {loop:11.3f} {loop / warm:6.1f} {difference:15.1e}")


if __name__ == "__main__":
    main()
