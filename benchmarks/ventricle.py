"""A ventricle: filled and contracted with the Guccione law; and what the weave does to it with the Lin–Yin law.

The cavity has the half axes 7 and 17 mm, the wall is 3 mm thick at the equator, which is the base; fibres go from +60°
inside to −60° outside, and the base slides in its plane. `python benchmarks/ventricle.py` runs every part, or those
that it is told: passive, body, active, patches, weave, mesh.
"""

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

import jaxmyo as jm
from jaxmyo import solve
from jaxmyo.coordinates import evaluate

solve.LARGE = 0  # sparse factors for all meshes: only the elements are compiled, which is most of the time here

VENTRICLE = jm.Ventricle.from_axes(short_endo=7.0, long_endo=17.0, short_epi=10.0)
#: Thickness of the wall at the equator [mm].
WALL = 3.0
#: Elements through the wall and from the apex to the base.
MESHES = [(2, 8), (4, 16), (8, 32)]
#: Elements through the wall, from the square at the apex to the base, around.
BODIES = [(1, 2, 8), (2, 4, 16), (4, 8, 32)]
#: Pressures of the Guccione ventricle, filled and contracted, and its beating tension [kPa].
FILLED, HELD, GUCCIONE_T0 = 2.0, 1.0, 10.0
#: End-diastolic pressure of the Lin–Yin ventricle [kPa]; its end-systolic one is T0 times `SHARE`.
DIASTOLE, SHARE = 0.5, 0.15
TENSIONS = (5.0, 15.0, 35.0)
WEAVES = (None, 0.1, 0.2)


def cavity(pressure: float) -> jm.Pressure:
    """The pressure [kPa] in the closed cavity."""
    return jm.Pressure("endo", pressure, ends="closed")


def guccione(elements: tuple[int, ...], **options: Any) -> jm.Scene:
    """The ventricle with the Guccione law: two counts for the body of revolution, three for the Cartesian body."""
    make: Callable[..., jm.Scene] = jm.axisymmetric_ventricle if len(elements) == 2 else jm.ventricle_body
    return make(VENTRICLE, elements, law=jm.guccione, constants=jm.LAND_ACTIVE, **options)


def positions(state: jm.State) -> np.ndarray:
    """Deformed nodes (n, 3) in Cartesian coordinates [mm]."""
    mesh = state.scene.mesh
    return evaluate(mesh.coordinates.position, np.asarray(mesh.points + state.u))


def apex(state: jm.State) -> float:
    """Height z [mm] of the inner apex."""
    mesh = state.scene.mesh
    nodes = np.unique(mesh.face("endo"))
    rest = evaluate(mesh.coordinates.position, mesh.points)[nodes]
    return float(positions(state)[nodes[np.argmax(rest[:, 2])], 2])


def wall(state: jm.State) -> float:
    """Thickness [mm] of the wall at the base, in the plane of the equator; of a body of revolution."""
    mesh, x = state.scene.mesh, positions(state)
    radius = [np.hypot(*x[np.intersect1d(mesh.face("base"), mesh.face(name)), :2].T).mean() for name in ("endo", "epi")]
    return float(radius[1] - radius[0])


def thickening(state: jm.State) -> float:
    """Thickness of the wall over that at rest [–], (n · C⁻¹ n)^(−½) with the normal n of the wall: a volume mean."""
    n = np.asarray(state.system.frame)[:, :, 2]
    weight = np.asarray(state.system.weight)
    inverse = np.linalg.inv(np.asarray(state.C))
    return float(np.sum(weight / np.sqrt(np.einsum("egi,egij,egj->eg", n, inverse, n))) / weight.sum())


def work_of_pressure(start: jm.State, volume: float, points: int = 6) -> float:
    """∫ P dV [µJ] of a filling from a state without load to a cavity of that volume [mm³], by Gauss's rule in V.

    The volume is prescribed at each of the points; the pressure is read off.
    """
    begin = float(start.cavity_volume("endo"))
    at, weight = np.polynomial.legendre.leggauss(points)
    pressures, state = [], None
    for V in begin + 0.5 * (1.0 + at) * (volume - begin):
        state = jm.load(start, jm.Volume("endo", float(V)), start=state)
        pressures.append(float(state.cavity_pressures[0]))
    return float(0.5 * (volume - begin) * weight @ np.array(pressures))


def orders(values: Sequence[float]) -> list[float]:
    """Observed orders of meshes that are halved, from every three successive values."""
    steps = np.abs(np.diff(values))
    return [float(np.log2(a / b)) for a, b in pairwise(steps)]


def limit(values: Sequence[float]) -> float:
    """Richardson's extrapolation of the last two values, at second order."""
    return values[-1] + (values[-1] - values[-2]) / 3.0


def passive(meshes: Sequence[tuple[int, ...]]) -> None:
    """Filling: volume, apex, energy balance."""
    print(f"\nGuccione, passive, {FILLED:g} kPa")
    print(f"{'elements':>12} {'unknowns':>9} {'V mm³':>11} {'apex mm':>9} {'∫W µJ':>10} {'∫P dV − ∫W':>11} {'s':>6}")
    volumes, heights = [], []
    for elements in meshes:
        begin = time.perf_counter()
        rest = jm.contract(guccione(elements), T0=0.0, a_over_D=None)
        filled = jm.load(rest, cavity(FILLED))
        volumes.append(float(filled.cavity_volume("endo")))
        heights.append(apex(filled))
        stored = float(filled.stored_energy)
        off = work_of_pressure(rest, volumes[-1]) / stored - 1.0
        seconds = time.perf_counter() - begin
        print(
            f"{elements!s:>12} {filled.system.size:9d} {volumes[-1]:11.3f} {heights[-1]:9.4f} {stored:10.2f} "
            f"{off:11.1e} {seconds:6.1f}",
            flush=True,
        )
    if len(meshes) > 1:
        print(f"{'h → 0':>12} {'':9} {limit(volumes):11.3f} {limit(heights):9.4f}")
    print(f"orders: volume {orders(volumes)}, apex {orders(heights)}")


def active(meshes: Sequence[tuple[int, ...]]) -> None:
    """Contraction at a fixed pressure: the passive and the active cavity."""
    print(f"\nGuccione, {HELD:g} kPa, passive and with a beating tension of {GUCCIONE_T0:g} kPa")
    print(f"{'elements':>12} {'V passive':>10} {'V active':>10} {'apex mm':>9} {'wall mm':>8} {'unstable':>8} {'s':>6}")
    for elements in meshes:
        begin = time.perf_counter()
        scene = guccione(elements)
        passive = jm.load(jm.contract(scene, T0=0.0, a_over_D=None), cavity(HELD))
        A = jm.contract(scene, T0=GUCCIONE_T0, a_over_D=None, throw=False)
        C = jm.load(A, cavity(HELD), throw=False) if A.converged else A
        volumes = [float(state.cavity_volume("endo")) for state in (passive, C)]
        print(
            f"{elements!s:>12} {volumes[0]:10.3f} {volumes[1]:10.3f} {apex(C):9.4f} {wall(C):8.4f} "
            f"{int(C.negative_eigenvalues):8d} {time.perf_counter() - begin:6.1f}",
            "" if C.converged else C.message.split(" (")[0],
            flush=True,
        )


@dataclass
class Beat:
    """The free contraction A, end diastole and end systole of one beat; NaN for a state that was not found.

    V: volumes of the cavity [mm³]; wall: its thickness at the equator [mm]; mean: its mean thickness over that at rest;
    cross: mean cross-fibre stress at end systole [kPa]; tension: mean T_A^cf of A [kPa]; q: least and largest [kPa];
    unstable: negative eigenvalues.
    """

    V: list[float]
    wall: list[float]
    mean: list[float]
    cross: float
    tension: float
    q: tuple[float, float]
    unstable: list[int]
    messages: list[str]


def beat(scene: jm.Scene, T0: float, a_over_D: float | None, P: float) -> Beat:
    """A beat of the Lin–Yin ventricle: at rest filled passively; contracted, then loaded.

    T0: beating tension; P: end-systolic pressure [kPa]. The end systole is loaded from A: a straight path from the end
    diastole, activation and pressure together, comes to a limit point, since a constant tension holds less pressure in
    a wide cavity than in a narrow one.
    """
    rest = jm.contract(scene, T0=0.0, a_over_D=None, beta=0.0)
    A = jm.contract(scene, T0=T0, a_over_D=a_over_D, throw=False)
    diastole = jm.load(rest, cavity(DIASTOLE), throw=False)
    systole = jm.load(A, cavity(P), throw=False) if A.converged else A
    states = [s if s.converged else None for s in (A, diastole, systole)]
    return Beat(
        V=[float(s.cavity_volume("endo")) if s else np.nan for s in states],
        wall=[wall(s) if s else np.nan for s in states],
        mean=[thickening(s) if s else np.nan for s in states],
        cross=float(systole.mean("cauchy_fibre")[1, 1]) if systole.converged else np.nan,
        tension=float(A.mean("T_cf")) if A.converged else np.nan,
        q=(0.0, 0.0) if A.q is None else (float(A.q.min()), float(A.q.max())),
        unstable=[int(s.negative_eigenvalues) if s else -1 for s in states],
        messages=[s.message.split(" (")[0] for s in (A, diastole, systole) if not s.converged],
    )


HEAD = (
    f"{'elements':>9} {'T0':>4} {'a/D':>5} {'P_ES':>5} | {'V_A':>7} {'V_ED':>7} {'V_ES':>7} {'EF %':>6} | "
    f"{'at equator %':>15} {'mean %':>15} | {'σcf':>7} {'T_Acf':>6} | {'q':>15} | unstable      s"
)


def row(elements: tuple[int, int], T0: float, a_over_D: float | None, P: float | None = None, **options: Any) -> Beat:
    """Compute and print one beat. At the equator and in the mean: how much the wall thickens [%] from rest to the free
    contraction A, and from end diastole to end systole."""
    begin = time.perf_counter()
    P = SHARE * T0 if P is None else P
    b = beat(jm.axisymmetric_ventricle(VENTRICLE, elements, **options), T0, a_over_D, P)
    name = "–" if a_over_D is None else f"{a_over_D:g}"
    A, d, s = b.V
    equator = 100 * (b.wall[0] / WALL - 1), 100 * (b.wall[2] / b.wall[1] - 1)
    mean = 100 * (b.mean[0] - 1), 100 * (b.mean[2] / b.mean[1] - 1)
    print(
        f"{elements!s:>9} {T0:4g} {name:>5} {P:5.3g} | {A:7.1f} {d:7.1f} {s:7.1f} {100 * (1 - s / d):6.2f} | "
        f"{equator[0]:7.2f} {equator[1]:7.2f} {mean[0]:7.2f} {mean[1]:7.2f} | {b.cross:7.3f} {b.tension:6.3f} | "
        f"{b.q[0]:7.2f} {b.q[1]:7.2f} | {b.unstable} {time.perf_counter() - begin:6.1f}",
        *b.messages,
        flush=True,
    )
    return b


def weave(elements: tuple[int, int]) -> None:
    """The beats of the Lin–Yin ventricle with and without the weave, beside the 16 % of the paper."""
    print(f"\nLin–Yin, end-diastolic pressure {DIASTOLE:g} kPa, end-systolic {SHARE:g} T0; one q per column")
    print(HEAD)
    for T0 in TENSIONS:
        found = {a: row(elements, T0, a) for a in WEAVES}
        without = found[None]
        for a in WEAVES[1:]:
            b = found[a]
            walls = [100 * (x / y - 1) for x, y in zip(b.wall + b.mean, without.wall + without.mean, strict=True)]
            print(
                f"  the wall with a/D = {a:g} beside without: free {walls[0]:+.2f} % (mean {walls[3]:+.2f} %), "
                f"end-systolic {walls[2]:+.2f} % (mean {walls[5]:+.2f} %)"
            )
    print("  the paper: 16 %, of the free contraction of a thin sample (T0 = 35 kPa, a/D = 0.2)")


def meshes(T0: float = 35.0) -> None:
    """One beat on three meshes."""
    print("\nThe same under refinement\n" + HEAD)
    for a in (None, 0.2):
        found = [row(elements, T0, a) for elements in MESHES]
        V, walls = [b.V[2] for b in found], [b.wall[2] for b in found]
        print(f"  h → 0: V_ES {limit(V):.1f} mm³, order {orders(V)[0]:.2f}; wall {limit(walls):.4f} mm")


def patches(T0: float = 5.0) -> None:
    """The number of q through the wall, under refinement: one for the column, some, one per element."""
    print("\nq through the wall\n" + HEAD)
    for per_column in (1, 2, 4, None):
        print(f"{'one per element' if per_column is None else per_column}")
        for elements in MESHES:
            if per_column is None or per_column <= elements[0]:
                row(elements, T0, 0.2, q_patches=per_column)


PARTS: dict[str, Callable[[], None]] = {
    "passive": lambda: passive(MESHES),
    "body": lambda: passive(BODIES),
    "active": lambda: active([*MESHES, *BODIES[1:]]),
    "patches": patches,
    "weave": lambda: weave(MESHES[1]),
    "mesh": meshes,
}


if __name__ == "__main__":
    for name in sys.argv[1:] or PARTS:
        PARTS[name]()
