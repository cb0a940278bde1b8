"""A fit of 8 constants to the 104 stresses of Lin & Yin 1998, Fig. 4: seconds, first and warm; 64 starts in one call.

Beside it what a user would do without derivatives: SciPy's least_squares with finite differences on the same compiled
predictions, from the same start.
"""

import platform
import time
from importlib.metadata import version

import jax
import numpy as np
from scipy.optimize import least_squares

import jaxmyo as jm
from jaxmyo import fitting
from jaxmyo.compiler import QUICK
from jaxmyo.fitting.cases import ACTIVE, PASSIVE
from jaxmyo.fitting.least_squares import residual_of, solve

print(f"Python {platform.python_version()},", ", ".join(f"{p} {version(p)}" for p in ("jax", "optimistix", "scipy")))
problem = fitting.sample_problem(jm.lin_yin_data(), T0=0.6, free=[*PASSIVE, *ACTIVE])
start = np.array([p.x(p.value) for p in problem.fitted])


def timed(what: str, call):  # type: ignore[no-untyped-def]
    """The result of the second call, and its seconds."""
    for kind in ("first", "warm"):
        begin, spent = time.perf_counter(), time.process_time()
        result = call()
        seconds, spent = time.perf_counter() - begin, time.process_time() - spent
        print(f"{what}, {kind}: {seconds:.2f} s ({spent:.2f} s of CPU)", flush=True)
    return result, seconds


found, ours = timed("8 constants, 104 stresses", lambda: solve(problem, start))
print(
    f"  {int(found.iterations)} iterations, rms {np.sqrt(found.sum / problem.n):.4f} kPa, converged: {found.converged}"
)

many = start + np.random.default_rng(0).normal(size=(64, len(start))) * 0.5
many[0] = start
found, _ = timed("64 starts, one vmapped call", lambda: solve(problem, many))
same = found.sum <= found.sum.min() * (1.0 + 1e-6)
print(f"  {int(found.converged.sum())} converged, {int(same.sum())} at the best; most steps {found.iterations.max()}")

residual = jax.jit(residual_of(problem, start, fitting.Loss()), compiler_options=QUICK)
peer, theirs = timed("SciPy, finite differences", lambda: least_squares(lambda x: np.asarray(residual(x)), start))
rms = np.sqrt(2.0 * peer.cost / problem.n) * np.sqrt(np.mean(problem.observed**2))
print(f"  {peer.nfev} evaluations and {peer.njev} Jacobians, rms {rms:.4f} kPa; {theirs / ours:.1f} × our time")
