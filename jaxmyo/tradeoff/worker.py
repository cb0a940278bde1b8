"""One process that measures: `python -m jaxmyo.tradeoff.worker` reads a task from stdin and writes a line per setting.

A task is a JSON object: the name of a body, a list of dials that share one compiled program, and how often to repeat.
A process of its own is what makes cold seconds cold and peak memory that of these solves; no compiled code is kept.
"""

import json
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxmyo import factor, solve, sparse
from jaxmyo.compiler import QUICK
from jaxmyo.newton import NUMBERS
from jaxmyo.scene import Scene
from jaxmyo.status import Status
from jaxmyo.tradeoff.bodies import BODIES, Body
from jaxmyo.tradeoff.dials import Dials, applied

#: Solves, and what they tell.
Run = Callable[[], dict[str, Any]]


def peak_MB() -> float:
    """The most memory that this process has held [MB]."""
    try:  # that of the parent counts in `getrusage` where a process starts as a copy of it
        status = Path("/proc/self/status").read_text(encoding="ascii")
        return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e6
    except (OSError, IndexError):
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e6


def main() -> None:
    """Measure every setting of the task."""
    task = json.load(sys.stdin)
    jax.config.update("jax_enable_compilation_cache", False)
    idle = peak_MB()
    body, every = BODIES[task["body"]], [Dials(**given) for given in task["dials"]]
    told: list[dict[str, Any]] = []
    solves: dict[int, Run] = {}
    cold: dict[str, float] = {}
    for k, dials in enumerate(every):
        start, cpu_start = time.perf_counter(), time.process_time()
        try:
            with applied(dials):
                scene = body.scene(dials)
                solves[k] = _program(body, scene, dials)
                found = solves[k]()
        except (ValueError, TypeError, RuntimeError) as error:
            told.append({"status": f"refused: {error}"})
            solves.pop(k, None)
            continue
        ended, cpu_ended = time.perf_counter(), time.process_time()
        cold = cold or {"cold_seconds": ended - start, "cold_cpu_seconds": cpu_ended - cpu_start}
        told.append(found | cold | {"idle_MB": idle, "unknowns": _unknowns(scene)})
    wall, cpu = _repeat(solves, every, task["repeats"], task["seconds"])
    for k in solves:
        times = {"seconds": statistics.median(wall[k]), "cpu_seconds": min(cpu[k]), "repeats": len(wall[k])}
        told[k] |= times | {"memory_MB": peak_MB()}
    for line in told:
        print(json.dumps(line), flush=True)


def _repeat(
    solves: dict[int, Run], every: list[Dials], repeats: int, enough: float
) -> tuple[dict[int, list[float]], dict[int, list[float]]]:
    """Seconds of warm solves, of the clock and of all cores: three each at least, then so many repeats or seconds.

    The settings take turns, so that what else the machine does slows down one as it does another.
    """
    wall: dict[int, list[float]] = {k: [] for k in solves}
    cpu: dict[int, list[float]] = {k: [] for k in solves}
    begin = time.perf_counter()
    for turn in range(repeats):
        passed = time.perf_counter() - begin
        if passed > 30.0 * enough or (turn >= 3 and passed > enough * len(solves)):
            break
        for k, run in solves.items():
            with applied(every[k]):
                sparse.forget()  # warm has the code compiled, and nothing else
                start, cpu_start = time.perf_counter(), time.process_time()
                run()
                wall[k].append(time.perf_counter() - start)
                cpu[k].append(time.process_time() - cpu_start)
    return wall, cpu


def _program(body: Body, scene: Scene, dials: Dials) -> Run:
    """A function without arguments that solves and tells: a compiled program of a small body, else as it stands."""
    settings = dials.settings

    def states(drive: Any, numbers: Any) -> Any:
        found = body.solve(scene, drive, settings._replace(**numbers))
        A, C = found
        return body.read(scene, found), C.status, A.steps + C.steps, A.iterations + C.iterations

    large = dials.solver != "dense" and scene.kinematics(()).size > solve.LARGE
    numbers: Any = {name: getattr(settings, name) for name in NUMBERS}
    if large:
        call, name = states, factor.chosen(scene.kinematics(()).size).name
    else:
        options = QUICK if dials.compiler == "quick" else None
        call, name = _COMPILED.setdefault(dials.program, jax.jit(states, compiler_options=options)), "dense LU"

    def run() -> dict[str, Any]:
        outputs, status, steps, iterations = jax.block_until_ready(call(body.drive, numbers))
        values = [float(x) for x in outputs]
        name_of = Status(int(status)).name
        return {
            "status": name_of if np.isfinite(values).all() else f"{name_of}, not finite",
            "outputs": values if np.isfinite(values).all() else None,
            "steps": int(steps),
            "iterations": int(iterations),
            "solver": name,
        }

    return run


#: Programs by what shapes them.
_COMPILED: dict[Any, Any] = {}


def _unknowns(scene: Scene) -> int:
    """Displacements, p and q."""
    return int(scene.kinematics(()).size + scene.p_patches.max() + scene.q_patches.max() + 2)


if __name__ == "__main__":
    main()
