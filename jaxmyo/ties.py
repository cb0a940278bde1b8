"""Ties: `full = offset + scale · reduced[index]`, one gather for every kinematic condition.

A Dirichlet value, a symmetry plane, a face that stays plane, axial symmetry, generalised plane strain and a homogeneous
deformation are all of this form, so that a body of one unknown and one of a million run through the same elements and
the same solver.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxmyo import checks, surface, tracing
from jaxmyo.conditions import Displacement, Homogeneous, Planar, Proportional, Shear, Spring, Stretch, Tie, Uniform
from jaxmyo.coordinates import Coordinates, evaluate
from jaxmyo.mesh import Mesh


@dataclass(frozen=True)
class Ties:
    """The kinematics of a body with `size` unknown displacements.

    index, scale: (n_dof,) with n_dof = 3 n_nodes; free: (n_dof,) whether it hangs on an unknown; offset: (n_dof,)
    prescribed displacements [mm, rad].
    """

    index: NDArray[np.int64]
    scale: Any
    free: NDArray[np.bool_]
    offset: Array
    size: int


def build(mesh: Mesh, conditions: Sequence[Tie], points: Any = None) -> Ties:
    """The ties of a mesh under a list of conditions. Errors name the condition, and a conflict names both.

    points: (n_nodes, 3) that take the place of the mesh's, which decide what is tied to what.
    """
    n_dof = mesh.points.size
    at, xp = (mesh.points, np) if points is None else (points, jnp)
    group, scale = np.arange(n_dof), np.ones(n_dof)  # u_i = scale_i · unknown of its group
    actual: Any = scale  # the scale, at the points that take the place of the mesh's
    tied: dict[int, Tie] = {}
    for c, whole in _of_whole_components(mesh, conditions):
        component = mesh.axis(whole.axis)
        dofs = 3 * np.arange(len(mesh.points)) + component
        if component in tied:
            raise ValueError(f"{c} contradicts {tied[component]}: both tie u_{whole.axis} of the whole body")
        tied[component] = c
        if isinstance(whole, Proportional):
            group[dofs], scale[dofs] = dofs[0], mesh.points[:, mesh.axis(whole.to)]
            if points is not None:
                actual = jnp.asarray(actual).at[dofs].set(at[:, mesh.axis(whole.to)])
        else:
            group[dofs] = dofs[_first_of_each_line(mesh, whole)]
    for plane in conditions:
        if isinstance(plane, Planar):
            dofs = _dofs(mesh, plane.face, plane.axis)
            if np.ptp(scale[dofs]) > 1e-12 * np.abs(scale[dofs]).max():
                raise ValueError(f"{plane} contradicts another tie: the face is not plane along {plane.axis}")
            group[np.isin(group, group[dofs])] = group[dofs].min()
    fixed = [c for c in conditions if isinstance(c, Displacement | Stretch)]
    owner, asked_of = np.full(n_dof, -1), np.ones(n_dof)  # which condition prescribes a group, at nodes of which scale
    offset: Any = np.zeros(n_dof)
    for k, f in enumerate(fixed):
        dofs = _dofs(mesh, f.face if isinstance(f, Displacement) else f"{f.axis}1", f.axis)
        value = _value(mesh, f, at)
        if tracing.is_traced(value) or float(value) != 0.0:
            if (scale[dofs] == 0.0).any():
                raise ValueError(f"{f} contradicts another tie, which does not move that face along {f.axis}")
            if np.ptp(scale[dofs]) > 1e-12 * np.abs(scale[dofs]).max():
                raise ValueError(f"{f} contradicts another tie, which does not move that face as a whole")
        dofs = dofs[scale[dofs] != 0.0]  # a node that another tie does not move is where it is
        for g, first in zip(*np.unique(group[dofs], return_index=True), strict=True):
            j = owner[g]
            if j >= 0 and not _same(_value(mesh, fixed[j], at) / asked_of[g], value / scale[dofs[first]]):
                raise ValueError(f"{f} contradicts {fixed[j]}: both prescribe {f.axis} of the same nodes")
        dofs = dofs[owner[group[dofs]] < 0]
        owner[group[dofs]], asked_of[group[dofs]] = k, scale[dofs]
        one = np.arange(n_dof)  # of each group that is prescribed, one of the nodes that the condition names
        one[group[dofs]] = dofs
        moved = np.isin(group, group[dofs])
        # What one unit of the condition does to each displacement of these groups.
        offset = offset + xp.where(moved, actual / xp.where(moved, actual[one[group]], 1.0), 0.0) * value
    offset = tracing.floats(offset)
    for s in conditions:
        if isinstance(s, Shear):
            offset = offset.at[mesh.axis(s.axis) :: 3].add(_shear(mesh, s) * jnp.asarray(at[:, mesh.axis(s.to)]))
    moving = np.unique(group[scale != 0.0])
    free = (owner[group] < 0) & np.isin(group, moving)
    unknown = np.unique(group[free])
    index = np.where(free, np.searchsorted(unknown, group), 0)
    index = np.minimum(index, max(len(unknown) - 1, 0))
    return Ties(index, xp.where(free, actual, 0.0), free, offset, len(unknown))


def rigid_motions(mesh: Mesh, ties: Ties, springs: Sequence[Spring]) -> list[str]:
    """Names of the rigid motions that ties and springs leave free (to first order), e.g. "rotation about z"."""
    c = mesh.coordinates
    x = evaluate(c.position, mesh.points)
    centre = x.mean(axis=0) * np.array([0.0, 0.0, 1.0] if c.curved else 1.0)  # on the axis that a body may turn about
    size = np.abs(x - centre).max()

    def rigid(theta: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return _rigid(c, theta, centre, size)

    at_nodes = _conjugate(*rigid(mesh.points))
    R = at_nodes.reshape(-1, 6)
    blocked = [R - ties.scale[:, None] * projected(R, ties.index, ties.scale, ties.size)[ties.index]]
    if c.curved:
        # An element that spans a large angle has no rigid motion where its nodes have one.
        middle = mesh.points[mesh.cells].mean(axis=1)
        along, g = rigid(middle)
        strained = (at_nodes[mesh.cells].mean(axis=1) * g[:, :, None] - along).reshape(-1, 6)
        blocked.append(np.where(np.abs(strained).max(axis=0) > 0.3, strained, 0.0))
    for spring in springs:
        if not tracing.is_traced(spring.stiffness) and float(np.asarray(spring.stiffness)) == 0.0:
            continue
        quads = mesh.points[mesh.face(spring.face)]
        at, normals = evaluate(_normals_of(c), quads).swapaxes(0, 1).reshape(2, -1, 3)
        moved, _ = rigid(at)
        if spring.direction == "normal":
            moved = np.einsum("qi,qim->qm", normals / np.linalg.norm(normals, axis=1)[:, None], moved)
        blocked.append(moved.reshape(-1, 6))
    rows = np.concatenate(blocked)
    _, singular, vt = np.linalg.svd(np.linalg.qr(rows, mode="r"))
    free = vt[singular < 1e-9 * np.sqrt(len(rows))]
    names = [f"translation along {a}" for a in "xyz"] + [f"rotation about {a}" for a in "xyz"]
    return [names[int(np.argmax(np.abs(v)))] for v in free]


@lru_cache
def _normals_of(c: Coordinates) -> Callable[[Any], Array]:
    """One function per system of coordinates, which is compiled once."""

    def normals(quad: Any) -> Array:
        return jnp.stack(surface.normals(c, quad))

    return normals


def rigid_unknowns(
    c: Coordinates, points: NDArray[np.float64], index: NDArray[np.int64], scale: NDArray[np.float64], size: int
) -> NDArray[np.float64]:
    """The unknowns (size, 6) that come closest to the six rigid motions; points: (n_nodes, 3)."""
    x = evaluate(c.position, points)
    motions = _conjugate(*_rigid(c, points, x.mean(axis=0), np.abs(x - x.mean(axis=0)).max()))
    return projected(motions.reshape(-1, 6), index, scale, size)


def _rigid(
    c: Coordinates, theta: NDArray[np.float64], centre: NDArray[np.float64], size: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Six motions at points θ (n, 3), along the local unit vectors: (n, 3, 6); and the scale factors (n, 3)."""
    X = (evaluate(c.position, theta) - centre) / size
    basis = np.nan_to_num(evaluate(c.basis, theta))  # there is no e_φ on an axis
    axes = np.broadcast_to(np.eye(3)[None], (len(X), 3, 3))
    motions = np.concatenate([axes, np.cross(np.eye(3)[None], X[:, None]).swapaxes(1, 2)], axis=2)
    return basis @ motions, evaluate(c.g, theta)


def projected(motions: Any, index: Any, scale: Any, size: int) -> Any:
    """The unknowns (size, k) that come closest to motions (n_dof, k): a sum over what hangs on each unknown."""
    index, scale, motions = (tracing.known(x) for x in (index, scale, motions))
    xp, length = tracing.numpy_for(index, scale, motions), max(size, 1)

    def collected(x: Any) -> Any:
        return np.bincount(index, x, length) if xp is np else jnp.zeros(length).at[index].add(x)

    norm = collected(scale**2)
    norm = xp.where(norm == 0.0, 1.0, norm)
    return xp.stack([collected(scale * m) / norm for m in motions.T], axis=1)


def _conjugate(along: NDArray[np.float64], g: NDArray[np.float64]) -> NDArray[np.float64]:
    """δθ_i = e_i · δx / g_i (n, 3, k) of motions along the local unit vectors; 0 on an axis."""
    return np.divide(along, g[:, :, None], out=np.zeros_like(along), where=g[:, :, None] > 1e-12 * g.max())


def _of_whole_components(mesh: Mesh, conditions: Sequence[Tie]) -> list[tuple[Tie, Uniform | Proportional]]:
    """The ties of whole components, with the conditions that they come from; a homogeneous deformation is three."""
    found: list[tuple[Tie, Uniform | Proportional]] = []
    for c in conditions:
        if isinstance(c, Homogeneous):
            if mesh.coordinates.curved:
                raise ValueError(
                    f"Homogeneous() needs Cartesian coordinates; the mesh has {mesh.coordinates.name} ones"
                )
            found += [(c, Proportional(a, a)) for a in mesh.coordinates.axes]
        elif isinstance(c, Uniform | Proportional):
            found.append((c, c))
    return found


def _first_of_each_line(mesh: Mesh, c: Uniform) -> NDArray[np.int64]:
    """For each node the first node of the line (plane, body) along which a component is uniform."""
    along = {mesh.axis(a) for a in c.along}
    across = [k for k in range(3) if k not in along]
    if not across:
        return np.zeros(len(mesh.points), dtype=np.int64)
    key = np.round(mesh.points[:, across] / mesh.extent[across] * 1e9).astype(np.int64)
    _, first, which = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return np.asarray(first[which.reshape(-1)])


def _dofs(mesh: Mesh, face: str, axis: str) -> NDArray[np.int64]:
    component = mesh.axis(axis)
    return 3 * np.unique(mesh.face(face)) + component


def _value(mesh: Mesh, c: Displacement | Stretch, points: Any) -> Any:
    if isinstance(c, Stretch):
        # Means over the nodes at both ends, which are all the same until the nodes are moved.
        along, at_rest = points[:, mesh.axis(c.axis)], mesh.points[:, mesh.axis(c.axis)]
        close = 1e-9 * np.ptp(at_rest)
        length = along[at_rest >= at_rest.max() - close].mean() - along[at_rest <= at_rest.min() + close].mean()
        return (tracing.known(checks.scalar(f"Stretch({c.axis!r})", c.value, "stretch")) - 1.0) * length
    name = f"Displacement({c.face!r}, {c.axis!r})"
    if jnp.ndim(c.value) != 0:
        raise ValueError(f"{name}: value must be a scalar (mm, rad); got shape {jnp.shape(c.value)}")
    return tracing.known(checks.finite_tree(name, c.value))


def _shear(mesh: Mesh, s: Shear) -> Array:
    if mesh.coordinates.curved:
        raise ValueError(f"{s} needs Cartesian coordinates; the mesh has {mesh.coordinates.name} ones")
    if s.axis == s.to:
        raise ValueError(f"{s}: axis and to must differ; Stretch prescribes a stretch")
    if jnp.ndim(s.value) != 0:
        raise ValueError(f"{s}: value must be a scalar (–, the amount of shear); got shape {jnp.shape(s.value)}")
    return jnp.asarray(checks.finite_tree(f"Shear({s.axis!r}, {s.to!r})", s.value))


def _same(a: Array, b: Array) -> bool:
    return not tracing.is_traced((a, b)) and bool(a == b)
