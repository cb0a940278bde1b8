"""The file that a cycle is kept in while it runs, so that a run that was killed goes on where it was.

One .npz of plain arrays and JSON, as `jaxmyo.restart` writes: nothing in it is executed, and it is whole or not there.
It is bound to the scene, to every number that the cycle is given, and to the versions of the programs.
"""

from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxmyo import restart
from jaxmyo.continuation import Solution
from jaxmyo.fingerprint import differing, fingerprint, hash_of
from jaxmyo.scene import Scene
from jaxmyo.system import Inputs

FORMAT, VERSION = "jaxmyo cycle", 1

#: The solutions A and C of the steps that are done.
Found = list[tuple[Solution, Solution]]


def identity(scene: Scene, **parts: Any) -> dict[str, str]:
    """Name of a part of a cycle → its hash; parts: pytrees of numbers, texts."""
    packages = {f"version of {name}": version(name) for name in ("jaxmyo", "jax", "jaxlib")}
    hashes = {name.replace("_", " "): _hash(part) for name, part in parts.items()}
    return fingerprint(scene) | hashes | packages | {"platform": jax.local_devices()[0].platform}


def _hash(part: Any) -> str:
    leaves, structure = jax.tree.flatten(part)
    return hash_of(str(structure), *(x if isinstance(x, str) else np.asarray(x) for x in leaves))


def read(path: Path, own: dict[str, str], constants: Any) -> Found:
    """The steps that are in a file, none where there is no file; constants: whose structure those of the inputs have.

    Errors: ValueError for a file that is of another cycle (it says in what they differ), or no such file.
    """
    if not path.exists():
        return []
    header, content = restart.read(path, FORMAT, VERSION, "steps", "cycle(out=...)")
    if differ := differing(own, header["cycle"]):
        raise ValueError(
            f"out = {path} is of another cycle; they differ in: {', '.join(differ)}. Choose another file, or repeat "
            "that cycle as it was begun"
        )

    def solution(fields: dict[str, Any]) -> Solution:
        inputs = fields["inputs"]
        structure = jax.tree.structure(constants)
        own = inputs | {"constants": jax.tree.unflatten(structure, inputs["constants"])}
        return Solution(**(fields | {"inputs": Inputs(**own)}))

    both = tuple(solution(content[name]) for name in ("A", "C"))
    return [jax.tree.map(lambda x, k=k: x[k], both) for k in range(len(both[0].status))]


def write(path: Path, own: dict[str, str], found: Found) -> None:
    """Write the steps that are done."""

    def fields(solutions: list[Solution]) -> dict[str, Any]:
        s = jax.tree.map(lambda *x: np.stack([np.asarray(v) for v in x]), *solutions)
        return s._asdict() | {"inputs": s.inputs._asdict() | {"constants": jax.tree.leaves(s.inputs.constants)}}

    content = {name: fields([step[k] for step in found]) for k, name in enumerate(("A", "C"))}
    restart.write(path, {"format": FORMAT, "version": VERSION, "cycle": own}, "steps", content)


def stacked(found: Found) -> tuple[Solution, Solution]:
    """All steps as two batches."""
    return jax.tree.map(lambda *x: jnp.stack(x), *found)
