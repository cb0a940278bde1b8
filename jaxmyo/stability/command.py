"""The command `jaxmyo stability`: measure, and write a report, CSV files and figures."""

import json
import time
from pathlib import Path

from jaxmyo import checks, console
from jaxmyo.files import write_rows
from jaxmyo.stability import checkerboard, inf_sup_cases, maps, report, tables
from jaxmyo.stability.random_problems import outcome
from jaxmyo.stability.report import Results
from jaxmyo.stability.solids import solid_outcome

#: Random problems: (body, with the weave, how many), quick and full; and of solids.
QUICK = [("sample", True, 500), ("tube", True, 500)]
FULL = [("sample", True, 3000), ("sample", False, 2000), ("tube", True, 3500), ("tube", False, 1500)]
SOLIDS = 200
SEED = 0


def run(out: Path, quick: bool, as_json: bool, started: float) -> int:
    """Measure and write everything; 0, or 1 with a message on stderr. `started`: of `time.perf_counter` [s]."""
    try:
        from jaxmyo.stability import figures

        console.make_writable(out)
    except ModuleNotFoundError as error:
        console.say(str(checks.missing(error, "jaxmyo stability needs", "'jaxmyo[paper]'")))
        return 1
    except OSError as error:
        console.say(f"--out {out}: cannot write there ({error.strerror})")
        return 1

    def done(step: str) -> None:
        console.say(f"  {time.perf_counter() - started:7.1f} s  {step}")

    rows = inf_sup_cases.measure(quick, done)
    sheets = checkerboard.measure(quick, done)
    outcomes = []
    for body, weave, n in QUICK if quick else FULL:
        outcomes.append(outcome(body, weave, n, SEED))
        done(f"{n} random problems, {body} {'with' if weave else 'without'} the weave")
    solids = None if quick else solid_outcome(SOLIDS, SEED)
    if solids:
        done(f"{SOLIDS} random problems in three dimensions")
    results = Results(rows, sheets, maps.measure(quick, done), outcomes, solids)
    try:
        files = [
            write_rows(out / "inf_sup.csv", [row._asdict() for row in rows]),
            write_rows(out / "checkerboards.csv", report.sheet_rows(sheets)),
            write_rows(out / "maps.csv", report.map_rows(results.maps)),
            write_rows(out / "random_by_region.csv", tables.by_region(outcomes)),
            write_rows(out / "random_statuses.csv", tables.statuses(outcomes)),
            write_rows(out / "random_missed.csv", tables.missed(outcomes)),
            figures.inf_sup(out / "inf_sup.png", rows),
            figures.checkerboards(out / "checkerboards.png", sheets),
            figures.roughness(out / "roughness.png", sheets),
            figures.status_maps(out / "maps.png", results.maps),
        ]
        files.append(report.write(out / "report.md", results, [f for f in files if f.suffix == ".png"]))
    except OSError as error:
        console.say(f"{error.filename or out}: cannot write ({error.strerror})")
        return 1
    seconds = time.perf_counter() - started
    console.say(f"Written in {seconds:.1f} s: {', '.join(map(str, files))}")
    summary = report.summary(results)
    if as_json:
        versions = console.versions("jaxmyo", "jax", "jaxlib", "numpy", "scipy", "matplotlib")
        more = {"quick": quick, "files": [str(f) for f in files], "seconds": seconds}
        print(json.dumps(summary | more | {"versions": versions}, indent=1))
    else:
        print("\n".join(report.in_words(summary)))
    return 0
