"""The branch from rest is kept on a body of many elements, where it passes bifurcations (minutes: marker slow)."""

import numpy as np
import pytest
import reference
from support import sample

import jaxmyo as jm

POINTS = np.random.default_rng(7).uniform(size=(40, 5)) * [200.0, 0.25, 1.0, 0.5, 0.5] + [0.0, 0.0, 0.0, 0.8, 0.8]


@pytest.mark.slow
@pytest.mark.parametrize("weave", [True, False], ids=["weave", "free"])
def test_random_points_on_a_distorted_mesh(weave: bool) -> None:
    c = reference.SETS["table1"]
    scene = sample((4, 4, 2), 0.2)
    for T0, ratio, beta, l1, l2 in POINTS:
        a_over_D = ratio if weave else None
        A = jm.contract(scene, T0=T0, a_over_D=a_over_D, beta=beta)
        expected = reference.free_contraction(c, T0, a_over_D, beta)
        np.testing.assert_allclose(np.asarray(A.stretches).reshape(-1, 3), np.tile(expected.stretches, (256, 1)), 1e-10)
        C = jm.load(A, jm.Stretch("x", l1), jm.Stretch("y", l2))
        loaded = reference.loaded_stretch(c, T0, beta, expected.T_f, expected.T_cf, l1, l2)
        sigma = np.einsum("egii->egi", np.asarray(C.cauchy)).reshape(-1, 3)
        np.testing.assert_allclose(
            sigma, np.tile(loaded.sigma, (256, 1)), rtol=1e-8, atol=1e-8 * np.abs(loaded.sigma).max()
        )
