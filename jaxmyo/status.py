"""What a solve says of itself: a status per solve (an integer under `vmap`), its meaning, and what to try."""

from collections.abc import Callable
from enum import IntEnum

import numpy as np
from jax.typing import ArrayLike


class Status(IntEnum):
    """The outcome of a solve."""

    CONVERGED = 0
    INVALID_INPUT = 1
    NO_DESCENT = 2
    TOO_MANY_ITERATIONS = 3
    SINGULAR = 4
    BRANCH_LEFT = 5
    TOO_MANY_STEPS = 6
    TIME_LIMIT = 7
    OUTPUT_NOT_FINITE = 8
    LIMIT_POINT = 9


MEANING = {
    Status.CONVERGED: "converged",
    Status.INVALID_INPUT: (
        "an input is outside its range or not finite; nothing was solved. Check beta in [0, 1], T0 >= 0 kPa, "
        "a_over_D in [0, 1/4], stretches in (0.2, 5), weave_stiffness > 0 kPa, and that constants and loads are finite"
    ),
    Status.NO_DESCENT: (
        "no correction shrank the residual, however small the load step: every trial inverted an element, closed a "
        "hole, overflowed the energy (exp Q exceeds float64 at large strain), or led away from equilibrium; try a "
        "smaller load, or prescribe a displacement instead of a traction"
    ),
    Status.TOO_MANY_ITERATIONS: (
        "Newton's iterations ran out at the smallest load step. The state may be close to a bifurcation; try a smaller "
        "load, or prescribe a displacement instead of a traction"
    ),
    Status.SINGULAR: (
        "the tangent is singular, or too large for float64 (exp Q at large strain). A mode without stiffness is free, "
        "or constraints are redundant; check the supports, the load, and the law's stiffness at this state"
    ),
    Status.BRANCH_LEFT: (
        "however small the load step, the body left the tangent of its path: the branch ends here, and the next "
        "equilibrium is far away (snap-through). Try a smaller load, or prescribe a displacement instead of a traction"
    ),
    Status.TOO_MANY_STEPS: (
        "the path used up its steps; the load is far beyond what the steps could reach. Try a smaller load, or more "
        "steps (settings.max_steps)"
    ),
    Status.TIME_LIMIT: "the time limit passed (settings.time_limit). Go on from this state, or allow more time",
    Status.LIMIT_POINT: (
        "the load has a maximum on this branch (a limit point): the body moves ever faster towards it, and there is no "
        "equilibrium near by beyond; try a smaller load, prescribe a displacement or a volume instead of a traction "
        "or a pressure, or follow the branch beyond its limit point (jaxmyo.trace)"
    ),
    Status.OUTPUT_NOT_FINITE: (
        "the state converged, but an output that a study computes from it is not finite; look at the output's function"
    ),
}


def explain(status: ArrayLike, reached: ArrayLike, residual: ArrayLike, loads: str = "", stability: str = "") -> str:
    """One sentence: what happened, how far the path came (`loads`: which are there), the residual, and what to try.

    stability: what is known of the stability of the state, or nothing.
    """
    s = Status(int(np.asarray(status)))
    of_state = f"relative residual {float(np.asarray(residual)):.1e}" + (f"; {stability}" if stability else "")
    if s is Status.CONVERGED:
        return f"converged ({of_state})"
    return (
        f"{s.name} at {100 * float(np.asarray(reached)):.4g} % of the load{', ' + loads if loads else ''} "
        f"(the fields are those of the last converged step, {of_state}): {MEANING[s]}."
    )


class SingularError(RuntimeError):
    """A derivative was asked for where there is none: the tangent of the equilibrium is singular."""


class SolveError(RuntimeError):
    """A solve did not reach its load. `.state` holds the last converged step with its status.

    A message may be a function: to say where the material is weakest takes seconds, which only a reader should wait.
    """

    def __init__(self, message: str | Callable[[], str], state: object) -> None:
        super().__init__(message)
        self.state = state

    def __str__(self) -> str:
        (message,) = self.args
        if callable(message):
            message = message()
            self.args = (message,)
        return str(message)
