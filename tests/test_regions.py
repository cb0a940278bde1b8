"""Bodies of several materials: bars in series and in parallel, passive regions, regions without the weave, errors."""

import re
from dataclasses import replace
from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo import solve, sparse

SYMMETRIES = (jm.Symmetry("x"), jm.Symmetry("y"), jm.Symmetry("z"))
SOFT, STIFF = {"mu": 4.0}, {"mu": 10.0}  # kPa


def neo_hookean(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    return 0.5 * constants["mu"] * (jnp.trace(C) - 3.0 - jnp.log(jnp.linalg.det(C)))


def says(*parts: str) -> str:
    """A pattern that asks for all parts, in any order."""
    return "".join(f"(?=(?s:.*){re.escape(p)})" for p in parts)


def halves(lengths: Any, elements: Any, axis: int) -> jm.Mesh:
    """A box; the region "far" is its upper half along an axis, "near" the other."""
    mesh = jm.box(lengths, elements)
    far = mesh.points[mesh.cells].mean(axis=1)[:, axis] > 0.5 * lengths[axis]
    return jm.Mesh(mesh.points, mesh.cells, mesh.faces, regions={"near": np.where(~far)[0], "far": np.where(far)[0]})


def assert_same(a: jm.State, b: jm.State, atol: float) -> None:
    for name in ("u", "p", "q", "T_f", "T_cf"):
        if getattr(b, name) is not None:
            x, y = np.asarray(getattr(a, name)), np.asarray(getattr(b, name))
            np.testing.assert_allclose(x, y, rtol=0, atol=atol, err_msg=name)


# ------------------------------------------------------------------------------------------------------ closed forms


@pytest.mark.slow
def test_layers_in_series() -> None:
    """Two layers under one shear stress τ: each is sheared by τ/μ of its own, exactly."""
    tau = 3.0  # kPa
    within = ("x", "y")
    supports = [jm.Uniform("x", within), jm.Uniform("y", ("x", "y", "z")), jm.Uniform("z", within)]
    supports += [jm.Displacement("z0", a) for a in "xyz"]
    far = {"far": jm.Material(neo_hookean, STIFF)}
    scene = jm.Scene(halves((1.0, 1.0, 2.0), (1, 1, 4), 2), neo_hookean, SOFT, supports=supports, regions=far)
    state = jm.load(jm.contract(scene, T0=0.0, a_over_D=None), jm.Traction("z1", (tau, 0.0, 0.0)))
    shear = np.asarray(state.F)[..., 0, 2].mean(axis=1)
    mu = np.where(np.isin(np.arange(4), scene.mesh.region("far")), STIFF["mu"], SOFT["mu"])
    np.testing.assert_allclose(shear, tau / mu, rtol=1e-11)
    np.testing.assert_allclose(float(state.u[:, 0].max()), tau / SOFT["mu"] + tau / STIFF["mu"], rtol=1e-11)
    np.testing.assert_allclose(np.asarray(state.reaction("z0")), [-tau, 0.0, 0.0], rtol=1e-11, atol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("large", [1000, 0], ids=["dense", "sparse"])
def test_bars_in_parallel(large: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two bars of one stretch λ; each carries A μ (λ − λ⁻²), exactly."""
    monkeypatch.setattr(solve, "LARGE", large)
    sparse.forget()
    stretch = 1.3
    far = {"far": jm.Material(neo_hookean, STIFF)}
    scene = jm.Scene(halves((2.0, 1.0, 1.5), (2, 2, 2), 1), neo_hookean, SOFT, supports=SYMMETRIES, regions=far)
    at_rest = jm.contract(scene, T0=0.0, a_over_D=None)
    np.testing.assert_allclose(np.asarray(at_rest.u), 0.0, atol=1e-12)
    state = jm.load(at_rest, jm.Stretch("x", stretch))
    F = np.diag([stretch, stretch**-0.5, stretch**-0.5])
    np.testing.assert_allclose(np.asarray(state.F), np.broadcast_to(F, state.F.shape), rtol=0, atol=1e-11)
    stress = np.asarray(state.cauchy)[..., 0, 0].mean(axis=1)
    mu = np.where(np.isin(np.arange(8), scene.mesh.region("far")), STIFF["mu"], SOFT["mu"])
    np.testing.assert_allclose(stress, mu * (stretch**2 - 1.0 / stretch), rtol=1e-10)
    force = 0.75 * (SOFT["mu"] + STIFF["mu"]) * (stretch - stretch**-2)
    np.testing.assert_allclose(float(state.reaction("x1")[0]), force, rtol=1e-10)


# ---------------------------------------------------------------------------------------------- contracting and not


def muscle_and_scar(**regions: jm.Material) -> jm.Scene:
    return jm.Scene(halves((4.0, 1.0, 1.0), (4, 1, 2), 0), jm.lin_yin, jm.TABLE1, supports=SYMMETRIES, regions=regions)


@cache
def contracted(large: int) -> jm.State:
    """The far half is passive and has no weave."""
    before, solve.LARGE = solve.LARGE, large
    try:
        scar = jm.Material(neo_hookean, STIFF, active=False, weave=False)
        return jm.contract(muscle_and_scar(far=scar), T0=5.0, a_over_D=0.2)
    finally:
        solve.LARGE = before


@pytest.mark.parametrize("large", [1000, 0], ids=["dense", "sparse"])
def test_a_scar_does_not_contract(large: int) -> None:
    """It has no q and no tensions; the muscle has, and shortens."""
    state = contracted(large)
    assert (state.solver == "dense LU") == (large > 0)
    scar = np.isin(np.arange(8), state.scene.mesh.region("far"))
    assert state.q is not None
    np.testing.assert_array_equal(np.asarray(state.q)[scar], 0.0)
    np.testing.assert_array_equal(np.asarray(state.T_f)[scar], 0.0)
    np.testing.assert_array_equal(np.asarray(state.T_cf)[scar], 0.0)
    assert (np.abs(np.asarray(state.q)[~scar]) > 0.1).all()
    along = np.asarray(state.stretches)[..., 0].mean(axis=1)
    assert along[~scar].mean() < 0.93
    assert (
        np.abs(along[scar & (state.scene.mesh.points[state.scene.mesh.cells].mean(axis=1)[:, 0] > 3)] - 1) < 0.02
    ).all()


def test_dense_and_sparse_agree() -> None:
    assert_same(contracted(0), contracted(1000), 2e-9)
    assert int(contracted(0).negative_eigenvalues) == int(contracted(1000).negative_eigenvalues)


def with_beating(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    """With a beating tension of 5 kPa of its own."""
    return neo_hookean(C, frame, beta, constants) + 0.5 * 5.0 * beta * jnp.log(frame[0] @ C @ frame[0])


@pytest.mark.slow
def test_a_passive_region_is_one_without_beating_tension() -> None:
    """T0 = 5 kPa with a region that is passive, and T0 = 0 with a law that beats by itself outside of it."""
    mesh = halves((4.0, 1.0, 1.0), (4, 1, 2), 0)
    passive = jm.Material(neo_hookean, STIFF, active=False)
    beats = jm.Material(with_beating, SOFT)
    a = jm.Scene(mesh, neo_hookean, SOFT, supports=SYMMETRIES, regions={"far": passive})
    b = jm.Scene(mesh, neo_hookean, STIFF, supports=SYMMETRIES, regions={"near": beats})
    A, B = jm.contract(a, T0=5.0, a_over_D=None), jm.contract(b, T0=0.0, a_over_D=None)
    assert float(A.stretches[..., 0].min()) < 0.9
    assert_same(A, B, 1e-11)


@pytest.mark.slow
def test_regions_of_one_material_are_no_regions() -> None:
    """To round-off, in the states A and C; the constants of a region may also be given to `contract`."""
    single, same = muscle_and_scar(), muscle_and_scar(far=jm.Material(jm.lin_yin, jm.TABLE1))
    other = muscle_and_scar(far=jm.Material(jm.lin_yin, jm.PRINTED))
    A = jm.contract(single, T0=5.0, a_over_D=0.2)
    A2 = jm.contract(same, T0=5.0, a_over_D=0.2)
    A3 = jm.contract(other, T0=5.0, a_over_D=0.2, constants={"far": jm.TABLE1})
    C, C2, C3 = (jm.load(s, jm.Stretch("x", 1.05)) for s in (A, A2, A3))
    for state, reference in ((A2, A), (A3, A), (C2, C), (C3, C)):
        assert_same(state, reference, 1e-10)


@pytest.mark.slow
def test_the_weave_of_a_region_is_counted_there_only() -> None:
    """One element of three has a weave: 3 + 1 conditions on the 5 displacements of the tube, which are not too many."""
    tube = jm.radial_tube(3, law=neo_hookean, constants=SOFT)
    mesh = replace(tube.mesh, regions={"inside": np.array([0]), "outside": np.array([1, 2])})
    scene = jm.Scene(
        mesh,
        neo_hookean,
        SOFT,
        fibre=(0.0, 1.0, 0.0),
        cross=(0.0, 0.0, 1.0),
        supports=tube.supports,
        quadrature=tube.quadrature,
        regions={"outside": jm.Material(neo_hookean, SOFT, weave=False)},
    )
    state = jm.contract(scene, T0=1.0, a_over_D=0.2)
    assert state.converged


# ------------------------------------------------------------------------------------------------------------ errors


def test_unknown_region() -> None:
    with pytest.raises(ValueError, match=says("region", "'scar'", "far", "near")):
        muscle_and_scar(scar=jm.Material(jm.lin_yin, jm.TABLE1))


def test_a_region_that_is_no_material() -> None:
    with pytest.raises(TypeError, match=says("regions['far']", "Material", "lin_yin")):
        muscle_and_scar(far=jm.lin_yin)  # type: ignore[arg-type]


def test_a_law_of_a_region_that_is_no_scalar() -> None:
    with pytest.raises(ValueError, match=says("one float64", "(3, 3)")):
        muscle_and_scar(far=jm.Material(lambda C, frame, beta, constants: C, {}))


def test_constants_of_a_region_that_are_not_finite() -> None:
    with pytest.raises(ValueError, match=says("regions['far'].constants", "finite")):
        muscle_and_scar(far=jm.Material(neo_hookean, {"mu": np.nan}))


def test_a_patch_of_q_with_the_weave_and_without() -> None:
    mesh = halves((4.0, 1.0, 1.0), (4, 1, 2), 0)
    without = {"far": jm.Material(jm.lin_yin, jm.TABLE1, weave=False)}
    with pytest.raises(ValueError, match=says("q_patches", "patch 0", "with the weave and without")):
        jm.Scene(mesh, jm.lin_yin, jm.TABLE1, supports=SYMMETRIES, regions=without, q_patches=np.zeros(8, dtype=int))


@pytest.mark.parametrize("constants", [jm.TABLE1, {"scar": jm.TABLE1}], ids=["no mapping", "unknown name"])
def test_constants_that_are_no_mapping_of_regions(constants: Any) -> None:
    scene = muscle_and_scar(far=jm.Material(jm.lin_yin, jm.TABLE1))
    with pytest.raises(ValueError, match=says("mapping", "regions", "['', 'far']")):
        jm.contract(scene, T0=1.0, a_over_D=0.2, constants=constants)
