"""One run: a single segment, or under the unilateral law one after each impact."""

from __future__ import annotations

import numpy as np

from ...models.errors import UnsupportedProblemError
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ..protocol import Recording
from .build import start_of
from .options import PymunkOptions
from .segment import Segment
from .unilateral import record_with_impacts


def record(problem: Problem, engine: PymunkOptions) -> Recording:
    """Run a problem.

    Raises:
        UnsupportedProblemError: the mechanism has a part that has no counterpart here, or starts on a moving stop.
    """
    if problem.stop_law is StopLaw.UNILATERAL:
        return record_with_impacts(problem, engine)
    _refuse_moving_stops(problem.mechanism)
    segment = Segment(problem.mechanism, engine, 0.0, problem.duration)
    segment.begin()
    segment.advance(segment.n)
    return segment.recording(segment.n)


def _refuse_moving_stops(mechanism: Mechanism) -> None:
    kinematics, (q, u) = Kinematics(mechanism), start_of(mechanism)
    for stop in mechanism.stops:
        row = kinematics.gap_jacobian(stop.name, q)
        if stop.closed and abs(float(row @ u)) > 1e-12 * (1 + float(np.abs(row) @ np.abs(u))):
            raise UnsupportedProblemError(
                f"pymunk cannot start with the stop {stop.name!r} closed and its gap changing: that is an impact."
            )
