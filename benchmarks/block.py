"""The block benchmark: jaxmyo beside other finite element codes on one and the same problem, and beside the machine.

A unit cube (mm) of n³ Q1–Q0 hexahedra, incompressible, W = ½ (I1 − 3) + (I4 − 1)² kPa with fibres along x, both x faces
clamped, is stretched by 1.2 along x in one load step from rest, until no force on a free node is more than 1e-8 mN.
Every code and every n runs in a process of its own: "first" is the first solve of the process with all that is compiled
in it, "warm" the best of the later ones. The mesh is made before the clock starts, modules are imported before it, too.
Warm solves start from rest with the code compiled and nothing else: jaxmyo is made to forget patterns and factors, and
the other codes keep none. The row "jaxmyo, again" is jaxmyo without that, on a problem that it has just solved: pattern
and ordering, the factors and what was assembled last are there. No ratio should be made of it. Ratios are of warm
seconds, those of the code over those of jaxmyo. Below n = 7 jaxmyo solves densely, and the times mean nothing.

    python benchmarks/block.py [--n 16 24 32] [--peers felupe dolfinx] [--repeat 2]

The peers (`benchmarks/peers`) are installed by pip into environments of their own, in a folder of the user's cache:
  felupe        FElupe, nearly incompressible (K = 1000 kPa), u alone after condensation, Pardiso
  felupe-mixed  FElupe, (u, p), exactly incompressible: the same discrete problem as jaxmyo's, digit by digit
  dolfinx       DOLFINx 0.5 to 0.9, (u, p), exactly incompressible, MUMPS: jaxmyo's discrete problem, too; where pip has
                none, the system's Python is asked, or that of `--python dolfinx=/path/to/python`
The reaction of the face x1 [mN] and the displacement v of the middle of the face y1 [mm] tell whether the codes solve
the same problem: they differ by 1/K and, where p multiplies another function of det F, by the size of the elements.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any

PEERS = Path(__file__).parent / "peers"
FELUPE = ("felupe_block.py", ["felupe>=11.3", "pypardiso"], "import felupe, pypardiso")
DOLFINX = ("dolfinx_block.py", ["fenics-dolfinx<0.10"], "from dolfinx.fem.petsc import create_matrix_block")
#: What may have the peers that pip cannot install, and how to come by them; OpenBLAS is much faster than Debian's own.
SYSTEM_PYTHON = "/usr/bin/python3"
BY_HAND = {"dolfinx": "on Debian 12: apt-get install python3-dolfinx libopenblas0-pthread"}
#: peer → (script, its arguments, name of its environment)
CODES = {
    "felupe": (*FELUPE, [], "felupe"),
    "felupe-mixed": (*FELUPE, ["--mixed"], "felupe"),
    "dolfinx": (*DOLFINX, [], "dolfinx"),
}
FORCE = 1e-8  # largest force on a free node [mN]


def jaxmyo(n: int, repeat: int) -> dict[str, Any]:
    """The solves by jaxmyo, in this process."""
    import jax
    import numpy as np

    import jaxmyo as jm
    from jaxmyo import sparse
    from jaxmyo.invariants import I1, I4

    def law(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
        return 0.5 * constants["mu"] * (I1(C) - 3.0) + constants["k"] * (I4(C, frame) - 1.0) ** 2

    clamps = tuple(jm.Displacement(face, axis) for face in ("x0", "x1") for axis in "xyz")
    scene = jm.Scene(jm.box((1.0, 1.0, 1.0), (n, n, n)), law, {"mu": 1.0, "k": 1.0}, supports=clamps)
    settings = jm.Settings(tolerance=1e-9, path_tolerance=1e-6)
    runs = []
    for name in ["first"] + ["warm"] * repeat + ["again"] * repeat:
        if name == "warm":
            sparse.forget()
        start = time.perf_counter()
        A = jm.contract(scene, T0=0.0, a_over_D=None, beta=0.0, settings=settings)
        middle = time.perf_counter()
        C = jax.block_until_ready(jm.load(A, jm.Displacement("x1", "x", 0.2), settings=settings))
        end = time.perf_counter()
        work = [{k: float(v) for k, v in state.work.items()} for state in (A, C)]
        counts = {"iterations": int(A.iterations + C.iterations), "force_mN": float(C.force_residual)}
        runs.append({"name": name, "seconds": [middle - start, end - middle], "work": work, **counts})
    points = scene.mesh.points
    on_y1 = np.flatnonzero(points[:, 1] == 1.0)
    away = np.hypot(*(points[on_y1][:, [0, 2]] - 0.5).T)
    return {
        "code": "jaxmyo",
        "versions": f"jaxmyo {jm_version()}, jax {version('jax')}, {C.solver}",
        "seconds": [sum(run["seconds"]) for run in runs if run["name"] != "again"],
        "again": [sum(run["seconds"]) for run in runs if run["name"] == "again"],
        "iterations": max(run["iterations"] for run in runs if run["name"] != "again"),
        "steps": int(C.steps),
        "peak_GB": peak_GB(),
        "reaction_mN": float(C.reaction("x1")[0]),
        "lateral_mm": float(np.asarray(C.u)[on_y1[away <= away.min() + 1e-9], 1].mean()),
        "force_mN": max(run["force_mN"] for run in runs),
        "runs": runs,
    }


def jm_version() -> str:
    """The version of jaxmyo, also where it runs from its sources."""
    try:
        return version("jaxmyo")
    except ImportError:
        return "(sources)"


def peak_GB() -> float:
    """The most memory that this process has held [GB]."""
    try:  # that of the parent counts in `getrusage` where a process starts as a copy of it
        status = Path("/proc/self/status").read_text()
        return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e9
    except (OSError, IndexError):
        import resource

        unit = 1 if sys.platform == "darwin" else 1024
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e9


def machine() -> dict[str, Any]:
    """What the machine can do: DGEMM [GFLOP/s] and copy and triad [GB/s] of NumPy, best of some, on all cores."""
    from concurrent.futures import ThreadPoolExecutor

    import numpy as np

    def best(function: Any, count: int) -> float:
        seconds = []
        for _ in range(count):
            start = time.perf_counter()
            function()
            seconds.append(time.perf_counter() - start)
        return min(seconds)

    m = 2000
    A = np.random.default_rng(0).normal(size=(m, m))
    dgemm = 2e-9 * m**3 / best(lambda: A @ A, 5)
    threads, size = os.cpu_count() or 1, 20_000_000
    x, y, z = (np.ones(size) for _ in range(3))
    bounds = np.linspace(0, size, 16 * threads + 1).astype(int)
    parts = [slice(a, b) for a, b in pairwise(bounds)]

    def copy(part: slice) -> None:
        np.copyto(x[part], y[part])

    def triad(part: slice) -> None:  # x = y + 3 z, by pieces that stay in cache between the two operations
        for at in range(part.start, part.stop, 16384):
            piece = slice(at, min(at + 16384, part.stop))
            np.multiply(z[piece], 3.0, out=x[piece])
            np.add(x[piece], y[piece], out=x[piece])

    with ThreadPoolExecutor(threads) as pool:
        rates = [k * 8e-9 * size / best(lambda f=f: list(pool.map(f, parts)), 5) for k, f in ((2, copy), (3, triad))]
    return {"dgemm": dgemm, "copy": rates[0], "triad": rates[1]}


def run(command: list[str], *, own: bool = False) -> dict[str, Any] | str:
    """The last line of what a command prints, as JSON; or the last line of its errors."""
    environment = {k: v for k, v in os.environ.items() if own or not k.startswith("PYTHON")}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode or not done.stdout.strip():
        return (done.stderr.strip() or f"ended with {done.returncode}").splitlines()[-1]
    return json.loads(done.stdout.strip().splitlines()[-1])


def environment_of(peer: str, folder: Path) -> str:
    """The Python of a peer's environment, which is made if there is none; RuntimeError if that does not work."""
    _, requirements, imports, _, name = CODES[peer]
    python = folder / name / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if not python.exists():
        folder.mkdir(parents=True, exist_ok=True)
        subprocess.run([sys.executable, "-m", "venv", str(folder / name)], check=True)
    if not has(str(python), imports):
        install = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *requirements]
        done = subprocess.run(install, capture_output=True, text=True)
        if done.returncode:
            errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
            raise RuntimeError((errors or ["ERROR: pip failed"])[-1])
    return str(python)


def has(python: str, imports: str) -> bool:
    """Whether a Python can import what a peer needs."""
    return not subprocess.run([python, "-I", "-c", imports], capture_output=True).returncode


def pythons(peers: list[str], folder: Path, given: dict[str, str]) -> dict[str, str]:
    """The Python of each peer that can run here; for each other one, a line that says why not."""
    found = {}
    for peer in peers:
        try:
            found[peer] = given.get(peer) or environment_of(peer, folder)
        except (RuntimeError, OSError, subprocess.CalledProcessError) as error:
            if peer in BY_HAND and Path(SYSTEM_PYTHON).exists() and has(SYSTEM_PYTHON, CODES[peer][2]):
                found[peer] = SYSTEM_PYTHON
                continue
            print(f"{peer} is left out, pip cannot install it ({error}); {BY_HAND.get(peer, '')}")
    return found


def print_row(n: int, result: dict[str, Any], of_jaxmyo: dict[str, Any] | None) -> None:
    """One line of the table."""
    warm = min(result["seconds"][1:], default=None)
    times = f"{result['seconds'][0]:.2f} | " + ("–" if warm is None else f"{warm:.2f}")
    ratio = deviation = ""
    if of_jaxmyo:
        if warm is not None:
            ratio = f"{warm / min(of_jaxmyo['seconds'][1:]):.2f}"
        deviation = f" ({result['reaction_mN'] / of_jaxmyo['reaction_mN'] - 1.0:+.1e})"
    force = f"{result['force_mN']:.0e}" + ("" if result["force_mN"] <= FORCE else " (!)")
    print(
        f"| {n} | {result['code']} | {result['versions']} | {times} | {ratio} | {result['iterations']} | {force} "
        f"| {result['peak_GB']:.2f} | {result['reaction_mN']:.6f}{deviation} | {result['lateral_mm']:.6f} |"
    )
    if result.get("again"):
        again = min((r for r in result["runs"] if r["name"] == "again"), key=lambda r: sum(r["seconds"]))
        print(f"| {n} | jaxmyo, again | | | {sum(again['seconds']):.2f} | | {again['iterations']} | | | | |")


def print_split(n: int, result: dict[str, Any], limits: dict[str, Any] | None) -> None:
    """Where the seconds of jaxmyo go, in the best run of each kind, and how far from the machine that is."""
    for name in dict.fromkeys(r["name"] for r in result["runs"]):
        run_ = min((r for r in result["runs"] if r["name"] == name), key=lambda r: sum(r["seconds"]))
        for state, seconds, work in zip("AC", run_["seconds"], run_["work"], strict=True):
            named = [k.removesuffix(" [s]") for k in work if k.endswith(" [s]")]
            other = seconds - sum(work[f"{k} [s]"] for k in named)
            parts = [f"{k} {work[f'{k} [s]']:.3f} s" for k in named] + [f"other {other:.3f} s"]
            parts += [f"{v:g} {k}" for k, v in work.items() if not k.endswith("]")]
            print(f"n = {n}, {name}, state {state}: {seconds:.3f} s: {', '.join(parts)}")
        if limits:
            print_limits(n, name, run_["work"], limits)
    if result["steps"] > 2:  # one at the unloaded state, one under the load
        print(f"n = {n}: jaxmyo split the load into {result['steps'] - 1} steps")


def print_limits(n: int, name: str, works: list[dict[str, float]], limits: dict[str, Any]) -> None:
    """The rates of the factorisation and of the inner solves, beside those of the machine.

    "factor GFLOP" is taken as the operations of one factorisation, "factor GB" as the size of the factors, which one
    application (an inner iteration) reads twice, forward and backward.
    """

    def total(key: str, by: str) -> float:
        return sum(w.get(key, 0.0) * w.get(by, 0.0) for w in works)

    flop, seconds = total("factor GFLOP", "factorisations"), sum(w.get("factorisation [s]", 0.0) for w in works)
    if flop and seconds:
        rate, dgemm = flop / seconds, limits["dgemm"]
        print(f"n = {n}, {name}: factorisation {rate:.1f} GFLOP/s, {rate / dgemm:.0%} of DGEMM's {dgemm:.1f}")
    size, seconds = 2.0 * total("factor GB", "inner iterations"), sum(w.get("inner solves [s]", 0.0) for w in works)
    if size and seconds:
        rate, triad = size / seconds, limits["triad"]
        print(f"n = {n}, {name}: inner solves {rate:.1f} GB/s, {rate / triad:.0%} of the triad's {triad:.1f}")


def main() -> None:
    """Run every code on every n, and print the table."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jaxmyo" / "peers"
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--n", type=int, nargs="+", default=[16, 24, 32], help="elements along an edge")
    parser.add_argument("--peers", nargs="*", default=["felupe", "dolfinx"], choices=list(CODES), help="other codes")
    parser.add_argument("--repeat", type=int, default=2, help="warm solves after the first")
    parser.add_argument("--venvs", type=Path, default=cache, help="folder of the peers' environments (%(default)s)")
    parser.add_argument("--python", nargs="+", default=[], metavar="PEER=PYTHON", help="a Python that has the peer")
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)  # in a process of its own: jaxmyo on one n
    parser.add_argument("--machine", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one or options.machine:
        print(json.dumps(machine() if options.machine else jaxmyo(options.one, options.repeat)))
        return

    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    found = pythons(options.peers, options.venvs, dict(pair.split("=", 1) for pair in options.python))
    limits = run([sys.executable, __file__, "--machine"], own=True)
    if isinstance(limits, str):
        print(f"the machine was not measured: {limits}")
        limits = {}
    else:
        print(f"DGEMM {limits['dgemm']:.1f} GFLOP/s, copy {limits['copy']:.1f}, triad {limits['triad']:.1f} GB/s")
    results = []
    for n in options.n:
        commands = {"jaxmyo": [sys.executable, __file__, "--one", str(n), "--repeat", str(options.repeat)]}
        for peer, python in found.items():
            script, _, _, arguments, _ = CODES[peer]
            commands[peer] = [python, str(PEERS / script), str(n), "--repeat", str(options.repeat), *arguments]
        for code, command in commands.items():
            result = run(command, own=code == "jaxmyo")
            if isinstance(result, str):
                print(f"n = {n}: {code} failed: {result}")
                continue
            results.append((n, result))
            if code == "jaxmyo":
                print_split(n, result, limits)
            sys.stdout.flush()
    columns = "n, code, versions, first [s], warm [s], ratio, Newton, force [mN], peak [GB], reaction [mN], v [mm]"
    names = columns.split(", ")
    print(f"| {' | '.join(names)} |")
    print(f"| {' | '.join(['---'] * len(names))} |")
    ours = {n: result for n, result in results if result["code"] == "jaxmyo"}
    for n, result in results:
        print_row(n, result, ours.get(n))


if __name__ == "__main__":
    main()
