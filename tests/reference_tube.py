"""Exact reference solution of the thick-walled active tube (independent of the package: numpy and scipy only).

Lengths are in mm, stresses, tensions and pressures in kPa, forces in mN, moments in mN mm; stretches are dimensionless.

The ends stay planar, the fibres run around (``f = e_theta``), the struts along the axis (``f_perp = e_z``), the normal
is radial: directions 1, 2, 3 of `reference` are theta, z, r. The wall is incompressible, so that two numbers, the inner
radius ``ri`` and the axial stretch ``lz``, give every stretch:

    r^2 = ri^2 + (R^2 - Ri^2) / lz,    l_theta = r / R,    l_z = lz,    l_r = 1 / (l_theta lz) = dr/dR.

With ``D = sigma_tt - sigma_rr`` and ``Z = sigma_zz - sigma_rr`` from the law (`reference.forces` and the tensions), the
inner pressure P and the outer surface free, radial equilibrium ``d sigma_rr / dr = D / r`` gives

    G = int_ri^ro D / r dr = P,
    F = 2 pi int sigma_zz r dr = pi (P ri^2 + N),    N = int_ri^ro (2 Z - D) r dr.

Open ends: ``F = 0``, that is ``N = -P ri^2``. Closed ends: ``F = pi P ri^2``, that is ``N = 0``.

State A (P = 0) has the pseudo-active constraint ``h = 1 - lz + (pi - 2) (1 - l_theta^(-1/2)) a/D`` with a multiplier q:

    uniform q, exact weave:        int h R dR = 0
    uniform q, weave stiffness k:  int h R dR + q / (2 k) int R dR = 0
    local q, weave stiffness k:    q(R) = -2 k h(R)

and the tensions ``T_f = -q h4 I4 = -q (pi - 2) (a/D) l_theta^(-1/2) / 4`` and ``T_cf = -q h6 I6 = q lz / 2``. State C
has no constraint and keeps these tensions at each material point; ``beta T0`` stays along the fibre.

All integrals are Gauss-Legendre sums over the undeformed radius, ``r dr = R dR / lz``; derivatives for the continuation
are complex steps of the residual. The unknowns are ``u = ln(ri / Ri)``, ``v = ln lz`` and, if q is uniform, q.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from reference import PI_2, Array, BranchEnds, Constants, NoConvergence, Number, forces, law
from scipy.optimize import brentq

QSpace = Literal["uniform", "local"]
Ends = Literal["open", "closed"]
#: residual at (unknowns, load factor); it accepts complex columns, one problem per column
_Residual = Callable[[Number, Number], Array]


class LimitPoint(BranchEnds):
    """The load turns back before its wanted value: ``load`` is its maximum (beta, or the pressure in kPa)."""

    def __init__(self, name: str, load: float, wanted: float) -> None:
        super().__init__(f"{name} turns back at {load:.9g}, before {wanted:.9g}")
        self.load = load


# ------------------------------------------------------------------------------------------------ the undeformed tube


@lru_cache
def _rule(points: int) -> tuple[Array, Array]:
    """Gauss-Legendre abscissae and weights on (0, 1)."""
    x, w = np.polynomial.legendre.leggauss(points)
    return 0.5 * (1.0 + x), 0.5 * w


@dataclass(frozen=True)
class Tube:
    """Undeformed tube: inner and outer radius and length in mm; ``points`` of the Gauss-Legendre rule of the wall."""

    Ri: float = 2.0
    Ro: float = 3.5
    L: float = 20.0
    points: int = 48

    def __post_init__(self) -> None:
        if not 0.0 < self.Ri < self.Ro or not self.L > 0.0:
            raise ValueError(f"a tube needs 0 < Ri < Ro and L > 0, not {self.Ri}, {self.Ro}, {self.L}")

    def quadrature(self) -> tuple[Array, Array]:
        """Radii R (mm) and weights such that ``int_Ri^Ro f R dR`` is ``sum(weights * f(radii))`` (weights in mm^2)."""
        x, w = _rule(self.points)
        radii = self.Ri + (self.Ro - self.Ri) * x
        return radii, (self.Ro - self.Ri) * w * radii

    def log_hoop(self, R: Array, u: Number, v: Number) -> Number:
        """``ln(r / R)`` at ``u = ln(ri / Ri)``, ``v = ln lz``, free of cancellation near rest."""
        grown = self.Ri**2 * np.expm1(2.0 * u) + (R * R - self.Ri**2) * np.expm1(-v)
        return 0.5 * np.log1p(grown / (R * R))


def weave(a: Number, v: Number, a_over_D: float) -> Number:
    """The constraint ``h = 1 - lz + (pi - 2) (1 - l_theta^(-1/2)) a/D`` at ``a = ln l_theta``, ``v = ln lz``."""
    return -np.expm1(v) - PI_2 * a_over_D * np.expm1(-0.5 * a)


def pseudo_tensions(q: Number, a: Number, v: Number, a_over_D: float) -> tuple[Number, Number]:
    """``(T_f, T_cf) = (-q (pi - 2) (a/D) l_theta^(-1/2) / 4, q lz / 2)`` in kPa."""
    return -0.25 * PI_2 * a_over_D * q * np.exp(-0.5 * a) + 0.0 * v, 0.5 * q * np.exp(v) + 0.0 * a


def _integrals(
    c: Constants, tube: Tube, T0: float, beta: Number, u: Number, v: Number, T_f: Number, T_cf: Number
) -> tuple[Number, Number]:
    """``(G, N)``: int D / r dr (kPa) and int (2 Z - D) r dr (kPa mm^2); beta, u and v end with an axis of length 1."""
    R, w = tube.quadrature()
    a = tube.log_hoop(R, u, v)
    s1, s2 = forces(law(c, beta, a, v), a, v)
    d, z = s1 + beta * T0 + T_f, s2 + T_cf
    g = np.sum(w * np.exp(-2.0 * a - v) / (R * R) * d, axis=-1)
    return g, np.sum(w * np.exp(-v) * (2.0 * z - d), axis=-1)


# -------------------------------------------------------------------------------------------------------- the states


@dataclass(frozen=True)
class Wall(ABC):
    """A deformed tube: activation beta (with T0 in kPa), inner pressure P (kPa), ``u = ln(ri/Ri)``, ``v = ln lz``."""

    c: Constants
    tube: Tube
    T0: float
    beta: float
    P: float
    u: float
    v: float

    @property
    def ri(self) -> float:
        """Inner radius in mm."""
        return float(self.tube.Ri * np.exp(self.u))

    @property
    def ro(self) -> float:
        """Outer radius in mm."""
        return float(self.r(self.tube.Ro))

    @property
    def lz(self) -> float:
        """Axial stretch: deformed over undeformed height."""
        return float(np.exp(self.v))

    def _log_hoop(self, R: Number) -> Array:
        return np.asarray(self.tube.log_hoop(np.asarray(R, dtype=float), self.u, self.v))

    @abstractmethod
    def T_f(self, R: Number) -> Array:
        """Pseudo-active tension along the fibre (kPa) at the undeformed radii R."""

    @abstractmethod
    def T_cf(self, R: Number) -> Array:
        """Pseudo-active tension along the struts (kPa) at the undeformed radii R."""

    def r(self, R: Number) -> Array:
        """Deformed radii (mm) of the undeformed radii R (mm)."""
        return np.asarray(R * np.exp(self._log_hoop(R)))

    def stretches(self, R: Number) -> Array:
        """``(l_theta, l_z, l_r)``, stacked along the first axis, at the undeformed radii R."""
        a = self._log_hoop(R)
        return np.exp(np.stack([a, self.v + 0.0 * a, -a - self.v]))

    def differences(self, R: Number) -> tuple[Array, Array]:
        """``(sigma_tt - sigma_rr, sigma_zz - sigma_rr)`` in kPa at the undeformed radii R."""
        a = self._log_hoop(R)
        s1, s2 = forces(law(self.c, self.beta, a, self.v), a, self.v)
        return s1 + self.beta * self.T0 + self.T_f(R), s2 + self.T_cf(R)

    def radial_stress(self, R: Number) -> Array:
        """``sigma_rr = -P + int_ri^r D / r dr`` in kPa at the undeformed radii R, by Gauss points between Ri and R."""
        x, w = _rule(self.tube.points)
        span = np.asarray(R, dtype=float)[..., None] - self.tube.Ri
        radii = self.tube.Ri + span * x
        integrand = self.differences(radii)[0] * radii / (self.lz * self.r(radii) ** 2)
        return np.asarray(np.sum(span * w * integrand, axis=-1) - self.P)

    def stress(self, R: Number) -> Array:
        """Cauchy stresses ``(sigma_tt, sigma_zz, sigma_rr)`` in kPa, along the first axis, at undeformed radii R."""
        s = self.radial_stress(R)
        d, z = self.differences(R)
        return np.stack([s + d, s + z, s])

    def p(self, R: Number) -> Array:
        """Multiplier of incompressibility (kPa): ``sigma_rr = 2 W1 l_r^2 - p``."""
        a = self._log_hoop(R)
        w1 = law(self.c, self.beta, a, self.v).w1
        return np.asarray(2.0 * w1 * np.exp(-2.0 * (a + self.v)) - self.radial_stress(R))

    def axial_force(self) -> float:
        """``2 pi int sigma_zz r dr`` in mN, from the stress field."""
        R, w = self.tube.quadrature()
        return float(2.0 * np.pi * np.sum(w * self.stress(R)[1]) / self.lz)


@dataclass(frozen=True)
class Contraction(Wall):
    """State A. ``q`` is the uniform multiplier in kPa (0 without the constraint), None if it varies: see `q_at`."""

    a_over_D: float | None
    k: float | None
    q_space: QSpace
    q: float | None

    def h(self, R: Number) -> Array:
        """The constraint h (dimensionless) at the undeformed radii R; 0 without the constraint."""
        a = self._log_hoop(R)
        return 0.0 * a if self.a_over_D is None else np.asarray(weave(a, self.v, self.a_over_D))

    def q_at(self, R: Number) -> Array:
        """The multiplier q (kPa) at the undeformed radii R."""
        if self.q is not None:
            return np.full(np.shape(R), self.q)
        assert self.k is not None
        return np.asarray(-2.0 * self.k * self.h(R))

    def T_f(self, R: Number) -> Array:
        """``-q h4 I4`` in kPa at the undeformed radii R."""
        tensions = pseudo_tensions(self.q_at(R), self._log_hoop(R), self.v, self.a_over_D or 0.0)
        return np.asarray(tensions[0])

    def T_cf(self, R: Number) -> Array:
        """``-q h6 I6`` in kPa at the undeformed radii R."""
        tensions = pseudo_tensions(self.q_at(R), self._log_hoop(R), self.v, self.a_over_D or 0.0)
        return np.asarray(tensions[1])


@dataclass(frozen=True)
class Inflation(Wall):
    """State C, under the pressure P, with the tensions of the state ``A`` frozen."""

    A: Contraction
    ends: Ends

    def T_f(self, R: Number) -> Array:
        """Tension along the fibre (kPa), frozen in state A, at the undeformed radii R."""
        return self.A.T_f(R)

    def T_cf(self, R: Number) -> Array:
        """Tension along the struts (kPa), frozen in state A, at the undeformed radii R."""
        return self.A.T_cf(R)


def contract(
    c: Constants, tube: Tube, T0: float, a_over_D: float | None, beta: float, k: float | None = None,
    q_space: QSpace = "uniform", start: Contraction | None = None,
) -> Contraction:  # fmt: skip
    """State A (no load), T0 and the weave stiffness k in kPa; ``a_over_D=None``: no constraint, ``k=None``: exact.

    The branch is followed in beta from rest, or from ``start`` (the same tube at another beta). Raises `LimitPoint`
    where beta turns back, `NoConvergence` where no step is small enough.
    """
    if not T0 >= 0.0 or not 0.0 <= beta <= 1.0 or (a_over_D is not None and not 0.0 <= a_over_D <= 0.25):
        raise ValueError(f"out of range: T0 = {T0}, a/D = {a_over_D}, beta = {beta}")
    if q_space not in ("uniform", "local") or (k is not None and not k > 0.0):
        raise ValueError(f"out of range: q_space = {q_space!r}, k = {k}")
    if a_over_D is not None and q_space == "local" and k is None:
        raise ValueError("a local q with an exact weave has more constraints than displacements")
    R, w = tube.quadrature()
    uniform = a_over_D is not None and q_space == "uniform"
    unit = max(T0, 1.0)  # q is counted in this many kPa along the branch
    beta0 = 0.0 if start is None else start.beta
    area = float(np.sum(w))

    def residual(z: Number, s: Number) -> Array:
        u, v, b = z[0][..., None], z[1][..., None], (beta0 + s * (beta - beta0))[..., None]
        a = tube.log_hoop(R, u, v)
        rows, q = [], 0.0
        if a_over_D is not None:
            h = weave(a, v, a_over_D)
            if uniform:
                q = unit * z[2][..., None]
                softness = 0.0 if k is None else unit * z[2] / (2.0 * k)
                rows = [np.sum(w * h, axis=-1) / area + softness]
            else:
                assert k is not None
                q = -2.0 * k * h
        t_f, t_cf = pseudo_tensions(q, a, v, a_over_D or 0.0)
        g, n = _integrals(c, tube, T0, b, u, v, t_f, t_cf)
        return np.stack([g, n / area, *rows])

    z0 = np.zeros(3 if uniform else 2)
    if start is not None:
        q0 = [(start.q or 0.0) / unit] if uniform else []
        z0 = np.array([start.u, start.v, *q0])
    z = z0 if beta == beta0 else _follow(residual, z0, "beta", beta0, beta)
    q: float | None = 0.0
    if a_over_D is not None:
        q = float(unit * z[2]) if uniform else None
    return Contraction(c, tube, T0, beta, 0.0, float(z[0]), float(z[1]), a_over_D, k, q_space, q)


def inflate(
    c: Constants, tube: Tube, A: Contraction, P: float, ends: Ends = "open", start: Inflation | None = None
) -> Inflation:
    """State C under the pressure P (kPa), the tensions of state A frozen.

    Followed in P from state A; or from another state C, ``start``, along the straight path between the two sets of
    loads (P, beta T0, beta and the frozen tensions). The two may end on different branches: the pressure of an active
    tube can have a maximum, with a second stable state beyond. Raises `LimitPoint` where the load turns back (its
    ``load`` is then the greatest pressure in kPa, if P is what changes), `NoConvergence` where no step is small enough.
    """
    if ends not in ("open", "closed") or (start is not None and start.ends != ends):
        raise ValueError(f"ends = {ends!r}, not 'open' or 'closed', or not those of the start")
    if A.c != c or A.tube != tube or (start is not None and (start.tube != tube or start.c != c)):
        raise ValueError("the states belong to another tube")
    R, w = tube.quadrature()
    area = float(np.sum(w))
    origin: Wall = A if start is None else start
    new = np.stack([A.T_f(R) + A.beta * A.T0, A.T_cf(R)])
    old = np.stack([origin.T_f(R) + origin.beta * origin.T0, origin.T_cf(R)])
    thrust = tube.Ri**2 if ends == "open" else 0.0

    def residual(z: Number, s: Number) -> Array:
        u, v, t = z[0][..., None], z[1][..., None], s[..., None]
        beta = origin.beta + t * (A.beta - origin.beta)
        load = origin.P + s * (P - origin.P)
        t_f, t_cf = old[0] + t * (new[0] - old[0]), old[1] + t * (new[1] - old[1])
        g, n = _integrals(c, tube, 0.0, beta, u, v, t_f, t_cf)
        return np.stack([g - load, (n + thrust * load * np.exp(2.0 * z[0])) / area])

    if P == origin.P and A.beta == origin.beta and np.array_equal(new, old):
        z = np.array([origin.u, origin.v])
    else:
        z = _follow(residual, np.array([origin.u, origin.v]), "P", origin.P, P)
    return Inflation(c, tube, A.T0, A.beta, P, float(z[0]), float(z[1]), A, ends)


class CycleStep(NamedTuple):
    """States A and C at the phase s of the cycle; P in kPa."""

    s: float
    beta: float
    P: float
    A: Contraction
    C: Inflation


def cycle(
    c: Constants, tube: Tube, T0: float, a_over_D: float | None, s_values: Sequence[float] | Array,
    k: float | None = None, q_space: QSpace = "uniform", ends: Ends = "open",
) -> list[CycleStep]:  # fmt: skip
    """States A and C at each phase s, with ``beta = sin^2(pi s)`` and ``P = 8 + 10 beta`` (kPa).

    A is followed in beta from the A before (the first one from rest), C from the C before (the first one in pressure
    from its own A): start at s = 0, where the tube is passive.
    """
    steps: list[CycleStep] = []
    A: Contraction | None = None
    C: Inflation | None = None
    for s in np.asarray(s_values, dtype=float):
        beta = min(float(np.sin(np.pi * s) ** 2), 1.0)
        P = 8.0 + 10.0 * beta
        A = contract(c, tube, T0, a_over_D, beta, k, q_space, start=A)
        C = inflate(c, tube, A, P, ends, start=C)
        steps.append(CycleStep(float(s), beta, P, A, C))
    return steps


# -------------------------------------------------------------------------------------------------- the continuation


def _jacobian(residual: _Residual, z: Array, s: float) -> Array:
    """``[dR/dz, dR/ds]`` by complex steps (exact to round-off)."""
    columns = np.append(z, s)[:, None] + 1e-30j * np.eye(len(z) + 1)
    return np.imag(residual(columns[:-1], columns[-1])) / 1e-30


def _direction(residual: _Residual, y: Array, along: Array) -> Array | None:
    """Unit tangent of the path at ``y = (unknowns, load factor)``, turned towards ``along``; None off the domain."""
    matrix = _jacobian(residual, y[:-1], float(y[-1]))
    if not np.isfinite(matrix).all():
        return None
    tangent = np.linalg.svd(matrix)[2][-1]
    return tangent if tangent @ along >= 0.0 else -tangent


def _corrected(residual: _Residual, y: Array, direction: Array, step: float) -> Array | None:
    """The point of the path at the distance ``step`` from ``y`` along ``direction`` (Newton), or None."""
    x = y + step * direction
    for _ in range(10):
        r = residual(x[:-1], np.asarray(x[-1]))
        matrix = np.vstack([_jacobian(residual, x[:-1], float(x[-1])), direction])
        full = np.append(r, direction @ (x - y) - step)
        if not (np.isfinite(matrix).all() and np.isfinite(full).all()):
            return None
        try:
            delta = np.linalg.solve(matrix, full)
        except np.linalg.LinAlgError:
            return None
        x = x - delta
        if np.max(np.abs(x - y)) > 3.0 * step:
            return None
        if np.max(np.abs(delta)) < 1e-12 + 1e-7 * step:
            return x
    return None


def _follow(
    residual: _Residual, z: Array, name: str, first: float, last: float, largest: float = 0.05, smallest: float = 1e-9
) -> Array:
    """Unknowns at load factor 1 (the load ``last``), followed from ``z`` at load factor 0 (the load ``first``).

    Pseudo-arc-length steps of at most ``largest``, over which the tangent may turn by 3 degrees; Newton at the end.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        y = np.append(z, 0.0)
        ahead = np.append(np.zeros(len(z)), 1.0)
        direction = _direction(residual, y, ahead)
        if direction is None or direction[-1] < 1e-12:
            raise NoConvergence(f"no way to leave {name} = {first:.9g}")
        step = 0.5 * largest
        for _ in range(100_000):
            x = _corrected(residual, y, direction, step)
            turned = None if x is None else _direction(residual, x, direction)
            if x is None or turned is None or turned @ direction < 0.9986:
                step *= 0.5
                if step < smallest:
                    raise NoConvergence(f"stuck at {name} = {first + y[-1] * (last - first):.9g}")
                continue
            reach, peak = step, x
            if turned[-1] <= 0.0 and x[-1] < 1.0:
                reach, peak = _peak(residual, y, direction, step)
            if peak[-1] >= 1.0:
                return _polish(residual, _at_target(residual, y, direction, reach), name, last)
            if turned[-1] <= 0.0:
                raise LimitPoint(name, float(first + peak[-1] * (last - first)), last)
            y, direction = x, turned
            step = min(1.5 * step, largest)
    raise NoConvergence(f"too many steps towards {name} = {last:.9g}")


def _must(x: Array | None) -> Array:
    if x is None:
        raise NoConvergence("a step inside a converged step did not converge")
    return x


def _peak(residual: _Residual, y: Array, direction: Array, step: float) -> tuple[float, Array]:
    """Distance and point, within ``step`` of ``y``, where the load factor is greatest."""

    def rise(t: float) -> float:
        x = _must(_corrected(residual, y, direction, t)) if t > 0.0 else y
        return float(_must(_direction(residual, x, direction))[-1])

    t = float(brentq(rise, 0.0, step, xtol=1e-14))
    return t, _must(_corrected(residual, y, direction, t))


def _at_target(residual: _Residual, y: Array, direction: Array, reach: float) -> Array:
    """Unknowns, within ``reach`` of ``y``, where the load factor is 1, roughly."""

    def excess(t: float) -> float:
        return float((_must(_corrected(residual, y, direction, t)) if t > 0.0 else y)[-1]) - 1.0

    t = float(brentq(excess, 0.0, reach, xtol=1e-3 * reach))
    return (_must(_corrected(residual, y, direction, t)) if t > 0.0 else y)[:-1]


def _polish(residual: _Residual, z: Array, name: str, last: float) -> Array:
    """Newton at load factor 1, until the residual falls no more."""
    guess, best, least = z, z, np.inf
    one = np.asarray(1.0)
    for _ in range(30):
        r = residual(z, one)
        matrix = _jacobian(residual, z, 1.0)[:, :-1]
        size = float(np.max(np.abs(r)))
        if not np.isfinite(size) or np.max(np.abs(z - guess)) > 1e-3:
            break
        if size >= least and least <= 1e-10 * (1.0 + float(np.max(np.abs(matrix)))):
            return best
        if size < least:
            best, least = z, size
        if size == 0.0:
            return z
        try:
            z = z - np.linalg.solve(matrix, r)
        except np.linalg.LinAlgError:
            break
    raise NoConvergence(f"Newton did not settle at {name} = {last:.9g}")


# ------------------------------------------------------------------------------- neo-Hookean closed forms, passive


class TubeLoads(NamedTuple):
    """Inner pressure (kPa), axial force of the wall ``2 pi int sigma_zz r dr`` (mN), moment about the axis (mN mm)."""

    P: float
    force: float
    moment: float


def tube_radius(R: Number, Ri: float, ri: float, lz: float = 1.0) -> Number:
    """``r = (ri^2 + (R^2 - Ri^2) / lz)^(1/2)`` in mm: every incompressible tube with planar ends."""
    return np.sqrt(ri**2 + (R * R - Ri**2) / lz)


def neo_hookean_tube(mu: float, Ri: float, Ro: float, ri: float, lz: float = 1.0, twist: float = 0.0) -> TubeLoads:
    """Loads of a tube of density ``mu (I1 - 3) / 2`` at inner radius ri, axial stretch lz, twist per undeformed length.

    ``mu`` in kPa, radii in mm, ``twist = t`` in rad/mm (``theta = Theta + t Z``, ``z = lz Z``), outer surface free.
    With ``m = Ri^2 - lz ri^2``, ``E = ln(Ro / Ri)`` and ``e = ln(ro / ri)``:

        P / mu = (E - e) / lz - m (1/ri^2 - 1/ro^2) / (2 lz^2) + t^2 (ro^2 - ri^2) / 2
        F / (pi mu) = P ri^2 / mu + lz^2 (ro^2 - ri^2) - [(Ro^2 - Ri^2) / (2 lz) - m E / lz] / lz
                      - [(ro^2 - ri^2) lz / 2 + m e] / lz^2 - t^2 (ro^4 - ri^4) / 4
        M / (pi mu) = t lz (ro^4 - ri^4) / 2
    """
    ro = float(tube_radius(Ro, Ri, ri, lz))
    m, outer, inner = Ri**2 - lz * ri**2, np.log(Ro / Ri), np.log(ro / ri)
    pressure = (outer - inner) / lz - 0.5 * m * (ri**-2 - ro**-2) / lz**2 + 0.5 * twist**2 * (ro**2 - ri**2)
    hoop = (0.5 * (Ro**2 - Ri**2) - m * outer) / lz**2
    radial = (0.5 * lz * (ro**2 - ri**2) + m * inner) / lz**2
    quartic = ro**4 - ri**4
    force = pressure * ri**2 + lz**2 * (ro**2 - ri**2) - hoop - radial - 0.25 * twist**2 * quartic
    return TubeLoads(float(mu * pressure), float(np.pi * mu * force), float(0.5 * np.pi * mu * twist * lz * quartic))


def neo_hookean_radius(mu: float, Ri: float, Ro: float, P: float, lz: float = 1.0, twist: float = 0.0) -> float:
    """Inner radius (mm) at the inner pressure P (kPa), axial stretch lz and twist (rad/mm).

    Without twist P rises with ri towards ``mu ln(Ro / Ri) / lz``; `BranchEnds` is raised beyond.
    """

    def excess(log_ri: float) -> float:
        return (neo_hookean_tube(mu, Ri, Ro, float(np.exp(log_ri)), lz, twist).P - P) / mu

    middle = float(np.log(Ri / np.sqrt(lz)))
    low, high = middle - 1e-3, middle + 1e-3
    while excess(low) > 0.0:
        low -= 0.1
        if low < middle - 15.0:
            raise BranchEnds(f"no inner radius at P = {P} kPa")
    while excess(high) < 0.0:
        high += 0.1
        if high > middle + 15.0:
            raise BranchEnds(f"no inner radius at P = {P} kPa")
    return float(np.exp(brentq(excess, low, high, xtol=1e-15, rtol=4.0 * np.finfo(float).eps)))


def neo_hookean_torsion(mu: float, Ro: float, twist: float, Ri: float = 0.0) -> tuple[float, TubeLoads]:
    """Inner radius (mm) and loads of a cylinder twisted at lz = 1, its lateral surfaces free of pressure.

    ``mu`` in kPa, radii in mm, ``twist = t`` in rad/mm. Solid (``Ri = 0``): ``r = R``, ``M = pi mu t Ro^4 / 2``,
    ``F = -pi mu t^2 Ro^4 / 4``. A hollow one also narrows: ri is the root of P = 0 in `neo_hookean_tube`.
    """
    if Ri == 0.0:
        quartic = np.pi * mu * Ro**4
        return 0.0, TubeLoads(0.0, float(-0.25 * quartic * twist**2), float(0.5 * quartic * twist))
    ri = neo_hookean_radius(mu, Ri, Ro, 0.0, 1.0, twist)
    return ri, neo_hookean_tube(mu, Ri, Ro, ri, 1.0, twist)


def neo_hookean_sphere(mu: float, Ri: float, Ro: float, ri: float) -> float:
    """Inner pressure (kPa) of a thick sphere at the inner radius ri (mm), outer surface free, ``mu`` in kPa.

    ``r^3 = ri^3 + R^3 - Ri^3``; with ``b = R / r``: ``P = mu [2 b + b^4 / 2] at Ro - mu [2 b + b^4 / 2] at Ri``.
    """
    inner, outer = Ri / ri, Ro / np.cbrt(ri**3 + Ro**3 - Ri**3)
    return float(mu * (2.0 * (outer - inner) + 0.5 * (outer**4 - inner**4)))
