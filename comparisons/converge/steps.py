"""Time steps that fit the throw: an engine that would shorten its steps to meet an event takes them as asked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..runs.runner import TAIL, TAIL_STEPS

_NEAR = 0.03  # how far from the step asked for is looked
_CANDIDATES = 6001


def fitting(step: float, end: float, events: Sequence[float]) -> float:
    """The step near the one asked for of which whole numbers come nearest to filling what remains after each event.

    Engines fit a whole number of equal steps between an event and the end, and so shorten them by up to one part in
    that number. Unequal shortening would spoil the ratio of the steps, on which Richardson's extrapolation rests.

    Args:
        step: asked for [s].
        end: of the compared motion [s].
        events: times of the reference's releases [s].
    """
    candidates = step * np.linspace(1.0 - _NEAR, 1.0 + _NEAR, _CANDIDATES)
    durations = end + np.maximum(TAIL, TAIL_STEPS * candidates)
    left = [(durations - start) / candidates for start in (0.0, *events)]
    shortened = np.max([(np.ceil(n - 1e-9) - n) / n for n in left], axis=0)
    return float(candidates[int(np.argmin(shortened))])
