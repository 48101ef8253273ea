"""The grids the paper samples on, and our own values at their points."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ...models.arrays import FloatArray
from ...models.trajectory import Trajectory
from ..verdicts import Grid
from .headline import GRIDS
from .throws import MachineThrow

TIME_STEP, CAPTION_STEP = GRIDS
"""Of the release times [s]: by the text (Sec. IV), and by the caption of Fig. 4."""
LEVER_STEP = 0.01
"""Of l1 [m]: the last digit that Sec. V prints it to."""


def around(point: float, step: float) -> FloatArray:
    """Points of the grid k step, k whole, that lie within one step of a point."""
    first, last = math.ceil((point - step) / step - 1e-9), math.floor((point + step) / step + 1e-9)
    return np.arange(first, last + 1, dtype=np.float64) * step


def time_grid(throw: MachineThrow, time: float, value: Callable[[Trajectory], FloatArray]) -> Grid:
    """Our values at the points of the time grid around an instant.

    Args:
        throw: whose reference is read.
        time: the instant [s].
        value: of a trajectory, shape (n,).
    """
    times = around(time, TIME_STEP)
    values = value(throw.at(times))
    return Grid(f"{TIME_STEP:g} s", tuple(zip(times.tolist(), values.tolist(), strict=True)))
