"""The events of a reference motion as data for MJCF: releases, impacts, rests and the launch, with the states there."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...models.mechanism import Mechanism
from ...models.mjcf.recorded import Keyframe, RecordedMotion, event_names
from ...models.problem import Problem, StopLaw
from ..runs.runner import Runner
from ..runs.until import Until

_PATH = 60  # intervals of the path
_DIGITS = 4  # of the path's coordinates: enough for a picture
_MOST = 100  # events: what bounces to rest has no end of them


def record_motion(given: Mechanism | Problem) -> RecordedMotion:
    """The events of a problem's motion, or of a mechanism's up to its launch or for some characteristic times.

    Those behind the predictability horizon are left out: they would not be certain.

    Raises:
        InputError: the reference cannot begin.
        SimulationError: the reference cannot move it.
    """
    problem = given if isinstance(given, Problem) else None
    mechanism = given.mechanism if isinstance(given, Problem) else given
    until = Until.of(problem.duration if problem else None)
    runner = Runner(mechanism, until=until, law=problem.stop_law if problem else StopLaw.RELEASE_ONCE)
    end = min(runner.end, runner.judged_to)
    events = sorted((t, stop, what) for t, stop, what in _events(runner) if t <= end)[:_MOST]
    names = event_names([(stop, what) for _, stop, what in events])
    at = runner.solution.motion(np.array([t for t, *_ in events]))
    path = runner.solution.motion(np.linspace(0.0, end, _PATH + 1)).q
    return RecordedMotion(
        mechanism_hash=mechanism.content_hash,
        keyframes=tuple(
            Keyframe(name=name, time=event[0], q=tuple(q), u=tuple(u))
            for name, event, q, u in zip(names, events, at.q.tolist(), at.u.tolist(), strict=True)
        ),
        path=tuple(tuple(round(value, _DIGITS) for value in q) for q in path.tolist()),
    )


def _events(runner: Runner) -> Iterator[tuple[float, str, str]]:
    """Times [s], stops and what becomes of them; of the launch, no stop."""
    solution = runner.solution
    yield from ((time, stop, "release") for stop, time in solution.release_times.items() if time is not None)
    struck = ((time, stop, size) for time, impulses in solution.impacts for stop, size in impulses.items())
    yield from ((time, stop, "impact") for time, stop, size in struck if size)
    yield from ((time, stop, "rest") for stop, times in solution.rest_times.items() for time in times)
    if runner.launch_time is not None:
        yield runner.launch_time, "", "launch"
