"""Linear algebra of one small matrix or of many: for a single one the calls' overhead is most of the cost.

LAPACK called directly does a 7 x 7 eigenvalue problem in a third of the time of numpy's wrapper, to the
same rounding; for many matrices at once numpy's loop is the faster one.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from vita.types import Array, frozen

DIGITS = 1e-12
Mask = NDArray[np.bool_]
_SYEVD, _POTRF, _TRTRI = get_lapack_funcs(("syevd", "potrf", "trtri"), dtype=np.float64)


def eigh(matrix: Array) -> tuple[Array, Array]:
    """Eigenvalues (..., n), ascending, and eigenvectors (..., n, n), in columns, of symmetric `matrix`."""
    if matrix.ndim > 2:
        values, vectors = np.linalg.eigh(matrix)
        return values, vectors
    values, vectors, failed = _SYEVD(matrix)
    if failed:
        raise np.linalg.LinAlgError("Eigenvalues did not converge")
    return values, vectors


def whitening(covariance: Array) -> Array:
    """(..., n, n) lower triangular W with W P W' = I for a positive definite P = `covariance`.

    P is taken to be known to twelve digits only: an estimator that learns from steps inside the noise
    may be ever so uncertain of one direction, and rounding would then make another one negative.
    """
    n = covariance.shape[-1]
    rounding = DIGITS * np.trace(covariance, axis1=-2, axis2=-1)
    covariance = covariance + rounding[..., None, None] * identity(n)
    if covariance.ndim > 2:
        return np.linalg.inv(np.linalg.cholesky(covariance)).astype(float, copy=False)
    lower, failed = _POTRF(covariance, lower=1, clean=1)
    if failed:
        raise np.linalg.LinAlgError("Matrix is not positive definite")
    return _TRTRI(lower, lower=1)[0]


def some(mask: Mask) -> bool:
    """Whether any entry is true; for a single one `mask.any()` would cost twenty times as much."""
    return bool(mask) if mask.ndim == 0 else bool(np.count_nonzero(mask))


def all_of(mask: Mask) -> bool:
    """Whether every entry is true."""
    return bool(mask) if mask.ndim == 0 else bool(np.count_nonzero(mask) == mask.size)


@cache
def identity(n: int) -> Array:
    """(n, n) identity matrix, made once and read-only."""
    return frozen(np.eye(n))
