"""A trajectory beside the reference at the same times, and which of its samples can be compared.

An impact makes speeds and forces jump: between the instants at which the two have it, and within
one and a half steps of either, they are not compared; the instants are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...models.arrays import BoolArray, FloatArray
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from .balance import reference_balance, sampled_balance
from .impacts import Pair, impact_times, paired
from .results import Metric
from .scales import Scales, away_from_poles, scales_until
from .stretching import Stretching

EVENT_GUARD = 1.5
"""Steps around an event within which a sample may fall on its other side."""
THROWN = "projectile"
"""The marker whose launch is measured, unless another one is named."""


@dataclass(frozen=True)
class Comparison:
    """A trajectory beside the reference at the same times, cut at the end of the compared motion."""

    trajectory: Trajectory
    reference: Trajectory
    solution: Solution
    end: float
    keep: BoolArray
    thrown: str = THROWN
    known_scales: Scales | None = None
    invariants_to: float | None = None
    """End of what invariants are compared over [s]; None: the same."""
    stretching: Stretching | None = None
    """Of the reference motion to that end, where it is known."""

    @property
    def t(self) -> FloatArray:
        """Compared times [s]."""
        return self.trajectory.t[self.keep]

    @cached_property
    def lasting(self) -> Comparison:
        """The same to the end of what invariants are compared over; an impact after this one's end spoils that."""
        end = self.invariants_to
        if end is None or any(
            self.end < t <= end for t, _ in (*self.trajectory.impacts, *self.solution.impacts)
        ):
            return self
        return replace(self, end=end, keep=self.trajectory.t <= end, invariants_to=None)

    @cached_property
    def scales(self) -> Scales:
        """Of the reference motion up to the end."""
        return self.known_scales or scales_until(self.solution, self.end)

    @cached_property
    def balance(self) -> tuple[FloatArray, FloatArray]:
        """T + V - W of the trajectory (:mod:`.balance`) and of the reference, at the trajectory's times [J].

        W of samples that begin late is the reference's until then.
        """
        expected = reference_balance(self.solution, self.reference)
        before = float(self.reference.total_energy[0] - expected[0])
        return sampled_balance(self.trajectory)[0] - before, expected

    @cached_property
    def step(self) -> float:
        """Median interval of the samples [s]."""
        return float(np.median(np.diff(self.trajectory.t)))

    @cached_property
    def smooth(self) -> BoolArray:
        """Which compared samples are not at an impact of either."""
        away = np.ones(len(self.t), dtype=bool)
        for first, last in _impact_windows(self):
            guard = EVENT_GUARD * self.step
            away &= (self.t < first - guard) | (self.t > last + guard)
        return away

    @cached_property
    def away(self) -> BoolArray:
        """Which compared samples are not beside a singular position of the reference, a pole of forces."""
        return away_from_poles(self.solution, self.t, self.scales.time)

    def impact_pairs(self, stop: str) -> list[Pair]:
        """Times of a stop's impacts in the trajectory and in the reference, side by side (:func:`.impacts.paired`)."""
        times, expected = impact_times(self.trajectory, stop), impact_times(self.solution, stop)
        return paired(
            times,
            expected,
            self.step,
            min(float(self.trajectory.t[-1]), self.solution.problem.duration),
        )

    def distance(self, values: FloatArray, reference: FloatArray) -> FloatArray:
        """|values - reference| at the compared times; Euclidean over a trailing axis, if there is one."""
        difference = (values - reference)[self.keep]
        return np.abs(difference) if difference.ndim == 1 else np.linalg.norm(difference, axis=-1)

    def largest(
        self,
        name: str,
        values: FloatArray,
        reference: FloatArray,
        unit: str,
        subject: str | None = None,
        *,
        forces: bool = False,
    ) -> Metric:
        """Metric of the largest distance at the compared times away from impacts, if there is such a time.

        Forces are compared away from singular positions, too.
        """
        chosen = self.smooth & self.away if forces else self.smooth
        if not chosen.any():
            where = "at an impact or beside a singular position" if forces else "at an impact"
            return not_observed(name, subject, unit, f"every sample is {where}")
        value = float(self.distance(values, reference)[chosen].max())
        return Metric(name=name, subject=subject, value=value, unit=unit)


def against(
    trajectory: Trajectory, solution: Solution, end: float, reference: Trajectory | None = None
) -> Comparison:
    """Set a trajectory beside the reference, from the start to `end` [s].

    Args:
        reference: at the trajectory's times, where it is known already.
    """
    reference = reference or solution.trajectory(trajectory.t)
    return Comparison(trajectory, reference, solution, end, trajectory.t <= end)


def _impact_windows(c: Comparison) -> Iterator[tuple[float, float]]:
    """First and last instant of each impact of either; both of an impact that both have."""
    for stop in c.trajectory.mechanism.stops:
        times, expected = impact_times(c.trajectory, stop.name), impact_times(c.solution, stop.name)
        yield from ((time, time) for time in [*times, *expected])
        pairs = c.impact_pairs(stop.name)
        yield from (
            (min(own, other), max(own, other))
            for own, other in pairs
            if own is not None and other is not None
        )


def not_observed(
    name: str, subject: str | None, unit: str, why: str = "the engine does not tell it"
) -> Metric:
    """A metric of what cannot be judged, with the reason."""
    return Metric(name=name, subject=subject, value=None, unit=unit, observed=False, note=why)
