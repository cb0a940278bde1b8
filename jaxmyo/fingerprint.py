"""What makes two scenes the same: a hash of each part, so that a difference has a name."""

import hashlib
from dataclasses import fields
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxmyo.coordinates import evaluate
from jaxmyo.scene import Scene

#: Decimals of coordinates [mm, rad] and unit vectors: the round-off of another machine is no other scene.
DECIMALS = 9


def fingerprint(scene: Scene) -> dict[str, str]:
    """Part of the scene → its hash. A law's text is not part of it: its name, and its energy in one deformation."""
    mesh, c = scene.mesh, scene.mesh.coordinates
    laws = [kind.law for kind in scene.kinds]
    C, frame = jnp.array([[1.2, 0.1, 0.0], [0.1, 0.9, 0.05], [0.0, 0.05, 1.0]]), jnp.eye(3)
    every = list(zip(laws, scene.constants_of_kinds(), strict=True))
    energies = [f"{float(law(C, frame, jnp.asarray(0.5, dtype=float), constants)):.9e}" for law, constants in every]
    names = [getattr(law, "__qualname__", type(law).__qualname__) for law in laws]
    constants = jax.tree_util.tree_flatten_with_path(scene.constants_of_kinds())[0]
    return {
        "mesh points": hash_of(_rounded(mesh.points)),
        "cells": hash_of(mesh.cells),
        "faces": hash_of(*(part for name in sorted(mesh.faces) for part in (name, mesh.faces[name]))),
        "coordinates": hash_of(c.name, *c.axes, *c.units, _rounded(evaluate(c.position, mesh.points))),
        "Gauss points": hash_of(np.array(scene.orders)),
        "fibre and cross": hash_of(_rounded(scene.frame)),
        "regions": hash_of(
            *(part for k, name in enumerate(scene.regions, start=1) for part in _region(scene, k, name))
        ),
        "law": hash_of(*names),
        "constants": hash_of(*(part for at, x in constants for part in (jax.tree_util.keystr(at), np.asarray(x)))),
        "energy density": hash_of(*energies),
        "p_patches": hash_of(scene.p_patches),
        "q_patches": hash_of(scene.q_patches),
        "supports": hash_of(*(part for support in scene.supports for part in _support(support))),
    }


def differing(own: dict[str, str], other: dict[str, str]) -> list[str]:
    """The parts in which two fingerprints differ."""
    return [part for part in own | other if own.get(part) != other.get(part)]


def _region(scene: Scene, k: int, name: str) -> list[Any]:
    kind = scene.kinds[k]
    return [f"{name} {kind.active} {kind.weave}", np.flatnonzero(scene.material == k)]


def _support(support: Any) -> list[Any]:
    parts: list[Any] = [type(support).__name__]
    for value in (getattr(support, f.name) for f in fields(support)):
        names = isinstance(value, str | tuple) and all(isinstance(v, str) for v in value)
        parts.append(str(value) if names else np.asarray(value, dtype=np.float64))
    return parts


def _rounded(x: np.ndarray) -> np.ndarray:
    return np.round(x, DECIMALS) + 0.0  # no −0


def hash_of(*parts: Any) -> str:
    """Of texts and arrays."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray) and part.dtype.kind in "iuf":
            part = part.astype("<f8" if part.dtype.kind == "f" else "<i8")
            digest.update(f"{part.dtype.str} {part.shape}\n".encode() + part.tobytes())
        else:
            digest.update(f"{part}\n".encode())
    return digest.hexdigest()
