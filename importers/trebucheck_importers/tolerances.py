"""How far an importer may be off; nothing here is set from what importers do."""

from __future__ import annotations

import math

import numpy as np
from trebucheck.api.mechanics import FloatArray

from .expected import Expected, Motion
from .zoo.model import TIME_CONSTANT

ROUNDING = {"float64": 1e-9, "float32": 1e-5}
"""Relative, of what follows from the file by arithmetic alone: some hundred roundings times a condition number."""
SOFTNESS = 10 * (1 - 0.9999)
"""Relative, of accelerations where equalities act: ten times what the files' impedance leaves of a constraint."""
ROUNDINGS = 10
"""Of each position on its way to the residual of a loop."""
REST_FORCE = 1e-3
"""Relative, of a force at rest: what a user of limit forces needs."""
TELLS_NOTHING = 1e-2
"""A tolerance above this part of how far the joints move decides nothing."""
REFINEMENTS = 5
"""So often the step is halved again where a verdict is undecided: a method of first order is then 32 times as near."""
_REBOUND = math.exp(
    -2
)  # of a critically damped limit that cannot pull: it is left at twice its time constant
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
    """By how much constraints of the files' time constant give way where they carry the motion's accelerations.

    That is a T^2; it is allowed where loops or events are part of the motion.
    """
    if not expected.needs:
        return 0.0
    accelerations = abs(np.gradient(motion.speeds, motion.interval, axis=0)[1:-1])
    return TIME_CONSTANT**2 * float(np.median(accelerations.max(axis=1)) * 10)


def of_impact(expected: Expected, step: float) -> float:
    """How far a joint may pass its limit, v (T + h): penetration of a critically damped limit is v T / e."""
    return float(abs(expected.whole.speeds).max()) * (TIME_CONSTANT + step)


def of_rebound(expected: Expected) -> float:
    """How far a joint may hop back from a limit that it is pressed on, by the rebound of the file's own limit."""
    if expected.pressing == 0.0:
        return 0.0
    speed = _REBOUND * float(abs(expected.whole.speeds).max())
    return speed**2 / (2 * expected.pressing)
