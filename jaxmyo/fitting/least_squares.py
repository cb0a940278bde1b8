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
from jaxmyo.compiler import LONG, QUICK
from jaxmyo.fitting.parameters import values_at
from jaxmyo.fitting.problem import MISSED, Predict, Problem, spread

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


class _Inputs(NamedTuple):
    """What of a problem may change without a new program; (K,) over all parameters, of which the held ones stay."""

    held: Any
    value: Any  # of the held ones
    x: Any  # of the start
    observed: Any
    weight: Any
    low: Any
    high: Any
    scale: Any
    size: Any
    loss_scale: Any


#: Names and kinds of bounds of all parameters.
_Space = tuple[tuple[str, str], ...]


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
    held = np.broadcast_to(False if held is None else held, x.shape)
    data = np.asarray(problem.observed if observed is None else observed, dtype=np.float64)
    if not problem.staged:
        if x.ndim == 1:
            return _outside(problem, x, loss, held, data, max_steps)
        each = [
            _outside(problem, x[i], loss, held[i], data if data.ndim == 1 else data[i], max_steps)
            for i in range(len(x))
        ]
        return Found(*(np.stack(field) for field in zip(*each, strict=True)))
    inputs = _inputs(problem, x, held, data, loss)
    axes = None
    if x.ndim == 2:
        axes = _Inputs(0, 0, 0, 0 if data.ndim == 2 else None, *[None] * 6)
    space = tuple((p.name, p.kind) for p in problem.parameters)
    found = Found(*map(np.asarray, _program(problem.predict, space, loss.name, max_steps, axes)(inputs)))
    free = _places(problem)
    return found._replace(x=found.x[..., free], jacobian=found.jacobian[..., free])


def _places(problem: Problem) -> list[int]:
    """Where the free parameters stand among all."""
    names = [p.name for p in problem.parameters]
    return [names.index(name) for name in problem.free]


@cache
def _program(
    predict: Predict, space: _Space, loss: str, max_steps: int, axes: _Inputs | None
) -> Callable[[_Inputs], Found]:
    """The compiled solve; one per problem that differs by more than numbers and by which parameters are free."""
    one = partial(_solve, predict, space, loss, max_steps)
    if axes is None:
        return jax.jit(one, compiler_options=QUICK)
    return jax.jit(jax.vmap(one, in_axes=(axes,)), compiler_options=LONG)


def _solve(predict: Predict, space: _Space, loss: str, max_steps: int, inputs: _Inputs) -> Found:
    optx, method = _optimistix()
    k = len(space)

    @jax.custom_jvp
    def residual(x: Array, inputs: _Inputs) -> tuple[Array, Array]:
        r, predicted, _ = _linearised(predict, space, loss, x, inputs)
        return r, predicted

    @residual.defjvp
    def by_x(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
        r, predicted, jacobian = _linearised(predict, space, loss, *primals)
        return (r, predicted), (jacobian @ tangents[0], jnp.zeros_like(predicted))

    # In the context in which JAX evaluates a jaxpr, so that the trace of optimistix's first look at it serves the rest.
    with jax.sharding.use_abstract_mesh(jax.sharding.get_abstract_mesh()):
        end = optx.least_squares(residual, method, inputs.x, inputs, has_aux=True, max_steps=max_steps, throw=False)
    last, predicted = end.state.f_info, end.state.aux  # both of the last step that was taken; end.aux is one older
    jacobian = last.jac.as_matrix()[:-k] * inputs.size
    r = last.residual[:-k] * inputs.size
    found = jnp.all(jnp.isfinite(predicted) | (inputs.weight == 0.0))
    converged = found & (end.result == optx.RESULTS.successful)
    return Found(end.value, r, jacobian, predicted, jnp.sum(r**2), converged, end.stats["num_steps"])


@partial(jax.jit, static_argnums=(0, 1, 2))
def _linearised(predict: Predict, space: _Space, loss: str, x: Array, inputs: _Inputs) -> tuple[Array, Array, Array]:
    """Scaled residuals (n + K,) with those of the held parameters, predictions (n,), and the Jacobian (n + K, K) by x.

    The Jacobian once for each step, and the predictions traced once for every program that uses them.
    """

    def residual(x: Array) -> tuple[Array, tuple[Array, Array]]:
        r, predicted = _residuals(predict, space, loss, x, inputs)
        every = jnp.concatenate([r, jnp.where(inputs.held, x - inputs.x, 0.0)])
        return every, (every, predicted)

    jacobian, (r, predicted) = jax.jacfwd(residual, has_aux=True)(x)
    return r, predicted, jacobian


def _residuals(predict: Predict, space: _Space, loss: str, x: Array, inputs: _Inputs) -> tuple[Array, Array]:
    """Scaled residuals (n,) through the loss, and the predictions (n,)."""
    free = values_at(x, tuple(kind for _, kind in space), inputs.low, inputs.high, inputs.scale)
    predicted = predict({n: jnp.where(inputs.held[i], inputs.value[i], free[i]) for i, (n, _) in enumerate(space)})
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
    every, free = problem.parameters, _places(problem)
    shape = (*x.shape[:-1], len(every))
    full, stay, value = np.zeros(shape), np.ones(shape, dtype=bool), np.empty(shape)
    full[..., free], stay[..., free] = x, held
    value[:] = [p.value for p in every]
    value[..., free] = np.apply_along_axis(partial(values_of, problem), -1, x)
    low, high, scale = (np.array([getattr(p, name) for p in every]) for name in ("low", "high", "scale"))
    size = np.float64(spread(problem.observed))
    return _Inputs(stay, value, full, observed, problem.weight, low, high, scale, size, np.float64(loss.scale))


def values_of(problem: Problem, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """The values (k,) of the free parameters at x (k,)."""
    fitted = problem.fitted
    low, high, scale = (np.array([getattr(p, name) for p in fitted]) for name in ("low", "high", "scale"))
    return np.array(values_at(x, tuple(p.kind for p in fitted), low, high, scale, np))


def residual_of(problem: Problem, x: NDArray[np.float64], loss: Loss) -> Callable[[Array], Array]:
    """The scaled residuals (n,) through the loss as a function of the free x (k,), near a start x."""
    inputs = _inputs(problem, x, np.zeros(x.shape, dtype=bool), problem.observed, loss)
    space, places = tuple((p.name, p.kind) for p in problem.parameters), np.array(_places(problem))

    def residual(x: Array) -> Array:
        return _residuals(problem.predict, space, loss.name, jnp.asarray(inputs.x).at[places].set(x), inputs)[0]

    return residual


def _outside(
    problem: Problem, x: NDArray[Any], loss: Loss, held: NDArray[np.bool_], observed: NDArray[Any], max_steps: int
) -> Found:
    """The same by SciPy's trust region, for predictions that do not run inside `jit`."""
    from scipy.optimize import least_squares

    inputs = _inputs(problem, x, held, observed, loss)
    space = tuple((p.name, p.kind) for p in problem.parameters)
    moving = np.flatnonzero(~held)
    places = np.array(_places(problem))[moving]
    last: dict[str, Any] = {}

    def at(y: NDArray[np.float64]) -> dict[str, Any]:
        if not np.array_equal(last.get("y", np.nan), y):  # SciPy asks for the residuals and for their derivatives

            def residual(y: Array) -> tuple[Array, Array]:
                return _residuals(problem.predict, space, loss.name, jnp.asarray(inputs.x).at[places].set(y), inputs)

            r, push, predicted = jax.linearize(residual, jnp.asarray(y), has_aux=True)
            J = np.stack([np.asarray(push(e)) for e in jnp.eye(len(y))], axis=1)
            last.update(y=y.copy(), r=np.asarray(r), J=J, predicted=np.asarray(predicted))
        return dict(last)

    end = least_squares(
        lambda y: at(y)["r"],
        x[moving],
        lambda y: at(y)["J"],
        xtol=1e-9,
        ftol=1e-10,
        gtol=None,
        max_nfev=max_steps,
    )
    known, size = at(end.x), float(inputs.size)
    full, jacobian = x.copy(), np.zeros((len(observed), len(x)))
    full[moving], jacobian[:, moving] = end.x, known["J"] * size
    seen = bool((np.isfinite(known["predicted"]) | (np.asarray(inputs.weight) == 0.0)).all())
    r, good, n = known["r"] * size, np.array(seen and end.status > 0), np.array(end.nfev)
    return Found(full, r, jacobian, known["predicted"], np.sum(r**2), good, n)


def _optimistix() -> Any:
    """optimistix, and our method of it."""
    try:
        import optimistix

        from jaxmyo.fitting.levenberg_marquardt import LevenbergMarquardt
    except ModuleNotFoundError as error:
        raise checks.missing(error, "a fit needs", "'jaxmyo[fit]'") from error
    return optimistix, LevenbergMarquardt()
