"""How fast a large body is assembled: residual and tangent, into the upper triangle of one sparse matrix.

The block of `benchmarks/block.py`, at random displacements of 1e-3/n mm. Warm, the median of 7.

    python benchmarks/assembly.py [--n 16 24 32]
"""

import argparse
import os
import platform
import time
from typing import Any

import jax
import numpy as np

import jaxmyo as jm
from jaxmyo import solve
from jaxmyo.invariants import I1, I4
from jaxmyo.sparse import Sparse

REPEAT = 7


def law(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    """½ µ (I1 − 3) + k (I4 − 1)² [kPa]."""
    return 0.5 * constants["mu"] * (I1(C) - 3.0) + constants["k"] * (I4(C, frame) - 1.0) ** 2


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--n", type=int, nargs="+", default=[16, 24, 32], help="elements along an edge")
    options = parser.parse_args()
    name = platform.processor() or platform.machine()
    print(f"jaxmyo on jax {jax.__version__}, Python {platform.python_version()}, {name}, {os.cpu_count()} cores")
    print("| n | unknowns | entries | pattern [s] | first [s] | warm [s] | µs per element | fastest, slowest |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    rng = np.random.default_rng(0)
    clamps = tuple(jm.Displacement(face, axis) for face in ("x0", "x1") for axis in "xyz")
    for n in options.n:
        scene = jm.Scene(jm.box((1.0, 1.0, 1.0), (n, n, n)), law, {"mu": 1.0, "k": 1.0}, supports=clamps)
        system, inputs, _ = solve.contraction(scene, 0.0, None, 0.0, None, None)
        start = time.perf_counter()
        sparse = Sparse(system)
        pattern = time.perf_counter() - start
        seconds = []
        for _ in range(1 + REPEAT):
            z = np.ones(system.size)  # the pressure at rest is 1 kPa
            z[: system.n_u] = rng.uniform(-1e-3 / n, 1e-3 / n, system.n_u)  # others each time: the last is remembered
            start = time.perf_counter()
            at = sparse.at(z, inputs)
            seconds.append(time.perf_counter() - start)
        assert np.all(at.finite)
        first, warm = seconds[0], float(np.median(seconds[1:]))
        each = [1e6 * t / n**3 for t in (warm, min(seconds[1:]), max(seconds[1:]))]
        print(
            f"| {n} | {system.size} | {sparse.pattern.nnz} | {pattern:.2f} | {first:.2f} | {warm:.4f} | {each[0]:.2f} "
            f"| {each[1]:.2f}, {each[2]:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
