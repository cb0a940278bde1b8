"""The discrete problem of one state: what drives it, its unknowns, and what is known of each Gauss point."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxmyo import tracing
from jaxmyo.coordinates import Coordinates, evaluate
from jaxmyo.energies import Kind
from jaxmyo.hexahedron import gauss, shape, shape_gradient
from jaxmyo.scene import Scene
from jaxmyo.ties import Ties


class Inputs(NamedTuple):
    """What a path of states is driven by. Every leaf may change along the path and may be differentiated.

    constants: the constants of each kind of material; T0 [kPa]; a_over_D [–]; beta [–]; softness: 1/k of the weave
    [1/kPa], 0 for an exact constraint; T_f, T_cf: (n_elements, n_points) tensions left by state A [kPa]; offset:
    (n_dof,) prescribed displacements [mm, rad]; loads: kind → values on the quads of `System.surfaces` [kPa, kPa/mm];
    volumes: (n_cavities,) that the cavities enclose [mm³]; imbalance: (size,) residual of the state that the path
    starts from, which fades along it.
    """

    constants: tuple[Any, ...]
    T0: Array
    a_over_D: Array
    beta: Array
    softness: Array
    T_f: Array
    T_cf: Array
    offset: Array
    loads: Mapping[str, Array]
    volumes: Array
    imbalance: Array


class Geometry(NamedTuple):
    """What takes the place of the scene's: points (n_nodes, 3) Θ [mm, rad]; frame (n_elements, n_points, 3, 3)."""

    points: Array
    frame: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class System:
    """The discrete problem of one state: geometry and bookkeeping, no material parameter and no load.

    The unknown vector is z = [displacements (n_u), p (n_p, one per patch), q (n_q, only with the weave), the pressures
    in cavities of prescribed volume (n_cavities)].

    columns: (n_elements, n_points, 3 or 4, n_local) derivatives of H_i1, H_i2, H_i3, and in curved coordinates of θ_i,
    by the local displacements, i the component that each moves; gradient: (n_elements, n_points, 9, n_local)
    ∂F/∂(local displacements) at rest; local_u: (n_elements, n_local) the displacements in z that an element feels;
    these three are None for a large body; slots: how many of the local displacements move each component, the first
    ones the first; whole: whether there is one element, which feels the displacements of z in their order;
    local_multipliers: (n_elements, 1 or 2) positions in z of the element's p and q; material: (n_elements,) which of
    the `kinds` an element is made of; weight: (n_elements, n_points) [mm³]; frame: (n_elements, n_points, 3, 3);
    N: (n_points, 8); dN: (n_elements, n_points, 8, 3) ∂N/∂Θ_j / g_j(Θ) [1/mm]; theta, inverse_g: (n_elements, n_points,
    3) Θ and 1/g(Θ); cells: (n_elements, 8); tie_index, tie_scale: (n_dof,); surfaces: kind of load → (n_quads, 4), or
    (n, 8) hexahedra; cavities: the walls (n_quads, 4) of each; points: (n_nodes, 3) Θ [mm, rad]; own_geometry: whether
    points and frame are not the scene's.
    """

    kinds: tuple[Kind, ...] = field(metadata={"static": True})
    coordinates: Coordinates = field(metadata={"static": True})
    weave: bool = field(metadata={"static": True})
    n_u: int = field(metadata={"static": True})
    n_p: int = field(metadata={"static": True})
    n_q: int = field(metadata={"static": True})
    own_geometry: bool = field(metadata={"static": True})
    slots: tuple[int, ...] = field(metadata={"static": True})
    whole: bool = field(metadata={"static": True})
    columns: Array | None
    gradient: Array | None
    weight: Array
    frame: Array
    local_u: Array | None
    local_multipliers: Array
    material: Array
    N: Array
    dN: Array
    theta: Array
    inverse_g: Array
    cells: Array
    tie_index: Array
    tie_scale: Array
    surfaces: Mapping[str, Array]
    cavities: tuple[Array, ...]
    points: Array

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.n_u + self.n_p + self.n_q + len(self.cavities)

    @property
    def is_small(self) -> bool:
        """Whether its matrices are dense."""
        return self.columns is not None

    @property
    def geometry(self) -> Geometry | None:
        """The geometry, if it is not the scene's."""
        return Geometry(self.points, self.frame) if self.own_geometry else None

    @property
    def multipliers(self) -> int:
        """Multipliers that an element feels: p, and q where the weave acts."""
        return 2 if self.weave else 1

    def pressures(self, z: Any) -> Any:
        """The pressures (n_cavities,) in cavities of prescribed volume [kPa]."""
        return z[self.n_u + self.n_p + self.n_q :]

    def displacements(self, z: Array, inputs: Inputs) -> Array:
        """Nodal displacements θ − Θ (n_nodes, 3) [mm, rad] of the unknowns z."""
        offset, z, index, scale = (tracing.known(x) for x in (inputs.offset, z, self.tie_index, self.tie_scale))
        return tracing.array((offset + scale * z[index] if self.n_u else offset).reshape(-1, 3))

    @classmethod
    def of(
        cls,
        scene: Scene,
        ties: Ties,
        *,
        weave: bool,
        surfaces: Mapping[str, np.ndarray],
        cavities: Sequence[np.ndarray] = (),
        large: bool = False,
        geometry: Geometry | None = None,
        like: "System | None" = None,
    ) -> "System":
        """The discrete problem of a scene under its ties; surfaces, cavities: as in `System`.

        In NumPy, unless the ties or the geometry are traced. like: another state of the body; a large one takes what is
        known of its Gauss points from there.
        """
        mesh = scene.mesh
        points, frame = geometry or Geometry(mesh.points, scene.frame)  # type: ignore[arg-type]
        if large and like is not None:
            of_body = {name: getattr(like, name) for name in _OF_BODY}
        else:
            of_body = _of_body(tracing.numpy_for(points, frame, ties.scale), scene, points)
            of_body |= {"frame": frame, "points": points, "material": scene.material, "cells": mesh.cells}
        columns, gradient, unknowns, slots = (None, None, None, ()) if large else _columns(scene, ties, of_body)
        whole = unknowns is not None and len(unknowns) == 1 and np.array_equal(unknowns[0], np.arange(ties.size))
        n_p, n_q = int(scene.p_patches.max()) + 1, int(scene.q_patches.max()) + 1 if weave else 0
        multipliers = [ties.size + scene.p_patches] + ([ties.size + n_p + scene.q_patches] if weave else [])
        arrays: dict[str, Any] = of_body | {
            "columns": columns,
            "gradient": gradient,
            "local_u": unknowns,
            "local_multipliers": np.stack(multipliers, axis=1),
            "tie_index": ties.index,
            "tie_scale": ties.scale,
            "surfaces": dict(surfaces),
            "cavities": tuple(cavities),
        }
        n_and_kinds: dict[str, Any] = {"n_u": ties.size, "n_p": n_p, "n_q": n_q, "kinds": scene.kinds}
        n_and_kinds |= {"slots": slots, "whole": whole, "own_geometry": geometry is not None}
        return cls(coordinates=mesh.coordinates, weave=weave, **n_and_kinds, **arrays)


#: What is the same in all states of a body.
_OF_BODY = ("N", "dN", "weight", "theta", "inverse_g", "frame", "points", "material", "cells")


def _of_body(xp: Any, scene: Scene, points: Any) -> dict[str, Any]:
    """N, dN, weight, θ and 1/g(θ) at the Gauss points, see `System`; points: (n_nodes, 3)."""
    coordinates = scene.mesh.coordinates
    xi, w = gauss(*scene.orders)
    N, dxi = shape(xi), shape_gradient(xi)
    nodes = points[scene.mesh.cells]
    inverse, det = _inverse(xp, xp.einsum("eai,gaj->egij", nodes, dxi, optimize=True))
    dN, weight = xp.asarray(dxi)[None] @ inverse, det * w[None]
    theta = xp.asarray(N)[None] @ nodes
    g = _at_points(coordinates.g, theta) if coordinates.curved else np.ones(theta.shape)
    weight, dN = weight * xp.prod(g, axis=-1), dN / g[:, :, None, :]
    return {"N": N, "dN": dN, "weight": weight, "theta": theta, "inverse_g": 1.0 / g}


def _inverse(xp: Any, A: Any) -> tuple[Any, Any]:
    """The inverses and the determinants of matrices (..., 3, 3), by cofactors: LAPACK takes ten times as long."""
    x, y, z = A[..., 0, :], A[..., 1, :], A[..., 2, :]
    columns = xp.stack([xp.cross(y, z), xp.cross(z, x), xp.cross(x, y)], axis=-1)
    det = xp.sum(x * columns[..., 0], axis=-1)
    return columns / det[..., None, None], det


def _at_points(function: Any, theta: Any) -> Any:
    """A function of θ (3,) at the points (n_elements, n_points, 3), in NumPy where they are not traced."""
    if tracing.is_traced(theta):
        return jax.vmap(jax.vmap(function))(theta)
    found = evaluate(function, theta.reshape(-1, 3))
    return found.reshape(*theta.shape[:2], *found.shape[1:])


def _columns(scene: Scene, ties: Ties, of_body: Mapping[str, Any]) -> tuple[Any, Any, Any, tuple[int, ...]]:
    """The columns, the gradient and the unknowns of each element, and the slots, see `System`."""
    mesh, coordinates = scene.mesh, scene.mesh.coordinates
    N, dN, theta, inverse_g = (of_body[name] for name in ("N", "dN", "theta", "inverse_g"))
    n_e, n_g = theta.shape[:2]
    # The distinct unknowns of each element and component (ties join displacements of one component), padded to the
    # longest list with columns of zeros.
    dofs = 3 * mesh.cells[:, None, :] + np.arange(3)[:, None]
    active = ties.free[dofs]
    lists = [
        [np.unique(ties.index[d[a]]) for d, a in zip(*of_e, strict=True)] for of_e in zip(dofs, active, strict=True)
    ]
    slots = tuple(max(len(own[i]) for own in lists) for i in range(3))
    component = np.repeat(np.arange(3), slots)
    first = np.cumsum([0, *slots])
    unknowns = np.zeros((n_e, len(component)), dtype=int)
    here: NDArray[np.float64] = np.zeros((n_e, 8, len(component)))
    for e, own in enumerate(lists):
        for i in range(3):
            unknowns[e, first[i] : first[i] + len(own[i])] = own[i]
            nodes = np.flatnonzero(active[e, i])
            here[e, nodes, first[i] + np.searchsorted(own[i], ties.index[dofs[e, i, nodes]])] = 1.0
    xp = tracing.numpy_for(dN, theta, ties.scale)
    moved = here * xp.swapaxes(ties.scale[dofs], 1, 2)[:, :, component]  # of each node, by each unknown
    # H_ij = Σ_a θ_ai ∂N_a/∂Θ_j / g_j(Θ), and F_ij = g_i(θ) H_ij, which at rest is δ_ij
    columns = xp.einsum("egaj,eal->egjl", dN, moved)
    by_theta = xp.einsum("ga,eal->egl", N, moved)
    is_own = np.eye(3)[:, component]
    gradient = is_own[None, None, :, None] / inverse_g[:, :, :, None, None] * columns[:, :, None]
    if coordinates.curved:
        by_g = _at_points(coordinates.by_theta, theta)[..., component]  # ∂g_i/∂θ_k, k the component of the unknown
        diagonal = by_g * by_theta[:, :, None] * inverse_g[..., None]
        gradient = gradient + diagonal[:, :, :, None] * np.eye(3)[None, None, :, :, None]
        columns = xp.concatenate([columns, by_theta[:, :, None]], axis=2)
    return columns, gradient.reshape(n_e, n_g, 9, -1), unknowns, slots
