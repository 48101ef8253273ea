"""Engines run on one mechanism: for how long, where, beside which reference motion, and what a failure becomes."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache

import numpy as np

from ...engines.protocol import Engine
from ...models.arrays import FloatArray
from ...models.errors import EngineNotInstalledError, InputError, TrebucheckError, UnsupportedProblemError
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from ...reference.solver import solve, solve_to_launch
from .results import Outcome
from .worker import Worker

TAIL_STEPS, TAIL = 20, 0.02  # an engine runs on past the end of what is compared, so that its launch can be found
_REFERENCE_TAIL = 1.0  # [s] and the reference further still
# Time grids on which the reference is kept: runs of one step and engine share theirs. The longest takes some 10 MB;
# longer ones belong to runs beside which the reference is cheap.
_GRIDS, _LONGEST_GRID = 3, 30_000


def run_duration(end: float, step: float) -> float:
    """How long an engine runs [s] if its motion is compared up to `end` [s] and its time step is `step` [s]."""
    return end + max(TAIL, TAIL_STEPS * step)


def failure(error: Exception) -> tuple[Outcome, str]:
    """The outcome and message of a run that raised: a plug-in may raise anything, and a study must survive it."""
    if not isinstance(error, TrebucheckError):
        return Outcome.FAILED, f"{type(error).__name__}: {error}"
    if isinstance(error, EngineNotInstalledError):
        return Outcome.ABSENT, str(error)
    return Outcome.UNSUPPORTED if isinstance(error, UnsupportedProblemError) else Outcome.FAILED, str(error)


class Runner:
    """Runs engines on one mechanism and evaluates its reference motion at their times.

    Args:
        mechanism: compared up to its launch, or to `duration`.
        worker: the process in which engines run; None: this one. Its owner closes it.
        duration: end of the compared motion [s]; None: the launch.
        law: of the stops.

    Raises:
        InputError: the duration is not valid.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        worker: Worker | None = None,
        duration: float | None = None,
        law: StopLaw = StopLaw.RELEASE_ONCE,
    ) -> None:
        self.mechanism, self.worker, self.law = mechanism, worker or Worker(isolate=False), law
        self._duration = None if duration is None else Problem(mechanism, duration=duration, stop_law=law).duration
        self._on_grid: Callable[[bytes], Trajectory] = lru_cache(_GRIDS)(self._evaluated)

    @cached_property
    def solution(self) -> Solution:
        """The reference motion, somewhat longer than the compared one.

        Raises:
            TrebucheckError: the reference cannot move the mechanism.
        """
        if self._duration is None:
            return solve_to_launch(self.mechanism, self.law)
        return solve(Problem(self.mechanism, duration=self._duration + _REFERENCE_TAIL, stop_law=self.law))

    @cached_property
    def end(self) -> float:
        """End of the compared motion [s]: the duration, or else the launch, or else the solution's own end."""
        if self._duration is not None:
            return self._duration
        launch = self.solution.launch
        return launch.time if launch else self.solution.problem.duration

    def refuse_no_launch(self) -> None:
        """Require a launch.

        Raises:
            InputError: the reference does not launch.
        """
        if self.solution.launch is None:
            raise InputError(f"{self.mechanism.name!r} does not launch, so there is no end to measure up to.")

    def problem(self, engine: Engine, given: Mechanism | None = None) -> Problem:
        """What an engine is to simulate.

        Args:
            given: a mechanism instead of the runner's.
        """
        duration = min(run_duration(self.end, engine.timestep or 0.0), self.solution.problem.duration)
        return Problem(given or self.mechanism, duration=duration, stop_law=self.law)

    def simulate(self, engine: Engine, given: Mechanism | None = None) -> Trajectory:
        """Run an engine, after a short run whose time is not counted.

        Raises:
            Exception: whatever the engine raises; :func:`failure` makes a row of it.
        """
        return self.worker.simulate(engine, self.problem(engine, given))

    def reference(self, t: FloatArray) -> Trajectory:
        """The reference at these times [s], shape (n,); evaluated once for each of the last few time grids."""
        return self.solution.trajectory(t) if len(t) > _LONGEST_GRID else self._on_grid(t.tobytes())

    def _evaluated(self, times: bytes) -> Trajectory:
        return self.solution.trajectory(np.frombuffer(times))
