"""Studies: what they compute, how they name it, and what they refuse."""

import csv
import json
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from scipy.io import netcdf_file

import jaxmyo as jm
from jaxmyo.status import Status
from jaxmyo.studies.evaluation import LAPACK, Evaluation
from jaxmyo.studies.identity import primitives

AXES = {"a_over_D": np.linspace(0.0, 0.25, 3), "beta": [0.0, 0.1, 0.5, 1.0], "T0": 35.0}
NAMES = ["lambda_f", "lambda_cf", "lambda_n", "T_cf", "negative_eigenvalues"]


@pytest.fixture(scope="module")
def scene() -> jm.Scene:
    return jm.thin_sample()


@pytest.fixture(scope="module")
def result(scene: jm.Scene) -> jm.Study:
    """12 contractions in three chunks, the last one filled up, with derivatives."""
    return jm.study(scene, AXES, NAMES, derivatives=["T0", "a_over_D"], chunk=5)


def closed_form(x: Any, y: Any, k: Any = 2.0) -> dict[str, Any]:
    """A function that costs nothing; it fails beyond x = 3 and is not finite at y = 0."""
    status = jnp.where(x > 3.0, Status.NO_DESCENT, Status.CONVERGED)
    return {"z": x**k / y, "pair": jnp.stack([x, y]), "status": status}


UNITS = {"x": "mm", "y": "kPa", "k": "–", "z": "mm²/kPa", "pair": "–"}
POINTS = {"x": [1.0, 2.0, 4.0], "y": [-1.0, 0.0, 2.0, 4.0]}


@pytest.fixture(scope="module")
def cheap() -> jm.Study:
    return jm.study(closed_form, {**POINTS, "k": 2.0}, units=UNITS, derivatives=True, chunk=5)


def exact(T0: float, i: int, j: int) -> reference.FreeContraction:
    """The hand-derived equations, at a point of the grid but for T0."""
    return reference.free_contraction(reference.SETS["table1"], T0, AXES["a_over_D"][i], AXES["beta"][j])


def test_a_study_is_what_the_hand_derived_equations_give(result: jm.Study) -> None:
    assert result.shape == (3, 4)
    assert list(result.values) == NAMES
    for i, j in np.ndindex(3, 4):
        one = exact(35.0, i, j)
        np.testing.assert_allclose([result[name][i, j] for name in NAMES[:3]], one.stretches, rtol=1e-10)
        np.testing.assert_allclose(result["T_cf"][i, j], one.T_cf, rtol=1e-9, atol=1e-12)
    assert result.converged.all()
    assert "12 samples (grid: a_over_D 3 × beta 4), 12 converged" in repr(result)
    assert result.failures() == "every sample converged"


def test_derivatives_of_a_study(result: jm.Study) -> None:
    """Against differences."""
    h = 1e-3
    slope, elasticity = result.derivative("lambda_f", "T0"), result.elasticity("lambda_f", "T0")
    for i, j in ((0, 1), (1, 2), (2, 3)):
        ends = [exact(35.0 + sign * h, i, j).stretches[0] for sign in (1, -1)]
        assert slope[i, j] == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-6)
        assert elasticity[i, j] == pytest.approx(slope[i, j] * 35.0 / result["lambda_f"][i, j])
    assert result.units["d_lambda_f_d_T0"] == "1/kPa"
    assert result.units["d_T_cf_d_a_over_D"] == "kPa"
    assert "d_negative_eigenvalues_d_T0" not in result.derivatives
    assert result.derivative_status is not None
    assert (result.derivative_status == Status.CONVERGED).all()


@pytest.mark.slow
def test_a_failed_sample_disturbs_no_other(scene: jm.Scene) -> None:
    """An activation that cannot be, and rest: without the weave there is no stiffness, hence no derivative."""

    def free(activation: Any) -> jm.State:
        return jm.contract(scene, T0=35.0, a_over_D=None, beta=activation)

    outputs = {"fibre": "lambda_f", "every": lambda A: A.mean("stretches")}
    axes, units = {"activation": [0.0, 2.0, 1.0]}, {"activation": "–", "every": "–"}
    found = jm.study(free, axes, outputs, units=units, derivatives=True, chunk=3)
    assert found.status.tolist() == [Status.CONVERGED, Status.INVALID_INPUT, Status.CONVERGED]
    assert found.derivative_status is not None
    assert found.derivative_status.tolist() == [Status.SINGULAR, Status.INVALID_INPUT, Status.CONVERGED]
    assert np.isnan(found["fibre"]).tolist() == [False, True, False]
    assert np.isnan(found["d_fibre_d_activation"]).tolist() == [True, True, False]
    np.testing.assert_allclose(found["every"][[0, 2]], [[1.0, 1.0, 1.0], [0.61749, 1.27258, 1.27258]], atol=6e-6)
    h = 1e-4
    ends = [reference.free_contraction(reference.SETS["table1"], 35.0, None, b).stretches[0] for b in (1.0, 1.0 - h)]
    assert found["d_fibre_d_activation"][2] == pytest.approx((ends[0] - ends[1]) / h, rel=1e-3)
    assert "1 INVALID_INPUT, the first at activation = 2: an input is outside its range" in repr(found)


def test_functions_of_the_users_own(cheap: jm.Study) -> None:
    x, y = np.meshgrid(POINTS["x"], POINTS["y"], indexing="ij")
    bad = (x > 3.0) | (y == 0.0)
    np.testing.assert_array_equal(cheap.status[x > 3.0], Status.NO_DESCENT)
    np.testing.assert_array_equal(cheap.status[(x <= 3.0) & (y == 0.0)], Status.OUTPUT_NOT_FINITE)
    np.testing.assert_array_equal(np.isnan(cheap["z"]), bad)
    np.testing.assert_allclose(cheap["z"][~bad], x[~bad] ** 2 / y[~bad])
    assert cheap["pair"].shape == (3, 4, 2)
    np.testing.assert_array_equal(cheap["pair"][~bad], np.stack([x, y], axis=-1)[~bad])
    np.testing.assert_allclose(cheap.elasticity("z", "x")[~bad], 2.0)
    np.testing.assert_allclose(cheap.elasticity("z", "y")[~bad], -1.0)
    np.testing.assert_allclose(cheap.elasticity("z", "k")[~bad], 2.0 * np.log(x[~bad]), atol=1e-14)
    np.testing.assert_allclose(cheap.elasticity("pair", "x")[~bad], [[1.0, 0.0]] * (~bad).sum())
    assert "4 NO_DESCENT, the first at x = 4 mm, y = -1 kPa, k = 2" in cheap.failures()


def test_csv(cheap: jm.Study, tmp_path: Path) -> None:
    with cheap.to_csv(tmp_path / "study.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:6] == ["x_mm", "y_kPa", "k", "z_mm2_per_kPa", "pair_0", "pair_1"]
    assert len(rows) == 12
    assert [row["status"] for row in rows[:3]] == ["CONVERGED", "OUTPUT_NOT_FINITE", "CONVERGED"]
    assert (rows[1]["z_mm2_per_kPa"], rows[1]["x_mm"], rows[1]["y_kPa"]) == ("", "1.0", "0.0")
    read = np.array([float(row["z_mm2_per_kPa"] or "nan") for row in rows])
    np.testing.assert_array_equal(read, cheap["z"].reshape(-1))


def test_xarray_and_netcdf(cheap: jm.Study, tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    dataset = cheap.to_xarray()
    assert dataset["z"].dims == ("x", "y")
    assert dataset["z"].attrs["units"] == "mm2/kPa"
    assert dataset["x"].attrs["units"] == "mm"
    assert float(dataset["k"]) == 2.0
    assert float(dataset["z"].sel(x=2.0, y=4.0)) == 1.0
    meanings = dict(zip(dataset["status"].flag_values, dataset["status"].flag_meanings.split(), strict=True))
    assert meanings[int(dataset["status"].sel(x=4.0, y=2.0))] == "NO_DESCENT"
    path = cheap.to_netcdf(tmp_path / "study.nc")
    with xarray.open_dataset(path, engine="scipy") as read:
        xarray.testing.assert_identical(read.load(), dataset.drop_attrs(deep=False).assign_attrs(design="grid"))
    with netcdf_file(path, mmap=False) as file:
        np.testing.assert_array_equal(file.variables["z"][:], cheap["z"])
        assert file.variables["z"].units == b"mm2/kPa"


def test_samples(tmp_path: Path) -> None:
    ranges = {"x": (0.0, 1.0), "y": (1.0, 3.0), "k": 2.0}
    drawn = jm.sobol_sample(ranges, 64, seed=3)
    assert drawn.dims == {"sample": 64}
    assert drawn.fixed == {"k": 2.0}
    assert all(len(np.unique(np.floor((x - x.min()) / np.ptp(x) * 8))) >= 8 for x in drawn.axes.values())
    assert (drawn.axes["y"] >= 1.0).all()
    assert (drawn.axes["y"] <= 3.0).all()
    np.testing.assert_array_equal(drawn.axes["x"], jm.sobol_sample(ranges, 64, seed=3).axes["x"])
    assert not np.array_equal(drawn.axes["x"], jm.sobol_sample(ranges, 64, seed=4).axes["x"])
    found = jm.study(closed_form, drawn, ["z"], units=UNITS, chunk=20)
    np.testing.assert_allclose(found["z"], drawn.axes["x"] ** 2 / drawn.axes["y"])
    own = jm.study(closed_form, jm.Sample({"x": [1.0, 2.0], "y": [2.0, 1.0]}), ["z"], units=UNITS, chunk=2)
    np.testing.assert_array_equal(own["z"], [0.5, 4.0])
    dataset = pytest.importorskip("xarray").open_dataset(own.to_netcdf(tmp_path / "own.nc"), engine="scipy")
    assert dataset["z"].dims == ("sample",)
    assert {"x", "y"} <= set(dataset.coords)
    dataset.close()


def test_sobol_indices_of_ishigami() -> None:
    """The closed form of Ishigami and Homma 1990, a = 7, b = 0.1."""

    def ishigami(x: Any, y: Any, z: Any) -> dict[str, Any]:
        return {"out": jnp.sin(x) + 7.0 * jnp.sin(y) ** 2 + 0.1 * z**4 * jnp.sin(x), "status": 0}

    units = dict.fromkeys(("x", "y", "z", "out"), "–")
    box = dict.fromkeys("xyz", (-np.pi, np.pi))
    found = jm.study(ishigami, jm.saltelli_sample(box, 4096), units=units)
    indices = found.sobol_indices("out")
    v1, v2, v13 = 0.5 * (1 + 0.1 * np.pi**4 / 5) ** 2, 49 / 8, 0.01 * np.pi**8 * 8 / 225
    v = v1 + v2 + v13
    for name, first, total in (("x", v1 / v, (v1 + v13) / v), ("y", v2 / v, v2 / v), ("z", 0.0, v13 / v)):
        s = indices[name]
        assert s.first_low <= s.first <= s.first_high
        assert s.total_low <= s.total <= s.total_high
        assert float(s.first) == pytest.approx(first, abs=0.02)
        assert float(s.total) == pytest.approx(total, abs=0.02)
    with pytest.raises(ValueError, match="need a study over a saltelli_sample; this one is over a sobol"):
        jm.study(ishigami, jm.sobol_sample(box, 16), units=units).sobol_indices("out")
    ranges = {"x": (2.0, 4.0), "y": (1.0, 2.0)}
    with pytest.raises(ValueError, match=r"\d+ of 64 samples failed"):
        jm.study(closed_form, jm.saltelli_sample(ranges, 16), ["z"], units=UNITS).sobol_indices("z")


NAN = float("nan")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"axes": {}}, "axes is empty: name at least one parameter"),
        ({"axes": 3}, "axes must be a mapping from names of parameters to values, or a Sample; got 3"),
        ({"axes": {"TO": [1.0], "a_over_D": 0.1}}, "axes: 'TO' is no parameter of the free contraction of the scene"),
        ({"axes": {"T0": [1.0]}}, "axes: the free contraction of the scene needs 'a_over_D' too; a number instead"),
        ({"axes": {"T0": [], "a_over_D": 0.1}}, r"axes\['T0'\] is empty: give at least one value"),
        ({"axes": {"T0": [1.0, NAN], "a_over_D": 0.1}}, r"axes\['T0'\] must be finite; got nan at index \(1,\)"),
        ({"axes": {"T0": [1.0, -1.0], "a_over_D": 0.1}}, r"axes\['T0'\]\[1\] = -1 is outside \[0, inf\] \(kPa"),
        ({"axes": {"T0": 1.0, "a_over_D": 0.3}}, r"axes\['a_over_D'\] = 0.3 is outside \[0, 0.25\]"),
        ({"axes": {"T0": [[1.0]], "a_over_D": 0.1}}, r"axes\['T0'\] must have shape \(n,\); got \(1, 1\)"),
        ({"axes": {"T0": ["a"], "a_over_D": 0.1}}, r"axes\['T0'\] must be numbers"),
        ({"solve": 3}, "solve must be a Scene, or a function of named numbers; got 3"),
        ({"outputs": ["lambda"]}, "outputs = 'lambda' is unknown; valid: 'lambda_f', 'lambda_cf'"),
        ({"outputs": []}, "outputs is empty: name at least one"),
        ({"outputs": {"r": lambda A: A}}, r"outputs\['r'\] must be a number or an array of fixed shape; got State"),
        (
            {"outputs": {"r": lambda A: A.u[0, 0].astype(complex)}},
            "must be real numbers; got complex128",
        ),
        ({"outputs": {"T0": lambda A: A.u[0, 0]}}, "outputs: 'T0' is the name of a parameter or of the status"),
        ({"outputs": {"r": lambda A: A.u[0, 0]}}, "units: the unit of the output 'r' is not known; add it"),
        ({"outputs": {"r": 3}}, r"outputs\['r'\] must be a function of what solve returns, or a name; got 3"),
        ({"derivatives": ["beta"]}, "derivatives = 'beta' is unknown; valid: 'T0', 'a_over_D'"),
        ({"chunk": 0}, "chunk = 0 must be an integer ≥ 1"),
        ({"solve": lambda T0, a_over_D: {"x": T0}}, "solve must return a State, or states among what it returns, or"),
        ({"solve": lambda T0, a_over_D: T0}, "solve must return a State, or a mapping from names to outputs"),
        ({"solve": lambda T0, k: T0}, "axes: 'a_over_D' is no parameter of solve, which has T0, k"),
    ],
)
def test_bad_input(change: dict[str, Any], message: str, scene: jm.Scene) -> None:
    given = {"solve": scene, "axes": {"T0": [1.0], "a_over_D": [0.1]}} | change
    with pytest.raises((ValueError, TypeError), match=message):
        jm.study(given.pop("solve"), given.pop("axes"), **given)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: jm.sobol_sample({"x": (0.0, 1.0)}, 100), "n = 100 must be a power of 2"),
        (lambda: jm.sobol_sample({"x": (1.0, 1.0)}, 8), r"ranges\['x'\] = \(1.0, 1.0\) must be \(low, high\)"),
        (lambda: jm.sobol_sample({"x": (0.0, NAN)}, 8), r"ranges\['x'\] must be finite"),
        (lambda: jm.sobol_sample({"beta": (0.0, 2.0)}, 8), r"ranges\['beta'\]\[1\] = 2 is outside \[0, 1\]"),
        (lambda: jm.saltelli_sample({"x": 1.0}, 8), "ranges is empty"),
        (lambda: jm.Sample({"x": [1.0], "y": [1.0, 2.0]}), "sample: its coordinates must be arrays of one length"),
        (lambda: jm.Sample({"x": [1.0, NAN]}), r"sample\['x'\] must be finite"),
        (lambda: jm.Sample({"a b": [1.0]}), "the name of a parameter must be a word"),
    ],
)
def test_bad_samples(call: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()


def test_what_solve_decides_by_values_is_an_error_with_a_hint() -> None:
    with pytest.raises(jax.errors.TracerBoolConversionError) as caught:
        jm.study(lambda x: {"y": 1.0 if x > 0 else 2.0, "status": 0}, {"x": [1.0]}, units={"x": "–", "y": "–"})
    assert any("A study traces solve with JAX" in note for note in caught.value.__notes__)


def test_which_studies_call_lapack_in_batches() -> None:
    """Solves of a body give it a matrix at a time, a function of the user's own as many as there are points."""
    tube = jm.radial_tube(8)

    def own(x: Any) -> dict[str, Any]:
        return {"y": jnp.linalg.eigvalsh(jnp.eye(3) * x)[0], "status": 0}

    def contracted(T0: Any) -> jm.State:
        return jm.contract(tube, T0=T0, a_over_D=0.2)

    for solve, name, wanted in ((own, "x", True), (contracted, "T0", False)):
        evaluation = Evaluation(solve, [name], None, [])
        assert not LAPACK.isdisjoint(primitives(jax.make_jaxpr(evaluation)({name: 1.0})))
        assert evaluation.lapack == wanted


def test_the_result_is_plain_json_able_numpy(cheap: jm.Study) -> None:
    """No masked or object arrays: what users plot or store."""
    assert all(type(x) is np.ndarray and x.dtype == np.float64 for x in cheap.values.values())
    assert json.loads(json.dumps(cheap.status.tolist())) == cheap.status.tolist()
