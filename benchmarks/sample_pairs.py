"""How many pairs of states of the thin sample are solved per second, beside a loop over MINPACK's hybrid method.

State A from rest (T0 in [0.1, 60] kPa, a/D in [0, 1/4], β = 1), then state C under its tensions, stretched by 1.2 along
the fibres and free across them. Ours: the scene's own equations in its tied unknowns, `jax.vmap` over a batch, a part
of it in each of as many threads as there are cores, warm, the best of three. Four ways: with the default settings, and
with states on the way to 1e-2, longer load steps, and final states to 1e-10; each as drawn, and ordered by T0, as paths
of like tension take as many steps (the time of ordering included). The loop:
`scipy.optimize.root(method="hybr")` on the hand-derived equations of `tests/reference.py` in (ln λ1, ln λ2, q) and in
ln λ2, activated and stretched in as few equal steps, of 1, 2, 5, 10 or 20, as it takes to reach the states.

    python benchmarks/sample_pairs.py [--batch 20000] [--loop 200]
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
LOOSE = jm.Settings(tolerance=1e-10, path_tolerance=1e-2, move=0.6)
WAYS = {
    "as drawn": (False, jm.Settings()),
    "ordered by T0": (True, jm.Settings()),
    "loose path": (False, LOOSE),
    "ordered, loose path": (True, LOOSE),
}
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def ours(
    T0: np.ndarray, a_over_D: np.ndarray, ordered: bool, settings: jm.Settings
) -> tuple[float, dict[str, np.ndarray]]:
    """Seconds per pair, and the states."""
    sample = jm.thin_sample()

    @jax.jit
    @jax.vmap
    def pairs(T0: Any, a_over_D: Any) -> dict[str, Any]:
        A = jm.contract(sample, T0=T0, a_over_D=a_over_D, settings=settings, throw=False)
        C = jm.load(A, jm.Stretch("x", STRETCH), settings=settings, throw=False)
        states = {"A": A, "C": C}
        return {name: jnp.stack([getattr(s, name) for s in states.values()]) for name in ("status", "residual")} | {
            f"stretch {key}": jnp.diagonal(s.F[0, 0])[:2] for key, s in states.items()
        }

    def all_of_it() -> dict[str, np.ndarray]:
        order = np.argsort(T0) if ordered else np.arange(len(T0))
        parts = [(T0[of_core], a_over_D[of_core]) for of_core in (order[i::CORES] for i in range(CORES))]
        found = list(pool.map(lambda part: jax.tree.map(np.asarray, pairs(*part)), parts))
        states = {name: np.empty((len(T0), *part.shape[1:]), part.dtype) for name, part in found[0].items()}
        for i, part in enumerate(found):
            for name in states:
                states[name][order[i::CORES]] = part[name]
        return states

    seconds = []
    with ThreadPoolExecutor(CORES) as pool:
        all_of_it()
        for _ in range(3):
            start = time.perf_counter()
            states = all_of_it()
            seconds.append(time.perf_counter() - start)
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
    parser.add_argument("--loop", type=int, default=200, help="pairs that the hybrid method is timed on")
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    T0, a_over_D = rng.uniform(0.1, 60.0, options.batch), rng.uniform(0.0, 0.25, options.batch)
    name = f"{platform.processor() or platform.machine()}, {CORES} cores"
    print(f"jax {jax.__version__}, scipy {scipy.__version__}, Python {platform.python_version()}, {name}")
    print(f"{options.batch} pairs")
    each: dict[str, float] = {}
    exact: dict[str, np.ndarray] = {}
    for way, how in WAYS.items():
        each[way], states = ours(T0, a_over_D, *how)
        exact = exact or states
        good = (states["status"] == jm.Status.CONVERGED).all(axis=1)
        print(f"{way + ':':20} {1.0 / each[way]:7.0f} pairs/s ({1e6 * each[way]:.1f} µs each), ", end="")
        print(
            f"converged {good.mean():.2%}, largest relative residual {states['residual'][good].max():.1e}", flush=True
        )
    some = slice(0, options.loop)
    with np.errstate(all="ignore"):
        seconds, failed = loop(reference.SETS["table1"], T0[some], a_over_D[some], exact)
    ratios = ", ".join(f"{seconds.mean() / own:.0f}" for own in each.values())
    print(f"hybrid method, one by one: {1e3 * seconds.mean():.2f} ms each, {failed} of {options.loop} not found")
    print(f"ratios {ratios}")


if __name__ == "__main__":
    main()
