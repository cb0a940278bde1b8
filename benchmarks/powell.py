"""How fast the free contraction is solved, beside the paper's own method, Powell's hybrid (MINPACK hybrd).

The same discrete problem (unknowns, residual, precision) is solved by `scipy.optimize.root(method="hybr")` with the
compiled residual, and by `jax.vmap(jaxmyo.contract)`. Powell's method starts at rest and applies the activation in
as few equal steps, of 1, 2, 5, 10 or 20, as it takes to reach the right state (within 1e-8 of the displacement);
samples on which every number of steps fails are counted as failures, and their time is left out. Ours is warm.

    python benchmarks/powell.py [--samples N]
"""

import argparse
import platform
import time
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import scipy
import scipy.optimize

import jaxmyo as jm
from jaxmyo import lagrangian


def ours(scene, T0, a_over_D, repeat=5):
    """Seconds per solve of one warm vmapped call, the displacements, and the largest relative residual."""

    def one(T0, a_over_D):
        A = jm.contract(scene, T0=T0, a_over_D=a_over_D)
        return A.u, A.status, A.residual

    batch = jax.jit(jax.vmap(one))
    jax.block_until_ready(batch(T0, a_over_D))
    seconds = []
    for _ in range(repeat):
        start = time.perf_counter()
        u, status, residual = jax.block_until_ready(batch(T0, a_over_D))
        seconds.append(time.perf_counter() - start)
    assert np.all(np.asarray(status) == jm.Status.CONVERGED)
    return min(seconds) / len(T0), np.asarray(u), float(np.max(residual))


def powell(scene, T0, a_over_D, expected):
    """Seconds per solve of Powell's hybrid on each sample that it solves, and the number that it does not."""
    state = jm.contract(scene, T0=T0[0], a_over_D=a_over_D[0])
    system = state.system

    @jax.jit
    def residual(z, T0, a_over_D, beta):
        return lagrangian.residual(system, z, state.inputs._replace(T0=T0, a_over_D=a_over_D, beta=beta))

    np.asarray(residual(np.zeros(system.size), T0[0], a_over_D[0], 1.0))
    seconds, failed = [], 0
    for tension, ratio, u in zip(T0, a_over_D, expected, strict=True):
        for steps in (1, 2, 5, 10, 20):
            start = time.perf_counter()
            z = np.zeros(system.size)
            for beta in np.linspace(0.0, 1.0, steps + 1)[1:]:
                z = scipy.optimize.root(
                    lambda z, *inputs: np.asarray(residual(z, *inputs)),
                    z,
                    args=(tension, ratio, beta),
                    method="hybr",
                    options={"xtol": 1e-12},
                ).x
            elapsed = time.perf_counter() - start
            found = np.asarray(system.displacements(jnp.asarray(z), state.inputs))
            if np.abs(found - u).max() <= 1e-8 * np.abs(u).max():
                seconds.append(elapsed)
                break
        else:
            failed += 1
    return np.array(seconds), failed


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--samples", type=int, default=100, help="samples that Powell's method is timed on")
    samples = parser.parse_args().samples
    warnings.simplefilter("ignore", RuntimeWarning)
    rng = np.random.default_rng(0)
    print(f"jax {jax.__version__}, scipy {scipy.__version__}, Python {platform.python_version()}, {platform.machine()}")
    print("T0 in [0.1, 60] kPa, a/D in [0, 1/4], beta = 1, from rest")
    print("| scene | unknowns | batch | ours, ms per solve | residual | Powell, median ms | ratio | Powell fails |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for name, scene, batch, timed in (
        ("homogeneous sample", jm.thin_sample(), 1000, samples),
        ("one element, 2×2×2 points", jm.thin_sample(elements=(1, 1, 1)), 1000, samples),
        ("4×4×2 elements", jm.thin_sample(elements=(4, 4, 2)), 8, 8),
    ):
        T0, a_over_D = rng.uniform(0.1, 60.0, batch), rng.uniform(0.0, 0.25, batch)
        each, u, residual = ours(scene, T0, a_over_D)
        times, failed = powell(scene, T0[:timed], a_over_D[:timed], u[:timed])
        system = jm.contract(scene, T0=1.0, a_over_D=0.2).system
        median = f"{1e3 * np.median(times):.3g} | {np.median(times) / each:.2g}" if len(times) else "– | –"
        own = f"{system.size} | {batch} | {1e3 * each:.3g} | {residual:.0e}"
        print(f"| {name} | {own} | {median} | {failed} of {timed} |", flush=True)


if __name__ == "__main__":
    main()
