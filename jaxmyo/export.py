"""States as files for ParaView: the undeformed body with its displacements and the fields of its elements.

An element in curved coordinates is no straight-edged hexahedron; it is cut into pieces that look like it.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, cast
from xml.sax.saxutils import quoteattr

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from numpy.typing import NDArray

from jaxmyo import checks, outputs
from jaxmyo.coordinates import evaluate
from jaxmyo.files import whole
from jaxmyo.hexahedron import shape
from jaxmyo.mesh import structured
from jaxmyo.scene import Scene
from jaxmyo.state import State

#: Components of strain and stress in fibre axes: fibre f, cross-fibre c, normal n.
COMPONENTS = {"ff": (0, 0), "cc": (1, 1), "nn": (2, 2), "fc": (0, 1), "fn": (0, 2), "cn": (1, 2)}


def write_vtu(path: str | Path, state: State, refine: tuple[int, int, int] = (1, 1, 1)) -> Path:
    """Write one state as a VTK file of hexahedra (.vtu), which ParaView opens ("Warp By Vector" deforms it).

    Points: Cartesian positions X in the zero-stress state P [mm]. Point data: displacement_mm, x − X (3,) in Cartesian
    components [mm], so that the deformed body is points + displacement_mm. Cell data, means over the Gauss points of an
    element (of the volume in P): p_kPa, the pressure; q_kPa, the multiplier of the weave, only in a free contraction
    with the weave; T_A_f_kPa, T_A_cf_kPa, the pseudo-active tensions; stretch_f, stretch_cf, stretch_n [–]; E_ff, E_cc,
    E_nn, E_fc, E_fn, E_cn [–], the Green–Lagrange strain ½ (FᵀF − 1) in the fibre axes of P, fibre f, cross-fibre c and
    normal n; sigma_ff_kPa, ..., the same components of the Cauchy stress in deformed fibre axes (numbers, not a tensor:
    programs take tensors as Cartesian); det_F [–], 1 where the volume is kept. fibre and fibre_P (3,): the direction of
    the fibre in the deformed body and in P, a Cartesian unit vector at the middle of the hexahedron.

    refine: pieces per element along its three coordinates, at least 1; nodes are interpolated by the element's shape
    functions in world coordinates, means are repeated. An element of `radial_tube` is a whole ring:
    refine=(1, 48, 1) shows it as one. Errors: ModuleNotFoundError without meshio, TypeError for a batch of states,
    ValueError for refine < 1.
    """
    try:
        import meshio
    except ModuleNotFoundError as error:
        raise checks.missing(error, "write_vtu needs", "'jaxmyo[mesh]'") from error
    if jnp.ndim(state.status):
        raise TypeError(
            f"state is a batch of shape {jnp.shape(state.status)}; write one of them, state[i], or all by write_series"
        )
    pieces = structured([np.linspace(-1.0, 1.0, n + 1) for n in checks.counts("refine", refine, 3)])
    points, displacements, cells = _body(state, shape(pieces.points), pieces.cells)
    means = _means(_bare(state))
    middles = shape(pieces.points[pieces.cells].mean(axis=1))
    fields = {name: np.repeat(values, len(pieces.cells)) for name, values in _numbers(state, means).items()}
    fields |= _directions(state, means, middles)
    data = {name: [values] for name, values in fields.items()}
    mesh = meshio.Mesh(points, [("hexahedron", cells)], {"displacement_mm": displacements}, data)
    with whole(path) as beside:
        meshio.write(beside, mesh, file_format="vtu")
    return Path(path)


def write_series(
    path: str | Path, states: State | Sequence[State], times: ArrayLike, refine: tuple[int, int, int] = (1, 1, 1)
) -> Path:
    """Write states as a time series, a .pvd file that ParaView opens and one .vtu file per state beside it.

    states: a batch, such as `cycle.C`, or a sequence; times: (n,), one per state, increasing; refine: as in
    `write_vtu`. The .pvd comes last and each file is whole or not there, so that a run that is killed leaves a series
    that can be read. Errors: ValueError for a name that does not end in .pvd, for no states, and for times that do not
    increase or are not one per state; TypeError for what is no batch or sequence of states; as in `write_vtu`.
    """
    path = Path(path)
    if path.suffix != ".pvd":
        raise ValueError(f"path = {path} must end in .pvd")
    every = _list(states)
    at = checks.concrete("times", times, (len(every),))
    if (np.diff(at) <= 0.0).any():
        k = int(np.argmax(np.diff(at) <= 0.0))
        raise ValueError(f"times must increase; got {at[k + 1]:g} at index {k + 1} after {at[k]:g}")
    names = [f"{path.stem}_{k:04d}.vtu" for k in range(len(every))]
    for name, state in zip(names, every, strict=True):
        write_vtu(path.with_name(name), state, refine)
    sets = [f'    <DataSet timestep="{float(t)!r}" file={quoteattr(n)}/>' for t, n in zip(at, names, strict=True)]
    head = ['<?xml version="1.0" encoding="utf-8"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>"]
    with whole(path) as beside:
        beside.write_text("\n".join([*head, *sets, "  </Collection>", "</VTKFile>", ""]), encoding="utf-8")
    return path


def _list(states: State | Sequence[State]) -> list[State]:
    if isinstance(states, State):
        if jnp.ndim(states.status) != 1:
            raise TypeError(f"states must be a batch of shape (n,) or a sequence; got {jnp.shape(states.status)}")
        states = [states[k] for k in range(len(states.status))]
    if not len(states):
        raise ValueError("states is empty: a series needs at least one state")
    for k, state in enumerate(states):
        if not isinstance(state, State) or jnp.ndim(state.status):
            raise TypeError(f"states[{k}] must be one State; got {state!r}")
    return list(states)


class _Means(NamedTuple):
    """Means over the Gauss points (n_elements, ...): E and sigma in fibre axes, fibres along the local unit vectors."""

    T_f: Array
    T_cf: Array
    stretches: Array
    E: Array
    sigma: Array
    det_F: Array
    fibre: Array
    fibre_P: Array


def _body(
    state: State, N: NDArray[np.float64], pieces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Points X and displacements (n, 3) [mm], and hexahedra (n, 8), of all elements cut into pieces."""
    position = state.scene.mesh.coordinates.position
    both = [evaluate(position, theta.reshape(-1, 3)) for theta in _coordinates(state, N)]
    cells = pieces[None] + len(N) * np.arange(len(state.scene.mesh.cells))[:, None, None]
    # What is at one place and stays together is one point: elements share nodes, and a ring closes.
    at = np.concatenate(both, axis=1)
    _, first, number = np.unique(np.round(at / (1e-9 * np.ptp(at))), axis=0, return_index=True, return_inverse=True)
    X, x = both
    return X[first], (x - X)[first], number.reshape(-1)[cells.reshape(-1, 8)]


def _coordinates(state: State, N: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Θ and θ (n_elements, n, 3) at points of every element, where its shape functions are N (n, 8)."""
    mesh = state.scene.mesh
    reference = np.einsum("ga,eai->egi", N, mesh.points[mesh.cells])
    return reference, reference + np.einsum("ga,eai->egi", N, np.asarray(state.u)[mesh.cells])


def _numbers(state: State, means: _Means) -> dict[str, NDArray[np.float64]]:
    """Name → one number per element."""
    scene = state.scene
    data = {"p_kPa": np.asarray(state.p)[scene.p_patches]}
    if state.q is not None:
        data["q_kPa"] = np.asarray(state.q)[scene.q_patches]
    data |= {"T_A_f_kPa": np.asarray(means.T_f), "T_A_cf_kPa": np.asarray(means.T_cf)}
    data |= {f"stretch_{axis}": np.asarray(means.stretches)[:, i] for i, axis in enumerate(("f", "cf", "n"))}
    data |= {f"E_{name}": np.asarray(means.E)[:, i, j] for name, (i, j) in COMPONENTS.items()}
    data |= {f"sigma_{name}_kPa": np.asarray(means.sigma)[:, i, j] for name, (i, j) in COMPONENTS.items()}
    return data | {"det_F": np.asarray(means.det_F)}


def _directions(state: State, means: _Means, N: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Name → Cartesian unit vectors (n, 3) at the middles of all pieces; N: (n_pieces, 8) shape functions there."""
    data = {}
    reference, current = _coordinates(state, N)
    for name, theta, local in (("fibre", current, means.fibre), ("fibre_P", reference, means.fibre_P)):
        basis = evaluate(state.scene.mesh.coordinates.basis, theta.reshape(-1, 3)).reshape(*theta.shape, 3)
        f = np.einsum("ei,epij->epj", local, basis).reshape(-1, 3)
        data[name] = f / np.linalg.norm(f, axis=1, keepdims=True)
    return data


def _bare(state: State) -> State:
    """Without what the fields do not depend on: bodies of one size share a compiled program, whatever loads them."""
    system, inputs = replace(state.system, surfaces={}, cavities=()), state.inputs._replace(loads={})
    inputs = inputs._replace(volumes=jnp.zeros(0))
    return replace(
        state, scene=cast(Scene, None), system=system, inputs=inputs, conditions=(), cavity_pressures=jnp.zeros(0)
    )


@jax.jit
def _means(state: State) -> _Means:
    F, frame, weight = state.F, state.system.frame, state.system.weight
    share = weight / jnp.sum(weight, axis=1, keepdims=True)
    fields = _Means(
        T_f=state.T_f,
        T_cf=state.T_cf,
        stretches=state.stretches,
        E=outputs.green_lagrange(F, frame),
        sigma=state.cauchy_fibre,
        det_F=jnp.linalg.det(F),
        fibre=outputs.deformed_frame(F, frame)[..., 0, :],
        fibre_P=frame[..., 0, :],
    )
    return jax.tree.map(lambda field: jnp.einsum("eg,eg...->e...", share, field), fields)
