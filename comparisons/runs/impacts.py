"""Impacts of a run, aligned with those of the reference.

An engine with a step does not resolve a rebound that is shorter: a stop that bounces to rest has
fewer impacts than in the reference, or at other instants, and later ones have other numbers. So
impacts are aligned: a pair costs the difference of its times; to leave out an impact at the end of
an unresolved rebound costs a step; any other impact of only one of the two is a disagreement.
Unresolved is a rebound of the engine's that is shorter than its step, or one of the reference's
that is shorter than `FOLLOWED` steps, for an engine may end bouncing some steps earlier. An impact
that one has when the other's motion has ended costs nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...models.trajectory import Trajectory
from ...reference.solution import Solution

FOLLOWED = 4.0
"""Steps of the shortest rebound that an engine must follow."""
_MOST = 100  # impacts that are aligned, of each of the two: enough to find the first ten pairs
_DROPPED = 0.5  # of a step: shorter rebounds are left out at once
_ROUNDING = 1e-9  # of the largest impulse of an impact: a stop that only touches has no more
_MISSING = 1e9  # cost of an impact that only one has, in those of an unresolved one
Pair = tuple[float | None, float | None]
"""Times of an impact in the engine's motion and in the reference's; None: it has none [s]."""


def impact_times(motion: Trajectory | Solution, stop: str) -> list[float]:
    """Times of impacts in which a stop pushes, by more than rounding [s]."""
    return [
        time
        for time, impulses in motion.impacts
        if impulses.get(stop, 0.0) > _ROUNDING * max(impulses.values(), default=0.0)
    ]


def paired(
    times: Sequence[float], expected: Sequence[float], step: float, until: float = math.inf
) -> list[Pair]:
    """Impacts of one stop in the order of their times.

    Those at the end of an unresolved rebound, or beyond the end of the shorter motion, only if both
    have one.

    Args:
        times: of the engine's [s].
        expected: of the reference's [s].
        step: of the engine [s].
        until: end of the motion that ends first [s].
    """
    run, reference = (
        _resolvable(times, step, 1.0, until),
        _resolvable(expected, step, FOLLOWED, until),
    )
    # Least cost of aligning the first i impacts with the first j, from none to all of each
    costs = np.zeros((len(run) + 1, len(reference) + 1))
    costs[1:, 0] = np.cumsum([cost for _, cost in run])
    costs[0, 1:] = np.cumsum([cost for _, cost in reference])
    for i, (time, missing) in enumerate(run, start=1):
        for j, (due, unpaired) in enumerate(reference, start=1):
            together = costs[i - 1, j - 1] + abs(time - due) / step
            costs[i, j] = min(together, costs[i - 1, j] + missing, costs[i, j - 1] + unpaired)
    # The way back along the least costs; what has a cost of missing is a disagreement
    pairs, i, j = list[Pair](), len(run), len(reference)
    while i or j:
        time, missing = run[i - 1] if i else (math.nan, 0.0)
        due, unpaired = reference[j - 1] if j else (math.nan, 0.0)
        if i and j and costs[i, j] == costs[i - 1, j - 1] + abs(time - due) / step:
            i, j = i - 1, j - 1
            pairs.append((time, due))
        elif i and costs[i, j] == costs[i - 1, j] + missing:
            i -= 1
            pairs += [(time, None)] if missing == _MISSING else []
        else:
            j -= 1
            pairs += [(None, due)] if unpaired == _MISSING else []
    return pairs[::-1]


def _resolvable(
    times: Sequence[float], step: float, shortest: float, until: float
) -> list[tuple[float, float]]:
    """Impacts [s] that may have a counterpart, and the cost of having none; `shortest` in steps."""
    impacts: list[tuple[float, float]] = []
    for time, rebound in zip(times, [math.inf, *np.diff(times).tolist()], strict=False):
        if rebound > _DROPPED * step:
            unresolved = 1.0 if rebound < shortest * step else _MISSING
            impacts.append((time, 0.0 if time > until else unresolved))
    return impacts[:_MOST]
