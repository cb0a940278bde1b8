"""The numerical inf-sup test: its figures, its zero modes, and which patches keep it bounded under refinement."""

from functools import cache

import numpy as np
import pytest
import scipy.linalg

import jaxmyo as jm
from jaxmyo.stability.inf_sup import InfSup


def box(elements: tuple[int, int, int], lengths: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> jm.Scene:
    supports = (jm.Symmetry("x"), jm.Symmetry("y"), jm.Symmetry("z"))
    return jm.Scene(jm.box(lengths, elements), jm.lin_yin, jm.TABLE1, supports=supports)


@cache
def cube(n: int) -> tuple[jm.Mesh, InfSup]:
    scene = box((n, n, n))
    return scene.mesh, InfSup.of(scene)


@pytest.mark.parametrize(
    ("n", "both", "p"),
    [(2, 0.245, 0.85), (4, 0.049, 0.35), (6, 0.026, 0.18), pytest.param(8, 0.019, 0.11, marks=pytest.mark.slow)],
)
def test_of_one_multiplier_per_element_it_falls(n: int, both: float, p: float) -> None:
    mesh, test = cube(n)
    own = np.arange(len(mesh.cells))
    found = test.constant(own, own)
    assert (found.zero, found.multipliers) == (0, 2 * n**3)
    assert found.beta == pytest.approx(both, abs=5e-4)
    assert test.constant(own, None).beta == pytest.approx(p, abs=5e-3)


def test_of_a_slab() -> None:
    scene = box((8, 8, 1), (1.0, 1.0, 0.1))
    own = np.arange(64)
    assert InfSup.of(scene).constant(own, own).beta == pytest.approx(0.029, abs=5e-4)


def test_p_on_blocks_is_bounded_q_needs_patches_that_do_not_shrink() -> None:
    """A q that varies along the normal only is felt by no displacement: see `jaxmyo.stability.inf_sup_cases`."""
    p, both, fixed, one = [], [], [], []
    for n in (4, 6):
        mesh, test = cube(n)
        block = jm.blocks(mesh)
        p.append(test.constant(block, None).beta)
        both.append(test.constant(block, block).beta)
        fixed.append(test.constant(block, jm.blocks(mesh, n // 2)).beta)
        one.append(test.constant(block, np.zeros_like(block)).beta)
    assert min(p) > 0.8
    assert min(fixed) > 0.3
    assert min(one) > 0.8
    assert both[0] > 1.8 * both[1]


def test_zero_modes_are_counted_apart() -> None:
    """Clamped on all sides, a constant p moves nothing: one zero mode, and the constant is that of the rest."""
    mesh = jm.box((1.0, 1.0, 1.0), (4, 4, 4))
    held = tuple(jm.Displacement(f"{a}{end}", a) for a in "xyz" for end in "01")
    own = np.arange(64)
    found = InfSup.of(jm.Scene(mesh, jm.lin_yin, jm.TABLE1, supports=held)).constant(jm.blocks(mesh), None)
    assert (found.zero, found.multipliers) == (1, 8)
    assert found.beta > 0.1
    assert len(own) == 64


def test_by_the_definition() -> None:
    """The least of b(u, m) / (|u|₁ ‖m‖₀) for the best u, on a skew mesh with fibres askew, by sums of its own."""
    scene = jm.Scene(
        jm.mesh.jitter(jm.box((1.0, 2.0, 1.5), (2, 2, 2)), 0.3, seed=1),
        jm.lin_yin,
        jm.TABLE1,
        (0.6, 0.8, 0.0),
        (-0.8, 0.6, 0.0),
        supports=(jm.Symmetry("x"), jm.Symmetry("y"), jm.Symmetry("z")),
    )
    points, cells = scene.mesh.points, scene.mesh.cells
    xi, w = np.polynomial.legendre.leggauss(2)
    corners = np.array(
        [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]
    )
    n = len(points)
    A, B, M = np.zeros((3 * n, 3 * n)), np.zeros((16, 3 * n)), np.zeros(16)
    f, c, slope = np.array([0.6, 0.8, 0.0]), np.array([-0.8, 0.6, 0.0]), 0.5 * (np.pi - 2.0) * 0.2
    for e, cell in enumerate(cells):
        for s in np.stack(np.meshgrid(xi, xi, xi), axis=-1).reshape(-1, 3):
            each = 0.5 * (1.0 + corners * s)
            dN = np.stack([0.5 * corners[:, k] * np.prod(np.delete(each, k, 1), axis=1) for k in range(3)], axis=1)
            jacobian = points[cell].T @ dN
            dN, weight = dN @ np.linalg.inv(jacobian), np.linalg.det(jacobian)
            of_p, of_q = dN, np.outer(dN @ c, c) - slope * np.outer(dN @ f, f)
            for i in range(3):
                A[np.ix_(3 * cell + i, 3 * cell + i)] += weight * dN @ dN.T
                B[e, 3 * cell + i] += weight * of_p[:, i]
                B[8 + e, 3 * cell + i] += weight * of_q[:, i]
            M[[e, 8 + e]] += weight
    free = [3 * a + i for a in range(n) for i in range(3) if points[a, i] > 0.0]
    S = B[:, free] @ np.linalg.solve(A[np.ix_(free, free)], B[:, free].T)
    expected = np.sqrt(scipy.linalg.eigh(S, np.diag(M), eigvals_only=True)[0])
    own = np.arange(8)
    assert w.tolist() == [1.0, 1.0]
    assert InfSup.of(scene).constant(own, own).beta == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow
def test_the_cure_under_refinement() -> None:
    """p on blocks of 2×2×2 elements, q on eighths of the body or one q: bounded below from n = 2 to 12."""
    of_eighths, of_one, of_blocks = [], [], []
    for n in (2, 4, 6, 8, 10, 12):
        mesh, test = cube(n)
        block = jm.blocks(mesh)
        of_eighths.append(test.constant(block, jm.blocks(mesh, n // 2)).beta)
        of_one.append(test.constant(block, np.zeros_like(block)).beta)
        of_blocks.append(test.constant(block, block).beta)
    assert min(of_eighths) > 0.24
    assert min(of_one) > 0.77
    assert of_blocks[-1] < 0.09
