"""The path to an equilibrium as one function, whose derivatives do not depend on the path: implicit differentiation.

An equilibrium z of r(z, inputs, geometry) = 0 changes by dz = −K⁻¹ dr, with K = ∂r/∂z and dr the change of the residual
at fixed z: one linear solve for a derivative, one with Kᵀ for a gradient, whatever the number of inputs. The rule is
itself made of functions that JAX differentiates, so second derivatives follow from it.
"""

from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.custom_derivatives import SymbolicZero

from jaxmyo import checks, continuation, lagrangian, leaves, linear, newton, progress, single_precision, sparse, tracing
from jaxmyo.compiler import lean
from jaxmyo.continuation import Route, Solution
from jaxmyo.linear import Dense
from jaxmyo.newton import NUMBERS, Settings
from jaxmyo.sparse import Sparse
from jaxmyo.status import SingularError, Status
from jaxmyo.system import Inputs, System


def follow(system: System, z: Array, route: Route, settings: Settings) -> Solution:
    """The path of states along a route, see `continuation.follow`: one program, or by sparse factors.

    Of its results z and inputs have derivatives, by the end of the route and by the arrays of `system`. They are 0
    where the path failed (`status`), those of z also where the tangent is singular (`zero` > 0), as in passive tissue
    at rest.
    Errors: SingularError for a derivative of a singular state, outside of jit and vmap.
    """
    return _followed(system, z, route, settings)[0]


@partial(jax.custom_jvp, nondiff_argnums=(3,))
def _followed(system: System, z: Array, route: Route, settings: Settings) -> tuple[Solution, Array | None]:
    """The solution and, of a small body, the tangent (n, n) there, which a derivative has a use for."""
    stepwise = settings.time_limit is not None or settings.progress
    single = checks.choice("settings.precision", settings.precision, newton.PRECISIONS) != "float64"
    if single and not system.is_small:
        raise ValueError(
            f"settings.precision = {settings.precision!r} is for bodies that are solved by dense factors: small ones, "
            'and all inside jit and vmap; of others, "float64" factorises in float32 and corrects in float64 already'
        )
    traced = tracing.is_traced((z, route.end))
    if system.is_small and (single or traced or not (stepwise or progress.wanted())):
        if stepwise:
            raise ValueError(
                'settings: time_limit and progress are for solves outside of jit and vmap, with precision "float64"'
            )
        # Numbers are arguments of the program: another tolerance compiles nothing.
        numbers = {name: getattr(settings, name) for name in NUMBERS}
        none: dict[str, Any] = dict.fromkeys(NUMBERS)
        kept = settings._replace(**none)
        return _compiled(system, z, route, numbers, settings=kept)
    if system.is_small:
        return continuation.follow(Dense.of(system), z, route, settings)
    at: Any = np.array(z)
    flags: Any = {name: np.asarray(getattr(route, name)) for name in ("valid", "from_rest", "from_A")}
    solution, _ = continuation.follow(Sparse.of(system), at, replace(route, **flags), settings)
    return jax.device_put(solution), None


def _path(
    system: System, z: Array, route: Route, numbers: dict[str, Any], *, settings: Settings
) -> tuple[Solution, Array]:
    follow = continuation.follow if settings.precision == "float64" else single_precision.follow
    return follow(Dense.of(system), z, route, settings._replace(**numbers))


_compiled = lean(_path, "settings")


@partial(_followed.defjvp, symbolic_zeros=True)
def _rule(settings: Settings, primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
    s, K = _followed(*primals, settings)
    system, d_system, d_end = primals[0], tangents[0], tangents[2].end
    regular = (s.status == Status.CONVERGED) & (s.zero <= 0)  # −1: multigrid, which cannot tell
    if not tracing.is_traced(regular) and s.status == Status.CONVERGED and not regular:
        raise SingularError(
            f"the state has no derivative: its tangent has {int(s.zero)} mode(s) without stiffness (zero_eigenvalues), "
            "as the Lin–Yin law at rest. Differentiate at another state, or hold these modes"
        )
    of_system, moved = _perturbed(system, d_system)
    of_inputs, driven = _perturbed(s.inputs, d_end)
    tangent = _hold(system, s.z, s.inputs, regular) if K is None else K
    dz = _sensitivity(system, s.z, s.inputs, regular, tangent, of_system, of_inputs, moved=moved, driven=driven)
    nothing, none = jax.tree.map(_nothing, (s, K))
    # Those of a singular state too: passive tissue at rest hands its constants on to what is loaded from it.
    known = [jnp.where(s.status == Status.CONVERGED, dx, 0.0) for dx in of_inputs]
    return (s, K), (nothing._replace(z=dz, inputs=leaves.put(nothing.inputs, driven, known)), none)


@jax.custom_jvp
def _hold(system: System, z: Array, inputs: Inputs, regular: Array) -> Array:
    """The number of the tangent at z of a large body; a function of values, whatever is differentiated."""
    return jnp.array(sparse.hold(system, np.asarray(z), inputs) if regular else 0)


@_hold.defjvp
def _hold_rule(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Array, Any]:
    number = _hold(*primals)
    return number, np.zeros((), jax.dtypes.float0)


@partial(jax.jit, static_argnames=("moved", "driven"))
def _sensitivity(
    system: System,
    z: Array,
    inputs: Inputs,
    regular: Array,
    tangent: Array,
    of_system: list[Array],
    of_inputs: list[Array],
    *,
    moved: tuple[int, ...],
    driven: tuple[int, ...],
) -> Array:
    """dz (n,) of changes of those leaves of system and inputs that change; 0 where not regular.

    tangent: (n, n), or of a large body its number, see `sparse.hold`.
    """

    def residual(geometry: list[Array], loading: list[Array]) -> Array:
        return lagrangian.residual(leaves.put(system, moved, geometry), z, leaves.put(inputs, driven, loading))

    at = leaves.pick(system, moved), leaves.pick(inputs, driven)
    _, dr = jax.jvp(residual, at, (of_system, of_inputs))
    # A matrix and a right side that are harmless where there is no derivative: what is 0 · NaN would come back.
    dr = jnp.where(regular, dr, 0.0)

    def apply(v: Array) -> Array:
        return jax.jvp(lambda z: lagrangian.residual(system, z, inputs), (z,), (v,))[1]

    def solve(_: Any, b: Array, *, transposed: bool = False) -> Array:
        if system.is_small:
            K = jnp.where(regular, tangent, jnp.eye(len(z)))
            return linear.factors(K.T if transposed else K).solve(b, None)
        like = jax.ShapeDtypeStruct(b.shape, b.dtype)
        return jax.pure_callback(sparse.solve_held, like, tangent, b, transposed, regular, vmap_method="sequential")

    return -jax.lax.custom_linear_solve(apply, dr, solve, partial(solve, transposed=True))


def _perturbed(tree: Any, tangents: Any) -> tuple[list[Array], tuple[int, ...]]:
    """The tangents that are not zero, and the positions of their leaves in the tree."""
    every = jax.tree.leaves(tangents, is_leaf=lambda x: isinstance(x, SymbolicZero))
    at = tuple(i for i, d in enumerate(every) if not isinstance(d, SymbolicZero))
    return [every[i] for i in at], at


def _nothing(x: Array) -> Any:
    """The tangent 0 of an array."""
    inexact = jnp.issubdtype(jnp.result_type(x), jnp.inexact)
    return jnp.zeros_like(x) if inexact else np.zeros(jnp.shape(x), jax.dtypes.float0)
