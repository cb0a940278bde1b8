"""Checkerboards of p and q, and how they go: a sheet of muscle whose fibres turn, on finer and finer meshes.

A sheet of 10 × 10 × 1 mm is contracted freely, then stretched by 1.2 along x. Its fibres are along x on the planes of
symmetry x = 0 and y = 0, and turn by up to `TURN` degrees towards the corner between the other edges, so that p, q and
the tensions vary smoothly, and nothing varies through the thickness.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxmyo.conditions import Proportional, Stretch, Symmetry, Uniform
from jaxmyo.constants import TABLE1
from jaxmyo.energies import lin_yin
from jaxmyo.mesh import Mesh, box
from jaxmyo.patches import blocks
from jaxmyo.scene import Scene
from jaxmyo.solve import contract, load
from jaxmyo.stability.independent import Array
from jaxmyo.status import Status

LENGTH, TURN, STRETCH = 10.0, 60.0, 1.2  # mm, degrees, –
T0, A_OVER_D = 2.0, 0.2  # kPa, –
#: Cells along an edge over whose means fields on different meshes are compared.
CELLS = 8

Patches = NDArray[np.int64] | None

#: Kinds of patches of p and q.
KINDS: dict[str, Callable[[Mesh], tuple[Patches, Patches]]] = {
    "p, q per element": lambda mesh: (None, None),
    "p, q per 2×2 block": lambda mesh: (blocks(mesh), blocks(mesh)),
    "p per 2×2 block, q per 16th": lambda mesh: (blocks(mesh), _parts(mesh, 4)),
}
CURE = "p per 2×2 block, q per 16th"


class Sheet(NamedTuple):
    """A contracted sheet of n × n elements: fields (n, n) [kPa], x along the first axis, and its status.

    cauchy: along x; cauchy_C: of the stretched sheet, NaN where that was not found;
    rough_p, rough_q: root mean square of what differs from the mean of neighbouring patches [kPa], see `roughness`.
    """

    kind: str
    n: int
    status: int
    p: Array
    q: Array
    T_f: Array
    T_cf: Array
    cauchy: Array
    cauchy_C: Array
    rough_p: float
    rough_q: float
    negative_eigenvalues: int


def sheet(kind: str, n: int) -> Sheet:
    """The free contraction on n × n elements, with p and q on patches of a kind."""
    mesh = box((LENGTH, LENGTH, 1.0), (n, n, 1))
    p_patches, q_patches = KINDS[kind](mesh)
    flat = (Uniform("x", ("z",)), Uniform("y", ("z",)), Proportional("z", "z"))
    scene = Scene(
        mesh,
        lin_yin,
        TABLE1,
        lambda X: _direction(X, 0.0),
        lambda X: _direction(X, 0.5 * np.pi),
        (Symmetry("x"), Symmetry("y"), *flat),
        (2, 2, 1),
        p_patches,
        q_patches,
    )
    A = contract(scene, T0=T0, a_over_D=A_OVER_D, throw=False)
    loaded = np.full((n, n), np.nan)
    if A.converged:
        C = load(A, Stretch("x", STRETCH), throw=False)
        loaded = np.where(C.converged, C.cauchy[:, :, 0, 0].mean(axis=1).reshape(n, n), loaded)
    of_p, of_q = np.asarray(A.p)[scene.p_patches], np.asarray(A.q)[scene.q_patches]
    p, q, T_f, T_cf, cauchy = (
        np.asarray(field).reshape(n, n)
        for field in (of_p, of_q, A.T_f.mean(axis=1), A.T_cf.mean(axis=1), A.cauchy[:, :, 0, 0].mean(axis=1))
    )
    sizes = [1 if patches is None else 2 for patches in (p_patches, q_patches)]
    rough = [roughness(field[::size, ::size]) for field, size in zip((p, q), sizes, strict=True)]
    negative = int(A.negative_eigenvalues)
    return Sheet(kind, n, int(A.status), p, q, T_f, T_cf, cauchy, loaded, rough[0], rough[1], negative)


def roughness(field: Array) -> float:
    """Root mean square of a field (n, n) less its binomial mean over 3 × 3 neighbours, (1, 2, 1)/4 along both axes.

    It keeps what alternates from one to the next, and vanishes with the square of their distance for a smooth field.
    """

    def mean(f: Array) -> Array:
        return np.asarray(0.25 * (f[:-2] + 2.0 * f[1:-1] + f[2:]))

    smooth = mean(mean(field).T).T
    return float(np.sqrt(np.mean((field[1:-1, 1:-1] - smooth) ** 2)))


def orders(sheets: list[Sheet], field: str) -> tuple[list[float], float]:
    """Relative L2 differences between each mesh of a kind and the next, each twice as fine, and the order they show.

    Of the means over `CELLS`² cells. The order is log2 of the ratio of the last two differences; NaN where some failed.
    """
    means = [_means(getattr(s, field)) for s in sheets]
    if any(s.status != Status.CONVERGED for s in sheets) or not np.isfinite(means).all():
        return [], float("nan")
    size = np.sqrt(np.mean(means[-1] ** 2))
    differences = [float(np.sqrt(np.mean((a - b) ** 2)) / size) for a, b in pairwise(means)]
    return differences, float(np.log2(differences[-2] / differences[-1])) if len(differences) > 1 else float("nan")


def _means(field: Array) -> Array:
    m = len(field) // CELLS
    return field.reshape(CELLS, m, CELLS, m).mean(axis=(1, 3))


def measure(quick: bool, done: Callable[[str], None]) -> list[Sheet]:
    """The sheets of all kinds; done: is told each."""
    found = []
    for kind in KINDS:
        for n in (24,) if quick else (16, 32, 64):
            found.append(sheet(kind, n))
            done(f"sheet with {kind}, {n} × {n} elements")
    return found


def _direction(X: Array, more: float) -> Array:
    turn = np.radians(TURN) * np.sin(0.5 * np.pi * X[:, 0] / LENGTH) * np.sin(0.5 * np.pi * X[:, 1] / LENGTH) + more
    return np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)


def _parts(mesh: Mesh, m: int) -> NDArray[np.int64]:
    assert mesh.grid is not None
    return blocks(mesh, (mesh.grid[0] // m, mesh.grid[1] // m, 1))
