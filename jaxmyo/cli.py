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
    return int(options.run(options, started))


def _parser() -> argparse.ArgumentParser:
    from jaxmyo.fitting import arguments as fit
    from jaxmyo.paper import arguments as paper
    from jaxmyo.stability import arguments as stability
    from jaxmyo.studies import arguments as study
    from jaxmyo.tradeoff import arguments as tradeoff

    parser = argparse.ArgumentParser(
        prog="jaxmyo", description="Large deformation of living soft tissue by mixed finite elements on JAX."
    )
    parser.add_argument("--version", action="version", version=f"jaxmyo {version('jaxmyo')}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for command in (paper, study, fit, tradeoff, stability):  # each adds one, with the function that runs it
        command.add(commands)
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
