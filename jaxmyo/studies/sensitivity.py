"""Global sensitivities: how much of the variance of an output each parameter accounts for (Sobol indices)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jaxmyo.studies.design import Design, Numbers


class Sobol(NamedTuple):
    """Indices [–] of one parameter, (...) of the output's shape, each with the ends of its confidence interval.

    first: the part of the variance that this parameter explains alone; total: with all its interactions.
    """

    first: Numbers
    first_low: Numbers
    first_high: Numbers
    total: Numbers
    total_low: Numbers
    total_high: Numbers


def sobol(
    design: Design, y: Numbers, converged: NDArray[np.bool_], confidence: float, seed: int = 0
) -> dict[str, Sobol]:
    """See `Study.sobol_indices`; y: ((d + 2) n, ...)."""
    from scipy.stats import sobol_indices

    if design.kind != "saltelli":
        raise ValueError(f"Sobol indices need a study over a saltelli_sample; this one is over a {design.kind} design")
    if not converged.all():
        raise ValueError(
            f"{int((~converged).sum())} of {converged.size} samples failed (`failures()` says why): the indices of the "
            "rest would be biased. Narrow the ranges"
        )
    d = len(design.axes)
    n = len(y) // (d + 2)
    blocks = y.reshape(d + 2, n, -1).transpose(0, 2, 1)  # block × output × point
    found = sobol_indices(func={"f_A": blocks[0], "f_B": blocks[1], "f_AB": blocks[2:]}, n=n)
    spread = found.bootstrap(confidence_level=confidence, n_resamples=999)
    inner = y.shape[1:]

    def of(values: Numbers, i: int) -> Numbers:
        return np.asarray(np.reshape(values, (-1, d))[:, i].reshape(inner))

    parts = (found.first_order, *spread.first_order.confidence_interval, found.total_order)
    parts = (*parts, *spread.total_order.confidence_interval)
    return {name: Sobol(*(of(part, i) for part in parts)) for i, name in enumerate(design.axes)}
