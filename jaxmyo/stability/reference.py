"""The branch of equilibria that a body moves along as its load grows, followed by small steps of the hand-made equations.

The inputs move on a straight line from those of a known state to the wanted ones, s = t³ of the way, since soft tissue
moves like a root of the load near rest. A step extrapolates the last one, corrects by Newton's method, and is taken if
that moved the body by no more than `NEAR`; else a smaller one is tried. So the branch can only be left where another
one comes closer than that. Where no step is small enough the branch ends, which is what a limit point does to a path in
the load; or exp Q leaves the range of float64.
"""

from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxmyo.stability.independent import Array, Body, Muscle, relative_residual, residual_and_tangent

#: The largest strain that a correction, and that a step, may make [–].
NEAR, STEP = 0.02, 0.05
#: The smallest step in t.
LEAST = 1e-6
EXACT = 1e-11


class End(IntEnum):
    """How the branch of a reference ends: at the wanted load, or before it."""

    REACHED = 0
    ENDS = 1
    OVERFLOW = 2


class Branch(NamedTuple):
    """z: (n, N) unknowns of the last equilibrium; reached: (n,) fraction of the load; end: (n,) see `End`."""

    z: Array
    reached: Array
    end: NDArray[np.int64]


class Path(NamedTuple):
    """What a batch of bodies is driven by along its path: at(s, some) of the problems `some` at the fractions s.

    It gives the muscle, the inner pressure, and the prescribed displacements (n, n_fixed) of the unknowns `fixed`.
    """

    at: Callable[[Array, Any], tuple[Muscle, Array, Array]]
    fixed: tuple[int, ...] = ()


def follow(body: Body, z: Array, path: Path) -> Branch:
    """From the equilibria z (n, N) of the path's start to its end."""
    n = len(z)
    z, last = z.copy(), z.copy()
    t, t_last, dt = np.zeros(n), np.full(n, -1.0), np.full(n, 0.01)
    end = np.full(n, End.ENDS)
    while (going := np.flatnonzero((t < 1.0) & (dt >= LEAST))).size:
        ahead = np.minimum(t[going] + dt[going], 1.0)
        part = (ahead - t[going]) / (t[going] - t_last[going])
        guess = z[going] + part[:, None] * (z[going] - last[going])
        few, muscle, pressure, held = body[going], *path.at(ahead**3, going)
        found, good, overflow = _newton(few, muscle, pressure, held, path.fixed, guess, t[going] == 0.0)
        with np.errstate(all="ignore"):  # what was not found may be anything
            off, moved = _strain(few, found - guess), _strain(few, found - z[going])
        first = t[going] == 0.0
        taken = good & (off <= np.where(first, STEP, NEAR)) & (moved <= STEP)
        end[going] = np.where(taken, End.ENDS, np.where(overflow, End.OVERFLOW, End.ENDS))
        yes, no = going[taken], going[~taken]
        last[yes], t_last[yes] = z[yes], t[yes]
        z[yes], t[yes] = found[taken], ahead[taken]
        easy = (off[taken] < 0.2 * NEAR) & (moved[taken] < 0.6 * STEP)
        dt[yes] *= np.where(easy, 1.5, 1.0)
        dt[no] *= 0.5
    end[t >= 1.0] = End.REACHED
    return Branch(z, t**3, end)


def _newton(
    body: Body, muscle: Muscle, pressure: Array, held: Array, fixed: tuple[int, ...], z: Array, first: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Equilibria near z, which of them were found, and where a number was too large for float64."""
    n_u, columns = body.n_u, list(fixed)
    z = z.copy()
    z[:, columns] = held
    free = np.setdiff1d(np.arange(n_u), columns)
    metric = np.einsum("ng,ngia,ngib->nab", body.weight, body.B, body.B, optimize=True)
    volume = np.sum(body.weight, axis=1)
    good, overflow = np.zeros(len(z), bool), np.zeros(len(z), bool)
    for _ in range(40 if first.any() else 12):
        go = np.flatnonzero(~good & ~overflow)
        if not go.size:
            break
        with np.errstate(all="ignore"):
            r, K = residual_and_tangent(body[go], muscle[go], z[go], pressure[go])
            inverted = np.any(body[go].stretches(z[go]) <= 0.0, axis=(1, 2))
            finite = np.isfinite(r).all(axis=1) & np.isfinite(K).all(axis=(1, 2))
        overflow[go[~finite | inverted]] = True
        go, r, K = (x[finite & ~inverted] for x in (go, r, K))
        if not go.size:
            break
        # Rest has no stiffness: the first step is damped by what is out of balance there.
        stress = np.max(np.abs(r[:, free]) / np.sqrt(np.diagonal(metric[go], axis1=1, axis2=2)[:, free]), axis=1)
        largest = np.max(np.abs(np.diagonal(K, axis1=1, axis2=2)), axis=1)
        scale = np.max(np.diagonal(metric[go], axis1=1, axis2=2), axis=1)
        damping = np.where(first[go], 0.1 * stress / np.sqrt(volume[go]), 0.0) + 1e-15 * largest / scale
        K[:, :n_u, :n_u] += damping[:, None, None] * metric[go]
        for a in columns:
            K[:, a, :], K[:, :, a], r[:, a] = 0.0, 0.0, 0.0
            K[:, a, a] = 1.0
        dz = _solve(K, r)
        size = _strain(body[go], dz)
        too_far = ~(size < 0.5)
        overflow[go[~np.isfinite(size)]] = True
        z[go] -= np.where(too_far[:, None], 0.0, dz)
        near = np.flatnonzero(size < 1e-6)
        if near.size:
            at = go[near]
            with np.errstate(all="ignore"):
                exact = relative_residual(body[at], muscle[at], z[at], pressure[at], free) <= EXACT
            good[at] = exact
        if too_far.all():
            break
    return z, good, overflow


def _solve(K: Array, r: Array) -> Array:
    """K⁻¹ r (n, N), not finite where K is singular; scaled, since units of displacements and multipliers differ."""
    scale = 1.0 / np.sqrt(np.maximum(np.max(np.abs(K), axis=2), 1e-300))
    scaled = scale[:, :, None] * K * scale[:, None, :]
    try:
        x = np.linalg.solve(scaled, (scale * r)[..., None])[..., 0]
    except np.linalg.LinAlgError:
        x = np.full_like(r, np.nan)
        for i in range(len(r)):
            try:
                x[i] = np.linalg.solve(scaled[i], scale[i] * r[i])
            except np.linalg.LinAlgError:
                continue
    return np.asarray(scale * x)


def _strain(body: Body, dz: Array) -> Array:
    """The largest change of a stretch (n,)."""
    return np.asarray(np.max(np.abs(np.einsum("ngia,na->ngi", body.B, dz[:, : body.n_u])), axis=(1, 2)))
