"""Parameter studies: a solve over a grid or a sample of named parameters, resumable, with derivatives and variances."""

from jaxmyo.studies.design import Sample, saltelli_sample, sobol_sample
from jaxmyo.studies.result import Study
from jaxmyo.studies.run import load_study, study

__all__ = ["Sample", "Study", "load_study", "saltelli_sample", "sobol_sample", "study"]
