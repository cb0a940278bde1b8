"""A scene: what is modelled. The mesh, the law and its constants, the fibres, the quadrature, the supports."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxmyo import checks, fibres, patches, surface, ties, tracing
from jaxmyo.conditions import Displacement, Spring, Tie
from jaxmyo.energies import Kind, Law
from jaxmyo.hexahedron import gauss
from jaxmyo.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Material:
    """What a region of a body is made of.

    law, constants: as in `Scene`; active: whether it contracts (β = 0 in it otherwise); weave: whether the weave's
    constraint h = 0 acts in it (q = 0 in it otherwise).
    """

    law: Law
    constants: Any
    active: bool = True
    weave: bool = True


@dataclass(frozen=True, eq=False)
class Scene:
    """A body and what holds it in every state.

    mesh: `Mesh` [mm, rad]; law: an energy density, see `jaxmyo.energies`; constants: the law's pytree of constants;
    fibre, cross: vectors f and f⊥ in the state P, along the local unit vectors of the world coordinates, see
    `jaxmyo.fibres`: (3,) for all, (n_elements, 3), (n_nodes, 3), (n_elements, n_points, 3) per quadrature point, a
    function of the coordinates Θ (n, 3) ↦ (n, 3), or the name of a field of the mesh;
    supports: ties and springs that hold in the states A and C alike;
    quadrature: Gauss points per direction, one number or three (2 is the Q1–Q0 standard; 1 is exact along a direction
    in which nothing varies); p_patches, q_patches: (n_elements,) the patch of each element that shares one p,
    one q; None is one per element (`jaxmyo.patches`); regions: name of a region of the mesh → the `Material` of its
    elements; all others have the law and the constants of the scene.

    A UserWarning says where fibre and cross were not of unit length or not orthogonal, and were made so.

    Errors: a ValueError for a law that is no finite scalar at rest, for fibres that are zero, not finite or parallel,
    for supports that leave a rigid motion free, for patches that do not cover the elements, and for names
    of faces and axes that the mesh does not have. `print(scene)` says what is modelled.
    """

    mesh: Mesh
    law: Law
    constants: Any
    fibre: Any = (1.0, 0.0, 0.0)
    cross: Any = (0.0, 1.0, 0.0)
    supports: tuple[Tie | Spring, ...] = ()
    quadrature: int | tuple[int, int, int] = 2
    p_patches: Any = None
    q_patches: Any = None
    regions: Mapping[str, Material] = field(default_factory=dict)
    orders: tuple[int, int, int] = field(init=False, repr=False)  # Gauss points per direction
    frame: NDArray[np.float64] = field(init=False, repr=False)
    kinds: tuple[Kind, ...] = field(init=False, repr=False)  # the scene's own, then those of the regions
    material: NDArray[np.int64] = field(init=False, repr=False)  # (n_elements,) which of the kinds

    def __post_init__(self) -> None:
        if not callable(self.law):
            raise TypeError(f"law must be a function law(C, frame, beta, constants) -> W; got {self.law!r}")
        orders = tuple(self.quadrature) if isinstance(self.quadrature, tuple | list) else (self.quadrature,) * 3
        if len(orders) != 3 or any(n not in range(1, 9) for n in orders):
            raise ValueError(
                f"quadrature = {self.quadrature} must be an integer in [1, 8], or three (points per direction)"
            )
        object.__setattr__(self, "orders", orders)
        object.__setattr__(self, "constants", checks.finite_tree("constants", self.constants))
        _check_law(self.law, self.constants)
        object.__setattr__(self, "supports", tuple(self.supports))
        for support in self.supports:
            if not isinstance(support, Tie | Spring):
                raise TypeError(
                    "supports must be Symmetry, Displacement, Stretch, Planar, Uniform, Proportional, Homogeneous or "
                    f"Spring; got {support!r}"
                )
        surface.build(self.mesh, self.springs)
        for name in ("p_patches", "q_patches"):
            object.__setattr__(self, name, patches.checked(name, getattr(self, name), self.mesh))
        xi, _ = gauss(*self.orders)
        object.__setattr__(self, "frame", fibres.frame(self.mesh, xi, self.fibre, self.cross))
        self._set_materials()
        if free := ties.rigid_motions(self.mesh, self.kinematics(()), self.springs):
            raise ValueError(
                f"supports = {self.supports} leave a rigid motion free: {', '.join(free)}. "
                "Add Symmetry planes, Displacement conditions or springs until none is left."
            )

    def _set_materials(self) -> None:
        material = np.zeros(len(self.mesh.cells), dtype=np.int64)
        for k, (name, m) in enumerate(self.regions.items(), start=1):
            if not isinstance(m, Material):
                raise TypeError(f"regions[{name!r}] must be a Material; got {m!r}")
            _check_law(m.law, checks.finite_tree(f"regions[{name!r}].constants", m.constants))
            material[self.mesh.region(name)] = k
        own = Kind(self.law, active=True, weave=True)
        kinds = (own, *(Kind(m.law, m.active, m.weave) for m in self.regions.values()))
        acts = np.array([k.weave for k in kinds])[material]
        counts = [np.bincount(self.q_patches, w, minlength=1) for w in (acts, ~acts)]
        if (mixed := (counts[0] > 0) & (counts[1] > 0)).any():
            raise ValueError(
                f"q_patches: patch {int(np.argmax(mixed))} has elements with the weave and without; give each region "
                "patches of its own"
            )
        object.__setattr__(self, "kinds", kinds)
        object.__setattr__(self, "material", material)

    def constants_of_kinds(self, own: Any = None) -> tuple[Any, ...]:
        """The constants of each of the `kinds`; own: instead of the scene's.

        With regions, own is a mapping from the names of regions to constants; the name "" is for the scene's own law.
        """
        if not self.regions:
            return (self.constants if own is None else checks.finite_tree("constants", own),)
        every = {"": self.constants} | {name: m.constants for name, m in self.regions.items()}
        if own is not None:
            if not isinstance(own, Mapping) or not set(own) <= set(every):
                raise ValueError(
                    f"constants must be a mapping from names of regions to constants, of {list(every)}; got {own!r}"
                )
            every |= own
        return tuple(checks.finite_tree(f"constants[{name!r}]", c) for name, c in every.items())

    @property
    def springs(self) -> tuple[Spring, ...]:
        """The springs among the supports."""
        return tuple(s for s in self.supports if isinstance(s, Spring))

    def kinematics(self, conditions: tuple[Tie | Spring, ...], points: Any = None) -> ties.Ties:
        """The ties of the supports and of further conditions, which hold the body as well as the supports alone.

        A prescribed displacement takes the place of a support of the same face and axis: it moves that support.
        points: (n_nodes, 3) instead of the mesh's.
        """
        moved = {(c.face, c.axis) for c in conditions if isinstance(c, Displacement)}
        stay = [s for s in self.supports if not (isinstance(s, Displacement) and (s.face, s.axis) in moved)]
        return ties.build(self.mesh, [c for c in (*stay, *conditions) if not isinstance(c, Spring)], points)

    def __str__(self) -> str:
        from jaxmyo.describe import describe  # it needs the scene's type

        return describe(self)


def _check_law(law: Law, constants: Any) -> None:
    rest = (np.eye(3), np.eye(3), np.zeros(()))
    shape = jax.eval_shape(law, *rest, constants)
    if not isinstance(shape, jax.ShapeDtypeStruct) or shape.shape != () or shape.dtype != jnp.float64:
        raise ValueError(f"law must return one float64 energy density W (kPa), shape (); {law} returns {shape}")
    if not tracing.is_traced(constants) and not np.isfinite(jax.jit(law)(*rest, constants)):
        raise ValueError(f"law is not finite at rest (C = I, beta = 0) with constants = {constants}")
