"""A study on disk: a folder with a manifest and one file per chunk, each whole or not there; nothing in it is executed.

`study.json` says what the study is, `axes.npz` has the values of its axes, `chunk-000000.npz` the outputs and the
status of the first chunk of points, and so on. The arrays are plain (`numpy.load(..., allow_pickle=False)`).
"""

import json
import time
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from jaxmyo.files import remove_parts, whole

FORMAT, VERSION = "jaxmyo study", 1
MANIFEST, AXES = "study.json", "axes.npz"
POLL = 0.05  # seconds between two looks at a folder that other processes write to

Arrays = dict[str, NDArray[Any]]
Shapes = Mapping[str, jax.ShapeDtypeStruct]


class Store:
    """The folder of one study. shapes: of what each point has; n: points; chunk: of them in a file."""

    def __init__(self, folder: Path, shapes: Shapes, n: int, chunk: int) -> None:
        self.folder, self._shapes, self._n, self._chunk = folder, shapes, n, chunk

    def missing(self) -> list[int]:
        """The chunks that are not on disk."""
        there = {path.name for path in self.folder.glob("chunk-*.npz")}
        return [k for k in range(-(-self._n // self._chunk)) if self._path(k).name not in there]

    def write(self, k: int, arrays: Arrays) -> None:
        """A chunk, (points in it, ...) each."""
        with whole(self._path(k)) as beside, beside.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)

    def read(self, k: int) -> Arrays:
        """A chunk; a ValueError if its file is damaged."""
        path = self._path(k)
        found = _arrays(path)
        n = min(self._chunk, self._n - k * self._chunk)
        expected = {name: ((n, *s.shape), np.dtype(s.dtype)) for name, s in self._shapes.items()}
        if {name: (x.shape, x.dtype) for name, x in found.items()} != expected:
            raise ValueError(f"{path} is not a chunk of this study; delete it, and it is computed again")
        return found

    def wait(self) -> None:
        """Until the other processes have written the chunks that are theirs."""
        while self.missing():
            time.sleep(POLL)

    def tidy(self) -> None:
        """Remove what killed runs left half-written; only where every chunk is there and nobody writes."""
        remove_parts(self.folder)

    def _path(self, k: int) -> Path:
        return self.folder / f"chunk-{k:06d}.npz"


def begin(folder: Path, manifest: dict[str, Any], axes: Arrays, writes: bool) -> None:
    """Make the folder of a study, or see that it is the folder of this one; a ValueError says what differs.

    writes: whether this process makes it; others wait until it is there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / MANIFEST
    if writes and not path.exists():
        if any(folder.glob("chunk-*.npz")):
            raise ValueError(f"out = {folder} has chunks of a study but no {MANIFEST}; choose another folder")
        with whole(path) as beside:
            beside.write_text(json.dumps(manifest, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    while not path.exists():
        time.sleep(POLL)
    if lines := list(differences(read_manifest(folder), json.loads(json.dumps(manifest)))):
        raise ValueError(
            f"out = {folder} has another study; it differs in:\n  " + "\n  ".join(lines) + "\n"
            "Choose another folder, or repeat that study as it was begun."
        )
    if writes and not (folder / AXES).exists():
        with whole(folder / AXES) as beside, beside.open("wb") as file:
            np.savez(file, allow_pickle=False, **axes)


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a folder; FileNotFoundError or ValueError where there is none."""
    path = folder / MANIFEST
    if not path.exists():
        raise FileNotFoundError(f"{folder} is no folder of a study: it has no {MANIFEST}")
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        known = manifest["format"] == FORMAT
    except (KeyError, TypeError, ValueError):
        known = False
    if not known:
        raise ValueError(f"{path} is not the manifest of a study")
    if manifest["version"] != VERSION:
        raise ValueError(f"{path} is of format version {manifest['version']}; this jaxmyo reads {VERSION}")
    return dict(manifest)


def read_axes(folder: Path) -> Arrays:
    """The values of the axes, by their names."""
    return _arrays(folder / AXES)


def _arrays(path: Path) -> Arrays:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return dict(arrays)
    except (ValueError, EOFError, KeyError, OSError, zipfile.BadZipFile, zlib.error) as error:
        if isinstance(error, FileNotFoundError):
            raise
        raise ValueError(f"{path} is damaged ({error}); delete it, and it is computed again") from error


def differences(old: Any, new: Any, name: str = "") -> Iterator[str]:
    """What is not the same in two manifests, one line each."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in [*old, *(k for k in new if k not in old)]:
            if key not in old or key not in new:
                yield f"{name}{key}: {'only there' if key in old else 'only here'}"
            else:
                yield from differences(old[key], new[key], f"{name}{key}, ")
    elif old != new:
        hashes = all(isinstance(x, str) and len(x) == 64 for x in (old, new))
        yield name.removesuffix(", ") + ("" if hashes else f": {_short(old)} there, {_short(new)} here")


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else text[:57] + "..."
