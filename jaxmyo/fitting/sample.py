"""Measured curves as a problem: every row of the data is a state C of the homogeneous sample, by the elements."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxmyo import checks, protocols
from jaxmyo.constants import MEASURED
from jaxmyo.data import AXES, MODES, Data
from jaxmyo.energies import Law, lin_yin
from jaxmyo.fitting.parameters import names_of, parameters_of
from jaxmyo.fitting.problem import Predict, Problem
from jaxmyo.scene import Scene
from jaxmyo.scenes import thin_sample
from jaxmyo.solve import contract, load
from jaxmyo.state import State


def sample_problem(
    data: Data,
    law: Law = lin_yin,
    constants: Any = MEASURED,
    *,
    T0: float = 0.0,
    a_over_D: float | None = None,
    free: Sequence[str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    per_protocol: Sequence[str] = (),
) -> Problem:
    """The fit of a law to measured curves.

    The parameters are the constants by their names, T0 [kPa] and, with the weave, a_over_D; constants, T0 and a_over_D
    (None: no weave) are where they start, or what they are. free: names of those that are fitted, default all
    constants that any row depends on; bounds: name → (low, high), instead of `fitting.parameters.BOUNDS`;
    per_protocol: names that have a value of their own for each protocol, "T0[contracted]", the others are shared; such
    a name in `free` stands for all of its values. Observed are the stresses [kPa], and the stretches [–] of rows under
    control by stress; where there are both, weights make them comparable.

    Errors: ValueError for unknown names, values out of bounds, a law whose energy is not finite at a row of the data.
    """
    constants = checks.finite_tree("constants", constants)
    scene = thin_sample(law=law, constants=constants)
    own = names_of(constants)
    if {"T0", "a_over_D"} & set(own):
        raise ValueError(f"constants: {own} must not have the names T0 and a_over_D")
    start = dict(zip(own, map(float, jax.tree.leaves(constants)), strict=True)) | {"T0": checks.number("T0", T0, "T0")}
    if a_over_D is not None:
        start["a_over_D"] = checks.number("a_over_D", a_over_D, "a_over_D")
    split = dict.fromkeys(per_protocol, data.protocols)
    parameters = parameters_of(start, bounds or {}, split)
    wanted = felt(data, law, constants)
    wanted = wanted if free is None else list(free)
    full = [f"{n}[{p}]" for n in wanted for p in split.get(n, ())]
    chosen = tuple(full + [n for n in wanted if n not in split])
    predict, observed, row = predictions(data, scene, a_over_D is not None, tuple(per_protocol))
    about = {"law": getattr(law, "__name__", repr(law)), "a_over_D": a_over_D, "data": data.as_json()}
    return Problem(
        predict,
        observed,
        parameters,
        chosen,
        data.weight[row],
        tuple(data.protocol[r] for r in row),
        "kPa" if not data.stress_controlled.any() else "kPa, –",
        about=about,
    )


class Kind(NamedTuple):
    """What rows have in common that go through one compiled solve."""

    stretched: tuple[bool, bool, bool]
    mode: str
    by_stress: bool
    measure: str


def predictions(
    data: Data, scene: Scene, weave: bool, per_protocol: tuple[str, ...] = ()
) -> tuple[Predict, NDArray[np.float64], NDArray[np.int64]]:
    """The function from named parameters to predictions (n,), the observations (n,), and the row of each (n,)."""
    kinds = [_kind(data, i) for i in range(len(data))]
    # The contractions that the rows start from: one for each activation, and for each protocol with values of its own.
    cases = [(p if per_protocol else "", float(b)) for p, b in zip(data.protocol, data.beta, strict=True)]
    every = list(dict.fromkeys(cases))
    case = np.array([every.index(c) for c in cases])
    blocks: list[tuple[Kind, NDArray[np.int64], tuple[NDArray[np.float64], ...]]] = []
    computed = np.empty(len(data), dtype=np.int64)  # where each row comes among all that are computed
    for kind in dict.fromkeys(kinds):
        rows = np.array([i for i, k in enumerate(kinds) if k == kind])
        computed[rows] = sum(r.size for _, r, _ in blocks) + np.arange(len(rows))
        blocks.append((kind, rows, _inputs(data.rows(rows), kind)))
    row, what = columns_of(data)
    where = 12 * computed[row] + what
    observed = np.concatenate([data.stress, data.stretch], axis=1)[row, what]
    structure = jax.tree.structure(scene.constants)
    own = names_of(scene.constants)

    def value(values: Mapping[str, Array], name: str) -> Array:
        """A parameter in each of the cases."""
        split = name in per_protocol
        return jnp.stack([values[f"{name}[{p}]" if split else name] for p, _ in every])

    def predict(values: Mapping[str, Array]) -> Array:
        constants = jax.tree.unflatten(structure, [value(values, name) for name in own])
        beta = jnp.array([b for _, b in every])
        ratio = value(values, "a_over_D") if weave else None
        A = jax.vmap(partial(_contracted, scene))(constants, value(values, "T0"), ratio, beta)
        found = []
        for kind, rows, inputs in blocks:
            start = jax.tree.map(lambda leaf, rows=rows: leaf[case[rows]], A)
            found.append(jax.vmap(_test(kind))(start, *inputs).reshape(-1))
        return jnp.concatenate(found)[where]

    return predict, observed, row


def columns_of(data: Data) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The observations of data: the row of each (n,), and which of the 9 stresses and 3 stretches (n,) it is."""
    row, what = np.nonzero([_seen(data, i, _kind(data, i)) for i in range(len(data))])
    return row, what


def _contracted(scene: Scene, constants: Any, T0: Array, a_over_D: Array | None, beta: Array) -> State:
    return contract(scene, T0=T0, a_over_D=a_over_D, beta=beta, constants=constants, throw=False)


def _test(kind: Kind) -> Callable[..., Array]:
    """From a free contraction and what the machine prescribes to the stresses (9) and stretches (3), NaN if lost."""

    def test(A: State, stretch: Array, amount: Array, stress: Array) -> Array:
        if kind.mode:
            i, j = (AXES.index(a) for a in kind.mode.split("-"))
            conditions = protocols.simple_shear(kind.mode, amount, (stretch[i], stretch[j]))
        elif kind.by_stress:
            conditions = protocols.biaxial_stress(stress[0], stress[1], kind.measure)  # type: ignore[arg-type]
        else:
            conditions = tuple(
                c for k, a in enumerate(AXES) if kind.stretched[k] for c in protocols.uniaxial(a, stretch[k])
            )
        C = load(A, *conditions, throw=False)
        found = jnp.concatenate([protocols.measured(C, kind.measure), C.mean("stretches")])
        return jnp.where(C.converged, found, jnp.nan)

    return test


def _kind(data: Data, i: int) -> Kind:
    sheared = np.flatnonzero(~np.isnan(data.shear[i]))
    mode = MODES[sheared[0]] if sheared.size else ""
    by_stress = bool(data.stress_controlled[i])
    given = ~np.isnan(data.stretch[i]) & (not mode) & (not by_stress)
    return Kind((bool(given[0]), bool(given[1]), bool(given[2])), mode, by_stress, data.measure[i])


def _inputs(rows: Data, kind: Kind) -> tuple[NDArray[np.float64], ...]:
    """Stretches (n, 3), amounts of shear (n,) and stresses (n, 2) that are prescribed; harmless where they are not."""
    amount = rows.shear[:, MODES.index(kind.mode)] if kind.mode else np.zeros(len(rows))
    return np.nan_to_num(rows.stretch, nan=1.0), amount, np.nan_to_num(rows.stress[:, :2], nan=0.0)


def _seen(data: Data, i: int, kind: Kind) -> NDArray[np.bool_]:
    """Which of the 9 stresses and 3 stretches of a row are observations: measured, not prescribed."""
    stress, stretch = ~np.isnan(data.stress[i]), ~np.isnan(data.stretch[i])
    if kind.by_stress:
        return np.concatenate([np.zeros(9, dtype=bool), stretch])
    if kind.mode:
        held = np.array([a in kind.mode.split("-") for a in AXES])
        return np.concatenate([stress[:3] & held, stress[3:], np.zeros(3, dtype=bool)])
    return np.concatenate([stress[:3] & stretch, np.zeros(9, dtype=bool)])


def felt(data: Data, law: Law, constants: Any) -> list[str]:
    """The names of the constants that the energy of any row depends on; an error for a law that is not finite there.

    Free stretches are taken as if they shared what incompressibility leaves.
    """
    stretch = data.stretch.copy()
    for i, row in enumerate(stretch):
        sheared = np.flatnonzero(~np.isnan(data.shear[i]))
        if sheared.size:
            held = [AXES.index(a) for a in MODES[sheared[0]].split("-")]
            row[held] = np.where(np.isnan(row[held]), 1.0, row[held])
        free = np.isnan(row)
        row[free] = np.prod(row[~free]) ** (-1.0 / max(int(free.sum()), 1))
    F = np.zeros((len(data), 3, 3))
    F[:, range(3), range(3)] = stretch
    for k, mode in enumerate(MODES):
        i, j = (AXES.index(a) for a in mode.split("-"))
        F[:, j, i] += np.nan_to_num(data.shear[:, k])

    @jax.jit
    @jax.vmap
    def energy(C: Array, beta: Array) -> tuple[Array, Any]:
        return jax.value_and_grad(lambda own: law(C, jnp.eye(3), beta, own))(constants)

    W, by_constants = energy(F.swapaxes(1, 2) @ F, data.beta)
    if not np.isfinite(W).all():
        i = int(np.argmax(~np.isfinite(W)))
        raise ValueError(
            f"law: the energy is {W[i]} at line {data.lines[i]} of the data (stretches "
            f"{np.round(stretch[i], 4).tolist()}, beta = {data.beta[i]:g}) with constants = {constants}"
        )
    slopes = jax.tree.leaves(by_constants)
    return [name for name, slope in zip(names_of(constants), slopes, strict=True) if np.any(slope != 0.0)]
