"""Functions of a few numbers, such as a law, at many points at once, written out number by number.

`vmap` makes of one operation on a tensor (3, 3) one on an array (points, 3, 3): XLA then keeps the tensors of all
points in memory, and reads their components with strides. Written out, each component is a row of lanes, see
`jaxmyo.lanes`: no tensor is kept, and what is known to be zero is not differentiated.

    function of arrays ─► program of numbers ─► its derivatives, by JAX ─► rows of lanes
"""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.extend.core import ClosedJaxpr, jaxpr_as_fun
from numpy.typing import NDArray

#: The most operations on numbers that are written out; the products of a neural network, say, are left to matrices.
MOST = 256

#: An array of a program: of each of its entries a number that JAX traces, a row of lanes, or a known number.
Entries = NDArray[np.object_]

# fmt: off
_OF_EACH_ENTRY = {
    "abs", "acos", "acosh", "add", "add_any", "and", "asin", "asinh", "atan", "atan2", "atanh", "cbrt", "ceil",
    "clamp", "convert_element_type", "copy", "cos", "cosh", "div", "eq", "erf", "erf_inv", "erfc", "exp", "exp2",
    "expm1", "floor", "ge", "gt", "integer_pow", "is_finite", "le", "lgamma", "log", "log1p", "logistic", "lt",
    "max", "min", "mul", "ne", "neg", "not", "or", "pow", "rem", "round", "rsqrt", "select_n", "sign", "sin",
    "sinh", "sqrt", "square", "sub", "tan", "tanh", "xor",
}
# fmt: on


class _CannotError(Exception):
    """The function does what is not written out."""


def of_numbers(function: Callable[..., Array], lanes: int, *args: Any) -> ClosedJaxpr | None:
    """The program of a function, of all the numbers in its arguments; None where it cannot be written out.

    function: of arrays without lanes, to a number; args: its arguments (..., *lanes), with so many axes of lanes. What
    cannot be written out: more than `MOST` operations, loops, linear algebra, functions with derivatives of their own.
    """

    def alone(x: Array) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct(x.shape[: x.ndim - lanes], x.dtype)

    program = jax.make_jaxpr(function)(*jax.tree.map(alone, args))
    shapes = [x.aval.shape for x in program.jaxpr.invars]
    ends = np.cumsum([0, *map(math.prod, shapes)])
    if ends[-1] > MOST:
        return None

    def run(*numbers: Any) -> Any:
        parts = [numbers[a:b] for a, b in pairwise(ends)]
        (found,) = _Writer(MOST).run(program, list(map(_array, parts, shapes)))
        return found[()]

    each = [x.aval.dtype for x in program.jaxpr.invars for _ in range(math.prod(x.aval.shape))]
    try:
        return _needed(jax.make_jaxpr(run)(*(jax.ShapeDtypeStruct((), dtype) for dtype in each)))
    except _CannotError:
        return None


def derivative(program: ClosedJaxpr, i: int) -> ClosedJaxpr:
    """The program of the derivative by one of the numbers."""
    function = jaxpr_as_fun(program)

    def along(*x: Any) -> Any:
        return jax.jvp(lambda x_i: function(*x[:i], x_i, *x[i + 1 :])[0], (x[i],), (jnp.ones_like(x[i]),))[1]

    return _needed(jax.make_jaxpr(along)(*(jax.ShapeDtypeStruct((), x.aval.dtype) for x in program.jaxpr.invars)))


def at_lanes(programs: Sequence[ClosedJaxpr], lanes: int, *args: Any) -> list[Array]:
    """What programs of the numbers in these arguments (..., *lanes) find, each (*lanes); what they share, once."""
    rows = [x[at] for x in jax.tree.leaves(args) for at in np.ndindex(x.shape[: x.ndim - lanes])]
    every = jnp.broadcast_shapes(*map(jnp.shape, rows))
    writer, numbers = _Writer(), list(map(_as_entries, rows))
    found = [writer.run(program, numbers)[0][()] for program in programs]
    return [jnp.broadcast_to(x, every) for x in found]


def _needed(program: ClosedJaxpr) -> ClosedJaxpr:
    """The program without what its result does not need."""
    needed, kept = set(map(id, program.jaxpr.outvars)), []
    for equation in reversed(program.jaxpr.eqns):
        if any(id(x) in needed for x in equation.outvars):
            needed |= set(map(id, equation.invars))
            kept.append(equation)
    return program.replace(jaxpr=program.jaxpr.replace(eqns=kept[::-1]))


def _array(numbers: Sequence[Any], shape: tuple[int, ...]) -> Entries:
    entries = np.empty(len(numbers), object)
    for i, x in enumerate(numbers):  # NumPy would take rows of lanes apart
        entries[i] = x
    return entries.reshape(shape)


def _entries(x: Any) -> Entries:
    """The entries of a known array."""
    return _array([x[at] for at in np.ndindex(np.shape(x))], np.shape(x))


def _as_entries(x: Any) -> Entries:
    """An array of entries, also where it is one entry that NumPy took out of its array."""
    return x if isinstance(x, np.ndarray) and x.dtype == object else _array([x], ())


class _Writer:
    """Writes programs of JAX out, the same operation on the same numbers once; at most so many operations."""

    def __init__(self, most: float = math.inf) -> None:
        self.known: dict[Any, tuple[Any, list[Any]]] = {}
        self.literals: dict[Any, Entries] = {}
        self.left = most

    def run(self, program: ClosedJaxpr, args: Sequence[Entries]) -> list[Entries]:
        """The results of a program."""
        values = dict(zip(program.jaxpr.invars, args, strict=True))
        values |= zip(program.jaxpr.constvars, map(_entries, program.consts), strict=True)

        def read(x: Any) -> Entries:
            return self._literal(x) if hasattr(x, "val") else values[x]

        for equation in program.jaxpr.eqns:
            values |= zip(equation.outvars, self._results(equation, [read(x) for x in equation.invars]), strict=True)
        return [read(x) for x in program.jaxpr.outvars]

    def _literal(self, x: Any) -> Entries:
        """A number in a program; the same one for equal ones."""
        value = np.asarray(x.val, x.aval.dtype)
        return self.literals.setdefault((value.dtype, value.shape, value.tobytes()), _entries(value))

    def _results(self, equation: Any, args: list[Entries]) -> list[Entries]:
        name, params = equation.primitive.name, equation.params
        if name in ("jit", "pjit"):
            return self.run(params["jaxpr"], args)
        if name in _OF_EACH_ENTRY:
            return [self._of_each_entry(equation, args)]
        if name == "dot_general" and not params["dimension_numbers"][1][0]:
            return [self._products(args, *params["dimension_numbers"][0])]
        if name in _REDUCTIONS:
            self._count(args[0].size)
            return [_as_entries(_REDUCTIONS[name](args[0], axis=tuple(params["axes"])))]
        if name == "unstack":
            return list(map(_as_entries, np.moveaxis(args[0], params["axis"], 0)))
        if name in _MOVES:
            return [_MOVES[name](args, params)]
        raise _CannotError(name)

    def _of_each_entry(self, equation: Any, args: list[Entries]) -> Entries:
        params, args = equation.params, list(np.broadcast_arrays(*args))
        operation = equation.primitive, repr(params)

        def entry(numbers: list[Any]) -> Any:
            key = *operation, *map(id, numbers)
            if key not in self.known:
                self._count(1)
                # With the numbers, whose identity would else be given to others.
                self.known[key] = equation.primitive.bind(*self._alike(equation, numbers), **params), numbers
            return self.known[key][0]

        shape = args[0].shape
        return _array([entry([x[at] for x in args]) for at in np.ndindex(shape)], shape)

    def _alike(self, equation: Any, numbers: list[Any]) -> list[Any]:
        """The numbers of an operation, as rows of the same lanes."""
        shape = jnp.broadcast_shapes(*map(np.shape, numbers))
        types = [x.aval.dtype for x in equation.invars]
        return [
            x if np.shape(x) == shape and isinstance(x, Array) else jnp.broadcast_to(jnp.asarray(x, dtype), shape)
            for x, dtype in zip(numbers, types, strict=True)
        ]

    def _products(self, args: list[Entries], of_a: Sequence[int], of_b: Sequence[int]) -> Entries:
        a, b = args
        self._count(2 * a.size * b.size // math.prod(a.shape[i] for i in of_a))
        return _as_entries(np.tensordot(a, b, (of_a, of_b)))

    def _count(self, operations: int) -> None:
        self.left -= operations
        if self.left < 0:
            raise _CannotError("too many operations")


def _broadcast(args: list[Entries], params: Any) -> Entries:
    shape = np.ones(len(params["shape"]), int)
    shape[list(params["broadcast_dimensions"])] = args[0].shape
    return np.broadcast_to(args[0].reshape(shape), params["shape"])


def _counted(args: list[Entries], params: Any) -> Entries:
    shape, axis = params["shape"], params["dimension"]
    along = np.arange(shape[axis], dtype=params["dtype"]).reshape(-1, *(1,) * (len(shape) - axis - 1))
    return _entries(np.broadcast_to(along, shape))


def _slice(args: list[Entries], params: Any) -> Entries:
    steps = params["strides"] or (1,) * args[0].ndim
    return args[0][tuple(map(slice, params["start_indices"], params["limit_indices"], steps))]


_REDUCTIONS: dict[str, Any] = {"reduce_prod": np.prod, "reduce_sum": np.sum}

_MOVES: dict[str, Callable[[list[Entries], Any], Entries]] = {
    "broadcast_in_dim": _broadcast,
    "concatenate": lambda args, params: np.concatenate(args, params["dimension"]),
    "iota": _counted,
    "reshape": lambda args, params: args[0].reshape(params["new_sizes"]),
    "rev": lambda args, params: np.flip(args[0], params["dimensions"]),
    "slice": _slice,
    "squeeze": lambda args, params: np.squeeze(args[0], params["dimensions"]),
    "stack": lambda args, params: np.stack(args, params["axis"]),
    "transpose": lambda args, params: np.transpose(args[0], params["permutation"]),
}
