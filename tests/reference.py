"""Hand-derived reference solution of the homogeneous thin sample (independent of the package: numpy and scipy only).

Directions: 1 = fibre, 2 = cross-fibre, 3 = normal. The deformation is ``F = diag(l1, l2, l3)`` with ``l1 l2 l3 = 1``.
Stresses, tensions and energy densities are in kPa, stretches are dimensionless. ``a``, ``b`` and ``-a - b`` below are
the logarithms of the three stretches (not to be mistaken for the length ``a`` of ``a_over_D``).

With ``x = I1 - 3`` and ``y = I4 - 1`` the energy density is ``Wp(x, y) + beta Wa(x, y) + beta T0 ln(I4) / 2``,

    Wp = C1p (exp Q - 1),   Q = C2p x^2 + C3p x y + C4p y^2,
    Wa = C1a x y + C2a x^2 + C3a y^2 + C4a x,

less ``p (I3 - 1) / 2`` for incompressibility. State A adds ``-q h / 2`` with the pseudo-active constraint

    h = 1 - I6^(1/2) + (pi - 2) (1 - I4^(-1/4)) a/D;

state C drops it and keeps its tensions, ``T_f = -q h4 I4`` and ``T_cf = -q h6 I6`` with ``hi = dh/dIi``.
The principal Cauchy stresses are ``sigma_i = d(density) / d(ln l_i)``:

    sigma_1 = 2 W1 l1^2 + 2 W4 l1^2 + beta T0 + T_f - p,
    sigma_2 = 2 W1 l2^2 + T_cf - p,
    sigma_3 = 2 W1 l3^2 - p,          W1 = dW/dI1,  W4 = dW/dI4.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

Array = NDArray[np.float64]
Constants = Mapping[str, float]
#: a float or an array of them
Number = Any

SETS: dict[str, dict[str, float]] = {
    "printed": {
        "C1p": 0.292, "C2p": 0.321, "C3p": -0.260, "C4p": 0.201,
        "C1a": -3.870, "C2a": 4.830, "C3a": 2.512, "C4a": 0.951,
    },
    "table1": {
        "C1p": 0.0292, "C2p": 3.21, "C3p": -2.60, "C4p": 2.01,
        "C1a": -3.870, "C2a": 4.083, "C3a": 2.512, "C4a": 0.951,
    },
    "measured": {
        "C1p": 0.292, "C2p": 3.21, "C3p": -2.60, "C4p": 2.01,
        "C1a": -3.870, "C2a": 4.083, "C3a": 2.512, "C4a": 0.951,
    },
}  # fmt: skip
"""Material constants: C1p and C1a..C4a in kPa, C2p, C3p and C4p dimensionless."""

PRINTED_TABLE: tuple[tuple[float | None, float, float, float], ...] = (
    (0.10, 5.0, 50.92, 5.94),
    (0.10, 15.0, 53.73, 11.44),
    (0.10, 25.0, 57.65, 17.78),
    (0.10, 35.0, 60.25, 24.32),
    (0.10, 45.0, 61.90, 30.88),
    (0.15, 5.0, 51.44, 5.97),
    (0.15, 15.0, 54.56, 11.48),
    (0.15, 25.0, 58.60, 17.80),
    (0.15, 35.0, 61.30, 24.31),
    (0.15, 45.0, 63.01, 30.84),
    (0.20, 5.0, 51.94, 6.00),
    (0.20, 15.0, 55.33, 11.51),
    (0.20, 25.0, 59.47, 17.79),
    (0.20, 35.0, 62.25, 24.25),
    (0.20, 45.0, 64.04, 30.73),
    (None, 5.0, 36.78, 4.32),
    (None, 15.0, 19.88, 4.32),
    (None, 25.0, 13.62, 4.32),
    (None, 35.0, 10.36, 4.32),
    (None, 45.0, 8.36, 4.32),
)
"""Table 1 as printed: (a/D or None, T0 in kPa, 100 sigma22/sigma11 in %, sigma22 in kPa); equibiaxial 1.2, beta = 1."""

PI_2 = np.pi - 2.0


class BranchEnds(RuntimeError):
    """The branch of solutions folds back before it reaches the wanted state."""


class NoConvergence(RuntimeError):
    """The branch could not be followed numerically to the wanted state."""


# ---------------------------------------------------------------------------------------------- energy, by hand


class Derivatives(NamedTuple):
    """First and second derivatives of a density with respect to I1 and I4, in kPa."""

    w1: Number
    w4: Number
    w11: Number
    w14: Number
    w44: Number

    def plus(self, factor: Number, other: Derivatives) -> Derivatives:
        """``self + factor * other``, term by term."""
        return Derivatives(*(s + factor * o for s, o in zip(self, other, strict=True)))


def passive_energy(c: Constants, x: Number, y: Number) -> Number:
    """``C1p (exp Q - 1)`` in kPa at ``x = I1 - 3``, ``y = I4 - 1``."""
    return c["C1p"] * np.expm1(c["C2p"] * x * x + c["C3p"] * x * y + c["C4p"] * y * y)


def active_energy(c: Constants, x: Number, y: Number) -> Number:
    """``C1a x y + C2a x^2 + C3a y^2 + C4a x`` in kPa at ``x = I1 - 3``, ``y = I4 - 1``."""
    return c["C1a"] * x * y + c["C2a"] * x * x + c["C3a"] * y * y + c["C4a"] * x


def passive_derivatives(c: Constants, x: Number, y: Number) -> Derivatives:
    """Derivatives (kPa) of the passive energy: ``Wi = C1p e^Q Qi`` and ``Wij = C1p e^Q (Qi Qj + Qij)``."""
    c2, c3, c4 = c["C2p"], c["C3p"], c["C4p"]
    e = c["C1p"] * np.exp(c2 * x * x + c3 * x * y + c4 * y * y)
    q1 = 2.0 * c2 * x + c3 * y
    q4 = c3 * x + 2.0 * c4 * y
    return Derivatives(e * q1, e * q4, e * (q1 * q1 + 2.0 * c2), e * (q1 * q4 + c3), e * (q4 * q4 + 2.0 * c4))


def active_derivatives(c: Constants, x: Number, y: Number) -> Derivatives:
    """Derivatives (kPa) of the active energy at beta = 1: ``W1 = C1a y + 2 C2a x + C4a``, ``W4 = C1a x + 2 C3a y``."""
    c1, c2, c3, c4 = c["C1a"], c["C2a"], c["C3a"], c["C4a"]
    return Derivatives(c1 * y + 2.0 * c2 * x + c4, c1 * x + 2.0 * c3 * y, 2.0 * c2, c1, 2.0 * c3)


def strains(a: Number, b: Number) -> tuple[Number, Number]:
    """``(I1 - 3, I4 - 1)`` at the log stretches ``(a, b, -a - b)``, free of cancellation against 3 and 1."""
    y = np.expm1(2.0 * a)
    return y + np.expm1(2.0 * b) + np.expm1(-2.0 * (a + b)), y


def law(c: Constants, beta: Number, a: Number, b: Number) -> Derivatives:
    """Derivatives (kPa) of ``Wp + beta Wa`` at the log stretches ``(a, b, -a - b)``."""
    x, y = strains(a, b)
    return passive_derivatives(c, x, y).plus(beta, active_derivatives(c, x, y))


def forces(w: Derivatives, a: Number, b: Number) -> tuple[Number, Number]:
    """Derivatives ``(S1, S2)`` of the energy by ``a`` and ``b`` (kPa): the in-plane Cauchy stresses at sigma33 = 0.

    ``S1 = 2 W1 (l1^2 - l3^2) + 2 W4 l1^2`` and ``S2 = 2 W1 (l2^2 - l3^2)``, without any tension.
    """
    d1 = np.expm1(2.0 * a) - np.expm1(-2.0 * (a + b))
    d2 = np.expm1(2.0 * b) - np.expm1(-2.0 * (a + b))
    return 2.0 * w.w1 * d1 + 2.0 * w.w4 * np.exp(2.0 * a), 2.0 * w.w1 * d2


def stiffness(w: Derivatives, a: Number, b: Number) -> tuple[Number, Number, Number]:
    """Second derivatives ``(K11, K12, K22)`` of the energy by the log stretches ``a`` and ``b`` (kPa).

    With ``A = I1,a = 2 (l1^2 - l3^2)``, ``B = I1,b = 2 (l2^2 - l3^2)`` and ``f = I4,a = 2 l1^2``:
    ``K11 = W11 A^2 + 2 W14 A f + W44 f^2 + 4 W1 (l1^2 + l3^2) + 4 W4 l1^2``,
    ``K12 = W11 A B + W14 f B + 4 W1 l3^2`` and ``K22 = W11 B^2 + 4 W1 (l2^2 + l3^2)``.
    """
    s1, s2, s3 = np.exp(2.0 * a), np.exp(2.0 * b), np.exp(-2.0 * (a + b))
    da, db, f = 2.0 * (s1 - s3), 2.0 * (s2 - s3), 2.0 * s1
    k11 = w.w11 * da * da + 2.0 * w.w14 * da * f + w.w44 * f * f + 4.0 * w.w1 * (s1 + s3) + 4.0 * w.w4 * s1
    k12 = w.w11 * da * db + w.w14 * f * db + 4.0 * w.w1 * s3
    k22 = w.w11 * db * db + 4.0 * w.w1 * (s2 + s3)
    return k11, k12, k22


def constraint(l1: Number, l2: Number, a_over_D: float) -> Number:
    """``h = 1 - l2 + (pi - 2) (1 - l1^(-1/2)) a/D``, dimensionless."""
    return 1.0 - l2 + PI_2 * a_over_D * (1.0 - l1**-0.5)


# ----------------------------------------------------------------------------------- state A: free contraction


@dataclass(frozen=True)
class FreeContraction:
    """State A: principal stretches, and p, q and the pseudo-active tensions in kPa (q = T_f = T_cf = 0 without h)."""

    stretches: Array
    p: float
    q: float
    T_f: float
    T_cf: float


def _manifold(a: Number, a_over_D: float | None) -> tuple[Number, Number, Number]:
    """``b``, ``db/da`` and ``d2b/da2`` along ``h = 0`` (or along ``l2 = l3`` when there is no constraint).

    ``l2 = 1 + k (1 - l1^(-1/2))`` with ``k = (pi - 2) a/D`` gives ``m = b' = (k/2) l1^(-1/2) / l2`` and
    ``b'' = -m (m + 1/2)``; ``l2 = l3`` is ``b = -a/2``.
    """
    if a_over_D is None:
        return -0.5 * a, -0.5 + 0.0 * a, 0.0 * a
    k = PI_2 * a_over_D
    stretch = 1.0 - k * np.expm1(-0.5 * a)
    m = 0.5 * k * np.exp(-0.5 * a) / stretch
    return np.log(stretch), m, -m * (m + 0.5)


def _reduced(c: Constants, a: Number, a_over_D: float | None) -> tuple[Number, Number, Number, Number]:
    """Passive and active (beta = 1) ``dW/da`` along the manifold, then their derivatives by ``a`` (kPa).

    With p and q eliminated, state A is ``R = Rp + beta (Ra + T0) = 0``, where each part is ``S1 + b' S2``
    and has the derivative ``K11 + 2 b' K12 + b'^2 K22 + b'' S2``. R is linear in beta.
    """
    b, m, dm = _manifold(a, a_over_D)
    x, y = strains(a, b)
    values, slopes = [], []
    for w in (passive_derivatives(c, x, y), active_derivatives(c, x, y)):
        s1, s2 = forces(w, a, b)
        k11, k12, k22 = stiffness(w, a, b)
        values.append(s1 + m * s2)
        slopes.append(k11 + 2.0 * m * k12 + m * m * k22 + dm * s2)
    return values[0], values[1], slopes[0], slopes[1]


def _contraction_grid(first: float, a_over_D: float | None) -> Array:
    """Log stretches ``a`` from 0 downwards: steps grow by 2 % from ``first / 1000`` to 5e-4, down to l1 = 0.05."""
    deepest = 3.0 if a_over_D is None else min(3.0, 1.99 * np.log1p(1.0 / max(PI_2 * a_over_D, 1e-9)))
    nodes = [0.0]
    step = min(1e-3 * first, 5e-4)
    while step < 5e-4:
        nodes.append(nodes[-1] + step)
        step *= 1.02
    return -np.concatenate([nodes, np.arange(nodes[-1] + 5e-4, deepest, 5e-4)])


def free_contraction(c: Constants, T0: float, a_over_D: float | None, beta: float) -> FreeContraction:
    """State A (no load) on the branch that leaves rest at beta = 0; ``T0`` in kPa, ``a_over_D=None``: no constraint.

    The branch is explicit, ``beta(a) = -Rp / (Ra + T0)``: walk down from a = 0 until beta(a) reaches the target,
    require d(beta)/da < 0 all the way, and polish the root of R. Raises `BranchEnds` at a fold.
    """
    if not T0 >= 0.0 or not 0.0 <= beta <= 1.0 or (a_over_D is not None and not 0.0 <= a_over_D <= 0.25):
        raise ValueError(f"out of range: T0 = {T0}, a/D = {a_over_D}, beta = {beta}")
    a = _follow_from_rest(c, T0, a_over_D, beta) if beta * T0 > 0.0 else 0.0
    b = float(_manifold(a, a_over_D)[0])
    w = law(c, beta, a, b)
    stretches = np.exp(np.array([a, b, -a - b]))
    p = float(2.0 * w.w1 * stretches[2] ** 2)
    if a_over_D is None:
        return FreeContraction(stretches, p, 0.0, 0.0, 0.0)
    t_cf = -float(forces(w, a, b)[1]) + 0.0  # sigma22 = sigma33 = 0; "+ 0.0" turns -0.0 into 0.0
    q = 2.0 * t_cf / stretches[1]  # T_cf = -q h6 I6 = q l2 / 2
    t_f = -0.25 * q * PI_2 * a_over_D / np.sqrt(stretches[0]) + 0.0  # T_f = -q h4 I4
    return FreeContraction(stretches, p, float(q), float(t_f), t_cf)


def _follow_from_rest(c: Constants, T0: float, a_over_D: float | None, beta: float) -> float:
    """The log fibre stretch of `free_contraction`, for ``beta T0 > 0``."""
    slope_p, slope_a = _reduced(c, 0.0, a_over_D)[2:]
    grid = _contraction_grid(beta * T0 / (slope_p + beta * slope_a), a_over_D)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        r_p, r_a, dr_p, dr_a = _reduced(c, grid, a_over_D)
        residual = r_p + beta * (r_a + T0)
        branch = -r_p / (r_a + T0)
        slope = dr_p + branch * dr_a  # = -(Ra + T0) d(beta)/da
    reached = np.flatnonzero(residual <= 0.0)
    end = int(reached[0]) if reached.size else len(grid)
    before = slice(0, end)
    healthy = (r_a[before] + T0 > 0.0) & (slope[before] > 0.0)
    if not healthy.all() or (np.diff(branch[before]) <= 0.0).any() or end == len(grid):
        top = int(np.argmin(healthy)) if not healthy.all() else end - 1
        raise BranchEnds(f"fold at l1 = {np.exp(grid[top]):.4f}, beta = {branch[top]:.4f}, before beta = {beta}")

    def equation(a: float) -> float:
        passive, active = _reduced(c, a, a_over_D)[:2]
        return float(passive + beta * (active + T0))

    xtol = max(1e-16 * abs(grid[end]), 1e-300)
    a = float(brentq(equation, grid[end], grid[end - 1], xtol=xtol, rtol=4.0 * np.finfo(float).eps, maxiter=1000))
    dp, da = _reduced(c, a, a_over_D)[2:]
    if dp + beta * da <= 0.0:
        raise BranchEnds(f"fold next to l1 = {np.exp(a):.4f}, beta = {beta}")
    polished = a - equation(a) / float(dp + beta * da)
    return polished if abs(equation(polished)) < abs(equation(a)) else a


# ------------------------------------------------------------------------------------------- state C: loaded


def cauchy(
    c: Constants, T0: float, beta: float, stretches: Sequence[float] | Array, p: float, T_f: float = 0.0,
    T_cf: float = 0.0,
) -> Array:  # fmt: skip
    """Principal Cauchy stresses (kPa) at the stretches (l1, l2, l3), ``l1 l2 l3 = 1``, with the pressure p (kPa)."""
    s1, s2, s3 = np.asarray(stretches, dtype=float) ** 2
    x, y = s1 + s2 + s3 - 3.0, s1 - 1.0
    w = passive_derivatives(c, x, y).plus(beta, active_derivatives(c, x, y))
    return np.array([2.0 * (w.w1 + w.w4) * s1 + beta * T0 + T_f - p, 2.0 * w.w1 * s2 + T_cf - p, 2.0 * w.w1 * s3 - p])


@dataclass(frozen=True)
class Loaded:
    """State C: principal stretches, pressure and principal Cauchy stresses (kPa); sigma33 = 0."""

    stretches: Array
    p: float
    sigma: Array

    @property
    def nominal(self) -> Array:
        """Nominal principal stresses ``sigma_i / l_i`` (force per undeformed area) in kPa."""
        return self.sigma / self.stretches


def _loaded(c: Constants, T0: float, beta: float, T_f: float, T_cf: float, a: float, b: float) -> Loaded:
    """State C at the log stretches (a, b) with sigma33 = 0, that is ``p = 2 W1 l3^2``."""
    w = law(c, beta, a, b)
    s1, s2 = forces(w, a, b)
    stretches = np.exp(np.array([a, b, -a - b]))
    return Loaded(stretches, float(2.0 * w.w1 * stretches[2] ** 2), np.array([s1 + beta * T0 + T_f, s2 + T_cf, 0.0]))


def loaded_stretch(
    c: Constants, T0: float, beta: float, T_f: float, T_cf: float, l1: float, l2: float
) -> Loaded:  # fmt: skip
    """State C with both in-plane stretches prescribed and sigma33 = 0; tensions in kPa."""
    return _loaded(c, T0, beta, T_f, T_cf, float(np.log(l1)), float(np.log(l2)))


Mode = Literal["uniaxial_f", "uniaxial_cf", "cauchy", "nominal"]
#: residual, its derivative by the unknowns, and its derivative by the load factor, at (unknowns, load factor)
_System = Callable[[Array, float], tuple[Array, Array, Array]]


def loaded_mixed(
    c: Constants, T0: float, beta: float, T_f: float, T_cf: float, start: Sequence[float] | Array, mode: Mode,
    value: float | tuple[float, float],
) -> Loaded:  # fmt: skip
    """State C under mixed conditions, sigma33 = 0, followed from the stretches ``start`` (those of state A).

    ``mode`` and ``value``: "uniaxial_f" (stretch l1, sigma22 = 0), "uniaxial_cf" (stretch l2, sigma11 = 0),
    "cauchy" (sigma11, sigma22 in kPa), "nominal" (sigma11 / l1, sigma22 / l2 in kPa).

    The load goes in proportion from that of ``start`` to the wanted one, along an arc-length path in the log stretches
    and the load factor. Raises `BranchEnds` where the load factor turns back (a fold under that control) and
    `NoConvergence` where no step is small enough. The law is transversely isotropic: when T_cf = 0, the traction in
    direction 2 is zero and ``start`` has l2 = l3, the branch l2 = l3 is kept (others may cross it).
    """
    a0, b0 = (float(v) for v in np.log(np.asarray(start, dtype=float)[:2]))
    symmetric = T_cf == 0.0 and abs(a0 + 2.0 * b0) < 1e-9
    first = _loaded(c, T0, beta, T_f, T_cf, a0, b0)

    def tangent(a: float, b: float) -> tuple[Array, Array]:
        w = law(c, beta, a, b)
        s1, s2 = forces(w, a, b)
        k11, k12, k22 = stiffness(w, a, b)
        return np.array([s1 + beta * T0 + T_f, s2 + T_cf]), np.array([[k11, k12], [k12, k22]])

    if mode in ("uniaxial_f", "uniaxial_cf"):
        driven = 0 if mode == "uniaxial_f" else 1
        free = 1 - driven
        goal = float(np.log(value))
        if mode == "uniaxial_f" and symmetric:
            return _loaded(c, T0, beta, T_f, T_cf, goal, -0.5 * goal)
        origin = (a0, b0)
        leftover = first.sigma[free]

        def point(z: Array, s: float) -> tuple[float, float]:
            stretch = origin[driven] + s * (goal - origin[driven])
            return (stretch, float(z[0])) if driven == 0 else (float(z[0]), stretch)

        def system(z: Array, s: float) -> tuple[Array, Array, Array]:
            sigma, k = tangent(*point(z, s))
            by_load = k[free, driven] * (goal - origin[driven]) + leftover
            residual = sigma[free] - (1.0 - s) * leftover
            return np.array([residual]), np.array([[k[free, free]]]), np.array([by_load])

        tiny = goal == origin[driven] and abs(leftover) < 1e-12 * (1.0 + abs(first.p))
        z = _continue(system, np.array([origin[free]]), tiny=tiny)
        return _loaded(c, T0, beta, T_f, T_cf, *point(z, 1.0))

    if mode not in ("cauchy", "nominal"):
        raise ValueError(f"unknown mode {mode!r}")
    wanted = np.asarray(value, dtype=float)
    symmetric = symmetric and wanted[1] == 0.0
    # the unknowns are z = (a, b), or z = (a,) with b = -a/2
    basis = np.array([[1.0], [-0.5]]) if symmetric else np.eye(2)
    rows = 1 if symmetric else 2
    weight = 1.0 if mode == "nominal" else 0.0

    def traction(z: Array) -> tuple[Array, Array]:
        """sigma_i / l_i (or sigma_i) and its derivative by z: ``(K_ij - delta_ij sigma_i) / l_i``."""
        logs = basis @ z
        sigma, k = tangent(float(logs[0]), float(logs[1]))
        scale = np.exp(-weight * logs)
        return (scale * sigma)[:rows], (scale[:, None] * (k - weight * np.diag(sigma)) @ basis)[:rows]

    z0 = np.array([a0, b0])[:rows]
    t0 = traction(z0)[0]
    change = wanted[:rows] - t0

    def load_system(z: Array, s: float) -> tuple[Array, Array, Array]:
        t, k = traction(z)
        return t - wanted[:rows] + (1.0 - s) * change, k, -change

    z = _continue(load_system, z0, tiny=bool(np.max(np.abs(change)) < 1e-12 * (1.0 + np.max(np.abs(wanted)))))
    logs = basis @ z
    return _loaded(c, T0, beta, T_f, T_cf, float(logs[0]), float(logs[1]))


def _continue(system: _System, z: Array, tiny: bool, largest: float = 0.01, smallest: float = 1e-8) -> Array:
    """Unknowns at load factor 1, followed from ``z`` at load factor 0 by pseudo-arc-length steps; ``tiny``: no path."""
    if tiny:
        return _polish(system, z, reach=1e-4)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        u = np.append(z, 0.0)
        step = largest
        direction = _direction(system, u)
        if abs(direction[-1]) > 1e-12:
            direction = direction * np.sign(direction[-1])
        else:  # no stiffness at the start: the load factor grows at a higher order, one way or the other
            rising: list[float] = []
            while len(rising) != 1:
                if step < smallest:
                    raise BranchEnds(f"no unique way to load from log stretches {z}")
                probes = [_corrected(system, u, sign * direction, step) for sign in (1.0, -1.0)]
                rising = [sign for sign, v in zip((1.0, -1.0), probes, strict=True) if v is not None and v[-1] > 0.0]
                step *= 0.5
            direction = direction * rising[0]
        for _ in range(100_000):
            v = _corrected(system, u, direction, step)
            turned = None if v is None else _direction(system, v)
            if turned is not None:
                turned = turned * np.sign(turned @ direction)
            if v is None or turned is None or turned @ direction < 0.995:
                step *= 0.5
                if step < smallest:
                    raise NoConvergence(f"stuck at log stretches {u[:-1]}, load factor {u[-1]:.6f}")
                continue
            if v[-1] <= u[-1] or (turned[-1] < 0.0 and v[-1] < 1.0):
                raise BranchEnds(f"the load factor turns back at {v[-1]:.6f}, log stretches {v[:-1]}")
            if v[-1] >= 1.0:
                guess = u + (1.0 - u[-1]) / (v[-1] - u[-1]) * (v - u)
                return _polish(system, guess[:-1], reach=2.0 * step)
            u, direction = v, turned
            step = min(1.5 * step, largest)
    raise NoConvergence("too many load steps")


def _direction(system: _System, u: Array) -> Array:
    """Unit tangent of the path at u = (unknowns, load factor): the null vector of [dR/dz, dR/ds], sign left open."""
    _, k, by_load = system(u[:-1], float(u[-1]))
    return np.linalg.svd(np.column_stack([k, by_load]))[2][-1]


def _corrected(system: _System, u: Array, direction: Array, step: float) -> Array | None:
    """The point of the path at the distance ``step`` from ``u`` along ``direction`` (Newton), or None."""
    v = u + step * direction
    for _ in range(12):
        r, k, by_load = system(v[:-1], float(v[-1]))
        matrix = np.vstack([np.column_stack([k, by_load]), direction])
        full = np.append(r, direction @ (v - u) - step)
        if not (np.isfinite(matrix).all() and np.isfinite(full).all()):
            return None
        try:
            delta = np.linalg.solve(matrix, full)
        except np.linalg.LinAlgError:
            return None
        v = v - delta
        if np.max(np.abs(v - u)) > 3.0 * step:
            return None
        if np.max(np.abs(delta)) < 1e-11 + 1e-9 * step:
            return v
    return None


def _polish(system: _System, z: Array, reach: float) -> Array:
    """Newton at load factor 1, down to round-off; it may not leave the neighbourhood ``reach`` of ``z``."""
    guess, best, smallest_residual = z, z, np.inf
    for _ in range(40):
        r, k, _ = system(z, 1.0)
        size = float(np.max(np.abs(r)))
        if not np.isfinite(size):
            break
        if size < smallest_residual:
            best, smallest_residual = z, size
        elif size <= 1e-9 * (1.0 + float(np.max(np.abs(k)))):
            return best
        if size == 0.0:
            return z
        try:
            z = z - np.linalg.solve(k, r)
        except np.linalg.LinAlgError:
            break
        if np.max(np.abs(z - guess)) > reach:
            break
    raise NoConvergence(f"Newton did not settle at full load near log stretches {guess}")


# --------------------------------------------------------------------------------------------------- Table 1


def table1(c: Constants) -> list[tuple[float, float]]:
    """Rows (100 sigma22 / sigma11 in %, sigma22 in kPa) for the (a/D, T0) of `PRINTED_TABLE`, in its order."""
    rows = []
    for a_over_D, t0, _, _ in PRINTED_TABLE:
        rest = free_contraction(c, t0, a_over_D, 1.0)
        sigma = loaded_stretch(c, t0, 1.0, rest.T_f, rest.T_cf, 1.2, 1.2).sigma
        rows.append((float(100.0 * sigma[1] / sigma[0]), float(sigma[1])))
    return rows


def table1_max_abs_diff(c: Constants) -> float:
    """Largest difference between the computed and the printed entries of Table 1, in % points or kPa."""
    printed = np.array([row[2:] for row in PRINTED_TABLE])
    return float(np.max(np.abs(np.array(table1(c)) - printed)))
