"""print(scene) says what is modelled: each line against the scene and its discrete problem."""

import re
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import sample

import jaxmyo as jm
from jaxmyo import element_batches
from jaxmyo.coordinates import CYLINDRICAL
from jaxmyo.cost import cost
from jaxmyo.mesh import structured
from jaxmyo.solve import contraction
from jaxmyo.system import System


def lines(scene: jm.Scene) -> dict[str, list[str]]:
    """The words after each "key: ", in order."""
    found: dict[str, list[str]] = {}
    for line in str(scene).splitlines()[1:]:
        assert line.startswith("  ")
        key, words = line.strip().split(": ", 1)
        found.setdefault(key, []).append(words)
    return found


SCENES = {
    "sample": lambda: sample(),
    "mesh": lambda: sample((2, 2, 1)),
    "radial": lambda: jm.radial_tube(4),
    "twist": lambda: jm.radial_tube(2, twist=True, q_patches=None),
    "axisymmetric": lambda: jm.axisymmetric_tube((2, 3)),
    "sector": lambda: jm.tube_sector((2, 2, 2)),
    "cartesian": lambda: jm.tube_sector((2, 2, 2), cartesian=True, ends="free"),
}


@pytest.fixture(scope="module", params=SCENES)
def named(request: pytest.FixtureRequest) -> tuple[str, jm.Scene]:
    return request.param, SCENES[request.param]()


def test_the_head(named: Any, capsys: pytest.CaptureFixture[str]) -> None:
    name, scene = named
    print(scene)
    head = capsys.readouterr().out.splitlines()[0]
    expected = {
        "sample": "Scene of 1 hexahedron (1 × 1 × 1), Q1–Q0, 1 × 1 × 1 Gauss points each",
        "mesh": "Scene of 4 hexahedra (2 × 2 × 1), Q1–Q0, 2 × 2 × 2 Gauss points each",
        "radial": "Scene of 4 hexahedra (4 × 1 × 1), Q1–Q0, 2 × 1 × 1 Gauss points each",
        "twist": "Scene of 2 hexahedra (2 × 1 × 1), Q1–Q0, 2 × 1 × 1 Gauss points each",
        "axisymmetric": "Scene of 6 hexahedra (2 × 1 × 3), Q1–Q0, 2 × 1 × 2 Gauss points each",
        "sector": "Scene of 8 hexahedra (2 × 2 × 2), Q1–Q0, 2 × 2 × 2 Gauss points each",
        "cartesian": "Scene of 8 hexahedra (2 × 2 × 2), Q1–Q0, 2 × 2 × 2 Gauss points each",
    }
    assert head == expected[name]


def test_coordinates_and_law(named: Any) -> None:
    name, scene = named
    said = lines(scene)
    if name in ("sample", "mesh", "cartesian"):
        assert said["coordinates"][0].startswith("Cartesian x [mm], y [mm], z [mm];")
    else:
        assert said["coordinates"][0].startswith("cylindrical r [mm], phi [rad], z [mm];")
    fibres = {
        "sample": "fibre [1. 0. 0.], cross-fibre [0. 1. 0.]",
        "mesh": "fibre [1. 0. 0.], cross-fibre [0. 1. 0.]",
        "cartesian": "fibre: a field, cross-fibre [0. 0. 1.]",
    }
    assert said["law"] == [f"lin_yin; {fibres.get(name, 'fibre [0. 1. 0.], cross-fibre [0. 0. 1.]')}"]


def test_unknowns_are_those_of_the_system(named: Any) -> None:
    _, scene = named
    ties = scene.kinematics(())
    system = System.of(scene, ties, weave=True, surfaces={})
    said = lines(scene)
    got = re.fullmatch(r"(\d+) unknown of (\d+) nodal ones \((.*)\)", said["displacements"][0])
    assert got is not None
    assert int(got[1]) == system.n_u == ties.size
    assert int(got[2]) == scene.mesh.points.size
    per_axis = dict(part.rsplit(" ", 1) for part in got[3].split(", "))
    assert list(per_axis) == [f"u_{a}" for a in scene.mesh.coordinates.axes]
    assert sum(int(n) for n in per_axis.values()) == system.n_u
    # The displacements of one component, if every unknown is moved by itself.
    for k, count in enumerate(per_axis.values()):
        own = {int(i) for i, s in zip(ties.index[k::3], ties.scale[k::3], strict=True) if s != 0.0}
        assert int(count) == len(own)
    assert said["pressure p"][0].startswith(f"{system.n_p}, one per ")
    assert said["weave q"][0].startswith(f"{system.n_q}, one per ")


def test_unknowns_in_numbers() -> None:
    counts = {name: lines(make())["displacements"][0] for name, make in SCENES.items()}
    assert counts["sample"] == "3 unknown of 24 nodal ones (u_x 1, u_y 1, u_z 1)"
    assert counts["mesh"] == "33 unknown of 54 nodal ones (u_x 12, u_y 12, u_z 9)"
    assert counts["radial"] == "6 unknown of 60 nodal ones (u_r 5, u_phi 0, u_z 1)"
    assert counts["twist"] == "5 unknown of 36 nodal ones (u_r 3, u_phi 1, u_z 1)"
    assert counts["axisymmetric"] == "19 unknown of 72 nodal ones (u_r 12, u_phi 0, u_z 7)"
    assert counts["sector"] == "46 unknown of 81 nodal ones (u_r 27, u_phi 9, u_z 10)"
    assert counts["cartesian"] == "54 unknown of 81 nodal ones (u_x 18, u_y 18, u_z 18)"


def test_every_support_has_its_line(named: Any) -> None:
    name, scene = named
    said = lines(scene)
    expected = {
        "sample": ["Homogeneous()"],
        "mesh": ["u_x = 0.0 on x0", "u_y = 0.0 on y0", "u_z = 0.0 on z0"],
        "radial": [
            "u_r does not vary along phi, z",
            "u_z = one unknown × z",
            "u_phi = one unknown × z",
            "u_phi = 0.0 on z1",
        ],
        "twist": ["u_r does not vary along phi, z", "u_z = one unknown × z", "u_phi = one unknown × z"],
        "axisymmetric": [
            "u_r does not vary along phi",
            "u_z does not vary along phi",
            "u_phi does not vary along r, phi, z",
            "u_z = 0.0 on z0",
            "u_phi = 0.0 on z0",
            "Planar(face='z1', axis='z')",
        ],
        "sector": ["u_z = 0.0 on z0", "Planar(face='z1', axis='z')", "u_phi = 0.0 on phi0", "u_phi = 0.0 on phi1"],
        "cartesian": ["u_z = 0.0 on z0", "u_y = 0.0 on phi0", "u_x = 0.0 on phi1"],
    }
    assert said["tie"] == expected[name]
    assert "spring" not in said


def test_multipliers_and_their_patches(named: Any) -> None:
    name, scene = named
    said = lines(scene)
    n_e = len(scene.mesh.cells)
    assert said["pressure p"][0].startswith(f"{n_e}, one per element, ")
    columns = {"radial": "1, one per patch of 4", "axisymmetric": "3, one per patch of 2"}
    columns |= {"sector": "4, one per patch of 2", "cartesian": "4, one per patch of 2"}
    q = f"{columns[name]} elements, " if name in columns else f"{n_e}, one per element, "
    assert said["weave q"][0].startswith(q)
    assert "state A only" in said["weave q"][0]
    assert "a_over_D" in said["weave q"][0]


def test_loads_and_faces(named: Any) -> None:
    _, scene = named
    (loads,) = lines(scene)["loads"]
    assert "none in state A" in loads
    assert loads.split("on the faces ")[1].split(", ") == sorted(scene.mesh.faces)


def test_what_is_left_out(named: Any) -> None:
    name, scene = named
    (words,) = lines(scene)["left out"]
    found = words.split("; ")
    assert found[-1] == "inertia, viscosity, compressibility"
    one_point = {
        "sample": "xyz",
        "radial": ("phi", "z"),
        "twist": ("phi", "z"),
        "axisymmetric": ("phi",),
    }.get(name, ())
    for axis in scene.mesh.coordinates.axes:
        line = f"variation of strain along {axis} within an element (one Gauss point)"
        assert (line in found) == (axis in one_point)
    uniform = {
        "radial": {"variation of u_r along phi", "variation of u_r along z"},
        "twist": {"variation of u_r along phi", "variation of u_r along z"},
        "axisymmetric": {
            "variation of u_r, u_z, u_phi along phi",
            "variation of u_phi along r",
            "variation of u_phi along z",
        },
    }.get(name, set())
    assert {f for f in found if f.startswith("variation of u_")} == uniform
    assert ("sections z = const. that do not stay plane" in found) == (name in ("radial", "twist"))


def test_springs_and_uneven_patches_have_their_lines() -> None:
    mesh = jm.box((3.0, 1.0, 1.0), (3, 1, 1))
    springs = jm.Spring("x0", 2.5), jm.Spring("z1", 1.0, "normal")
    scene = jm.Scene(mesh, jm.lin_yin, jm.TABLE1, supports=(*springs, jm.Stretch("x", 1.1)), p_patches=[0, 0, 1])
    said = lines(scene)
    assert [s.split(", energy")[0] for s in said["spring"]] == [str(s) for s in springs]
    assert said["tie"] == [str(jm.Stretch("x", 1.1))]
    assert said["pressure p"][0].startswith("2, one per patch of 1 to 2 elements, ")
    assert said["displacements"][0].startswith("44 unknown of 48 ")
    assert np.unique(scene.q_patches).size == 3


def test_a_mesh_without_a_grid_and_a_law_without_a_name() -> None:
    class Law:
        def __call__(self, C: Any, frame: Any, beta: Any, constants: Any) -> Any:
            return jm.lin_yin(C, frame, beta, constants)

        def __repr__(self) -> str:
            return "my law"

    mesh = jm.box((3.0, 1.0, 1.0), (3, 1, 1))
    loose = jm.Mesh(mesh.points, mesh.cells, mesh.faces)
    scene = jm.Scene(loose, Law(), jm.TABLE1, supports=(jm.Spring("x0", 1.0),))
    assert str(scene).splitlines()[0] == "Scene of 3 hexahedra, Q1–Q0, 2 × 2 × 2 Gauss points each"
    assert lines(scene)["law"][0].startswith("my law; ")


def needless(scene: jm.Scene) -> list[str]:
    return lines(scene).get("needless", [])


def test_the_cost_counts_unknowns_and_points(named: Any) -> None:
    _, scene = named
    (words,) = lines(scene)["cost"]
    ties = scene.kinematics(())
    A = System.of(scene, ties, weave=True, surfaces={})
    C = System.of(scene, ties, weave=False, surfaces={})
    assert words.startswith(f"{A.size} unknowns in state A with the weave, else {C.size} (dense LU); ")
    assert f"differentiated twice: {A.weight.size};" in words
    assert re.search(r"by estimate [0-9.e-]+ ms per Newton iteration \(elements \d+%, factors \d+%\)", words)


def test_the_cost_of_a_large_body_is_that_of_sparse_factors() -> None:
    scene = jm.specimen((12, 12, 2))
    (words,) = lines(scene)["cost"]
    assert scene.kinematics(()).size > 1000
    assert "(Pardiso)" in words or "(SuperLU)" in words
    more = cost(jm.specimen((16, 16, 4)))
    assert more.elements > cost(scene).elements
    assert more.factors > cost(scene).factors


def test_what_the_ready_scenes_model_is_needed(named: Any) -> None:
    name, scene = named
    assert len(needless(scene)) == (name == "mesh")


@pytest.mark.parametrize("mesh", [{"elements": (2, 2, 1)}, {"elements": (3, 2, 2), "distortion": 0.2}])
def test_three_dimensions_of_a_homogeneous_state_are_needless(mesh: Any) -> None:
    scene = jm.thin_sample(**mesh)
    (words,) = needless(scene)
    n = len(scene.mesh.cells)
    assert words.startswith(f"{n} elements with {scene.kinematics(()).size} displacements, {n} p and {n} q, if ")
    assert "Homogeneous()" in words


def box(**given: Any) -> jm.Scene:
    planes = tuple(jm.Symmetry(a) for a in "xyz")
    return jm.Scene(jm.box((2.0, 1.0, 1.0), (2, 1, 1)), jm.lin_yin, jm.TABLE1, **({"supports": planes} | given))


def test_what_bends_or_varies_is_not_homogeneous() -> None:
    assert len(needless(box())) == 1
    planes = tuple(jm.Symmetry(a) for a in "xyz")
    clamp = jm.Displacement("x0", "y"), jm.Displacement("x0", "z")
    half = replace(jm.box((2.0, 1.0, 1.0), (2, 1, 1)), regions={"half": np.array([0]), "rest": np.array([1])})

    def turning(x: Any) -> Any:
        return np.stack([np.cos(x[:, 0]), np.sin(x[:, 0]), 0.0 * x[:, 0]], axis=1)

    assert needless(box(supports=(*planes, *clamp))) == []
    assert needless(box(supports=(*planes, jm.Spring("x1", 1.0)))) == []
    assert needless(box(supports=(*planes, jm.Displacement("x1", "x", 0.1)))) == []
    assert needless(box(fibre=turning, cross=(0.0, 0.0, 1.0))) == []
    scar = {"half": jm.Material(jm.lin_yin, jm.MEASURED)}
    assert needless(jm.Scene(half, jm.lin_yin, jm.TABLE1, supports=planes, regions=scar)) == []
    wedge = jm.box((2.0, 1.0, 1.0), (2, 1, 1))
    points = wedge.points * (1.0 - 0.2 * wedge.points[:, [0]] * np.array([0.0, 0.0, 1.0]))
    assert needless(jm.Scene(replace(wedge, points=points), jm.lin_yin, jm.TABLE1, supports=planes)) == []


def test_points_along_which_nothing_varies_are_needless() -> None:
    (words,) = needless(jm.thin_sample(quadrature=2))
    assert words == "2 × 2 × 2 Gauss points along x, y, z: nothing varies there in an element, 1 is exact"
    (words,) = needless(replace(jm.radial_tube(3), quadrature=2))
    assert words.startswith("2 × 2 Gauss points along phi, z: ")
    (words,) = needless(replace(jm.axisymmetric_tube((2, 2)), quadrature=2))
    assert words.startswith("2 Gauss points along phi: ")

    def turning(theta: Any) -> Any:  # along z
        a = 0.05 * theta[:, 2]
        return np.stack([0.0 * a, np.cos(a), np.sin(a)], axis=1)

    tube = replace(jm.radial_tube(3, fibre=turning, cross=(1.0, 0.0, 0.0)), quadrature=2)
    (words,) = needless(tube)
    assert words.startswith("2 Gauss points along phi: ")


def test_one_point_is_exact_where_it_is_said_to_be() -> None:
    """The residual of the sample with eight points is that with one."""
    z = jnp.asarray([0.1, -0.05, 0.02, 3.0, 1.0])

    def residual(points: int) -> Any:
        system, inputs, _ = contraction(jm.thin_sample(quadrature=points), 5.0, 0.2, 1.0, None, None)
        return jax.jit(element_batches.residual_and_tangent)(system, z, inputs)[0]

    np.testing.assert_allclose(residual(2), residual(1), rtol=1e-12, atol=1e-12)


def test_elements_and_multipliers_where_one_would_do_are_needless() -> None:
    mesh = jm.box((10.0, 10.0, 1.0), (2, 3, 1))
    scene = jm.Scene(mesh, jm.lin_yin, jm.TABLE1, supports=(jm.Homogeneous(),), quadrature=1)
    words = needless(scene)
    assert words[0].startswith("6 p and 6 q in a homogeneous body: ")
    assert {w.split(":")[0] for w in words[1:]} == {"2 elements along x", "3 elements along y"}
    nodes = np.linspace(2.0, 3.5, 4), np.linspace(0.0, 2 * np.pi, 2), np.linspace(0.0, 20.0, 3)
    directions = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    supports = jm.radial_tube(3).supports
    long = jm.Scene(structured(nodes, CYLINDRICAL), jm.lin_yin, jm.TABLE1, *directions, supports, (2, 1, 1))
    assert [w.split(":")[0] for w in needless(long)] == ["2 elements along z"]


def test_the_weave_of_a_passive_body_is_needless() -> None:
    mesh = replace(jm.box((1.0, 1.0, 1.0), (1, 1, 1)), regions={"all": np.array([0])})

    def body(active: bool) -> jm.Scene:
        regions = {"all": jm.Material(jm.lin_yin, jm.TABLE1, active=active)}
        supports = (jm.Homogeneous(),)
        return jm.Scene(mesh, jm.lin_yin, jm.TABLE1, supports=supports, quadrature=1, regions=regions)

    (words,) = needless(body(active=False))
    assert words.startswith("the weave q, as no element is active: ")
    assert needless(body(active=True)) == []


def test_a_passive_state_with_the_weave_says_so() -> None:
    scene = sample()
    assert "needless: 1 q of the weave in a passive state" in str(jm.contract(scene, T0=35.0, a_over_D=0.2, beta=0.0))
    assert "needless" not in str(jm.contract(scene, T0=5.0, a_over_D=0.2))
