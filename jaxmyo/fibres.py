"""The fibre frame f, f⊥, n at the quadrature points, from vectors per element, per node, per point, or functions.

Vectors need not be of unit length nor orthogonal: they are normalised, and f⊥ is taken normal to f. What is more than
rounding in a file (`ROUNDING`) is said by a UserWarning.
"""

import warnings
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxmyo.hexahedron import shape
from jaxmyo.mesh import Mesh

#: What passes silently: a length that is off 1 by so much [–], an angle that is off 90° by so much [rad].
ROUNDING = 1e-3
#: The length of a vector up to which it has no direction [–].
SHORT = 1e-6


def frame(mesh: Mesh, xi: NDArray[np.float64], fibre: Any, cross: Any) -> NDArray[np.float64]:
    """Rows f, f⊥, n = f × f⊥ at the points xi (n_points, 3) of every element: (n_elements, n_points, 3, 3).

    fibre, cross: as of `Scene`, along the local unit vectors of the mesh's coordinates. Vectors at nodes are made
    unit vectors, interpolated by the shape functions, and made unit vectors again; whether they are orthogonal is then
    judged at the nodes. Errors name the element and the point, or the node: vectors that are zero, not finite or
    parallel.
    """
    f, f_nodes = _directions("fibre", fibre, mesh, xi)
    c, c_nodes = _directions("cross", cross, mesh, xi)
    normal = c - _dot(f, c)[..., None] * f
    length = np.linalg.norm(normal, axis=-1)
    if (length < ROUNDING).any():
        e, g = _first(length < ROUNDING)
        raise ValueError(f"fibre and cross are parallel in element {e}, point {g}: {f[e, g]} and {c[e, g]}")
    nodal = f_nodes is not None and c_nodes is not None
    off = np.abs(np.arcsin(np.clip(_dot(f_nodes, c_nodes) if nodal else _dot(f, c), -1.0, 1.0)))
    if (off > ROUNDING).any():
        place = ("node {}" if nodal else "element {}, point {}").format(*_first(off == off.max()))
        message = f"{np.degrees(off.max()):.3g}° off at most ({place}); cross is made normal to fibre"
        warnings.warn(f"fibre and cross are not orthogonal, {message}", UserWarning, stacklevel=4)
    c = normal / length[..., None]
    return np.stack([f, c, np.cross(f, c)], axis=-2)


def traced_frame(mesh: Mesh, xi: NDArray[np.float64], fibre: Any, cross: Any) -> tuple[Array, Array]:
    """The same frame, of vectors that JAX traces, and whether all of them have a direction.

    Those that have none, which are errors of `frame`, are replaced, so that no derivative by them is NaN.
    """
    N = shape(xi)
    f, f_good = _traced_directions("fibre", fibre, mesh, N)
    c, c_good = _traced_directions("cross", cross, mesh, N)
    c, good = _traced_unit(c - jnp.sum(f * c, axis=-1, keepdims=True) * f, ROUNDING)
    return jnp.stack([f, c, jnp.cross(f, c)], axis=-2), f_good & c_good & good


def _traced_directions(name: str, value: Any, mesh: Mesh, N: NDArray[np.float64]) -> tuple[Array, Array]:
    """Unit vectors at the points (n_elements, n_points, 3), and whether all were vectors with a direction."""
    array, good = jnp.asarray(value, dtype=float), jnp.array(True)
    _check_shape(name, array.shape, mesh, len(N))
    if array.shape == (len(mesh.points), 3):
        nodes, good = _traced_unit(array)
        array = jnp.einsum("ga,eai->egi", N, nodes[mesh.cells])
    array = array[:, None] if array.ndim == 2 else array[(None,) * (3 - array.ndim)]
    unit, also = _traced_unit(array)
    return jnp.broadcast_to(unit, (len(mesh.cells), len(N), 3)), good & also


def _traced_unit(vectors: Array, least: float = SHORT) -> tuple[Array, Array]:
    """Vectors (..., 3) of unit length, and whether all were long enough; those that were not become (1, 1, 1)/√3."""
    square = jnp.sum(vectors**2, axis=-1, keepdims=True)
    good = (square > least**2) & jnp.isfinite(square)
    vectors = jnp.where(good, vectors, 1.0)
    return vectors / jnp.linalg.norm(vectors, axis=-1, keepdims=True), jnp.all(good)


def _check_shape(name: str, shape: tuple[int, ...], mesh: Mesh, n_points: int) -> None:
    """Errors for what is no field of vectors, and for one that could be per element or per node."""
    n_e, n_n = len(mesh.cells), len(mesh.points)
    full = (n_e, n_points, 3)
    if shape not in ((3,), (n_e, 3), (n_n, 3), full):
        raise ValueError(
            f"{name} must have shape (3,), ({n_e}, 3) per element, ({n_n}, 3) per node or {full} per quadrature point; "
            f"got {shape}"
        )
    if len(shape) == 2 and n_e == n_n:
        raise ValueError(
            f"{name} of shape {shape} is ambiguous: the mesh has as many nodes as elements ({n_n}); give it per "
            f"quadrature point, {full}"
        )


def _directions(
    name: str, value: Any, mesh: Mesh, xi: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Unit vectors (n_elements, n_points, 3); and those at the nodes (n_nodes, 3), if they were given there."""
    n_e, n_n, N = len(mesh.cells), len(mesh.points), shape(xi)
    if isinstance(value, str):
        if value not in mesh.fields:
            known = ", ".join(map(repr, sorted(mesh.fields))) or "none"
            raise ValueError(f"{name} = {value!r} is not a field of the mesh; fields: {known}")
        name, value = f"{name} = {value!r}", mesh.fields[value]
    elif callable(value):
        at = np.einsum("ga,eai->egi", N, mesh.points[mesh.cells])
        value = np.reshape(value(at.reshape(-1, 3)), at.shape)
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} must be numbers, vectors; got {value!r}") from error
    _check_shape(name, array.shape, mesh, len(xi))
    full = (n_e, len(xi), 3)
    if array.shape == (n_n, 3):
        nodes = _unit(name, array, "node {}")
        inside = np.einsum("ga,eai->egi", N, nodes[mesh.cells])
        return _unit(f"{name}, interpolated,", inside, "element {}, point {}", warn=False), nodes
    full_array = np.broadcast_to(array[:, None] if array.ndim == 2 else array, full)
    return _unit(name, full_array, "element {}, point {}"), None


def _unit(name: str, vectors: NDArray[np.float64], place: str, *, warn: bool = True) -> NDArray[np.float64]:
    """Vectors (..., 3) of unit length; an error for zero, NaN and infinity, which says where."""
    length = np.linalg.norm(vectors, axis=-1)
    if not (good := (length > SHORT) & np.isfinite(length)).all():
        where = _first(~good)
        raise ValueError(
            f"{name} must be vectors with a direction, finite and not zero; got {vectors[where]} in "
            f"{place.format(*where)}"
        )
    off = np.abs(length - 1.0)
    if warn and (off > ROUNDING).any():
        where = _first(off == off.max())
        message = f"{name}: vectors are made unit vectors; the length in {place.format(*where)} is {length[where]:.6g}"
        warnings.warn(message, UserWarning, stacklevel=6)
    return np.asarray(vectors / length[..., None])


def _dot(a: Any, b: Any) -> NDArray[np.float64]:
    return np.einsum("...i,...i->...", a, b)


def _first(where: NDArray[np.bool_]) -> tuple[int, ...]:
    return tuple(int(i) for i in np.argwhere(where)[0])
