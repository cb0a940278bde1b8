"""Assembly of a large body: element tangents straight into the upper triangle of one sparse matrix, in chunks.

The pattern is found once. JAX computes the element terms of a chunk while NumPy adds those of the one before.
"""

import ctypes
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jax import Array

from jaxmyo import compiler, lagrangian, surface
from jaxmyo.pattern import UPPER, Floats, Ints, pattern
from jaxmyo.system import Inputs, System

CHUNK = 1024  # elements per call
BLOCK = 128  # elements whose intermediates stay in cache together
FLIGHT = 4  # chunks that are computed ahead

Found = TypeVar("Found")

_I, _J = UPPER
_THREADS = ThreadPoolExecutor(min(4, os.cpu_count() or 1), thread_name_prefix="jaxmyo")


class Elements(NamedTuple):
    """What the elements of a chunk need, (n_elements, ...) each, see `System`; scale: (24,) of their ties."""

    cells: Array
    dN: Array
    weight: Array
    frame: Array
    theta: Array
    inverse_g: Array
    material: Array
    scale: Array


class Terms(NamedTuple):
    """The terms of the elements of a chunk, (n_elements, ...) each.

    In JAX or, of a chunk that is done, in NumPy. r: (24,) forces; K: (300,) upper triangle of the tangent, rows first,
    with the augmentation; B: (24, multipliers) its coupling with p and q; D: (multipliers,) second derivative by them;
    r_m: (multipliers,) residual; least_J.
    """

    r: Any
    K: Any
    B: Any
    D: Any
    r_m: Any
    least_J: Any


def _in_blocks(function: Callable[[Any], Any], arrays: Any) -> Any:
    """The function of arrays (n_elements, ...), a `BLOCK` of elements at a time."""
    split = jax.tree.map(lambda x: x.reshape(-1, BLOCK, *x.shape[1:]), arrays)
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), jax.lax.map(function, split))


@partial(jax.jit, static_argnames=("inside",), compiler_options=compiler.LEAN)
def _terms(system: System, e: Elements, u: Any, m: Any, inputs: Inputs, gamma: Any, inside: tuple[bool, ...]) -> Terms:
    """The terms of a chunk. u: (n_nodes, 3); m: (n_elements, multipliers); inputs: with the tensions of the chunk.

    inside: the multipliers whose augmentation BᵀWB, W = 1 / (V/γ − D), is added to K.
    """
    c, n_m = system.coordinates, system.multipliers
    order = np.arange(9).reshape(3, 3)  # positions in y of ∂θ_i/∂Θ_k[, θ_i]
    if c.curved:
        order = np.concatenate([order, np.arange(9, 12)[:, None]], axis=1)
    n_y = order.size

    def element(e: Elements, nodes: Array, m: Array, T_f: Array, T_cf: Array) -> Terms:
        def point(dN: Array, N: Array, weight: Array, frame: Array, theta: Array, g: Array, *T: Any) -> Any:
            y = lagrangian.variables(c, nodes, dN, N, theta, g)
            place: Any = (frame, *T, e.material, inputs)
            r_y, K_y = lagrangian.at_point(system, jnp.concatenate([y, m]), *place)
            M = K_y[order.reshape(-1)[:, None], order.reshape(-1)[None, :]].reshape(*order.shape, *order.shape)
            return weight * r_y, weight * M, weight * K_y[:, n_y:], lagrangian.volume_ratio(c, y)

        r_y, M, by_m, J = jax.vmap(point)(e.dN, system.N, e.weight, e.frame, e.theta, e.inverse_g, T_f, T_cf)
        G = e.dN
        if c.curved:
            G = jnp.concatenate([G, system.N[:, :, None]], axis=2)
        half = jnp.einsum("gikjl,gbl->gikbj", M, G)
        K = jnp.einsum("gak,gikbj->aibj", G, half).reshape(24, 24)
        B = jnp.einsum("gak,gikm->aim", G, by_m[:, order]).reshape(24, n_m) * e.scale[:, None]
        D = jnp.diagonal(jnp.sum(by_m[:, n_y:], axis=0))
        K = e.scale[:, None] * K * e.scale[None, :]
        for k in range(n_m):
            if inside[k]:
                K = K + B[:, k, None] * B[None, :, k] / (jnp.sum(e.weight) / gamma - D[k])
        r = e.scale * jnp.einsum("gak,gik->ai", G, r_y[:, order]).reshape(24)
        return Terms(r, K[_I, _J], B, D, jnp.sum(r_y[:, n_y:], axis=0), jnp.min(J))

    def block(at: tuple[Any, ...]) -> Terms:
        e, *further = at
        return jax.vmap(element)(e, u[e.cells], *further)

    return _in_blocks(block, (e, m, inputs.T_f, inputs.T_cf))


@partial(jax.jit, compiler_options=compiler.LEAN)
def _forces(system: System, e: Elements, u: Any, du: Any, m: Any, inputs: Inputs, by_t: Inputs) -> tuple[Any, Any, Any]:
    """The first derivatives of a chunk alone, their change with u and the inputs, and the smallest det F.

    Forces (n_elements, 24) and constraints (n_elements, multipliers); for the changes du, by_t: the same again.
    """
    c = system.coordinates

    def element(e: Elements, nodes: Array, m: Array, T_f: Array, T_cf: Array, inputs: Inputs) -> Any:
        at = (e.dN, e.weight, e.frame, e.theta, e.inverse_g, e.material)
        forces, by_m = lagrangian.element_forces(system, nodes, *at, m, T_f, T_cf, inputs)
        y = jax.vmap(partial(lagrangian.variables, c, nodes))(e.dN, system.N, e.theta, e.inverse_g)
        least_J = jnp.min(jax.vmap(partial(lagrangian.volume_ratio, c))(y))
        return (e.scale * forces.reshape(24), by_m), least_J

    def block(at: tuple[Any, ...]) -> tuple[Any, Any, Any]:
        e, m, T, dT = at

        def of(u: Array, T: tuple[Array, Array], inputs: Inputs) -> Any:
            return jax.vmap(element, in_axes=(0, 0, 0, 0, 0, None))(e, u[e.cells], m, *T, inputs)

        return jax.jvp(of, (u, T, inputs), (du, dT, by_t), has_aux=True)

    return _in_blocks(block, (e, m, (inputs.T_f, inputs.T_cf), (by_t.T_f, by_t.T_cf)))


def _load_forces(system: System, u: Any, pressures: Any, inputs: Inputs) -> tuple[Array, Array]:
    """The loads at the nodes (n_nodes, 3), and the volumes (n_cavities,)."""
    loads = lagrangian.loads(system, pressures, inputs)
    at_nodes = surface.nodal_forces(system.coordinates, loads, system.points + u, system.points)
    return at_nodes, lagrangian.enclosed(system, u)


@jax.jit
def _load_rates(system: System, u: Any, du: Any, pressures: Any, inputs: Inputs, by_t: Inputs) -> tuple[Any, Any]:
    """`_load_forces`, and their change with u and the inputs."""

    def of(u: Array, inputs: Inputs) -> tuple[Array, Array]:
        return _load_forces(system, u, pressures, inputs)

    return jax.jvp(of, (u, inputs), (du, by_t))


@jax.jit
def _load_terms(system: System, u: Any, pressures: Any, inputs: Inputs) -> tuple[Any, list[Array], list[Array]]:
    """Forces and volumes, the derivatives (n, 12 or 24, 12 or 24) of each load, and of each volume (n, 12)."""
    c, theta = system.coordinates, system.points + u
    loads = lagrangian.loads(system, pressures, inputs)
    tangents = [surface.tangents(c, kind, theta[n], system.points[n], values) for kind, n, values in loads]
    ones = [surface.forces(c, "closed", theta[w], system.points[w], jnp.ones(len(w))) for w in system.cavities]
    return _load_forces(system, u, pressures, inputs), tangents, [one.reshape(-1, 12) for one in ones]


def _programs() -> int:
    """How many programs for elements are compiled."""
    return int(_terms._cache_size() + _forces._cache_size())  # type: ignore[attr-defined]


def _give_back() -> None:
    """Give memory that is free back to the system: of what the compiler used, glibc would keep 0.2 GB."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)


class Assembly:
    """The elements of a system in chunks, and the pattern that their terms go to."""

    def __init__(self, system: System, patches: list[sp.csr_matrix]) -> None:
        cells = np.asarray(system.cells)
        tie_index, self.tie_scale = np.asarray(system.tie_index), np.asarray(system.tie_scale)
        dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(-1, 24)
        self.system = system
        self.tie_index = tie_index
        self.dofs, self.scale = tie_index[dofs], self.tie_scale[dofs]
        self.pattern = pattern(cells, tie_index, self.tie_scale, system.n_u, patches)
        self.local = np.asarray(system.local_multipliers)
        n_e, self.count = len(cells), min(CHUNK, -(-len(cells) // BLOCK) * BLOCK)
        self.chunks = [np.arange(i, min(i + self.count, n_e)) for i in range(0, n_e, self.count)]
        arrays = [np.asarray(getattr(system, name)) for name in Elements._fields[:-1]]
        self._elements = [
            Elements(*(jnp.asarray(x[self._padded(ids)]) for x in (*arrays, self.scale))) for ids in self.chunks
        ]
        # Without what belongs to single elements, so that bodies of all sizes share the compiled functions.
        none: Any = np.zeros(0)
        own = (*Elements._fields[:-1], "tie_index", "tie_scale", "points", "local_multipliers")
        bare: dict[str, Any] = dict.fromkeys(own, none)
        self._shared = replace(system, n_u=0, n_p=0, n_q=0, surfaces={}, cavities=(), **bare)
        loads: dict[str, Any] = {"surfaces": system.surfaces, "cavities": system.cavities, "points": system.points}
        self._loads = replace(self._shared, **loads, kinds=(), N=none)

    def _padded(self, ids: Ints) -> Ints:
        """The elements of a chunk; the last one is filled up with repetitions."""
        return np.concatenate([ids, np.full(self.count - len(ids), ids[-1])])

    def _cut(self, inputs: Inputs, ids: Ints) -> Inputs:
        """The inputs of a chunk."""
        none: Any = np.zeros(0)
        tensions: Any = [np.asarray(T)[self._padded(ids)] for T in (inputs.T_f, inputs.T_cf)]
        cut = inputs._replace(T_f=tensions[0], T_cf=tensions[1], offset=none)
        return cut._replace(loads={}, volumes=none, imbalance=none)

    def _each(
        self, compute: Callable[[Ints, Elements], Found], chunks: int | None = None
    ) -> Iterator[tuple[Ints, Found]]:
        """(elements, what is computed of them) of all chunks, or of the first ones; some are computed ahead."""
        ahead: list[tuple[Ints, Future[Found]]] = []
        for ids, e in zip(self.chunks[:chunks], self._elements[:chunks], strict=True):
            ahead.append((ids, _THREADS.submit(compute, ids, e)))
            if len(ahead) > FLIGHT:
                ids, future = ahead.pop(0)
                yield ids, future.result()
        for ids, future in ahead:
            yield ids, future.result()

    def terms(
        self,
        u: Floats,
        z: Floats,
        inputs: Inputs,
        gamma: float,
        inside: tuple[bool, ...],
        chunks: int | None = None,
    ) -> Iterator[tuple[Ints, Terms]]:
        """(elements, their terms) of all chunks, or of the first ones."""

        def compute(ids: Ints, e: Elements) -> Terms:
            m = z[self.local[self._padded(ids)]]
            found = _terms(self._shared, e, u, m, self._cut(inputs, ids), np.float64(gamma), inside)
            return Terms(*(np.asarray(x)[: len(ids)] for x in found))

        return self._each(compute, chunks)

    def add_to(self, r: Floats, ids: Ints, r_u: Any, r_m: Any) -> None:
        """Add the forces (n, 24) and the constraints (n, multipliers) of elements `ids` to the residual (n,)."""
        r += np.bincount(self.dofs[ids].ravel(), r_u.ravel(), len(r))
        r += np.bincount(self.local[ids].ravel(), r_m.ravel(), len(r))

    def first(self, u: Floats, z: Floats, inputs: Inputs, gamma: float, inside: tuple[bool, ...]) -> tuple[Ints, Terms]:
        """(elements, their terms) of the first chunk. What `forces` needs is compiled beside: each takes seconds."""
        known, none = _programs(), jax.tree.map(np.zeros_like, inputs)
        args = (self.chunks[0], self._elements[0], u, z, inputs, np.zeros_like(u), none)
        forces = _THREADS.submit(self._forces_of, *args)
        found = next(self.terms(u, z, inputs, gamma, inside, chunks=1))
        forces.result()
        if _programs() != known:
            _give_back()
        return found

    def _forces_of(
        self, ids: Ints, e: Elements, u: Floats, z: Floats, inputs: Inputs, du: Floats, by_t: Inputs
    ) -> tuple[Any, Any, Any]:
        m = z[self.local[self._padded(ids)]]
        found = _forces(self._shared, e, u, du, m, self._cut(inputs, ids), self._cut(by_t, ids))
        return jax.tree.map(lambda x: np.asarray(x)[: len(ids)], found)

    def forces(self, u: Floats, z: Floats, inputs: Inputs, du: Floats, by_t: Inputs) -> tuple[Floats, Floats, float]:
        """The residual (n,), its change with the displacements and the inputs, and the smallest det F."""

        def compute(ids: Ints, e: Elements) -> Any:
            return self._forces_of(ids, e, u, z, inputs, du, by_t)

        r, dr, least_J = -np.array(inputs.imbalance), -np.array(by_t.imbalance), np.inf
        for ids, (at, change, J) in self._each(compute):
            self.add_to(r, ids, *at)
            self.add_to(dr, ids, *change)
            least_J = min(least_J, float(J.min()))
        if self.loaded:
            cut = self._of_loads(inputs), self._of_loads(by_t)
            loads, by_loads = _load_rates(self._loads, u, du, self.system.pressures(z), *cut)
            for to, (forces, volumes), wanted in ((r, loads, inputs), (dr, by_loads, by_t)):
                to += np.bincount(self.tie_index, -self.tie_scale * np.asarray(forces).ravel(), len(to))
                to[len(to) - len(volumes) :] += np.asarray(wanted.volumes) - np.asarray(volumes)
        return r, dr, least_J

    @property
    def loaded(self) -> bool:
        """Whether there are loads, or cavities of prescribed volume."""
        return bool(self.system.surfaces or self.system.cavities)

    def loads(self, u: Floats, z: Floats, inputs: Inputs) -> tuple[Floats, sp.csr_matrix, Floats, Floats]:
        """Forces on the unknowns (n,), their derivative (n_u, n_u); volumes (n_cavities,), and theirs (…, n_u)."""
        size, n_u, s = self.system.size, self.system.n_u, self.system
        pressures = s.pressures(z)
        (forces, volumes), tangents, by_u = _load_terms(self._loads, u, pressures, self._of_loads(inputs))
        data, rows, columns = [], [], []
        for nodes, K in zip([*s.surfaces.values(), *s.cavities], tangents, strict=True):
            index, scale = self._tied(nodes)
            data.append((scale[:, :, None] * np.asarray(K) * scale[:, None, :]).ravel())
            rows.append(np.broadcast_to(index[:, :, None], K.shape).ravel())
            columns.append(np.broadcast_to(index[:, None, :], K.shape).ravel())
        entries = (np.concatenate(rows), np.concatenate(columns))
        matrix = sp.coo_matrix((np.concatenate(data), entries), shape=(n_u, n_u)).tocsr()
        matrix.eliminate_zeros()
        of_volumes = np.zeros((len(s.cavities), n_u))
        for row, wall, one in zip(of_volumes, s.cavities, by_u, strict=True):
            index, scale = self._tied(wall)
            row += np.bincount(index.ravel(), (scale * np.asarray(one)).ravel(), n_u)
        on_unknowns = np.bincount(self.tie_index, self.tie_scale * np.asarray(forces).ravel(), size)
        return on_unknowns.astype(np.float64), matrix, np.asarray(volumes), of_volumes

    def _tied(self, nodes: Array) -> tuple[Ints, Floats]:
        """The unknowns, and the scales of their ties, of the nodes (n, k) of quads or hexahedra: (n, 3k)."""
        dofs = (3 * np.asarray(nodes)[:, :, None] + np.arange(3)).reshape(len(nodes), -1)
        return self.tie_index[dofs], self.tie_scale[dofs]

    def _of_loads(self, inputs: Inputs) -> Inputs:
        """The inputs without what loads do not need."""
        none: Any = np.zeros(0)
        return inputs._replace(constants=(), T_f=none, T_cf=none, offset=none, imbalance=none)
