"""The exact tube that the elements will be held against reproduces the known figures, from its own equations."""

import numpy as np
import pytest
import reference
import reference_tube as tube

SET = reference.SETS["table1"]
T0, A_OVER_D = 15.0, 0.2


@pytest.mark.parametrize(
    ("a_over_D", "s", "ri", "ro", "height"),
    [
        (A_OVER_D, 0.0, 3.4244, 4.6118, 0.8646),
        (A_OVER_D, 0.5, 3.3492, 4.7859, 0.7059),
        (None, 0.5, 3.4206, 4.4639, 1.0030),
    ],
)
def test_figures_of_the_cycle(a_over_D: float | None, s: float, ri: float, ro: float, height: float) -> None:
    C = tube.cycle(SET, tube.Tube(), T0, a_over_D, np.linspace(0.0, 0.5, 6))[round(10 * s)].C
    np.testing.assert_allclose([C.ri, C.ro, C.lz], [ri, ro, height], atol=5.1e-5)


def test_the_surfaces_are_in_equilibrium() -> None:
    body = tube.Tube()
    C = tube.cycle(SET, body, T0, A_OVER_D, np.linspace(0.0, 0.5, 6))[-1].C
    np.testing.assert_allclose(C.radial_stress(np.array([body.Ri, body.Ro])), [-18.0, 0.0], atol=1e-11)
    assert abs(C.axial_force()) < 1e-10
