"""One path, or those of a batch: a few at a time, each in a lane of its own, and a lane that is free takes the next.

Under `vmap` a loop goes on until it has ended for all: nested loops would wait, at every load step, for the path with
the most iterations, and at the end for the one with the most steps. Here lanes wait for each other only until enough of
them have come to the same point.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxmyo import control, newton
from jaxmyo.leaves import pick, put, true

#: The most paths at a time, the fewest, and the Gauss points of all of them: as many as stay in the cache.
MOST, FEWEST, POINTS = 128, 16, 2048

#: One in so many lanes may still search its equilibrium while the others wait for their next load step; when one in so
#: many has come to its end, results are stored and new paths begin.
SEARCHING, ENDED = 2, 4

#: The steps of a path: `continuation.Walk`.
Walk = Any


class _Lanes(NamedTuple):
    """Paths on their way: of each the last state, the step, Newton's iterate, and whether to aim at the next step."""

    path: Any
    step: Any
    found: newton.Iterate
    arrived: Array


class _Queue(NamedTuple):
    """task: (lanes,) which one is in each lane, `size` for none; own: of the tasks there, what they do not share.

    begun: how many tasks; results: (size + lanes, …) task and end, in the order in which they ended; ended: how many.
    """

    lanes: _Lanes
    task: Array
    own: list[Array]
    begun: Array
    results: Array
    ended: Array


def alone(walk: Walk) -> Any:
    """The end of one path."""

    def step(path: Any) -> Any:
        step = walk.aim(path)
        found = newton.solve(walk.lin, step.guess, walk.inputs(step), step.target, walk.settings)
        return walk.arrive(path, step, found)

    path = newton.batched_as(walk.valid, walk.begin())
    return walk.end(control.loop(walk.goes_on, step, path))


def followed(walk: Callable[..., Walk], *task: Any) -> Any:
    """The end of the path of a task, inside JAX; of those of all tasks under `vmap`."""
    # A rule of `vmap` runs later, when the arithmetic of a path in float32 may have ended.
    wide = jnp.result_type(float) == "float64"
    leaves, structure = jax.tree.flatten(jax.tree.map(jnp.asarray, task))
    lanes = min(MOST, max(FEWEST, POINTS // walk(*task).lin.system.weight.size))

    def walk_of(leaves: Sequence[Array]) -> Walk:
        return walk(*jax.tree.unflatten(structure, leaves))

    @jax.custom_batching.custom_vmap
    def one(*leaves: Array) -> Any:
        return alone(walk_of(leaves))

    @one.def_vmap
    def many(size: int, is_batched: Sequence[bool], *leaves: Array) -> tuple[Any, Any]:
        with jax.enable_x64(wide):
            ends = _batch(walk_of, lanes, size, is_batched)(*leaves)
        return ends, jax.tree.map(lambda x: True, ends)

    return one(*leaves)


def _batch(
    walk_of: Callable[[Sequence[Array]], Walk], lanes: int, size: int, is_own: Sequence[bool]
) -> Callable[..., Any]:
    """A function of the leaves of tasks, each (size, ...) where a task has its own: the ends (size, ...) of all."""

    @jax.custom_batching.custom_vmap
    def run(*leaves: Array) -> Any:
        return _Batch(walk_of, leaves, is_own, size, min(lanes, size)).ends()

    @run.def_vmap
    def of_batches(outer: int, is_batched: Sequence[bool], *leaves: Array) -> tuple[Any, Any]:
        def flat(x: Array, own: bool, batched: bool) -> Array:
            if not own and not batched:
                return x
            x = x if batched else x[None]
            x = x if own else x[:, None]
            return jnp.broadcast_to(x, (outer, size, *x.shape[2:])).reshape(outer * size, *x.shape[2:])

        is_any = [own or batched for own, batched in zip(is_own, is_batched, strict=True)]
        ends = _batch(walk_of, lanes, outer * size, is_any)(*map(flat, leaves, is_own, is_batched))
        ends = jax.tree.map(lambda x: x.reshape(outer, size, *x.shape[1:]), ends)
        return ends, jax.tree.map(lambda x: True, ends)

    return run


@dataclass(frozen=True)
class _Batch:
    """Tasks and lanes; leaves: of the tasks, (size, ...) those that each has of its own."""

    walk_of: Callable[[Sequence[Array]], Walk]
    leaves: Sequence[Array]
    is_own: Sequence[bool]
    size: int
    lanes: int

    def ends(self) -> Any:
        """The ends (size, ...) of all paths."""
        tasks = jnp.arange(self.lanes)
        own = self._own(tasks)
        start = self._start(own)
        if self.size == self.lanes:
            return self._at_lanes(_end, own, self._walked(own, start, jnp.all).path)
        like = jax.eval_shape(lambda path: (tasks, self._at_lanes(_end, own, path)), start.path)
        width = sum(math.prod(x.shape[1:]) for x in jax.tree.leaves(like))
        none = jnp.array(0)
        first = _Queue(start, tasks, own, none + self.lanes, jnp.zeros((self.size + self.lanes, width)), none)
        results = jax.lax.while_loop(lambda q: q.ended < self.size, self._served, first).results[: self.size]
        return _unpacked(results[jnp.argsort(results[:, 0])], like)[1]

    def _own(self, tasks: Array) -> list[Array]:
        """Of some tasks, what they do not share."""
        return [x[tasks] for x in pick(self.leaves, true(self.is_own))]

    def _at_lanes(self, function: Callable[..., Any], own: list[Array], *states: Any) -> Any:
        """function(walk, *states) in every lane."""

        def one(own: list[Array], *states: Any) -> Any:
            return function(self.walk_of(put(self.leaves, true(self.is_own), own)), *states)

        return jax.vmap(one)(own, *states)

    def _start(self, own: list[Array]) -> _Lanes:
        path = self._at_lanes(_begin, own)
        shapes = jax.eval_shape(lambda path: self._at_lanes(_aimed_first, own, path), path)
        step, found = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)  # until it is aimed at
        return _Lanes(path, step, found, jnp.ones(self.lanes, bool))

    def _walked(self, own: list[Array], lanes: _Lanes, enough: Callable[[Array], Array]) -> _Lanes:
        """Until enough paths do not go on."""

        def next_step(lanes: _Lanes) -> _Lanes:
            going = self._at_lanes(_goes_on, own, lanes.path)
            aimed = self._at_lanes(_aimed_again, own, lanes.path, lanes.found)
            step, found = _where(lanes.arrived, aimed, (lanes.step, lanes.found))

            def look(at: tuple[newton.Iterate, Array]) -> tuple[newton.Iterate, Array]:
                found, searching = at
                found = _where(searching, self._at_lanes(_look, own, step, found), found)
                return found, searching & self._at_lanes(_searches, own, step, found)

            few = jnp.sum(going) // SEARCHING
            searching = going & self._at_lanes(_searches, own, step, found)
            found, searching = jax.lax.while_loop(lambda at: jnp.sum(at[1]) > few, look, (found, searching))
            arrived = going & ~searching
            path = _where(arrived, self._at_lanes(_arrive, own, lanes.path, step, found), lanes.path)
            return _Lanes(path, step, found, arrived)

        def goes_on(lanes: _Lanes) -> Array:
            return ~enough(~self._at_lanes(_goes_on, own, lanes.path))

        return jax.lax.while_loop(goes_on, next_step, lanes)

    def _served(self, q: _Queue) -> _Queue:
        """Paths that have ended give their results, and their lanes take new tasks."""
        filled = q.task < self.size

        def enough(ended: Array) -> Array:
            waiting = jnp.sum(filled & ended)
            return waiting >= jnp.where(q.begun < self.size, self.lanes // ENDED, jnp.sum(filled))

        lanes = self._walked(q.own, q.lanes, enough)
        ended = filled & ~self._at_lanes(_goes_on, q.own, lanes.path)
        # In front those that have ended; what is written behind them is written over later.
        results = _packed((q.task, self._at_lanes(_end, q.own, lanes.path)))[jnp.argsort(~ended)]
        task = q.begun + jnp.cumsum(ended) - 1
        takes = ended & (task < self.size)
        own = _where(takes, self._own(jnp.minimum(task, self.size - 1)), q.own)
        path = _where(takes, self._at_lanes(_begin, own), lanes.path)
        return _Queue(
            lanes=lanes._replace(path=path, arrived=lanes.arrived | takes),
            task=jnp.where(takes, task, jnp.where(ended, self.size, q.task)),
            own=own,
            begun=q.begun + jnp.sum(takes),
            results=jax.lax.dynamic_update_slice_in_dim(q.results, results, q.ended, 0),
            ended=q.ended + jnp.sum(ended),
        )


def _begin(walk: Walk) -> Any:
    return walk.begin()


def _goes_on(walk: Walk, path: Any) -> Array:
    going: Array = walk.goes_on(path)
    return going


def _end(walk: Walk, path: Any) -> Any:
    return walk.end(path)


def _aimed_first(walk: Walk, path: Any) -> tuple[Any, newton.Iterate]:
    return _aimed(walk, path, walk.lin.nothing())


def _aimed_again(walk: Walk, path: Any, last: newton.Iterate) -> tuple[Any, newton.Iterate]:
    return _aimed(walk, path, (last.at.K, last.factors))


def _aimed(walk: Walk, path: Any, nothing: tuple[Any, Any]) -> tuple[Any, newton.Iterate]:
    """The next step, and Newton's method before its first look, with any tangent and factors."""
    step = walk.aim(path)
    return step, newton.begin(walk.lin, step.guess, nothing, walk.settings)


def _look(walk: Walk, step: Any, found: newton.Iterate) -> newton.Iterate:
    return newton.look(walk.lin, found, walk.inputs(step), step.target, walk.settings)


def _searches(walk: Walk, step: Any, found: newton.Iterate) -> Array:
    return newton.goes_on(found, step.target, walk.settings)


def _arrive(walk: Walk, path: Any, step: Any, found: newton.Iterate) -> Any:
    return walk.arrive(path, step, newton.ended(walk.lin, found, step.target))


def _packed(tree: Any) -> Array:
    """The leaves (n, ...) as one array (n, ...) of floats: one copy instead of many."""
    return jnp.concatenate([x.reshape(len(x), -1).astype(float) for x in jax.tree.leaves(tree)], axis=1)


def _unpacked(packed: Array, like: Any) -> Any:
    leaves, structure = jax.tree.flatten(like)
    ends = np.cumsum([math.prod(x.shape[1:]) for x in leaves])[:-1]
    parts = jnp.split(packed, ends, axis=1)
    return jax.tree.unflatten(
        structure, [x.astype(own.dtype).reshape(-1, *own.shape[1:]) for x, own in zip(parts, leaves, strict=True)]
    )


def _where(lanes: Array, new: Any, old: Any) -> Any:
    def of_leaf(a: Array, b: Array) -> Array:
        return jnp.where(lanes.reshape(-1, *(1,) * (a.ndim - 1)), a, b)

    return jax.tree.map(of_leaf, new, old)
