"""States of the homogeneous thin sample with and without the weave, and the few numbers that tell of each."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from threading import Lock
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxmyo.compiler import QUICK
from jaxmyo.scenes import thin_sample
from jaxmyo.solve import contract
from jaxmyo.state import State
from jaxmyo.status import SolveError, Status, explain

#: The scene of all of them: one object, so that its states can be joined.
SAMPLE = thin_sample()

_BATCH = 48
_COMPILING = Lock()  # a second thread waits for the compiled programs rather than compiling them again

#: Where states come with and without the constraint of the weave, they come in this order.
CONSTRAINT = (True, False)


class Point(NamedTuple):
    """One homogeneous state, or arrays of them (leading axes).

    stretches: (..., 3) λf, λcf, λn [–]; sigma: (..., 3) Cauchy stresses σ11, σ22, σ33 [kPa]; T_f, T_cf: pseudo-active
    tensions [kPa]; residual: relative; reached, status: see `jaxmyo.State`; negative, zero: eigenvalue counts of the
    second variation (> 0 negative: unstable; > 0 zero: a mode without stiffness).
    """

    stretches: Any
    sigma: Any
    T_f: Any
    T_cf: Any
    residual: Any
    reached: Any
    status: Any
    negative: Any
    zero: Any

    def at(self, index: Any) -> "Point":
        """Some of the states, by an index of the leading axes."""
        return Point(*(field[index] for field in self))

    def shaped(self, *shape: int) -> "Point":
        """A batch with its leading axis unfolded."""
        return Point(*(np.reshape(field, (*shape, *field.shape[1:])) for field in self))


def point(state: State) -> Point:
    """The numbers of a state of the sample of one element with one quadrature point."""
    return Point(
        stretches=state.stretches[0, 0],
        sigma=jnp.diagonal(state.cauchy[0, 0]),
        T_f=state.T_f[0, 0],
        T_cf=state.T_cf[0, 0],
        residual=state.residual,
        reached=state.reached,
        status=state.status,
        negative=state.negative_eigenvalues,
        zero=state.zero_eigenvalues,
    )


def contractions(constants: Any, T0: ArrayLike, a_over_D: ArrayLike, beta: ArrayLike) -> State:
    """Free contractions A of n samples with and without the weave, as one batch (2n,) ready to be loaded.

    T0 [kPa], a_over_D, beta: (n,), n ≤ 48. First the n states with the weave, then the n without it. In both the
    multiplier q is left behind; its tensions T_A are what state C starts from (0 without the weave).
    """
    n = np.size(T0)
    fill = [*range(n), *[0] * (_BATCH - n)]  # one size for all, so that two compiled programs serve every caller
    arguments = (constants, *(np.asarray(x, dtype=np.float64)[fill] for x in (T0, a_over_D, beta)))
    with _COMPILING, ThreadPoolExecutor(2) as pool:
        acting, absent = pool.map(lambda program: program(*arguments), (_with_weave, _without_weave))
    # In NumPy, where cutting and joining some thirty arrays needs no compilation.
    return jax.tree.map(
        lambda *leaves: np.concatenate([np.asarray(leaf)[:n] for leaf in leaves]),
        replace(acting, system=absent.system),
        absent,
    )


@partial(jax.jit, compiler_options=QUICK)
def _with_weave(constants: Any, T0: Array, a_over_D: Array, beta: Array) -> State:
    def one(T0: Array, a_over_D: Array, beta: Array) -> State:
        return without_q(contract(SAMPLE, T0=T0, a_over_D=a_over_D, beta=beta, constants=constants, throw=False))

    return jax.vmap(one)(T0, a_over_D, beta)


def without_q(A: State) -> State:
    """A contraction with the weave as one without: its multiplier has become the tensions T_A; all but its system."""
    imbalance = A.inputs.imbalance[: A.system.n_u + A.system.n_p]
    return replace(A, q=None, inputs=A.inputs._replace(T_f=A.T_f, T_cf=A.T_cf, imbalance=imbalance))


@partial(jax.jit, compiler_options=QUICK)
def _without_weave(constants: Any, T0: Array, _: Array, beta: Array) -> State:
    def one(T0: Array, beta: Array) -> State:
        return contract(SAMPLE, T0=T0, a_over_D=None, beta=beta, constants=constants, throw=False)

    return jax.vmap(one)(T0, beta)


def join(*batches: Any) -> Any:
    """Batches of the same kind, one after the other."""
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *batches)


def constants_as_arrays(constants: Any) -> Any:
    """Every constant as a float64 array, so that all sets run through one compiled program."""
    return jax.tree.map(lambda c: np.asarray(c, dtype=np.float64), constants)


def solved(points: Point, what: Sequence[str]) -> Point:
    """A batch (n,) as NumPy arrays, if all states converged; a SolveError that names the first which did not.

    what: a name for each state.
    """
    points = Point(*(np.asarray(field) for field in jax.device_get(tuple(points))))
    failed = np.flatnonzero(points.status != Status.CONVERGED)
    if failed.size:
        first = points.at(failed[0])
        raise SolveError(
            f"{failed.size} of {points.status.size} states were not found; the first, {what[failed[0]]}: "
            f"{explain(first.status, first.reached, first.residual)}",
            first,
        )
    return points


def worst(*points: Point) -> float:
    """The largest relative residual of some states."""
    return max(float(np.max(p.residual)) for p in points)
