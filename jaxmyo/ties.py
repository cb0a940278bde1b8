"""Ties: `full = offset + scale · reduced[index]`, one gather for every kinematic condition.

A Dirichlet value, a symmetry plane, a face that stays plane and a homogeneous deformation are all of this form, so
that a body of one unknown and one of a million run through the same elements and the same solver.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxmyo import checks
from jaxmyo.conditions import AXES, Displacement, Homogeneous, Planar, Stretch, Tie
from jaxmyo.mesh import Mesh


@dataclass(frozen=True)
class Ties:
    """The kinematics of a body with `size` unknown displacements.

    index, scale: (n_dof,) with n_dof = 3 n_nodes; offset: (n_dof,) prescribed displacements [mm].
    """

    index: NDArray[np.int64]
    scale: NDArray[np.float64]
    offset: Array
    size: int


def build(mesh: Mesh, conditions: Sequence[Tie]) -> Ties:
    """The ties of a mesh under a list of conditions. Errors name the condition, and a conflict names both."""
    n_dof = mesh.points.size
    group, scale = np.arange(n_dof), np.ones(n_dof)  # u_i = scale_i · unknown of its group
    for c in conditions:
        if isinstance(c, Homogeneous):
            group, scale = np.tile(np.arange(3), len(mesh.points)), mesh.points.reshape(-1).copy()
    for c in conditions:
        if isinstance(c, Planar):
            dofs = _dofs(mesh, c.face, c.axis)
            if np.ptp(scale[dofs]) > 1e-12 * np.abs(scale[dofs]).max():
                raise ValueError(f"{c} contradicts the homogeneous deformation: the face is not plane along {c.axis}")
            group[np.isin(group, group[dofs])] = group[dofs].min()
    fixed = [c for c in conditions if isinstance(c, Displacement | Stretch)]
    owner = np.full(n_dof, -1)  # which condition prescribes a group
    offset = jnp.zeros(n_dof)
    for k, c in enumerate(fixed):
        face = c.face if isinstance(c, Displacement) else f"{c.axis}1"
        dofs = _dofs(mesh, face, c.axis)
        value = _value(mesh, c)
        if (scale[dofs] == 0.0).any():  # nodes that a homogeneous deformation does not move
            if checks.is_traced(value) or float(value) != 0.0:
                raise ValueError(f"{c} contradicts the homogeneous deformation, which does not move that face")
            continue
        for j in np.unique(owner[group[dofs]]):
            if j >= 0 and not _same(_value(mesh, fixed[j]), value):
                raise ValueError(f"{c} contradicts {fixed[j]}: both prescribe {c.axis} of the same nodes")
        dofs = dofs[owner[group[dofs]] < 0]
        owner[group[dofs]] = k
        unit = np.zeros(n_dof)  # what one mm of the condition does to each unknown
        unit[group[dofs]] = 1.0 / scale[dofs]
        offset = offset + jnp.asarray(scale * unit[group]) * value
    scale = np.where(owner[group] >= 0, 0.0, scale)
    free = np.unique(group[scale != 0.0])
    index = np.where(scale != 0.0, np.searchsorted(free, group), 0)
    return Ties(np.minimum(index, max(len(free) - 1, 0)), scale, offset, len(free))


def rigid_motions(mesh: Mesh, ties: Ties) -> list[str]:
    """Names of the rigid motions that the ties leave free (to first order), e.g. "rotation about z"."""
    X = mesh.points - mesh.points.mean(axis=0)
    X = X / np.abs(X).max()
    modes = [np.broadcast_to(np.eye(3)[k], X.shape) for k in range(3)] + [np.cross(np.eye(3)[k], X) for k in range(3)]
    R = np.stack([m.reshape(-1) for m in modes], axis=1)
    # Each degree of freedom hangs on one unknown: the projection on what the ties can move is a sum per unknown.
    norm = np.bincount(ties.index, ties.scale**2, minlength=max(ties.size, 1))
    norm[norm == 0.0] = 1.0
    coordinates = np.stack([np.bincount(ties.index, ties.scale * r, minlength=len(norm)) / norm for r in R.T], axis=1)
    blocked = R - ties.scale[:, None] * coordinates[ties.index]
    _, singular, vt = np.linalg.svd(blocked, full_matrices=False)
    free = vt[singular < 1e-9 * np.sqrt(len(R))]
    names = [f"translation along {a}" for a in AXES] + [f"rotation about {a}" for a in AXES]
    return [names[int(np.argmax(np.abs(v)))] for v in free]


def _dofs(mesh: Mesh, face: str, axis: str) -> NDArray[np.int64]:
    checks.choice("axis", axis, list(AXES))
    return 3 * np.unique(mesh.face(face)) + AXES.index(axis)


def _value(mesh: Mesh, c: Displacement | Stretch) -> Array:
    if isinstance(c, Stretch):
        length = float(mesh.extent[AXES.index(checks.choice("axis", c.axis, list(AXES)))])
        return (checks.scalar(f"Stretch({c.axis!r})", c.value, "stretch") - 1.0) * length
    name = f"Displacement({c.face!r}, {c.axis!r})"
    if jnp.ndim(c.value) != 0:
        raise ValueError(f"{name}: value must be a scalar (mm); got shape {jnp.shape(c.value)}")
    return checks.finite_tree(name, c.value)


def _same(a: Array, b: Array) -> bool:
    return not checks.is_traced((a, b)) and bool(a == b)
