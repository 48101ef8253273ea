"""Until when motions are compared: a launch, a time, or a release, as a user states it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Self

from ...models.errors import InputError
from ...models.launch import LAUNCH_ANGLE
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...reference.solution import Solution
from ...reference.solver import characteristic_time, solve, solve_to_launch, solve_until
from .comparison import THROWN

_FORM = "must be 'launch', 'launch:MARKER', 'release:STOP', or a time in seconds"
_TAIL = 0.4  # of the compared time: the reference goes on, so that events of engines that are late can be found
_SPANS = (2.0, 5.5, 16.0)  # characteristic times within which a release is looked for


@dataclass(frozen=True)
class Until:
    """The end of a compared motion."""

    kind: Literal["launch", "time", "release"] = "launch"
    time: float = math.nan
    """[s], of kind 'time'."""
    name: str = ""
    """Marker or stop; '' is the marker that machines throw."""
    required: bool = True
    """Whether a motion without that event is refused; if not, it is compared for some characteristic times."""

    @classmethod
    def of(cls, given: str | float | None) -> Self:
        """From 'launch', 'launch:tip', 'release:hanger rest', '2.5' or 2.5; None: the launch, if there is one.

        Raises:
            InputError: it has none of these forms.
        """
        if given is None:
            return cls(required=False)
        if isinstance(given, str):
            kind, separator, name = given.strip().partition(":")
            if kind == "launch" and bool(separator) == bool(name.strip()):
                return cls(name=name.strip())
            if kind == "release" and name.strip():
                return cls("release", name=name.strip())
        try:
            return cls("time", float(given))
        except (ValueError, OverflowError):
            shown = str(given) if len(str(given)) <= 60 else f"{str(given)[:57]}..."
            raise InputError(f"until = {shown!r} {_FORM}.") from None

    @property
    def thrown(self) -> str:
        """The marker whose launch is measured."""
        return self.name if self.kind == "launch" and self.name else THROWN

    def solve(self, mechanism: Mechanism, law: StopLaw) -> tuple[Solution, float]:
        """The reference motion, somewhat longer than the compared one, and the end of that [s].

        Raises:
            InputError: the time is not valid, there is no such marker or stop, or the event does
            not come.
            SimulationError: the reference cannot move the mechanism.
        """
        if self.kind == "time":
            duration = Problem(mechanism, duration=self.time, stop_law=law).duration
            return solve(
                Problem(mechanism, duration=duration * (1 + _TAIL), stop_law=law)
            ), duration
        if mechanism.gravity == 0:
            raise InputError(
                f"{mechanism.name!r} has no gravity, and so no time scale within which an event could be looked for; "
                "name the end of the compared motion in seconds, e.g. --until 2.5."
            )
        return (
            self._released(mechanism, law)
            if self.kind == "release"
            else self._launched(mechanism, law)
        )

    def _released(self, mechanism: Mechanism, law: StopLaw) -> tuple[Solution, float]:
        closed = [stop.name for stop in mechanism.stops if stop.closed]
        if self.name not in closed:
            raise InputError(
                f"until = 'release:{self.name[:60]}': {mechanism.name!r} has no such closed stop: {closed}."
            )
        solution = _solved(mechanism, law, lambda found: found.release_times[self.name])
        time = solution.release_times[self.name]
        if time is None or time == 0.0:
            within = f"does not open within {solution.problem.duration:.6g} s"
            when = "opens at the start" if time == 0.0 else within
            raise InputError(f"until = 'release:{self.name}': the stop {when}; name another end.")
        return solution, time

    def _launched(self, mechanism: Mechanism, law: StopLaw) -> tuple[Solution, float]:
        if self.name and mechanism.marker(self.name) is None:
            known = [marker.name for marker in mechanism.markers]
            raise InputError(
                f"until = 'launch:{self.name[:60]}': {mechanism.name!r} has no such marker: {known}."
            )

        def launched(solution: Solution) -> float | None:
            launch = solution.launch_at(LAUNCH_ANGLE, self.thrown)
            return None if launch is None else launch.time

        known = self.thrown == THROWN
        solution = solve_to_launch(mechanism, law) if known else _solved(mechanism, law, launched)
        time = launched(solution)
        if time is None and self.required:
            raise InputError(
                f"{mechanism.name!r} does not launch within {solution.problem.duration:.6g} s, so there is no end to "
                "measure up to; name one, e.g. --until 2.5."
            )
        return solution, time or solution.problem.duration / (1 + _TAIL)


def _solved(
    mechanism: Mechanism, law: StopLaw, event: Callable[[Solution], float | None]
) -> Solution:
    """Solved until the event, and on by the tail."""
    scale = characteristic_time(mechanism)

    def done(solution: Solution) -> bool:
        time = event(solution)
        return time is not None and time * (1 + _TAIL) <= solution.problem.duration

    return solve_until(mechanism, (spans * scale for spans in _SPANS), done, law)
