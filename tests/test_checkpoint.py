"""A cycle that is kept in a file: killed at any moment it goes on from its last step, and finds the same bits."""

import os
import signal
import subprocess
import sys
import time
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo import checkpoint, solve

TIMES = tuple(np.linspace(0.0, 0.5, 6))


def neo_hookean(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    return 0.5 * constants["mu"] * (jnp.trace(C) - 3.0 - jnp.log(jnp.linalg.det(C)))


@cache
def tube() -> jm.Scene:
    return jm.radial_tube(2, law=neo_hookean, constants={"mu": 10.0})


def cycle(out: Path | None, times: Any = TIMES, top: float = 3.0, **options: Any) -> jm.Cycle:
    return jm.cycle(
        options.pop("scene", None) or tube(),
        times,
        T0=options.pop("T0", 5.0),
        a_over_D=None,
        beta=lambda s: float(np.sin(np.pi * s) ** 2),
        loads=lambda s: [jm.Pressure("inner", 1.0 + top * float(np.sin(np.pi * s) ** 2))],
        out=out,
        **options,
    )


def assert_same(a: jm.Cycle, b: jm.Cycle) -> None:
    """Bit for bit."""
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        np.testing.assert_array_equal(np.asarray(x), np.asarray(y))


class Killed(BaseException):
    pass


def interrupted(out: Path, steps: int, monkeypatch: pytest.MonkeyPatch, **options: Any) -> None:
    """A run that ends while it solves the step after `steps`."""
    write = checkpoint.write

    def once_more(path: Path, own: Any, found: Any) -> None:
        if len(found) > steps:
            raise Killed
        write(path, own, found)

    monkeypatch.setattr(checkpoint, "write", once_more)
    with pytest.raises(Killed):
        cycle(out, **options)
    monkeypatch.undo()


def steps_solved(out: Path, monkeypatch: pytest.MonkeyPatch, **options: Any) -> tuple[int, jm.Cycle]:
    writes, write = [], checkpoint.write
    monkeypatch.setattr(checkpoint, "write", lambda *a: (writes.append(1), write(*a)))
    found = cycle(out, **options)
    monkeypatch.undo()
    return len(writes), found


def test_a_cycle_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = cycle(tmp_path / "whole.npz")
    assert bool(whole.C.converged.all())
    interrupted(tmp_path / "cycle.npz", 2, monkeypatch)
    left = tmp_path / ".cycle.npz.1.part"  # as a run leaves it that was killed while it wrote
    left.write_bytes(b"half")
    n, found = steps_solved(tmp_path / "cycle.npz", monkeypatch)
    assert n == len(TIMES) - 2
    assert_same(found, whole)
    assert not left.exists()
    n, found = steps_solved(tmp_path / "cycle.npz", monkeypatch)
    assert n == 0
    assert_same(found, whole)
    with np.load(tmp_path / "cycle.npz", allow_pickle=False) as file:  # plain arrays
        assert len(file["A.status"]) == len(TIMES)
    for changed, said in [
        ({"T0": 6.0}, "inputs"),
        ({"top": 4.0}, "loads"),
        ({"times": TIMES[:-1]}, "s, beta, loads"),
        ({"settings": jm.Settings(move=0.2)}, "settings"),
        ({"scene": jm.radial_tube(2, Ri=2.5, law=neo_hookean, constants={"mu": 10.0})}, "mesh points"),
    ]:
        with pytest.raises(ValueError, match=rf"cycle.npz is of another cycle; they differ in: .*{said}"):
            cycle(tmp_path / "cycle.npz", **changed)
    (tmp_path / "cycle.npz").write_bytes((tmp_path / "cycle.npz").read_bytes()[:-500])
    with pytest.raises(ValueError, match="truncated or damaged"):
        cycle(tmp_path / "cycle.npz")


def test_not_inside_jit(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="out is for a cycle outside of jit"):
        jax.jit(lambda T0: cycle(tmp_path / "cycle.npz", T0=T0).C.u)(5.0)


@pytest.mark.slow
def test_with_and_without_a_file(tmp_path: Path) -> None:
    kept, free = cycle(tmp_path / "cycle.npz"), cycle(None)
    np.testing.assert_allclose(np.asarray(kept.C.u), np.asarray(free.C.u), rtol=0, atol=1e-12)


@pytest.mark.slow
def test_a_large_cycle_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By sparse factors, which a new process does not have."""
    monkeypatch.setattr(solve, "LARGE", 0)
    whole = cycle(tmp_path / "whole.npz")
    interrupted(tmp_path / "cycle.npz", 3, monkeypatch)
    monkeypatch.setattr(solve, "LARGE", 0)
    found = cycle(tmp_path / "cycle.npz")
    assert found.C.solver != "dense LU"
    for a, b in ((found.A, whole.A), (found.C, whole.C)):
        for name in ("u", "p", "residual", "history", "iterations", "negative_eigenvalues"):
            np.testing.assert_array_equal(np.asarray(getattr(a, name)), np.asarray(getattr(b, name)))


@pytest.mark.slow
def test_a_process_is_killed_again_and_again(tmp_path: Path) -> None:
    """SIGKILL at random moments of the writing and solving of a cycle of 200 steps."""
    times = np.linspace(0.0, 1.0, 200)
    out, script = (
        tmp_path / "cycle.npz",
        "import sys, numpy as np; from pathlib import Path; import test_checkpoint as t; ",
    )
    script += "t.cycle(Path(sys.argv[1]), np.linspace(0.0, 1.0, 200))"
    rng, kills = np.random.default_rng(11), 0
    environment = os.environ | {"PYTHONPATH": f"{Path(__file__).parent}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    for _ in range(4):
        before = out.stat().st_mtime_ns if out.exists() else 0
        process = subprocess.Popen([sys.executable, "-c", script, str(out)], env=environment)
        while process.poll() is None and (out.stat().st_mtime_ns if out.exists() else 0) == before:
            time.sleep(0.002)
        time.sleep(rng.uniform(0.0, 0.3))
        kills += process.poll() is None
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert kills >= 2
    with np.load(out, allow_pickle=False) as file:
        done = len(file["A.status"])
    assert done > 0
    assert_same(cycle(out, times), cycle(tmp_path / "whole.npz", times))
