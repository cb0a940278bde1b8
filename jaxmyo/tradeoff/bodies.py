"""The bodies whose trade is measured: scenes with a solve, two outputs, and what these are exactly.

Numbers called `near` are where Newton's method for an exact solution starts; they tell the branch, roughly.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxmyo import conditions, patches, tracing
from jaxmyo.constants import TABLE1
from jaxmyo.invariants import I1, I4
from jaxmyo.mesh import box
from jaxmyo.newton import Settings
from jaxmyo.paper import exact_tube
from jaxmyo.paper.exact_tube import Muscle
from jaxmyo.scene import Scene
from jaxmyo.scenes import axisymmetric_tube, radial_tube, thin_sample, tube_sector
from jaxmyo.scenes.tube import HEIGHT, RI, RO
from jaxmyo.solve import contract, load
from jaxmyo.state import State
from jaxmyo.tradeoff import exact
from jaxmyo.tradeoff.dials import Dials

#: Free contraction and the loaded state that starts from it.
Pair = tuple[State, State]


@dataclass(frozen=True)
class Body:
    """A body in one state.

    models: name → scene of some dials; the first is the body's own; solve: of a scene, T0 [kPa] or another number that
    drives it, and settings; drive: that number; read: outputs (k,) of the scene and its states; outputs: their names
    and units, the first is what the front is drawn for; exact: their values, None where only finer meshes tell.
    """

    name: str
    title: str
    outputs: tuple[tuple[str, str], ...]
    models: Mapping[str, Callable[[Dials], Scene]]
    solve: Callable[[Scene, Any, Settings], Pair]
    drive: float
    read: Callable[[Scene, Pair], Array]
    exact: Callable[[], tuple[float, ...]] | None

    def scene(self, dials: Dials) -> Scene:
        """The scene of a setting; ValueError where the dials ask for what it cannot have."""
        model = self.models[dials.model or next(iter(self.models))]
        scene = _with_patches(model(dials), dials.patches)
        x, y, z = (dials.quadrature if n > 1 else 1 for n in scene.orders)
        return scene if (x, y, z) == scene.orders else replace(scene, quadrature=(x, y, z))


def _with_patches(scene: Scene, name: str) -> Scene:
    if not name:
        return scene
    multiplier, _, kind = name.partition(": ")
    new: Any = {
        "one per element": lambda: None,
        "one": lambda: np.zeros(len(scene.mesh.cells), dtype=int),
        "columns along x": lambda: patches.columns(scene.mesh, "x"),
        "pairs along r": lambda: np.arange(len(scene.mesh.cells)) // 2,
        "blocks": lambda: patches.blocks(scene.mesh),
    }[kind]()
    return replace(scene, p_patches=new) if multiplier == "p" else replace(scene, q_patches=new)


# The sample: T0 = 5 kPa, where the homogeneous state of a mesh is stable, too.
_A_OVER_D = 0.2
_STRETCH = (1.2, 1.2)


def _solve_sample(scene: Scene, T0: Any, settings: Settings) -> Pair:
    A = contract(scene, T0=T0, a_over_D=_A_OVER_D, settings=settings, throw=False)
    ties = (conditions.Stretch(axis, value) for axis, value in zip("xy", _STRETCH, strict=True))
    return A, _loaded(A, *ties, settings=settings)


def _read_sample(scene: Scene, states: Pair) -> Array:
    A, C = states
    return jnp.stack([A.mean("stretches")[2], C.mean("cauchy")[0, 0]])


def _exact_sample() -> tuple[float, ...]:
    found = exact.sample(Muscle(TABLE1, 5.0, 1.0, _A_OVER_D), _STRETCH, near=(-0.12, -0.015, 3.4))
    return float(found.stretches[2]), found.sigma11


# The paper's tube at full activation.
_T0, _PRESSURE = 15.0, 18.0


def _solve_tube(scene: Scene, T0: Any, settings: Settings, pressure: float = _PRESSURE) -> Pair:
    A = contract(scene, T0=T0, a_over_D=_A_OVER_D, settings=settings, throw=False)
    return A, _loaded(A, conditions.Pressure("inner", pressure), settings=settings)


def _loaded(A: State, *given: Any, settings: Settings) -> State:
    """State C of an A that converged, or A itself, whose status says what happened."""
    follows = tracing.is_traced(A.status) or bool(A.converged)
    return load(A, *given, settings=settings, throw=False) if follows else A


def _read_tube(scene: Scene, states: Pair) -> Array:
    """Outer radius [mm] and height over that of the state P [–] of state C; means over the nodes of the faces."""
    mesh, u = scene.mesh, states[1].u
    outer, top = np.unique(mesh.face("outer")), np.unique(mesh.face("z1"))
    if mesh.coordinates.curved:
        radius = mesh.points[outer, 0] + u[outer, 0]
    else:
        place = mesh.points[outer, :2] + u[outer, :2]
        radius = jnp.sqrt(jnp.sum(place**2, axis=1))
    return jnp.stack([jnp.mean(radius), 1.0 + jnp.mean(u[top, 2]) / float(mesh.extent[2])])


@cache
def _exact_tube() -> tuple[float, ...]:
    near = exact_tube.Pair(exact_tube.Wall(1.55, 0.98, 6.6), exact_tube.Wall(3.3492, 0.7059))
    found = exact_tube.pair(Muscle(TABLE1, _T0, 1.0, _A_OVER_D), "uniform", _PRESSURE, near).C
    return found.ro, found.height


_TUBE_OUTPUTS = (("outer radius", "mm"), ("height ratio", "–"))


def _radial(dials: Dials) -> Scene:
    return radial_tube(dials.elements, grading=dials.grading)


def _axisymmetric(dials: Dials) -> Scene:
    return axisymmetric_tube((dials.elements, max(1, dials.elements // 4)), grading=dials.grading)


def _sector(dials: Dials, cartesian: bool) -> Scene:
    n = dials.elements
    elements = (n, n, max(1, n // 2)) if cartesian else (n, 2, 2)
    return tube_sector(elements, cartesian=cartesian, grading=dials.grading)


# A block between clamps: W = ½ (I1 − 3) + (I4 − 1)² kPa, stretched by 1.2.


def _block_law(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    return 0.5 * constants["mu"] * (I1(C) - 3.0) + constants["k"] * (I4(C, frame) - 1.0) ** 2


def _block(dials: Dials) -> Scene:
    clamps = tuple(conditions.Displacement(face, axis) for face in ("x0", "x1") for axis in "xyz")
    n = dials.elements
    return Scene(box((1.0, 1.0, 1.0), (n, n, n)), _block_law, {"mu": 1.0, "k": 1.0}, supports=clamps)


def _solve_block(scene: Scene, pull: Any, settings: Settings) -> Pair:
    A = contract(scene, T0=0.0, a_over_D=None, beta=0.0, settings=settings, throw=False)
    return A, _loaded(A, conditions.Displacement("x1", "x", pull), settings=settings)


def _read_block(scene: Scene, states: Pair) -> Array:
    """Reaction of the clamp [mN], and displacement of the middle of the face y1 towards the inside [mm]."""
    points = scene.mesh.points
    middle = np.flatnonzero((points[:, 1] == 1.0) & (np.abs(points[:, [0, 2]] - 0.5) < 1e-9).all(axis=1))
    return jnp.stack([states[1].reaction("x1")[0], -jnp.mean(states[1].u[middle, 1])])


# A tube whose fibres turn from +60° inside to −60° outside, and which is free to twist.
HELIX = exact.Helix(RI, RO, float(np.radians(60.0)), float(np.radians(-60.0)))
_HELIX_PRESSURE = 8.0


def _helix(dials: Dials) -> Scene:
    return radial_tube(dials.elements, grading=dials.grading, twist=True, fibre=HELIX.fibre, cross=HELIX.cross)


def _read_helix(scene: Scene, states: Pair) -> Array:
    """Outer radius [mm] and the twist of the whole tube [rad] of state C."""
    u, top = states[1].u, np.unique(scene.mesh.face("z1"))
    outer = np.unique(scene.mesh.face("outer"))
    return jnp.stack([RO + jnp.mean(u[outer, 0]), jnp.mean(u[top, 1])])


@cache
def _exact_helix() -> tuple[float, ...]:
    near = exact.Twisted(1.38, 0.98, 0.08, 2.0), exact.Twisted(3.07, 0.85, 0.043)
    found = exact.helix_tube(HELIX, Muscle(TABLE1, _T0, 1.0, _A_OVER_D), _HELIX_PRESSURE, *near)
    ro = np.sqrt(found.ri**2 + (RO**2 - RI**2) / found.height)
    return float(ro), found.twist * HEIGHT


_TUBE_MODELS: dict[str, Callable[[Dials], Scene]] = {
    "1-D": _radial,
    "2-D": _axisymmetric,
    "3-D, r φ z": partial(_sector, cartesian=False),
    "3-D, x y z": partial(_sector, cartesian=True),
}


def _tube(name: str, title: str, own: str) -> Body:
    models = {own: _TUBE_MODELS[own]} | _TUBE_MODELS
    return Body(name, title, _TUBE_OUTPUTS, models, _solve_tube, _T0, _read_tube, _exact_tube)


#: Name → body.
BODIES = {
    body.name: body
    for body in (
        Body(
            "sample",
            "Thin sample (0-D), T0 = 5 kPa, a/D = 0.2, stretched by 1.2 both ways",
            (("stretch λn of A", "–"), ("stress σ11 of C", "kPa")),
            {
                "0-D": lambda dials: thin_sample(),
                "3-D": lambda dials: thin_sample(elements=(dials.elements, dials.elements, 1)),
            },
            _solve_sample,
            5.0,
            _read_sample,
            _exact_sample,
        ),
        _tube("radial", "Radial tube (1-D), T0 = 15 kPa, a/D = 0.2, 18 kPa inside", "1-D"),
        _tube("axisymmetric", "Axisymmetric tube (2-D), the same state", "2-D"),
        _tube("sector", "Sector of the tube (3-D, straight-edged hexahedra), the same state", "3-D, x y z"),
        Body(
            "block",
            "Clamped block (3-D), ½ (I1 − 3) + (I4 − 1)² kPa, stretched by 1.2",
            (("reaction", "mN"), ("contraction of the middle", "mm")),
            {"3-D": _block},
            _solve_block,
            0.2,
            _read_block,
            None,
        ),
        Body(
            "helix",
            "Tube with fibres from +60° inside to −60° outside (1-D and twist), T0 = 15 kPa, a/D = 0.2, 8 kPa inside",
            (("outer radius", "mm"), ("twist", "rad")),
            {"1-D": _helix},
            partial(_solve_tube, pressure=_HELIX_PRESSURE),
            _T0,
            _read_helix,
            _exact_helix,
        ),
    )
}
