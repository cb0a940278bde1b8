"""Everything that is reported of the tube, computed side by side: most of the time is compilation."""

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from typing import Any

from jaxmyo.paper import tube_accuracy, tube_weave
from jaxmyo.paper.claims import Claim
from jaxmyo.paper.exact_tube import Pair, Weave
from jaxmyo.paper.sample import S
from jaxmyo.paper.tube import ELEMENTS, ENDS, Tube, tube
from jaxmyo.paper.tube_accuracy import Accuracy
from jaxmyo.paper.tube_claims import claims
from jaxmyo.paper.tube_tension import Change, changes
from jaxmyo.paper.tube_weave import WEAVES, SoftWeave, lines, soft_weave


@dataclass(frozen=True)
class TubeResults:
    """The cycle, its accuracy, the tube with a soft weave (elements, and exact states), other T0, and the claims."""

    tube: Tube
    accuracy: Accuracy
    soft: Sequence[SoftWeave]
    lines: Mapping[Weave, Sequence[Pair]]
    changes: Sequence[Change]
    claims: Sequence[Claim]

    @property
    def limit(self) -> Pair:
        """The exact states at s = ½ with the constraint."""
        return self.accuracy.exact[0][1]


#: The steps that `tube_results` says are done.
STEPS = len(tube_accuracy.MESHES) + len(tube_weave.MESHES) + 1


def tube_results(constants: Any, done: Callable[[str], None]) -> TubeResults:
    """All results with a set of constants of the Lin–Yin law. done: told of each step.

    A `SolveError` if one of the states is not found.
    """
    # The matrices are small: the threads of the linear algebra would only wait for each other, beside those here.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with ThreadPoolExecutor(2) as pool:
        meshes = sorted(tube_accuracy.MESHES, key=lambda n: n != ELEMENTS)  # the longest first
        cycles = {pool.submit(tube, constants, n, S if n == ELEMENTS else ENDS): n for n in meshes}
        soft = {pool.submit(soft_weave, constants, n): n for n in tube_weave.MESHES}
        what: dict[Future[Any], str] = {}
        what.update({job: f"tube of {n} elements" for job, n in cycles.items()})
        what.update({job: f"tube of {n} elements with a soft weave" for job, n in soft.items()})
        for job in as_completed(what):
            job.result()
            done(what[job])
    tubes = {n: job.result() for job, n in cycles.items()}
    accuracy = tube_accuracy.accuracy(constants, [tubes[n] for n in tube_accuracy.MESHES])
    exact = {weave: lines(constants, weave, accuracy.exact[1][1]) for weave in WEAVES}
    other = changes(constants, accuracy)
    done("exact tube")
    of_cycle = tubes[ELEMENTS]
    found = claims(of_cycle, accuracy, other)
    return TubeResults(of_cycle, accuracy, [job.result() for job in soft], exact, other, found)
