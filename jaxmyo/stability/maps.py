"""Maps of the extremes: a plane of two inputs, a status at each point of it.

All points of the sample, and of the tube, go through the program that solves the random problems; slabs and distorted
elements through that of the solids. So a map costs a moment.
"""

from collections.abc import Callable
from dataclasses import astuple
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from jaxmyo.constants import TABLE1
from jaxmyo.newton import Settings
from jaxmyo.scenes import thin_sample
from jaxmyo.scenes.tube import HEIGHT, RI, RO
from jaxmyo.solve import contract
from jaxmyo.stability.independent import Array
from jaxmyo.stability.problems import MODULI, WALL, Problems
from jaxmyo.stability.random_problems import solve
from jaxmyo.stability.solids import Solids, place, solve_solids
from jaxmyo.status import Status

#: Points along the axes: as many as one call of a program solves.
NX, NY = 25, 20
T0, A_OVER_D, STRETCH = 35.0, 0.2, 1.2  # kPa, –, –: of what a map does not vary
TUBE_T0, TUBE_P = 15.0, 18.0  # kPa
PLAIN = np.array(astuple(TABLE1), dtype=float)


class Axis(NamedTuple):
    """One input: its name, its unit, its values, and whether they are spread by their logarithms."""

    name: str
    unit: str
    values: Array
    log: bool = False


class Map(NamedTuple):
    """status: (len(x.values), len(y.values)), of the state A where that fails, else of the state C.

    error: like it, or None: what a map of an approximation shows besides.
    """

    name: str
    title: str
    x: Axis
    y: Axis
    status: NDArray[np.int64]
    error: Array | None = None

    @property
    def converged(self) -> float:
        """The share of the points that converge."""
        return float(np.mean(self.status == Status.CONVERGED))


def measure(quick: bool, done: Callable[[str], None]) -> list[Map]:
    """All maps; quick: those that need no program of their own; done: is told each."""
    tension = Axis("T0", "kPa", np.linspace(0.0, 500.0, NX))
    thickness = Axis("wall thickness / inner radius", "–", np.logspace(-3.0, 4.0, NY), log=True)
    scale = Axis("factor of all moduli", "–", np.logspace(-6.0, 6.0, NX), log=True)
    weak = Axis("T0", "kPa", np.concatenate([[0.0], np.logspace(-3.0, np.log10(500.0), NY - 1)]))
    maps = []

    def add(name: str, title: str, x: Axis, y: Axis, make: Callable[[Array, Array], tuple[str, Problems]]) -> None:
        at_x, at_y = (v.ravel() for v in np.meshgrid(x.values, y.values, indexing="ij"))
        kind, problems = make(at_x, at_y)
        A, C = solve(kind, True, problems)
        status = np.where(A.status == Status.CONVERGED, C.status, A.status).reshape(len(x.values), len(y.values))
        maps.append(Map(name, title, x, y, status))
        done(f"map of {title}")

    add(
        "activation",
        "sample: free contraction, then stretched to 1.2 both ways",
        tension,
        Axis("a/D", "–", np.linspace(0.0, 0.25, NY)),
        lambda x, y: ("sample", _sample(len(x), T0=x, a_over_D=y)),
    )
    stretch = [
        Axis(f"stretch {where} the fibres", "–", np.linspace(0.4, 2.5, n))
        for where, n in (("along", NX), ("across", NY))
    ]
    add(
        "stretches",
        "sample: contracted, then stretched",
        stretch[0],
        stretch[1],
        lambda x, y: ("sample", _sample(len(x), target=np.column_stack([x, y]))),
    )
    add(
        "constants",
        "sample: units of the moduli mistaken",
        scale,
        weak,
        lambda x, y: ("sample", _sample(len(x), T0=y, scale=np.log10(x))),
    )
    pressure = Axis("pressure", "kPa", np.linspace(0.0, 60.0, NX))
    add(
        "pressure",
        "tube of the paper: contracted, then inflated",
        pressure,
        Axis("T0", "kPa", np.linspace(0.0, 60.0, NY)),
        lambda x, y: ("tube", _tube(len(x), target=x[:, None], T0=y)),
    )
    add(
        "wall",
        "tube: walls from a membrane to a solid cylinder",
        pressure,
        thickness,
        lambda x, y: ("tube", _tube(len(x), target=x[:, None], thickness=y)),
    )
    add(
        "tube_constants",
        "tube: units of the moduli mistaken, at 18 kPa",
        scale,
        weak,
        lambda x, y: ("tube", _tube(len(x), T0=y, scale=np.log10(x))),
    )
    if quick:
        return maps
    maps.append(_shapes())
    done("map of slabs and distorted elements")
    maps += [_precision(name, tension) for name in ("float32", "mixed")]
    done("maps of precision")
    return maps


def _sample(n: int, **given: Any) -> Problems:
    plain: dict[str, Any] = {"T0": T0, "beta": 1.0, "a_over_D": A_OVER_D, "scale": 0.0}
    values = {
        name: np.broadcast_to(np.asarray(given.get(name, value), dtype=float), n) for name, value in plain.items()
    }
    target = given.get("target", np.full((n, 2), STRETCH))
    constants = PLAIN * np.where(MODULI > 0.0, 10.0 ** values["scale"][:, None], 1.0)
    return Problems(constants, **values, target=target, R=np.zeros((n, 0)), H=np.ones(n))


def _tube(n: int, **given: Any) -> Problems:
    thickness = np.broadcast_to(np.asarray(given.pop("thickness", RO / RI - 1.0), dtype=float), n)
    problems = _sample(n, **({"T0": TUBE_T0, "target": np.full((n, 1), TUBE_P)} | given))
    # The outer radius stays within twice that of the paper: thin walls at Ri, thick ones around a thin hole.
    Ri = RI * np.minimum(1.0, 1.0 / thickness)
    R = Ri[:, None] * (1.0 + thickness[:, None] * np.linspace(0.0, 1.0, WALL + 1))
    return problems._replace(R=R, H=np.full(n, HEIGHT))


def _shapes() -> Map:
    """Slabs of 2×2×1 elements, homogeneous states, with an inner edge that moves until a corner has no volume."""
    aspect = Axis("thickness / edge of a slab", "–", np.logspace(-3.0, 0.0, 20), log=True)
    distortion = Axis(
        "distortion (1: det J = 0 at a corner)", "–", np.array([0.0, 0.3, 0.6, 0.9, 0.99, 0.999, 1.0, 1.3, 1.6, 1.9])
    )
    x, y = (v.ravel() for v in np.meshgrid(aspect.values, distortion.values, indexing="ij"))
    fibre = np.tile([1.0, 0.0, 0.0], (len(x), 4, 1))
    A, C = solve_solids(Solids(_sample(len(x), T0=5.0), place(x, y, 0), fibre))
    status = np.where(A.status == Status.CONVERGED, C.status, A.status)
    title = "slab of 2×2×1 elements, T0 = 5 kPa, stretched to 1.2 both ways"
    return Map("shapes", title, aspect, distortion, status.reshape(20, 10))


def _precision(name: str, tension: Axis) -> Map:
    """The free contraction in another precision, and how far its stretches are off those in float64."""
    scene = thin_sample()
    ratio = Axis("a/D", "–", np.linspace(0.0, 0.25, NY))
    x, y = (v.ravel() for v in np.meshgrid(tension.values, ratio.values, indexing="ij"))

    def states(settings: Settings) -> tuple[Any, Any]:
        def one(T0: Any, a_over_D: Any) -> tuple[Any, Any]:
            A = contract(scene, T0=T0, a_over_D=a_over_D, settings=settings, throw=False)
            return A.status, A.mean("stretches")

        status, stretches = jax.jit(jax.vmap(one))(x, y)
        return np.asarray(status), np.asarray(stretches)

    _, exact = states(Settings())
    status, found = states(Settings(precision=name))
    error = np.max(np.abs(found - exact), axis=1)
    shape = len(tension.values), len(ratio.values)
    return Map(name, f"sample: free contraction in {name}", tension, ratio, status.reshape(shape), error.reshape(shape))
