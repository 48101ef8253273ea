"""The array types of the package."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.intp]


def as_vectors(z: ComplexArray) -> FloatArray:
    """Complex numbers x + i y as vectors, along a new last axis."""
    return np.stack([z.real, z.imag], axis=-1)
