"""Stepping: MuJoCo's own loop between releases, a bisection on the step where one is."""

from __future__ import annotations

import importlib
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from ...models.mjcf.writer import torque_sensor
from ...models.problem import Problem, StopLaw
from ..protocol import Recording
from .build import bias_of, load, mujoco, preload, start_data
from .constraints import rails, stop_holds
from .options import MujocoOptions
from .read import Samples, recording

_rollout: Any = importlib.import_module("mujoco.rollout")

_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
_CHUNK = 256  # steps between looks at the torques; at most these are run in vain at a release
_HALVINGS = 45  # of the step in which a release is: to 3e-14 of it
_ROUNDING = 1e-15  # times closer than this (relatively) are one time


def run(problem: Problem, options: MujocoOptions) -> Recording:
    """Simulate a problem.

    Raises:
        SimulationError: MuJoCo refused the model, or warned that it diverged.
        UnsupportedProblemError: the mechanism cannot be built, or starts with an impact.
    """
    stepper = _Stepper(problem, options)
    with _warnings_raised():
        stepper.begin()
        with stepper.bias.applied():
            stepper.proceed()
    return recording(problem.mechanism, stepper.model, stepper.holds, stepper.samples)


@contextmanager
def _warnings_raised() -> Generator[None]:
    """Turn MuJoCo's warnings into an error; left alone it fills the states that are missing and writes a log file."""
    messages: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(messages.append)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
    if messages:
        raise SimulationError(f"MuJoCo gave up: {messages[0]}")


class _Stepper:
    """The model on its way through a problem."""

    def __init__(self, problem: Problem, options: MujocoOptions) -> None:
        self.problem, self.options = problem, options
        self.model = load(problem.mechanism, options)
        self.data = start_data(self.model)
        self.holds = stop_holds(problem.mechanism, self.model)
        self.bias = bias_of(problem.mechanism, self.model, options)
        self.columns = {name: int(self.model.sensor(torque_sensor(name)).adr[0]) for name in self.holds}
        self.holding = [stop.name for stop in problem.mechanism.stops if stop.closed]
        self.removes = problem.stop_law is StopLaw.RELEASE_ONCE and not options.keep_limits
        self.samples = Samples(dict.fromkeys(self.holds))
        self.size = mujoco.mj_stateSize(self.model, _STATE)

    def begin(self) -> None:
        """Decide which stops push, and record the start."""
        if self.removes:
            for name in self.holds.keys() - set(self.holding):
                self.holds[name].remove(self.model)
        with self.bias.applied():
            self._forward()
            self._release(self._slack(), 0.0)
        if self.options.preload:
            closed = [self.holds[name] for name in self.holding] + rails(self.problem.mechanism, self.model)
            preload(self.model, self.data, closed, self.bias)
        self._record(0.0)

    def proceed(self) -> None:
        """Step to the end of the problem."""
        duration, n = self.problem.duration, self._whole_steps()
        k = 0
        while k < n:
            k = self._run_on(k, min(_CHUNK, n - k))
        if self._times(n) < duration:
            self._cross(float(self._times(n)), duration)

    def _whole_steps(self) -> int:
        """How many time steps the problem has room for, but for rounding."""
        steps = self.problem.duration / self.options.timestep
        return round(steps) if abs(steps - round(steps)) < _ROUNDING * steps else int(steps)

    def _times(self, k: Any) -> FloatArray:
        """Times after k time steps [s]; the last is the problem's end, not a rounding beside it."""
        times = self.options.timestep * np.asarray(k)
        duration = self.problem.duration
        return np.where(np.abs(times - duration) < _ROUNDING * duration, duration, times)

    def _pieces(self) -> int:
        """Steps of MuJoCo to a time step, now."""
        return 1 if self.holding else self.options.free_substeps

    def _run_on(self, k: int, n: int) -> int:
        """Take n time steps from step k, or up to and including the first with a release; the step reached."""
        before = self._state()
        states, sensed = self._rolled(before, n)
        clear = self._steps_before_a_release(sensed)
        self.samples.add(self._times(np.arange(k + 1, k + clear + 1)), states[:clear], sensed[:clear])
        if clear == n:
            return k + n
        self._restore(states[clear - 1] if clear else before)
        self._cross(*map(float, self._times([k + clear, k + clear + 1])))
        return k + clear + 1

    def _rolled(self, before: FloatArray, n: int) -> tuple[FloatArray, FloatArray]:
        """States and sensors after each of n time steps, by MuJoCo's loop; shapes (n, n_state), (n, n_sensor)."""
        pieces = self._pieces()
        self.model.opt.timestep = self.options.timestep / pieces
        self.bias.restart()
        states, sensed = _rollout.rollout(self.model, self.data, before[None], nstep=n * pieces)
        self.samples.steps += n * pieces
        # Its sensors are those before each step, and the data are left at the last stage of RK4.
        self._restore(states[0, -1])
        self._forward()
        after = np.concatenate([sensed[0, 1:], self.data.sensordata[None]])
        return states[0, pieces - 1 :: pieces], after[pieces - 1 :: pieces]

    def _steps_before_a_release(self, sensed: FloatArray) -> int:
        columns = [self.columns[name] for name in self.holding]
        slack = (sensed[:, columns] == 0).any(axis=1)
        return int(np.argmax(slack)) if slack.any() else len(sensed)

    def _cross(self, start: float, end: float) -> None:
        """Go from one time to another [s], halting at every release between them."""
        while start < end:
            before, reached = self._state(), end
            self._step_on(before, end - start)
            slack = self._slack()
            if slack and self.options.locate_releases:
                part, slack = self._locate(before, end - start, slack)
                reached = start + part
                # What is left to the end, or was done since the start, may be no more than rounding.
                reached = end if end - reached < _ROUNDING * end else reached
            self._release(slack, reached)
            if reached - start > _ROUNDING * end:
                self._record(reached)
            start = reached

    def _locate(self, before: FloatArray, step: float, slack: list[str]) -> tuple[float, list[str]]:
        """The shortest part of a step [s] after which stops carry no torque, and these; the data are left there."""
        low, high = 0.0, step
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            self._step_on(before, middle)
            found = self._slack()
            low, high, slack = (low, middle, found) if found else (middle, high, slack)
        # The solver's warm start makes the last bit of a torque depend on what was done before: a stop found
        # slack above may come out a trifle taut here, and is released all the same.
        self._step_on(before, high)
        return high, slack

    def _step_on(self, before: FloatArray, step: float) -> None:
        """Go on from a state by a time step [s], and find the forces at its end."""
        pieces = self._pieces()
        self._restore(before)
        self.model.opt.timestep = step / pieces
        self.bias.restart()
        mujoco.mj_step(self.model, self.data, pieces)
        self._forward()
        self.samples.steps += pieces

    def _forward(self) -> None:
        """Find the forces of the state as it stands."""
        self.bias.restart()
        mujoco.mj_forward(self.model, self.data)

    def _slack(self) -> list[str]:
        """Stops that were holding and now carry no torque."""
        return [name for name in self.holding if self.data.sensordata[self.columns[name]] == 0]

    def _release(self, slack: list[str], t: float) -> None:
        """Release stops, and those that turn slack once these are gone."""
        while slack:
            for name in slack:
                self.samples.releases[name] = t
                self.holding.remove(name)
                if self.removes:
                    self.holds[name].remove(self.model)
            self._forward()
            slack = self._slack()

    def _state(self) -> FloatArray:
        state = np.empty(self.size)
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        return state

    def _restore(self, state: FloatArray) -> None:
        mujoco.mj_setState(self.model, self.data, state, _STATE)

    def _record(self, t: float) -> None:
        self.samples.add(np.array([t]), self._state()[None], self.data.sensordata[None].copy())
