"""The command `jaxmyo paper`: compute, compare with the paper, write CSV files, figures and the report."""

import json
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from jaxmyo import console
from jaxmyo.constants import SETS
from jaxmyo.paper import output, report, sections, tube_section
from jaxmyo.paper.claims import Claim, claims
from jaxmyo.paper.sample import A_OVER_D, HALF, T0_KPA, Sample, sample
from jaxmyo.paper.table1 import REPRODUCED, Table, table1
from jaxmyo.paper.tube_results import STEPS, TubeResults, tube_results
from jaxmyo.status import SolveError

#: The set whose figures and claims are shown when no set is asked for.
DEFAULT_SET = "table1"
PACKAGES = ("jaxmyo", "jax", "jaxlib", "numpy", "matplotlib", "meshio")


def run(out: Path, chosen: str | None, as_json: bool, started: float) -> int:
    """Compute and write everything; 0, or 1 with a message on stderr. `started`: of `time.perf_counter` [s]."""
    try:
        import meshio  # noqa: F401  (used at the end, missed at the beginning)
        from tqdm import tqdm

        from jaxmyo.paper import figures, tube_output
    except ModuleNotFoundError as error:
        console.say(f"jaxmyo paper needs {error.name}, which is not installed: pip install 'jaxmyo[paper]'")
        return 1
    name = chosen or DEFAULT_SET
    names = [chosen] if chosen else list(SETS)
    try:
        console.make_writable(out)
    except OSError as error:
        console.say(f"--out {out}: cannot write there ({error.strerror})")
        return 1
    console.say(
        f"Computing Table 1 ({', '.join(names)}), the thin sample and the tube ({name}); the first run compiles for a "
        "while."
    )
    try:
        with Progress(tqdm, total=6 + STEPS) as progress:
            tables, of_sample = _solve(names, name, progress)
            found = claims(tables[name], of_sample)
            files = [
                output.write_csv(out / "table1.csv", output.table_rows(tables)),
                output.write_csv(out / "free_contraction.csv", output.free_contraction_rows(name, of_sample)),
                output.write_csv(out / "uniaxial.csv", output.uniaxial_rows(name, of_sample)),
            ]
            progress.done("CSV files of the sample")
            pictures = [
                figures.free_contraction(out / "free_contraction.png", name, of_sample),
                figures.uniaxial(out / "uniaxial.png", name, of_sample),
            ]
            progress.done("figures of the sample")
            of_tube = tube_results(SETS[name], progress.done)
            files += tube_output.write_data(out, name, of_tube)
            progress.done("files of the tube")
            of_tube_pictures = tube_output.write_figures(out, name, of_tube)
            csv_files = [file for file in files if file.suffix == ".csv"]
            parts = [
                sections.basis(names, console.versions(*PACKAGES)),
                sections.thin_sample(tables, name, of_sample, found, *pictures),
                tube_section.tube(name, of_tube, of_tube_pictures),
            ]
            page = report.write(out / "report.html", sections.TITLE, parts, sections.footer(csv_files))
            files += [*pictures, *of_tube_pictures, page]
            progress.done("figures of the tube and report")
    except SolveError as error:
        console.say(f"A state could not be computed, so there is no report: {error}")
        return 1
    except OSError as error:
        console.say(f"{error.filename or out}: cannot write ({error.strerror})")
        return 1
    seconds = time.perf_counter() - started
    _summary(tables, name, of_sample, found, of_tube)
    console.say(f"\nWritten in {seconds:.1f} s: {', '.join(map(str, files))}")
    if as_json:
        result = _result(tables, name, of_sample, [*found, *of_tube.claims])
        result |= {"tube": tube_output.as_json(name, of_tube), "files": [str(file) for file in files]}
        result |= {"versions": console.versions(*PACKAGES), "seconds": seconds}
        print(json.dumps(result, allow_nan=False, indent=1))
    else:
        print("\n\n".join(format_table(n, t) for n, t in tables.items()))
    return 0


class Progress:
    """Steps done, on stderr: a bar on a terminal, one line per step elsewhere."""

    def __init__(self, bar: Callable[..., Any], total: int) -> None:
        style = "{n}/{total} |{bar:20}| {elapsed} {desc}"
        on_terminal = sys.stderr.isatty()
        self._bar = bar(total=total, file=sys.stderr, leave=False, bar_format=style) if on_terminal else None

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()

    def done(self, step: str) -> None:
        """One more step is done."""
        if self._bar is None:
            console.say(f"  done: {step}")
        else:
            self._bar.set_description_str(step, refresh=False)
            self._bar.update()


def _solve(names: list[str], name: str, progress: Progress) -> tuple[dict[str, Table], Sample]:
    """The two programs side by side: most of the time is compilation, which runs in parallel."""
    with ThreadPoolExecutor(2) as pool:
        of_tables = pool.submit(lambda: {n: table1(SETS[n]) for n in names})
        of_sample = pool.submit(lambda: sample(SETS[name]))
        steps: dict[Future[Any], str] = {of_tables: "Table 1", of_sample: "free contraction and uniaxial tests"}
        for future in as_completed(steps):
            future.result()
            progress.done(steps[future])
    return of_tables.result(), of_sample.result()


def format_table(name: str, table: Table) -> str:
    """Table 1 beside the printed values, as text."""
    lines = [
        f"Table 1 with the constants '{name}' (equibiaxial stretch 1.2, beta = 1)",
        f"{'':>8} {'T0':>5} | {'sigma22/sigma11 [%]':^25} | {'sigma22 [kPa]':^25}",
        f"{'a/D':>8} {'[kPa]':>5}" + 2 * f" | {'computed':>9} {'printed':>7} {'diff':>7}",
    ]
    for row in table.rows:
        label = "none" if row.a_over_D is None else f"{row.a_over_D:.2f}"
        ratio, sigma = row.ratio_percent, row.sigma22
        lines.append(
            f"{label:>8} {row.T0:5.0f} | "
            f"{ratio:9.4f} {row.printed_ratio_percent:7.2f} {ratio - row.printed_ratio_percent:+7.4f} | "
            f"{sigma:9.4f} {row.printed_sigma22:7.2f} {sigma - row.printed_sigma22:+7.4f}"
        )
    lines.append(f"largest difference {table.max_abs_diff:.4f}; largest relative residual {table.residual:.1e}")
    return "\n".join(lines)


def _summary(
    tables: Mapping[str, Table], name: str, of_sample: Sample, found: list[Claim], of_tube: TubeResults
) -> None:
    """What reproduces and what does not, in words."""
    console.say("\nTable 1 (40 entries in % and kPa; 'none' in the tables: no kinematic constraint):")
    for n, table in tables.items():
        verdict = "reproduces it" if table.reproduced else "does not reproduce it"
        console.say(f"  {n}: largest difference {table.max_abs_diff:.4f}, {verdict} (limit {REPRODUCED})")
    for body, statements in (("sample", found), ("tube", of_tube.claims)):
        console.say(f"\nThe paper's statements about the {body}, with the constants '{name}':")
        for claim in statements:
            console.say(f"  {claim}")
    if note := sections.unstable_note(of_sample):
        console.say(f"\n{note}")


def _result(tables: Mapping[str, Table], name: str, of_sample: Sample, found: list[Claim]) -> dict[str, Any]:
    """The claims, and the sample for the object of --json. Stretches are without unit, tensions in kPa."""
    free = {}
    for c, key in enumerate(("with_constraint", "without_constraint")):
        state = of_sample.free.at((c, HALF))
        lf, lcf, ln = (float(x) for x in state.stretches)
        free[key] = {
            "lambda_f": lf,
            "lambda_cf": lcf,
            "lambda_n": ln,
            "T_f_kPa": float(state.T_f),
            "T_cf_kPa": float(state.T_cf),
            "negative_eigenvalues": int(state.negative),
            "relative_residual": float(state.residual),
        }
    return {
        "table": {n: table.as_json() for n, table in tables.items()},
        "free_contraction": {"set": name, "s": 0.5, "beta": 1.0, "T0_kPa": T0_KPA, "a_over_D": A_OVER_D, **free},
        "uniaxial": {"set": name, "unstable_states": int(of_sample.unstable.sum())},
        "claims": [claim.as_json() for claim in found],
    }
