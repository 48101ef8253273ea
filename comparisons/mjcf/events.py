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
LONGEST_STEP = 1e-3  # [s] of MuJoCo, where none is asked for; the named machines have it
_STEP = 0.01  # of the characteristic time
_MOST = 100  # events: what bounces to rest has no end of them


def record_motion(given: Mechanism | Problem) -> RecordedMotion:
    """The events of a problem's motion, or of a mechanism's up to its launch or for some characteristic times.

    Those behind the predictability horizon are left out: they would not be certain.

    Raises:
        InputError: the reference cannot begin.
        SimulationError: the reference cannot move it.
    """
    return recorded(motion_of(given))


def motion_of(given: Mechanism | Problem) -> Runner:
    """That motion.

    Raises:
        InputError: the reference cannot begin.
    """
    problem = given if isinstance(given, Problem) else None
    mechanism = given.mechanism if isinstance(given, Problem) else given
    until = Until.of(problem.duration if problem else None)
    return Runner(mechanism, until=until, law=problem.stop_law if problem else StopLaw.RELEASE_ONCE)


def suitable_step(runner: Runner) -> float:
    """A hundredth of a motion's characteristic time [s], with two digits; 1 ms at most.

    Raises:
        SimulationError: the reference cannot move it.
    """
    return min(LONGEST_STEP, float(f"{_STEP * runner.scales.time:.1e}"))


def recorded(runner: Runner) -> RecordedMotion:
    """Its events, as :func:`record_motion`.

    Raises:
        SimulationError: the reference cannot move it.
    """
    end = min(runner.end, runner.judged_to)
    events = sorted((t, stop, what) for t, stop, what in _events(runner) if t <= end)[:_MOST]
    names = event_names([(stop, what) for _, stop, what in events])
    at = runner.solution.motion(np.array([t for t, *_ in events]))
    path = runner.solution.motion(np.linspace(0.0, end, _PATH + 1)).q
    return RecordedMotion(
        mechanism_hash=runner.mechanism.content_hash,
        keyframes=tuple(
            Keyframe(name=name, time=event[0], q=tuple(q), u=tuple(u))
            for name, event, q, u in zip(names, events, at.q.tolist(), at.u.tolist(), strict=True)
        ),
        path=tuple(tuple(round(value, _DIGITS) for value in q) for q in path.tolist()),
    )


def _events(runner: Runner) -> Iterator[tuple[float, str, str]]:
    """Times [s], stops and what becomes of them; of the launch, no stop."""
    solution = runner.solution
    yield from (
        (time, stop, "release") for stop, time in solution.release_times.items() if time is not None
    )
    struck = (
        (time, stop, size) for time, impulses in solution.impacts for stop, size in impulses.items()
    )
    yield from ((time, stop, "impact") for time, stop, size in struck if size)
    yield from (
        (time, stop, "rest") for stop, times in solution.rest_times.items() for time in times
    )
    if runner.launch_time is not None:
        yield runner.launch_time, "", "launch"
