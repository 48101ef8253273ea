"""Extrema of a proved motion: where a rate falls through zero, and nowhere else in an interval.

The rate of a function is proved positive on all of the interval before the times of a ball, and
negative after them: the function is largest at one of those times.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

from ..taylor.numbers import PROJECTILE
from .balls import Ball, acb, arb, between, squared
from .motion import Phase, ProvedEvent, ProvedMotion, State, hull
from .numbers import Complex, as_coordinates

_PARTS = 64  # of an interval, before those without a sign are halved
_MOST = 400  # of those, beyond which no single maximum is found
_KEPT = 3  # digits of a motion that its extremum's time does not have

Rate = Callable[[Ball], Ball]
"""Derivative of a function at the times of a ball [s].

Raises:
    ValueError: it is not known there.
"""


class _Interval(NamedTuple):
    low: Ball
    high: Ball
    """Both exact [s]."""


def largest(rate: Rate, low: Ball, high: Ball, digits: int) -> Ball | None:
    """Enclose the time at which a function is largest inside an interval.

    Args:
        rate: of the function.
        low: start of the interval [s].
        high: its end [s].
        digits: of its length, to which the time is sought.

    Returns:
        The time [s]; None where the rate's sign does not show a single maximum, or shows it at an
        end of the interval.
    """
    ends = [(low + (high - low) * k / _PARTS).mid() for k in range(_PARTS + 1)]
    pieces = [_Interval(a, b) for a, b in pairwise(ends)]
    rising: list[_Interval] = []
    falling: list[_Interval] = []
    for _ in range(math.ceil(digits * math.log2(10))):
        undecided: list[_Interval] = []
        for piece in pieces:
            match _sign(rate, between(*piece)):
                case 1:
                    rising.append(piece)
                case -1:
                    falling.append(piece)
                case _:
                    middle = ((piece.low + piece.high) / 2).mid()
                    undecided += _Interval(piece.low, middle), _Interval(middle, piece.high)
        pieces = undecided
        if not 0 < len(pieces) <= _MOST:
            return None
    first, last = pieces[0].low, pieces[-1].high
    one = all(a.high <= first for a in rising) and all(a.low >= last for a in falling)
    return between(first, last) if one and rising and falling else None


def _sign(rate: Rate, t: Ball) -> int:
    """Sign of a rate at all times of a ball; 0: it is not known, or not one."""
    try:
        value = rate(t)
    except ValueError:
        return 0
    if value > 0:
        return 1
    return -1 if value < 0 else 0


def _with_following(motion: ProvedMotion) -> Iterator[tuple[Phase, Phase | None]]:
    """Each phase with the next one; None after the last."""
    return zip(motion.phases, [*motion.phases[1:], None], strict=True)


def state_at(motion: ProvedMotion, t: Ball) -> State:
    """The least box around the states at the times of a ball [s], of all phases that it meets.

    Raises:
        ValueError: the ball lies beyond the end of the motion.
    """
    found: list[State] = []
    for phase, following in _with_following(motion):
        if t < phase.start or (following is not None and t > following.start):
            continue
        if following is None and not t < phase.end:
            raise ValueError("the motion is over")
        found.append(phase.at(t))
    return hull(found)


def _phase_at(motion: ProvedMotion, t: Ball) -> Phase:
    """The phase at the times of a ball [s].

    A launch changes nothing, so that the steps before it hold for what follows at once.

    Raises:
        ValueError: the ball lies across another event, or beyond the end of the motion.
    """
    for phase, following in _with_following(motion):
        begun = phase is motion.phases[0] or t > phase.start
        goes_on = following is None or t < following.start or following.closed == phase.closed
        if begun and goes_on and t < phase.end:
            return phase
    raise ValueError("the ball lies across an event")


@dataclass(frozen=True)
class Extrema:
    """Extrema of a motion that launches, in the context's precision.

    Each is an event with the time and the state of the maximum; None where no single maximum inside
    its interval is proved.
    """

    motion: ProvedMotion
    digits: int
    """Digits of the motion."""

    def rightmost(self, marker: str) -> ProvedEvent | None:
        """Where a marker's x is largest between the start and the launch."""

        def rate(t: Ball) -> Ball:
            return self.motion.point(marker, state_at(self.motion, t))[1].real

        end = self._launch.time.lower()
        # A motion that begins at rest has no sign at once: its first part is compared by x itself.
        first = (end / _PARTS).mid()
        event = self._event(f"x of {marker}", rate, first, end)
        if event is None:
            return None
        x = self.motion.point(marker, (event.q, event.u))[0].real
        before = self.motion.point(marker, state_at(self.motion, between(arb(0), first)))[0].real
        return event if before < x else None

    def best_release(self, step: float) -> ProvedEvent | None:
        """The release with the longest flight without air, within a step of the launch [s]."""
        g = self.motion.problem.mechanism.gravity

        def rate(t: Ball) -> Ball:
            """Derivative of R = x + vx T by the release, g T = vy + sqrt(vy^2 + 2 g y)."""
            position, velocity, acceleration = self._accelerated(t)
            fall = (squared(velocity.imag) + 2 * g * position.imag).sqrt()
            time = (velocity.imag + fall) / g
            d_fall = (velocity.imag * acceleration.imag + g * velocity.imag) / fall
            d_time = (acceleration.imag + d_fall) / g
            return velocity.real + acceleration.real * time + velocity.real * d_time

        return self._event("range", rate, *self._about_the_launch(step)) if g else None

    def fastest(self, step: float) -> ProvedEvent | None:
        """Where the projectile is fastest, within a step of the launch [s]."""

        def rate(t: Ball) -> Ball:
            _, velocity, acceleration = self._accelerated(t)
            return velocity.real * acceleration.real + velocity.imag * acceleration.imag

        return self._event("speed", rate, *self._about_the_launch(step))

    @cached_property
    def _launch(self) -> ProvedEvent:
        launch = self.motion.launch
        assert launch is not None, "a motion without a launch has no extrema about it"
        return launch

    def _about_the_launch(self, step: float) -> tuple[Ball, Ball]:
        """The interval within a step of the launch, after the last release before it [s]."""
        time = self._launch.time
        low = (time.lower() - step).max(arb(0))
        for event in self.motion.events:
            if event.kind == "release" and event.time < time and not event.time < low:
                low = event.time.upper()
        return low, time.upper() + step

    def _event(self, name: str, rate: Rate, low: Ball, high: Ball) -> ProvedEvent | None:
        time = largest(rate, low, high, self.digits - _KEPT)
        if time is None:
            return None
        return ProvedEvent("maximum", name, time, *state_at(self.motion, time))

    def _accelerated(self, t: Ball) -> tuple[Complex, Complex, Complex]:
        """Position, velocity and acceleration of the projectile, x + i y."""
        motion, phase = self.motion, _phase_at(self.motion, t)
        state = phase.at(t)
        position, velocity = motion.point(PROJECTILE, state)
        marker = motion.problem.mechanism.marker(PROJECTILE)
        assert marker is not None
        q, u = map(as_coordinates, state)
        second = motion.kinematics.second_flow(q, u, motion.forces(phase, state).accelerations)
        row = motion.kinematics.point(marker.body, marker.point)
        acceleration = sum((a * c for a, c in zip(second, row.coefficients, strict=True)), acb(0))
        return position, velocity, acceleration
