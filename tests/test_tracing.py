"""What is known while Python runs is worked on without JAX, whose operations are each compiled."""

import logging
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo import tracing


@pytest.fixture
def compiled() -> Iterator[list[str]]:
    """The names of the programs that are compiled in a test."""
    names: list[str] = []

    class Names(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.getMessage().startswith("Compiling "):
                names.append(record.getMessage().split()[1])

    logger, handler = logging.getLogger("jax"), Names()
    logger.addHandler(handler)
    with jax.log_compiles():
        yield names
    logger.removeHandler(handler)


def test_a_solve_compiles_nothing_beside_the_programs_of_a_solve(compiled: list[str]) -> None:
    def law(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
        return 0.5 * constants["mu"] * (jnp.trace(C) - 3.0)

    supports = tuple(jm.Symmetry(axis) for axis in "xyz")
    scene = jm.Scene(jm.box((1.0, 1.1, 1.2), (1, 1, 2)), law, {"mu": 2.0}, supports=supports)
    A = jm.contract(scene, T0=2.0, a_over_D=None)
    C = jm.load(A, jm.Displacement("x1", "x", 0.1), jm.Pressure("y1", 0.5), jm.Spring("z1", 0.3))
    assert bool(C.converged)
    own = {"_path", "_pressures_at_rest", "basis", "_cartesian", "g", "law", "normals"}
    assert "jit(_path)" in compiled
    assert {name.removeprefix("jit(").removesuffix(")") for name in compiled} <= own


def test_values_that_are_known_stay_in_numpy() -> None:
    assert isinstance(tracing.known(jnp.ones(2)), np.ndarray)
    assert tracing.numpy_for(1.0, jnp.ones(2)) is np
    assert tracing.every(True, np.True_, jnp.array(True)) is np.True_

    def look(x: jax.Array) -> jax.Array:
        assert tracing.known(x) is x
        assert tracing.numpy_for(np.ones(2), x) is jnp
        return jnp.where(tracing.every(True, x > 0.0), tracing.floats(x), tracing.zeros())

    assert float(jax.jit(look)(3.0)) == 3.0
    assert float(jax.jit(look)(-3.0)) == 0.0


def test_whether_a_value_is_staged() -> None:
    seen: list[tuple[bool, bool]] = []

    def look(x: jax.Array) -> jax.Array:
        seen.append((tracing.is_traced(x), tracing.is_staged(x)))
        return x

    look(jnp.ones(()))
    jax.grad(look)(1.0)
    jax.jit(look)(1.0)
    jax.vmap(look)(jnp.ones(2))
    assert seen == [(False, False), (True, False), (True, True), (True, True)]
