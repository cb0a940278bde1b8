"""The least-squares solves: Levenberg–Marquardt of optimistix, many starts as one vmapped program; SciPy outside JAX.

Residuals are √w (predicted − observed), over the size of the observations, through the robust loss. One compiled
program serves a fit, its profile (a parameter that is held has a residual of its own) and a held-out protocol (weights
are inputs); another one serves a batch.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxmyo import checks
from jaxmyo.compiler import QUICK
from jaxmyo.fitting.parameters import values_at
from jaxmyo.fitting.problem import MISSED, Predict, Problem, spread

#: Of the free variables x, which are of size 1, and of the scaled residuals.
TOLERANCE = 1e-8
LOSSES = ("linear", "soft_l1", "huber", "cauchy")


class Loss(NamedTuple):
    """A loss ½ Σ s² ρ(r²/s²) of the residuals √w r, by the name that SciPy gives it; scale s [unit of the residuals].

    ρ(z): linear z; soft_l1 2(√(1+z) − 1); huber z to 1, 2√z − 1 beyond; cauchy ln(1+z).
    """

    name: str = "linear"
    scale: float = 1.0


LINEAR = Loss()


class Found(NamedTuple):
    """Where a solve ended. x: (k,); residuals (n,) and jacobian (n, k) by x, both of √w r through the loss [unit of the
    observations]; predicted: (n,), NaN where a state was not found; sum: of squares of the residuals;
    converged: whether a minimum was reached with every state found; iterations. Leading axes: the starts of a batch.
    """

    x: Any
    residuals: Any
    jacobian: Any
    predicted: Any
    sum: Any
    converged: Any
    iterations: Any


class _Space(NamedTuple):
    """What of the free parameters is static."""

    names: tuple[str, ...]
    kinds: tuple[str, ...]


class _Inputs(NamedTuple):
    """What of a problem may change without a new program; x where `held` is fixed."""

    held: Array
    x: Array
    observed: Array
    weight: Array
    fixed: dict[str, Array]
    low: Array
    high: Array
    scale: Array
    size: Array
    loss_scale: Array


def check_loss(loss: Loss) -> Loss:
    """The loss, if there is one of that name with a positive scale."""
    checks.choice("loss", loss.name, list(LOSSES))
    if not 0.0 < loss.scale < np.inf:
        raise ValueError(f"loss: scale = {loss.scale} must be positive (the unit of the observations)")
    return loss


def solve(
    problem: Problem,
    x: NDArray[np.float64],
    loss: Loss = LINEAR,
    *,
    held: NDArray[np.bool_] | None = None,
    observed: NDArray[np.float64] | None = None,
    max_steps: int = 200,
) -> Found:
    """From x (k,), or a batch (m, k) of starts as one vmapped call, to a minimum near by.

    held: (k,) or (m, k), which of x stay as they are; observed: (n,) or (m, n), instead of the problem's.
    """
    x = np.asarray(x, dtype=np.float64)
    held = np.zeros(x.shape, dtype=bool) if held is None else np.broadcast_to(held, x.shape)
    data = problem.observed if observed is None else np.asarray(observed, dtype=np.float64)
    if not problem.staged:
        if x.ndim == 1:
            return _outside(problem, x, loss, held, data, max_steps)
        each = [
            _outside(problem, x[i], loss, held[i], data if data.ndim == 1 else data[i], max_steps)
            for i in range(len(x))
        ]
        return Found(*(np.stack(field) for field in zip(*each, strict=True)))
    inputs = _inputs(problem, x, held, data, loss)
    space = _Space(problem.free, tuple(p.kind for p in problem.fitted))
    axes = None
    if x.ndim == 2:
        axes = _Inputs(0, 0, 0 if data.ndim == 2 else None, *[None] * 7)  # type: ignore[arg-type]
    found = _program(problem.predict, space, loss.name, max_steps, axes)(x, inputs)
    return Found(*(np.asarray(field) for field in found))


@cache
def _program(
    predict: Predict, space: _Space, loss: str, max_steps: int, axes: _Inputs | None
) -> Callable[[Any, _Inputs], Found]:
    """The compiled solve; one per problem that differs by more than numbers."""
    one = partial(_solve, predict, space, loss, max_steps)
    return jax.jit(one if axes is None else jax.vmap(one, in_axes=(0, axes)), compiler_options=QUICK)


def _solve(predict: Predict, space: _Space, loss: str, max_steps: int, x: Array, inputs: _Inputs) -> Found:
    optx = _optimistix()
    k = len(space.names)

    def residual(x: Array, inputs: _Inputs) -> tuple[Array, Array]:
        at = jnp.where(inputs.held, inputs.x, x)
        r, predicted = _residuals(predict, space, loss, at, inputs)
        return jnp.concatenate([r, jnp.where(inputs.held, x - inputs.x, 0.0)]), predicted

    method = optx.LevenbergMarquardt(rtol=TOLERANCE, atol=TOLERANCE)
    end = optx.least_squares(residual, method, x, inputs, has_aux=True, max_steps=max_steps, throw=False)
    last = end.state.f_info
    jacobian = last.jac.as_matrix()[:-k] * inputs.size
    r = last.residual[:-k] * inputs.size
    found = jnp.all(jnp.isfinite(end.aux) | (inputs.weight == 0.0))
    converged = found & (end.result == optx.RESULTS.successful)
    return Found(end.value, r, jacobian, end.aux, jnp.sum(r**2), converged, end.stats["num_steps"])


def _residuals(predict: Predict, space: _Space, loss: str, x: Array, inputs: _Inputs) -> tuple[Array, Array]:
    """Scaled residuals (n,) through the loss, and the predictions (n,)."""
    free = values_at(x, space.kinds, inputs.low, inputs.high, inputs.scale)
    predicted = predict(inputs.fixed | dict(zip(space.names, free, strict=True)))
    off = jnp.where(jnp.isfinite(predicted), predicted - inputs.observed, MISSED * inputs.size)
    r = jnp.sqrt(inputs.weight) * off
    return r * jnp.sqrt(_over_square(loss, (r / inputs.loss_scale) ** 2)) / inputs.size, predicted


def _over_square(loss: str, z: Array) -> Array:
    """ρ(z)/z of a loss."""
    if loss == "soft_l1":
        return 2.0 / (jnp.sqrt(1.0 + z) + 1.0)
    far = jnp.maximum(z, 1.0)
    if loss == "huber":
        return jnp.where(z <= 1.0, 1.0, (2.0 * jnp.sqrt(far) - 1.0) / far)
    if loss == "cauchy":
        some = jnp.maximum(z, 1e-8)
        return jnp.where(z < 1e-8, 1.0 - 0.5 * z, jnp.log1p(some) / some)
    return jnp.ones_like(z)


def _inputs(
    problem: Problem, x: NDArray[Any], held: NDArray[np.bool_], observed: NDArray[np.float64], loss: Loss
) -> _Inputs:
    fitted = problem.fitted
    fixed: Any = {p.name: np.float64(p.value) for p in problem.parameters if p.name not in problem.free}
    numbers: Any = [np.array([getattr(p, name) for p in fitted]) for name in ("low", "high", "scale")]
    arrays: Any = (held, x, observed, problem.weight, fixed)
    return _Inputs(*arrays, *numbers, np.float64(spread(problem.observed)), np.float64(loss.scale))  # type: ignore[arg-type]


def _outside(
    problem: Problem, x: NDArray[Any], loss: Loss, held: NDArray[np.bool_], observed: NDArray[Any], max_steps: int
) -> Found:
    """The same by SciPy's Levenberg–Marquardt, for predictions that do not run inside `jit`."""
    from scipy.optimize import least_squares

    inputs = _inputs(problem, x, held, observed, loss)
    space = _Space(problem.free, tuple(p.kind for p in problem.fitted))
    free = np.flatnonzero(~held)
    last: dict[str, Any] = {}

    def at(y: NDArray[np.float64]) -> dict[str, Any]:
        if not np.array_equal(last.get("y"), y):  # SciPy asks for the residuals and for their derivatives
            full = jnp.asarray(x).at[free].set(y)
            r, push, predicted = jax.linearize(
                lambda x: _residuals(problem.predict, space, loss.name, x, inputs), full, has_aux=True
            )
            columns = [np.asarray(push(jnp.zeros(len(x)).at[i].set(1.0))) for i in free]
            last.update(y=y.copy(), r=np.asarray(r), J=np.stack(columns, axis=1), predicted=np.asarray(predicted))
        return dict(last)

    if free.size:
        # `lm` of MINPACK has no limit of iterations but one of evaluations, and a Jacobian at each is what costs.
        end = least_squares(
            lambda y: at(y)["r"], x[free], lambda y: at(y)["J"], method="trf", xtol=1e-9, ftol=1e-12, gtol=1e-12,
            max_nfev=max_steps,
        )  # fmt: skip
        y, good, n = end.x, end.status > 0, end.nfev
    else:
        y, good, n = x[free], True, 1
    known, size = at(y), float(inputs.size)
    jacobian = np.zeros((len(known["r"]), len(x)))
    jacobian[:, free] = known["J"] * size
    full = x.copy()
    full[free] = y
    seen = bool((np.isfinite(known["predicted"]) | (np.asarray(inputs.weight) == 0.0)).all())
    r = known["r"] * size
    return Found(full, r, jacobian, known["predicted"], np.sum(r**2), np.array(seen and good), np.array(n))


def _optimistix() -> Any:
    try:
        import optimistix
    except ModuleNotFoundError as error:
        raise checks.missing(error, "a fit needs", "'jaxmyo[fit]'") from error
    return optimistix
