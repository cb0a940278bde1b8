"""What makes two functions of JAX the same: a hash of the traced program, whatever its functions are called."""

import hashlib
from enum import Enum
from typing import Any

import jax
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal

#: Digits of a constant that count: the round-off of another machine is no other program.
DIGITS = 40  # binary


def program_hash(program: ClosedJaxpr) -> str:
    """Of the operations, of how they are connected, and of every constant; 64 hexadecimal digits."""
    return _Hasher().closed(program)


def primitives(program: ClosedJaxpr) -> dict[str, int]:
    """The names of all operations, also of programs inside of programs, and the most axes of what each is done with."""
    names: dict[str, int] = {}
    known: dict[int, Jaxpr] = {}

    def look(value: Any) -> None:
        if isinstance(value, ClosedJaxpr):
            value = value.jaxpr
        if isinstance(value, tuple | list):
            for v in value:
                look(v)
        elif isinstance(value, Jaxpr) and id(value) not in known:
            known[id(value)] = value
            for eqn in value.eqns:
                axes = max((x.aval.ndim for x in eqn.invars if hasattr(x.aval, "ndim")), default=0)
                names[eqn.primitive.name] = max(axes, names.get(eqn.primitive.name, 0))
                look(list(eqn.params.values()))

    look(program)
    return names


class _Hasher:
    """Programs inside of programs are hashed once."""

    def __init__(self) -> None:
        self._known: dict[int, str] = {}
        self._alive: list[Any] = []  # so that no two objects have one id

    def closed(self, program: ClosedJaxpr) -> str:
        if id(program) not in self._known:
            self._alive.append(program)
            consts = [_array(np.asarray(c)) for c in program.consts]
            self._known[id(program)] = _hash(self._open(program.jaxpr), *consts)
        return self._known[id(program)]

    def _open(self, program: Jaxpr) -> str:
        names: dict[Any, str] = {}

        def name(v: Any) -> str:
            if isinstance(v, Literal):
                return _array(np.asarray(v.val))
            return names.setdefault(v, f"{len(names)}:{v.aval.str_short()}")

        lines = [" ".join(map(name, [*program.constvars, *program.invars]))]
        for eqn in program.eqns:
            inputs = " ".join(map(name, eqn.invars))
            params = " ".join(f"{key}={self._value(v)}" for key, v in sorted(eqn.params.items()) if key != "name")
            lines.append(f"{eqn.primitive.name} {inputs} {params} {' '.join(map(name, eqn.outvars))}")
        return _hash(*lines, " ".join(map(name, program.outvars)))

    def _value(self, value: Any) -> str:
        if isinstance(value, ClosedJaxpr):
            return self.closed(value)
        if isinstance(value, Jaxpr):
            return self._open(value)
        if isinstance(value, tuple | list):
            return f"({' '.join(map(self._value, value))})"
        if isinstance(value, dict):
            return f"{{{' '.join(f'{k}:{self._value(v)}' for k, v in value.items())}}}"
        if isinstance(value, np.ndarray | np.generic | jax.Array):
            return _array(np.asarray(value))
        if value is None or isinstance(value, bool | int | float | str | np.dtype | Enum):
            return repr(value)
        return type(value).__name__  # a function that JAX made, a place in the source: not what is computed


def _array(x: Any) -> str:
    if x.dtype.kind == "f":
        mantissa, exponent = np.frexp(x)
        kept = np.round(np.ldexp(mantissa, DIGITS)) + 0.0  # no −0
        return _hash(x.dtype.str, str(x.shape), kept.astype("<f8").tobytes(), exponent.astype("<i4").tobytes())
    return _hash(x.dtype.str, str(x.shape), x.tobytes())


def _hash(*parts: str | bytes) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part if isinstance(part, bytes) else part.encode())
        digest.update(b"\n")
    return digest.hexdigest()
