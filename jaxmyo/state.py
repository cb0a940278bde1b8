"""A state of a body: the fields of an equilibrium, what it belongs to, and how it was found."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import wraps
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxmyo import checks, ellipticity, lagrangian, outputs, surface, tracing
from jaxmyo.conditions import Load, Spring
from jaxmyo.scene import Scene
from jaxmyo.status import Status, explain
from jaxmyo.system import Inputs, System

#: The fields at the quadrature points that `State.mean` averages.
FIELDS = ["F", "C", "stretches", "second_piola_kirchhoff", "cauchy", "cauchy_fibre", "T_f", "T_cf"]


#: Elements at most in which a message looks for the place where the material is weakest.
LOOKED_AT = 256
#: Statuses that no place in the body explains.
_NO_PLACE = {Status.CONVERGED, Status.INVALID_INPUT, Status.TIME_LIMIT, Status.OUTPUT_NOT_FINITE}


def _per_state(function: Callable[..., Any]) -> Callable[..., Any]:
    """Apply a function of one state to every state of a batch (the leading axes that `vmap` gave it)."""

    @wraps(function)
    def apply(self: "State", *arguments: Any) -> Any:
        def mapped(state: "State") -> Any:
            return function(state, *arguments)

        axes = self._mapped_axes()
        for _ in range(jnp.ndim(self.status)):
            mapped = jax.vmap(mapped, in_axes=(axes,))
        return mapped(self)

    return apply


@jax.tree_util.register_dataclass
@dataclass(frozen=True, repr=False)
class State:
    """An equilibrium: the fields, what they belong to, and how they were found. A pytree; every array may be batched.

    scene: the `Scene`; system: the discrete problem; inputs: constants, T0, a/D, β, tensions, loads of this state;
    conditions: the tractions, pressures and springs that `load` was given; u: (n_nodes, 3) displacements θ − Θ in the
    world coordinates [mm, rad]; p: (n_p,) pressure [kPa], one per patch (by default per element); q: (n_q,) weave
    multiplier [kPa], likewise, None without the weave; cavity_pressures: (n,) [kPa], one per
    `Volume`; status: see `Status`; reached: the fraction of the load at which
    the fields stand (1 if converged); residual: relative; force_residual [mN, mN·mm]; constraint_residual [–]; history:
    relative residuals of the last Newton loop, 0 beyond its end; steps, rejected, iterations: counts;
    negative_eigenvalues: of the second variation on the constraint manifold, 0 for a stable state; zero_eigenvalues: of
    the saddle matrix, > 0 where a mode has no stiffness, also in the state A that left C its tensions: such a state has
    no derivative (a large body has 1 for any number of them); both −1 where an invalid input kept the solve from
    starting, and where multigrid does not know them; stable_until: the fraction of the load before the
    determinant of the tangent first changed its sign on the path, to 0.01, 1 if it did not: there an odd number of
    modes gained or lost stability;
    solver: of the linear systems, "dense LU", "Pardiso", "SuperLU" or "multigrid"; work: of a sparse solve, the counts
    and the seconds of its parts.
    """

    scene: Scene = field(metadata={"static": True})
    system: System
    inputs: Inputs
    conditions: tuple[Load | Spring, ...]
    u: Array
    p: Array
    q: Array | None
    cavity_pressures: Array
    status: Array
    reached: Array
    residual: Array
    force_residual: Array
    constraint_residual: Array
    history: Array
    steps: Array
    rejected: Array
    iterations: Array
    negative_eigenvalues: Array
    zero_eigenvalues: Array
    stable_until: Array
    work: dict[str, Array]
    solver: str = field(metadata={"static": True})

    @property
    def converged(self) -> Any:
        """Whether the whole load was reached and the residual is below the tolerance."""
        return tracing.known(self.status) == Status.CONVERGED

    @property
    def message(self) -> str:
        """What happened, where, and what to try (of one state: `states[i].message` in a batch)."""
        loads = surface.values(self.scene.mesh, self.conditions, self.inputs.loads)
        said = explain(self.status, self.reached, self.residual, ", ".join(loads), self._stability())
        return said if int(self.status) in _NO_PLACE else f"{said} {self._weakest_place()}"

    def _stability(self) -> str:
        """Of one state: how many modes are unstable, and since when; nothing where it is stable."""
        n, since = int(self.negative_eigenvalues), float(self.stable_until)
        if n <= 0 or int(self.status) == Status.LIMIT_POINT:
            return ""
        after = f", after {100 * since:.3g} % of the load" if since < 1.0 else ""
        return f"unstable: {n} mode{'s' if n > 1 else ''}{after}"

    def _weakest_place(self) -> str:
        """Of one state: whether and where the material has lost ellipticity, and where it is stretched most."""
        stretch = np.sqrt(np.linalg.eigvalsh(np.asarray(self.C))[..., -1])
        looked_at = np.argsort(-stretch.max(axis=1), kind="stable")[:LOOKED_AT]
        system = replace(
            self.system, frame=self.system.frame[looked_at], material=jnp.asarray(self.system.material)[looked_at]
        )
        inputs = self.inputs._replace(T_f=self.inputs.T_f[looked_at], T_cf=self.inputs.T_cf[looked_at])
        found = ellipticity.weakest(system, self.F[looked_at], self._multipliers()[looked_at], inputs)
        least, directions = (np.asarray(x) for x in found)

        def place(values: NDArray[np.float64], elements: NDArray[np.int64] | None = None) -> str:
            e, g = (int(i) for i in np.unravel_index(np.argmax(values), values.shape))
            return f"element {e if elements is None else elements[e]}, Gauss point {g}"

        if not np.isfinite(least).all():
            said = f"The stiffness of the material is beyond float64 in {place(~np.isfinite(least), looked_at)}"
        elif least.min() <= 0.0:
            N = directions[np.unravel_index(least.argmin(), least.shape)]
            said = (
                f"The material has lost ellipticity, most in {place(-least, looked_at)}: {least.min():.4g} kPa for a "
                f"band normal to ({', '.join(f'{x:.3f}' for x in N)})"
            )
        else:
            said = f"The material is elliptic, least in {place(-least, looked_at)}: {least.min():.4g} kPa"
        among = f" (of the {LOOKED_AT} elements that are stretched most)" if len(stretch) > LOOKED_AT else ""
        return f"{said}{among}; the largest stretch, {stretch.max():.4g}, is in {place(stretch)}."

    @property
    @_per_state
    def F(self) -> Array:
        """Deformation gradient (n_elements, n_points, 3, 3) [–], from the local basis of P to the deformed one."""
        return lagrangian.deformation_gradients(self.system, self.u)

    @property
    @_per_state
    def C(self) -> Array:
        """Right Cauchy–Green tensor FᵀF (n_elements, n_points, 3, 3) [–]."""
        return jnp.swapaxes(self.F, -1, -2) @ self.F

    @property
    @_per_state
    def stretches(self) -> Array:
        """λf, λcf, λn (n_elements, n_points, 3) [–]: stretches along fibre, cross-fibre and normal."""
        return jnp.sqrt(jnp.einsum("egki,egij,egkj->egk", self.system.frame, self.C, self.system.frame))

    @property
    @_per_state
    def second_piola_kirchhoff(self) -> Array:
        """S = 2 ∂W/∂C (n_elements, n_points, 3, 3) [kPa], along the local unit vectors of the state P."""
        return outputs.second_piola_kirchhoff(self.system, self.F, self._multipliers(), self.inputs)

    def _multipliers(self) -> Array:
        """p and q (n_elements, 1 or 2) [kPa] of each element."""
        per_patch = jnp.concatenate([self.p] if self.q is None else [self.p, self.q])
        return per_patch[self.system.local_multipliers - self.system.n_u]

    @property
    @_per_state
    def cauchy(self) -> Array:
        """Cauchy stress (n_elements, n_points, 3, 3) [kPa], along the local unit vectors of the deformed place."""
        return outputs.cauchy(self.F, self.second_piola_kirchhoff)

    @property
    @_per_state
    def cauchy_fibre(self) -> Array:
        """Cauchy stress (n_elements, n_points, 3, 3) [kPa] in deformed fibre axes: fibre, cross-fibre, normal."""
        R = outputs.deformed_frame(self.F, self.system.frame)
        return R @ self.cauchy @ jnp.swapaxes(R, -1, -2)

    @property
    def ellipticity(self) -> Array:
        """The least energy of a band of localised deformation (n_elements, n_points) [kPa], see `jaxmyo.ellipticity`.

        The least eigenvalue of the acoustic tensor over all directions N of P and amplitudes that keep the volume:
        positive where the material is strongly elliptic, μ for ½ μ (I1 − 3) at rest.
        """
        return self._weakest[0]

    @property
    def weakest_direction(self) -> Array:
        """The normal N in P (n_elements, n_points, 3) of the band that `ellipticity` is of, along the local axes."""
        return self._weakest[1]

    @property
    @_per_state
    def _weakest(self) -> tuple[Array, Array]:
        return ellipticity.weakest(self.system, self.F, self._multipliers(), self.inputs)

    @property
    def T_f(self) -> Array:
        """Pseudo-active fibre tension T_A^f = −q h4 I4 (n_elements, n_points) [kPa] (paper, Eq. (T))."""
        return self._tensions[0]

    @property
    def T_cf(self) -> Array:
        """Pseudo-active cross-fibre tension T_A^cf = −q h6 I6 (n_elements, n_points) [kPa]."""
        return self._tensions[1]

    @property
    @_per_state
    def _tensions(self) -> tuple[Array, Array]:
        if self.q is None:
            return self.inputs.T_f, self.inputs.T_cf
        return outputs.tensions(self.system, self.u, self.q, self.inputs)

    @property
    @_per_state
    def reactions(self) -> Array:
        """Forces (n_nodes, 3) of the supports on the body [mN]; moments [mN·mm] for an angle. Round-off at free nodes.

        They are conjugate to the world coordinates.
        """
        S, P = self.second_piola_kirchhoff, self.cavity_pressures
        return outputs.nodal_forces(self.system, self.u, S, P, self.inputs)

    @_per_state
    def reaction(self, face: str) -> Array:
        """Sum (3,) of the supports' forces on the nodes of a named face [mN]; a moment [mN·mm] for an angle."""
        return jnp.sum(self.reactions[np.unique(self.scene.mesh.face(face))], axis=0)

    @_per_state
    def cavity_volume(self, face: str) -> Array:
        """The volume [mm³] of the cavity whose wall is a named face, see `Pressure` with closed ends."""
        mesh = self.scene.mesh
        return surface.enclosed(mesh.coordinates, mesh.face(face), self.system.points + self.u)

    @property
    @_per_state
    def stored_energy(self) -> Array:
        """∫ W dV [µJ] of the law alone: no tension T0, no weave. In a passive body, the work done on it from rest."""
        return outputs.stored_energy(self.system, self.F, self.inputs)

    def mean(self, name: str) -> Array:
        """Volume mean of a field at the quadrature points by its name, e.g. mean("cauchy"): (3, 3) [kPa]."""
        return self._mean(checks.choice("name", name, FIELDS))

    @_per_state
    def _mean(self, name: str) -> Array:
        return jnp.tensordot(self.system.weight, getattr(self, name), axes=2) / jnp.sum(self.system.weight)

    def __getitem__(self, i: Any) -> "State":
        """One state, or some, of a batch that `vmap` made."""
        if not jnp.ndim(self.status):
            raise TypeError("this is one state, not a batch of states")
        one = jax.tree.map(lambda leaf: leaf[i], replace(self, system=cast(System, None)))
        shared = jnp.ndim(self.system.weight) == 2
        return replace(one, system=self.system if shared else jax.tree.map(lambda leaf: leaf[i], self.system))

    def _mapped_axes(self) -> "State":
        """What `vmap` takes apart: everything, but the system where all states of the batch share one."""
        axes = jax.tree.map(lambda _: 0, self)
        return replace(axes, system=cast(System, None)) if jnp.ndim(self.system.weight) == 2 else axes

    def __repr__(self) -> str:
        kind = "A, free contraction" if self.system.weave else "A without weave, or C"
        n_e = len(self.scene.mesh.cells)
        if isinstance(self.status, jax.core.Tracer):
            return f"State ({kind}) of {n_e} element(s), traced"
        if jnp.ndim(self.status):
            names, counts = np.unique(np.asarray(self.status), return_counts=True)
            how = ", ".join(f"{n} {Status(int(s)).name}" for s, n in zip(names, counts, strict=True))
            return f"{np.size(self.status)} states ({kind}) of {n_e} element(s): {how}"
        loads = "".join(f", {x}" for x in surface.values(self.scene.mesh, self.conditions, self.inputs.loads))
        stretches = ", ".join(f"{float(x):.5f}" for x in self.mean("stretches"))
        return (
            f"State ({kind}) of {n_e} element(s): {self.message}\n"
            f"  beta = {float(self.inputs.beta):g}, T0 = {float(self.inputs.T0):g} kPa{loads}; mean stretches "
            f"{stretches} (fibre, cross-fibre, normal)\n"
            f"  {int(self.steps)} steps, {int(self.iterations)} iterations ({self.solver}); negative eigenvalues: "
            f"{int(self.negative_eigenvalues)}, zero: {int(self.zero_eigenvalues)}{self._needless}"
        )

    @property
    def _needless(self) -> str:
        """Of a passive state A: what it has multipliers for moves nothing."""
        moves = np.abs(np.asarray(self.u)) > 1e-12 * self.scene.mesh.extent
        if self.q is None or moves.any() or not self.converged:
            return ""
        return (
            f"\n  needless: {self.q.size} q of the weave in a passive state, which stays at rest: "
            "contract(a_over_D=None) has none"
        )
