"""Meshes from files and into files, against box meshes and against gmsh."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo.mesh import boundary, jitter

meshio = pytest.importorskip("meshio")
SUFFIXES = [".vtu", ".xdmf", ".msh", ".inp"]


def needs(suffix: str) -> None:
    if suffix == ".xdmf":
        pytest.importorskip("h5py")


def says(*parts: str) -> str:
    """A pattern that asks for all parts, in any order."""
    return "".join(f"(?=(?s:.*){re.escape(p)})" for p in parts)


def body(fields: bool = True) -> jm.Mesh:
    """Uneven hexahedra, faces that share quads, interleaved regions, fields of every shape."""
    mesh = jitter(jm.box((3.0, 2.0, 1.0), (3, 2, 2)), 0.2, seed=1)
    rng = np.random.default_rng(0)
    n, e = len(mesh.points), len(mesh.cells)
    number = np.arange(e)
    faces = {"lid": mesh.face("z1"), "x 0": mesh.face("x0"), "part": mesh.face("z1")[2:4][::-1]}
    data = {
        "fibre": rng.normal(size=(n, 3)),
        "T": rng.normal(size=n),
        "stiffness": rng.normal(size=e),
        "cross": rng.normal(size=(e, 3)),
        "tensor": rng.normal(size=(e, 9)),
    }
    regions = {"odd": number[number % 2 == 1], "even": number[number % 2 == 0]}
    return jm.Mesh(mesh.points, mesh.cells, faces, regions=regions, fields=data if fields else {})


def canonical(quads: np.ndarray) -> list[tuple[int, ...]]:
    """Quads as a sorted list, each from its lowest node on: equal for equal faces with equal orientation."""
    return sorted(tuple(np.roll(q, -int(np.argmin(q))).tolist()) for q in quads)


def assert_same(a: jm.Mesh, b: jm.Mesh) -> None:
    np.testing.assert_array_equal(a.points, b.points)
    np.testing.assert_array_equal(a.cells, b.cells)
    assert set(a.faces) == set(b.faces)
    assert set(a.regions) == set(b.regions)
    assert set(a.fields) == set(b.fields)
    for name in a.faces:
        assert canonical(a.face(name)) == canonical(b.face(name)), name
    for name in a.regions:
        np.testing.assert_array_equal(a.region(name), b.region(name))
    for name, values in a.fields.items():
        np.testing.assert_array_equal(values, b.fields[name])


# ---------------------------------------------------------------------------------------------------- there and back


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_written_and_read_again(suffix: str, tmp_path: Path) -> None:
    needs(suffix)
    mesh = body(fields=suffix != ".inp")
    path = jm.write_mesh(tmp_path / f"body{suffix}", mesh)
    assert_same(jm.read_mesh(path), mesh)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_without_faces_and_regions(suffix: str, tmp_path: Path) -> None:
    needs(suffix)
    mesh = jm.box((1.0, 1.0, 1.0), (2, 1, 1))
    bare = jm.Mesh(mesh.points, mesh.cells)
    assert_same(jm.read_mesh(jm.write_mesh(tmp_path / f"bare{suffix}", bare)), bare)


def test_fields_have_no_place_in_abaqus_files(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=says("Abaqus", "'fibre'", ".vtu")):
        jm.write_mesh(tmp_path / "body.inp", body())


@pytest.mark.parametrize("values", [np.zeros((18, 2)), np.zeros((4, 3, 3))], ids=str)
def test_fields_that_files_do_not_take(values: Any, tmp_path: Path) -> None:
    mesh = jm.box((1.0, 1.0, 1.0), (2, 2, 1))
    with pytest.raises(ValueError, match=says("fields['a']", "(n, 9)", str(values.shape))):
        jm.write_mesh(tmp_path / "a.vtu", jm.Mesh(mesh.points, mesh.cells, fields={"a": values}))


@pytest.mark.parametrize("name", ["", "a,b", 'a"b', " a", "a\nb", "a=b"])
def test_names_that_files_do_not_take(name: str, tmp_path: Path) -> None:
    mesh = jm.box((1.0, 1.0, 1.0), (1, 1, 1))
    with pytest.raises(ValueError, match=says(repr(name), "quotes")):
        jm.write_mesh(tmp_path / "a.msh", jm.Mesh(mesh.points, mesh.cells, {name: mesh.face("x0")}))


@pytest.mark.parametrize("name", ["face", "region:a", "gmsh:physical"])
def test_fields_that_would_be_read_as_names(name: str, tmp_path: Path) -> None:
    mesh = jm.Mesh(TWO.points, TWO.cells, fields={name: np.zeros(2)})
    with pytest.raises(ValueError, match=says(repr(name), "no field")):
        jm.write_mesh(tmp_path / "a.vtu", mesh)


def test_files_are_in_cartesian_coordinates(tmp_path: Path) -> None:
    mesh = jm.structured([[1.0, 2.0], [0.0, 1.0], [0.0, 1.0]], jm.CYLINDRICAL)
    with pytest.raises(ValueError, match=says("cylindrical", "mapped")):
        jm.write_mesh(tmp_path / "a.vtu", mesh)
    straight = mesh.mapped(jm.CYLINDRICAL.position)
    assert_same(jm.read_mesh(jm.write_mesh(tmp_path / "a.vtu", straight)), straight)


def test_faces_inside_are_not_written(tmp_path: Path) -> None:
    mesh = jm.box((2.0, 1.0, 1.0), (2, 1, 1))
    inner = [[4, 5, 7, 6]]
    with pytest.raises(ValueError, match=says("face 'middle'", "1 of 1", "boundary", "[4, 5, 7, 6]")):
        jm.write_mesh(tmp_path / "a.vtu", jm.Mesh(mesh.points, mesh.cells, {"middle": inner}))


# ------------------------------------------------------------------------------------------------ what others write


def raw(path: Path, points: Any, cells: Any, **more: Any) -> Path:
    meshio.Mesh(points, cells, **more).write(path)
    return path


def test_quads_are_turned_outward(tmp_path: Path) -> None:
    mesh = jm.box((1.0, 1.0, 1.0), (1, 1, 1))
    quads = np.concatenate([mesh.face("z1")[:, ::-1], mesh.face("x0"), mesh.face("x1")[:, [0, 2, 1, 3]]])
    cells = [("quad", quads), ("hexahedron", mesh.cells)]
    face = {"face": [np.array([7, 3, 4]), np.array([0])], "region": [np.zeros(3, int), np.array([2])]}
    found = jm.read_mesh(raw(tmp_path / "a.vtu", mesh.points, cells, cell_data=face))
    assert set(found.faces) == {"7", "3", "4"}
    for number, name in (("7", "z1"), ("3", "x0"), ("4", "x1")):
        assert canonical(found.face(number)) == canonical(mesh.face(name))
    assert set(found.regions) == {"2"}


def test_faces_from_nodes(tmp_path: Path) -> None:
    """All boundary quads whose nodes are in the set; only where a file has no quads."""
    mesh = jm.box((2.0, 1.0, 1.0), (2, 1, 1))
    sets = {"lid": mesh.points[:, 2] == 1.0, "edge": (mesh.points[:, :2] == 0.0).all(axis=1)}
    nodes = {f"face:{name}": there.astype(int) for name, there in sets.items()}
    found = jm.read_mesh(raw(tmp_path / "a.vtu", mesh.points, [("hexahedron", mesh.cells)], point_data=nodes))
    assert set(found.faces) == {"lid"}
    assert canonical(found.face("lid")) == canonical(mesh.face("z1"))
    cells = [("hexahedron", mesh.cells), ("quad", mesh.face("x0"))]
    assert not jm.read_mesh(raw(tmp_path / "a.vtu", mesh.points, cells, point_data=nodes)).faces


def test_points_of_no_hexahedron_are_dropped(tmp_path: Path) -> None:
    """Where gmsh stores the centres of arcs; fields and faces keep their nodes."""
    mesh = jm.box((1.0, 1.0, 1.0), (2, 1, 1))
    points = np.concatenate([[[np.nan, 0.0, 0.0]], mesh.points[:4], [[9.0, 9.0, 9.0]], mesh.points[4:]])
    place = np.array([1, 2, 3, 4, *range(6, 14)])
    cells = [("hexahedron", place[mesh.cells]), ("quad", place[mesh.face("x1")]), ("vertex", np.array([[0]]))]
    data = {"face:lid": [np.zeros(2, int), np.ones(1, int), np.ones(1, int)]}
    found = jm.read_mesh(
        raw(tmp_path / "a.vtu", points, cells, cell_data=data, point_data={"T": np.arange(len(points), dtype=float)})
    )
    np.testing.assert_array_equal(found.points, mesh.points)
    np.testing.assert_array_equal(found.fields["T"], place)
    assert canonical(found.face("lid")) == canonical(mesh.face("x1"))


CUBE = jm.box((1.0, 1.0, 1.0), (1, 1, 1))
TWO = jm.box((2.0, 1.0, 1.0), (2, 1, 1))
TETRA = ("tetra", np.array([[0, 1, 2, 4], [1, 2, 3, 4]]))


def moved(mesh: jm.Mesh, node: int, to: Any) -> np.ndarray:
    points = mesh.points.copy()
    points[node] = to
    return points


@pytest.mark.parametrize(
    ("points", "cells", "parts"),
    [
        (CUBE.points, [("hexahedron", CUBE.cells), TETRA], ("2 tetra", "not supported", "hexahedra")),
        (CUBE.points, [TETRA, ("wedge", np.arange(6)[None])], ("2 tetra, 1 wedge", "not supported")),
        (np.zeros((20, 3)), [("hexahedron20", np.arange(20)[None])], ("1 hexahedron20", "8 nodes")),
        (CUBE.points, [("quad", CUBE.face("x0"))], ("no hexahedra", "1 quad")),
        (CUBE.points, [("hexahedron", CUBE.cells[[0, 0]])], ("1 hexahedra occur twice",)),
        (moved(CUBE, 5, np.nan), [("hexahedron", CUBE.cells)], ("finite", "node 5", "nan")),
        (
            TWO.points,
            [("hexahedron", TWO.cells[:1]), ("quad", TWO.face("x1"))],
            ("4 node(s)", "quad", "node 8 (from 0)"),
        ),
        (
            TWO.points,
            [("hexahedron", TWO.cells[:, [4, 5, 6, 7, 0, 1, 2, 3]])],
            ("element 0", "inverted", "2 such", "of 2"),
        ),
        (
            TWO.points,
            [("hexahedron", np.stack([TWO.cells[0], TWO.cells[1][[4, 5, 6, 7, 0, 1, 2, 3]]]))],
            ("element 1", "inverted", "Gauss point", "1 such", "of 2"),
        ),
        (moved(CUBE, 7, 0.2), [("hexahedron", CUBE.cells)], ("element 0", "inverted", "corner 6 (node 7)")),
    ],
)
def test_files_that_are_refused(points: Any, cells: Any, parts: tuple[str, ...], tmp_path: Path) -> None:
    path = raw(tmp_path / "bad.vtu", points, cells)
    with pytest.raises(ValueError, match=says("bad.vtu", *parts)):
        jm.read_mesh(path)


@pytest.mark.parametrize("text", ["", "no mesh", "<VTKFile></VTKFile>"])
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_files_that_hold_no_mesh(suffix: str, text: str, tmp_path: Path) -> None:
    needs(suffix)
    path = tmp_path / f"bad{suffix}"
    path.write_text(text)
    with pytest.raises(ValueError, match=f"bad{suffix}: "):
        jm.read_mesh(path)


def test_faces_inside_are_refused(tmp_path: Path) -> None:
    cells = [("hexahedron", TWO.cells), ("quad", np.array([[4, 5, 7, 6], *TWO.face("x0")]))]
    path = raw(tmp_path / "bad.vtu", TWO.points, cells, cell_data={"face:lid": [np.zeros(2, int), np.ones(2, int)]})
    with pytest.raises(ValueError, match=says("bad.vtu", "face 'lid'", "1 of 2", "boundary", "[4, 5, 7, 6]")):
        jm.read_mesh(path)


def test_unknown_suffix_and_no_file(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=says("'.stl'", ".vtu", ".xdmf", ".msh", ".inp")):
        jm.read_mesh("body.stl")
    with pytest.raises(FileNotFoundError, match="nothing"):
        jm.read_mesh(tmp_path / "nothing.msh")


@pytest.mark.parametrize(("factor", "unit"), [(1e-3, "metres"), (1e3, "micrometres")])
def test_units(factor: float, unit: str, tmp_path: Path) -> None:
    mesh = jm.box((60.0, 40.0, 40.0), (1, 1, 1))
    path = jm.write_mesh(tmp_path / "a.msh", jm.Mesh(factor * mesh.points, mesh.cells))
    with pytest.warns(UserWarning, match=says("a.msh", f"in {unit}?", f"scale={1 / factor:g}")):
        jm.read_mesh(path)
    np.testing.assert_allclose(jm.read_mesh(path, scale=1.0 / factor).points, mesh.points, rtol=1e-15)


@pytest.mark.parametrize("scale", [0.0, -1.0, np.nan])
def test_scale_that_is_none(scale: float) -> None:
    with pytest.raises(ValueError, match="scale"):
        jm.read_mesh("a.msh", scale=scale)


# ---------------------------------------------------------------------------------------------------- regions, fields


@pytest.mark.parametrize(
    ("regions", "parts"),
    [
        ({"a": [0, 1], "b": [1]}, ("overlap", "'a'", "'b'", "element 1")),
        ({"a": [1]}, ("miss 1 of 2", "element 0", "'a'")),
        ({"a": [0, 2]}, ("regions['a']", "0..2", "0..1")),
        ({"a": [0.0, 1.0]}, ("regions['a']", "integers", "float64")),
        ({"a": [[0, 1]]}, ("regions['a']", "(n,)", "(1, 2)")),
    ],
)
def test_regions_that_are_no_partition(regions: Any, parts: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=says(*parts)):
        jm.Mesh(TWO.points, TWO.cells, regions=regions)


def test_unknown_region() -> None:
    mesh = jm.Mesh(TWO.points, TWO.cells, regions={"a": [1], "b": [0]})
    np.testing.assert_array_equal(mesh.region("a"), [1])
    with pytest.raises(ValueError, match=says("region = 'c'", "'a', 'b'")):
        mesh.region("c")


def test_field_of_wrong_length() -> None:
    with pytest.raises(ValueError, match=says("fields['T']", "(12)", "(2)", "(3,)")):
        jm.Mesh(TWO.points, TWO.cells, fields={"T": np.zeros(3)})


def test_a_mapped_mesh_keeps_regions_and_fields() -> None:
    mesh = jm.Mesh(TWO.points, TWO.cells, TWO.faces, regions={"a": [0, 1]}, fields={"T": np.arange(12.0)})
    found = mesh.mapped(lambda x: 2.0 * x)
    np.testing.assert_array_equal(found.region("a"), [0, 1])
    np.testing.assert_array_equal(found.fields["T"], np.arange(12.0))
    assert set(found.faces) == set(TWO.faces)


# ------------------------------------------------------------------------------------------------------------ Abaqus

NODES = "*Node\n" + "".join(f"{10 * (k + 1)}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(TWO.points))
HEXAHEDRA = "*Element, type=c3d8rh\n" + "".join(
    f"{e + 5}, {', '.join(str(10 * (n + 1)) for n in c[:4])},\n{', '.join(str(10 * (n + 1)) for n in c[4:])}\n"
    for e, c in enumerate(TWO.cells)
)


def abaqus(tmp_path: Path, *cards: str) -> Path:
    path = tmp_path / "a.inp"
    path.write_text("*Heading\n** a comment\n" + NODES + HEXAHEDRA + "".join(cards))
    return path


def test_abaqus_sets_and_surfaces(tmp_path: Path) -> None:
    """Labels with gaps, elements over two lines, GENERATE, sets of sets, sections among overlapping sets."""
    mesh = jm.read_mesh(
        abaqus(
            tmp_path,
            "*Elset, elset=Left\n5\n*Elset, elset=right, generate\n6, 6, 1\n*Elset, elset=all\nleft, RIGHT\n",
            "*Elset, elset=_Lid_S2, internal\n5, 6\n*Surface, type=ELEMENT, name=Lid\n_Lid_S2, S2\n",
            "*Surface, name=ends\nleft, S6\n6, S4\n*Nset, nset=some, generate\n10, 40, 10\n*Nset, nset=two\n10, 20\n",
            "*Solid Section, elset=LEFT, material=m\n*Solid Section, elset=right, material=m\n",
        )
    )
    np.testing.assert_array_equal(mesh.points, TWO.points)
    np.testing.assert_array_equal(mesh.cells, TWO.cells)
    assert {name: n.tolist() for name, n in mesh.regions.items()} == {"Left": [0], "right": [1]}
    assert canonical(mesh.face("Lid")) == canonical(TWO.face("z1"))
    assert canonical(mesh.face("ends")) == canonical(np.concatenate([TWO.face("x0"), TWO.face("x1")]))
    assert canonical(mesh.face("some")) == canonical(TWO.face("x0"))
    assert set(mesh.faces) == {"Lid", "ends", "some"}


def test_abaqus_quads(tmp_path: Path) -> None:
    x1 = ", ".join(str(10 * (n + 1)) for n in TWO.face("x1")[0][::-1])
    mesh = jm.read_mesh(abaqus(tmp_path, f"*Element, type=SFM3D4, elset=end\n9, {x1}\n*Nset, nset=a\n10, 20, 30, 40\n"))
    assert canonical(mesh.face("end")) == canonical(TWO.face("x1"))
    assert set(mesh.faces) == {"end"}
    assert mesh.regions == {}


@pytest.mark.parametrize("sets", [True, False])
def test_abaqus_regions_of_elements(sets: bool, tmp_path: Path) -> None:
    """As gmsh writes them: every volume in *ELEMENT, the physical ones in *ELSET."""
    card = "*Elset, elset=wall\n5, 6\n" if sets else ""
    path = abaqus(tmp_path, card)
    path.write_text(path.read_text().replace("type=c3d8rh", "type=C3D8, ELSET=Volume1"))
    assert list(jm.read_mesh(path).regions) == ["wall" if sets else "Volume1"]


@pytest.mark.parametrize(
    ("card", "parts"),
    [
        ("*Elset, elset=a\n5, 6\n*Elset, elset=b\n6\n", ("overlap", "'a'", "'b'", "element 1")),
        ("*Element, type=C3D4\n9, 10, 20, 30, 40\n", ("1 tetra", "not supported")),
        ("*Node\n10, 0, 0, 0\n", ("1 node label", "twice")),
        ("*Include, input=b.inp\n", ("*INCLUDE", "not supported")),
        ("*Element, type=C3D8\n9, 10, 20\n", ("element 9", "2 nodes, not 8")),
        ("*Element, type=C3D20\n8, " + "10, " * 12 + "\n" + "20, " * 7 + "20\n9, 10, 20\n", ("2 hexahedron20",)),
        ("*Element, type=S4\n5, 10, 20, 30, 40\n", ("element label 5", "twice")),
        ("*Surface, name=lid\nall\n", ("surface 'lid'", "all", "S1 to S6")),
        ("*Surface, name=lid\nnone, S1\n", ("'NONE'", "does not define")),
        ("*Element, type=S4\n9, 10, 20, 30, 999\n", ("999", "does not define")),
        ("*Elset, elset=a\n77\n", ("77", "does not define")),
    ],
)
def test_abaqus_files_that_are_refused(card: str, parts: tuple[str, ...], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=says("a.inp", *parts)):
        jm.read_mesh(abaqus(tmp_path, card))


# -------------------------------------------------------------------------------------------------------------- gmsh

Option = tuple[str, bool]


@pytest.fixture
def session() -> Any:
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Verbosity", 1)
    yield gmsh
    gmsh.finalize()


def gmsh_block(gmsh: Any, path: Path, version: float, binary: bool, fibre: Callable[[np.ndarray], np.ndarray]) -> None:
    """A block 3 × 2 × 1 mm of 3 × 2 × 1 hexahedra in two volumes, with a view per element and one per node."""
    gmsh.model.add("block")
    left = gmsh.model.occ.addBox(0, 0, 0, 1, 2, 1)
    right = gmsh.model.occ.addBox(1, 0, 0, 2, 2, 1)
    gmsh.model.occ.addPoint(7, 7, 7)
    gmsh.model.occ.fragment([(3, left)], [(3, right)])
    gmsh.model.occ.synchronize()
    for _, curve in gmsh.model.getEntities(1):
        a, b = (
            np.array(gmsh.model.getValue(0, p, [])) for _, p in gmsh.model.getBoundary([(1, curve)], oriented=False)
        )
        gmsh.model.mesh.setTransfiniteCurve(curve, round(float(np.linalg.norm(a - b))) + 1)
    for _, surface in gmsh.model.getEntities(2):
        gmsh.model.mesh.setTransfiniteSurface(surface)
        gmsh.model.mesh.setRecombine(2, surface)
    faces: dict[str, list[int]] = {}
    for _, volume in gmsh.model.getEntities(3):
        gmsh.model.mesh.setTransfiniteVolume(volume)
        middle = gmsh.model.occ.getCenterOfMass(3, volume)[0]
        gmsh.model.addPhysicalGroup(3, [volume], name="left wall" if middle < 1 else "right")
    for _, surface in gmsh.model.getEntities(2):
        x, y, z = gmsh.model.occ.getCenterOfMass(2, surface)
        for name, on in (("x0", x < 0.1), ("x1", x > 2.9), ("z1", z > 0.9), ("y0", y < 0.1)):
            if on:
                faces.setdefault(name, []).append(surface)
    for name, surfaces in faces.items():
        gmsh.model.addPhysicalGroup(2, surfaces, name=name)
    gmsh.model.mesh.generate(3)
    nodes, x, _ = gmsh.model.mesh.getNodes()
    at = dict(zip(nodes.tolist(), x.reshape(-1, 3), strict=True))
    _, (elements,), (corners,) = _hexahedra(gmsh)
    centres = np.array([np.mean([at[n] for n in own], axis=0) for own in corners.reshape(-1, 8).tolist()])
    by_node, by_element = gmsh.view.add("fibre"), gmsh.view.add("centre")
    backwards = nodes[::-1]  # in an order of their own
    gmsh.view.addModelData(by_node, 0, "block", "NodeData", backwards, [fibre(at[n]) for n in backwards.tolist()])
    gmsh.view.addModelData(by_element, 0, "block", "ElementData", elements, centres)
    gmsh.option.setNumber("Mesh.MshFileVersion", version)
    gmsh.option.setNumber("Mesh.Binary", binary)
    gmsh.option.setNumber("PostProcessing.SaveMesh", 0)
    gmsh.write(str(path))
    for view in (by_node, by_element):
        gmsh.view.write(view, str(path), append=True)


def _hexahedra(gmsh: Any) -> tuple[Any, Any, Any]:
    found = [gmsh.model.mesh.getElements(3, volume) for _, volume in gmsh.model.getEntities(3)]
    return [5], [np.concatenate([f[1][0] for f in found])], [np.concatenate([f[2][0] for f in found])]


def fibre(x: np.ndarray) -> np.ndarray:
    return np.array([np.cos(x[0]), np.sin(x[0]), x[1] * x[2]])


@pytest.mark.parametrize("binary", [False, True], ids=["text", "binary"])
@pytest.mark.parametrize("version", [4.1, 2.2])
def test_a_block_of_gmsh(version: float, binary: bool, tmp_path: Path, session: Any) -> None:
    path = tmp_path / "block.msh"
    gmsh_block(session, path, version, binary, fibre)
    mesh, expected = jm.read_mesh(path), jm.box((3.0, 2.0, 1.0), (3, 2, 1))
    # The box's number of each node, by its place.
    number = {tuple(np.round(x).astype(int)): k for k, x in enumerate(expected.points)}
    to = np.array([number[tuple(np.round(x).astype(int))] for x in mesh.points])
    np.testing.assert_allclose(mesh.points, expected.points[to], atol=1e-12)
    assert sorted(map(sorted, to[mesh.cells].tolist())) == sorted(map(sorted, expected.cells.tolist()))
    assert set(mesh.faces) == {"x0", "x1", "y0", "z1"}
    for name in mesh.faces:
        assert canonical(to[mesh.face(name)]) == canonical(expected.face(name))
    centres = mesh.points[mesh.cells].mean(axis=1)
    assert set(mesh.regions) == {"left wall", "right"}
    np.testing.assert_array_equal(mesh.region("left wall"), np.flatnonzero(centres[:, 0] < 1.0))
    np.testing.assert_allclose(mesh.fields["centre"], centres, atol=1e-12)
    np.testing.assert_allclose(mesh.fields["fibre"], [fibre(x) for x in mesh.points], atol=1e-12)
    for suffix in (".msh", ".vtu"):
        assert_same(jm.read_mesh(jm.write_mesh(tmp_path / f"again{suffix}", mesh)), mesh)


def test_gmsh_reads_what_is_written(tmp_path: Path, session: Any) -> None:
    mesh = body()
    session.open(str(jm.write_mesh(tmp_path / "a.msh", mesh)))
    labels, x, _ = session.model.mesh.getNodes()
    np.testing.assert_array_equal(x.reshape(-1, 3)[np.argsort(labels)], mesh.points)
    groups = {session.model.getPhysicalName(d, t): (d, t) for d, t in session.model.getPhysicalGroups()}
    assert set(groups) == {"lid", "x 0", "part", "odd", "even"}
    for name, (dim, tag) in groups.items():
        own = [session.model.mesh.getElements(dim, e) for e in session.model.getEntitiesForPhysicalGroup(dim, tag)]
        nodes = np.concatenate([o[2][0] for o in own]).reshape(-1, 4 if dim == 2 else 8).astype(int) - 1
        there = mesh.face(name) if dim == 2 else mesh.cells[mesh.region(name)]
        assert sorted(nodes.tolist()) == sorted(there.tolist())
    views = [session.view.getModelData(tag, 0) for tag in session.view.getTags()]
    assert sorted(kind for kind, *_ in views) == ["ElementData"] * 3 + ["NodeData"] * 2


def test_values_for_some_elements_only(tmp_path: Path) -> None:
    """By their labels, whatever their order; a view of the quads alone is no field of the hexahedra."""
    mesh = jm.Mesh(TWO.points, TWO.cells, {"lid": TWO.face("z1")}, fields={"T": np.array([5.0, 6.0])})
    path = jm.write_mesh(tmp_path / "a.msh", mesh)
    text = path.read_text()
    view = text[text.index("$ElementData") :]
    other = view.replace('"T"', '"quads"').replace("\n1 5.0\n2 6.0\n", "\n3 5.0\n4 6.0\n")
    some = view.replace("\n2\n1 5.0\n2 6.0\n", "\n3\n4 1.0\n3 2.0\n2 7.0\n")
    path.write_text(text.replace(view, some) + other)
    assert "quads" in path.read_text()
    fields = jm.read_mesh(path).fields
    assert set(fields) == {"T"}
    np.testing.assert_array_equal(fields["T"], [np.nan, 7.0])


def test_msh_of_another_version(tmp_path: Path) -> None:
    path = tmp_path / "a.msh"
    path.write_text("$MeshFormat\n4.0 0 8\n$EndMeshFormat\n$Nodes\n$EndNodes\n$Elements\n$EndElements\n")
    with pytest.raises(ValueError, match=says("a.msh", "4.0", "4.1 or 2.2")):
        jm.read_mesh(path)


def test_the_boundary_of_a_box() -> None:
    mesh = jm.box((1.0, 2.0, 3.0), (3, 2, 2))
    assert canonical(boundary(mesh.cells)) == canonical(np.concatenate(list(mesh.faces.values())))
