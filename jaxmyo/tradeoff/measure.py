"""Settings measured, each group of them that shares a compiled program in a process of its own, one at a time."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from jaxmyo.tradeoff.dials import Dials

#: Seconds after which a process is given up.
PATIENCE = 1800.0


@dataclass(frozen=True)
class Point:
    """What one setting gave.

    body: its name; status: CONVERGED, or why there is nothing else; outputs: of the body; seconds: of a warm solve of
    both states by the clock, the median of `repeats`; cpu_seconds: of all cores together, the least of them, which
    other programs on the machine disturb less; cold_seconds, cold_cpu_seconds: of the first solve in the process,
    with all that is compiled in it; memory_MB: the most that the process held, idle_MB: before it solved anything;
    unknowns; steps, iterations: of both states together; solver; parts: the points that an extrapolation is made of.
    """

    body: str
    dials: Dials
    status: str
    outputs: tuple[float, ...] | None = None
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    repeats: int = 0
    cold_seconds: float = 0.0
    cold_cpu_seconds: float = 0.0
    memory_MB: float = 0.0
    idle_MB: float = 0.0
    unknowns: int = 0
    steps: int = 0
    iterations: int = 0
    solver: str = ""
    parts: tuple["Point", ...] = field(default=(), repr=False)

    @property
    def converged(self) -> bool:
        """Whether there are outputs to look at."""
        return self.status == "CONVERGED" and self.outputs is not None


@dataclass(frozen=True)
class Effort:
    """How long warm solves are repeated: `repeats` times at most, or until `seconds` have passed; three at least."""

    repeats: int = 9
    seconds: float = 1.0


def measure(body: str, dials: Sequence[Dials], effort: Effort, say: Callable[[str], None]) -> Iterator[Point]:
    """The settings of a body, each once, in the order of their programs."""
    groups: dict[Any, list[Dials]] = {}
    for one in dict.fromkeys(dials):
        groups.setdefault(one.program, []).append(one)
    for group in groups.values():
        first = group[0]
        say(f"{body}: {_label(first)}, {len(group)} setting(s)")
        yield from _measured(body, group, effort)


def _label(dials: Dials) -> str:
    words = [
        dials.model,
        f"{dials.elements} elements",
        f"grading {dials.grading:g}",
        f"{dials.quadrature} Gauss points",
        dials.precision,
    ]
    return ", ".join(word for word in (*words, dials.patches, dials.solver) if word)


def _measured(body: str, group: list[Dials], effort: Effort) -> list[Point]:
    """By one process; what it does not tell has a status that says why."""
    task = json.dumps({"body": body, "dials": [asdict(d) for d in group], **asdict(effort)})
    command = [sys.executable, "-m", "jaxmyo.tradeoff.worker"]
    environment = os.environ | {"JAX_ENABLE_COMPILATION_CACHE": "false"}
    try:
        done = subprocess.run(
            command, input=task, env=environment, capture_output=True, text=True, timeout=PATIENCE, check=False
        )
        lines, ended = done.stdout.splitlines(), f"the process ended with {done.returncode}: {_last(done.stderr)}"
    except subprocess.TimeoutExpired as error:
        told = error.stdout or b""
        lines = (told.decode() if isinstance(told, bytes) else told).splitlines()
        ended = f"no answer after {PATIENCE:g} s"
    points = []
    for k, dials in enumerate(group):
        found: dict[str, Any] = json.loads(lines[k]) if k < len(lines) else {"status": ended}
        outputs = found.pop("outputs", None)
        points.append(Point(body, dials, outputs=None if outputs is None else tuple(outputs), **found))
    return points


def _last(text: str) -> str:
    lines = [line for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else "nothing said"
