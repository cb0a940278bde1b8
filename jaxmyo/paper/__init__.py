"""The results of the paper (Bourdarias, Gerbi, Ohayon), recomputed and held against what it prints.

`command` is `jaxmyo paper`. Of the thin sample, `table1` and `sample` compute, `claims` compares, `figures` draws and
`output` writes CSV. Of the tube, `tube` computes the cycle, `exact_tube` the exact solution, `tube_accuracy` what lies
between, `tube_weave` and `tube_tension` other weaves and tensions, `tube_claims` compares, `tube_figures` draws and
`tube_output` writes; `tube_results` is all of it. `sections`, `tube_section` and `report` make the page report.html.
matplotlib, tqdm and meshio are needed by the figures, by `command` and by `tube_output` (the extra `jaxmyo[paper]`).
"""

from jaxmyo.paper.sample import Sample, sample
from jaxmyo.paper.table1 import Row, Table, table1

__all__ = ["Row", "Sample", "Table", "sample", "table1"]
