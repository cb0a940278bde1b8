"""Derivatives of whole solves against differences of whole solves, and where there is none."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmyo as jm
from jaxmyo import lagrangian, outputs, protocols
from jaxmyo.invariants import I1, I3, I4
from jaxmyo.mesh import jitter
from jaxmyo.solve import contraction
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


POINTS = 50  # random points of the slow tests
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


#: Steps of central differences, and what extrapolates them to the sixth order (Richardson).
STEPS, WEIGHTS = (0.02, 0.01, 0.005), (1.0 / 45.0, -20.0 / 45.0, 64.0 / 45.0)


def difference(values: Callable[[float], Any]) -> Any:
    """The derivative at 0 of values(h), an array."""
    return sum(w * (values(h) - values(-h)) / (2.0 * h) for h, w in zip(STEPS, WEIGHTS, strict=True))


def dot(a: Any, b: Any) -> Any:
    return sum(map(jnp.vdot, jax.tree.leaves(a), jax.tree.leaves(b)))


def converged(found: tuple[Any, Any]) -> Any:
    """The values, if every status is good."""
    assert (found[1] == jm.Status.CONVERGED).all()
    return found[0]


@pytest.mark.slow
def test_forward_and_reverse() -> None:
    """By all inputs of the sample together, in one program: differences to 1e-7, forward against reverse to 1e-10."""
    solve, x, far = sample()
    rng, points = np.random.default_rng(3), 4
    at, by = (
        stacked([make() for _ in range(points)])
        for make in (lambda: plus(x, moved(x, far, rng)), lambda: moved(x, far, rng))
    )
    weights = jnp.asarray(rng.normal(size=4))

    @jax.jit
    @jax.vmap
    def everything(x: Inputs, d: Inputs) -> Any:
        value, push, status = jax.linearize(solve, x, has_aux=True)
        (gradient,) = jax.linear_transpose(push, x)(weights)
        return value, status, push(d), dot(gradient, d)

    _, status, forward, reverse = everything(at, by)
    assert (status == jm.Status.CONVERGED).all()
    np.testing.assert_allclose(forward @ weights, reverse, rtol=1e-10)
    found = difference(lambda h: converged(everything(plus(at, by, h), by)[:2]))
    np.testing.assert_allclose(found, forward, rtol=1e-7, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", BODIES)
def test_first_derivatives(name: str) -> None:
    """By every kind of input, at 50 random points: differences to 1e-7, forward against reverse to 1e-10."""
    solve, x, far = BODIES[name]()
    rng, kinds = np.random.default_rng(0), sorted(x)
    at = stacked([plus(x, moved(x, far, rng)) for _ in range(POINTS)])
    by = stacked([moved(x, far, rng) for _ in range(POINTS)])
    every = jax.jit(jax.vmap(solve))
    weights = jnp.asarray(rng.normal(size=4))

    @jax.jit
    @jax.vmap
    def derivatives(x: Inputs, d: Inputs) -> tuple[Any, Any]:
        _, push = jax.linearize(lambda x: solve(x)[0], x)
        (gradient,) = jax.linear_transpose(push, x)(weights)
        products = [dot(gradient[n], d[n]) for n in kinds]
        return jax.vmap(push)(stacked([only(d, n) for n in kinds])), jnp.stack(products)

    forward, reverse = derivatives(at, by)
    values = converged(every(at))
    assert jnp.isfinite(forward).all()
    scale = jnp.max(jnp.abs(forward), axis=1) + 1e-6 * jnp.abs(values)
    for k, kind in enumerate(kinds):
        found = difference(lambda h, kind=kind: converged(every(plus(at, only(by, kind), h))))
        off = jnp.abs(found - forward[:, k]) / scale
        assert off.max() < 1e-7, (kind, off)
    along_weights = forward @ weights
    assert jnp.max(jnp.abs(along_weights - reverse) / jnp.max(jnp.abs(along_weights), axis=1, keepdims=True)) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("name", BODIES)
def test_second_derivatives(name: str) -> None:
    """By every pair of kinds of input, at 50 random points, forward over reverse: differences of gradients to 1e-5.

    The Hessian is symmetric.
    """
    solve, x, far = BODIES[name]()
    rng, kinds = np.random.default_rng(1), sorted(x)
    at = stacked([plus(x, moved(x, far, rng)) for _ in range(POINTS)])
    by = stacked([moved(x, far, rng) for _ in range(POINTS)])

    def slopes(x: Inputs, d: Inputs) -> tuple[Any, Any]:
        """The derivatives of a scalar along the part of d of each kind, from its gradient; and the status."""
        gradient, status = jax.grad(lambda x: _weighed(*solve(x)), has_aux=True)(x)
        return jnp.stack([dot(gradient[n], d[n]) for n in kinds]), status

    first = jax.jit(jax.vmap(slopes))

    @jax.jit
    @jax.vmap
    def second(x: Inputs, d: Inputs) -> Any:
        _, push = jax.linearize(lambda x: slopes(x, d)[0], x)
        return jax.vmap(push)(stacked([only(d, n) for n in kinds]))

    H = second(at, by)
    assert jnp.isfinite(H).all()
    largest = jnp.max(jnp.abs(H), axis=2, keepdims=True)
    assert (jnp.abs(H - jnp.swapaxes(H, 1, 2)) <= 1e-8 * largest).all()
    for k, kind in enumerate(kinds):
        found = difference(lambda h, kind=kind: converged(first(plus(at, only(by, kind), h), by)))
        off = jnp.abs(found - H[:, k]) / (jnp.abs(H[:, k]) + 1e-3 * largest[:, k])
        assert off.max() < 1e-5, (kind, off)


def _weighed(outputs: Any, status: Any) -> tuple[Any, Any]:
    return jnp.array([1.0, 0.3, 0.1, 0.2]) @ outputs, status


def test_directions_of_nodes_of_a_tube_in_a_batch() -> None:
    """A tube whose lengths all grow by a part moves by that part more: u_r is that derivative, the other is by T0."""
    scene, T0 = jm.radial_tube(2), jnp.array(5.0)
    points = jnp.asarray(scene.mesh.points)

    def inner(points: Any, T0: Any) -> Any:
        return jm.contract(scene, T0=T0, a_over_D=None, points=points, throw=False).u[0, 0]

    u, push = jax.linearize(inner, points, T0)
    larger = points * jnp.array([[1.0, 0.0, 1.0]])  # r and z [mm], φ stays
    found = jax.vmap(push)(jnp.stack([larger, 0.0 * larger]), jnp.array([0.0, 1.0]))
    h = 1e-3
    by_T0 = (inner(points, T0 + h) - inner(points, T0 - h)) / (2.0 * h)
    np.testing.assert_allclose(found, jnp.stack([u, by_T0]), rtol=1e-7)


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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


NAN = float("nan")

#: What makes a sample fail, and the statuses of its A and C.
FAILURES: list[tuple[dict[str, Any], str, str]] = [
    ({}, "CONVERGED", "CONVERGED"),
    ({"T0": NAN}, "INVALID_INPUT", "INVALID_INPUT"),
    ({"a_over_D": 0.3}, "INVALID_INPUT", "INVALID_INPUT"),
    ({"beta": NAN}, "INVALID_INPUT", "INVALID_INPUT"),
    ({"weave_stiffness": 0.0}, "INVALID_INPUT", "INVALID_INPUT"),
    ({"weave_stiffness": NAN}, "INVALID_INPUT", "INVALID_INPUT"),
    ({"constants": replace(jm.TABLE1, C1p=NAN)}, "INVALID_INPUT", "INVALID_INPUT"),
    ({"constants": replace(jm.TABLE1, C2p=float("inf"))}, "INVALID_INPUT", "INVALID_INPUT"),
    ({"points": np.full((8, 3), NAN)}, "INVALID_INPUT", "INVALID_INPUT"),
    ({"points": np.zeros((8, 3))}, "INVALID_INPUT", "INVALID_INPUT"),
    ({"fibre": np.zeros(3)}, "INVALID_INPUT", "INVALID_INPUT"),
    ({"fibre": np.full(3, NAN)}, "INVALID_INPUT", "INVALID_INPUT"),
    ({"cross": np.array([2.0, 0.2, 0.0])}, "INVALID_INPUT", "INVALID_INPUT"),  # parallel to the fibre
    ({"stretch": NAN}, "CONVERGED", "INVALID_INPUT"),
    ({"stretch": 9.0}, "CONVERGED", "INVALID_INPUT"),
    ({"traction": NAN}, "CONVERGED", "INVALID_INPUT"),
    ({"stretch": 4.9}, "CONVERGED", "NO_DESCENT"),  # exp Q is beyond float64
]


@pytest.mark.slow
def test_no_derivative_is_nan() -> None:
    """By every kind of input, whatever is wrong with one of them, forward and reverse; the status says what."""
    scene = jm.thin_sample()
    good = {"T0": 10.0, "a_over_D": 0.2, "beta": 0.8, "weave_stiffness": 50.0, "constants": jm.TABLE1}
    good |= {"points": scene.mesh.points, "fibre": np.array([1.0, 0.1, 0.0]), "cross": np.array([0.0, 1.0, 0.0])}
    good |= {"stretch": 1.1, "traction": 0.5}

    def outputs(x: Inputs) -> tuple[Any, Any]:
        of_A = {name: value for name, value in x.items() if name not in ("stretch", "traction")}
        A = jm.contract(scene, **of_A)
        up = jnp.array([0.0, 1.0, 0.0]) * x["traction"]
        C = jm.load(A, jm.Stretch("x", x["stretch"]), jm.Traction("y1", up))
        of_C = [C.mean("cauchy_fibre")[0, 0], C.stored_energy, C.reaction("x1")[0], C.mean("stretches")[1]]
        return jnp.stack([A.T_cf[0, 0] + A.u[6, 2], *of_C]), (A.status, C.status)

    @jax.jit
    @jax.vmap
    def derivatives(x: Inputs, d: Inputs) -> Any:
        values, push, status = jax.linearize(outputs, x, has_aux=True)
        pull = jax.linear_transpose(push, x)
        by_A, by_C = (pull(values.at[:].set(w))[0] for w in jnp.array([[1.0, 0, 0, 0, 0], [0, 1.0, 1.0, 1.0, 1.0]]))
        return values, status, push(d), by_A, by_C

    rng = np.random.default_rng(0)
    change = jax.tree.map(lambda x: rng.normal(size=np.shape(x)), good)
    batch = stacked([jax.tree.map(jnp.asarray, good | wrong) for wrong, _, _ in FAILURES])
    values, (of_A, of_C), forward, by_A, by_C = derivatives(batch, stacked([change] * len(FAILURES)))
    names = [tuple(jm.Status(int(s)).name for s in both) for both in zip(of_A, of_C, strict=True)]
    assert names == [(A, C) for _, A, C in FAILURES]
    assert all(jnp.isfinite(x).all() for x in jax.tree.leaves((values, forward, by_A, by_C)))
    for failed, mine, gradient in ((of_A != 0, forward[:, :1], by_A), (of_C != 0, forward[:, 1:], by_C)):
        for path, x in jax.tree_util.tree_leaves_with_path((mine, gradient)):
            assert not x[failed].any(), (path, x[failed])
    assert all((x[0] != 0.0).any() for x in (forward, *jax.tree.leaves(by_C)))


@pytest.mark.slow
def test_what_starts_from_a_state_that_failed_has_its_status() -> None:
    scene, few = jm.thin_sample(), jm.Settings(max_steps=3)

    def stress(T0: Any) -> tuple[Any, Any]:
        A = jm.contract(scene, T0=T0, a_over_D=0.2, settings=few)
        B = jm.contract(scene, T0=1.0, a_over_D=0.2, start=A)
        C = jm.load(A, jm.Stretch("x", 1.0))
        return C.mean("cauchy")[0, 0], (A.status, B.status, C.status)

    slope, status = jax.jit(jax.vmap(jax.grad(stress, has_aux=True)))(jnp.array([200.0, -1.0]))
    why = [jm.Status.TOO_MANY_STEPS, jm.Status.INVALID_INPUT]
    assert [s.tolist() for s in status] == [why, why, why]
    assert slope.tolist() == [0.0, 0.0]


@pytest.mark.slow
def test_tensions_of_a_singular_state() -> None:
    """At rest nothing resists shear: the tensions of such an A have no derivative, and a C that holds them says so."""
    scene = jm.thin_sample(elements=(1, 1, 1))

    def stress(beta: Any) -> tuple[Any, Any]:
        C = jm.load(jm.contract(scene, T0=10.0, a_over_D=0.2, beta=beta), jm.Stretch("x", 1.1), jm.Stretch("y", 1.1))
        return C.mean("cauchy")[0, 0], (C.status, C.zero_eigenvalues)

    _, (status, zero) = jax.jit(jax.vmap(jax.grad(stress, has_aux=True)))(jnp.array([0.0, 0.1]))
    assert status.tolist() == [0, 0]
    assert zero[0] > 0
    assert zero[1] == 0


@pytest.mark.slow
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


@pytest.mark.parametrize("conditions", ["stretches", "stress"])
@pytest.mark.slow
def test_a_passive_body_loaded_from_rest(conditions: str) -> None:
    """Rest is singular, the loaded body is not: derivatives by the constants pass through the one to the other.

    W is C1p (exp Q − 1), so that C1p ∂σ/∂C1p = σ at given stretches; at given stresses C1p ∂λ/∂C1p = −P ∂λ/∂P.
    """
    scene = jm.thin_sample(constants=jm.MEASURED)

    def outputs(C1p: jax.Array, times: jax.Array) -> jax.Array:
        A = jm.contract(scene, T0=0.6, a_over_D=None, beta=0.0, constants=replace(jm.MEASURED, C1p=C1p), throw=False)
        if conditions == "stretches":
            C = jm.load(A, jm.Stretch("x", 1.2), jm.Stretch("y", 1.15), throw=False)
            return times * C.mean("cauchy")[jnp.arange(2), jnp.arange(2)]
        return jm.load(A, *protocols.biaxial_stress(4.0 * times, 3.0 * times), throw=False).mean("stretches")

    C1p, one = jnp.array(jm.MEASURED.C1p), jnp.array(1.0)
    sign = 1.0 if conditions == "stretches" else -1.0
    for derivative in (jax.jacfwd, jax.jacrev):
        by_C1p, by_times = jax.jit(derivative(outputs, argnums=(0, 1)))(C1p, one)
        assert jnp.all(jnp.abs(by_times) > 1e-3)
        np.testing.assert_allclose(C1p * by_C1p, sign * by_times, rtol=1e-9)


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


@pytest.mark.slow
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


@pytest.mark.slow
def test_through_a_cycle() -> None:
    """Of a radius in the last state C by T0, the activation and the pressure of all states, against differences."""
    tube = jm.radial_tube(4)

    def radius(x: Any) -> Any:
        cycle = jm.cycle(
            tube,
            [0.0, 0.2, 0.4],
            T0=x["T0"],
            a_over_D=0.2,
            beta=lambda s: x["slope"] * s,
            loads=lambda s: [jm.Pressure("inner", 4.0 + x["pressure"] * s)],
        )
        assert cycle.C.u.shape[0] == 3
        return cycle.C.u[2, 0, 0] + 0.1 * cycle.C.cauchy[1, 0, 0, 1, 1]

    x = {"T0": 10.0, "slope": 1.5, "pressure": 5.0}
    gradient = jax.grad(radius)(x)
    for name in x:
        found = difference(lambda h, name=name: radius(x | {name: x[name] + h}))
        np.testing.assert_allclose(gradient[name], found, rtol=1e-7)


def test_a_law_that_overflows_elsewhere() -> None:
    """In the elements of another material a law may be infinite; derivatives there are those of their own law."""

    def hard(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
        return constants["a"] * (jnp.exp(constants["b"] * (I1(C) - 3.0) ** 2) - 1.0)

    mesh = jm.box((2.0, 1.0, 1.0), (2, 1, 1))
    mesh = jm.Mesh(mesh.points, mesh.cells, mesh.faces, regions={"soft": np.array([0]), "scar": np.array([1])})
    held = tuple(jm.Symmetry(axis) for axis in "xyz")
    scar = {"scar": jm.Material(hard, {"a": 1.0, "b": 1e3})}
    scene = jm.Scene(mesh, own_law, {"mu": 3.0, "k": 2.0}, supports=held, regions=scar)
    system, at, _ = contraction(scene, 0.0, None, 0.0, None, None)
    u = 2.0 * np.eye(3)[:1] * (mesh.points[:, :1] > 0.5)  # the scar moves as a whole

    @jax.jit
    def work(constants: Any) -> Any:
        inputs = at._replace(constants=constants, offset=jnp.asarray(u.reshape(-1)))
        r = lagrangian.residual(system, jnp.zeros(system.size), inputs)
        stored = outputs.stored_energy(system, lagrangian.deformation_gradients(system, jnp.asarray(u)), inputs)
        return jnp.sum(r) + stored

    by_soft, by_hard = jax.grad(work)(at.constants)
    assert jnp.isfinite(jnp.array([*by_soft.values(), *by_hard.values()])).all()
    assert by_soft["k"] != 0.0
