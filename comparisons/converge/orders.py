"""Observed orders of convergence: the power law that errors follow, and Richardson's limit.

The order is a straight line in the log-log plane, over the range in which there is one. The limit
is what an engine would say with no time step at all, as functions of time: the deviations from the
reference stand on one grid of times, so that those of different steps can be subtracted and
extrapolated sample by sample. (Richardson 1911; Roache, Verification and Validation, on observed
orders.)
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import stats
from scipy.optimize import brentq

from ...models.arrays import FloatArray
from ..runs.runner import run_duration
from .results import PowerLaw

CONFIDENCE = 0.95
FEWEST = 4  # points of a line: two make it, two more can gainsay it
SLOPE = 0.1
"""How far the local slope may depart from a line's along its run: the bar the suite states for orders. A parabola that
is off a line by r at worst, over a length L of the logarithm, has slopes that are off by 6 r / L at
its ends; so a run is taken for straight if its worst point is off by no more than SLOPE * L / 6."""
TENFOLD = 10.0
"""An exponent is only claimed where the error changes at least so much: less may be a floor with a slope."""


def power_law(
    values: Sequence[float], errors: Sequence[float | None], uncertainty: float = 0.0
) -> PowerLaw | None:
    """The power law that tells the most of a study: error = factor * value^exponent.

    Of all runs of at least four neighbouring points on a line (least squares of the logarithms)
    whose slope departs by less than `SLOPE`, the one along which the error changes most. The rule
    knows of no expected exponent; it leaves out a floor, on which the error does not change, and a
    coarse end with another slope.

    Args:
        values: of the swept parameter, positive.
        errors: None where a run failed, which parts neighbours.
        uncertainty: errors not above it are not fitted: they measure the reference.

    Returns:
        None where no run of points qualifies, or along none the error changes tenfold.
    """
    order = np.argsort(values)
    x = np.array(values, dtype=np.float64)[order]
    y = np.array(
        [np.nan if e is None or e <= uncertainty or e <= 0 else e for e in errors], dtype=np.float64
    )[order]
    laws = [
        law
        for law in _lines(x, y)
        if abs(law.exponent) * np.log(law.high / law.low) >= np.log(TENFOLD)
    ]
    return max(laws, key=lambda law: abs(law.exponent) * np.log(law.high / law.low), default=None)


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


ASYMPTOTIC = 0.1
"""How far an observed order may lie from a whole number: the bar the suite states for orders themselves."""
_LOWEST, _HIGHEST = 0.1, 8.0  # orders that are looked for
_NEAR, _CANDIDATES = (
    0.03,
    6001,
)  # range of the fitting step about the one asked for, relative; steps tried in it


@dataclass(frozen=True)
class Level:
    """A motion's deviation at one time step."""

    step: float
    """[s]"""
    position: FloatArray
    """[m], shape (..., 2, n): of one point or several."""
    torques: FloatArray
    """[N m], shape (number of stops, n)."""


@dataclass(frozen=True)
class Extrapolated:
    """A limit, and how it was come by."""

    levels: tuple[float, ...]
    order: float
    power: int
    position: FloatArray
    """Deviation of the limit from the reference [m], shape (..., 2, n)."""
    torques: FloatArray
    position_three: FloatArray

    @property
    def estimate(self) -> float:
        """The limit's own error [m], without the reference: its distance from the one of three levels."""
        return largest(self.position - self.position_three)


def largest(position: FloatArray) -> float:
    """Largest length of any vector over time [m]; shape (..., 2, n)."""
    return float(np.linalg.norm(position, axis=-2).max())


def limit(levels: Sequence[Level]) -> Extrapolated | None:
    """The best limit of a ladder of levels, judged without the reference.

    Of all three neighbouring levels whose successive differences show a whole order, those whose
    limits from two and from three levels lie nearest to each other. A coarse triple fails by the
    next power, a fine one by rounding.

    Args:
        levels: of one engine and preset, at least three.

    Returns:
        None if no three levels show a whole order.
    """
    ladder = sorted(levels, key=lambda level: -level.step)
    triples = zip(ladder, ladder[1:], ladder[2:], strict=False)
    limits = [
        extrapolated for triple in triples if (extrapolated := _extrapolated(triple)) is not None
    ]
    return min(limits, key=lambda extrapolated: extrapolated.estimate, default=None)


def observed_order(steps: Sequence[float], first: float, second: float) -> float | None:
    """The order p for which (h0^p - h1^p) / (h1^p - h2^p) is the ratio of two successive differences.

    Args:
        steps: three, from coarse to fine [s]; their ratios need not be the same.
        first: size of the difference between the coarser two.
        second: between the finer two.

    Returns:
        None where no order between 0.1 and 8 does.
    """
    h0, h1, h2 = steps

    def excess(p: float) -> float:
        return np.log((h0**p - h1**p) / (h1**p - h2**p)) - np.log(first / second)

    if not (first > 0 and second > 0) or excess(_LOWEST) * excess(_HIGHEST) > 0:
        return None
    return float(brentq(excess, _LOWEST, _HIGHEST))


def weights(steps: Sequence[float], powers: Sequence[int]) -> FloatArray:
    """What to add the levels up with, so that the given powers of the step cancel; they sum to 1.

    Args:
        steps: one more than there are powers [s].
    """
    h = np.array(steps) / min(steps)
    matrix = np.stack([h ** float(p) for p in (0, *powers)])
    return np.linalg.solve(matrix, np.eye(len(steps))[0])


def _extrapolated(triple: tuple[Level, Level, Level]) -> Extrapolated | None:
    steps = tuple(level.step for level in triple)
    coarse, middle, fine = (level.position for level in triple)
    order = observed_order(steps, largest(coarse - middle), largest(middle - fine))
    if order is None or round(order) < 1 or abs(order - round(order)) > ASYMPTOTIC:
        return None
    power = round(order)
    two, three = weights(steps[1:], (power,)), weights(steps, (power, power + 1))
    return Extrapolated(
        levels=steps,
        order=order,
        power=power,
        position=np.tensordot(two, np.stack([middle, fine]), 1),
        torques=np.tensordot(two, np.stack([level.torques for level in triple[1:]]), 1),
        position_three=np.tensordot(three, np.stack([coarse, middle, fine]), 1),
    )


def fitting(step: float, end: float, events: Sequence[float], longest: float = math.inf) -> float:
    """The step near the one asked for of which whole numbers come nearest to filling what remains after each event.

    Engines fit a whole number of equal steps between an event and the end, and so shorten them by
    up to one part in that number. Unequal shortening would spoil the ratio of the steps, on which
    Richardson's extrapolation rests.

    Args:
        step: asked for [s].
        end: of the compared motion [s].
        events: times of the reference's releases [s].
        longest: that the reference goes on to [s].
    """
    candidates = step * np.linspace(1.0 - _NEAR, 1.0 + _NEAR, _CANDIDATES)
    durations = np.array([run_duration(end, float(candidate), longest) for candidate in candidates])
    left = [(durations - start) / candidates for start in (0.0, *events)]
    shortened = np.max([(np.ceil(n - 1e-9) - n) / n for n in left], axis=0)
    return float(candidates[int(np.argmin(shortened))])
