"""What a scene models, in words: `print(scene)`."""

import numpy as np

from jaxmyo.conditions import Displacement, Homogeneous, Proportional, Tie, Uniform
from jaxmyo.cost import cost, needless
from jaxmyo.scene import Scene
from jaxmyo.ties import Ties


def describe(scene: Scene) -> str:
    """Coordinates, unknowns of each kind, ties, multipliers, loads, what is left out, what it costs; one line each.

    Lines that begin with "needless:" say what is modelled though nothing depends on it.
    """
    mesh, ties = scene.mesh, scene.kinematics(())
    c, n_e = mesh.coordinates, len(mesh.cells)
    grid = " (" + " × ".join(map(str, mesh.grid)) + ")" if mesh.grid else ""
    axes = ", ".join(f"{a} [{u}]" for a, u in zip(c.axes, c.units, strict=True))
    n_p, n_q = int(scene.p_patches.max()) + 1, int(scene.q_patches.max()) + 1
    orders = " × ".join(map(str, scene.orders))
    law = getattr(scene.law, "__name__", repr(scene.law))
    return "\n".join(
        [
            f"Scene of {n_e} hexahedr{'on' if n_e == 1 else 'a'}{grid}, Q1–Q0, {orders} Gauss points each",
            f"  coordinates: {c.name} {axes}; F in their local orthonormal bases",
            f"  law: {law}; {_fibres(scene)}",
            *(f"  region {name}: {_material(scene, name)}" for name in scene.regions),
            f"  displacements: {ties.size} unknown of {ties.scale.size} nodal ones ({_per_component(scene, ties)})",
            *(f"  tie: {_tie(t)}" for t in scene.supports if isinstance(t, Tie)),
            *(f"  spring: {s}, energy ½ k u² per area" for s in scene.springs),
            f"  pressure p: {n_p}, {_patches(scene.p_patches)}, I3 = 1 in the mean of each",
            f"  weave q: {n_q}, {_patches(scene.q_patches)}, in state A only, where contract() is given a_over_D",
            "  loads: none in state A; state C has those that load() is given, on the body "
            "and on the faces " + ", ".join(sorted(mesh.faces)),
            f"  left out: {'; '.join([*_left_out(scene), 'inertia, viscosity, compressibility'])}",
            f"  cost: {cost(scene)}",
            *(f"  needless: {words}" for words in needless(scene)),
        ]
    )


def _material(scene: Scene, name: str) -> str:
    m, n = scene.regions[name], len(scene.mesh.region(name))
    left_out = [word for word, acts in (("passive", m.active), ("without the weave", m.weave)) if not acts]
    return ", ".join([f"{n} elements of {getattr(m.law, '__name__', repr(m.law))}", *left_out])


def _fibres(scene: Scene) -> str:
    words = []
    for k, name in enumerate(("fibre", "cross-fibre")):
        d = scene.frame[:, :, k].reshape(-1, 3)
        constant = np.ptp(d, axis=0).max() < 1e-12
        words.append(
            f"{name} {np.array2string(d[0] + 0.0, precision=4, suppress_small=True)}"
            if constant
            else f"{name}: a field"
        )
    return ", ".join(words)


def _per_component(scene: Scene, ties: Ties) -> str:
    index, scale = ties.index.reshape(-1, 3), ties.scale.reshape(-1, 3)
    return ", ".join(
        f"u_{a} {len(np.unique(index[scale[:, k] != 0.0, k]))}" for k, a in enumerate(scene.mesh.coordinates.axes)
    )


def _tie(tie: Tie) -> str:
    if isinstance(tie, Displacement):
        return f"u_{tie.axis} = {tie.value} on {tie.face}"
    if isinstance(tie, Uniform):
        return f"u_{tie.axis} does not vary along {', '.join(tie.along)}"
    if isinstance(tie, Proportional):
        return f"u_{tie.axis} = one unknown × {tie.to}"
    return str(tie)


def _patches(numbers: np.ndarray) -> str:
    size = np.bincount(numbers)
    if (size == 1).all():
        return "one per element"
    counts = f"{size[0]}" if np.ptp(size) == 0 else f"{size.min()} to {size.max()}"
    return f"one per patch of {counts} elements"


def _left_out(scene: Scene) -> list[str]:
    """The variations that ties and Gauss points do not model."""
    found = []
    if any(isinstance(t, Homogeneous) for t in scene.supports):
        found.append("shear, and every deformation that is not homogeneous")
    for axis, order in zip(scene.mesh.coordinates.axes, scene.orders, strict=True):
        if order == 1:
            found.append(f"variation of strain along {axis} within an element (one Gauss point)")
        along = [t.axis for t in scene.supports if isinstance(t, Uniform) and axis in t.along]
        if along:
            found.append(f"variation of {', '.join(f'u_{a}' for a in along)} along {axis}")
        if any(isinstance(t, Proportional) and t.axis == t.to == axis for t in scene.supports):
            found.append(f"sections {axis} = const. that do not stay plane")
    return found
