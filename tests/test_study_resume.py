"""Studies on disk: killed at any moment they go on, over any number of devices and processes, bit for bit the same."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo.studies import store

#: As a user's script: a study of 60 samples, 10 at a time, as slow as it is told; with several processes if it is told.
SCRIPT = '''
import sys
import jax
import jax.numpy as jnp
import numpy as np
import jaxmyo as jm

out, rounds, address, rank = sys.argv[1], int(sys.argv[2]), sys.argv[3], int(sys.argv[4])
if address:
    jax.distributed.initialize(address, num_processes=2, process_id=rank)

def solve(x, y):
    """Newton's square root of x, then a few of the round-off's own numbers."""
    z = jax.lax.fori_loop(0, rounds, lambda i, z: 0.5 * (z + x / z), 1.0 + 0.0 * x)
    return {"root": z, "wave": jnp.sin(jnp.stack([x, y]) / z), "status": jnp.where(x > 5.5, 2, 0)}

axes = {"x": np.linspace(1.0, 6.0, 12), "y": np.linspace(0.1, 0.9, 5)}
units = dict.fromkeys(("x", "y", "root", "wave"), "–")
found = jm.study(solve, axes, units=units, out=out or None, chunk=10)
here = {"devices": jax.local_device_count(), "processes": jax.process_count(), "status": found.status}
np.savez(sys.argv[5], **here, **found.values)
'''


#: The real sample: 200 samples, 32 at a time, states A and C; arguments as above.
SAMPLE = """
import sys
import jax
import numpy as np
import jaxmyo as jm
from jaxmyo.studies.command import sample_study

out, _, address, rank = sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4])
if address:
    jax.distributed.initialize(address, num_processes=2, process_id=rank)
axes = {"a_over_D": np.linspace(0.0, 0.25, 8), "T0": np.linspace(1.0, 60.0, 25), "beta": 1.0}
found = sample_study(jm.TABLE1, axes, (1.2, 1.2), chunk=32, out=out or None)
here = {"devices": jax.local_device_count(), "processes": jax.process_count(), "status": found.status}
np.savez(sys.argv[5], **here, **found.values)
"""


def start(
    out: Path | str,
    result: Path,
    rounds: int = 40,
    address: str = "",
    rank: int = 0,
    devices: int = 1,
    script: str = SCRIPT,
) -> Any:
    flags = f"--xla_force_host_platform_device_count={devices}"
    command = [sys.executable, "-c", script, str(out), str(rounds), address, str(rank), str(result)]
    return subprocess.Popen(command, env=os.environ | {"XLA_FLAGS": flags}, stderr=subprocess.PIPE, text=True)


def finish(*processes: Any, timeout: float = 120.0) -> None:
    for process in processes:
        _, told = process.communicate(timeout=timeout)
        assert process.returncode == 0, told


def two_processes(folder: Path, **options: Any) -> list[Any]:
    """Begun, with two devices each; their results are to be folder/result0.npz and folder/result1.npz."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    results = [folder / f"result{rank}.npz" for rank in (0, 1)]
    return [start(folder / "study", results[k], address=address, rank=k, devices=2, **options) for k in (0, 1)]


def chunks(folder: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("chunk-*.npz")}


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Without a folder, on one device."""
    result = tmp_path_factory.mktemp("plain") / "result.npz"
    finish(start("", result))
    return dict(np.load(result))


def assert_same(path: Path, other: dict[str, Any]) -> dict[str, Any]:
    found = dict(np.load(path))
    for name in ("root", "wave", "status"):
        np.testing.assert_array_equal(found[name], other[name])
    assert np.isnan(found["root"]).sum() == 10
    return found


def test_killed_and_resumed(tmp_path: Path, uninterrupted: dict[str, Any]) -> None:
    folder, result = tmp_path / "study", tmp_path / "result.npz"
    process = start(folder, result, rounds=30_000_000)
    process.kill()  # before anything is there
    process.communicate()
    for least in (1, 3):
        process = start(folder, result, rounds=30_000_000)
        while len(chunks(folder)) < least and process.poll() is None:
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert len(chunks(folder)) < 6
    before = chunks(folder)
    assert len(before) >= 3
    assert not result.exists()
    finish(start(folder, result, rounds=30_000_000))
    after = chunks(folder)
    assert len(after) == 6
    assert {name: after[name] for name in before} == before  # not computed again
    assert_same(result, uninterrupted)  # Newton's root has long converged, the rounds change no bit
    again = jm.load_study(folder)
    np.testing.assert_array_equal(again["root"], uninterrupted["root"])
    assert sorted(path.name for path in folder.iterdir()) == sorted([*after, "axes.npz", "study.json"])


def test_several_devices(tmp_path: Path, uninterrupted: dict[str, Any]) -> None:
    result = tmp_path / "result.npz"
    finish(start("", result, devices=4))
    assert assert_same(result, uninterrupted)["devices"] == 4


def test_several_processes(tmp_path: Path, uninterrupted: dict[str, Any]) -> None:
    """Two processes with two devices each, through JAX's distributed runtime; both have the whole result."""
    finish(*two_processes(tmp_path))
    for rank in (0, 1):
        found = assert_same(tmp_path / f"result{rank}.npz", uninterrupted)
        assert (found["devices"], found["processes"]) == (2, 2)


def solve(x: Any, y: Any) -> dict[str, Any]:
    return {"z": jnp.sin(x) * y, "status": 0}


AXES: dict[str, Any] = {"x": [1.0, 2.0, 3.0], "y": [1.0, 2.0]}
UNITS = {"x": "mm", "y": "kPa", "z": "mN"}


def small(folder: Path, **change: Any) -> jm.Study:
    given: dict[str, Any] = {"solve": solve, "axes": AXES, "units": UNITS, "chunk": 4} | change
    return jm.study(given.pop("solve"), given.pop("axes"), out=folder, **given)


def test_a_damaged_chunk(tmp_path: Path) -> None:
    found = small(tmp_path)
    path = tmp_path / "chunk-000001.npz"
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(ValueError, match=r"chunk-000001.npz is damaged .*; delete it, and it is computed again"):
        small(tmp_path)
    path.unlink()
    with pytest.raises(ValueError, match=r"is not finished: 1 of 2 chunks are missing"):
        jm.load_study(tmp_path)
    np.testing.assert_array_equal(small(tmp_path)["z"], found["z"])
    np.savez(path, z=np.zeros(2))
    with pytest.raises(ValueError, match="is not a chunk of this study"):
        jm.load_study(tmp_path)


def test_the_axes_of_another_study(tmp_path: Path) -> None:
    found = small(tmp_path / "one")
    small(tmp_path / "other", axes=AXES | {"y": [1.0, 3.0]})
    own = tmp_path / "one" / "axes.npz"
    own.write_bytes((tmp_path / "other" / "axes.npz").read_bytes())
    with pytest.raises(ValueError, match=r"axes.npz is of another study; it differs in:\n  axes, y, last: 2.0"):
        jm.load_study(tmp_path / "one")
    own.unlink()
    small(tmp_path / "one")
    np.testing.assert_array_equal(jm.load_study(tmp_path / "one")["z"], found["z"])


def steeper(x: Any, y: Any) -> dict[str, Any]:
    return {"z": jnp.sin(x) * y * 1.0000001, "status": 0}


@pytest.mark.parametrize(
    ("change", "differs"),
    [
        ({"axes": AXES | {"x": [1.0, 2.0, 4.0]}}, "axes, x, last: 3.0 there, 4.0 here\n  axes, x, values\n"),
        ({"axes": AXES | {"x": [1.0, 2.5, 3.0]}}, "axes, x, values\n"),
        ({"axes": AXES | {"y": 1.0}}, "axes, y: only there\n  fixed, y: only here\n"),
        ({"units": UNITS | {"z": "N"}}, 'units, z: "mN" there, "N" here\n'),
        ({"chunk": 3}, "chunk: 4 there, 3 here\n"),
        ({"solve": steeper}, "program of solve and outputs\n"),
        ({"axes": jm.Sample({"x": [1.0, 2.0, 3.0], "y": [1.0, 2.0, 3.0]})}, 'design: "grid" there, "points" here\n'),
        ({"derivatives": True}, "outputs, d_z_d_x: only here\n"),
    ],
)
def test_the_folder_of_another_study(change: dict[str, Any], differs: str, tmp_path: Path) -> None:
    small(tmp_path)
    with pytest.raises(ValueError, match=r"^out = .* has another study; it differs in:\n  ") as caught:
        small(tmp_path, **change)
    assert differs in str(caught.value)


def test_other_versions(tmp_path: Path) -> None:
    small(tmp_path)
    manifest = json.loads((tmp_path / "study.json").read_text())
    manifest["versions"]["jax"] = "0.1.2"
    (tmp_path / "study.json").write_text(json.dumps(manifest))
    with pytest.raises(ValueError, match=r'versions, jax: "0.1.2" there, "0'):
        small(tmp_path)


def test_scenes_of_a_study_are_named_where_they_differ(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Traced only: what a study is is known before it is compiled."""
    manifests = []

    def refuse(folder: Path, manifest: dict[str, Any], axes: Any, writes: bool) -> None:
        manifests.append(manifest)
        raise InterruptedError

    monkeypatch.setattr(store, "begin", refuse)
    for scene in (jm.thin_sample(), jm.thin_sample(), jm.thin_sample(constants=jm.MEASURED)):
        with pytest.raises(InterruptedError):
            jm.study(scene, {"T0": [1.0], "a_over_D": 0.1}, ["lambda_f"], out=tmp_path)
    assert manifests[0] == manifests[1]
    different = list(store.differences(manifests[0], manifests[2]))
    assert different == ["scenes, 0, constants", "scenes, 0, energy density", "program of solve and outputs"]


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda folder: None, FileNotFoundError, "is no folder of a study: it has no study.json"),
        (lambda folder: (folder / "study.json").write_text("{}"), ValueError, "is not the manifest of a study"),
        (lambda folder: (folder / "study.json").write_text("{"), ValueError, "is not the manifest of a study"),
        (
            lambda folder: (folder / "study.json").write_text('{"format": "jaxmyo study", "version": 9}'),
            ValueError,
            "is of format version 9; this jaxmyo reads 1",
        ),
    ],
)
def test_what_is_no_study(make: Callable[[Path], Any], error: type[Exception], message: str, tmp_path: Path) -> None:
    make(tmp_path)
    with pytest.raises(error, match=message):
        jm.load_study(tmp_path)


def test_chunks_without_a_manifest(tmp_path: Path) -> None:
    (tmp_path / "chunk-000000.npz").touch()
    with pytest.raises(ValueError, match=r"has chunks of a study but no study.json"):
        small(tmp_path)


def test_an_error_of_the_folder_stops_the_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Any, k: int, arrays: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(store.Store, "write", full)
    with pytest.raises(OSError, match="No space left"):
        small(tmp_path)


def test_progress(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    small(tmp_path, progress=True)
    assert "6/6" in capsys.readouterr().err


@pytest.fixture(scope="module")
def sample_on_one_device(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    result = tmp_path_factory.mktemp("sample") / "result.npz"
    finish(start("", result, script=SAMPLE), timeout=900.0)
    return dict(np.load(result))


def assert_same_sample(path: Path, other: dict[str, Any]) -> dict[str, Any]:
    found = dict(np.load(path))
    assert not found["status"].any()
    for name in set(other) - {"devices", "processes", "residual"}:
        np.testing.assert_allclose(found[name], other[name], rtol=1e-12, atol=1e-12, err_msg=name)
    assert max(found["residual"].max(), other["residual"].max()) <= 1e-13
    return found


@pytest.mark.slow
def test_the_sample_over_devices(tmp_path: Path, sample_on_one_device: dict[str, Any]) -> None:
    """States A and C of the thin sample: on one device, and on those of four that may run."""
    finish(start("", tmp_path / "four.npz", devices=4, script=SAMPLE), timeout=900.0)
    assert assert_same_sample(tmp_path / "four.npz", sample_on_one_device)["devices"] == 4


@pytest.mark.slow
def test_the_sample_over_processes(tmp_path: Path, sample_on_one_device: dict[str, Any]) -> None:
    """The same on two processes of `jax.distributed`; each computes about half of the chunks and has all of them."""
    finish(*two_processes(tmp_path, script=SAMPLE), timeout=900.0)
    for rank in (0, 1):
        found = assert_same_sample(tmp_path / f"result{rank}.npz", sample_on_one_device)
        assert (found["devices"], found["processes"]) == (2, 2)
