"""Settings of JAX's compiler: its defaults take long for programs as large as those of a solve, and gain little."""

from collections.abc import Callable
from functools import partial, wraps
from typing import Any, TypeVar, cast

import jax

from jaxmyo import tracing

F = TypeVar("F", bound=Callable[..., Any])

#: For programs that run for milliseconds: half the time of compilation. Solves of a few unknowns are as fast, those of
#: a mesh take two to three times as long.
QUICK: dict[str, str | bool] = {"xla_backend_optimization_level": "0", "xla_cpu_use_fusion_emitters": False}

#: For programs that run for seconds: batches of thousands of states run four times as fast, the default no faster.
LONG: dict[str, str | bool] = QUICK | {"xla_backend_optimization_level": "1"}

#: For the arithmetic of elements, and a solve of a small body: two thirds of the time of compilation by default, and it
#: runs as fast. (For float32 in curved coordinates, XLA's emitters of fusions take minutes.)
LEAN: dict[str, str | bool] = {"xla_cpu_use_fusion_emitters": False}


def lean(function: F, *static: str) -> F:
    """The function as a program, `LEAN` unless it is part of another one, which alone has a say in how it is compiled.

    static: the names of arguments that shape the program.
    """
    program, part = (
        partial(jax.jit, static_argnames=static, compiler_options=options)(function) for options in (LEAN, None)
    )

    @wraps(function)
    def run(*args: Any, **kwargs: Any) -> Any:
        return (part if tracing.is_traced((args, kwargs)) else program)(*args, **kwargs)

    return cast(F, run)
