"""The command `jaxmyo study`: the thin sample over a grid, its CSV and NetCDF files, and a figure."""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxmyo import checks, console
from jaxmyo.conditions import Stretch
from jaxmyo.constants import SETS
from jaxmyo.scenes import thin_sample
from jaxmyo.solve import contract, load
from jaxmyo.state import State
from jaxmyo.status import Status
from jaxmyo.studies.result import Study
from jaxmyo.studies.run import study

#: What is read from (A, C), with units: the sample's state is homogeneous, so a mean is the value.
OUTPUTS: dict[str, tuple[str, Any]] = {
    "lambda_f": ("–", lambda s: s[0].mean("stretches")[0]),
    "lambda_cf": ("–", lambda s: s[0].mean("stretches")[1]),
    "lambda_n": ("–", lambda s: s[0].mean("stretches")[2]),
    "T_f": ("kPa", lambda s: s[0].mean("T_f")),
    "T_cf": ("kPa", lambda s: s[0].mean("T_cf")),
    "sigma11": ("kPa", lambda s: s[1].mean("cauchy")[0, 0]),
    "sigma22": ("kPa", lambda s: s[1].mean("cauchy")[1, 1]),
    "negative_eigenvalues_A": ("–", lambda s: s[0].negative_eigenvalues),
    "negative_eigenvalues_C": ("–", lambda s: s[1].negative_eigenvalues),
    "residual": ("–", lambda s: jax.numpy.maximum(s[0].residual, s[1].residual)),
}


def sample_study(constants: Any, axes: dict[str, Any], stretch: tuple[float, float], **options: Any) -> Study:
    """The states A and C of the thin sample over axes of a_over_D [–], T0 [kPa] and beta [–]; options: of `study`.

    stretch: of state C along x, the fibres, and y [–]. Outputs: the stretches and pseudo-active tensions of A, the
    Cauchy stresses of C, the negative eigenvalues of both, and the larger relative residual.
    """
    scene = thin_sample(constants=constants)

    def states(a_over_D: Any, T0: Any, beta: Any) -> tuple[State, State]:
        A = contract(scene, T0=T0, a_over_D=a_over_D, beta=beta)
        return A, load(A, *(Stretch(axis, x) for axis, x in zip("xy", stretch, strict=True)))

    outputs = {name: of for name, (_, of) in OUTPUTS.items()}
    return study(states, axes, outputs, units={name: unit for name, (unit, _) in OUTPUTS.items()}, **options)


def run(options: argparse.Namespace, started: float) -> int:
    """Compute and write everything; 0, or 1 with a message on stderr. `started`: of `time.perf_counter` [s]."""
    if options.distributed:
        jax.distributed.initialize()
    out: Path = options.out
    axes = {"a_over_D": options.a_over_D, "T0": options.T0, "beta": options.beta}
    given = {name: x if len(x) > 1 else float(x[0]) for name, x in axes.items()}
    stretch = (float(options.stretch[0]), float(options.stretch[1]))
    n = int(np.prod([len(x) for x in axes.values()]))
    try:
        from jaxmyo.studies import figure

        out.mkdir(parents=True, exist_ok=True)
        console.say(f"{n} samples of the thin sample, constants: {options.set}; the first run compiles for a while.")
        found = sample_study(SETS[options.set], given, stretch, out=out, progress=sys.stderr.isatty())
        if jax.process_index():
            return 0  # the first process writes
        files = [found.to_csv(out / "study.csv"), found.to_netcdf(out / "study.nc")]
        if len(options.a_over_D) > 1 and len(options.T0) > 1:
            files.append(figure.contours(out / "study.png", options.set, found, stretch))
        else:
            console.say("No contours: they need two or more values of both a/D and T0.")
    except ModuleNotFoundError as error:
        console.say(str(checks.missing(error, "jaxmyo study needs", "'jaxmyo[study]'")))
        return 1
    except ValueError as error:
        console.say(str(error))
        return 1
    except OSError as error:
        console.say(f"--out {out}: cannot write {error.filename or 'there'} ({error.strerror})")
        return 1
    seconds = time.perf_counter() - started
    console.say(f"Written in {seconds:.1f} s: {', '.join(map(str, files))}")
    if options.json:
        print(json.dumps(_result(found, options.set, stretch, files, seconds), allow_nan=False, indent=1))
    else:
        print(found)
    return 0


def _result(found: Study, name: str, stretch: tuple[float, float], files: list[Path], seconds: float) -> dict[str, Any]:
    """The object of --json: outputs as nested lists over the axes in their order, null where a sample failed."""
    return {
        "set": name,
        "stretch": list(stretch),
        "axes": {axis: x.tolist() for axis, x in found.axes.items()},
        "fixed": found.design.fixed,
        "units": found.units,
        "outputs": {output: np.where(np.isnan(x), np.array(None), x).tolist() for output, x in found.values.items()},
        "status": found.status.tolist(),
        "status_names": {int(s): Status(int(s)).name for s in np.unique(found.status)},
        "samples": found.status.size,
        "converged": int(found.converged.sum()),
        "failures": found.failures(),
        "files": [str(file) for file in files],
        "versions": console.versions("jaxmyo", "jax", "jaxlib", "numpy", "scipy", "matplotlib"),
        "seconds": seconds,
    }
