"""The branch of equilibria that a body moves along as its load grows, followed by the hand-made equations.

The inputs move on a straight line from those of a known state, s = 0, to the wanted ones, s = 1, and the equations are
linear in them: r(z, s) = r(z, 0) + s (r(z, 1) − r(z, 0)). A step goes a given strain along the branch and finds z and s
together, so that no load is too steep or too soft for it, and limit points are seen: s has a maximum there. Steps are
small beside what a jump to another branch would be.
"""

from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxmyo.stability.independent import Array, Body, Muscle, relative_residual, residual_and_tangent

#: The strain of the first step, of the longest one, and of the shortest [–]; the load changes by `LOAD` at most.
FIRST, STEP, LEAST = 1e-6, 0.05, 1e-13
LOAD = 0.1
#: A correction is at most this part of its step.
NEAR = 0.2
#: The relative residual of the last state.
EXACT = 1e-11
MOST_STEPS = 3000


class End(IntEnum):
    """How a branch ends: at the wanted load; at a limit point; where float64 does; where a hole closes; or lost."""

    REACHED = 0
    LIMIT_POINT = 1
    OVERFLOW = 2
    CLOSED = 3
    LOST = 4


class Branch(NamedTuple):
    """z: (n, N) unknowns of the last equilibrium; reached: (n,) fraction of the load; end: (n,) see `End`."""

    z: Array
    reached: Array
    end: NDArray[np.int64]


class Drive(NamedTuple):
    """What drives a batch of bodies at one end of its path: the muscle, and the inner pressure (n,) [kPa]."""

    muscle: Muscle
    pressure: Array

    def of(self, some: Any) -> "Drive":
        """Of some of the bodies."""
        return Drive(self.muscle[some], self.pressure[some])


def follow(body: Body, z: Array, begin: Drive, end: Drive, *, past_limits: bool = False) -> Branch:
    """From the equilibria z (n, N) under `begin` as far as the branch goes towards `end`.

    past_limits: go on through limit points, where the load would have to fall, until the branch comes to the end.
    """
    n = len(z)
    y = np.concatenate([z, np.zeros((n, 1))], axis=1)  # (z, s)
    ahead, step = np.zeros_like(y), np.full(n, FIRST)
    how = np.full(n, int(End.LOST))
    with np.errstate(all="ignore"):
        after = y.copy()
        after[:, -1] = 1.0
        last, there = _polished(body, y, after, end)  # the path is no longer than 1e-6, or has no length
        y[there, :-1], y[there, -1], how[there] = last[there], 1.0, End.REACHED
        going = np.flatnonzero(~there)
        ahead[going] = _tangent(body[going], y[going], begin.of(going), end.of(going), None)
        for _ in range(MOST_STEPS):
            going = going[(step[going] > LEAST) & (how[going] == End.LOST)]
            if not going.size:
                break
            step[going] = np.minimum(step[going], LOAD / np.abs(ahead[going, -1]))
            few, at_0, at_1 = body[going], begin.of(going), end.of(going)
            found, good, overflow = _corrected(few, y[going], ahead[going], step[going], at_0, at_1)
            overflow &= step[going] < 1e-9
            how[going[overflow & ~good]] = End.OVERFLOW
            new = np.zeros_like(found)
            new[good] = _tangent(few[good], found[good], at_0.of(good), at_1.of(good), ahead[going[good]])
            turn = _cosine(few, new, ahead[going])
            start = (y[going, -1] == 0.0) & good  # rest may have no stiffness, and its tangent no meaning
            # s may have a pole, where a law with negative moduli would need infinite activation: not to be jumped over.
            ds, expected = found[:, -1] - y[going, -1], step[going] * ahead[going, -1]
            smooth = (turn > 0.95) & (np.abs(ds - expected) <= 0.5 * np.abs(expected) + 0.01 * np.abs(y[going, -1]))
            good &= smooth | (start & (step[going] <= FIRST))
            good &= np.isfinite(new).all(axis=1)
            step[going[~good]] *= 0.5
            yes, found, new = going[good], found[good], new[good]
            passed = found[:, -1] >= 1.0
            back = (new[:, -1] <= 0.0) & ~passed & (not past_limits)
            if passed.any():
                which = yes[passed]
                last, exact = _polished(body[which], y[which], found[passed], end.of(which))
                how[which[exact]] = End.REACHED
                y[which[exact], :-1], y[which[exact], -1] = last[exact], 1.0
                step[which[~exact]] *= 0.5
            how[yes[back]] = End.LIMIT_POINT
            y[yes[~passed]], ahead[yes[~passed]] = found[~passed], new[~passed]
            grow = yes[~passed]
            step[grow] = np.minimum(1.5 * step[grow], STEP)
    closed = (how == End.LOST) & (body.Ri > 0.0) & (body.inner_radius(y) < 1e-3 * body.Ri)
    return Branch(y[:, :-1], y[:, -1], np.where(closed, End.CLOSED, how))


def _system(body: Body, y: Array, begin: Drive, end: Drive) -> tuple[Array, Array, Array]:
    """r (n, N), ∂r/∂z and ∂r/∂s at y = (z, s)."""
    z, s = y[:, :-1], y[:, -1]
    r_0, K_0 = residual_and_tangent(body, begin.muscle, z, begin.pressure)
    r_1, K_1 = residual_and_tangent(body, end.muscle, z, end.pressure)
    by_s = r_1 - r_0
    return r_0 + s[:, None] * by_s, K_0 + s[:, None, None] * (K_1 - K_0), by_s


def _tangent(body: Body, y: Array, begin: Drive, end: Drive, along: Array | None) -> Array:
    """dy of the strain 1 along the branch, with a positive ds, or in the direction `along`."""
    _, K, by_s = _system(body, y, begin, end)
    n_u = body.n_u
    if along is None:
        stiff = np.max(np.abs(K[:, :n_u, :n_u]), axis=(1, 2))  # without the constraints, which have other units
        square = np.einsum("ngi,ngia->na", np.ones((*body.weight.shape, 3)), body.B**2)
        K = K.copy()
        K[:, range(n_u), range(n_u)] += 1e-6 * (stiff / np.max(square, axis=1))[:, None] * square
        dy = np.concatenate([_solve(K, -by_s), np.ones((len(y), 1))], axis=1)
    else:
        row = _row(body, along)
        matrix = np.concatenate(
            [np.concatenate([K, by_s[:, :, None]], axis=2), row[:, None, :]], axis=1
        )  # the branch, a strain of one along the last direction
        right = np.zeros(matrix.shape[:2])
        right[:, -1] = 1.0
        dy = _solve(matrix, right)
    return np.asarray(dy / _strain(body, dy)[:, None])


def _corrected(
    body: Body, y: Array, ahead: Array, step: Array, begin: Drive, end: Drive
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """The points of the branch a strain `step` further, which of them were found, and which numbers overflowed."""
    guess = y + step[:, None] * ahead
    row, at = _row(body, ahead), guess.copy()
    good, bad = np.zeros(len(y), bool), np.zeros(len(y), bool)
    overflow = np.zeros(len(y), bool)
    for _ in range(12):
        go = np.flatnonzero(~good & ~bad)
        if not go.size:
            break
        few = body[go]
        r, K, by_s = _system(few, at[go], begin.of(go), end.of(go))
        matrix = np.concatenate([np.concatenate([K, by_s[:, :, None]], axis=2), row[go, None, :]], axis=1)
        right = np.concatenate([r, np.einsum("na,na->n", row[go], at[go] - guess[go])[:, None]], axis=1)
        closed = (few.Ri > 0.0) & (few.inner_radius(at[go]) <= 0.0)
        inverted = np.any(few.stretches(at[go]) <= 0.0, axis=(1, 2)) | closed
        finite = np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(right).all(axis=1)
        overflow[go[~finite]] = True
        dy = _solve(np.where(finite[:, None, None], matrix, 0.0), np.where(finite[:, None], right, 0.0))
        at[go] -= dy
        size, off = _strain(few, dy), _strain(few, at[go] - guess[go])
        fails = ~finite | inverted | ~(off <= NEAR * step[go])
        bad[go] = fails
        good[go] = ~fails & (size <= 1e-9 * (1.0 + step[go])) & (size <= 1e-3 * step[go])
    return at, good, overflow


def _polished(body: Body, before: Array, after: Array, end: Drive) -> tuple[Array, NDArray[np.bool_]]:
    """The equilibria (n, N) at the wanted load, between a state before it and one after it, and which were found."""
    part: Array = (1.0 - before[:, -1:]) / (after[:, -1:] - before[:, -1:])
    guess = before[:, :-1] + part * (after - before)[:, :-1]
    z, width = guess.copy(), np.maximum(_strain(body, after - before), 1e-6)
    best, least = z.copy(), np.full(len(z), np.inf)
    for _ in range(12):
        error = relative_residual(body, end.muscle, z, end.pressure)
        better = error < least
        best[better], least[better] = z[better], error[better]
        r, K = residual_and_tangent(body, end.muscle, z, end.pressure)
        fine = np.asarray(np.isfinite(r).all(axis=1) & np.isfinite(K).all(axis=(1, 2)))
        z = z - np.where(fine[:, None], _solve(np.where(fine[:, None, None], K, 0.0), r), 0.0)
    return best, (least <= EXACT) & (_strain(body, best - guess) <= width)


def _row(body: Body, along: Array) -> Array:
    """The row (n, N + 1) whose product with dy is its strain along a direction of the strain 1."""
    strain = np.einsum("ngia,na->ngi", body.B, along[:, : body.n_u])
    row = np.zeros_like(along)
    row[:, : body.n_u] = np.einsum("ngi,ngia->na", strain, body.B) / np.sum(strain**2, axis=(1, 2))[:, None]
    return row * np.max(np.abs(strain), axis=(1, 2))[:, None]


def _cosine(body: Body, a: Array, b: Array) -> Array:
    x, y = (np.einsum("ngia,na->ngi", body.B, c[:, : body.n_u]) for c in (a, b))
    return np.asarray(np.sum(x * y, axis=(1, 2)) / np.sqrt(np.sum(x**2, axis=(1, 2)) * np.sum(y**2, axis=(1, 2))))


def _solve(K: Array, r: Array) -> Array:
    """K⁻¹ r (n, N), not finite where K is singular; equilibrated, since the units of its rows differ."""
    rows = 1.0 / np.maximum(np.max(np.abs(K), axis=2), 1e-300)
    scaled = rows[:, :, None] * K
    columns = 1.0 / np.maximum(np.max(np.abs(scaled), axis=1), 1e-300)
    scaled, right = scaled * columns[:, None, :], rows * r
    try:
        x = np.linalg.solve(scaled, right[..., None])[..., 0]
    except np.linalg.LinAlgError:
        x = np.full_like(r, np.nan)
        for i in range(len(r)):
            try:
                x[i] = np.linalg.solve(scaled[i], right[i])
            except np.linalg.LinAlgError:
                continue
    return np.asarray(columns * x)


def _strain(body: Body, dy: Array) -> Array:
    """The largest change of a stretch (n,)."""
    return np.asarray(np.max(np.abs(np.einsum("ngia,na->ngi", body.B, dy[:, : body.n_u])), axis=(1, 2)))
