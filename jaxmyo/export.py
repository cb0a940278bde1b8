"""A state as a file for ParaView: the undeformed body with its displacements and the fields of its elements.

An element in curved coordinates is no straight-edged hexahedron; it is cut into pieces that look like it.
"""

from dataclasses import replace
from pathlib import Path
from typing import cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxmyo import checks
from jaxmyo.coordinates import evaluate
from jaxmyo.hexahedron import shape
from jaxmyo.mesh import structured
from jaxmyo.scene import Scene
from jaxmyo.state import State

#: Components of the Cauchy stress in fibre axes: fibre f, cross-fibre c, normal n.
COMPONENTS = {"ff": (0, 0), "cc": (1, 1), "nn": (2, 2), "fc": (0, 1), "fn": (0, 2), "cn": (1, 2)}


def write_vtu(path: str | Path, state: State, refine: tuple[int, int, int] = (1, 1, 1)) -> Path:
    """Write one state as a VTK file of hexahedra (.vtu), which ParaView opens ("Warp By Vector" deforms it).

    Points: Cartesian positions in the zero-stress state P [mm]. Point data: displacement_mm, x − X (3,) in Cartesian
    components [mm]. Cell data, means over the Gauss points of an element (of the volume in P): p_kPa, the pressure;
    q_kPa, the multiplier of the weave, only in a free contraction with the weave; T_A_f_kPa, T_A_cf_kPa, the
    pseudo-active tensions; stretch_f, stretch_cf, stretch_n [–]; sigma_ff_kPa, sigma_cc_kPa, sigma_nn_kPa,
    sigma_fc_kPa, sigma_fn_kPa, sigma_cn_kPa, the Cauchy stress in deformed fibre axes, fibre f, cross-fibre c and
    normal n (numbers, not a tensor: programs take tensors as Cartesian); det_F [–], 1 where the volume is kept.

    refine: pieces per element along its three coordinates, at least 1; nodes are interpolated by the element's shape
    functions in world coordinates, cell data are repeated. An element of `radial_tube` is a whole ring:
    refine=(1, 48, 1) shows it as one. Errors: ModuleNotFoundError without meshio, TypeError for a batch of states,
    ValueError for refine < 1.
    """
    try:
        import meshio  # type: ignore[import-untyped]
    except ModuleNotFoundError as error:
        message = f"write_vtu needs {error.name}, which is not installed: pip install 'jaxmyo[mesh]'"
        raise ModuleNotFoundError(message, name=error.name) from error
    if jnp.ndim(state.status):
        raise TypeError(f"state is a batch of shape {jnp.shape(state.status)}; write one of them, state[i]")
    pieces = structured([np.linspace(-1.0, 1.0, n + 1) for n in checks.counts("refine", refine, 3)])
    points, displacements, cells = _body(state, shape(pieces.points), pieces.cells)
    fields = {name: [np.repeat(values, len(pieces.cells))] for name, values in _cell_data(state).items()}
    mesh = meshio.Mesh(points, [("hexahedron", cells)], {"displacement_mm": displacements}, fields)
    meshio.write(path, mesh, file_format="vtu")
    return Path(path)


def _body(
    state: State, N: NDArray[np.float64], pieces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Points X and displacements (n, 3) [mm], and hexahedra (n, 8), of all elements cut into pieces."""
    mesh = state.scene.mesh
    position = mesh.coordinates.position
    reference = np.einsum("ga,eai->egi", N, mesh.points[mesh.cells])
    current = reference + np.einsum("ga,eai->egi", N, np.asarray(state.u)[mesh.cells])
    X, x = (evaluate(position, theta.reshape(-1, 3)) for theta in (reference, current))
    cells = pieces[None] + len(N) * np.arange(len(mesh.cells))[:, None, None]
    # What is at one place and stays together is one point: elements share nodes, and a ring closes.
    both = np.concatenate([X, x], axis=1)
    _, first, number = np.unique(np.round(both / (1e-9 * np.ptp(both))), axis=0, return_index=True, return_inverse=True)
    return X[first], (x - X)[first], number.reshape(-1)[cells.reshape(-1, 8)]


def _cell_data(state: State) -> dict[str, NDArray[np.float64]]:
    """Name → one number per element."""
    scene = state.scene
    data = {"p_kPa": np.asarray(state.p)[scene.p_patches]}
    if state.q is not None:
        data["q_kPa"] = np.asarray(state.q)[scene.q_patches]
    # Without what the fields do not depend on, bodies of one size share a compiled program, whatever loads them.
    system, inputs = replace(state.system, surfaces={}), state.inputs._replace(loads={})
    bare = replace(state, scene=cast(Scene, None), system=system, inputs=inputs, conditions=())
    T_f, T_cf, stretches, sigma, det_F = (np.asarray(field) for field in _means(bare))
    data |= {"T_A_f_kPa": T_f, "T_A_cf_kPa": T_cf}
    data |= {f"stretch_{axis}": stretches[:, i] for i, axis in enumerate(("f", "cf", "n"))}
    data |= {f"sigma_{name}_kPa": sigma[:, i, j] for name, (i, j) in COMPONENTS.items()}
    return data | {"det_F": det_F}


@jax.jit
def _means(state: State) -> tuple[Array, ...]:
    """T_f, T_cf, stretches, Cauchy stress in fibre axes, det F: means (n_elements, ...) over the Gauss points."""
    fields = (state.T_f, state.T_cf, state.stretches, state.cauchy_fibre, jnp.linalg.det(state.F))
    share = state.system.weight / jnp.sum(state.system.weight, axis=1, keepdims=True)
    return tuple(jnp.einsum("eg,eg...->e...", share, field) for field in fields)
