"""`write_vtu`: the file is read back with meshio and held against the state."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import meshio
import numpy as np
import pytest
from numpy.typing import NDArray

import jaxmyo as jm
from jaxmyo.export import write_series, write_vtu
from jaxmyo.hexahedron import gauss, shape_gradient

SEGMENTS = 48  # of a ring


@pytest.fixture(scope="module")
def sample() -> jm.State:
    """With a fibre between the axes, so that every component of the stress in fibre axes could go astray."""
    scene = jm.Scene(
        jm.box((10.0, 10.0, 1.0), (2, 2, 1)),
        jm.lin_yin,
        jm.TABLE1,
        fibre=(0.8, 0.6, 0.0),
        cross=(-0.6, 0.8, 0.0),
        supports=(jm.Symmetry("x"), jm.Symmetry("y"), jm.Symmetry("z")),
    )
    return jm.contract(scene, T0=2.0, a_over_D=0.2)


@pytest.fixture(scope="module")
def tube() -> jm.State:
    return jm.contract(jm.radial_tube(3), T0=15.0, a_over_D=None)


def read(path: Path) -> tuple[meshio.Mesh, NDArray[np.int64]]:
    mesh = meshio.read(path)
    (block,) = mesh.cells
    assert block.type == "hexahedron"
    return mesh, block.data


def volumes(points: NDArray[np.float64], cells: NDArray[np.int64]) -> NDArray[np.float64]:
    """Of the hexahedra (n,); an error if one is inverted at a Gauss point."""
    xi, w = gauss(2, 2, 2)
    det = np.linalg.det(np.einsum("eai,gaj->egij", points[cells], shape_gradient(xi)))
    assert det.min() > 0.0
    return det @ w


def by_position(mesh: meshio.Mesh) -> dict[tuple[float, ...], NDArray[np.float64]]:
    """Point rounded to 1e-9 mm → its displacement."""
    displacements = mesh.point_data["displacement_mm"]
    return {tuple(np.round(X, 9) + 0.0): u for X, u in zip(mesh.points, displacements, strict=True)}


def test_round_trip(sample: jm.State, tmp_path: Path) -> None:
    path = write_vtu(tmp_path / "a.vtu", sample)
    assert path == tmp_path / "a.vtu"
    mesh, cells = read(path)
    found = by_position(mesh)
    assert len(found) == len(mesh.points) == 18
    for X, u in zip(sample.scene.mesh.points, np.asarray(sample.u), strict=True):
        np.testing.assert_allclose(found[tuple(X)], u, rtol=0, atol=1e-14)
    np.testing.assert_allclose(volumes(mesh.points, cells), 25.0, rtol=1e-12)
    of_scene = sample.scene.mesh
    np.testing.assert_array_equal(mesh.points[cells], of_scene.points[of_scene.cells])


def test_cell_data(sample: jm.State, tmp_path: Path) -> None:
    mesh, _ = read(write_vtu(tmp_path / "a.vtu", sample))
    data = {name: values for name, (values,) in mesh.cell_data.items()}
    np.testing.assert_array_equal(data.pop("p_kPa"), sample.p)
    np.testing.assert_array_equal(data.pop("q_kPa"), sample.q)
    mean = lambda field: np.asarray(field).mean(axis=1)  # noqa: E731  (equal elements: all weights are the same)
    close = {"rtol": 1e-12, "atol": 1e-12}
    np.testing.assert_allclose(data.pop("T_A_f_kPa"), mean(sample.T_f), **close)
    np.testing.assert_allclose(data.pop("T_A_cf_kPa"), mean(sample.T_cf), **close)
    for i, axis in enumerate(("f", "cf", "n")):
        np.testing.assert_allclose(data.pop(f"stretch_{axis}"), mean(sample.stretches)[:, i], **close)
    np.testing.assert_allclose(data.pop("det_F"), 1.0, atol=1e-2)  # the mean of I3, not of J, is 1 in each element
    sigma = mean(sample.cauchy_fibre)
    frame = sample.system.frame
    E = 0.5 * (mean(frame @ sample.C @ jnp.swapaxes(frame, -1, -2)) - np.eye(3))
    for i, row in enumerate("fcn"):
        for j, column in enumerate("fcn"):
            if j >= i:
                np.testing.assert_allclose(data.pop(f"sigma_{row}{column}_kPa"), sigma[:, i, j], **close)
                np.testing.assert_allclose(data.pop(f"E_{row}{column}"), E[:, i, j], **close)
    np.testing.assert_allclose(data.pop("fibre_P"), [[0.8, 0.6, 0.0]] * 4, **close)
    f = np.einsum("egij,j->egi", sample.F, [0.8, 0.6, 0.0])
    f = (f / np.linalg.norm(f, axis=-1, keepdims=True)).mean(axis=1)
    np.testing.assert_allclose(data.pop("fibre"), f / np.linalg.norm(f, axis=-1, keepdims=True), **close)
    assert data == {}


def test_refined_box(sample: jm.State, tmp_path: Path) -> None:
    mesh, cells = read(write_vtu(tmp_path / "a.vtu", sample, refine=(2, 1, 3)))
    assert (len(mesh.points), len(cells)) == (5 * 3 * 4, 2 * 2 * 6)
    np.testing.assert_allclose(volumes(mesh.points, cells).sum(), 100.0, rtol=1e-12)
    volumes(mesh.points + mesh.point_data["displacement_mm"], cells)
    found, u = by_position(mesh), np.asarray(sample.u)
    at = {tuple(X): u[i] for i, X in enumerate(sample.scene.mesh.points)}
    between = 0.5 * (at[0.0, 5.0, 0.0] + at[5.0, 5.0, 0.0])
    np.testing.assert_allclose(found[2.5, 5.0, 0.0], between, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(mesh.cell_data["p_kPa"][0], np.repeat(np.asarray(sample.p), 6))


@pytest.mark.slow
def test_ring(tube: jm.State, tmp_path: Path) -> None:
    mesh, cells = read(write_vtu(tmp_path / "a.vtu", tube, refine=(1, SEGMENTS, 1)))
    assert (len(mesh.points), len(cells)) == (4 * SEGMENTS * 2, 3 * SEGMENTS)  # the ring closes
    assert "q_kPa" not in mesh.cell_data
    polygon = 0.5 * SEGMENTS * np.sin(2.0 * np.pi / SEGMENTS)  # the area of that of radius 1, for π
    np.testing.assert_allclose(volumes(mesh.points, cells).sum(), polygon * (3.5**2 - 2.0**2) * 20.0, rtol=1e-12)
    moved = mesh.points + mesh.point_data["displacement_mm"]
    # det F = 1 in the mean of each element, and a polygon of the same number of sides
    np.testing.assert_allclose(volumes(moved, cells).sum(), volumes(mesh.points, cells).sum(), rtol=2e-3)
    R, r = (np.hypot(points[:, 0], points[:, 1]) for points in (mesh.points, moved))
    nodes = tube.scene.mesh.points[:, 0]
    for node, u in zip(nodes, np.asarray(tube.u)[:, 0], strict=True):
        np.testing.assert_allclose(r[np.abs(R - node) < 1e-9], node + u, rtol=1e-12)
    np.testing.assert_allclose(mesh.cell_data["det_F"][0], 1.0, atol=5e-3)
    np.testing.assert_array_equal(mesh.cell_data["T_A_cf_kPa"][0], 0.0)


@pytest.mark.slow
def test_fibres_of_a_ring(tube: jm.State, tmp_path: Path) -> None:
    """They go round with its pieces, and turn with the body."""
    mesh, cells = read(write_vtu(tmp_path / "a.vtu", tube, refine=(2, SEGMENTS, 1)))
    x, y, z = mesh.points[cells].mean(axis=1).T
    around = np.stack([-y, x, 0.0 * z], axis=1) / np.hypot(x, y)[:, None]
    np.testing.assert_allclose(mesh.cell_data["fibre_P"][0], around, rtol=0, atol=1e-12)
    np.testing.assert_allclose(mesh.cell_data["fibre"][0], around, rtol=0, atol=1e-12)
    turned = replace(tube, u=tube.u + jnp.array([[0.0, 0.5, 0.0]]))  # a rigid rotation by 0.5 rad about the axis
    mesh, _ = read(write_vtu(tmp_path / "b.vtu", turned, refine=(2, SEGMENTS, 1)))
    c, s = np.cos(0.5), np.sin(0.5)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(mesh.cell_data["fibre"][0], around @ rotation.T, rtol=0, atol=1e-12)


def test_means_are_of_the_volume(tube: jm.State, tmp_path: Path) -> None:
    """Around an axis the outer Gauss point of an element stands for more volume than the inner one."""
    mesh, _ = read(write_vtu(tmp_path / "a.vtu", tube))
    weight, around = np.asarray(tube.system.weight), np.asarray(tube.stretches)[..., 0]
    expected = np.sum(weight * around, axis=1) / weight.sum(axis=1)
    np.testing.assert_allclose(mesh.cell_data["stretch_f"][0], expected, rtol=1e-14)
    assert np.abs(expected - around.mean(axis=1)).max() > 1e-4


def test_one_state_at_a_time(tube: jm.State, tmp_path: Path) -> None:
    batch = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), tube)
    with pytest.raises(TypeError, match=r"batch of shape \(2,\); write one of them, state\[i\]"):
        write_vtu(tmp_path / "a.vtu", batch)
    assert not list(tmp_path.iterdir())
    write_vtu(tmp_path / "a.vtu", batch[1])


def test_states_of_a_shared_system(tube: jm.State, tmp_path: Path) -> None:
    """A batch as `cycle` returns it shares one system."""
    batch = replace(jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), tube), system=tube.system)
    assert write_vtu(tmp_path / "a.vtu", batch[0]).read_bytes() == write_vtu(tmp_path / "b.vtu", tube).read_bytes()


@pytest.mark.parametrize("refine", [(1, 0, 1), (1, 1), (1, 1.5, 1)])
def test_refine_is_checked(tube: jm.State, tmp_path: Path, refine: tuple[int, int, int]) -> None:
    with pytest.raises(ValueError, match="refine"):
        write_vtu(tmp_path / "a.vtu", tube, refine=refine)


def test_missing_meshio_is_named(tube: jm.State, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "meshio", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'jaxmyo\[mesh\]'"):
        write_vtu(tmp_path / "a.vtu", tube)


def series(path: Path) -> list[tuple[float, Path]]:
    """The times and files of a .pvd file."""
    root = ElementTree.parse(path).getroot()
    assert (root.tag, root.get("type")) == ("VTKFile", "Collection")
    sets = root.findall("Collection/DataSet")
    return [(float(entry.attrib["timestep"]), path.parent / entry.attrib["file"]) for entry in sets]


def test_series(tube: jm.State, tmp_path: Path) -> None:
    rest = replace(tube, u=0.0 * tube.u)
    batch = replace(jax.tree.map(lambda *leaves: jnp.stack(leaves), rest, tube), system=tube.system)
    path = write_series(tmp_path / "a & b.pvd", batch, [0.1, 0.3], refine=(1, SEGMENTS, 1))
    assert path == tmp_path / "a & b.pvd"
    found = series(path)
    assert [t for t, _ in found] == [0.1, 0.3]
    assert sorted(tmp_path.iterdir()) == sorted([path, *(file for _, file in found)])
    for (_, file), state in zip(found, (rest, tube), strict=True):
        alone = write_vtu(tmp_path / "alone.vtu", state, refine=(1, SEGMENTS, 1))
        assert file.read_bytes() == alone.read_bytes()
    of_list = series(write_series(tmp_path / "list.pvd", [rest, tube, rest], np.array([-1.0, 0.0, 1e-9])))
    assert [t for t, _ in of_list] == [-1.0, 0.0, 1e-9]
    assert np.abs(meshio.read(of_list[0][1]).point_data["displacement_mm"]).max() == 0.0


def test_a_killed_series(tube: jm.State, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Killed while it writes its second file: the series that was there before is whole."""
    path = write_series(tmp_path / "a.pvd", [tube, tube], [0.0, 1.0])
    before = path.read_text()
    write, calls = meshio.write, []

    def killed(file: Path, *arguments: Any, **options: Any) -> None:
        calls.append(file)
        if len(calls) == 2:
            Path(file).write_text("half a fi")
            raise KeyboardInterrupt
        write(file, *arguments, **options)

    monkeypatch.setattr(meshio, "write", killed)
    for name, files in (("a.pvd", 3), ("new.pvd", 4)):
        calls.clear()
        with pytest.raises(KeyboardInterrupt):
            write_series(tmp_path / name, [tube, tube, tube], [0.0, 1.0, 2.0])
        assert len(list(tmp_path.iterdir())) == files
    assert path.read_text() == before
    assert not (tmp_path / "new.pvd").exists()
    for _, file in series(path):
        read(file)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.0, 1.0, 1.0], r"times must increase; got 1 at index 2 after 1"),
        ([0.0, 2.0, 1.0], r"times must increase; got 1 at index 2 after 2"),
        ([0.0, 1.0], r"times must have shape \(3,\); got \(2,\)"),
        ([0.0, 1.0, np.inf], r"times must be finite; got inf at index \(2,\)"),
    ],
)
def test_times_are_checked(tube: jm.State, tmp_path: Path, times: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        write_series(tmp_path / "a.pvd", [tube] * 3, times)
    assert not list(tmp_path.iterdir())


def test_series_of_states(tube: jm.State, tmp_path: Path) -> None:
    pair = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), tube)
    for states, error, message in [
        (tube, TypeError, r"states must be a batch of shape \(n,\) or a sequence; got \(\)"),
        ([], ValueError, "states is empty"),
        ([tube, pair], TypeError, r"states\[1\] must be one State"),
        ([tube, None], TypeError, r"states\[1\] must be one State; got None"),
    ]:
        with pytest.raises(error, match=message):
            write_series(tmp_path / "a.pvd", states, [0.0, 1.0])
    with pytest.raises(ValueError, match=r"path = .*a\.vtu must end in \.pvd"):
        write_series(tmp_path / "a.vtu", [tube], [0.0])
    assert not list(tmp_path.iterdir())
