"""A left ventricle as a truncated ellipsoid: two confocal ellipsoids about the z axis, cut by a plane.

The apex points to z > 0, as in the coordinates λ, μ, φ of `prolate_spheroidal`; the base is the plane z = `base_z`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmyo import checks
from jaxmyo.coordinates import CARTESIAN, Coordinates, prolate_spheroidal
from jaxmyo.mesh import Mesh, structured

#: A direction as a function of points (n, 3) ↦ (n, 3).
Direction = Callable[[NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True)
class Ventricle:
    """The shape: the wall lambda_endo ≤ λ ≤ lambda_epi, z ≥ base_z.

    focus: focal distance d of all the ellipsoids [mm]; their half axes are d sinh λ, across, and d cosh λ, along z.
    base_z: the plane of the base [mm]; 0 is the equator, negative values leave more than half an ellipsoid.
    Errors: a ValueError unless 0 < lambda_endo < lambda_epi, and for a base that does not cut the cavity.
    """

    focus: float
    lambda_endo: float
    lambda_epi: float
    base_z: float = 0.0

    def __post_init__(self) -> None:
        for name in ("focus", "lambda_endo", "lambda_epi", "base_z"):
            object.__setattr__(self, name, float(checks.concrete(name, getattr(self, name), ())))
        if self.focus <= 0.0:
            raise ValueError(f"focus = {self.focus} must be a positive length (mm)")
        if not 0.0 < self.lambda_endo < self.lambda_epi:
            raise ValueError(
                f"lambda_endo = {self.lambda_endo}, lambda_epi = {self.lambda_epi} must be 0 < λ_endo < λ_epi (–)"
            )
        limit = self.focus * np.cosh(self.lambda_endo)
        if not abs(self.base_z) < limit:
            raise ValueError(
                f"base_z = {self.base_z} does not cut the cavity; it must be in ({-limit:g}, {limit:g}) mm"
            )

    @classmethod
    def from_axes(cls, short_endo: float, long_endo: float, short_epi: float, base_z: float = 0.0) -> "Ventricle":
        """From half axes [mm] across and along z of the cavity, and across of the outside.

        The outer ellipsoid is confocal: its half axis along z is (short_epi² + long_endo² − short_endo²)^½.
        Error: a ValueError unless 0 < short_endo < long_endo and short_endo < short_epi.
        """
        if not 0.0 < short_endo < min(long_endo, short_epi):
            raise ValueError(
                f"short_endo = {short_endo} must be > 0, below long_endo = {long_endo} and short_epi = {short_epi} (mm)"
            )
        focus = float(np.sqrt(long_endo**2 - short_endo**2))
        return cls(focus, float(np.arcsinh(short_endo / focus)), float(np.arcsinh(short_epi / focus)), base_z)

    @property
    def coordinates(self) -> Coordinates:
        """The prolate spheroidal coordinates λ, μ, φ with this focus."""
        return prolate_spheroidal(self.focus)

    def mu_base(self, lam: Any) -> NDArray[np.float64]:
        """The coordinate μ [rad] of the base on the ellipsoids λ."""
        return np.arccos(self.base_z / (self.focus * np.cosh(lam)))

    def enclosed(self, lam: float) -> float:
        """The volume [mm³] inside the ellipsoid λ and above the base: of the cavity, with lambda_endo."""
        short, long = self.focus * np.sinh(lam), self.focus * np.cosh(lam)
        return float(np.pi * short**2 * (2.0 * long / 3.0 - self.base_z + self.base_z**3 / (3.0 * long**2)))


def ventricle_mesh(ventricle: Ventricle, elements: tuple[int, int, int]) -> Mesh:
    """Hexahedra in Cartesian coordinates, also at the apex, where none is degenerate; faces "endo", "epi", "base".

    elements: (through the wall, from the apex to the base, around), the last one 4 m. A square of m × m columns covers
    the apex, and rings of 4 m columns go on from there to the base; nodes are on ellipsoids λ = const. Elements are
    numbered layer by layer from the inside, so that a column through the wall has the numbers e, e + n, e + 2 n, ...,
    with the n = m² + 4 m × (from the apex to the base) elements of a layer.
    Error: a ValueError for a number around that is not a multiple of 4.
    """
    n_wall, n_rings, n_around = checks.counts("elements", elements, 3)
    if n_around % 4:
        raise ValueError(f"elements = {elements}: the number around, {n_around}, must be a multiple of 4")
    disk, quads, rim = _disk(n_around // 4, n_rings)
    lam = np.linspace(ventricle.lambda_endo, ventricle.lambda_epi, n_wall + 1)[:, None]
    mu = np.linalg.norm(disk, axis=1) * ventricle.mu_base(lam)  # (n_wall + 1, n)
    across = ventricle.focus * np.sinh(lam) * ventricle.mu_base(lam) * np.sinc(mu / np.pi)  # sin μ / |disk|
    points = np.concatenate(
        [across[..., None] * disk, (ventricle.focus * np.cosh(lam) * np.cos(mu))[..., None]], axis=-1
    )
    points[:, rim[:, 0], 2] = ventricle.base_z  # exactly
    layers = len(disk) * np.arange(n_wall + 1)[:, None, None]
    lower, upper = quads + layers[:-1], quads + layers[1:]
    inner, outer = rim + layers[:-1], rim[:, ::-1] + layers[1:]
    faces = {
        "endo": quads[:, ::-1],
        "epi": quads + layers[-1],
        "base": np.concatenate([inner, outer], axis=-1).reshape(-1, 4),
    }
    return Mesh(points.reshape(-1, 3), np.concatenate([lower, upper], axis=-1).reshape(-1, 8), faces)


def prolate_mesh(ventricle: Ventricle, elements: tuple[int, int, int], angle: float = 2.0 * np.pi) -> Mesh:
    """A structured mesh in the coordinates of the ventricle; faces "endo", "epi", "base", "apex", "phi0", "phi1".

    elements: along λ, through the wall; μ, from the apex to the base; φ, around, over `angle` [rad].

    The face "apex" is the axis μ = 0, where the scale factor of φ is 0; no Gauss point is there. The elements beside it
    have nodes at one place with different φ, and a full turn has the faces phi0 and phi1 at one place: their
    displacements must be tied, as by Uniform(..., ("phi",)) and Displacement("apex", "mu") in a body of revolution.
    Error: a ValueError for an angle outside (0, 2π].
    """
    n = checks.counts("elements", elements, 3)
    if not 0.0 < angle <= 2.0 * np.pi:
        raise ValueError(f"angle = {angle} must be in (0, 2π] (rad)")
    lam = np.linspace(ventricle.lambda_endo, ventricle.lambda_epi, n[0] + 1)
    mesh = structured([lam, np.linspace(0.0, 1.0, n[1] + 1), np.linspace(0.0, angle, n[2] + 1)])
    points = mesh.points * np.stack(
        [np.ones(len(mesh.points)), ventricle.mu_base(mesh.points[:, 0]), np.ones(len(mesh.points))], axis=1
    )
    names = {"x0": "endo", "x1": "epi", "y0": "apex", "y1": "base", "z0": "phi0", "z1": "phi1"}
    faces = {names[name]: quads for name, quads in mesh.faces.items()}
    return replace(mesh, points=points, faces=faces, coordinates=ventricle.coordinates)


def helix_fibres(
    ventricle: Ventricle, endo: float = 60.0, epi: float = -60.0, coordinates: Coordinates = CARTESIAN
) -> tuple[Direction, Direction]:
    """Fibre f and cross-fibre f⊥ of a helix whose angle is linear in λ through the wall, for `Scene(fibre=, cross=)`.

    endo, epi: the angle [degrees] from the circumference e_φ towards the apex, at the inner and the outer surface;
    positive is a right-handed helix. Both vectors are tangent to the ellipsoids λ = const.; f × f⊥ points outward.
    coordinates: those of the mesh, CARTESIAN or `ventricle.coordinates`; other ones are a ValueError.
    """
    alpha = {"endo": endo, "epi": epi}
    for name, value in alpha.items():
        if not abs(checks.concrete(name, value, ())) <= 90.0:
            raise ValueError(f"{name} = {value} is outside [-90, 90] (degrees)")
    if coordinates not in (CARTESIAN, ventricle.coordinates):
        raise ValueError(f"coordinates must be CARTESIAN or those of the ventricle; got {coordinates.name}")

    def along(turn: float) -> Direction:
        """The vector at `turn` from f in the tangent plane."""

        def direction(points: NDArray[np.float64]) -> NDArray[np.float64]:
            theta = _prolate(ventricle.focus, points) if coordinates is CARTESIAN else points
            depth = (theta[:, 0] - ventricle.lambda_endo) / (ventricle.lambda_epi - ventricle.lambda_endo)
            angle = np.radians(endo + (epi - endo) * depth) + turn
            if coordinates is not CARTESIAN:
                return np.stack([0.0 * angle, -np.sin(angle), np.cos(angle)], axis=1)
            e_mu, e_phi = _tangents(theta)
            return np.cos(angle)[:, None] * e_phi - np.sin(angle)[:, None] * e_mu

        return direction

    return along(0.0), along(0.5 * np.pi)


def _prolate(focus: float, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """λ, μ, φ (n, 3) of Cartesian points off the focal line."""
    rho, z = np.hypot(x[:, 0], x[:, 1]), x[:, 2]
    far, near = np.hypot(rho, z + focus), np.hypot(rho, z - focus)
    lam = np.arccosh(np.maximum((far + near) / (2.0 * focus), 1.0))
    mu = np.arctan2(rho / np.sinh(lam), z / np.cosh(lam))
    return np.stack([lam, mu, np.arctan2(x[:, 1], x[:, 0])], axis=1)


def _tangents(theta: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The unit vectors e_μ, e_φ (n, 3) in Cartesian components."""
    lam, mu, phi = theta.T
    flat, steep = np.sinh(lam) * np.cos(mu), -np.cosh(lam) * np.sin(mu)
    e_mu = np.stack([flat * np.cos(phi), flat * np.sin(phi), steep], axis=1) / np.hypot(flat, steep)[:, None]
    return e_mu, np.stack([-np.sin(phi), np.cos(phi), 0.0 * phi], axis=1)


def _disk(m: int, rings: int) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Quads on the unit disk, m × m in the middle and 4 m in each ring: points (n, 2), quads (k, 4), rim (4 m, 2).

    All counter-clockwise. The square bulges by a third of the way to a circle: three quads of 120° meet at its corners.
    """
    steps = np.linspace(-1.0, 1.0, m + 1)
    s, t = (a.ravel() for a in np.meshgrid(steps, steps, indexing="ij"))
    far, near = np.where(np.abs(s) >= np.abs(t), [s, t], [t, s])
    turn = 0.25 * np.pi * np.divide(near, far, out=np.zeros_like(far), where=far != 0.0)
    turn = np.where(np.abs(s) >= np.abs(t), turn, 0.5 * np.pi - turn)
    circles = far[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    straight = np.stack([s, t], axis=1) / np.sqrt(2.0)
    size = 0.5 * m / (0.5 * m + rings)  # elements of one size along the diagonal
    square = size * (straight + (circles - straight) / 3.0)
    number = np.arange((m + 1) ** 2).reshape(m + 1, m + 1)
    edge = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
    way = np.linspace(0.0, 1.0, rings + 1)[1:, None, None]
    outside = (1.0 - way) * square[edge] + way * circles[edge]
    loops = np.concatenate([edge[None], len(square) + np.arange(4 * m * rings).reshape(rings, 4 * m)])
    ahead = np.roll(loops, -1, axis=1)
    inner = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)
    around = np.stack([loops[:-1], loops[1:], ahead[1:], ahead[:-1]], axis=-1)
    quads = np.concatenate([inner.reshape(-1, 4), around.reshape(-1, 4)])
    return np.concatenate([square, outside.reshape(-1, 2)]), quads, np.stack([loops[-1], ahead[-1]], axis=1)
