"""Where float32 suffices: the tube from thick to thin walls, and from full activation to next to none.

`python -m jaxmyo.tradeoff.extremes PRECISION` solves every case by one compiled program and writes a JSON list.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxmyo.compiler import QUICK
from jaxmyo.conditions import Pressure
from jaxmyo.files import whole
from jaxmyo.newton import Settings
from jaxmyo.scenes import radial_tube
from jaxmyo.scenes.tube import RI, RO
from jaxmyo.solve import contract, load
from jaxmyo.status import Status

T0, A_OVER_D, ELEMENTS = 15.0, 0.2, 4
PRECISIONS = ("float64", "float32", "mixed")


@dataclass(frozen=True)
class Case:
    """wall: thickness over inner radius [–]; beta: activation [–]; pressure [kPa] inside."""

    wall: float
    beta: float
    pressure: float


#: The pressure goes with the thickness, so that the stress around stays what it is.
WALLS = [Case(w, 1.0, 18.0 * w / 0.75) for w in (0.75, 0.1, 1e-2, 1e-3, 1e-4)]
#: Tissue without stress has no shear stiffness: the tangent is singular at the end of this list.
RESTS = [Case(0.75, b, 0.0) for b in (1e-1, 1e-2, 1e-3, 1e-4)]
CASES = [*WALLS, *RESTS]


def measured(path: Path, versions: dict[str, str], say: Callable[[str], None]) -> dict[str, list[dict[str, Any]]]:
    """Precision → what every case told, each in a process of its own; kept in a file for the next run."""
    if path.exists():
        known = json.loads(path.read_text(encoding="utf-8"))
        if known["versions"] == versions:
            return dict(known["cases"])
    found = {}
    for precision in PRECISIONS:
        say(f"thin walls and states near rest: {precision}")
        command = [sys.executable, "-m", "jaxmyo.tradeoff.extremes", precision]
        environment = os.environ | {"JAX_ENABLE_COMPILATION_CACHE": "false"}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            raise ValueError(f"thin walls and states near rest in {precision}: {done.stderr.strip()[-500:]}")
        found[precision] = json.loads(done.stdout)
    with whole(path) as beside:
        beside.write_text(json.dumps({"versions": versions, "cases": found}), encoding="utf-8")
    return found


def rows(found: dict[str, list[dict[str, Any]]]) -> list[tuple[str, ...]]:
    """Of each case: wall, β, pressure; then of float32 and of mixed the status and the errors of radius and p."""
    told = []
    for k, case in enumerate(CASES):
        exact = found["float64"][k]
        cells = [f"{case.wall:g}", f"{case.beta:g}", f"{case.pressure:.3g}", exact["status"]]
        for precision in PRECISIONS[1:]:
            own = found[precision][k]
            good = own["status"] == exact["status"] == "CONVERGED"
            cells.append(own["status"])
            cells += [f"{_apart(own[q], exact[q]):.1e}" if good else "–" for q in ("radius", "p")]
        told.append(tuple(cells))
    return told


def _apart(x: float, y: float) -> float:
    return abs(x - y) / max(abs(y), 1e-300)


def solve(precision: str) -> list[dict[str, object]]:
    """status, outer radius [mm] and mean pressure p [kPa] of state C, of every case."""
    scene, settings = radial_tube(ELEMENTS), Settings(precision=precision)
    points = scene.mesh.points

    def numbers(points: jax.Array, beta: jax.Array, pressure: jax.Array) -> jax.Array:
        A = contract(scene, T0=T0, a_over_D=A_OVER_D, beta=beta, points=points, settings=settings)
        C = load(A, Pressure("inner", pressure), settings=settings)
        return jnp.stack([points[-1, 0] + C.u[-1, 0], jnp.mean(C.p), C.status.astype(float)])

    program = jax.jit(numbers, compiler_options=QUICK)
    told = []
    for case in CASES:
        moved = np.array(points)
        moved[:, 0] = RI + (points[:, 0] - RI) / (RO - RI) * RI * case.wall
        radius, p, status = (float(x) for x in program(moved, case.beta, case.pressure))
        told.append({"status": Status(int(status)).name, "radius": radius, "p": p})
    return told


if __name__ == "__main__":
    print(json.dumps(solve(sys.argv[1])))
