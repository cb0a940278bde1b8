"""Importing the package switches on float64 and does nothing else."""

import json
import os
import subprocess
import sys

import jaxmyo

SCRIPT = """
import json, os, sys
import jax

def values():
    names = [n for n in dir(jax.config) if n.startswith("jax_")]
    out = {}
    for name in names:
        try:
            out[name] = repr(getattr(jax.config, name))
        except Exception as error:
            out[name] = type(error).__name__
    return out

before, environment, path = values(), dict(os.environ), list(sys.path)
import jaxmyo
after = values()
from jax._src import xla_bridge
print(json.dumps({
    "changed": {n: [before[n], after[n]] for n in after if before.get(n) != after[n]},
    "count": len(after),
    "cache": jax.config.jax_compilation_cache_dir,
    "environment": environment == dict(os.environ),
    "path": path == sys.path,
    "backends": xla_bridge.backends_are_initialized(),
    "heavy": sorted({"matplotlib", "scipy.optimize", "pandas", "tqdm", "hypothesis", "pytest"} & set(sys.modules)),
}))
"""


def run(script: str) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}
    command = [sys.executable, "-c", script]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=120, env=environment)


def test_import_changes_nothing_but_float64() -> None:
    done = run(SCRIPT)
    seen = json.loads(done.stdout)
    assert seen["count"] > 50
    assert seen["changed"] == {"jax_enable_x64": ["False", "True"]}
    assert seen["cache"] is None
    assert seen["environment"]
    assert seen["path"]
    assert done.stderr == ""


def test_import_loads_no_plotting_and_starts_no_device() -> None:
    seen = json.loads(run(SCRIPT).stdout)
    assert seen["heavy"] == []
    assert not seen["backends"]


def test_every_public_name_exists() -> None:
    assert len(set(jaxmyo.__all__)) == len(jaxmyo.__all__)
    for name in jaxmyo.__all__:
        assert hasattr(jaxmyo, name), name


def test_every_public_name_says_what_it_is() -> None:
    for name in jaxmyo.__all__:
        thing = getattr(jaxmyo, name)
        if callable(thing):
            assert thing.__doc__, name
