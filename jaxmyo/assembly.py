"""Assembly of a large body: element tangents straight into the upper triangle of one sparse matrix, in chunks.

The pattern is found once. JAX computes the element terms of a chunk while NumPy adds those of the one before.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jax import Array

from jaxmyo import compiler, element_blocks, lagrangian, memory, surface
from jaxmyo.coordinates import evaluate
from jaxmyo.element_blocks import Elements, Terms
from jaxmyo.pattern import BLOCK, Floats, Ints, in_blocks, pattern, same_components
from jaxmyo.system import Inputs, System

CHUNK = 16  # blocks per call
FLIGHT = 4  # chunks that are computed ahead

Found = TypeVar("Found")

_THREADS = ThreadPoolExecutor(min(4, os.cpu_count() or 1), thread_name_prefix="jaxmyo")
#: For what waits for those threads itself.
_BESIDE = ThreadPoolExecutor(1, thread_name_prefix="jaxmyo-compile")


@partial(jax.jit, static_argnames=("inside",), compiler_options=compiler.LEAN)
def _terms(system: System, e: Elements, u: Any, m: Any, inputs: Inputs, gamma: Any, inside: tuple[bool, ...]) -> Terms:
    """The terms of the blocks of a chunk, see `element_blocks.terms`; with the blocks first, as all that is of a chunk.

    u: (n_nodes, 3); m: (n_blocks, multipliers, BLOCK); inputs: with the tensions of the chunk.
    """

    def block(at: tuple[Any, ...]) -> Terms:
        e, m, T = at
        return element_blocks.terms(system, e, u, m, _with_tensions(inputs, T), gamma, inside)

    return jax.lax.map(block, (e, m, (inputs.T_f, inputs.T_cf)))


@partial(jax.jit, compiler_options=compiler.LEAN)
def _forces(system: System, e: Elements, u: Any, m: Any, inputs: Inputs) -> tuple[Any, Any, Any]:
    """Forces (n_blocks, 24, BLOCK), constraints (n_blocks, multipliers, BLOCK) and the smallest det F of each block."""

    def block(at: tuple[Any, ...]) -> tuple[Any, Any, Any]:
        e, m, T = at
        return element_blocks.forces(system, e, u, m, _with_tensions(inputs, T))

    return jax.lax.map(block, (e, m, (inputs.T_f, inputs.T_cf)))


@partial(jax.jit, compiler_options=compiler.LEAN)
def _changes(system: System, e: Elements, u: Any, m: Any, inputs: Inputs, du: Any, dm: Any) -> tuple[Any, Any]:
    """The change of the forces and constraints of `_forces` with (u, m)."""

    def block(at: tuple[Any, ...]) -> tuple[Any, Any]:
        e, m, dm, T = at

        def forces(u: Any, m: Any) -> tuple[Any, Any]:
            r, r_m, _ = element_blocks.forces(system, e, u, m, _with_tensions(inputs, T))
            return r, r_m

        change: tuple[Any, Any] = jax.jvp(forces, (u, m), (du, dm))[1]
        return change

    return jax.lax.map(block, (e, m, dm, (inputs.T_f, inputs.T_cf)))


def _with_tensions(inputs: Inputs, T: tuple[Array, Array]) -> Inputs:
    return inputs._replace(T_f=T[0], T_cf=T[1])


@jax.jit
def _load_forces(system: System, u: Any, pressures: Any, inputs: Inputs) -> tuple[Array, Array]:
    """The loads at the nodes (n_nodes, 3), and the volumes (n_cavities,)."""
    loads = lagrangian.loads(system, pressures, inputs)
    at_nodes = surface.nodal_forces(system.coordinates, loads, system.points + u, system.points)
    return at_nodes, lagrangian.enclosed(system, u)


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
    programs: Any = (_terms, _forces)
    return sum(int(f._cache_size()) for f in programs)


class Assembly:
    """The elements of a system in blocks and chunks, and the pattern that their terms go to.

    What is of elements is (n_blocks, ..., BLOCK), a chunk is a slice of it. Elements that only fill up the last blocks
    have the unknown `system.size`, which is none: residuals have one entry more for it here.
    """

    def __init__(self, system: System, patches: list[sp.csr_matrix]) -> None:
        cells = np.asarray(system.cells)
        tie_index, self.tie_scale = np.asarray(system.tie_index), np.asarray(system.tie_scale)
        dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(-1, 24)
        self.system = system
        self.tie_index = tie_index
        n_blocks = -(-len(cells) // BLOCK)
        count = min(CHUNK, n_blocks)
        self.n_blocks = -(-n_blocks // count) * count
        self.chunks = [slice(k, k + count) for k in range(0, self.n_blocks, count)]
        self.dofs, self.scale = self.in_blocks(tie_index[dofs], system.size), self.in_blocks(self.tie_scale[dofs])
        self.local = self.in_blocks(np.asarray(system.local_multipliers), system.size)
        self.pattern = pattern(cells, tie_index, self.tie_scale, system.n_u, patches, self.n_blocks)
        dN, weight, frame, theta, inverse_g = (
            self.in_blocks(np.moveaxis(np.asarray(x), 1, -1))
            for x in (system.dN, system.weight, system.frame, system.theta, system.inverse_g)
        )
        geometry = (self.in_blocks(cells), dN, weight, frame, theta, inverse_g)
        every = (*geometry, self.in_blocks(np.asarray(system.material)), self.scale)
        self._elements = [jax.device_put(Elements(*(x[chunk] for x in every))) for chunk in self.chunks]
        # Without what belongs to single elements, so that bodies of all sizes share the compiled functions.
        none: Any = np.zeros(0)
        own = (*Elements._fields[:-1], "tie_index", "tie_scale", "points", "local_multipliers")
        bare: dict[str, Any] = dict.fromkeys(own, none)
        self._shared = replace(system, n_u=0, n_p=0, n_q=0, surfaces={}, cavities=(), **bare)
        loads: dict[str, Any] = {"surfaces": system.surfaces, "cavities": system.cavities, "points": system.points}
        self._loads = replace(self._shared, **loads, kinds=(), N=none)

    def in_blocks(self, x: Any, fill: Any = None) -> Any:
        """Values (n_elements, ...) in blocks, see `pattern.in_blocks`."""
        return in_blocks(x, self.n_blocks, fill)

    def _each(
        self, compute: Callable[..., Found], of_elements: Any, chunks: int | None = None
    ) -> Iterator[tuple[slice, Found]]:
        """(chunk, what is computed of it in NumPy) of all chunks, or of the first ones; some are computed ahead."""

        def computed(chunk: slice, e: Elements) -> Found:
            found: Found = jax.tree.map(np.asarray, compute(e, *jax.tree.map(lambda x: x[chunk], of_elements)))
            return found

        ahead: list[tuple[slice, Future[Found]]] = []
        for chunk, e in zip(self.chunks[:chunks], self._elements[:chunks], strict=True):
            ahead.append((chunk, _THREADS.submit(computed, chunk, e)))
            if len(ahead) > FLIGHT:
                chunk, future = ahead.pop(0)
                yield chunk, future.result()
        for chunk, future in ahead:
            yield chunk, future.result()

    def _multipliers(self, z: Floats) -> Floats:
        """Those of the elements, (n_blocks, multipliers, BLOCK)."""
        return np.append(z, np.zeros(1, z.dtype))[self.local]

    def _split(self, inputs: Inputs) -> tuple[Inputs, tuple[Floats, Floats]]:
        """What elements need of the inputs: what is common to all, and the tensions of each."""
        none: Any = np.zeros(0)
        T_f, T_cf = (self.in_blocks(np.asarray(T)) for T in (inputs.T_f, inputs.T_cf))
        common = inputs._replace(T_f=none, T_cf=none, offset=none, loads={}, volumes=none, imbalance=none)
        return common, (T_f, T_cf)

    def terms(
        self, u: Floats, z: Floats, inputs: Inputs, gamma: float, inside: tuple[bool, ...], chunks: int | None = None
    ) -> Iterator[tuple[slice, Terms]]:
        """(chunk, its terms) of all chunks, or of the first ones."""
        common, tensions = self._split(inputs)

        def compute(e: Elements, m: Floats, T: tuple[Any, Any]) -> Terms:
            return _terms(self._shared, e, u, m, _with_tensions(common, T), np.float64(gamma), inside)

        return self._each(compute, (self._multipliers(z), tensions), chunks)

    def first(
        self, u: Floats, z: Floats, inputs: Inputs, gamma: float, inside: tuple[bool, ...]
    ) -> tuple[slice, Terms]:
        """(chunk, its terms) of the first chunk. The program of the forces is compiled beside: each takes seconds."""
        known = _programs()
        beside = _BESIDE.submit(list, self._forces(u, z, inputs, 1))
        found = next(self.terms(u, z, inputs, gamma, inside, chunks=1))
        beside.result()
        if _programs() != known:
            memory.give_back()  # of what the compiler used, 0.2 GB
        return found

    def _forces(self, u: Floats, z: Floats, inputs: Inputs, chunks: int | None = None) -> Iterator[tuple[slice, Any]]:
        common, tensions = self._split(inputs)

        def compute(e: Elements, m: Floats, T: tuple[Any, Any]) -> Any:
            return _forces(self._shared, e, u, m, _with_tensions(common, T))

        return self._each(compute, (self._multipliers(z), tensions), chunks)

    def add_to(self, r: Floats, chunk: slice, r_u: Any, r_m: Any) -> None:
        """Add the forces (n_blocks, 24, BLOCK) and the constraints of a chunk to the residual (n + 1,)."""
        r += np.bincount(self.dofs[chunk].ravel(), r_u.ravel(), len(r))
        r += np.bincount(self.local[chunk].ravel(), r_m.ravel(), len(r))

    def forces(self, u: Floats, z: Floats, inputs: Inputs) -> tuple[Floats, float]:
        """The residual (n,) and the smallest det F."""
        r, least_J = np.append(-np.asarray(inputs.imbalance), 0.0), np.inf
        for chunk, (r_u, r_m, J) in self._forces(u, z, inputs):
            self.add_to(r, chunk, r_u, r_m)
            least_J = min(least_J, float(J.min()))
        r = r[:-1]
        if self.loaded:
            at_nodes, volumes = _load_forces(self._loads, u, self.system.pressures(z), self._of_loads(inputs))
            r += np.bincount(self.tie_index, -self.tie_scale * np.asarray(at_nodes).ravel(), len(r))
            r[len(r) - len(volumes) :] += np.asarray(inputs.volumes) - np.asarray(volumes)
        return r, least_J

    def product(self, u: Floats, z: Floats, inputs: Inputs, x: Floats) -> Floats:
        """The product of the tangent of the elements and (u, m), without any matrix: the derivative along it."""
        common, tensions = self._split(inputs)
        x = np.append(x, np.zeros(self.system.size - len(x)))  # of the pressures in cavities
        du = (self.tie_scale * x[self.tie_index]).reshape(-1, 3)

        def compute(e: Elements, m: Floats, dm: Floats, T: tuple[Any, Any]) -> tuple[Any, Any]:
            return _changes(self._shared, e, u, m, _with_tensions(common, T), du, dm)

        y = np.zeros(self.system.size + 1)
        for chunk, (r, r_m) in self._each(compute, (self._multipliers(z), self._multipliers(x), tensions)):
            self.add_to(y, chunk, r, r_m)
        return y[: self.system.size - len(self.system.cavities)]

    def rates(self, u: Floats, z: Floats, inputs: Inputs, by_t: Inputs) -> Floats:
        """The change (n,) of the residual with the inputs, prescribed displacements among them.

        By central differences, to some 1e-9: what goes along the path needs no more, and an exact derivative is one
        more program, which takes seconds to compile.
        """
        h = 1e-6
        du = np.broadcast_to(by_t.offset, inputs.offset.shape).reshape(-1, 3)

        def residual(t: float) -> Floats:
            moved = jax.tree.map(lambda x, dx: np.asarray(x) + t * np.asarray(dx), inputs, by_t)
            return self.forces(u + t * du, z, moved)[0]

        return (residual(h) - residual(-h)) / (2.0 * h)

    def metric(self) -> Floats:
        """The upper triangle (nnz,) of ∫ |∂F|² dV at rest, its parts that couple different components left out."""
        data = np.zeros(self.pattern.nnz + 1)
        for chunk in self.chunks:
            self.pattern.add_upper(data, chunk, self._element_metric(chunk))
        return data[:-1]

    def _element_metric(self, chunk: slice) -> Floats:
        """The upper triangles (n_blocks, 300, BLOCK) of some elements."""
        s, N = self.system, np.asarray(self.system.N)
        first, last = (BLOCK * k for k in (chunk.start, chunk.stop))
        weight, dN, inverse_g, theta = (np.asarray(x)[first:last] for x in (s.weight, s.dN, s.inverse_g, s.theta))
        weighted = (weight[:, :, None] / inverse_g**2)[:, :, :, None, None] * dN[:, :, None]  # e g i a k
        stiffness = np.einsum("egiak,egbk->eiab", weighted, dN, optimize=True)
        if s.coordinates.curved:
            by = evaluate(s.coordinates.by_theta, theta.reshape(-1, 3)).reshape(*theta.shape, 3)  # ∂g_j/∂θ_i
            hoop = np.einsum("eg,egji->egi", weight, (by * inverse_g[..., None]) ** 2)
            stiffness = stiffness + np.einsum("egi,ga,gb->eiab", hoop, N, N, optimize=True)
        upper, i, a, b = same_components()
        K, scale = np.zeros((chunk.stop - chunk.start, 300, BLOCK)), self.scale[chunk]
        own = in_blocks(stiffness[:, i, a, b], len(K))
        K[:, upper] = own * scale[:, 3 * a + i] * scale[:, 3 * b + i]
        return K

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
