"""What a scene costs, and what it models without need: lines of `print(scene)`."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jaxmyo.conditions import Displacement, Homogeneous, Planar, Proportional, Stretch, Uniform
from jaxmyo.coordinates import evaluate
from jaxmyo.factor import chosen
from jaxmyo.linear import Dense
from jaxmyo.multigrid import Multigrid
from jaxmyo.scene import Scene
from jaxmyo.solve import LARGE
from jaxmyo.system import System

# Seconds on an AMD EPYC (Lin–Yin law; dense: `Dense.at`, `linear.factors`, `Dense.inertia`, of one core; sparse: the
# block of the README, on two), measured on bodies of 5 to 1,200 unknowns, and of 13,000 to 101,000, multigrid on the
# latter and on 811,000. They hold within a factor of three there: an estimate, to compare scenes with.
_START = 8e-5  # of a dense iteration, whatever its size
_POINT = {"few": 1.4e-6, "many": 2.2e-6, "sparse": 6e-7}  # residual and tangent at a Gauss point
_FEW = 6  # unknowns of an element up to which they are few
_LU = 6e-11  # dense factors, times n³
_INERTIA = 1e-10  # the count of unstable modes at the end of a dense solve, times n³
_NESTED = 2.4e-10  # sparse factors, times n²
_CYCLES = 6.5e-7  # multigrid, times n^(4/3): more iterations on finer meshes


@dataclass(frozen=True)
class Cost:
    """The size of a scene's systems, and an estimate of the work.

    n_u, n_p, n_q: displacements, pressures, multipliers of the weave (in state A only); points: Gauss points at which
    the law is differentiated twice in each Newton iteration; solver: of the linear systems; elements, factors: seconds
    of one iteration; inertia: once in a solve.
    """

    n_u: int
    n_p: int
    n_q: int
    points: int
    solver: str
    elements: float
    factors: float
    inertia: float

    def __str__(self) -> str:
        n_A, n_C = self.n_u + self.n_p + self.n_q, self.n_u + self.n_p
        each = self.elements + self.factors
        parts = f"elements {self.elements / each:.0%}, factors {self.factors / each:.0%}"
        last = f", {_time(self.inertia)} for the count of unstable modes" if self.inertia > 0.1 * each else ""
        return (
            f"{n_A} unknowns in state A with the weave, else {n_C} ({self.solver}); Gauss points at which the law is "
            f"differentiated twice: {self.points}; by estimate {_time(each)} per Newton iteration ({parts}){last}"
        )


def _time(seconds: float) -> str:
    return f"{seconds * 1e3:.1g} ms" if seconds < 1.0 else f"{seconds:.2g} s"


def cost(scene: Scene) -> Cost:
    """Of solves without `jit` or `vmap`, where large bodies have sparse factors."""
    n_u, n_p, n_q = scene.kinematics(()).size, int(scene.p_patches.max()) + 1, int(scene.q_patches.max()) + 1
    points = len(scene.mesh.cells) * int(np.prod(scene.orders))
    size = n_u + n_p + n_q
    if n_u > LARGE:
        solver = chosen(n_u)
        factors = _CYCLES * n_u ** (4 / 3) if solver is Multigrid else _NESTED * n_u**2
        return Cost(n_u, n_p, n_q, points, solver.name, points * _POINT["sparse"], factors, 0.0)
    tied = any(isinstance(s, Uniform | Proportional | Homogeneous) for s in scene.supports)
    at_points = points * _POINT["few" if tied and n_u <= _FEW * len(scene.mesh.cells) else "many"]
    return Cost(n_u, n_p, n_q, points, Dense.name, _START + at_points, _LU * size**3, _INERTIA * size**3)


def needless(scene: Scene) -> list[str]:
    """What is modelled though nothing depends on it, and what would do."""
    found = []
    if not any(kind.active for kind in (scene.kinds[k] for k in np.unique(scene.material))):
        found.append(
            "the weave q, as no element is active: contract(a_over_D=None) has no multipliers for a body that stays at "
            "rest"
        )
    n_e, n_p, n_q = len(scene.mesh.cells), int(scene.p_patches.max()) + 1, int(scene.q_patches.max()) + 1
    tied = any(isinstance(s, Homogeneous) for s in scene.supports)
    if tied and max(n_p, n_q) > 1:
        found.append(f"{n_p} p and {n_q} q in a homogeneous body: one of each is all that its {n_e} elements can obey")
    if not tied and _stays_homogeneous(scene):
        n_u = scene.kinematics(()).size
        found.append(
            f"{n_e} elements with {n_u} displacements, {n_p} p and {n_q} q, if stretches and uniform tractions are its "
            "only loads: a box of one material with straight fibres between symmetry planes deforms homogeneously; "
            "Homogeneous() on one element with one Gauss point has 3 displacements, one p and one q (and does not see "
            "instabilities of other shapes)"
        )
        return found
    if any(isinstance(s, Uniform | Proportional | Homogeneous) for s in scene.supports):
        found += _along_axes(scene)
    return found


def _stays_homogeneous(scene: Scene) -> bool:
    """A box of one material, its fibres alike everywhere, held by planes that do not bend and slide in themselves."""
    mesh, points = scene.mesh, scene.mesh.points
    planes = [s for s in scene.supports if isinstance(s, Displacement | Stretch | Planar)]
    if mesh.coordinates.curved or len(np.unique(scene.material)) > 1 or len(planes) < len(scene.supports):
        return False
    if len(mesh.cells) == 1 and max(scene.orders) == 1:
        return False
    directions = scene.frame.reshape(-1, 9)
    system = System.of(scene, scene.kinematics(()), weave=False, surfaces={}, large=True)
    box = float(np.prod(np.ptp(points, axis=0)))
    if np.ptp(directions, axis=0).max() > 1e-9 or abs(float(np.sum(system.weight)) - box) > 1e-9 * box:
        return False
    for s in planes:
        if isinstance(s, Stretch):
            continue
        along = points[np.unique(mesh.face(s.face)), mesh.axis(s.axis)]
        ends = points[:, mesh.axis(s.axis)]
        at_end = np.isin(np.round((along - ends.min()) / np.ptp(ends), 9), (0.0, 1.0)).all()
        whole = np.sum(np.abs(ends - along[0]) < 1e-9 * np.ptp(ends)) == len(along)
        if not (at_end and whole and np.ptp(along) < 1e-9 * np.ptp(ends)):
            return False
        if isinstance(s, Displacement) and not _is_zero(s.value):
            return False
    return True


def _is_zero(value: object) -> bool:
    return np.ndim(value) == 0 and float(value) == 0.0  # type: ignore[arg-type]


def _along_axes(scene: Scene) -> list[str]:
    """Gauss points, and elements, along axes in which nothing varies."""
    mesh, found = scene.mesh, []
    system = System.of(scene, scene.kinematics(()), weave=False, surfaces={})
    fields = [f.reshape(len(mesh.cells), *scene.orders, -1) for f in _what_varies(scene, system)]
    axes = mesh.coordinates.axes
    points = [a for k, a in enumerate(axes) if scene.orders[k] > 1 and all(_same(f, 1 + k) for f in fields)]
    if points:
        counts = " × ".join(str(scene.orders[axes.index(a)]) for a in points)
        found.append(f"{counts} Gauss points along {', '.join(points)}: nothing varies there in an element, 1 is exact")
    if mesh.grid is None:
        return found
    fields += [np.asarray(x, dtype=float).reshape(len(mesh.cells), -1) for x in (system.local_u, system.material)]
    for k, a in enumerate(axes):
        # Alike in the first element of each line and all the others, and within each of them.
        if mesh.grid[k] > 1 and all(_same(f.reshape(*mesh.grid, *f.shape[1:]), k) for f in fields):
            within = [f for f in fields if f.ndim > 2 and scene.orders[k] > 1]
            if all(_same(f, 1 + k) for f in within):
                found.append(f"{mesh.grid[k]} elements along {a}: nothing varies there, 1 is exact")
    return found


def _what_varies(scene: Scene, system: System) -> list[NDArray[np.float64]]:
    """What the Lagrangian depends on at the Gauss points (n_elements, n_points, ...)."""
    c = scene.mesh.coordinates
    columns = np.asarray(system.columns)
    fields = [np.asarray(system.frame), np.asarray(system.inverse_g), columns[:, :, :3]]
    if c.curved:
        theta = np.asarray(system.theta)
        by_theta = evaluate(c.by_theta, theta.reshape(-1, 3)).reshape(*theta.shape, 3)
        acts = np.abs(by_theta).max(axis=(0, 1, 2)) > 0.0  # the coordinates that scale factors depend on
        fields += [columns[:, :, 3, np.repeat(acts, system.slots)], theta[:, :, acts]]
    return fields


def _same(x: NDArray[np.float64], axis: int) -> bool:
    return bool(np.ptp(x, axis=axis).max(initial=0.0) <= 1e-9 * np.abs(x).max(initial=1e-300))
