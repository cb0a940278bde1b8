"""The command `jaxmyo fit`: a CSV file, the curves of Lin and Yin, or Table 1 of the paper."""

import argparse
import json
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from jaxmyo import console
from jaxmyo.fitting.arguments import CASES
from jaxmyo.status import SolveError


def run(options: argparse.Namespace, started: float) -> int:
    """Fit, print, write; 0, or 1 with a message on stderr. started: of `time.perf_counter` [s]."""
    try:
        import matplotlib  # noqa: F401  (used at the end, missed at the beginning)
        import optimistix  # noqa: F401
    except ModuleNotFoundError as error:
        console.say(f"jaxmyo fit needs {error.name}, which is not installed: pip install 'jaxmyo[fit]'")
        return 1
    from jaxmyo.fitting import cases

    try:
        options.out.mkdir(parents=True, exist_ok=True)
        with _warnings_as_lines():
            if options.data in CASES:
                console.say(f"Fitting {options.data}; the first run compiles for a while.")
                report = cases.lin_yin(options) if options.data == "lin-yin" else cases.table1(options)
            else:
                report = cases.of_file(options)
        path = options.out / "fit.json"
        path.write_text(json.dumps(report.as_json, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    except OSError as error:
        console.say(f"{error.filename or options.out}: {error.strerror or error}")
        return 1
    except (ValueError, SolveError) as error:
        console.say(f"jaxmyo fit: {error}")
        return 1
    print(json.dumps(report.as_json, allow_nan=False) if options.json else report.text)
    console.say(f"Written: {', '.join(map(str, [*report.files, path]))}; {time.perf_counter() - started:.1f} s")
    return 0


@contextmanager
def _warnings_as_lines() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = lambda message, *_, **__: console.say(f"Warning: {message}")
        yield
