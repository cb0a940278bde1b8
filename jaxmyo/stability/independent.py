"""The equations of the thin sample and of the radial tube by hand, in NumPy: no element of the package, no autodiff.

In both bodies the principal stretches λ = (λf, λcf, λn) lie along the fibre, the struts and the normal at every point,
and are linear in the unknown displacements: λ = 1 + B u. With x = I1 − 3, y = I4 − 1, J = λf λcf λn the density is

    W(x, y) + ½ (βT0 + T_f) ln λf² + ½ T_cf ln λcf² − ½ p (J² − 1) − ½ q h,    h = 1 − λcf + (π−2) (1 − λf^(−½)) a/D,
    W = C1p (exp Q − 1) + β (C1a x y + C2a x² + C3a y² + C4a x),    Q = C2p x² + C3p x y + C4p y²,

whose first and second derivatives by λ are written out below. Everything is of a batch of problems, first axis n.
Units: mm, kPa, mN.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PI_2 = np.pi - 2.0


@dataclass(frozen=True)
class Muscle:
    """What drives a batch of bodies. constants: (n, 8) C1p [kPa], C2p, C3p, C4p [–], C1a, C2a, C3a, C4a [kPa].

    T0: (n,) [kPa]; beta: (n,) [–]; a_over_D: (n,) [–] of a body with the weave (state A), None without;
    T_f, T_cf: (n, points) [kPa] that state A left (zero in A).
    """

    constants: Array
    T0: Array
    beta: Array
    a_over_D: Array | None
    T_f: Array
    T_cf: Array

    def at(self, beta: Array) -> "Muscle":
        """The same at another activation (n,)."""
        return replace(self, beta=beta)

    def __getitem__(self, some: Any) -> "Muscle":
        weave = None if self.a_over_D is None else self.a_over_D[some]
        return Muscle(self.constants[some], self.T0[some], self.beta[some], weave, self.T_f[some], self.T_cf[some])


@dataclass(frozen=True)
class Body:
    """B: (n, points, 3, n_u) [1/mm]; weight: (n, points) [mm³]; patch: (points,) the p of each point.

    inner: (n, n_u) and axial: (n, n_u): the inner radius is Ri + inner · u, the length H (1 + axial · u / H), so that
    a pressure P inside, ends open, does the work P (Ri + inner · u) (H + axial · u) inner · δu per 2π; 0 of a sample.
    """

    B: Array
    weight: Array
    patch: NDArray[np.int64]
    Ri: Array
    H: Array
    inner: Array
    axial: Array

    @property
    def n_u(self) -> int:
        """Displacements of one body."""
        return int(self.B.shape[-1])

    @property
    def n_p(self) -> int:
        """Pressures of one body."""
        return int(self.patch.max()) + 1

    def __getitem__(self, some: Any) -> "Body":
        of = (self.Ri[some], self.H[some], self.inner[some], self.axial[some])
        return Body(self.B[some], self.weight[some], self.patch, *of)

    def inner_radius(self, z: Array) -> Array:
        """(n,) [mm] deformed; 0 of a sample."""
        return np.asarray(self.Ri + np.einsum("na,na->n", self.inner, z[:, : self.n_u]))

    def stretches(self, z: Array) -> Array:
        """λf, λcf, λn (n, points, 3) of the unknowns z (n, n_u + n_p[ + 1])."""
        return 1.0 + np.einsum("ngia,na->ngi", self.B, z[:, : self.n_u])


def sample(n: int) -> Body:
    """Unit cubes; the unknown displacements are λ − 1 along fibre, cross-fibre and normal."""
    none = np.zeros(n)
    nothing = np.zeros((n, 3))
    return Body(np.tile(np.eye(3), (n, 1, 1, 1)), np.ones((n, 1)), np.zeros(1, int), none, none, nothing, nothing)


def tube(R: Array, H: Array) -> Body:
    """Tubes with nodes at the radii R (n, m + 1) and of height H (n,), per 2π; fibres around, struts along the axis.

    Between nodes r is linear in R. The unknowns are r − R at the nodes, and λz − 1. Two Gauss points per interval.
    """
    n, m = R.shape[0], R.shape[1] - 1
    B, weight = np.zeros((n, 2 * m, 3, m + 2)), np.zeros((n, 2 * m))
    for e in range(m):
        length = R[:, e + 1] - R[:, e]
        for k, s in enumerate((0.5 - 0.5 / np.sqrt(3.0), 0.5 + 0.5 / np.sqrt(3.0))):
            g, at = 2 * e + k, R[:, e] + s * length
            B[:, g, 0, e], B[:, g, 0, e + 1] = (1.0 - s) / at, s / at  # λθ = r / R
            B[:, g, 1, m + 1] = 1.0  # λz
            B[:, g, 2, e], B[:, g, 2, e + 1] = -1.0 / length, 1.0 / length  # λr = dr/dR
            weight[:, g] = 0.5 * length * at * H
    inner, axial = np.zeros((n, m + 2)), np.zeros((n, m + 2))
    inner[:, 0], axial[:, m + 1] = 1.0, H
    return Body(B, weight, np.repeat(np.arange(m), 2), R[:, 0], H, inner, axial)


def residual_and_tangent(body: Body, muscle: Muscle, z: Array, pressure: Array) -> tuple[Array, Array]:
    """The derivatives of ∫ density dV less the work of the inner pressure (n,) [kPa] by z, and theirs.

    z: (n, N) = [u (n_u), p (n_p), q with the weave]. Both are not finite where exp Q overflows.
    """
    n_u, n_p = body.n_u, body.n_p
    n, N = z.shape
    lam = body.stretches(z)
    p = z[:, n_u + body.patch]
    stress, stiffness = _law(muscle, lam)
    J2 = np.prod(lam, axis=-1) ** 2
    by_p = -J2[..., None] / lam  # ∂(−½ (J² − 1))/∂λ
    stress = stress + p[..., None] * by_p
    twice = 2.0 - np.eye(3)
    stiffness = stiffness - (p * J2)[..., None, None] * twice / (lam[..., :, None] * lam[..., None, :])
    r, K = np.zeros((n, N)), np.zeros((n, N, N))
    w = body.weight
    if muscle.a_over_D is not None:
        k, q = PI_2 * muscle.a_over_D[:, None], z[:, -1:]
        h = 1.0 - lam[..., 1] + k * (1.0 - lam[..., 0] ** -0.5)
        by_q = np.zeros_like(lam)  # ∂(−½ h)/∂λ
        by_q[..., 0], by_q[..., 1] = -0.25 * k * lam[..., 0] ** -1.5, 0.5
        stress = stress + q[..., None] * by_q
        stiffness[..., 0, 0] += q * 0.375 * k * lam[..., 0] ** -2.5
        r[:, -1] = -0.5 * np.sum(w * h, axis=1)
        K[:, -1, :n_u] = np.einsum("ng,ngi,ngia->na", w, by_q, body.B)
    r[:, :n_u] = np.einsum("ng,ngi,ngia->na", w, stress, body.B)
    K[:, :n_u, :n_u] = np.einsum("ngia,ngij,ngjb->nab", body.B, w[..., None, None] * stiffness, body.B, optimize=True)
    of_p = np.einsum("ngi,ngia->nga", w[..., None] * by_p, body.B)
    for e in range(n_p):
        here = body.patch == e
        r[:, n_u + e] = -0.5 * np.sum((w * (J2 - 1.0))[:, here], axis=1)
        K[:, n_u + e, :n_u] = np.sum(of_p[:, here], axis=1)
    K[:, :n_u, n_u:] = np.swapaxes(K[:, n_u:, :n_u], 1, 2)
    ri, height = body.inner_radius(z), body.H + np.einsum("na,na->n", body.axial, z[:, :n_u])
    r[:, :n_u] -= (pressure * ri * height)[:, None] * body.inner
    change = ri[:, None] * body.axial + height[:, None] * body.inner
    K[:, :n_u, :n_u] -= pressure[:, None, None] * body.inner[:, :, None] * change[:, None, :]
    return r, K


def tensions(body: Body, muscle: Muscle, z: Array) -> tuple[Array, Array]:
    """T_A^f = −q h4 I4 and T_A^cf = −q h6 I6 (n, points) [kPa] of a state A with the weave; zeros without it."""
    lam = body.stretches(z)
    if muscle.a_over_D is None:
        return np.zeros(lam.shape[:2]), np.zeros(lam.shape[:2])
    q, k = z[:, -1:], PI_2 * muscle.a_over_D[:, None]
    return -0.25 * q * k * lam[..., 0] ** -0.5, 0.5 * q * lam[..., 1]


def relative_residual(
    body: Body, muscle: Muscle, z: Array, pressure: Array, free: NDArray[np.bool_] | None = None
) -> Array:
    """(n,) [–]: the largest force imbalance, as a stress, to the largest stiffness or multiplier; or constraint error.

    A displacement u_a strains the volume V_a that it reaches by |B_a|, with a = root of ∫ |B_a|² dV: its force is a
    stress r_a / (a √V_a), and its stiffness K_aa / a². free: (n_u,) the displacements that no condition prescribes.
    """
    n_u = body.n_u
    r, K = residual_and_tangent(body, muscle, z, pressure)
    square = np.einsum("ng,ngia->na", body.weight, body.B**2)
    reaches = np.any(body.B != 0.0, axis=2)
    volume = np.einsum("ng,nga->na", body.weight, reaches.astype(float))
    force = np.abs(r[:, :n_u]) / np.sqrt(square * volume)
    stiffness = np.max(np.abs(np.diagonal(K, axis1=1, axis2=2)[:, :n_u]) / square, axis=1)
    scale = np.maximum(stiffness, np.max(np.abs(z[:, n_u:]), axis=1))
    if free is not None:
        force = force[:, free]
    of_p = np.stack([np.sum(body.weight[:, body.patch == e], axis=1) for e in range(body.n_p)], axis=1)
    of_q = [np.abs(r[:, -1]) / np.sum(body.weight, axis=1)] if muscle.a_over_D is not None else []
    constraint = np.max(np.abs(r[:, n_u : n_u + body.n_p]) / of_p, axis=1)
    largest = np.max(force, axis=1)
    # A body without any stress and stiffness is in equilibrium.
    of_force = np.divide(largest, scale, out=np.where(largest > 0.0, np.inf, 0.0), where=scale > 0.0)
    return np.max(np.stack([of_force, constraint, *of_q]), axis=0)


def _law(muscle: Muscle, lam: Array) -> tuple[Array, Array]:
    """First (n, points, 3) and second derivatives (n, points, 3, 3) of the law and all tensions by the stretches."""
    C1p, C2p, C3p, C4p, C1a, C2a, C3a, C4a = muscle.constants.T[:, :, None]
    beta = muscle.beta[:, None]
    s = lam**2
    x, y = np.sum((lam - 1.0) * (lam + 1.0), axis=-1), (lam[..., 0] - 1.0) * (lam[..., 0] + 1.0)
    e = C1p * np.exp(C2p * x * x + C3p * x * y + C4p * y * y)
    Qx, Qy = 2.0 * C2p * x + C3p * y, C3p * x + 2.0 * C4p * y
    W1 = e * Qx + beta * (C1a * y + 2.0 * C2a * x + C4a)
    W4 = e * Qy + beta * (C1a * x + 2.0 * C3a * y)
    W11 = e * (Qx * Qx + 2.0 * C2p) + 2.0 * beta * C2a
    W14 = e * (Qx * Qy + C3p) + beta * C1a
    W44 = e * (Qy * Qy + 2.0 * C4p) + 2.0 * beta * C3a
    along, across = (muscle.T0 * muscle.beta)[:, None] + muscle.T_f, muscle.T_cf
    first = 2.0 * W1[..., None] * lam
    first[..., 0] += 2.0 * W4 * lam[..., 0] + along / lam[..., 0]
    first[..., 1] += across / lam[..., 1]
    second = 4.0 * W11[..., None, None] * lam[..., :, None] * lam[..., None, :]
    second = second + 2.0 * W1[..., None, None] * np.eye(3)
    mixed = 4.0 * W14[..., None] * lam * lam[..., :1]
    second[..., 0, :] += mixed
    second[..., :, 0] += mixed
    second[..., 0, 0] += 4.0 * W44 * s[..., 0] + 2.0 * W4 - along / s[..., 0]
    second[..., 1, 1] -= across / s[..., 1]
    return first, second
