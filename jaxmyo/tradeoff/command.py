"""The command `jaxmyo tradeoff`: measure every body, and write tables, figures, the report and the fronts."""

import argparse
import json
import os
import platform
import time
from pathlib import Path
from typing import Any

from jaxmyo import checks, console
from jaxmyo.tradeoff import extremes, output, report
from jaxmyo.tradeoff.bodies import BODIES
from jaxmyo.tradeoff.front import write
from jaxmyo.tradeoff.store import Store
from jaxmyo.tradeoff.trade import Trade, trade


def run(options: argparse.Namespace, started: float) -> int:
    """Measure and write everything; 0, or 1 with a message on stderr. `started`: of `time.perf_counter` [s]."""
    out: Path = options.out
    found: list[Trade] = []
    try:
        from jaxmyo.tradeoff import figures

        out.mkdir(parents=True, exist_ok=True)
        made = versions() | {"plan": "quick" if options.quick else "full"}
        store = Store(out / "points.jsonl", made)
        console.say(
            f"{len(BODIES)} bodies; every program is compiled anew in a process of its own, which takes a while."
        )
        for name in BODIES:
            found.append(trade(name, options.quick, store, console.say))
        singles = [] if options.quick else extremes.rows(extremes.measured(out / "extremes.json", made, console.say))
        files = [output.write_table(out / "tradeoff.csv", found)]
        pictures = {t.body.name: figures.draw(out / f"front_{t.body.name}.png", t) for t in found}
        files += pictures.values()
        files.append(write(out / "front.json", fronts(found), made))
        files.append(report.write(out / "report.md", found, pictures, made, singles))
    except ModuleNotFoundError as error:
        console.say(str(checks.missing(error, "jaxmyo tradeoff needs", "'jaxmyo[paper]'")))
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
        result = {"bodies": output.summary(found), "files": [str(f) for f in files]}
        print(json.dumps(result | {"versions": made, "seconds": seconds}, allow_nan=False, indent=1))
    else:
        print("\n\n".join(output.as_text(t) for t in found))
    return 0


def fronts(found: list[Trade]) -> dict[str, dict[str, Any]]:
    """The fronts of all bodies, for `datasets/front.json`."""
    return {
        t.body.name: {
            "title": t.body.title,
            "output": t.body.outputs[0][0],
            "truth": t.truth.outputs[0],
            "doubt": t.truth.doubt[0],
            "truth_is": t.truth.source,
            "settings": [t.data(p) for p in t.settings],
        }
        for t in found
    }


def versions() -> dict[str, str]:
    """What the numbers were measured with."""
    machine = f"{_processor()}, {os.cpu_count()} cores"
    return console.versions("jaxmyo", "jax", "jaxlib", "numpy", "scipy") | {"machine": machine}


def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        return next(line.split(":", 1)[1].strip() for line in text.splitlines() if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()
