"""Precisions and tolerances of the Taylor integrator."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from ...models.errors import InputError
from .machine import RealType

Precision = Literal["double", "extended"]

_REALS: Mapping[str, RealType] = {"double": np.float64, "extended": np.longdouble}
_COARSEST = 1e-2


def real_of(precision: str) -> RealType:
    """The number type of a precision.

    Raises:
        InputError: there is none.
    """
    if precision not in _REALS:
        raise InputError(f"precision = {precision!r} is not one of 'double', 'extended'.")
    real = _REALS[precision]
    if precision == "extended" and np.finfo(real).eps >= np.finfo(np.float64).eps:
        raise InputError(
            "precision = 'extended' needs a machine whose long double is longer than a double."
        )
    return real


def checked_tolerance(tolerance: float | None, real: RealType) -> float:
    """A tolerance, or the number type's epsilon.

    Raises:
        InputError: it is less than that, or coarse.
    """
    least = float(np.finfo(real).eps)
    if tolerance is None:
        return least
    if not least <= tolerance <= _COARSEST:
        raise InputError(
            f"tolerance = {tolerance!r} is not between {least:.3g} (the precision's) and {_COARSEST}."
        )
    return float(tolerance)
