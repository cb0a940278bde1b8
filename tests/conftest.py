"""Settings of the whole suite: JAX is strict about types and shapes, hypothesis draws the same examples every time.

One run of `jaxmyo paper` for all tests that look at what it writes.
"""

import gc
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import hypothesis
import jax
import pytest

from jaxmyo import sparse
from jaxmyo.compiler import QUICK

#: The command `jaxmyo` with these arguments.
Command = Callable[..., subprocess.CompletedProcess[str]]

#: Files that take a minute or more: first, so that both workers end together.
LONG = ["test_loads.py", "test_surface.py", "test_tube.py", "test_own_law.py", "test_newton.py", "test_table1.py"]

CACHE = pytest.StashKey[str]()

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

hypothesis.settings.register_profile("suite", derandomize=True, deadline=None, max_examples=50, database=None)
hypothesis.settings.load_profile("suite")


def pytest_configure(config: pytest.Config) -> None:
    """Compiled programs are kept on disk while the tests run: both workers, and every file anew, need the same ones."""
    if not hasattr(config, "workerinput"):
        os.environ["JAX_COMPILATION_CACHE_DIR"] = config.stash[CACHE] = tempfile.mkdtemp(prefix="jaxmyo-tests-")
        os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.3"
        # Nearly all of the time of the suite is compilation, and this halves it.
        quick = " ".join(f"--{name}={str(value).lower()}" for name, value in QUICK.items())
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {quick}".strip()


def pytest_unconfigure(config: pytest.Config) -> None:
    """Remove it."""
    if CACHE in config.stash:
        shutil.rmtree(config.stash[CACHE], ignore_errors=True)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What looks at the files of `jaxmyo paper` waits for its run of minutes; long files come first."""
    items.sort(key=lambda item: LONG.index(item.path.name) if item.path.name in LONG else len(LONG))
    for item in items:
        if "paper_run" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="module", autouse=True)
def free_compiled_programs() -> Iterator[None]:
    """A process may map 65,530 pieces of memory, and compiled programs take several each: free them in time.

    Files that come after each other share programs, so not more often than needed.
    """
    yield
    sparse.forget()
    maps = Path("/proc/self/maps")
    if not maps.exists() or len(maps.read_text().splitlines()) > 20_000:
        jax.clear_caches()
        gc.collect()


def jaxmyo_in(folder: Path) -> Command:
    """As a user runs it: in a process of its own, in a folder, with a cache directory of its own there."""

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        own = {"XDG_CACHE_HOME": str(folder / "cache")}
        environment = {n: v for n, v in os.environ.items() if n != "JAX_COMPILATION_CACHE_DIR"} | own
        command = [sys.executable, "-m", "jaxmyo", *arguments]
        return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)

    return run


@pytest.fixture(scope="session")
def paper_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder for both workers."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "paper"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def run_jaxmyo(paper_folder: Path) -> Command:
    """The command, in `paper_folder`."""
    return jaxmyo_in(paper_folder)


@pytest.fixture(scope="session")
def paper_run(paper_folder: Path, run_jaxmyo: Command) -> subprocess.CompletedProcess[str]:
    """The run with all sets, which compiles; it writes into `paper_folder`/all. One worker runs it, for the other."""
    begun, kept = paper_folder / "begun", paper_folder / "run.json"
    try:
        begun.mkdir()
    except FileExistsError:
        end = time.monotonic() + 1800.0
        while not kept.exists():
            assert time.monotonic() < end, "the other worker did not finish `jaxmyo paper`"
            time.sleep(0.5)
        return subprocess.CompletedProcess(**json.loads(kept.read_text(encoding="utf-8")))
    run = run_jaxmyo("paper", "--json", "--out", "all")
    part = kept.with_suffix(".part")
    part.write_text(json.dumps(vars(run)), encoding="utf-8")
    part.rename(kept)
    return run


@pytest.fixture(scope="session")
def paper_result(paper_run: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    """What `paper_run` printed."""
    assert paper_run.returncode == 0, paper_run.stderr
    return json.loads(paper_run.stdout)
