"""Intel's Math Kernel Library, where it is installed (`jaxmyo[fast]`): its functions, and its sparse matrices."""

import ctypes
import os
import weakref
from functools import cache
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray


@cache
def library() -> Any:
    """The library; ImportError where there is none. pypardiso takes a fifth of a second to find it when imported.

    MKL's threads wait busily for their next call, for 200 ms unless the environment variable KMP_BLOCKTIME says
    otherwise, and take a core from JAX's. It is set to 5 ms here, unless the user has set it.
    """
    os.environ.setdefault("KMP_BLOCKTIME", "5")
    from pypardiso import ps

    return ps.libmkl


class _Description(ctypes.Structure):
    """Of a matrix, MKL's `struct matrix_descr`."""

    _fields_ = (("type", ctypes.c_int), ("mode", ctypes.c_int), ("diag", ctypes.c_int))


# Numbers of MKL's enumerations in mkl_spblas.h: kinds of matrix (the symmetric one by its upper triangle, diagonal
# included), indices from zero, blocks by rows, and a product with the matrix as it is.
_GENERAL, _SYMMETRIC = _Description(20, 0, 0), _Description(21, 41, 50)
_FROM_ZERO, _BY_ROWS, _AS_IT_IS = 0, 101, 10


class Matrix:
    """A sparse matrix of single precision, in CSR or in BSR with square blocks, that multiplies vectors by all cores.

    SciPy's products, which run on one core, take two to four times as long. Of a symmetric one, the upper triangle.
    """

    def __init__(self, matrix: sp.csr_matrix | sp.bsr_matrix, *, symmetric: bool = False) -> None:
        self._kind = _SYMMETRIC if symmetric else _GENERAL
        rows = len(matrix.indptr) - 1
        size = matrix.shape[0] // rows
        self.shape, self._handle = matrix.shape, ctypes.c_void_p()
        self._data = matrix.data.astype(np.float32)
        starts, self._indices = (x.astype(np.int32) for x in (matrix.indptr, matrix.indices))
        self._starts = starts  # MKL holds on to the arrays
        counts = (
            (_FROM_ZERO, _BY_ROWS, rows, matrix.shape[1] // size, size) if size > 1 else (_FROM_ZERO, *matrix.shape)
        )
        of_bsr, of_csr, self._multiply, destroy = _functions()
        create = of_bsr if size > 1 else of_csr
        arrays = (starts[:-1], starts[1:], self._indices, self._data)
        pointers = (ctypes.c_void_p(x.ctypes.data) for x in arrays)
        _checked(create(ctypes.byref(self._handle), *map(ctypes.c_int, counts), *pointers))
        weakref.finalize(self, destroy, self._handle)

    def __matmul__(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        x, y = np.ascontiguousarray(x, dtype=np.float32), np.empty(self.shape[0], np.float32)
        _checked(self._multiply(_AS_IT_IS, 1.0, self._handle, self._kind, x.ctypes.data, 0.0, y.ctypes.data))
        return y


@cache
def _functions() -> tuple[Any, Any, Any, Any]:
    """That create a matrix in BSR and in CSR, multiply by it, and destroy it."""
    names = ("s_create_bsr", "s_create_csr", "s_mv", "destroy")
    of_bsr, of_csr, multiply, destroy = (library()[f"mkl_sparse_{name}"] for name in names)
    number, address = ctypes.c_float, ctypes.c_void_p
    multiply.argtypes = (ctypes.c_int, number, address, _Description, address, number, address)
    destroy.argtypes = (address,)
    return of_bsr, of_csr, multiply, destroy


def _checked(status: int) -> None:
    if status:
        raise RuntimeError(f"a sparse matrix of MKL failed with its status {status}")
