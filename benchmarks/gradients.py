"""What a gradient costs: value and gradient of a scalar of a whole solve, A and then C, over the solve alone.

(a) the homogeneous sample, a batch in one compiled call; (b) the radial tube, one compiled solve; (c) a block of n³
elements in three dimensions, sparse factors, outside of jit. By 1 input (T0), by 10 (T0, a/D, the constants of the law,
loads), and by many: node coordinates and fibres besides. Seconds are warm, the best of several,
on the wall; the ratio of processor seconds, too, which other programs on the machine disturb less.

    python benchmarks/gradients.py [--only sample tube block] [--samples 2000] [--elements 32] [--n 18]
"""

import argparse
import os
import platform
import time
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxmyo as jm
from jaxmyo.invariants import I1, I3, I4

Inputs = dict[str, Any]
#: (T0, a/D and constants; many more inputs) ↦ (a scalar, status)
Function = Callable[[Inputs, Inputs], tuple[Any, Any]]


def sample(samples: int) -> tuple[str, Function, Inputs, Inputs]:
    """The mean fibre stress of the stretched sample; many: nodes and fibre."""
    scene = jm.thin_sample()

    def stress(ten: Inputs, many: Inputs) -> tuple[Any, Any]:
        A = jm.contract(scene, **ten, **many, throw=False)
        C = jm.load(A, jm.Stretch("x", 1.1), throw=False)
        return C.mean("cauchy")[0, 0], C.status

    rng = np.random.default_rng(0)
    ten = _ten(jnp.asarray(rng.uniform(1.0, 40.0, samples)), jnp.asarray(rng.uniform(0.05, 0.25, samples)))
    ten = jax.tree.map(lambda x: jnp.broadcast_to(x, (samples,)), ten)
    many = {"points": jnp.asarray(scene.mesh.points), "fibre": jnp.asarray(scene.frame[0, 0, 0])}
    many = jax.tree.map(lambda x: jnp.broadcast_to(x, (samples, *x.shape)), many)
    return f"sample, a batch of {samples}", jax.vmap(stress), ten, many


def tube(elements: int) -> tuple[str, Function, Inputs, Inputs]:
    """The inner radius of the active tube under pressure; many: nodes, and fibres of each element."""
    scene = jm.radial_tube(elements)

    def radius(ten: Inputs, many: Inputs) -> tuple[Any, Any]:
        A = jm.contract(scene, **ten, **many, beta=0.5, throw=False)
        C = jm.load(A, jm.Pressure("inner", 5.0), throw=False)
        return C.u[0, 0], C.status

    fibre = jnp.broadcast_to(jnp.array([0.0, 1.0, 0.0]), (elements, 3))
    many = {"points": jnp.asarray(scene.mesh.points), "fibre": fibre}
    return f"radial tube, {elements} elements", radius, _ten(jnp.array(15.0), jnp.array(0.2)), many


def law(C: Any, frame: Any, beta: Any, constants: Any) -> Any:
    """Fibres in an isotropic matrix [kPa], stiffer when active."""
    passive = 0.5 * constants["mu"] * (I1(C) - 3.0 - jnp.log(I3(C))) + constants["k"] * (I4(C, frame) - 1.0) ** 2
    return passive + beta * (constants["mu_a"] * (I1(C) - 3.0) ** 2 + constants["k_a"] * (I4(C, frame) - 1.0) ** 2)


def block(n: int) -> tuple[str, Function, Inputs, Inputs]:
    """The pull of a clamped block that contracts and is stretched; many: nodes, and fibres of each element."""
    mesh = jm.box((10.0, 10.0, 10.0), (n, n, n))
    constants = {"mu": 10.0, "k": 5.0, "mu_a": 1.0, "k_a": 2.0}
    scene = jm.Scene(mesh, law, constants, supports=tuple(jm.Displacement("x0", axis) for axis in "xyz"))

    def pull(ten: Inputs, many: Inputs) -> tuple[Any, Any]:
        own = {name: ten[name] for name in ("T0", "beta", "constants")}
        A = jm.contract(scene, **own, **many, a_over_D=None, throw=False)
        moved = (jm.Displacement("x1", axis, ten["move"][i]) for i, axis in enumerate("xyz"))
        C = jm.load(A, *moved, jm.Pressure("z1", ten["pressure"]), throw=False)
        return C.reaction("x1")[0], C.status

    ten = {"T0": 2.0, "beta": 0.5, "move": np.array([1.0, 0.0, 0.5]), "pressure": 0.2, "constants": constants}
    fibre = jnp.broadcast_to(jnp.array([1.0, 0.0, 0.0]), (n**3, 3))
    many = {"points": jnp.asarray(mesh.points), "fibre": fibre}
    return f"block of {n}³ = {n**3} elements", pull, jax.tree.map(jnp.asarray, ten), many


def _ten(T0: Any, a_over_D: Any) -> Inputs:
    return {"T0": T0, "a_over_D": a_over_D, "constants": jax.tree.map(jnp.asarray, jm.TABLE1)}


def timed(function: Callable[[], Any]) -> tuple[float, float, Any]:
    """(seconds on the wall, seconds of processors, result)."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = jax.block_until_ready(function())
    return time.perf_counter() - wall, time.process_time() - cpu, result


def measure(name: str, function: Function, ten: Inputs, many: Inputs, *, compiled: bool, repeat: int) -> None:
    """Print a row for each number of inputs; the solve alone gets its inputs in the same way, and runs in turn."""
    batch = np.size(ten["T0"])

    def of(x: Inputs, rest: Inputs, geometry: Inputs) -> tuple[Any, Any]:
        value, status = function({**rest, **x}, geometry)
        return jnp.sum(value), status

    def of_all(x: tuple[Inputs, Inputs]) -> tuple[Any, Any]:
        return of(x[0], {}, x[1])

    def programs(f: Any) -> tuple[Any, Any]:
        both = jax.value_and_grad(f, has_aux=True)
        return (jax.jit(f), jax.jit(both)) if compiled else (f, both)

    alone, gradient = programs(of)
    with_geometry, gradient_of_all = programs(of_all)
    own: Any = (ten, many)
    rows: list[Any] = [
        (partial(alone, ten, {}, {}), partial(gradient, {"T0": ten["T0"]}, ten, {}), 1),
        (partial(alone, ten, {}, {}), partial(gradient, ten, {}, {}), sum(map(np.size, jax.tree.leaves(ten))) // batch),
        (partial(with_geometry, own), partial(gradient_of_all, own), sum(map(np.size, jax.tree.leaves(own))) // batch),
    ]
    for solve, derive, inputs in rows:
        _, status = solve()
        assert np.all(np.asarray(status) == jm.Status.CONVERGED), name
        first, _, (_, found) = timed(derive)
        assert all(bool(jnp.isfinite(leaf).all()) for leaf in jax.tree.leaves(found))
        # In turn, so that what else the machine does meets both alike.
        pairs = np.array([[timed(solve)[:2], timed(derive)[:2]] for _ in range(repeat)])
        (solved, cpu), (both, cpu_of_both) = pairs.min(axis=0)
        row = f"{name:>28} {inputs:>7} {solved:>9.4f} {both:>13.4f} {both / solved:>6.2f} {cpu_of_both / cpu:>10.2f}"
        print(f"{row} {first:>11.1f}", flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", nargs="+", choices=["sample", "tube", "block"], default=["sample", "tube", "block"])
    parser.add_argument("--samples", type=int, default=2000, help="samples of the batch")
    parser.add_argument("--elements", type=int, default=32, help="elements through the wall of the tube")
    parser.add_argument("--n", type=int, default=18, help="elements along an edge of the block")
    options = parser.parse_args()
    machine = platform.processor() or platform.machine()
    print(f"{machine}, {os.cpu_count()} cores, Python {platform.python_version()}, jax {version('jax')}, ", end="")
    print(f"jaxmyo {version('jaxmyo')}; seconds")
    head = f"{'':>28} {'inputs':>7} {'solve':>9} {'with gradient':>13} {'ratio':>6} {'of CPU':>10}"
    print(f"{head} {'first call':>11}")
    if "sample" in options.only:
        measure(*sample(options.samples), compiled=True, repeat=10)
    if "tube" in options.only:
        measure(*tube(options.elements), compiled=True, repeat=20)
    if "block" in options.only:
        measure(*block(options.n), compiled=False, repeat=3)


if __name__ == "__main__":
    main()
