"""Batches in a queue: every path is what it is alone, wherever it stands, however long the others take."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import sample

import jaxmyo as jm
from jaxmyo import path_queue

#: More than there are lanes, and neither a multiple of them nor of the parts that are stored together.
MANY = 53

FIELDS = ("u", "p", "q", "status", "residual", "steps", "rejected", "iterations", "history", "reached", "stable_until")


@pytest.fixture(autouse=True)
def few_lanes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(path_queue, "MOST", 16)


def contracted(T0: Any, a_over_D: Any, **own: Any) -> jm.State:
    return jm.contract(sample(), T0=T0, a_over_D=a_over_D, throw=False, **own)


def drawn(seed: int) -> tuple[Any, Any]:
    rng = np.random.default_rng(seed)
    return jnp.asarray(rng.uniform(0.0, 60.0, MANY)), jnp.asarray(rng.uniform(0.0, 0.25, MANY))


def assert_same(one: jm.State, of_batch: jm.State) -> None:
    """All that a path found and spent."""
    for name in FIELDS:
        a, b = (np.asarray(getattr(state, name)) for state in (one, of_batch))
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-13, err_msg=name)


def test_a_path_of_a_queue_is_what_it_is_alone() -> None:
    T0, a_over_D = drawn(0)
    batch = jax.vmap(contracted)(T0, a_over_D)
    assert len(set(np.asarray(batch.iterations).tolist())) > 3  # some take longer than others
    for i in range(0, MANY, 4):
        assert_same(contracted(T0[i], a_over_D[i]), batch[i])


def test_paths_that_fail_disturb_no_others() -> None:
    """Out of range at once, or out of steps later: a status in its place, and the others as they are."""
    T0, a_over_D = drawn(1)
    bad = {0: -1.0, 7: np.nan, 20: np.inf, 36: -2.0, MANY - 1: np.nan}
    spoiled = T0.at[jnp.array(list(bad))].set(jnp.array(list(bad.values())))
    found, good = jax.vmap(contracted)(spoiled, a_over_D), jax.vmap(contracted)(T0, a_over_D)
    status = np.asarray(found.status)
    assert (status[list(bad)] == jm.Status.INVALID_INPUT).all()
    others = np.setdiff1d(np.arange(MANY), list(bad))
    assert (status[others] == jm.Status.CONVERGED).all()
    np.testing.assert_array_equal(np.asarray(found.u)[others], np.asarray(good.u)[others])
    assert np.isfinite(np.asarray(found.u)).all()

    few = jax.vmap(lambda T0: contracted(T0, 0.2, settings=jm.Settings(max_steps=2)))(T0)
    stopped = np.asarray(few.status) == jm.Status.TOO_MANY_STEPS
    assert stopped.any()
    assert (np.asarray(few.steps)[stopped] == 2).all()


def test_all_paths_fail() -> None:
    found = jax.vmap(contracted)(jnp.full(MANY, -1.0), jnp.full(MANY, 0.2))
    assert (np.asarray(found.status) == jm.Status.INVALID_INPUT).all()


def test_batches_of_batches_are_one_queue() -> None:
    """Along both axes, along one, and along the other."""
    T0, a_over_D = drawn(2)[0][:6], jnp.linspace(0.0, 0.25, 5)
    grid = jax.vmap(lambda T0: jax.vmap(lambda a: contracted(T0, a))(a_over_D))(T0)
    assert grid.status.shape == (6, 5)
    flat = jax.vmap(contracted)(jnp.repeat(T0, 5), jnp.tile(a_over_D, 6))
    for name in ("u", "q", "iterations"):
        of_grid = np.asarray(getattr(grid, name))
        of_flat = np.asarray(getattr(flat, name))
        np.testing.assert_allclose(of_grid.reshape(of_flat.shape), of_flat, rtol=1e-12, atol=1e-13)
    both = jax.vmap(jax.vmap(contracted))(jnp.broadcast_to(T0[:, None], (6, 5)), jnp.broadcast_to(a_over_D, (6, 5)))
    np.testing.assert_allclose(np.asarray(both.u), np.asarray(grid.u), rtol=1e-12, atol=1e-13)


def test_states_that_follow_each_other_and_their_derivatives() -> None:
    """C from A, in a queue each, by own stretches, and the gradients of all."""
    T0, a_over_D = drawn(3)
    stretch = jnp.linspace(1.05, 1.3, MANY)

    def stress(T0: Any, a_over_D: Any, stretch: Any) -> Any:
        C = jm.load(contracted(T0, a_over_D), jm.Stretch("x", stretch), throw=False)
        return C.mean("cauchy")[0, 0]

    values, slopes = jax.vmap(jax.value_and_grad(stress, argnums=(0, 1, 2)))(T0, a_over_D, stretch)
    for i in (0, 17, MANY - 1):
        value, own = jax.value_and_grad(stress, argnums=(0, 1, 2))(T0[i], a_over_D[i], stretch[i])
        np.testing.assert_allclose(value, values[i], rtol=1e-11)
        np.testing.assert_allclose(np.array(own), np.array([s[i] for s in slopes]), rtol=1e-9)


def test_paths_in_single_precision() -> None:
    """In float32, then in float64, a queue each."""
    T0, a_over_D = drawn(4)
    settings = jm.Settings(precision="mixed")
    found = jax.vmap(lambda T0, a: contracted(T0, a, settings=settings))(T0, a_over_D)
    exact = jax.vmap(contracted)(T0, a_over_D)
    assert found.u.dtype == np.float64
    assert (np.asarray(found.status) == jm.Status.CONVERGED).all()
    np.testing.assert_allclose(np.asarray(found.stretches), np.asarray(exact.stretches), rtol=1e-10)


def test_own_nodes_and_constants() -> None:
    """What else a path of a batch may have of its own: nodes, and constants of the law."""
    scene = sample()
    scale = jnp.linspace(0.5, 2.0, MANY)

    def contracted(scale: Any) -> jm.State:
        points = jnp.asarray(scene.mesh.points) * jnp.stack([scale, jnp.ones(()), jnp.ones(())])[None]
        constants = {**vars(scene.constants), "C1p": scene.constants.C1p * scale}
        return jm.contract(
            scene, T0=30.0, a_over_D=0.2, points=points, constants=type(scene.constants)(**constants), throw=False
        )

    batch = jax.vmap(contracted)(scale)
    for i in (0, 20, MANY - 1):
        assert_same(contracted(scale[i]), batch[i])
