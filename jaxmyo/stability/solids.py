"""Random problems in three dimensions: small distorted slabs of one shape, as thin as 1:1000, with fibres askew.

Whether what the package finds is an equilibrium is told by element forces written out by hand, in NumPy:

    S = 2 W1 I + (2 W4 + (βT0 + T_f)/I4 − q h4) f⊗f + (T_cf/I6 − q h6) f⊥⊗f⊥ − p I3 C⁻¹,    f_a = ∫ F S ∇N_a dV.

h4 and h6 are the derivatives of h by I4 and I6. Where fibres are straight the deformation is that of the thin sample,
whatever the mesh: there `reference` tells which branch it has to be. Everywhere a path from rest of steps a sixth as
long, `FINER`, has to come to the same states.
"""

from functools import cache
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from jaxmyo.compiler import LONG
from jaxmyo.conditions import Stretch
from jaxmyo.constants import LinYin
from jaxmyo.newton import Settings
from jaxmyo.scene import Scene
from jaxmyo.scenes import thin_sample
from jaxmyo.solve import DEFAULT, contract, load
from jaxmyo.stability.independent import PI_2, Array
from jaxmyo.stability.problems import Problems, draw
from jaxmyo.stability.random_problems import body_of, branch_A, muscle_of
from jaxmyo.stability.reference import End
from jaxmyo.state import State
from jaxmyo.status import Status

ELEMENTS = (2, 2, 1)

FINER: Any = {"move": 0.05, "max_steps": 2000}


class Solids(NamedTuple):
    """A batch of n problems. problems: as of the thin sample; points: (n, n_nodes, 3) [mm]; fibre: (n, n_e, 3)."""

    problems: Problems
    points: Array
    fibre: Array


class Solid(NamedTuple):
    """What the package found of a state: u (n, n_nodes, 3) [mm], p and q (n, n_e) [kPa] (q = 0 in C), status (n,)."""

    u: Array
    p: Array
    q: Array
    T_f: Array
    T_cf: Array
    status: NDArray[np.int64]


@cache
def scene() -> Scene:
    """The one mesh; nodes, fibres and constants are those of each problem."""
    return thin_sample(elements=ELEMENTS)


def place(aspect: Array, distortion: Array, seed: int) -> Array:
    """Nodes (n, n_nodes, 3) of slabs 1 × 1 × aspect [mm] whose inner nodes are displaced; 1 makes det J vanish.

    The middle node moves along the diagonal of its plane, and det J at the corner that it comes to is 1 − distortion.
    """
    unit = scene().mesh.points / scene().mesh.extent
    middle = (unit[:, :2] == 0.5).all(axis=1)
    points = np.tile(unit, (len(aspect), 1, 1))
    sign = np.random.default_rng(seed).choice([-1.0, 1.0], (len(aspect), 1))
    # Where the middle node comes to the line between its neighbours at distortion 1, one corner has no volume.
    points[:, middle, 0] += 0.25 * (distortion[:, None] * sign)
    points[:, middle, 1] += 0.25 * distortion[:, None]
    points[:, :, 2] *= aspect[:, None]
    return points


def draw_solids(n: int, seed: int) -> Solids:
    """n random problems; half of them with straight fibres along x."""
    rng = np.random.default_rng([seed, n, 3])
    problems = draw("sample", n, seed + 1)
    aspect = 10.0 ** rng.uniform(-3.0, 0.0, n)
    points = place(aspect, rng.uniform(0.0, 0.99, n), seed)
    angle = np.where(np.arange(n)[:, None] % 2 == 0, 0.0, rng.uniform(-1.0, 1.0, (n, int(np.prod(ELEMENTS)))))
    return Solids(problems, points, np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1))


def solve_solids(solids: Solids, move: float = DEFAULT.move, max_steps: int = DEFAULT.max_steps) -> tuple[Solid, Solid]:
    """The states A and C of the package, with the weave; move, max_steps: as in `Settings`."""
    A, C = jax.tree.map(np.asarray, _program()(solids, np.float64(move), max_steps))
    return A, C


@cache
def _program() -> Any:
    def one(x: Solids, move: Any, max_steps: Any) -> tuple[Solid, Solid]:
        at = x.problems
        f = x.fibre
        cross = jax.numpy.stack([-f[:, 1], f[:, 0], f[:, 2]], axis=-1)
        constants = LinYin(*(at.constants[k] for k in range(8)))
        how: Any = {"T0": at.T0, "a_over_D": at.a_over_D, "beta": at.beta, "constants": constants}
        path: Any = {"settings": Settings(move=move, max_steps=max_steps), "throw": False}
        A = contract(scene(), **how, points=x.points, fibre=f, cross=cross, **path)
        C = load(A, Stretch("x", at.target[0]), Stretch("y", at.target[1]), **path)
        return _solid(A), _solid(C)

    return jax.jit(jax.vmap(one, in_axes=(0, None, None)), compiler_options=LONG)


def _solid(state: State) -> Any:
    q = jax.numpy.zeros_like(state.p) if state.q is None else state.q
    return Solid(state.u, state.p, q, state.T_f, state.T_cf, state.status)  # type: ignore[arg-type]


def residual(solids: Solids, state: Solid, T_f: Array, T_cf: Array, *, loaded: bool) -> Array:
    """(n,) [–]: the largest imbalance of an unsupported node, as a stress, to the largest stress or modulus.

    Or the largest mean of ½ |I3 − 1| in an element, in A also of ½ |h|, if that is more. T_f, T_cf: (n, n_e, points)
    [kPa] that state A left, zero in A.
    """
    x, problems = scene().mesh.cells, solids.problems
    n_e = len(x)
    r1 = 1.0 / np.sqrt(3.0)
    corner = np.array(
        [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]],
        dtype=float,
    )
    xi = r1 * np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)], dtype=float)
    each = 0.5 * (1.0 + corner[None] * xi[:, None])  # (points, 8, 3)
    dxi = np.stack([0.5 * corner[:, k] * each[:, :, (k + 1) % 3] * each[:, :, (k + 2) % 3] for k in range(3)], axis=-1)
    jacobian = np.einsum("neai,gaj->negij", solids.points[:, x], dxi)
    dN, weight = np.einsum("gaj,negjk->negak", dxi, np.linalg.inv(jacobian)), np.linalg.det(jacobian)
    F = np.eye(3) + np.einsum("neai,negaj->negij", state.u[:, x], dN)
    C = np.swapaxes(F, -1, -2) @ F
    f = np.broadcast_to(solids.fibre[:, :, None], (*weight.shape, 3))
    c = np.stack([-f[..., 1], f[..., 0], f[..., 2]], axis=-1)
    i1, i3 = np.trace(C, axis1=-2, axis2=-1) - 3.0, np.linalg.det(C)
    i4, i6 = (np.einsum("negi,negij,negj->neg", v, C, v) for v in (f, c))
    y = i4 - 1.0
    C1p, C2p, C3p, C4p, C1a, C2a, C3a, C4a = problems.constants.T[:, :, None, None]
    beta, tension, k = (v[:, None, None] for v in (problems.beta, problems.beta * problems.T0, problems.a_over_D))
    e = C1p * np.exp(C2p * i1**2 + C3p * i1 * y + C4p * y**2)
    W1 = e * (2.0 * C2p * i1 + C3p * y) + beta * (C1a * y + 2.0 * C2a * i1 + C4a)
    W4 = e * (C3p * i1 + 2.0 * C4p * y) + beta * (C1a * i1 + 2.0 * C3a * y)
    p, q = state.p[:, :, None], state.q[:, :, None]
    along = 2.0 * W4 + (tension + T_f) / i4 - q * 0.25 * PI_2 * k * i4**-1.25
    across = T_cf / i6 + 0.5 * q / np.sqrt(i6)
    S = 2.0 * W1[..., None, None] * np.eye(3) - (p * i3)[..., None, None] * np.linalg.inv(C)
    S = S + along[..., None, None] * f[..., :, None] * f[..., None, :]
    S = S + across[..., None, None] * c[..., :, None] * c[..., None, :]
    local = np.einsum("neg,negij,negjk,negak->neai", weight, F, S, dN, optimize=True)
    square = np.einsum("neg,negai->nea", weight, dN**2)
    forces, unit, volume = np.zeros(state.u.shape), np.zeros(state.u.shape[:2]), np.zeros(state.u.shape[:2])
    for element in range(n_e):
        forces[:, x[element]] += local[:, element]
        unit[:, x[element]] += square[:, element]
        volume[:, x[element]] += weight[:, element].sum(axis=1)[:, None]
    held = scene().mesh.points == 0.0
    if loaded:
        held = held | (scene().mesh.points == scene().mesh.extent) & (np.arange(3) < 2)
    stress = np.where(held, 0.0, np.abs(forces)) / np.sqrt(unit * volume)[..., None]
    largest = np.stack(
        [np.abs(v).max(axis=(1, 2)) for v in (2.0 * W1, 2.0 * W4 * i4, tension + T_f, T_cf, p * i3, q, e, beta * C2a)]
    ).max(axis=0)
    total = weight.sum(axis=2)
    imbalance = np.max(stress, axis=(1, 2))
    of_force = np.divide(imbalance, largest, out=np.where(imbalance > 0.0, np.inf, 0.0), where=largest > 0.0)
    error = [of_force, np.abs(0.5 * np.sum(weight * (i3 - 1.0), axis=2) / total).max(axis=1)]
    if not loaded:
        h = 1.0 - np.sqrt(i6) + PI_2 * k * (1.0 - i4**-0.25)
        error.append(np.abs(0.5 * np.sum(weight * h, axis=2) / total).max(axis=1))
    return np.asarray(np.max(np.stack(error), axis=0))


def stretches(solids: Solids, state: Solid) -> Array:
    """(n, 3) [–]: extensions of the slab's edges along x, y and z; of a homogeneous deformation, its stretches."""
    top = int(np.argmax(solids.points[0].sum(axis=1)))
    return np.asarray(1.0 + state.u[:, top] / solids.points[:, top])


class SolidOutcome(NamedTuple):
    """A batch of solids, solved and verified. error_A, error_C: (n,) `residual`, NaN where not converged.

    straight: (n,) fibres along x; off: (n,) the largest difference of a stretch of A from the reference where straight;
    apart_A, apart_C: (n,) the largest difference of a displacement, over the extent of the slab, from the state that a
    finer path comes to, NaN where one of the two came to none.
    """

    solids: Solids
    A: Solid
    C: Solid
    error_A: Array
    error_C: Array
    straight: NDArray[np.bool_]
    off: Array
    apart_A: Array
    apart_C: Array


def solid_outcome(n: int, seed: int) -> SolidOutcome:
    """n random problems in three dimensions."""
    solids = draw_solids(n, seed)
    A, C = solve_solids(solids)
    body = body_of("sample", solids.problems)
    branch = branch_A(body, muscle_of(solids.problems, True, body))
    none = np.zeros_like(A.T_f)
    with np.errstate(all="ignore"):
        error_A = residual(solids, A, none, none, loaded=False)
        error_C = residual(solids, C, A.T_f, A.T_cf, loaded=True)
        off = np.max(np.abs(stretches(solids, A) - body.stretches(branch.z)[:, 0]), axis=1)
    good_A, good_C = A.status == Status.CONVERGED, C.status == Status.CONVERGED
    straight = np.all(solids.fibre[:, :, 1] == 0.0, axis=1)
    known = straight & good_A & (branch.end == End.REACHED)
    error_A, error_C = np.where(good_A, error_A, np.nan), np.where(good_C, error_C, np.nan)
    finer_A, finer_C = solve_solids(solids, **FINER)
    apart = _apart(solids, A, finer_A), _apart(solids, C, finer_C)
    return SolidOutcome(solids, A, C, error_A, error_C, straight, np.where(known, off, np.nan), *apart)


def _apart(solids: Solids, one: Solid, other: Solid) -> Array:
    """(n,) [–]: the largest difference of a displacement over the extent of the slab, NaN where one has none."""
    off = np.abs(one.u - other.u) / np.ptp(solids.points, axis=1)[:, None]
    good = (one.status == Status.CONVERGED) & (other.status == Status.CONVERGED)
    return np.where(good, off.max(axis=(1, 2)), np.nan)
