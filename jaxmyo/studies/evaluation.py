"""What a study evaluates at a point: the user's function, the outputs, their derivatives, and a status."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxmyo import checks
from jaxmyo.scene import Scene
from jaxmyo.solve import LARGE, contract
from jaxmyo.state import State
from jaxmyo.status import SingularError, SolveError, Status
from jaxmyo.studies import quantities
from jaxmyo.studies.identity import primitives, program_hash

Solve = Scene | Callable[..., Any]
Outputs = Sequence[str] | Mapping[str, str | Callable[[Any], Any]] | None

#: Operations on matrices that JAX hands to LAPACK on a CPU.
LAPACK = {"cholesky", "eig", "eigh", "geqrf", "hessenberg", "householder_product", "lu", "schur", "svd"}
LAPACK |= {"triangular_solve", "tridiagonal", "tridiagonal_solve"}

STATUS, DERIVATIVE_STATUS = "status", "derivative_status"


def derivative_name(output: str, parameter: str) -> str:
    """The name of ∂output/∂parameter in files and datasets."""
    return f"d_{output}_d_{parameter}"


class Evaluation:
    """A function of one point, name → scalar, that JAX can trace; what it returns is `shapes`.

    names: the parameters; outputs: their names; scenes: those of the states that the function makes; unknowns: of the
    largest of these states; large: whether they are so large that they are solved by sparse factors, outside of JAX's
    transformations; program: a hash of what is computed; lapack: whether a batch of points calls LAPACK with several
    matrices at a time.
    """

    def __init__(self, solve: Solve, names: Sequence[str], outputs: Outputs, derivatives: Sequence[str]) -> None:
        self.names = tuple(names)
        self._solve = _of_scene(solve, self.names) if isinstance(solve, Scene) else _of_function(solve, self.names)
        self._wanted = _checked(outputs)
        self.by = tuple(derivatives)
        for name in self.by:
            checks.choice("derivatives", name, list(self.names))
        self.scenes: tuple[Scene, ...] = ()
        self.unknowns, self.large = 0, False
        self.outputs: tuple[str, ...] = ()
        self.differentiated: tuple[str, ...] = ()
        at = {name: jax.ShapeDtypeStruct((), jnp.float64) for name in self.names}
        try:
            jax.eval_shape(self._look, at)
            program, shapes = jax.make_jaxpr(self, return_shape=True)(at)
        except jax.errors.JAXTypeError as error:
            error.add_note("A study traces solve with JAX (jit and vmap): no Python decisions by values of parameters.")
            raise
        self.program = program_hash(program)
        self.lapack = not self.large and not LAPACK.isdisjoint(primitives(program)) and self._lapack_in_batches()
        status = [STATUS, DERIVATIVE_STATUS] if self.by else [STATUS]
        self.shapes = {name: shapes[name] for name in (*self.outputs, *self.slopes, *status)}  # JAX sorts the names

    def __call__(self, point: Mapping[str, Any]) -> dict[str, Array]:
        """Outputs, NaN where the status says that the sample failed; derivatives, likewise with their own status."""
        if not self.by:
            values, status, _ = self._values(point)
            return _flagged(values, status, STATUS)
        at = {name: point[name] for name in self.by}

        def moved(x: dict[str, Array]) -> tuple[dict[str, Array], tuple[Any, ...]]:
            values, status, zero = self._values({**point, **x})
            return {name: values[name] for name in self.differentiated}, (values, status, zero)

        # As many linear solves as there are parameters, or as there are numbers in the outputs.
        mode = jax.jacfwd if len(at) <= self._n_differentiated else jax.jacrev
        slopes, (values, status, zero) = mode(moved, has_aux=True)(at)
        singular = jnp.where(zero > 0, Status.SINGULAR, Status.CONVERGED).astype(jnp.int8)
        named = {derivative_name(y, x): slopes[y][x] for y in self.differentiated for x in self.by}
        own = jnp.where(status == Status.CONVERGED, singular, status)
        return _flagged(values, status, STATUS) | _flagged(named, own, DERIVATIVE_STATUS)

    def one(self, point: Mapping[str, float]) -> dict[str, NDArray[Any]]:
        """The same with numbers, outside of jit and vmap, for states that are solved by sparse factors."""
        at = {name: jnp.asarray(x, dtype=float) for name, x in point.items()}
        found: dict[str, Any] = {}
        try:
            found = self(at)
        except SolveError as error:
            status = np.asarray(error.state.status)  # type: ignore[attr-defined]
        except SingularError:
            status = np.asarray(Status.SINGULAR)
            found = _flagged(*self._values(at)[:2], STATUS)
        return {
            name: np.asarray(found[name])
            if name in found
            else status.astype(s.dtype)
            if s.dtype == np.int8
            else np.full(s.shape, np.nan)
            for name, s in self.shapes.items()
        }

    def _lapack_in_batches(self) -> bool:
        """Whether a batch calls LAPACK with more than a matrix; solves of small bodies call it one by one."""
        batch = {name: jax.ShapeDtypeStruct((2,), jnp.float64) for name in self.names}
        found = primitives(jax.make_jaxpr(jax.vmap(self))(batch))
        return any(axes > 2 for name, axes in found.items() if name in LAPACK)

    def _look(self, point: Mapping[str, Any]) -> Array:
        """A first trace, from which is known what the function returns."""
        value = self._solve(**point)
        states = _states(value)
        seen: dict[int, Scene] = {id(state.scene): state.scene for state in states}
        self.scenes = tuple(seen.values())
        self.unknowns = max((state.system.size for state in states), default=0)
        self.large = any(state.system.n_u > LARGE for state in states)
        values = self._outputs_of(value, states)
        self.outputs = tuple(values)
        for name, x in values.items():
            if not name.isidentifier():
                raise ValueError(f"outputs: the name of an output must be a word, as 'lambda_f'; got {name!r}")
            if name in (*self.names, STATUS, DERIVATIVE_STATUS):
                raise ValueError(f"outputs: {name!r} is the name of a parameter or of the status; choose another")
            if not isinstance(x, np.ndarray | np.generic | jax.Array | float | int):
                raise TypeError(
                    f"outputs[{name!r}] must be a number or an array of fixed shape; got {type(x).__name__}"
                )
            if jnp.result_type(x).kind not in "biuf":
                raise TypeError(f"outputs[{name!r}] must be real numbers; got {jnp.result_type(x)}")
        known = quantities.OUTPUTS
        no = {name for name, source in self._sources(values).items() if source in known and known[source].diagnostic}
        no |= {name for name, x in values.items() if jnp.result_type(x).kind != "f"}
        self.differentiated = tuple(name for name in values if name not in no)
        self._n_differentiated = sum(int(np.prod(jnp.shape(values[name]))) for name in self.differentiated)
        self._status(value, states)
        return jnp.zeros(())

    @property
    def slopes(self) -> tuple[str, ...]:
        """The names of the derivatives."""
        return tuple(derivative_name(y, x) for y in self.differentiated for x in self.by)

    def units(self, given: Mapping[str, str]) -> dict[str, str]:
        """Units of parameters, outputs and derivatives, from the user's or those that are known."""
        sources = self._sources(self.outputs)
        known = {n: quantities.OUTPUTS[s].unit for n, s in sources.items() if s in quantities.OUTPUTS}
        of_parameters = quantities.units_of(self.names, quantities.PARAMETERS, given, "parameter")
        of_outputs = quantities.units_of(self.outputs, known, given, "output")
        slopes = {
            derivative_name(y, x): quantities.quotient(of_outputs[y], of_parameters[x])
            for y in self.differentiated
            for x in self.by
        }
        return of_parameters | of_outputs | slopes

    def _sources(self, names: Any) -> dict[str, str]:
        """Name of an output → the name by which it was asked for, if it was by a name."""
        asked = self._wanted or {}
        return {n: s for n in names if isinstance(s := asked.get(n, n), str)}

    def _values(self, point: Mapping[str, Any]) -> tuple[dict[str, Array], Array, Array]:
        """Outputs, status (a converged state with an output that is not finite has one of its own), free modes."""
        value = self._solve(**point)
        states = _states(value)
        raw = self._outputs_of(value, states)
        values = {name: jnp.asarray(x).astype(float) for name, x in raw.items()}
        zero = [jnp.max(state.zero_eigenvalues).astype(int) for state in states]
        return values, self._status(value, states), jnp.max(jnp.stack([*zero, jnp.array(0)]))

    def _outputs_of(self, value: Any, states: Sequence[State]) -> dict[str, Any]:
        own = {n: x for n, x in value.items() if not _states(x) and n != STATUS} if isinstance(value, Mapping) else {}
        wanted = self._wanted or {name: name for name in (own or (quantities.DEFAULT if states else ()))}
        if not wanted:
            raise TypeError(f"solve must return a State, or a mapping from names to outputs; it returns {value!r}")
        found = {}
        for name, source in wanted.items():
            if callable(source):
                found[name] = source(value)
            elif source in own:
                found[name] = own[source]
            else:
                valid = [*own, *(quantities.OUTPUTS if states else ())]
                found[name] = quantities.OUTPUTS[checks.choice("outputs", source, valid)].of(states[-1])
        return found

    def _status(self, value: Any, states: Sequence[State]) -> Array:
        """The first status that is not CONVERGED, in the order of the states."""
        every = [jnp.ravel(jnp.asarray(state.status)) for state in states]
        if isinstance(value, Mapping) and STATUS in value:
            every.append(jnp.ravel(jnp.asarray(value[STATUS])))
        if not every:
            raise TypeError(
                "solve must return a State, or states among what it returns, or a 'status' beside its outputs (0 where "
                "they are good): a study has to know which samples failed"
            )
        joined = jnp.concatenate([s.astype(jnp.int8) for s in every])
        return joined[jnp.argmax(joined != Status.CONVERGED)]


def _flagged(values: dict[str, Array], status: Array, name: str) -> dict[str, Array]:
    """The values, NaN where they failed, with the status under its name."""
    finite = jnp.all(jnp.stack([quantities.is_finite(x) for x in values.values()]))
    wrong = jnp.asarray(Status.OUTPUT_NOT_FINITE, dtype=jnp.int8)
    status = jnp.where((status == Status.CONVERGED) & ~finite, wrong, status)
    return {n: jnp.where(status == Status.CONVERGED, x, jnp.nan) for n, x in values.items()} | {name: status}


def _states(value: Any) -> list[State]:
    leaves = jax.tree.leaves(value, is_leaf=lambda x: isinstance(x, State))
    return [leaf for leaf in leaves if isinstance(leaf, State)]


def _checked(outputs: Outputs) -> dict[str, str | Callable[[Any], Any]] | None:
    if outputs is None:
        return None
    if isinstance(outputs, str):
        outputs = [outputs]
    if not isinstance(outputs, Mapping):
        if not all(isinstance(name, str) for name in outputs):
            raise TypeError(f"outputs must be names, or a mapping from names to functions; got {outputs!r}")
        outputs = {name: name for name in outputs}
    if not outputs:
        raise ValueError("outputs is empty: name at least one, or leave it out for all that a state has")
    for name, source in outputs.items():
        if not isinstance(name, str) or not (isinstance(source, str) or callable(source)):
            raise TypeError(f"outputs[{name!r}] must be a function of what solve returns, or a name; got {source!r}")
    return dict(outputs)


def _of_scene(scene: Scene, names: Sequence[str]) -> Callable[..., State]:
    """The free contraction of a scene, by its inputs and by its law's constants."""
    own: Any = scene.constants
    constants: list[str] = []
    if not scene.regions:
        if is_dataclass(own):
            constants = [f.name for f in fields(own) if np.ndim(getattr(own, f.name)) == 0]
        elif isinstance(own, Mapping):
            constants = [n for n, x in own.items() if isinstance(n, str) and np.ndim(x) == 0]
    inputs = ["T0", "a_over_D", "beta", "weave_stiffness"]
    _check_names(names, [*inputs, *constants], ["T0", "a_over_D"], "the free contraction of the scene")

    def solve(**point: Any) -> State:
        moved = {name: x for name, x in point.items() if name in constants}
        given = {name: x for name, x in point.items() if name in inputs}
        changed = None if not moved else {**own, **moved} if isinstance(own, Mapping) else replace(own, **moved)
        return contract(scene, constants=changed, throw=False, **given)

    return solve


def _of_function(solve: Any, names: Sequence[str]) -> Callable[..., Any]:
    if not callable(solve):
        raise TypeError(f"solve must be a Scene, or a function of named numbers; got {solve!r}")
    try:
        parameters = inspect.signature(solve).parameters.values()
    except (TypeError, ValueError):  # something compiled that does not tell
        return solve
    kinds = inspect.Parameter
    named = [p for p in parameters if p.kind in (kinds.POSITIONAL_OR_KEYWORD, kinds.KEYWORD_ONLY)]
    required = [p.name for p in named if p.default is kinds.empty]
    valid = None if any(p.kind is kinds.VAR_KEYWORD for p in parameters) else [p.name for p in named]
    _check_names(names, valid, required, "solve")
    return solve


def _check_names(names: Sequence[str], valid: list[str] | None, required: list[str], what: str) -> None:
    unknown = [name for name in names if valid is not None and name not in valid]
    if unknown:
        raise ValueError(
            f"axes: {', '.join(map(repr, unknown))} is no parameter of {what}, which has {', '.join(valid or ['none'])}"
        )
    if missing := [name for name in required if name not in names]:
        raise ValueError(
            f"axes: {what} needs {', '.join(map(repr, missing))} too; a number instead of an array keeps a parameter "
            "fixed"
        )
