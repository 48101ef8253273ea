"""Events of a motion by solver: releases, impacts and the launch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

from ..trajectory import Trajectory

_MOST_IMPACTS = 12
"""Of each stop; a bouncing body has any number of them."""


@dataclass(frozen=True)
class Event:
    """What happens once in a motion, and when in each solver's."""

    kind: Literal["release", "impact", "launch"]
    name: str
    """In words."""
    time: float
    """In the reference, or in the first run that has it [s]."""
    reference: float | None
    """[s]; None: it does not happen there."""
    runs: Mapping[str, float | None]
    """[s], by run."""
    stop: str = ""


def events_of(
    reference: Trajectory,
    runs: Mapping[str, Trajectory],
    end: float,
    thrown: str | None = None,
    launch: float | None = None,
) -> tuple[Event, ...]:
    """All events up to the end of the compared motion [s], in their order.

    Args:
        thrown: marker whose launch is one; None: none is thrown.
        launch: the reference's [s]; found on the trajectory's samples where left out.
    """
    found = [*_releases(reference, runs), *_impacts(reference, runs)]
    if thrown is not None:
        own = launch if launch is not None else _launch(reference, thrown)
        found.append(
            (
                "launch",
                "launch",
                "",
                own,
                {name: _launch(run, thrown) for name, run in runs.items()},
            )
        )
    events: list[Event] = []
    for kind, name, stop, own, others in found:
        first, *rest = (
            time if time is not None and time <= end else None for time in (own, *others.values())
        )
        times = [time for time in (first, *rest) if time is not None]
        if times:
            events.append(
                Event(kind, name, times[0], first, dict(zip(others, rest, strict=True)), stop)
            )
    return tuple(sorted(events, key=lambda event: event.time))


_Found = tuple[
    Literal["release", "impact", "launch"], str, str, float | None, dict[str, float | None]
]
"""Kind, name, stop, and times in the reference and the runs."""


def _releases(reference: Trajectory, runs: Mapping[str, Trajectory]) -> Iterator[_Found]:
    for stop in reference.release_times:
        times = {name: run.release_times.get(stop) for name, run in runs.items()}
        yield "release", f"{stop} opens", stop, reference.release_times[stop], times


def _impacts(reference: Trajectory, runs: Mapping[str, Trajectory]) -> Iterator[_Found]:
    for stop in reference.mechanism.stops:
        own = _of_stop(reference, stop.name)
        theirs = {name: _of_stop(run, stop.name) for name, run in runs.items()}
        count = min(max(map(len, (own, *theirs.values()))), _MOST_IMPACTS)
        for k in range(count):
            times = {name: times[k] if k < len(times) else None for name, times in theirs.items()}
            name = f"{stop.name} is hit" + (f" ({k + 1})" if count > 1 else "")
            yield "impact", name, stop.name, own[k] if k < len(own) else None, times


def _of_stop(trajectory: Trajectory, stop: str) -> list[float]:
    return [time for time, impulses in trajectory.impacts if impulses.get(stop, 0.0) > 0]


def _launch(trajectory: Trajectory, marker: str) -> float | None:
    launch = trajectory.launch(marker=marker) if marker in trajectory.markers else None
    return None if launch is None else launch.time
