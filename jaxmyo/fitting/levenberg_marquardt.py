"""Levenberg–Marquardt as a method of optimistix: Nielsen's damping, bounded steps, an end that the data decide.

A step dx minimises |r + J dx|² + λ |dx|². With ρ, the decrease of the sum of squares over the predicted one, λ becomes
λ max(1/10, 1 − (2ρ − 1)³) after a step that is taken, and 2, 4, 8, ... times itself after each that is not
(Madsen, Nielsen, Tingleff 2004, Methods for non-linear least squares problems).
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import optimistix as optx
from jax import Array

#: A minimum is reached where a Gauss–Newton step would lower the sum of squares by less than this part of it (so that x
#: is within 1e-4 of its standard errors or so; the relative offset of Bates and Watts), or where the residuals are
#: this part of the observations. Much less is below the round-off of the solves.
OFFSET, EXACT = 1e-10, 1e-10
#: 1/λ at the start; the least ρ [–] of a step that is taken.
FIRST, LEAST = 10.0, 1e-3
#: No x changes by more in one step: a factor of e² where there are bounds. Far out, exp Q is not finite.
LONGEST = 2.0


class _Damping(NamedTuple):
    """1/λ, and by what the next refused step multiplies λ."""

    step_size: Array
    rise: Array


class _Search(optx.ClassicalTrustRegion):
    """Nielsen's rule for λ."""

    def init(self, y: Any, f_info_struct: Any) -> Any:
        return _Damping(jnp.array(FIRST), jnp.array(2.0))

    def step(self, first_step: Any, y: Any, y_eval: Any, f_info: Any, f_eval_info: Any, state: Any) -> Any:
        predicted = self.predict_reduction(y_eval - y, f_info)
        gained = (f_eval_info.as_min() - f_info.as_min()) / jnp.minimum(predicted, -jnp.finfo(y.dtype).tiny)
        accept = first_step | (gained >= LEAST)  # not where it is NaN
        easier = jnp.maximum(0.1, 1.0 - (2.0 * jnp.minimum(gained, 1.0) - 1.0) ** 3)
        times = jnp.where(first_step, 1.0, jnp.where(accept, easier, state.rise))
        size = state.step_size / times
        rise = jnp.where(accept, 2.0, 2.0 * state.rise)
        return size, accept, optx.RESULTS.successful, _Damping(size, rise)


class _Descent(optx.DampedNewtonDescent):
    """The damped step, no longer than `LONGEST`."""

    def step(self, step_size: Any, state: Any) -> Any:
        dx, result = super().step(step_size, state)
        return dx * jnp.minimum(1.0, LONGEST / jnp.maximum(jnp.max(jnp.abs(dx)), 1e-30)), result


class LevenbergMarquardt(optx.LevenbergMarquardt):
    """It ends where the data cannot tell the next step, however far that goes in a flat valley."""

    def __init__(self) -> None:
        super().__init__(rtol=1e-13, atol=1e-13)
        self.search, self.descent = _Search(), _Descent()

    def terminate(self, fn: Any, y: Any, args: Any, options: Any, state: Any, tags: Any) -> Any:
        """Whether the last step that was taken came to a minimum."""
        done, result = super().terminate(fn, y, args, options, state, tags)
        J, r = state.f_info.jac.as_matrix(), state.f_info.residual
        J = J / jnp.maximum(jnp.linalg.norm(J, axis=0), 1e-30)[None]
        slope = J.T @ r
        gain = slope @ jnp.linalg.solve(J.T @ J + 1e-13 * jnp.eye(len(slope)), slope)
        sum_ = r @ r
        there = (gain <= OFFSET * sum_) | (sum_ <= len(r) * EXACT**2)
        return done | (there & (state.num_accepted_steps > 0)), result
