"""Loads: dead and follower tractions, pressure in deformed geometry, springs, body forces; volumes of cavities.

Each kind of load is one function of the deformed and the reference nodes of a quad (of a hexahedron, for body forces).
The forces are conjugate to the world coordinates: mN for a length, mN·mm for an angle.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxmyo import checks, tracing
from jaxmyo.conditions import BodyForce, Condition, Load, Pressure, Spring, Traction, Volume
from jaxmyo.coordinates import Coordinates, evaluate
from jaxmyo.hexahedron import gauss, shape, shape_gradient
from jaxmyo.mesh import Mesh

_XI, _W = gauss(2, 2)
_N, _DN = shape(_XI), shape_gradient(_XI)
_XI3, _W3 = gauss(2, 2, 2)
_N3, _DN3 = shape(_XI3), shape_gradient(_XI3)


def normals(c: Coordinates, theta: Array) -> tuple[Array, Array]:
    """At the Gauss points of a quad with nodes θ (4, 3): the coordinates (4, 3), and normal × area × weight (4, 3)."""
    at = jnp.asarray(_N, theta.dtype) @ theta
    tangents = jnp.einsum("gak,ai->gki", jnp.asarray(_DN, theta.dtype), theta) * jax.vmap(c.g)(at)[:, None, :]
    return at, jnp.cross(tangents[:, 0], tangents[:, 1]) * jnp.asarray(_W, theta.dtype)[:, None]


def _on_nodes(c: Coordinates, at: Array, physical: Array) -> Array:
    """Forces (4, 3) at Gauss points, along the local unit vectors, as forces conjugate to the nodal coordinates."""
    return jnp.asarray(_N, at.dtype).T @ (physical * jax.vmap(c.g)(at))


def _traction(area: Array, c: Coordinates, theta: Array, vector: Array) -> Array:
    at = jnp.asarray(_N, theta.dtype) @ theta
    return _on_nodes(c, at, jnp.linalg.norm(area, axis=-1)[:, None] * vector[None, :])


def _nominal(c: Coordinates, theta: Array, reference: Array, vector: Array) -> Array:
    return _traction(normals(c, reference)[1], c, theta, vector)


def _cauchy(c: Coordinates, theta: Array, reference: Array, vector: Array) -> Array:
    return _traction(normals(c, theta)[1], c, theta, vector)


def _open(c: Coordinates, theta: Array, reference: Array, pressure: Array) -> Array:
    at, normal = normals(c, theta)
    return _on_nodes(c, at, -pressure * normal)


def _closed(c: Coordinates, theta: Array, reference: Array, pressure: Array) -> Array:
    return pressure * jax.grad(lambda nodes: cavity_volume(c, nodes))(theta)


def _spring(c: Coordinates, theta: Array, reference: Array, stiffness: Array) -> Array:
    return -jax.grad(lambda nodes: _spring_energy(c, nodes, reference, stiffness, normal=False))(theta)


def _normal_spring(c: Coordinates, theta: Array, reference: Array, stiffness: Array) -> Array:
    return -jax.grad(lambda nodes: _spring_energy(c, nodes, reference, stiffness, normal=True))(theta)


def _spring_energy(c: Coordinates, theta: Array, reference: Array, stiffness: Array, *, normal: bool) -> Array:
    At, N = normals(c, reference)
    area = jnp.linalg.norm(N, axis=-1)
    u = jax.vmap(c.position)(jnp.asarray(_N, theta.dtype) @ theta) - jax.vmap(c.position)(At)
    if normal:  # the normal in Cartesian components
        direction = jnp.einsum("gi,gij->gj", N / area[:, None], jax.vmap(c.basis)(At))
        return 0.5 * stiffness * jnp.sum(area * jnp.sum(u * direction, axis=-1) ** 2)
    return 0.5 * stiffness * jnp.sum(area * jnp.sum(u**2, axis=-1))


def cavity_volume(c: Coordinates, theta: Array) -> Array:
    """What a quad (4, 3) adds to the volume [mm³] of the cavity that it bounds: −½ ∫ (x n_x + y n_y) da.

    The field ½ (x, y, 0) has divergence 1 and no flux through planes that contain the z axis or are normal to it.
    """
    at = jnp.asarray(_N, theta.dtype) @ theta
    by_xi = jnp.einsum("gak,ai->gki", jnp.asarray(_DN, theta.dtype), theta)
    x = jax.vmap(c.position)(at)
    tangents = jnp.einsum("gij,gkj->gki", jax.vmap(jax.jacfwd(c.position))(at), by_xi)
    normal = jnp.cross(tangents[:, 0], tangents[:, 1])
    return -0.5 * jnp.sum(jnp.asarray(_W, at.dtype) * jnp.sum((x * normal)[:, :2], axis=-1))


def _body(c: Coordinates, theta: Array, reference: Array, vector: Array) -> Array:
    jacobian = jnp.einsum("ai,gaj->gij", reference, jnp.asarray(_DN3, theta.dtype))
    scale_factors = jnp.prod(jax.vmap(c.g)(jnp.asarray(_N3, theta.dtype) @ reference), axis=-1)
    volume = jnp.linalg.det(jacobian) * scale_factors * jnp.asarray(_W3, theta.dtype)
    return jnp.asarray(_N3, theta.dtype).T @ (
        volume[:, None] * vector[None] * jax.vmap(c.g)(jnp.asarray(_N3, theta.dtype) @ theta)
    )


#: kind of load → (coordinates, deformed nodes θ (4 or 8, 3), reference nodes Θ, value) ↦ forces (4 or 8, 3).
FORCES: dict[str, Callable[[Coordinates, Array, Array, Array], Array]] = {
    "nominal": _nominal,
    "cauchy": _cauchy,
    "open": _open,
    "closed": _closed,
    "spring": _spring,
    "normal spring": _normal_spring,
    "body": _body,
}


def build(mesh: Mesh, loads: Sequence[Load | Spring]) -> tuple[dict[str, NDArray[np.int64]], dict[str, Array]]:
    """The quads (n, 4) and the values, (n, 3) or (n,) [kPa, kPa/mm], of each kind of load that acts on a mesh.

    For body forces the hexahedra (n, 8) instead of the quads. Errors name the load: unknown faces and kinds, values
    that are not finite or of the wrong shape, springs < 0.
    """
    quads: dict[str, list[NDArray[np.int64]]] = {}
    values: dict[str, list[Any]] = {}
    for load in loads:
        own = _loaded(mesh, load)
        kind, value = _kind_and_value(load)
        quads.setdefault(kind, []).append(own)
        each = tracing.known(value)[None]
        values.setdefault(kind, []).append(tracing.numpy_for(each).broadcast_to(each, (len(own), *value.shape)))
    of_kinds = {k: tracing.floats(tracing.numpy_for(v).concatenate(v)) for k, v in values.items()}
    return {k: np.concatenate(v) for k, v in quads.items()}, of_kinds


def values(mesh: Mesh, conditions: Sequence[Load | Spring], loads: Mapping[str, Array]) -> list[str]:
    """What each condition amounts to in the loads of a state, in words with units, e.g. "Pressure('inner') 8 kPa".

    The quads of the conditions are the last ones of each kind.
    """
    beyond = {kind: len(v) for kind, v in loads.items()}
    found = []
    for c in reversed(conditions):
        kind, _ = _kind_and_value(c)
        beyond[kind] -= len(_loaded(mesh, c))
        numbers = " ".join(f"{x:.7g}" for x in np.ravel(np.asarray(loads[kind][beyond[kind]])) + 0.0)
        found.append(f"{_name(c)} {numbers} {'kPa' if isinstance(c, Traction | Pressure) else 'kPa/mm'}")
    return found[::-1]


def springs_are_valid(loads: Mapping[str, Array]) -> Any:
    """Whether no spring has a negative stiffness, as a flag that may be traced."""
    stiffness = [v for kind, v in loads.items() if kind in ("spring", "normal spring")]
    return tracing.every(True, *((tracing.known(v) >= 0.0).all() for v in stiffness))


def _loaded(mesh: Mesh, load: Load | Spring) -> NDArray[np.int64]:
    """The quads, or the hexahedra, that a load acts on."""
    if isinstance(load, BodyForce):
        return mesh.cells if load.region is None else mesh.cells[mesh.region(load.region)]
    return mesh.face(load.face)


def _kind_and_value(load: Load | Spring) -> tuple[str, Array]:
    if isinstance(load, BodyForce):
        return "body", _value(load, load.vector, (3,), "kPa/mm = mN/mm³")
    if isinstance(load, Traction):
        return checks.choice("measure", load.measure, ["nominal", "cauchy"]), _value(load, load.vector, (3,), "kPa")
    if isinstance(load, Pressure):
        return checks.choice("ends", load.ends, ["open", "closed"]), _value(load, load.value, (), "kPa")
    stiffness = _value(load, load.stiffness, (), "kPa/mm")
    if not tracing.is_traced(stiffness) and float(stiffness) < 0.0:
        raise ValueError(f"{_name(load)}: stiffness = {load.stiffness} must be ≥ 0 (kPa/mm)")
    kind = checks.choice("direction", load.direction, ["all", "normal"])
    return ("spring" if kind == "all" else "normal spring"), stiffness


def _value(load: Load | Spring, value: Any, shape: tuple[int, ...], unit: str) -> Array:
    name = _name(load)
    array = tracing.floats(value if tracing.is_traced(value) else checks.concrete(name, value, shape))
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape} ({unit}); got {array.shape}")
    return array


def _name(load: Load | Spring) -> str:
    if isinstance(load, BodyForce):
        return "BodyForce" if load.region is None else f"BodyForce({load.region!r})"
    return f"{type(load).__name__}({load.face!r})"


def cavities(mesh: Mesh, conditions: Sequence[Condition]) -> tuple[tuple[NDArray[np.int64], ...], Array]:
    """Of the `Volume`s among conditions: quads (n, 4) of the walls, and the volumes (n_cavities,) to enclose [mm³]."""
    found, wanted = [], []
    for condition in (c for c in conditions if isinstance(c, Volume)):
        name = f"Volume({condition.face!r})"
        quads = mesh.face(condition.face)
        at_rest = float(enclosed(mesh.coordinates, quads, mesh.points))
        if at_rest <= 1e-9 * float(np.ptp(evaluate(mesh.coordinates.position, mesh.points), axis=0).prod()):
            raise ValueError(
                f"{name}: the face encloses {at_rest:.3g} mm³ in the zero-stress state (must be > 0); it must be the "
                "whole wall of a cavity, up to caps normal to z and symmetry planes"
            )
        value = condition.value
        if not tracing.is_traced(value) and not float(checks.concrete(name, value, ())) > 0.0:
            raise ValueError(f"{name}: value = {value} must be > 0 (mm³; {at_rest:.6g} in the zero-stress state)")
        found.append(quads)
        wanted.append(value)
    xp = tracing.numpy_for(wanted)
    return tuple(found), tracing.floats(xp.stack(wanted) if wanted else [])


def enclosed(c: Coordinates, quads: Any, theta: Any) -> Array:
    """The volume [mm³] of the cavity whose wall are the quads (n, 4) of nodes with coordinates θ (n_nodes, 3)."""
    return jnp.sum(_cavity_volumes(c, jnp.asarray(theta)[quads]))


@partial(jax.jit, static_argnums=0)
def _cavity_volumes(c: Coordinates, theta: Array) -> Array:
    return jax.vmap(lambda nodes: cavity_volume(c, nodes))(theta)


class Loads(NamedTuple):
    """All loads of one kind, or of one cavity: on quads (n, 4) or hexahedra (n, 8), with values (n, ...)."""

    kind: str
    nodes: Array
    values: Array


def every(
    surfaces: Mapping[str, Array], loads: Mapping[str, Array], cavities: Sequence[Array], pressures: Any
) -> list[Loads]:
    """The loads by kind, and the pressure (n_cavities,) [kPa] in each cavity."""
    on_walls = [Loads("closed", w, jnp.broadcast_to(p, len(w))) for w, p in zip(cavities, pressures, strict=True)]
    return [Loads(kind, nodes, loads[kind]) for kind, nodes in surfaces.items()] + on_walls


def nodal_forces(c: Coordinates, loads: Sequence[Loads], theta: Array, reference: Array) -> Array:
    """The sum of all loads at the nodes (n_nodes, 3) [mN, mN·mm]; theta, reference: (n_nodes, 3) coordinates."""
    total = jnp.zeros(theta.shape)
    for kind, nodes, values in loads:
        total = total.at[nodes].add(forces(c, kind, theta[nodes], reference[nodes], values))
    return total


def forces(c: Coordinates, kind: str, theta: Array, reference: Array, values: Array) -> Array:
    """Forces (n, 4 or 8, 3) of one kind of load on n quads or hexahedra with nodes (n, 4 or 8, 3)."""
    return jax.vmap(lambda *one: FORCES[kind](c, *one))(theta, reference, values)


def tangents(c: Coordinates, kind: str, theta: Array, reference: Array, values: Array) -> Array:
    """Their derivatives (n, 12 or 24, 12 or 24) by the nodal coordinates."""
    by_theta = jax.vmap(lambda *one: jax.jacfwd(lambda nodes: FORCES[kind](c, nodes, *one[1:]))(one[0]))
    n = 3 * theta.shape[1]
    return by_theta(theta, reference, values).reshape(-1, n, n)
