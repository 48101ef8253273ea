"""Tolerances of importers; nothing here is set from what importers do."""

from __future__ import annotations

import math

import numpy as np
from trebucheck.api.mechanics import FloatArray

from .expected import Expected, Motion
from .zoo.model import TIME_CONSTANT

ROUNDING = {"float64": 1e-9, "float32": 1e-5}
"""Relative tolerance of arithmetic alone: some hundred roundings times a condition number."""
SOFTNESS = 10 * (1 - 0.9999)
"""Relative tolerance of accelerations with equalities: ten times the files' softness."""
ROUNDINGS = 10
"""Roundings of each position on its way to the residual of a loop."""
REST_FORCE = 1e-3
"""Relative, of a force at rest: what a user of limit forces needs."""
TELLS_NOTHING = 1e-2
"""A tolerance above this part of how far the joints move decides nothing."""
REFINEMENTS = 5
"""Halvings of the step while a verdict is undecided: 32 times the accuracy at first order."""
# Of a critically damped limit that cannot pull: it is left at twice its time constant.
_REBOUND = math.exp(-2)
_SAFETY = 2.0


def of_motion(
    expected: Expected,
    motion: Motion,
    coarse: FloatArray,
    fine: FloatArray,
    steps: int,
    precision: str,
) -> FloatArray:
    """Tolerance of the finer of two runs, at half the step, shape (n,): the larger up to each time.

    A scheme of order p leaves of the difference of both runs 1 / (2^p - 1), at most all of it with
    p = 1; twice that is allowed. To it come the certified uncertainty, rounding, of each of the
    steps too, and what the file states of its constraints' softness.
    """
    own = np.maximum.accumulate(abs(fine - coarse).max(axis=1))
    size = max(1.0, float(abs(motion.positions).max()))
    rounding = max(ROUNDING[precision], steps * float(np.finfo(precision).eps))
    known = motion.uncertainty.max(axis=1) + rounding * size
    return _SAFETY * own + known + give(expected, motion)


def give(expected: Expected, motion: Motion) -> float:
    """Yield of constraints with the files' time constant under the motion's accelerations.

    That is a T^2; it is allowed where loops or events are part of the motion.
    """
    if not expected.needs:
        return 0.0
    accelerations = abs(np.gradient(motion.speeds, motion.interval, axis=0)[1:-1])
    return TIME_CONSTANT**2 * float(np.median(accelerations.max(axis=1)) * 10)


def of_impact(expected: Expected, step: float) -> float:
    """Largest passage of a limit, v (T + h): a critically damped limit gives way by v T / e."""
    return float(abs(expected.whole.speeds).max()) * (TIME_CONSTANT + step)


def of_rebound(expected: Expected) -> float:
    """Largest hop back from a limit that is pressed, by the rebound of the file's own limit."""
    if expected.pressing == 0.0:
        return 0.0
    speed = _REBOUND * float(abs(expected.whole.speeds).max())
    return speed**2 / (2 * expected.pressing)
