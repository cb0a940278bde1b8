"""How many pairs of states of the thin sample are solved per second, beside a loop over MINPACK's hybrid method.

State A from rest (T0 in [0.1, 60] kPa, a/D in [0, 1/4], β = 1), then state C under its tensions, stretched by 1.2 along
the fibres and free across them. Ours: the scene's own equations in its tied unknowns, `jax.lax.map` over chunks of a
batch, a part of the batch in each of as many threads as there are cores, warm, the best of three. The loop:
`scipy.optimize.root(method="hybr")` on the hand-derived equations of `tests/reference.py` in (ln λ1, ln λ2, q) and in
ln λ2, activated and stretched in as few equal steps, of 1, 2, 5, 10 or 20, as it takes to reach the states.

    python benchmarks/sample_pairs.py [--batch 20000] [--chunk 64] [--loop 200]
"""

import argparse
import os
import platform
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy
import scipy.optimize

import jaxmyo as jm

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
import reference

STRETCH = 1.2
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def ours(T0: np.ndarray, a_over_D: np.ndarray, chunk: int) -> tuple[float, dict[str, np.ndarray]]:
    """Seconds per pair, and the states."""
    sample = jm.thin_sample()

    def pair(at: tuple[Any, Any]) -> dict[str, Any]:
        A = jm.contract(sample, T0=at[0], a_over_D=at[1], throw=False)
        C = jm.load(A, jm.Stretch("x", STRETCH), throw=False)
        states = {"A": A, "C": C}
        return {name: jnp.stack([getattr(s, name) for s in states.values()]) for name in ("status", "residual")} | {
            f"stretch {key}": jnp.diagonal(s.F[0, 0])[:2] for key, s in states.items()
        }

    program = jax.jit(lambda *at: jax.lax.map(pair, at, batch_size=chunk))
    parts = [
        (jnp.asarray(x), jnp.asarray(y)) for x, y in zip(np.split(T0, CORES), np.split(a_over_D, CORES), strict=True)
    ]

    def all_of_it() -> list[dict[str, Any]]:
        return list(pool.map(lambda part: jax.block_until_ready(program(*part)), parts))

    seconds = []
    with ThreadPoolExecutor(CORES) as pool:
        all_of_it()
        for _ in range(3):
            start = time.perf_counter()
            found = all_of_it()
            seconds.append(time.perf_counter() - start)
    states = {name: np.concatenate([np.asarray(part[name]) for part in found]) for name in found[0]}
    return min(seconds) / len(T0), states


def hybrid(c: dict[str, float], T0: float, a_over_D: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """The stretches along and across the fibres in A and in C."""
    weave = reference.PI_2 * a_over_D

    def tensions(z: np.ndarray) -> tuple[float, float]:
        return -0.25 * z[2] * weave * np.exp(-0.5 * z[0]), 0.5 * z[2] * np.exp(z[1])

    def of_A(z: np.ndarray, beta: float) -> list[float]:
        along, across = reference.forces(reference.law(c, beta, z[0], z[1]), z[0], z[1])
        T_f, T_cf = tensions(z)
        return [along + beta * T0 + T_f, across + T_cf, reference.constraint(np.exp(z[0]), np.exp(z[1]), a_over_D)]

    z = np.zeros(3)
    for beta in np.linspace(0.0, 1.0, steps + 1)[1:]:
        z = scipy.optimize.root(of_A, z, args=(beta,), method="hybr", options={"xtol": 1e-12}).x
    _, T_cf = tensions(z)

    def of_C(b: np.ndarray, a: float) -> float:
        return reference.forces(reference.law(c, 1.0, a, b[0]), a, b[0])[1] + T_cf

    b = z[1:2]
    for a in np.linspace(z[0], np.log(STRETCH), steps + 1)[1:]:
        b = scipy.optimize.root(of_C, b, args=(a,), method="hybr", options={"xtol": 1e-12}).x
    return np.exp(z[:2]), np.array([STRETCH, np.exp(b[0])])


def loop(c: dict[str, float], T0: np.ndarray, a_over_D: np.ndarray, states: dict[str, np.ndarray]) -> tuple[Any, int]:
    """Seconds of each pair that the hybrid method finds, and how many it does not."""
    seconds, failed = [], 0
    for i, at in enumerate(zip(T0, a_over_D, strict=True)):
        for steps in (1, 2, 5, 10, 20):
            start = time.perf_counter()
            A, C = hybrid(c, *at, steps)
            elapsed = time.perf_counter() - start
            if max(np.abs(A - states["stretch A"][i]).max(), np.abs(C - states["stretch C"][i]).max()) <= 1e-8:
                seconds.append(elapsed)
                break
        else:
            failed += 1
    return np.array(seconds), failed


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--batch", type=int, default=20_000, help="pairs in a batch")
    parser.add_argument("--chunk", type=int, default=64, help="pairs that are solved together")
    parser.add_argument("--loop", type=int, default=200, help="pairs that the hybrid method is timed on")
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    T0, a_over_D = rng.uniform(0.1, 60.0, options.batch), rng.uniform(0.0, 0.25, options.batch)
    each, states = ours(T0, a_over_D, options.chunk)
    some = slice(0, options.loop)
    with np.errstate(all="ignore"):
        seconds, failed = loop(reference.SETS["table1"], T0[some], a_over_D[some], states)
    name = f"{platform.processor() or platform.machine()}, {CORES} cores"
    print(f"jax {jax.__version__}, scipy {scipy.__version__}, Python {platform.python_version()}, {name}")
    good = (states["status"] == jm.Status.CONVERGED).all(axis=1)
    print(f"{options.batch} pairs, {options.chunk} together: {1.0 / each:.0f} pairs/s ({1e6 * each:.1f} µs each)")
    print(f"converged {good.mean():.2%}, largest relative residual {states['residual'][good].max():.1e}")
    print(
        f"hybrid method, one by one: {1e3 * seconds.mean():.2f} ms each, {failed} of {options.loop} not found; "
        f"ratio {seconds.mean() / each:.0f}"
    )


if __name__ == "__main__":
    main()
