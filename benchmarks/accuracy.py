"""Errors that `jaxmyo.converge` promises, and those that it has: 50 random scenes with a known solution.

Half are thin samples (a homogeneous state, one element is exact), half thick-walled tubes of random T0, a/D and
pressure, held against their exact solutions, which need no elements. For each target: the share of the scenes whose
true error is below it, the share of the estimates that were, the true errors, and the median CPU time of a warm run.
Writes a figure with --figure FILE.
"""

import argparse
import platform
import sys
import time
from importlib.metadata import version
from pathlib import Path

import jax
import numpy as np

import jaxmyo as jm
from jaxmyo.paper import exact_tube
from jaxmyo.paper.exact_tube import Muscle, Pair, Wall
from jaxmyo.tradeoff import exact

TARGETS = (1e-2, 1e-4, 1e-6, 1e-8)


def tubes(count, seed):
    """(attempt, output, exact value) of random tubes: the outer radius [mm] of state C."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        T0, a_over_D, pressure = rng.uniform(5.0, 30.0), rng.uniform(0.05, 0.25), rng.uniform(5.0, 18.0)

        def attempt(n, settings, T0=T0, a_over_D=a_over_D, pressure=pressure):
            A = jm.contract(jm.radial_tube(n), T0=T0, a_over_D=a_over_D, settings=settings)
            return jm.load(A, jm.Pressure("inner", pressure), settings=settings)

        # The exact solution is found from the elements' own, coarse, state.
        A = jm.contract(jm.radial_tube(8), T0=T0, a_over_D=a_over_D)
        C = jm.load(A, jm.Pressure("inner", pressure))
        walls = [
            Wall(2.0 + float(s.u[0, 0]), 1.0 + float(s.u[-1, 2]) / 20.0, q) for s, q in ((A, float(A.q[0])), (C, 0.0))
        ]
        wall = exact_tube.pair(Muscle(jm.TABLE1, T0, 1.0, a_over_D), "uniform", pressure, Pair(*walls)).C
        yield attempt, lambda C: 3.5 + float(np.asarray(C.u)[:, 0][C.scene.mesh.face("outer")[0, 0]]), wall.ro


def samples(count, seed):
    """(attempt, output, exact value) of random samples: the Cauchy stress [kPa] along the fibres of state C."""
    rng = np.random.default_rng(seed)
    sample = jm.thin_sample()
    for _ in range(count):
        T0, a_over_D, stretch = rng.uniform(1.0, 60.0), rng.uniform(0.0, 0.25), rng.uniform(1.05, 1.25, 2)

        def attempt(n, settings, T0=T0, a_over_D=a_over_D, stretch=stretch):
            A = jm.contract(sample, T0=T0, a_over_D=a_over_D, settings=settings)
            return jm.load(A, jm.Stretch("x", stretch[0]), jm.Stretch("y", stretch[1]), settings=settings)

        A = jm.contract(sample, T0=T0, a_over_D=a_over_D)
        f, c, _ = np.log(np.asarray(A.mean("stretches")))
        found = exact.sample(Muscle(jm.TABLE1, T0, 1.0, a_over_D), tuple(stretch), near=(f, c, float(A.q[0])))
        yield attempt, lambda C: float(C.mean("cauchy")[0, 0]), found.sigma11


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--figure", type=Path, help="errors against targets, and seconds")
    options = parser.parse_args()
    half = options.scenes // 2
    kinds = {"sample": samples(half, options.seed), "tube": tubes(options.scenes - half, options.seed)}
    scenes = [(kind, *scene) for kind, every in kinds.items() for scene in every]
    print(f"Python {platform.python_version()}, jax {version('jax')}, {jax.devices()[0]}; {len(scenes)} scenes")
    rows = []
    for target in TARGETS:
        for kind, attempt, output, true in scenes:
            answer = jm.converge(attempt, output, accuracy=target)  # compiles
            begun = time.process_time()
            answer = jm.converge(attempt, output, accuracy=target)
            spent = time.process_time() - begun
            rows.append(
                (target, kind, abs(answer.value / true - 1.0), answer.error, spent, answer.reached, answer.elements[-1])
            )
        print("target  scenes  true error below  estimate below  median, worst true error  finest mesh  CPU s (median)")
        for kind in kinds:
            mine = [r for r in rows if r[0] == target and r[1] == kind]
            errors = np.array([r[2] for r in mine])
            below, promised = np.mean(errors <= target), np.mean([r[5] for r in mine])
            finest, spent = max(r[6] for r in mine), np.median([r[4] for r in mine])
            worst = f"{np.median(errors):.1e}, {errors.max():.1e}"
            print(f"{target:.0e}  {kind:6}  {below:.0%}  {promised:.0%}  {worst}  {finest}  {spent:.3f}")
        sys.stdout.flush()
    if options.figure:
        draw(rows, options.figure)


def draw(rows, path):
    """True and estimated errors against the target, and the CPU seconds."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
    for kind, colour, shift in (("tube", "C0", 0.8), ("sample", "C1", 1.25)):
        mine = [r for r in rows if r[1] == kind]
        targets = np.array([r[0] for r in mine])
        left.loglog(shift * targets, [max(r[2], 1e-16) for r in mine], ".", color=colour, label=f"{kind}, true error")
        left.loglog(
            shift * targets, [max(r[3], 1e-16) for r in mine], "_", color=colour, label=f"{kind}, estimated error"
        )
        median = [np.median([r[4] for r in mine if r[0] == t]) for t in TARGETS]
        right.loglog(TARGETS, median, "o-", color=colour, label=kind)
    left.loglog(TARGETS, TARGETS, "k-", linewidth=0.8, label="target")
    left.set(xlabel="target: relative error [–]", ylabel="relative error [–]")
    right.set(xlabel="target: relative error [–]", ylabel="CPU time of a warm run [s]")
    left.set_ylim(top=1e3)  # room for the legend
    for axes in (left, right):
        axes.invert_xaxis()
        axes.legend(fontsize=7, ncols=2)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
