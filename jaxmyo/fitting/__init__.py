"""Fits of constants to measurements, and what the measurements can tell of them. Needs the extra `fit` (optimistix)."""

from jaxmyo.fitting.descent import descend
from jaxmyo.fitting.fit import Estimate, Fit, fit, held_out, unfitted
from jaxmyo.fitting.least_squares import Loss
from jaxmyo.fitting.parameters import Parameter
from jaxmyo.fitting.problem import Problem, log_likelihood
from jaxmyo.fitting.sample import sample_problem

__all__ = [
    "Estimate",
    "Fit",
    "Loss",
    "Parameter",
    "Problem",
    "descend",
    "fit",
    "held_out",
    "log_likelihood",
    "sample_problem",
    "unfitted",
]
