"""`save_state` and `load_state`: what goes on from a file is what would have gone on from the state."""

import io
import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo import restart

#: The last one is a tie: of it a state C has the system, not the condition.
LOADS = (jm.Pressure("inner", 4.0), jm.Spring("outer", jnp.asarray(0.5)), jm.Stretch("z", 0.97))


@pytest.fixture(scope="module")
def scene() -> jm.Scene:
    return jm.radial_tube(4)


@pytest.fixture(scope="module")
def A(scene: jm.Scene) -> jm.State:
    return jm.contract(scene, T0=15.0, a_over_D=0.2, beta=0.5)


@pytest.fixture(scope="module")
def C(A: jm.State) -> jm.State:
    return jm.load(A, *LOADS)


@pytest.fixture
def reloaded(tmp_path: Path) -> Callable[[jm.State], jm.State]:
    """The state through a file, with a scene that was built anew."""

    def through(state: jm.State, scene: jm.Scene | None = None) -> jm.State:
        path = jm.save_state(tmp_path / "state.npz", state)
        assert [file.name for file in tmp_path.iterdir()] == ["state.npz"]
        return jm.load_state(path, scene or jm.radial_tube(4))

    return through


def assert_same(a: jm.State, b: jm.State) -> None:
    """To the last bit, with every kind of leaf; only the scene is another object."""
    b = replace(b, scene=a.scene)
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for (path, x), y in zip(jax.tree_util.tree_flatten_with_path(a)[0], jax.tree.leaves(b), strict=True):
        assert (np.asarray(x).dtype, np.shape(x)) == (np.asarray(y).dtype, np.shape(y)), path
        np.testing.assert_array_equal(x, y, err_msg=jax.tree_util.keystr(path))


def test_round_trip(A: jm.State, C: jm.State, reloaded: Callable[..., jm.State]) -> None:
    for state in (A, C):
        again = reloaded(state)
        assert_same(state, again)
        assert str(again) == str(state)
    assert again.conditions == LOADS[:2]
    assert again.q is None


def test_what_follows_is_the_same(A: jm.State, C: jm.State, reloaded: Callable[..., jm.State]) -> None:
    scene = jm.radial_tube(4)
    A_again, C_again = reloaded(A, scene), reloaded(C, scene)
    assert_same(C, jm.load(A_again, *LOADS))
    further = (jm.Pressure("inner", 5.0), *LOADS[1:])
    assert_same(jm.load(A, *further, start=C), jm.load(A_again, *further, start=C_again))
    more = {"T0": 15.0, "a_over_D": 0.2, "beta": 0.6}
    assert_same(jm.contract(A.scene, start=A, **more), jm.contract(scene, start=A_again, **more))


def test_conditions_keep_their_kinds(C: jm.State, reloaded: Callable[..., jm.State]) -> None:
    """A vector may be a tuple, a list or an array; which it is decides whether loads are the same with other values."""
    vectors = [(0.0, 0, 0.1), [0.0, 0.0, 0.1], np.array([0.0, 0.0, 0.1])]
    conditions = tuple(jm.Traction("z1", v, "cauchy") for v in vectors)
    assert_same(replace(C, conditions=conditions), reloaded(replace(C, conditions=conditions)))


def in_regions(active: bool = True) -> jm.Scene:
    """The tube with an outer half of its own material."""
    scene = jm.radial_tube(4)
    mesh = replace(scene.mesh, regions={"in": np.array([0, 1]), "out": np.array([2, 3])})
    return replace(scene, mesh=mesh, regions={"out": jm.Material(jm.lin_yin, jm.TABLE1, active=active)})


@pytest.mark.slow
def test_cavities_body_forces_and_regions(reloaded: Callable[..., jm.State]) -> None:
    A = jm.contract(in_regions(), T0=5.0, a_over_D=None)
    inside = float(A.cavity_volume("inner"))
    C = jm.load(A, jm.Volume("inner", 1.05 * inside), jm.BodyForce((0.1, 0.0, 0.0), region="out"))
    again = reloaded(C, in_regions())
    assert_same(C, again)
    assert str(again) == str(C)
    assert again.cavity_pressures[0] == C.cavity_pressures[0]
    with pytest.raises(ValueError, match=r"they differ in: regions$"):
        reloaded(C, in_regions(active=False))


def test_loads_that_faded_are_still_there(C: jm.State, reloaded: Callable[..., jm.State]) -> None:
    """After `load(A, start=C)` with other kinds of conditions, the old ones stay in the system, with 0 kPa."""
    faded = {kind: 0.0 * values for kind, values in C.inputs.loads.items()}
    state = replace(C, inputs=C.inputs._replace(loads=faded), conditions=())
    again = reloaded(state)
    assert set(again.system.surfaces) == {"open", "spring"}
    assert_same(state, again)


def test_batches(C: jm.State, reloaded: Callable[..., jm.State]) -> None:
    """Each state of a batch has its system, as `vmap` makes them, or they share one, as in a `cycle`."""
    many = jax.tree.map(lambda x: jnp.stack([x, x]), C)
    for batch in (many, replace(many, system=C.system)):
        again = reloaded(batch)
        assert_same(batch, again)
        assert str(again) == str(batch)
        assert_same(C, again[1])


def test_a_state_that_failed(A: jm.State, C: jm.State, reloaded: Callable[..., jm.State]) -> None:
    failed = replace(C, status=jnp.asarray(jm.Status.TOO_MANY_STEPS), reached=jnp.asarray(0.25))
    again = reloaded(failed)
    assert_same(failed, again)
    assert again.message == failed.message
    with pytest.raises(ValueError, match=r"start is not converged: TOO_MANY_STEPS at 25 %"):
        jm.load(reloaded(A, again.scene), jm.Pressure("inner", 1.0), start=again)


@pytest.mark.parametrize(
    ("other", "parts"),
    [
        (lambda: jm.radial_tube(5), ["mesh points", "cells", "faces", "coordinates", "fibre and cross"]),
        (lambda: jm.radial_tube(4, grading=2.0), ["mesh points", "coordinates"]),
        (lambda: jm.radial_tube(4, constants=jm.MEASURED), ["constants", "energy density"]),
        (lambda: jm.radial_tube(4, twist=True), ["supports"]),
        (lambda: jm.radial_tube(4, q_patches=[0, 0, 1, 1]), ["q_patches"]),
        (lambda: jm.radial_tube(4, fibre=(0.0, 0.8, 0.6), cross=(0.0, -0.6, 0.8)), ["fibre and cross"]),
        (lambda: jm.radial_tube(4, law=lambda C, frame, beta, c: jm.lin_yin(C, frame, beta, c)), ["law"]),
        (lambda: replace_face(jm.radial_tube(4)), ["faces"]),
    ],
)
def test_another_scene(
    other: Callable[[], jm.Scene], parts: list[str], A: jm.State, reloaded: Callable[..., jm.State]
) -> None:
    with pytest.raises(ValueError, match=r"scene is not the one of the state in .*; they differ in: ") as error:
        reloaded(A, other())
    found = str(error.value).split("differ in: ")[1].split(", ")
    assert set(parts) <= set(found) <= {*parts, "p_patches", "q_patches"}


def replace_face(scene: jm.Scene) -> jm.Scene:
    faces = {("lumen" if name == "inner" else name): quads for name, quads in scene.mesh.faces.items()}
    return replace(scene, mesh=replace(scene.mesh, faces=faces))


def test_what_is_no_other_scene(A: jm.State, reloaded: Callable[..., jm.State]) -> None:
    """Round-off, and numbers of another type in the supports."""
    scene = jm.radial_tube(4)
    points = scene.mesh.points * (1.0 + 1e-15)
    (held,) = (s for s in scene.supports if isinstance(s, jm.Displacement))
    supports = tuple(replace(s, value=0) if s is held else s for s in scene.supports)
    reloaded(A, replace(scene, mesh=replace(scene.mesh, points=points), supports=supports))


def test_files_that_are_no_states(A: jm.State, scene: jm.Scene, tmp_path: Path) -> None:
    path = tmp_path / "state.npz"
    whole = jm.save_state(path, A).read_bytes()
    for n in (4, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:n])
        with pytest.raises(ValueError, match=r"state.npz is truncated or damaged"):
            jm.load_state(path, scene)
    damaged = bytearray(whole)
    at = whole.index(np.asarray(A.u).tobytes())
    damaged[at] ^= 1
    path.write_bytes(damaged)
    with pytest.raises(ValueError, match=r"truncated or damaged: Bad CRC"):
        jm.load_state(path, scene)
    npz, npy, without_header = io.BytesIO(), io.BytesIO(), io.BytesIO()
    np.savez(npz, u=np.zeros(3))
    np.save(npy, np.zeros(3))
    np.savez(without_header, header=np.frombuffer(b"[1, 2]", dtype=np.uint8))
    for content in (b"", b"hello", npz.getvalue(), npy.getvalue(), without_header.getvalue()):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"state.npz is no file of `save_state`"):
            jm.load_state(path, scene)
    with pytest.raises(FileNotFoundError):
        jm.load_state(tmp_path / "none.npz", scene)
    with pytest.raises(TypeError, match="scene must be a Scene; got None"):
        jm.load_state(path, None)  # type: ignore[arg-type]


class Executed:
    def __reduce__(self) -> Any:
        return (pytest.fail, ("the file was executed",))


def test_nothing_in_a_file_is_executed(scene: jm.Scene, tmp_path: Path) -> None:
    path, code = tmp_path / "state.npz", np.array([Executed()], dtype=object)
    np.savez(path, allow_pickle=True, header=code)
    with pytest.raises(ValueError, match="truncated or damaged: Object arrays cannot be loaded"):
        jm.load_state(path, scene)
    path.write_bytes(pickle.dumps(Executed()))
    with pytest.raises(ValueError, match="no file of `save_state`"):
        jm.load_state(path, scene)


def test_another_version(A: jm.State, scene: jm.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "state.npz"
    monkeypatch.setattr(restart, "VERSION", 99)
    jm.save_state(path, A)
    monkeypatch.undo()
    with pytest.raises(ValueError, match=r"state.npz is of format version 99; this jaxmyo reads 3"):
        jm.load_state(path, scene)


def test_the_file_is_plain(C: jm.State, tmp_path: Path) -> None:
    with np.load(jm.save_state(tmp_path / "C", C), allow_pickle=False) as file:
        np.testing.assert_array_equal(file["fields.u"], C.u)
        np.testing.assert_array_equal(file["inputs.T_f"], C.inputs.T_f)
        header = json.loads(file["header"].tobytes())
        assert not any(name.startswith("system.columns") for name in file.files)
    assert (header["format"], header["version"]) == ("jaxmyo state", 3)
    pressure = header["state"]["dict"]["conditions"]["tuple"][0]["Pressure"]
    assert pressure == {"face": "inner", "value": 4.0, "ends": "open"}


def test_what_cannot_be_saved(scene: jm.Scene, A: jm.State, tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="state must be a State; got 3"):
        jm.save_state(tmp_path / "a", 3)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="state is traced"):
        jax.jit(lambda state: jm.save_state(tmp_path / "a", state))(A)
    other = replace(A, inputs=A.inputs._replace(constants={"mu": jnp.ones(())}))
    with pytest.raises(ValueError, match=r"constants = \{'mu': .*another structure"):
        jm.save_state(tmp_path / "a", other)
    assert not list(tmp_path.iterdir())


def test_a_killed_run_leaves_the_old_file(
    A: jm.State, C: jm.State, scene: jm.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = jm.save_state(tmp_path / "state.npz", A)

    def killed(file: Any, **_: Any) -> None:
        file.write(b"PK\x03\x04")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez", killed)
    with pytest.raises(KeyboardInterrupt):
        jm.save_state(path, C)
    assert list(tmp_path.iterdir()) == [path]
    assert_same(A, jm.load_state(path, scene))
