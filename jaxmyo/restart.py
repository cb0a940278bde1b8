"""A state as a file that a later run goes on from: arrays and JSON in one .npz, nothing of which is executed.

The file holds what cannot be rebuilt from the scene, and a fingerprint of the scene that the state belongs to.
"""

import json
import zipfile
import zlib
from dataclasses import fields
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxmyo import checks, tracing
from jaxmyo.conditions import BodyForce, Pressure, Spring, Traction
from jaxmyo.files import whole
from jaxmyo.fingerprint import differing, fingerprint
from jaxmyo.scene import Scene
from jaxmyo.state import State
from jaxmyo.system import Geometry, Inputs, System
from jaxmyo.ties import Ties

FORMAT, VERSION = "jaxmyo state", 3  # another version wherever the fields of State or Inputs change
_CONDITIONS = {kind.__name__: kind for kind in (Traction, Pressure, BodyForce, Spring)}
_FIELDS = [f.name for f in fields(State) if f.name not in ("scene", "system", "inputs", "conditions")]


def save_state(path: str | Path, state: State) -> Path:
    """Write a state, or a batch of states, for `load_state`; the name is taken as it is.

    The file is whole or not there: a run that is killed leaves an older file as it was.
    Errors: TypeError for what is no state, or a traced one; ValueError for constants of another structure than the
    scene's.
    """
    if not isinstance(state, State):
        raise TypeError(f"state must be a State; got {state!r}")
    if tracing.is_traced(state):
        raise TypeError("state is traced: save it outside of jit, vmap and grad")
    if not checks.same_structure(state.inputs.constants, state.scene.constants_of_kinds()):
        raise ValueError(
            f"constants = {state.inputs.constants} of the state are of another structure than those of its scene, "
            f"{state.scene.constants_of_kinds()}: a file has no name for them. Build the scene with these constants"
        )
    header = {"format": FORMAT, "version": VERSION, "scene": fingerprint(state.scene)}
    write(path, header, "state", _content(state))
    return Path(path)


def load_state(path: str | Path, scene: Scene) -> State:
    """The state that `save_state` wrote, as a state of this scene; `contract` and `load` go on from it as from the old.

    Errors: ValueError for a file that is no state, is truncated or of another format version, and for a scene that
    differs from the saved state's (it says in what); FileNotFoundError.
    """
    if not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene; got {scene!r}")
    header, content = read(Path(path), FORMAT, VERSION, "state", "save_state")
    if differ := differing(fingerprint(scene), header["scene"]):
        raise ValueError(f"scene is not the one of the state in {path}; they differ in: {', '.join(differ)}")
    constants = jax.tree.unflatten(jax.tree.structure(scene.constants_of_kinds()), content["inputs"].pop("constants"))
    return State(
        scene=scene,
        system=_system(scene, **content["system"]),
        inputs=Inputs(constants=constants, **content["inputs"]),
        conditions=content["conditions"],
        **content["fields"],
    )


def _content(state: State) -> dict[str, Any]:
    """What is not the scene's; of the system its ties, loaded quads and cavities."""
    system = state.system
    batch = system.weight.shape[:-2]  # a batch that `vmap` made repeats the system
    first = (0,) * len(batch)
    return {
        "fields": {name: getattr(state, name) for name in _FIELDS},
        "inputs": state.inputs._asdict() | {"constants": jax.tree.leaves(state.inputs.constants)},
        "conditions": state.conditions,
        "system": {
            "weave": system.weave,
            "n_u": system.n_u,
            "index": system.tie_index[first],
            "scale": system.tie_scale[first],
            "surfaces": {kind: quads[first] for kind, quads in system.surfaces.items()},
            "cavities": tuple(wall[first] for wall in system.cavities),
            "geometry": None if (own := system.geometry) is None else (own.points[first], own.frame[first]),
            "batch": batch,
            "large": not system.is_small,
        },
    }


def _system(
    scene: Scene,
    weave: bool,
    n_u: int,
    index: Any,
    scale: Any,
    surfaces: dict[str, Any],
    cavities: tuple[Any, ...],
    geometry: Any,
    batch: tuple[int, ...],
    large: bool,
) -> System:
    """The discrete problem, as `contract` and `load` build it."""
    free = np.asarray(scale) != 0.0
    ties = Ties(np.asarray(index), np.asarray(scale), free, jnp.zeros(scale.shape), n_u)  # inputs.offset has the offset
    quads = {kind: np.asarray(q) for kind, q in surfaces.items()}
    walls = [np.asarray(wall) for wall in cavities]
    own = geometry and Geometry(*map(np.asarray, geometry))  # type: ignore[arg-type]
    built = System.of(scene, ties, weave=weave, surfaces=quads, cavities=walls, large=large, geometry=own)
    system = jax.tree.map(jnp.asarray, built)
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (*batch, *x.shape)), system) if batch else system


def write(path: str | Path, header: dict[str, Any], name: str, content: Any) -> None:
    """One .npz: the header as JSON, with the content under this name, whose arrays are those of the file."""
    arrays: dict[str, NDArray[Any]] = {}
    packed = _pack(content, "", arrays)
    arrays["header"] = np.frombuffer(json.dumps(header | {name: packed}).encode(), dtype=np.uint8)
    with whole(path) as beside, beside.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def read(path: Path, form: str, version: int, name: str, writer: str) -> tuple[dict[str, Any], Any]:
    """The header and the content of a file that `write` wrote; writer: the function that users know it by.

    Errors: ValueError for a file that is damaged, none of these, or of another version.
    """
    with path.open("rb") as file:
        is_zip = file.read(4) == b"PK\x03\x04"
        file.seek(0)
        try:
            arrays = dict(np.load(file, allow_pickle=False)) if is_zip else {}
        except (ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error) as error:
            raise ValueError(f"path = {path} is truncated or damaged: {error}") from error
    try:
        header = json.loads(arrays.pop("header").tobytes())
        known = header["format"] == form
    except (KeyError, TypeError, ValueError):
        known = False
    if not known:
        raise ValueError(f"path = {path} is no file of `{writer}`")
    if header["version"] != version:
        raise ValueError(f"path = {path} is of format version {header['version']}; this jaxmyo reads {version}")
    return header, _unpack(header[name], arrays)


def _pack(value: Any, name: str, arrays: dict[str, NDArray[Any]]) -> Any:
    """The value as JSON; its arrays go into `arrays` by their names."""

    def every(values: dict[str, Any]) -> dict[str, Any]:
        return {key: _pack(v, f"{name}.{key}" if name else key, arrays) for key, v in values.items()}

    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, dict):
        return {"dict": every(value)}
    if isinstance(value, tuple | list):
        kind = "tuple" if isinstance(value, tuple) else "list"
        return {kind: list(every({str(k): v for k, v in enumerate(value)}).values())}
    if (kind := type(value).__name__) in _CONDITIONS:
        return {kind: every({f.name: getattr(value, f.name) for f in fields(value)})}
    arrays[name] = np.asarray(value)
    return {"array": name}


def _unpack(value: Any, arrays: dict[str, NDArray[Any]]) -> Any:
    if not isinstance(value, dict):
        return value
    ((kind, content),) = value.items()
    if kind == "array":
        return jnp.asarray(arrays[content])
    if kind in ("tuple", "list"):
        items = (_unpack(v, arrays) for v in content)
        return tuple(items) if kind == "tuple" else list(items)
    named = {key: _unpack(v, arrays) for key, v in content.items()}
    return named if kind == "dict" else _CONDITIONS[kind](**named)
