"""Engines run on one mechanism: for how long, where, beside which reference motion, and what a failure becomes.

The reference runs where the engines do, under the same limit of time: in a process of its own if
they are isolated.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache, partial
from threading import RLock
from typing import Any, Generic, TypeVar

import numpy as np

from ...engines.protocol import Engine
from ...models.arrays import FloatArray
from ...models.errors import (
    EngineNotInstalledError,
    SimulationError,
    TrebucheckError,
    UnsupportedProblemError,
    shortened,
)
from ...models.launch import LAUNCH_ANGLE
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.trajectory import Trajectory
from ...reference.certification.certificate import Uncertainties
from ...reference.solution import Solution
from .metrics import measure
from .results import Metric, Outcome, Predictability
from .scales import Scales, scales_until
from .stretching import Stretching, stretching_until
from .uncertainty import reference_uncertainties
from .until import Until
from .validity import refuse_invalid
from .worker import Worker

_Result = TypeVar("_Result")

_TAIL_STEPS, _TAIL = (
    20,
    0.02,
)  # an engine runs on past the end of what is compared, so that its launch can be found
# Time grids on which the reference is kept: runs of one step and engine share theirs. The longest
# takes some 10 MB; longer ones belong to runs beside which the reference is cheap.
_GRIDS, _LONGEST_GRID = 3, 30_000


def run_duration(end: float, step: float, longest: float = math.inf) -> float:
    """How long an engine runs [s] if its motion is compared up to `end` [s] and its time step is `step` [s].

    Args:
        longest: that the reference goes on to [s]; an engine of whole steps may need one more than
            it is asked for.
    """
    return min(end + max(_TAIL, _TAIL_STEPS * step), max(longest - step, end))


def failure(error: Exception) -> tuple[Outcome, str]:
    """The outcome and message of a run that raised: a plug-in may raise anything, and a study must survive it."""
    if not isinstance(error, TrebucheckError):
        return Outcome.FAILED, shortened(f"{type(error).__name__}: {error}")
    if isinstance(error, EngineNotInstalledError):
        return Outcome.ABSENT, str(error)
    return Outcome.UNSUPPORTED if isinstance(
        error, UnsupportedProblemError
    ) else Outcome.FAILED, str(error)


class _once(Generic[_Result]):  # noqa: N801 - used as a decorator, like the property it stands for
    """A property computed once, whichever thread asks first; others wait, but not for those of other runners.

    (functools.cached_property computes it once a thread, and in Python 3.11 one object at a time.)
    """

    def __init__(self, compute: Callable[[Any], _Result]) -> None:
        self._compute, self.__doc__ = compute, compute.__doc__

    def __get__(self, runner: Runner | None, owner: type[Runner]) -> _Result:
        if runner is None:
            return self  # type: ignore[return-value] - documentation asks the class
        name = self._compute.__name__
        with runner.lock:
            if name not in runner.__dict__:
                runner.__dict__[name] = self._compute(
                    runner
                )  # is found there before this is asked again
            return runner.__dict__[name]


class Runner:
    """Runs engines on one mechanism and evaluates its reference motion at their times.

    Args:
        mechanism: compared up to its launch, or as `until` says.
        worker: the process in which engines run; None: this one. Its owner closes it.
        until: end of the compared motion.
        law: of the stops.

    Raises:
        InputError: the end is not valid.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        worker: Worker | None = None,
        until: Until | None = None,
        law: StopLaw = StopLaw.RELEASE_ONCE,
    ) -> None:
        self.mechanism, self.worker, self.law = mechanism, worker or Worker(isolate=False), law
        self.until, self.lock = until or Until(required=False), RLock()
        self._on_grid: Callable[[bytes], Trajectory] = lru_cache(_GRIDS)(self._evaluated)

    @_once
    def _solved(self) -> tuple[Solution, float]:
        return self.worker.compute(partial(self.until.solve, self.mechanism, self.law))

    @property
    def solution(self) -> Solution:
        """The reference motion, somewhat longer than the compared one.

        Raises:
            InputError: the reference cannot begin, or the end does not come.
            SimulationError: it failed, or did not come to an end.
        """
        return self._solved[0]

    @property
    def end(self) -> float:
        """End of the compared motion [s]: as asked for, or the launch, or after some characteristic times."""
        return self._solved[1]

    @property
    def launch_time(self) -> float | None:
        """Of the reference, by the end of the compared motion [s]."""
        launch = self.solution.launch_at(LAUNCH_ANGLE, self.until.thrown)
        return launch.time if launch and launch.time <= self.end else None

    @_once
    def uncertainties(self) -> Uncertainties:
        """Of the reference, up to the end of the compared motion.

        Raises:
            SimulationError: as for :attr:`solution`.
        """
        given = (
            self.solution,
            self.judged_to,
            self.scales,
            self.until.thrown,
            self.end,
            self._stretching,
        )
        return self.worker.compute(partial(reference_uncertainties, *given))

    @_once
    def _stretching(self) -> Stretching:
        return self.worker.compute(
            partial(stretching_until, self.solution, self.end, self._scales_to_end)
        )

    @_once
    def judged_to(self) -> float:
        """The end, or the predictability horizon if that is earlier [s]."""
        return self._stretching.horizon

    @property
    def stretching(self) -> float:
        """Of the motion up to there, by parameters."""
        return float(self._stretching.parameters[self._stretching.before(self.judged_to)])

    @property
    def predictability(self) -> Predictability:
        """Stretching at each quarter of the compared time."""
        found, times = self._stretching, [part * self.end for part in (0.25, 0.5, 0.75, 1.0)]
        at = [found.before(time) for time in times]
        parameters, start = (
            tuple(float(v) if np.isfinite(v) else None for v in each[at])
            for each in (found.parameters, found.start)
        )
        return Predictability(times=tuple(times), parameters=parameters, start=start)

    @_once
    def _scales_to_end(self) -> Scales:
        return scales_until(self.solution, self.end)

    @_once
    def scales(self) -> Scales:
        """Of the motion up to there."""
        same = self.judged_to == self.end
        return self._scales_to_end if same else scales_until(self.solution, self.judged_to)

    @_once
    def whole_scales(self) -> Scales | None:
        """Of the motion to its end; None where that is the same."""
        return None if self.judged_to == self.end else self._scales_to_end

    def measured(self, trajectory: Trajectory) -> tuple[Metric, ...]:
        """Every metric of an engine's run, up to the predictability horizon; invariants up to the end."""
        return measure(
            trajectory, self.solution, self.judged_to, self.reference(trajectory.t),
            scales=self.scales, thrown=self.until.thrown, invariants_to=self.end, stretching=self._stretching,
        )  # fmt: skip

    def problem(self, engine: Engine, given: Mechanism | None = None) -> Problem:
        """What an engine is to simulate.

        Args:
            given: a mechanism instead of the runner's.
        """
        duration = run_duration(self.end, engine.timestep or 0.0, self.solution.problem.duration)
        return Problem(given or self.mechanism, duration=duration, stop_law=self.law)

    def simulate(self, engine: Engine, given: Mechanism | None = None) -> Trajectory:
        """Run an engine, after a short run whose time is not counted.

        Raises:
            Exception: whatever the engine raises; :func:`failure` makes a row of it.
            SimulationError: what it gave is no valid trajectory.
        """
        problem, longest = self.problem(engine, given), self.solution.problem.duration
        trajectory = self.worker.simulate(engine, problem)
        valid = refuse_invalid(
            engine.name, trajectory, given or self.mechanism, engine.capabilities
        )
        if valid.t[-1] > longest:
            to = f"it goes on to {valid.t[-1]:.6g} s, and {problem.duration:.6g} s was asked for"
            raise SimulationError(f"{engine.name} gave an invalid trajectory: {to}.")
        return valid

    def reference(self, t: FloatArray) -> Trajectory:
        """The reference at these times [s], shape (n,); evaluated once for each of the last few time grids."""
        return self.solution.trajectory(t) if len(t) > _LONGEST_GRID else self._on_grid(t.tobytes())

    def _evaluated(self, times: bytes) -> Trajectory:
        return self.solution.trajectory(np.frombuffer(times))
