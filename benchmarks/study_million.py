"""A study of 1,000,000 points in bounded memory, killed half-way and resumed, equal to the uninterrupted one.

The free contraction of the thin sample over a/D × T0 × β, 100 values each, on the cores that this process may use.
Three processes, each measures its own peak memory: one runs the study from beginning to end; one is killed (SIGKILL)
when half of the chunks are on disk; one resumes it. Then every number and status of both is compared, bit for bit.

    python benchmarks/study_million.py [--points 1000000] [--out DIR]
"""

import argparse
import json
import os
import platform
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np

import jaxmyo as jm

OUTPUTS = ["lambda_f", "lambda_cf", "lambda_n", "T_f", "T_cf", "residual"]


def run(folder: Path, n: int) -> None:
    """The study, and what it took, as one line of JSON."""
    side = round(n ** (1 / 3))
    axes = {
        "a_over_D": np.linspace(0.0, 0.25, side),
        "T0": np.linspace(0.1, 60.0, side),
        "beta": np.linspace(0.05, 1.0, n // side**2),
    }
    start = time.perf_counter()
    found = jm.study(jm.thin_sample(), axes, OUTPUTS, out=folder)
    seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    good = found.converged
    worst = float(found["residual"][good].max())
    print(json.dumps({"seconds": seconds, "GiB": peak, "points": good.size, "good": int(good.sum()), "worst": worst}))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--points", type=int, default=1_000_000, help="of the grid, about")
    parser.add_argument("--out", type=Path, help="a folder that is kept (default: a temporary one)")
    parser.add_argument("--run", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.run:
        run(options.run, options.points)
        return
    out = options.out or Path(tempfile.mkdtemp(prefix="jaxmyo-study-"))
    whole, killed = out / "whole", out / "killed"
    packages = ", ".join(f"{p} {version(p)}" for p in ("jaxmyo", "jax", "jaxlib", "numpy"))
    print(f"{packages}, Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores", flush=True)
    try:
        measure("uninterrupted", start(whole, options.points))
        total = len(chunks(whole))
        process = start(killed, options.points)
        while len(chunks(killed)) < total // 2:
            if process.poll() is not None:
                raise RuntimeError("the run ended before it was killed")
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        before = chunks(killed)
        print(f"killed with {len(before)} of {total} chunks on disk", flush=True)
        measure("resumed", start(killed, options.points))
        after = chunks(killed)
        print(f"chunks computed twice: {sum(after[name] != t for name, t in before.items())}")
        a, b = jm.load_study(whole), jm.load_study(killed)
        same = [np.array_equal(a[name], b[name], equal_nan=True) for name in OUTPUTS]
        same.append(np.array_equal(a.status, b.status))
        print(f"equal to the uninterrupted study, bit for bit: {'yes' if all(same) else 'NO'}")
        print(a)
    finally:
        if options.out is None:
            shutil.rmtree(out)


def start(folder: Path, n: int) -> subprocess.Popen[str]:
    """The study in a process of its own."""
    command = [sys.executable, __file__, "--run", str(folder), "--points", str(n)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def measure(name: str, process: subprocess.Popen[str]) -> None:
    """Wait for a run, and print what it took."""
    told, _ = process.communicate()
    if process.returncode:
        raise RuntimeError(f"the {name} run failed")
    r = json.loads(told.splitlines()[-1])
    rate = "" if name == "resumed" else f", {r['points'] / r['seconds']:,.0f} samples/s"
    print(
        f"{name}: {r['points']:,} points in {r['seconds']:.1f} s, tracing and compilation included{rate}; peak memory "
        f"{r['GiB']:.2f} GiB; {r['good']:,} converged, largest relative residual {r['worst']:.1e}",
        flush=True,
    )


def chunks(folder: Path) -> dict[str, int]:
    """The chunks on disk, with the times at which they were written."""
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("chunk-*.npz")}


if __name__ == "__main__":
    main()
