"""Redundant constraints: are the conditions det F = 1 and h = 0 of a body independent of each other?

An element of a tube with planar ends and struts along its axis must meet both; with one p and one q per element, three
elements through the wall have more conditions than displacements. Then q is not unique, or nothing can move.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from numpy.typing import NDArray

from jaxmyo import element_batches, tracing
from jaxmyo.coordinates import evaluate
from jaxmyo.invariants import weave_h
from jaxmyo.scene import Scene
from jaxmyo.system import Inputs, System

_CHEAP = 3e8  # operations of the singular values, well below a second
_ZERO = 1e-9  # singular values of normalised rows, relative to the largest


def check_at_rest(scene: Scene, system: System, a_over_D: ArrayLike | None, *, soft: bool) -> None:
    """A ValueError if the constraints, linearised at rest, are redundant. The rank is computed where that is cheap.

    Nor may the weave leave a mesh no displacement free: such a body is locked, and q has nothing to do with its muscle.
    soft: the weave has a finite stiffness, and is no constraint. A traced a/D is taken as 0.2.
    """
    hard = _hard(system, soft=soft)
    n_p, n_q = system.n_p, len(hard) - system.n_p
    if system.n_u == 0:
        return
    if system.gradient is None or (n_p + n_q) ** 2 * system.n_u > _CHEAP:
        if n_p + n_q > system.n_u:
            raise ValueError(_message(scene, n_p, n_q, system.n_u, min(n_p, system.n_u), system.n_u))
        return
    value = 0.2 if a_over_D is None or tracing.is_traced(a_over_D) else float(np.asarray(a_over_D))
    B = _jacobian_at_rest(system, value)[hard]
    rank_p, rank = _rank(B[:n_p]), _rank(B)
    locked = n_q > 0 and rank == system.n_u and len(system.cells) > 1
    if rank < n_p + n_q or locked:
        raise ValueError(_message(scene, n_p, n_q, system.n_u, rank_p, rank))


def at_failure(system: System, z: Array, inputs: Inputs) -> str:
    """For a solve that failed: a sentence if the constraints are redundant at its last state, else nothing."""
    if tracing.is_traced((system, z, inputs)):
        return ""
    hard = _hard(system, soft=float(inputs.softness) != 0.0)
    n_u, n_hard = system.n_u, len(hard)
    if n_u == 0 or system.gradient is None or n_hard**2 * n_u > 10.0 * _CHEAP:
        return ""
    _, K = jax.jit(element_batches.residual_and_tangent)(system, z, inputs)
    B = np.asarray(K)[n_u + hard, :n_u]
    rank = _rank(_normalised(system, B))
    if rank == n_hard:
        return ""
    return f" There the {n_hard} constraints are redundant: only {rank} of them are independent of each other."


def _hard(system: System, *, soft: bool) -> NDArray[np.int64]:
    """The multipliers that stand for a condition, numbered from 0: all p, and the q of elements with the weave."""
    acts = np.array([kind.weave and system.weave and not soft for kind in system.kinds])[np.asarray(system.material)]
    q = np.asarray(system.local_multipliers)[acts, 1:] - system.n_u
    return np.concatenate([np.arange(system.n_p), np.unique(q)])


def _jacobian_at_rest(system: System, a_over_D: float) -> NDArray[np.float64]:
    """The rows of −½ (I3 − 1) and −½ h (n_p + n_q, n_u), integrated over the patches, in normalised form."""
    B = np.zeros((system.size, system.n_u))
    own = np.asarray(system.local_u)
    for row, patch in zip(rows_at_rest(system, a_over_D), np.asarray(system.local_multipliers).T, strict=True):
        np.add.at(B, (patch[:, None], own), row)
    return _normalised(system, B[system.n_u :])


def rows_at_rest(system: System, a_over_D: float) -> list[NDArray[np.float64]]:
    """The derivatives at rest of −½ (I3 − 1), and of −½ h where the weave acts, by an element's own displacements.

    Each (n_elements, n_local) [mm², or mm³ for an angle], integrated over the element; of a small system.
    """
    dF = np.asarray(system.gradient).reshape(*system.weight.shape, 3, 3, -1)
    weight, frame = np.asarray(system.weight), np.asarray(system.frame)
    rows = [-np.einsum("eg,egiil->el", weight, dF)]
    if system.weave:
        by_4, by_6 = (float(d) for d in evaluate(_slopes_at_rest, np.array([a_over_D]))[0])
        along, across = (
            np.einsum("eg,egi,egijl,egj->el", weight, frame[:, :, k], dF, frame[:, :, k], optimize=True) for k in (0, 1)
        )
        rows.append(-by_4 * along - by_6 * across)
    return rows


def _slopes_at_rest(a_over_D: Array) -> Array:
    """h4 and h6 (2,) at rest."""
    one = jnp.ones(())
    return jnp.stack(jax.grad(weave_h, argnums=(0, 1))(one, one, a_over_D))


def _normalised(system: System, B: NDArray[np.float64]) -> NDArray[np.float64]:
    """Columns by the strain that each unknown makes, then rows to length one (zero rows stay)."""
    strain = np.zeros(system.n_u)
    np.add.at(
        strain, np.asarray(system.local_u), np.einsum("eg,egil->el", system.weight, np.asarray(system.gradient) ** 2)
    )
    B = B / np.sqrt(strain)[None, :]
    length = np.linalg.norm(B, axis=1, keepdims=True)
    return np.asarray(B / np.where(length > 0.0, length, 1.0))


def _rank(B: NDArray[np.float64]) -> int:
    if not B.size:
        return 0
    singular = np.linalg.svd(B, compute_uv=False)
    return int(np.sum(singular > _ZERO * max(singular[0], 1.0)))


def _message(scene: Scene, n_p: int, n_q: int, n_u: int, rank_p: int, rank: int) -> str:
    what = f"incompressibility ({n_p} pressures p)" + (f" and the weave ({n_q} multipliers q)" if n_q else "")
    axes = " or ".join(f'jaxmyo.columns(mesh, "{a}")' for a in scene.mesh.coordinates.axes[:1])
    proposals = []
    if n_q:
        proposals += [f"one q per column of elements, q_patches={axes}", "a finite weave_stiffness [kPa]"]
    if rank_p < n_p:
        proposals.append(
            "one p per block or column of elements, p_patches=jaxmyo.blocks(mesh) or jaxmyo.columns(mesh, axis)"
        )
    kind = "over-determined" if n_p + n_q > n_u else "redundant" if rank < n_p + n_q else "locking the body"
    return (
        f"the constraints are {kind}: {what} are {n_p + n_q} conditions on {n_u} displacements, and only {rank} of "
        f"them are independent (of incompressibility alone: {rank_p}). "
        f"Try {', or '.join(proposals) or 'fewer supports'}."
    )
