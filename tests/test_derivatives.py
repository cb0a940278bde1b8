"""Derivatives of whole solves against differences of whole solves, and where there is none."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo.invariants import I1, I3, I4
from jaxmyo.mesh import jitter
from jaxmyo.status import SingularError

Inputs = dict[str, Any]
Function = Callable[[Inputs], tuple[Any, Any]]


def along(angle: Any, plane: tuple[int, int]) -> tuple[Any, Any]:
    """Fibre and cross-fibre, turned by an angle [rad] in a coordinate plane."""
    i, j = plane
    c, s = jnp.cos(angle), jnp.sin(angle)
    return jnp.zeros(3).at[i].set(c).at[j].set(s), jnp.zeros(3).at[i].set(-s).at[j].set(c)


def own_law(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    """A law of a user's own: a neo-Hookean body with fibres that stiffen."""
    return 0.5 * constants["mu"] * (I1(C) - 3.0 - jnp.log(I3(C))) + constants["k"] * (I4(C, frame) - 1.0) ** 2 * (
        1.0 + beta
    )


def sample() -> tuple[Function, Inputs, Inputs]:
    """The homogeneous sample: (outputs and status, inputs, how far each may move)."""
    scene = jm.thin_sample()

    def solve(x: Inputs) -> tuple[Any, Any]:
        fibre, cross = along(x["angle"], (0, 1))
        own = {"constants": x["constants"], "points": x["points"], "fibre": fibre, "cross": cross}
        A = jm.contract(scene, T0=x["T0"], a_over_D=x["a_over_D"], beta=x["beta"], **own, throw=False)
        loads = jm.Stretch("x", x["stretch"]), jm.Traction("y1", jnp.array([0.0, 1.0, 0.0]) * x["traction"])
        C = jm.load(A, *loads, throw=False)
        return jnp.stack([C.mean("cauchy")[0, 0], C.u[6, 2], A.q[0], A.T_f[0, 0]]), C.status

    numbers = {"T0": (15.0, 5.0), "a_over_D": (0.15, 0.08), "beta": (0.7, 0.2), "angle": (0.1, 0.1)}
    numbers |= {"stretch": (1.1, 0.05), "traction": (1.0, 0.5)}
    return solve, *_spread(scene, numbers)


def tube() -> tuple[Function, Inputs, Inputs]:
    """Two rings of the radial tube, with a weave of finite stiffness."""
    scene = jm.radial_tube(2)

    def solve(x: Inputs) -> tuple[Any, Any]:
        fibre, cross = along(x["angle"], (1, 2))
        own = {"constants": x["constants"], "points": x["points"], "fibre": fibre, "cross": cross}
        weave = {"a_over_D": x["a_over_D"], "weave_stiffness": x["stiffness"]}
        A = jm.contract(scene, T0=x["T0"], beta=x["beta"], **weave, **own, throw=False)
        C = jm.load(A, jm.Pressure("inner", x["pressure"]), jm.Stretch("z", x["stretch"]), throw=False)
        return jnp.stack([C.u[0, 0], C.mean("cauchy_fibre")[0, 0], A.q[0], C.p[1]]), C.status

    numbers = {"T0": (8.0, 2.0), "a_over_D": (0.15, 0.08), "beta": (0.4, 0.1), "angle": (0.1, 0.05)}
    numbers |= {"stiffness": (200.0, 50.0), "stretch": (1.0, 0.01), "pressure": (2.0, 0.5)}
    return solve, *_spread(scene, numbers)


def body() -> tuple[Function, Inputs, Inputs]:
    """A small distorted body with a fibre field and a law of one's own."""
    constants = {"mu": 3.0, "k": 2.0}
    mesh = jitter(jm.box((1.0, 1.0, 1.0), (2, 2, 1)), 0.1, seed=0)
    scene = jm.Scene(mesh, own_law, constants, supports=tuple(jm.Symmetry(axis) for axis in "xyz"))
    nodes = jnp.asarray(scene.mesh.points)

    def solve(x: Inputs) -> tuple[Any, Any]:
        own = {"constants": x["constants"], "points": x["points"], "fibre": x["fibre"]}
        weave = {"a_over_D": x["a_over_D"], "weave_stiffness": x["stiffness"]}
        A = jm.contract(scene, T0=x["T0"], beta=x["beta"], **weave, **own, throw=False)
        loads = jm.Stretch("x", x["stretch"]), jm.Pressure("z1", x["pressure"])
        C = jm.load(A, *loads, throw=False)
        return jnp.stack([C.reaction("x1")[0], C.u[4, 1], A.q[0], C.stored_energy]), C.status

    numbers = {"T0": (1.1, 0.3), "a_over_D": (0.15, 0.08), "beta": (0.7, 0.2), "stiffness": (20.0, 5.0)}
    numbers |= {"stretch": (1.05, 0.05), "pressure": (0.2, 0.1)}
    x, far = _spread(scene, numbers)
    x["fibre"] = jnp.array([[1.0, 0.1, 0.05]]) + 0.1 * nodes
    x["fibre"] = x["fibre"] / jnp.linalg.norm(x["fibre"], axis=1, keepdims=True)
    return solve, x, far | {"fibre": 0.05}


def _spread(scene: jm.Scene, numbers: dict[str, tuple[float, float]]) -> tuple[Inputs, Inputs]:
    x: Inputs = {name: jnp.array(value) for name, (value, _) in numbers.items()}
    far: Inputs = {name: range_ for name, (_, range_) in numbers.items()}
    x["constants"], x["points"] = scene.constants, jnp.asarray(scene.mesh.points)
    return x, far | {"constants": jax.tree.map(lambda c: 0.1 * abs(c), scene.constants), "points": 0.03}


BODIES = {"sample": sample, "tube": tube, "body": body}


def moved(x: Inputs, far: Inputs, rng: np.random.Generator) -> Inputs:
    """A random change of every input, as far as it may go; of each constant in proportion to it."""

    def of(x: Any, far: Any) -> Any:
        return jnp.asarray(far * rng.uniform(-1.0, 1.0, np.shape(x)))

    return {n: jax.tree.map(of, x[n], far[n]) if n == "constants" else of(x[n], far[n]) for n in x}


def plus(x: Inputs, d: Inputs, h: float = 1.0) -> Inputs:
    return jax.tree.map(lambda a, b: a + h * b, x, d)


def only(d: Inputs, name: str) -> Inputs:
    return {n: v if n == name else jax.tree.map(jnp.zeros_like, v) for n, v in d.items()}


def stacked(trees: list[Any]) -> Any:
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *trees)


def richardson(difference: Callable[[float], Any], h: float) -> Any:
    return (4.0 * difference(h / 2.0) - difference(h)) / 3.0


@pytest.mark.parametrize(
    ("name", "points"),
    [
        ("sample", 4),
        ("tube", 2),
        *(pytest.param(name, 50, marks=pytest.mark.slow) for name in BODIES),
    ],
)
def test_first_derivatives(name: str, points: int) -> None:
    """By every kind of input, at random points: differences to 1e-7, forward against reverse to 1e-10."""
    solve, x, far = BODIES[name]()
    rng, h = np.random.default_rng(0), 0.02
    at = [plus(x, moved(x, far, rng)) for _ in range(points)]
    by = [moved(x, far, rng) for _ in range(points)]
    every = jax.jit(jax.vmap(solve))
    weights, kinds = jnp.asarray(rng.normal(size=4)), sorted(x)

    @jax.jit
    @partial(jax.vmap, in_axes=(0, 0))
    def derivatives(x: Inputs, d: Inputs) -> tuple[Any, Any]:
        _, push = jax.linearize(lambda x: solve(x)[0], x)
        (gradient,) = jax.linear_transpose(push, x)(weights)
        products = [sum(map(jnp.vdot, jax.tree.leaves(gradient[n]), jax.tree.leaves(d[n]))) for n in kinds]
        return jax.vmap(push)(stacked([only(d, n) for n in kinds])), jnp.stack(products)

    forward, reverse = derivatives(stacked(at), stacked(by))
    values, status = every(stacked(at))
    assert (status == jm.Status.CONVERGED).all()
    assert jnp.isfinite(forward).all()
    scale = jnp.max(jnp.abs(forward), axis=1, keepdims=True) + 1e-6 * jnp.abs(values)[:, None]
    for k, kind in enumerate(kinds):

        def difference(h: float, kind: str = kind) -> Any:
            def shifted(step: float) -> Any:
                found, status = every(stacked([plus(a, only(d, kind), step) for a, d in zip(at, by, strict=True)]))
                assert (status == 0).all()
                return found

            return (shifted(h) - shifted(-h)) / (2.0 * h)

        off = jnp.abs(richardson(difference, h) - forward[:, k]) / scale[:, 0]
        assert off.max() < 1e-7, (kind, off)
    along_weights = jnp.einsum("pko,o->pk", forward, weights)
    assert jnp.max(jnp.abs(along_weights - reverse) / jnp.max(jnp.abs(along_weights), axis=1, keepdims=True)) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("name", BODIES)
def test_second_derivatives(name: str) -> None:
    """Forward over reverse, against differences of gradients to 1e-5; the Hessian is symmetric."""
    solve, x, far = BODIES[name]()
    rng, h = np.random.default_rng(1), 0.02
    by = [moved(x, far, rng) for _ in range(2)]

    def first(x: Inputs) -> Any:
        return jnp.array([1.0, 0.0, 0.1, 0.0]) @ solve(x)[0]

    gradient = jax.jit(jax.grad(first))
    product = jax.jit(lambda x, d: jax.jvp(jax.grad(first), (x,), (d,))[1])
    H = [product(x, d) for d in by]

    def dot(a: Inputs, b: Inputs) -> Any:
        return sum(map(jnp.vdot, jax.tree.leaves(a), jax.tree.leaves(b)))

    crossed = dot(H[0], by[1])
    np.testing.assert_allclose(crossed, dot(H[1], by[0]), rtol=1e-9)

    def difference(h: float) -> Any:
        return (dot(gradient(plus(x, by[0], h)), by[1]) - dot(gradient(plus(x, by[0], -h)), by[1])) / (2.0 * h)

    np.testing.assert_allclose(richardson(difference, h), crossed, rtol=1e-5)


def test_hessian_in_a_batch() -> None:
    """Of the fibre tension by (T0, a/D), against the closed form at the same state: jit, vmap and grad compose."""
    scene = jm.thin_sample()

    def tension(x: Any) -> Any:
        return jm.contract(scene, T0=x[0], a_over_D=x[1], throw=False).T_f[0, 0]

    at = jnp.array([[5.0, 0.1], [20.0, 0.2]])
    batched = jax.jit(jax.vmap(jax.hessian(tension)))(at)
    one = jax.jacrev(jax.grad(tension))(at[1])
    np.testing.assert_allclose(batched[1], one, rtol=1e-9)
    np.testing.assert_allclose(batched, jnp.swapaxes(batched, 1, 2), rtol=1e-9)


def test_the_path_does_not_matter() -> None:
    """A derivative is the same however the state was reached, and 0 by where it came from."""
    scene = jm.thin_sample()
    near = jm.contract(scene, T0=9.0, a_over_D=0.1)

    def stretch(T0: Any, start: jm.State | None) -> Any:
        return jm.contract(scene, T0=T0, a_over_D=0.2, start=start).mean("stretches")[0]

    np.testing.assert_allclose(jax.grad(stretch)(10.0, None), jax.grad(stretch)(10.0, near), rtol=1e-10)

    def from_where(T0: Any) -> Any:
        return stretch(jnp.array(10.0), jm.contract(scene, T0=T0, a_over_D=0.1))

    assert jax.grad(from_where)(9.0) == 0.0


def test_failed_samples_of_a_batch() -> None:
    """Their derivatives are 0, never NaN, their status says why, and their neighbours do not notice."""
    scene = jm.thin_sample()

    def stress(T0: Any, stretch: Any) -> tuple[Any, Any]:
        A = jm.contract(scene, T0=T0, a_over_D=0.2, throw=False)
        C = jm.load(A, jm.Stretch("x", stretch), throw=False)
        return C.mean("cauchy")[0, 0], C.status

    batch = jax.jit(jax.vmap(jax.value_and_grad(stress, argnums=(0, 1), has_aux=True)))
    T0, stretch = jnp.array([10.0, jnp.nan, 10.0, -1.0, 0.0]), jnp.array([1.1, 1.1, 7.0, 1.1, 1.1])
    (_, status), derivatives = batch(T0, stretch)
    assert [jm.Status(int(s)).name for s in status[:4]] == ["CONVERGED", *["INVALID_INPUT"] * 3]
    assert all(jnp.isfinite(d).all() for d in derivatives)
    assert all((d[1:4] == 0.0).all() for d in derivatives)
    alone = jax.grad(lambda *x: stress(*x)[0], argnums=(0, 1))(10.0, 1.1)
    np.testing.assert_allclose([d[0] for d in derivatives], alone, rtol=1e-12)


def test_a_singular_state() -> None:
    """Without activation the law resists no shear at rest: stretches move like a root, and no derivative is made up."""
    scene = jm.thin_sample()

    def contracted(beta: Any) -> jm.State:
        return jm.contract(scene, T0=10.0, a_over_D=None, beta=beta, throw=False)

    assert contracted(0.0).zero_eigenvalues > 0
    with pytest.raises(SingularError, match=r"no derivative: its tangent has 1 mode\(s\) without stiffness"):
        jax.grad(lambda beta: contracted(beta).mean("stretches")[1])(0.0)

    def both(beta: Any) -> tuple[Any, Any]:
        state = contracted(beta)
        return state.mean("stretches")[1], state.zero_eigenvalues

    slope, zero = jax.jit(jax.vmap(jax.grad(both, has_aux=True)))(jnp.array([0.0, 0.5]))
    assert zero.tolist() == [1, 0]
    assert slope[0] == 0.0
    assert slope[1] != 0.0


def test_a_failure_under_grad_is_an_error() -> None:
    scene = jm.thin_sample()
    with pytest.raises(jm.SolveError, match="INVALID_INPUT"):
        jax.grad(lambda T0: jm.contract(scene, T0=T0, a_over_D=0.2).mean("stretches")[0])(-3.0)


def test_geometry_is_checked() -> None:
    scene = jm.thin_sample()
    points = scene.mesh.points
    with pytest.raises(ValueError, match=r"points must have shape \(8, 3\)"):
        jm.contract(scene, T0=1.0, a_over_D=0.2, points=points[:7])
    with pytest.raises(ValueError, match="element 0 is inverted"):
        jm.contract(scene, T0=1.0, a_over_D=0.2, points=-points)
    with pytest.raises(ValueError, match="fibre must be vectors with a direction"):
        jm.contract(scene, T0=1.0, a_over_D=0.2, fibre=np.zeros(3))

    def inside(flip: Any) -> Any:
        return jm.contract(scene, T0=1.0, a_over_D=0.2, points=flip * points, throw=False).status

    assert jax.jit(jax.vmap(inside))(jnp.array([1.0, -1.0])).tolist() == [0, jm.Status.INVALID_INPUT]


def test_moved_nodes_are_another_mesh() -> None:
    """`points` and `fibre` give what a scene that was built with them gives."""
    scene = jm.radial_tube(3)
    points = scene.mesh.points * np.array([1.1, 1.0, 1.0])
    fibre, cross = np.array([0.0, 0.8, 0.6]), np.array([0.0, -0.6, 0.8])
    A = jm.contract(scene, T0=10.0, a_over_D=0.2, beta=0.5, points=points, fibre=fibre, cross=cross)
    other = jm.radial_tube(3, fibre=tuple(fibre), cross=tuple(cross))
    other = jm.Scene(**{**_fields(other), "mesh": _at(other.mesh, points)})
    B = jm.contract(other, T0=10.0, a_over_D=0.2, beta=0.5)
    C, D = (jm.load(state, jm.Pressure("inner", 3.0)) for state in (A, B))
    np.testing.assert_allclose(A.u, B.u, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(C.u, D.u, rtol=0.0, atol=1e-12)


def _fields(scene: jm.Scene) -> dict[str, Any]:
    names = ("law", "constants", "fibre", "cross", "supports", "quadrature", "p_patches", "q_patches", "regions")
    return {name: getattr(scene, name) for name in names}


def _at(mesh: jm.Mesh, points: Any) -> jm.Mesh:
    return replace(mesh, points=points)
