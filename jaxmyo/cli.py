"""The command line: `jaxmyo`, also `python -m jaxmyo`. Results go to stdout, progress and prose to stderr."""

import argparse
import os
import sys
import time
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; the exit code: 0 done, 1 failed (with a message), 2 not understood."""
    started = time.perf_counter()
    options = _parser().parse_args(argv)
    use_compilation_cache()
    if hasattr(options, "run"):
        return int(options.run(options, started))
    from jaxmyo.paper import command

    return command.run(options.out, options.set, options.json, started)


def _parser() -> argparse.ArgumentParser:
    from jaxmyo.constants import SETS
    from jaxmyo.fitting import arguments as fit

    parser = argparse.ArgumentParser(
        prog="jaxmyo", description="Large deformation of living soft tissue by mixed finite elements on JAX."
    )
    parser.add_argument("--version", action="version", version=f"jaxmyo {version('jaxmyo')}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    paper = commands.add_parser(
        "paper",
        help="recompute the paper's results and compare them with what it prints",
        description="Recompute the results of the paper: of the thin sample Table 1, the free contraction and the "
        "uniaxial tests, of the active tube its cycle and how far it is from the exact solution. Print Table 1 beside "
        "the printed values; write CSV files, states of the tube for ParaView (.vtu), figures, and report.html, which "
        "shows it all and holds every statement of the paper against what comes out.",
    )
    paper.add_argument("--out", type=Path, default=Path("paper-out"), metavar="DIR", help="default: %(default)s")
    paper.add_argument(
        "--set",
        choices=list(SETS),
        help="one set of material constants for the table, the figures and the tube (default: Table 1 with all three, "
        "everything else with table1)",
    )
    paper.add_argument("--json", action="store_true", help="one JSON object on stdout instead of the table")
    fit.add(commands)
    return parser


def use_compilation_cache() -> None:
    """Keep compiled code in the user's cache directory, so that a second run starts faster.

    $XDG_CACHE_HOME/jaxmyo or ~/.cache/jaxmyo; without a cache, said on stderr, where that cannot be written. A cache
    directory that the user set for JAX stays.
    """
    import jax

    if jax.config.jax_compilation_cache_dir:  # type: ignore[attr-defined]
        return
    try:
        directory = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jaxmyo"
        directory.mkdir(parents=True, exist_ok=True)
        if not os.access(directory, os.W_OK | os.X_OK):
            raise PermissionError(None, "Permission denied")
    except (OSError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or error
        print(f"Compiled code is not kept for the next run: no cache directory ({reason}).", file=sys.stderr)
        return
    jax.config.update("jax_compilation_cache_dir", str(directory))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
