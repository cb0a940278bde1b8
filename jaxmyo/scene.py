"""A scene: what is modelled. The mesh, the law and its constants, the fibres, the quadrature, the supports."""

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxmyo import checks, ties
from jaxmyo.conditions import Tie
from jaxmyo.energies import Law
from jaxmyo.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Scene:
    """A body and what holds it in every state.

    mesh: `Mesh` [mm]; law: an energy density, see `jaxmyo.energies`; constants: the law's pytree of constants;
    fibre, cross: unit vectors f and f⊥ in the state P, (3,) for all or (n_elements, 3) or
    (n_elements, n_points, 3) per quadrature point; supports: ties that hold in the states A and C alike;
    quadrature: Gauss points per direction (2 is the Q1–Q0 standard; 1 is exact for a homogeneous state).

    Errors: a ValueError for a law that is no finite scalar at rest, for fibres that are not of unit length or not
    orthogonal, for supports that leave a rigid motion free, and for names of faces that the mesh does not have.
    """

    mesh: Mesh
    law: Law
    constants: Any
    fibre: Any = (1.0, 0.0, 0.0)
    cross: Any = (0.0, 1.0, 0.0)
    supports: tuple[Tie, ...] = ()
    quadrature: int = 2
    frame: NDArray[np.float64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not callable(self.law):
            raise TypeError(f"law must be a function law(C, frame, beta, constants) -> W; got {self.law!r}")
        if self.quadrature not in range(1, 9):
            raise ValueError(f"quadrature = {self.quadrature} must be an integer in [1, 8] (points per direction)")
        object.__setattr__(self, "constants", checks.finite_tree("constants", self.constants))
        _check_law(self.law, self.constants)
        object.__setattr__(self, "supports", tuple(self.supports))
        for support in self.supports:
            if not isinstance(support, Tie):
                raise TypeError(
                    f"supports must be Symmetry, Displacement, Stretch, Planar or Homogeneous; got {support!r}"
                )
        shape = (len(self.mesh.cells), self.quadrature**3)
        f, cf = _directions("fibre", self.fibre, shape), _directions("cross", self.cross, shape)
        dot = np.einsum("egi,egi->eg", f, cf)
        if (np.abs(dot) > 1e-6).any():
            e, g = (int(i) for i in np.argwhere(np.abs(dot) > 1e-6)[0])
            raise ValueError(
                f"fibre and cross must be orthogonal; f · f⊥ = {dot[e, g]:.3g} in element {e}, point {g} (valid: 0)"
            )
        object.__setattr__(self, "frame", np.stack([f, cf, np.cross(f, cf)], axis=-2))
        self.kinematics(())

    def kinematics(self, conditions: tuple[Tie, ...]) -> ties.Ties:
        """The ties of the supports and of further conditions; an error if a rigid motion stays free."""
        built = ties.build(self.mesh, (*self.supports, *conditions))
        if free := ties.rigid_motions(self.mesh, built):
            raise ValueError(
                f"supports = {self.supports} leave a rigid motion free: {', '.join(free)}. "
                "Add Symmetry planes or Displacement conditions until none is left."
            )
        return built


def _check_law(law: Law, constants: Any) -> None:
    rest = (jnp.eye(3), jnp.eye(3), jnp.zeros(()))
    shape = jax.eval_shape(law, *rest, constants)
    if not isinstance(shape, jax.ShapeDtypeStruct) or shape.shape != () or shape.dtype != jnp.float64:
        raise ValueError(f"law must return one float64 energy density W (kPa), shape (); {law} returns {shape}")
    if not checks.is_traced(constants) and not bool(jnp.isfinite(law(*rest, constants))):
        raise ValueError(f"law is not finite at rest (C = I, beta = 0) with constants = {constants}")


def _directions(name: str, value: Any, shape: tuple[int, int]) -> NDArray[np.float64]:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} must be numbers, unit vectors; got {value!r}") from error
    if array.shape not in ((3,), (shape[0], 3), (*shape, 3)):
        raise ValueError(
            f"{name} must have shape (3,), ({shape[0]}, 3) per element or {(*shape, 3)} per quadrature point; "
            f"got {array.shape}"
        )
    array = np.broadcast_to(array[:, None] if array.ndim == 2 else array, (*shape, 3))
    length = np.linalg.norm(array, axis=-1)
    if not (np.abs(length - 1.0) <= 1e-6).all():  # also catches NaN
        e, g = (int(i) for i in np.argwhere(~(np.abs(length - 1.0) <= 1e-6))[0])
        raise ValueError(
            f"{name} must be unit vectors; {array[e, g]} in element {e}, point {g} has length {length[e, g]:.6g} "
            "(valid: 1 ± 1e-6)"
        )
    return array / length[..., None]
