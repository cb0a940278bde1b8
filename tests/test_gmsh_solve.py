"""From gmsh to a solved body and back into files, against the same body as a structured box."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo import solve

meshio = pytest.importorskip("meshio")

LENGTHS, ELEMENTS = (3.0, 2.0, 1.0), (3, 2, 2)  # mm
T0, A_OVER_D = 5.0, 0.2


def angle(x: Any) -> Any:
    """Of the fibre to the x axis at points x (n, 3)."""
    return 0.3 * x[:, 2]


def fibre(x: Any) -> Any:
    return np.stack([np.cos(angle(x)), np.sin(angle(x)), np.zeros(len(x))], axis=1)


def cross(x: Any) -> Any:
    return np.stack([-np.sin(angle(x)), np.cos(angle(x)), np.zeros(len(x))], axis=1)


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> jm.Mesh:
    """Written by gmsh: transfinite hexahedra, physical groups, a view of fibres and one of cross-fibres."""
    gmsh = pytest.importorskip("gmsh")
    path = tmp_path_factory.mktemp("gmsh") / "block.msh"
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 1)
        gmsh.model.add("block")
        gmsh.model.occ.addBox(0, 0, 0, *LENGTHS)
        gmsh.model.occ.synchronize()
        for _, curve in gmsh.model.getEntities(1):
            x0, y0, z0, x1, y1, z1 = gmsh.model.getBoundingBox(1, curve)
            along = int(np.argmax([x1 - x0, y1 - y0, z1 - z0]))
            gmsh.model.mesh.setTransfiniteCurve(curve, ELEMENTS[along] + 1)
        for _, surface in gmsh.model.getEntities(2):
            gmsh.model.mesh.setTransfiniteSurface(surface)
            gmsh.model.mesh.setRecombine(2, surface)
            middle = np.array(gmsh.model.occ.getCenterOfMass(2, surface)) / LENGTHS
            axis = int(np.argmax(np.abs(middle - 0.5)))
            gmsh.model.addPhysicalGroup(2, [surface], name=f"{'xyz'[axis]}{round(middle[axis])}")
        ((_, volume),) = gmsh.model.getEntities(3)
        gmsh.model.mesh.setTransfiniteVolume(volume)
        gmsh.model.addPhysicalGroup(3, [volume], name="muscle")
        gmsh.model.mesh.generate(3)
        nodes, x, _ = gmsh.model.mesh.getNodes()
        views = []
        for name, field in (("fibre", fibre), ("cross", cross)):
            views.append(gmsh.view.add(name))
            gmsh.view.addModelData(views[-1], 0, "block", "NodeData", nodes, field(x.reshape(-1, 3)))
        gmsh.option.setNumber("PostProcessing.SaveMesh", 0)
        gmsh.write(str(path))
        for view in views:
            gmsh.view.write(view, str(path), append=True)
    finally:
        gmsh.finalize()
    return jm.read_mesh(path)


def solved(mesh: jm.Mesh, fibres: Any, crosses: Any) -> tuple[jm.State, jm.State]:
    supports = (jm.Symmetry("x"), jm.Symmetry("y"), jm.Symmetry("z"))
    scene = jm.Scene(mesh, jm.lin_yin, jm.TABLE1, fibres, crosses, supports)
    A = jm.contract(scene, T0=T0, a_over_D=A_OVER_D)
    return A, jm.load(A, jm.Stretch("x", 1.05), jm.Pressure("z1", 0.2))


@pytest.fixture(scope="module")
def states(block: jm.Mesh) -> Any:
    """A and C of the block of gmsh and of the box, by sparse factors, which compile faster."""
    box = jm.box(LENGTHS, ELEMENTS)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solve, "LARGE", 0)
        return solved(block, "fibre", "cross"), solved(box, fibre(box.points), cross(box.points))


def places(x: Any) -> dict[tuple[int, ...], int]:
    """The number of each point, by its place."""
    found = {tuple(np.round(1e6 * p).astype(int)): k for k, p in enumerate(x)}
    assert len(found) == len(x)
    return found


def numbers(x: Any, among: Any) -> Any:
    """The numbers of the points x (n, 3) among others."""
    number = places(among)
    return np.array([number[p] for p in places(x)])


def centres(mesh: jm.Mesh) -> Any:
    return mesh.points[mesh.cells].mean(axis=1)


def test_the_mesh_is_that_of_the_box(block: jm.Mesh) -> None:
    box = jm.box(LENGTHS, ELEMENTS)
    assert set(block.faces) == set(box.faces)
    assert set(block.regions) == {"muscle"}
    assert sorted(numbers(block.points, box.points)) == list(range(len(box.points)))
    for name in box.faces:
        own = numbers(block.points, box.points)[block.face(name)]
        assert sorted(map(sorted, own.tolist())) == sorted(map(sorted, box.face(name).tolist()))


@pytest.mark.parametrize("k", [0, 1], ids=["A", "C"])
def test_the_same_numbers(states: Any, k: int) -> None:
    state, reference = states[0][k], states[1][k]
    nodes = numbers(state.scene.mesh.points, reference.scene.mesh.points)
    elements = numbers(centres(state.scene.mesh), centres(reference.scene.mesh))
    assert not (nodes == np.arange(len(nodes))).all()  # gmsh numbers the nodes otherwise
    assert np.abs(np.asarray(reference.u)).max() > 0.05
    close = {"rtol": 0, "atol": 1e-10}
    np.testing.assert_allclose(np.asarray(state.u), np.asarray(reference.u)[nodes], **close)
    np.testing.assert_allclose(np.asarray(state.p), np.asarray(reference.p)[elements], rtol=0, atol=1e-9)
    if k == 0:
        np.testing.assert_allclose(np.asarray(state.q), np.asarray(reference.q)[elements], rtol=0, atol=1e-9)
    for name in ("stretches", "cauchy_fibre", "T_f", "T_cf"):
        own, other = (np.asarray(getattr(s, name)).mean(axis=1) for s in (state, reference))
        np.testing.assert_allclose(own, other[elements], rtol=0, atol=1e-9, err_msg=name)
    np.testing.assert_allclose(
        np.asarray(state.reaction("x0")), np.asarray(reference.reaction("x0")), rtol=0, atol=1e-9
    )


def test_written_back(states: Any, tmp_path: Path) -> None:
    """The mesh as it was read, with what was found beside it; the state as a file for ParaView."""
    state = states[0][1]
    mesh = state.scene.mesh
    fields = {**mesh.fields, "u": np.asarray(state.u), "pressure": np.asarray(state.p)}
    result = jm.Mesh(mesh.points, mesh.cells, mesh.faces, regions=mesh.regions, fields=fields)
    for suffix in (".vtu", ".msh"):
        again = jm.read_mesh(jm.write_mesh(tmp_path / f"result{suffix}", result))
        np.testing.assert_array_equal(again.points, mesh.points)
        np.testing.assert_array_equal(again.cells, mesh.cells)
        assert set(again.faces) == set(mesh.faces)
        assert set(again.regions) == {"muscle"}
        for name, values in fields.items():
            np.testing.assert_array_equal(again.fields[name], values)
    shown = meshio.read(jm.write_vtu(tmp_path / "C.vtu", state))
    nodes = numbers(shown.points, mesh.points)  # in an order of its own
    assert sorted(nodes) == list(range(len(mesh.points)))
    shown_u = shown.point_data["displacement_mm"]
    np.testing.assert_allclose(shown_u, np.asarray(state.u)[nodes], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(nodes[shown.cells_dict["hexahedron"]], mesh.cells)
    np.testing.assert_allclose(shown.cell_data["p_kPa"][0], np.asarray(state.p), rtol=1e-12)
    sigma = np.asarray(state.cauchy_fibre)[..., 0, 0].mean(axis=1)
    np.testing.assert_allclose(shown.cell_data["sigma_ff_kPa"][0], sigma, rtol=0, atol=1e-12)
