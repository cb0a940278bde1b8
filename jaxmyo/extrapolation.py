"""To h = 0 from meshes of one family, as finite elements have errors with an expansion in powers of h."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray


def neville(values: Sequence[ArrayLike], h: Sequence[float], order: float = 2.0) -> NDArray[np.float64]:
    """The value at h = 0 of the polynomial in h^order through the values (numbers, arrays) on meshes of size h."""
    table, x = [np.asarray(v, dtype=np.float64) for v in values], [size**order for size in h]
    for m in range(1, len(table)):
        table = [(x[j] * table[j + 1] - x[j + m] * table[j]) / (x[j] - x[j + m]) for j in range(len(values) - m)]
    return table[0]
