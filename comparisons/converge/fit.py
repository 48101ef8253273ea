"""The observed order: a straight line in the log-log plane, over the range in which there is one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
from scipy import stats

from ...models.arrays import FloatArray
from .results import PowerLaw

CONFIDENCE = 0.95
FEWEST = 4  # points of a line: two make it, two more can gainsay it
SLOPE = 0.1
"""How far the local slope may depart from a line's along its run: the bar the suite states for orders. A parabola that
is off a line by r at worst, over a length L of the logarithm, has slopes that are off by 6 r / L at its ends; so a run
is taken for straight if its worst point is off by no more than SLOPE * L / 6."""
TENFOLD = 10.0
"""An exponent is only claimed where the error changes at least so much: less may be a floor with a slope."""


def power_law(values: Sequence[float], errors: Sequence[float | None], uncertainty: float = 0.0) -> PowerLaw | None:
    """The power law that tells the most of a study: error = factor * value^exponent.

    Of all runs of at least four neighbouring points on a line (least squares of the logarithms) whose slope departs
    by less than `SLOPE`, the one along which the error changes most. The rule knows of no expected exponent; it leaves
    out a floor, on which the error does not change, and a coarse end with another slope.

    Args:
        values: of the knob, positive.
        errors: None where a run failed, which parts neighbours.
        uncertainty: errors not above it are not fitted: they measure the reference.

    Returns:
        None where no run of points qualifies, or along none the error changes tenfold.
    """
    order = np.argsort(values)
    x = np.array(values, dtype=np.float64)[order]
    y = np.array([np.nan if e is None or e <= uncertainty or e <= 0 else e for e in errors], dtype=np.float64)[order]
    found = [law for law in _lines(x, y) if abs(law.exponent) * np.log(law.high / law.low) >= np.log(TENFOLD)]
    return max(found, key=lambda law: abs(law.exponent) * np.log(law.high / law.low), default=None)


def _lines(x: FloatArray, y: FloatArray) -> Iterator[PowerLaw]:
    """Every run of neighbours that one line tells well enough."""
    for first, end in combinations(range(len(x) + 1), 2):
        # A run of one and the same error is a floor; linregress has no deviation for it.
        if end - first >= FEWEST and np.isfinite(y[first:end]).all() and np.ptp(y[first:end]) > 0:
            law, off = _line(np.log(x[first:end]), np.log(y[first:end]))
            if 6.0 * off <= SLOPE * np.log(law.high / law.low):
                yield law


def _line(x: FloatArray, y: FloatArray) -> tuple[PowerLaw, float]:
    """The line through all these logarithms, and how far the worst point is off it."""
    line = stats.linregress(x, y)
    quantile = stats.t.ppf((1 + CONFIDENCE) / 2, len(x) - 2)
    law = PowerLaw(
        exponent=float(line.slope),
        half_width=float(quantile * line.stderr),
        factor=float(np.exp(line.intercept)),
        low=float(np.exp(x[0])),
        high=float(np.exp(x[-1])),
        points=len(x),
    )
    return law, float(np.abs(y - line.intercept - line.slope * x).max())
