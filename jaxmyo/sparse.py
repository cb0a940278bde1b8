"""The linearised system of a large body: sparse, with the multipliers eliminated by an augmented Lagrangian.

One factorisation serves as the preconditioner of several Newton steps, as long as that takes few iterations, see
`jaxmyo.saddle`. An unsymmetric tangent (follower loads) is factorised by its symmetric part.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
import scipy.sparse as sp

from jaxmyo import checks, factor, lagrangian, linear, memory, multigrid, saddle
from jaxmyo.assembly import Assembly
from jaxmyo.linear import At, Scales
from jaxmyo.multigrid import Multigrid
from jaxmyo.pattern import DIAGONAL, Floats, distinct
from jaxmyo.saddle import Factored, Tangent
from jaxmyo.status import SingularError
from jaxmyo.system import Inputs, System
from jaxmyo.ties import rigid_unknowns

EXACT = 1e-10  # relative residual of the linear systems of derivatives, at most [–]
SINGULAR = 1e-11  # stiffness of a motion, over the largest, that round-off leaves where there is none [–]
FREE = 1e-8  # stiffness, over the largest, that tells the motions without any from unstable ones [–]
NEAR = 5e-3  # strain, and stress over stiffness, between two states whose tangents have one inertia [–]
SOFT = 1e-5  # stiffness of a motion, over the largest, below which linear systems may not be solved exactly [–]
SOFTER = 0.25  # change of stiffness, as a fraction, between two tangents that may have different inertia [–]
GAIN = 0.3  # ratio of the residuals before and after all Krylov iterations, up to which more of them are worth it [–]
SLOW = 0.03  # ratio of the residuals of two iterations from which on a new tangent is worth its assembly [–]


class Sparse:
    """The linear algebra of one system with sparse matrices. Not for use inside JAX's transformations."""

    xp = np
    inexact = 1.0

    def __init__(self, system: System) -> None:
        self.system = system
        n_u, n_e = system.n_u, len(system.cells)
        self.n_m = system.n_p + system.n_q
        patch = np.asarray(system.local_multipliers) - n_u
        single = [bool((np.bincount(own)[own] == 1).all()) for own in patch.T]
        cells = np.asarray(system.cells)
        dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(n_e, 24)
        index, moves = np.asarray(system.tie_index)[dofs], np.asarray(system.tie_scale)[dofs] != 0.0
        # B in CSR: which element entry stands where
        keys = patch.T[:, :, None] * np.int64(n_u) + index[None]
        self._coupling, entry = distinct(np.where(moves[None], keys, -1).reshape(-1))
        several = []
        for own, alone in zip(patch.T, single, strict=True):
            if not alone:
                at = (np.broadcast_to(own[:, None], index.shape)[moves], index[moves])
                touches = sp.csr_matrix((np.ones(len(at[0])), at), shape=(self.n_m, n_u))
                touches.data[:] = 1.0
                several.append(touches)
        self.assembly = Assembly(system, several)
        self.pattern = self.assembly.pattern
        self._entry = self.assembly.in_blocks(entry.reshape(keys.shape).transpose(1, 2, 0), len(self._coupling))
        self._inside = tuple(single)
        self._is_inside = np.zeros(self.n_m)
        for own, alone in zip(patch.T, single, strict=True):
            self._is_inside[own] = alone
        self._metric = self.assembly.metric()
        self.scale = self._scales(self._metric[self.pattern.diagonal], index, moves, patch)
        self._volume = np.asarray(self.scale.volume)[n_u : n_u + self.n_m]
        self.factors = factor.solver(self.pattern, self._metric, self._rigid)
        self._stiffness = 0.0  # of the body [kPa]; 0 before it is known
        self._factored: Factored | None = None
        self._stiffened = False
        self._single: tuple[Tangent, float, saddle.Product] | None = None  # the last one of single precision
        self._compared: Tangent | None = None
        self._apart = np.inf
        self._known: tuple[Floats, Inputs, At] | None = None  # a path often begins where the last one ended
        self._counts = dict.fromkeys(
            ("assemblies", "residuals", "factorisations", "inner solves", "inner iterations"), 0
        )
        self._seconds = dict.fromkeys(("assembly", "factorisation", "inner solves"), 0.0)

    @classmethod
    def of(cls, system: System) -> "Sparse":
        """As the last call gave it, with its pattern, ordering and factors, if the system is the same."""
        for k, known in enumerate(_known):
            if _equal(known.system, system):
                _known.append(_known.pop(k))
                return known
        while len(_known) > 1:  # A and C of one body at a time, for the memory of their factors
            _known.pop(0).release()
        _known.append(cls(system))
        return _known[-1]

    def _scales(self, diagonal: Floats, index: Any, moves: Any, patch: Any) -> Scales:
        n_u, size = self.system.n_u, np.asarray(self.system.weight).sum(axis=1)
        each = np.broadcast_to(size[:, None], index.shape)
        volume = np.bincount(index[moves], each[moves], minlength=self.system.size)
        for own in patch.T:
            volume += np.bincount(n_u + own, size, minlength=len(volume))
        if self.system.cavities:
            volume[-len(self.system.cavities) :] = lagrangian.enclosed(self.system, np.zeros(self.system.points.shape))
        unit = np.ones(len(volume))
        unit[:n_u] = np.sqrt(volume[:n_u] / diagonal)
        return Scales(unit, volume)  # type: ignore[arg-type]

    @property
    def _gamma(self) -> float:
        return self.factors.augmentation * self._stiffness

    def _rigid(self) -> Floats:
        s, a = self.system, self.assembly
        return rigid_unknowns(s.coordinates, np.asarray(s.points), a.tie_index, a.tie_scale, s.n_u)

    @property
    def work(self) -> dict[str, Any]:
        """The counts and the seconds since the last time it was asked for."""
        work = {k: np.float64(v) for k, v in self._counts.items()}
        work |= {k: np.float64(v) for k, v in self.factors.size.items()}
        work |= {f"{k} [s]": np.float64(v) for k, v in self._seconds.items()}
        self._counts, self._seconds = dict.fromkeys(self._counts, 0), dict.fromkeys(self._seconds, 0.0)
        return work

    @contextmanager
    def _timed(self, part: str) -> Iterator[None]:
        begin = time.perf_counter()
        yield
        self._seconds[part] += time.perf_counter() - begin

    def at(self, z: Floats, inputs: Inputs) -> At:
        """The residual (n,) at z, and the tangent there or, where that serves Newton's method as well, one near by."""
        if self._known is None or not _equal(self._known[:2], (z, inputs)):
            self._known = (z, inputs, self._by_same_tangent(z, inputs) or self._linearised(z, inputs))
        return self._known[2]

    def tangent(self, z: Floats, inputs: Inputs) -> Tangent:
        """The tangent at z itself."""
        K = self.at(z, inputs).K
        if not np.array_equal(K.z, z):
            self._known = (z, inputs, self._linearised(z, inputs))
        return self._known[2].K  # type: ignore[index]

    def _linearised(self, z: Floats, inputs: Inputs) -> At:
        self._counts["assemblies"] += 1
        with self._timed("assembly"):
            return self._assembled(z, inputs)

    def _by_same_tangent(self, z: Floats, inputs: Inputs) -> At | None:
        """The residual with the tangent that is factorised, if that is near and takes Newton's method on well."""
        if self._factored is None or self._stiffened or self._known is None:
            return None
        K, last = self._factored.K, self._known[2]
        if last.K is not K or K.inputs is not inputs or self._distance(K, z) > NEAR:
            return None
        self._counts["residuals"] += 1
        with self._timed("assembly"):
            u = self._displacements(z, inputs)
            r, least_J = self.assembly.forces(u, z, inputs)
        at = linear.summary(np, self.system, self.scale, z, r, K.diagonal, self._least(u, least_J), K)
        return at if at.residual <= max(SLOW * last.residual, at.noise) else None

    def _assembled(self, z: Floats, inputs: Inputs) -> At:
        s, a, n_u = self.system, self.assembly, self.system.n_u
        u = self._displacements(z, inputs)
        if not self._stiffness:
            chunk, t = a.first(u, z, inputs, 1e-30, self._inside)
            diagonal = np.bincount(a.dofs[chunk].ravel(), t.K[:, DIAGONAL].ravel(), n_u)[:n_u]
            self._stiffness = float(linear.stiffness(np, self.scale, diagonal))
        r, data = np.append(-np.asarray(inputs.imbalance), 0.0), np.zeros(self.pattern.nnz + 1)
        B, D, least_J = np.zeros(len(self._coupling) + 1), np.zeros(s.size - n_u + 1), np.inf
        for chunk, t in a.terms(u, z, inputs, self._gamma, self._inside):
            a.add_to(r, chunk, t.r, t.r_m)
            self.pattern.add_upper(data, chunk, t.K)
            np.add.at(B, self._entry[chunk].ravel(), t.B.ravel())
            np.add.at(D, a.local[chunk].ravel() - n_u, t.D.ravel())
            least_J = min(least_J, float(t.least_J.min()))
        r, data, B, D = r[:-1], data[:-1], B[:-1], D[: self.n_m]
        kept = self._coupling >= 0
        rows, columns = np.divmod(self._coupling[kept], n_u)
        coupling = sp.csr_matrix((B[kept], columns, np.searchsorted(rows, np.arange(self.n_m + 1))), (self.n_m, n_u))
        W = 1.0 / (self._volume / self._gamma - D)
        inside = W * self._is_inside
        squares = coupling.copy()
        squares.data **= 2
        diagonal = data[self.pattern.diagonal] - squares.T @ inside
        stiffness = float(linear.stiffness(np, self.scale, diagonal))
        if not 0.1 * self._stiffness <= stiffness <= 10.0 * self._stiffness and np.isfinite(stiffness):
            self._stiffness, self._factored = stiffness, None  # another material: what was augmented does not suit it
            return self._assembled(z, inputs)
        if (inside != W).any():
            outside = (coupling.T @ sp.diags(W - inside) @ coupling).tocoo()
            upper = outside.row <= outside.col
            np.add.at(data, self.pattern.find(outside.row[upper], outside.col[upper]), outside.data[upper])
        loads, walls = None, np.zeros((0, n_u))
        if a.loaded:
            forces, loads, volumes, by_u = a.loads(u, z, inputs)
            r -= forces
            r[n_u + self.n_m :] += np.asarray(inputs.volumes) - volumes
            diagonal, walls = diagonal - loads.diagonal(), -by_u
        K = Tangent(z, inputs, data, loads, coupling, D, W, walls, diagonal)
        return linear.summary(np, s, self.scale, z, r, diagonal, self._least(u, least_J), K)

    def _least(self, u: Floats, least_J: float) -> np.float64:
        """The smallest det F, or −1 where a node left the range of its coordinates."""
        curved = self.system.coordinates.curved
        return np.float64(-1.0 if curved and lagrangian.is_folded(self.system, u) else least_J)

    def _displacements(self, z: Floats, inputs: Inputs) -> Floats:
        full = np.asarray(inputs.offset) + self.assembly.tie_scale * z[self.assembly.tie_index]
        return full.reshape(-1, 3)

    def strain_of(self, dz: Floats) -> tuple[Any, Any]:
        """Root mean square and maximum over the body of |∂F| [–] for a change dz of the unknowns at rest."""
        rms, largest = linear.strain_of(self.system, dz)
        return np.float64(rms), np.float64(largest)

    def rates(self, z: Floats, inputs: Inputs, by_t: Inputs, factors: "Factors") -> tuple[Floats, Any]:
        """dz/dt (n,) along the path whose inputs change by by_t, and the root-mean-square strain rate."""
        offset_rate = np.broadcast_to(by_t.offset, inputs.offset.shape)
        u = self._displacements(z, inputs)
        rate = -factors.solve(self.assembly.rates(u, z, inputs, by_t), 1e-4)
        return rate, np.float64(linear.strain_rate(self.system, z, inputs, rate, offset_rate))

    def factorise(self, at: At, mu: Any, last: Any) -> "Factors":
        """The system K + μ·metric, to be solved; nothing is factorised before it is needed.

        last: the state is all but found, so that its own factors serve the rest of the way, and its inertia.
        """
        return Factors(self, at.K, float(mu), bool(last))

    def nothing(self) -> tuple[None, None]:
        """A tangent and factors to begin a loop with."""
        return None, None

    def inertia(self, at: At, z: Floats) -> tuple[Any, Any]:
        """(negative eigenvalues of the second variation on the constraint manifold, zero ones), see `Dense`.

        The augmented matrix has the former as its negative eigenvalues, for γ large enough. Zero ones are not counted:
        1 says that there are some.
        """
        if at.K is None or self.near(at.K).inertia[0] < 0:
            return np.array(-1), np.array(-1)
        singular = self._is_singular()
        if not singular and self._is_softer(at.K):
            self._factorise(at.K, 0.0)
            singular = self._is_singular()
        if singular:  # round-off decides whether its pivots are negative
            self._take(at.K, FREE * self._stiffness)
            self._stiffened = True
        return np.array(self._negative), np.array(int(singular))

    @property
    def _negative(self) -> int:
        """Negative eigenvalues of the tangent that is factorised, on the constraint manifold."""
        assert self._factored is not None
        return self.factors.inertia[0] - self._factored.held

    def _is_singular(self) -> bool:
        """Whether the factors resist some motion by round-off only: the length of a random vector, iterated inversely.

        Pardiso perturbs no pivot of 1e-13 that round-off left, and SuperLU none at all.
        """
        if self.factors.inertia[1] > 0:
            return True
        y = self._soft_motion() / self._strains
        return not SINGULAR * self._stiffness * factor.norm(y) < 1.0

    def _is_softer(self, K: Tangent) -> bool:
        """Whether K resists the softest motions of the factors much less, or more, than the tangent that they are of.

        A law without stiffness at rest gains it within a small strain, so that being near does not tell.
        """
        if self.has_factors_of(K):
            return False
        x = self._soft_motion()
        back = self.factors.solve(self.pattern.product(self._symmetric(K, 0.0))(x))
        return not factor.norm((back - x) / self._strains) < SOFTER * factor.norm(x / self._strains)

    @property
    def _strains(self) -> Floats:
        """s (n_u,) such that x / s of unknown displacements x are strains."""
        n_u = self.system.n_u
        return np.asarray(self.scale.unit[:n_u] / np.sqrt(self.scale.volume[:n_u]))

    def _soft_motion(self) -> Floats:
        """Displacements (n_u,) by random forces of size 1 each, in which the softest motions of the factors prevail."""
        s = self._strains
        return self.factors.solve(np.random.default_rng(0).normal(size=len(s)) / s)

    def near(self, K: Tangent) -> factor.Solver:
        """Factors that have the inertia of K: its own, or those of a state that is the same but for a small strain."""
        if self._factored is None or self._stiffened or not self._serves(K):
            self._factorise(K, 0.0)
        return self.factors

    def has_factors_of(self, K: Tangent) -> bool:
        """Whether the factors are those of K itself."""
        return self._factored is not None and self._factored.K is K

    def _serves(self, K: Tangent) -> bool:
        """Whether the factors are those of K, of a tangent near by, or of a solver that gives no inertia."""
        assert self._factored is not None
        if self.has_factors_of(K) or self.factors.inertia[0] < 0:
            return True
        if self._compared is not K:
            self._compared, self._apart = K, self._distance(self._factored.K, K.z)
        return self._apart <= NEAR

    def _distance(self, K: Tangent, z: Floats) -> float:
        """Strain, and stress over stiffness, between the state of a tangent and another one."""
        apart = K.z - z
        stress = np.max(np.abs(apart[self.system.n_u :]), initial=0.0)
        return float(self.strain_of(apart)[0]) + float(stress) / self._stiffness

    def _factorise(self, K: Tangent, mu: float) -> None:
        """Factors of K, or of K + μ·metric where K is singular."""
        self._counts["factorisations"] += 1
        with self._timed("factorisation"):
            self.factors.factorise(self._symmetric(K, 0.0))
            self._stiffened = mu > 0.0 and self.factors.inertia[1] > 0
        if self._stiffened:
            self._take(K, mu)
        else:
            self._keep(K)

    def _take(self, K: Tangent, mu: float) -> None:
        """Factors of K + μ·metric."""
        with self._timed("factorisation"):
            self.factors.factorise(self._symmetric(K, mu))
        self._keep(K)

    def _keep(self, K: Tangent) -> None:
        """What goes with factors of K."""
        self._factored, self._compared = Factored.of(K, self.factors), None
        # The next tangents are augmented in proportion to the stiffness that this one has.
        self._stiffness = float(linear.stiffness(np, self.scale, K.diagonal))

    def _symmetric(self, K: Tangent, mu: float) -> Floats:
        """The upper triangle (nnz,) of the symmetric part of A + BᵀWB + μ·metric, loads included."""
        data = K.data + mu * self._metric
        if K.loads is not None:
            of_loads = (-0.5 * (K.loads + K.loads.T)).tocoo()
            upper = of_loads.row <= of_loads.col
            np.add.at(data, self.pattern.find(of_loads.row[upper], of_loads.col[upper]), of_loads.data[upper])
        return data

    def release(self) -> None:
        """Free the factors; they are made anew when they are needed."""
        self.factors.free()
        self._factored = self._single = None

    def solve(self, K: Tangent, mu: float, b: Floats, accuracy: float, guess: Floats | None, last: bool) -> Floats:
        """The solution x of (K + μ·metric) x = b to a relative residual; NaN if it is not reached."""
        if self._factored is None or (last and not self._serves(K)):
            self._factorise(K, mu)
        x, off = self._krylov(K, mu, b, accuracy, guess)
        if not off <= accuracy and not self.has_factors_of(K):
            self._factorise(K, mu)
            x, off = self._krylov(K, mu, b, accuracy, x)
        gains = True
        while gains and not off <= accuracy:  # once more from there, as long as that gains much
            before = off
            x, off = self._krylov(K, mu, b, accuracy, x)
            gains = off < GAIN * before
        if not off <= accuracy and self.factors.sharpen():
            x, off = self._krylov(K, mu, b, accuracy, x)
        return x if off <= accuracy else np.full(b.shape, np.nan)

    def solve_exactly(self, K: Tangent, b: Floats) -> tuple[Floats, float]:
        """The solution of K x = b as far as round-off lets it, and its relative residual."""
        x, off = np.zeros_like(b), np.inf
        if self._factored is not None:
            x, off = self._krylov(K, 0.0, b, 1e-12, None)
        if not off <= EXACT and not self.has_factors_of(K):
            self._factorise(K, 0.0)
            x, off = self._krylov(K, 0.0, b, 1e-12, None)
        if not off <= EXACT and self.factors.sharpen():
            x, off = self._krylov(K, 0.0, b, 1e-12, None)
        return x, off

    def uncertainty(self, K: Tangent) -> float:
        """The relative residual to which K x = b is solved, b random, where that is in question; otherwise 0.

        In question: multigrid, which does not know its inertia, and a body with very soft motions.
        """
        self.near(K)
        n_u = self.system.n_u
        if self.factors.inertia[0] >= 0:
            y = self._soft_motion() / self._strains
            if SOFT * self._stiffness * factor.norm(y) < 1.0:
                return 0.0
        s = np.where(np.arange(len(self.scale.unit)) < n_u, self.scale.unit, self._stiffness)
        b = np.random.default_rng(1).normal(size=len(s)) * np.sqrt(self.scale.volume) / s
        return self.solve_exactly(K, b)[1]

    def _krylov(self, K: Tangent, mu: float, b: Floats, accuracy: float, guess: Floats | None) -> tuple[Floats, float]:
        """x, aimed at that accuracy, and its relative residual; preconditioned by the factors that are there."""
        assert self._factored is not None
        with self._timed("inner solves"):
            # In y = x / s strains and stresses count alike, whatever the units and the size of the elements.
            s = np.where(np.arange(len(b)) < self.system.n_u, self.scale.unit, self._stiffness)
            s = s / np.sqrt(self.scale.volume)
            x, off, count = saddle.solve(K, *self._products(K, mu), self._factored, s, b, accuracy, guess)
        self._counts["inner solves"] += 1
        self._counts["inner iterations"] += count
        return x, off

    def _products(self, K: Tangent, mu: float) -> tuple[saddle.Product, saddle.Product | None]:
        """Of the elements' part of K + μ·metric and (u, m): exact, and cheap where the exact one is matrix-free."""
        data, n_u = K.data + mu * self._metric if mu else K.data, self.system.n_u
        if not isinstance(self.factors, Multigrid):
            return saddle.augmented(K, self.pattern.product(data)), None
        at = self._displacements(K.z, K.inputs)
        if self._single is None or self._single[:2] != (K, mu):
            self._single = None  # first, for its memory
            self._single = (K, mu, multigrid.symmetric(self.pattern, data))

        def product(x: Floats) -> Floats:
            y = self.assembly.product(at, K.z, K.inputs, x)
            if mu:
                y[:n_u] += mu * self.pattern.product(self._metric)(x[:n_u])
            return y

        return product, saddle.augmented(K, self._single[2])


_known: list[Sparse] = []


#: The tangents at the last states that a derivative was asked of, by a number that JAX can carry.
_held: dict[int, tuple[Sparse, Tangent]] = {}
_HELD_AT_MOST = 2e9  # bytes


def hold(system: System, z: Floats, inputs: Inputs) -> int:
    """The number of the tangent at z, for `solve_held`. Errors: SingularError if it could not be solved with.

    They are raised here, since an error inside JAX's callbacks is one of JAX's own by the time a user sees it.
    """
    sparse = Sparse.of(system)
    handle = max(_held, default=0) + 1
    K = sparse.tangent(z, inputs)
    if not (off := sparse.uncertainty(K)) <= EXACT:
        raise SingularError(
            "the state has no derivative that could be found: its linear system is solved to a relative residual of "
            f"{off:.1e} only ({EXACT:g} is asked for), since the tangent is all but singular, as that of the Lin–Yin "
            "law next to rest. Differentiate at another state, or hold its soft motions"
        )
    _held[handle] = sparse, K
    size = 0
    for old in list(_held)[::-1]:
        size += _held[old][1].bytes
        if size > _HELD_AT_MOST and old != handle:
            del _held[old]
    return handle


def solve_held(handle: Any, b: Any, transposed: Any, regular: Any) -> Floats:
    """The solution of K x = b, or of Kᵀ x = b, and 0 where K is not regular; an error if it is not found to `EXACT`."""
    if not regular:
        return np.zeros(np.shape(b))
    if int(handle) not in _held:
        raise RuntimeError(
            "a derivative through many large states at once: of their tangents, "
            f"{1e-9 * _HELD_AT_MOST:g} GB are remembered"
        )
    sparse, K = _held[int(handle)]
    if transposed and K.loads is not None:
        K = replace(K, loads=K.loads.T.tocsr())
    x, off = sparse.solve_exactly(K, np.asarray(b))
    if not off <= EXACT:
        raise RuntimeError(
            f"the linear system of a derivative was solved to {off:.1e} only (relative residual; {EXACT:g} is asked "
            "for): the tangent is all but singular there"
        )
    return x


def forget() -> None:
    """Free the patterns and factors that are kept for the next solve, and for derivatives of the last ones."""
    forget_factors()
    _held.clear()
    memory.give_back()


def forget_factors() -> None:
    """Free those for the next solve: what it finds then does not depend, in its last digits, on what was before."""
    _known.clear()


def _equal(a: Any, b: Any) -> bool:
    """Whether two pytrees are equal, number by number."""
    if not checks.same_structure(a, b):
        return False
    pairs = zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    return all(x is y or np.array_equal(x, y) for x, y in pairs)


@dataclass(frozen=True, eq=False)
class Factors:
    """K + μ·metric, to be solved and counted."""

    of: Sparse
    K: Tangent
    mu: float
    last: bool

    def solve(self, b: Floats, accuracy: Any, guess: Floats | None = None) -> Floats:
        """The solution x of (K + μ·metric) x = b to a relative residual; NaN if it is not reached."""
        return self.of.solve(self.K, self.mu, b, float(accuracy), guess, self.last)

    @property
    def sign(self) -> Any:
        """The sign of the determinant, up to that of the multipliers' block, ±1."""
        self.of.near(self.K)
        return np.array(1.0 if self.of._negative % 2 == 0 else -1.0)
