"""The results of the paper (Bourdarias, Gerbi, Ohayon), recomputed and held against what it prints.

`table1` and `sample` compute, `claims` compares, `figures` draws, `output` writes CSV; `command` is `jaxmyo paper`.
matplotlib and tqdm are needed by `figures` and `command` only (the extra `jaxmyo[paper]`).
"""

from jaxmyo.paper.sample import Sample, sample
from jaxmyo.paper.table1 import Row, Table, table1

__all__ = ["Row", "Sample", "Table", "sample", "table1"]
