"""Stepping: MuJoCo's own loop between events, a bisection of the step in which a stop releases."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.mjcf.writer import mjcf_names, torque_sensor
from ...models.problem import Problem
from ..events import ContactEvents
from ..protocol import Recording
from .build import correction_of, load, preload, start_data
from .constraints import slot_contacts, stop_constraints
from .options import MujocoOptions
from .read import Samples, recording
from .reference_acceleration import mujoco

_rollout: Any = importlib.import_module("mujoco.rollout")

_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
_CHUNK = 256  # steps between checks of the torques; at most these are repeated at a release
_HALVINGS = 45  # of the step in which a release is: to 3e-14 of it
ROUNDING = 1e-15  # times closer than this (relatively) are one time


class Stepper:
    """Steps the model through a problem and records it; a stop that has released stays as it is.

    Raises:
        SimulationError: MuJoCo refuses the model.
        UnsupportedProblemError: the mechanism cannot be written as MJCF.
    """

    def __init__(self, problem: Problem, options: MujocoOptions) -> None:
        self.problem, self.options = problem, options
        self.model = load(problem.mechanism, options)
        self.data = start_data(self.model)
        self.constraints = stop_constraints(problem.mechanism, self.model)
        self.correction = correction_of(problem.mechanism, self.model, options)
        sensors = {
            name: mjcf_names(problem.mechanism)[torque_sensor(name)] for name in self.constraints
        }
        self.columns = {
            name: int(self.model.sensor(sensor).adr[0]) for name, sensor in sensors.items()
        }
        self.active = [stop.name for stop in problem.mechanism.stops if stop.closed]
        self.events = ContactEvents(problem.mechanism, "mujoco")
        self.samples = Samples()
        self.size = mujoco.mj_stateSize(self.model, _STATE)

    def recording(self) -> Recording:
        """What was recorded of the motion."""
        return recording(
            self.problem.mechanism, self.model, self.constraints, self.samples, self.events
        )

    def begin(self) -> None:
        """Find which stops push, and record the start."""
        if not self.options.keep_limits:
            for name in self.constraints.keys() - set(self.active):
                self.constraints[name].remove(self.model)
        self._start()
        self._record(0.0)

    def _start(self) -> None:
        self._release_those_that_pull(0.0)

    def _release_those_that_pull(self, t: float) -> None:
        """Of the active stops, release those that do not push at a time [s], and preload the others."""
        with self.correction.applied():
            self.correction.forward(self.data)
            self._release(self._inactive(), t)
        if self.options.preload:
            active = [self.constraints[name] for name in self.active]
            preload(
                self.model,
                self.data,
                active + slot_contacts(self.problem.mechanism, self.model),
                self.correction,
            )

    def integrate(self) -> None:
        """Step to the end of the problem."""
        duration, n = self.problem.duration, self._whole_steps()
        k = 0
        while k < n:
            k = self._advance(k, min(_CHUNK, n - k))
        if self._times(n) < duration:
            self._step_through_events(float(self._times(n)), duration)

    def _whole_steps(self) -> int:
        """Number of whole time steps in the problem's duration, but for rounding."""
        steps = self.problem.duration / self.options.timestep
        return round(steps) if abs(steps - round(steps)) < ROUNDING * steps else int(steps)

    def _times(self, k: Any) -> FloatArray:
        """Times after k time steps [s]; the last one is exactly the problem's end."""
        times = self.options.timestep * np.asarray(k)
        duration = self.problem.duration
        return np.where(np.abs(times - duration) < ROUNDING * duration, duration, times)

    def _substeps(self) -> int:
        """Steps of MuJoCo per time step, now."""
        return 1 if self.active else self.options.free_substeps

    def _advance(self, k: int, n: int) -> int:
        """Take n time steps from step k, or up to and including the first with an event; return the step reached."""
        before = self._state()
        states, sensed = self._rolled_out(before, n)
        clear = self._steps_before_an_event(np.concatenate([before[None], states]), sensed)
        self.samples.add(
            self._times(np.arange(k + 1, k + clear + 1)), states[:clear], sensed[:clear]
        )
        if clear == n:
            return k + n
        self._restore(states[clear - 1] if clear else before)
        self._step_through_events(*map(float, self._times([k + clear, k + clear + 1])))
        return k + clear + 1

    def _rolled_out(self, before: FloatArray, n: int) -> tuple[FloatArray, FloatArray]:
        """States and sensors after each of n time steps, by MuJoCo's loop; shapes (n, n_state), (n, n_sensor)."""
        substeps = self._substeps()
        self.model.opt.timestep = self.options.timestep / substeps
        self.correction.begin_step()
        states, sensed = _rollout.rollout(self.model, self.data, before[None], nstep=n * substeps)
        self.samples.steps += n * substeps
        # Its sensors are those before each step, and the data are left at the last stage of RK4.
        self._restore(states[0, -1])
        self.correction.forward(self.data)
        after = np.concatenate([sensed[0, 1:], self.data.sensordata[None]])
        return states[0, substeps - 1 :: substeps], after[substeps - 1 :: substeps]

    def _steps_before_an_event(self, states: FloatArray, sensed: FloatArray) -> int:
        """Of n time steps, the number before the first with an event; shapes (n + 1, n_state), (n, n_sensor)."""
        columns = [self.columns[name] for name in self.active]
        inactive = (sensed[:, columns] == 0).any(axis=1)
        return int(np.argmax(inactive)) if inactive.any() else len(sensed)

    def _step_through_events(self, start: float, end: float) -> None:
        """Step from one time to another [s], halting at every event between them."""
        while start < end:
            start = self._step_to_event(start, end)

    def _step_to_event(self, start: float, end: float) -> float:
        """Step to the next event, or from one time to another [s]; return the time reached."""
        before = self._state()
        self._step(before, end - start)
        return self._after_release(before, start, end)

    def _after_release(self, before: FloatArray, start: float, end: float) -> float:
        """Halt at the first release in the step just taken from a state, if there is one; return the time reached."""
        inactive, reached = self._inactive(), end
        if inactive and self.options.locate_releases:
            part, inactive = self._locate(before, end - start, inactive)
            # What remains to the end, or was stepped since the start, may be no more than rounding.
            reached = end if end - (start + part) < ROUNDING * end else start + part
        self._release(inactive, reached)
        if reached - start > ROUNDING * end:
            self._record(reached)
        return reached

    def _locate(
        self, before: FloatArray, step: float, inactive: list[str]
    ) -> tuple[float, list[str]]:
        """The shortest part of a step [s] after which stops carry no torque, and these; the data are left there."""
        low, high = 0.0, step
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            self._step(before, middle)
            inactive_at_middle = self._inactive()
            low, high, inactive = (
                (low, middle, inactive_at_middle)
                if inactive_at_middle
                else (middle, high, inactive)
            )
        # The solver's warm start makes the last bit of a torque depend on the steps before: a stop
        # that was found inactive above may carry a last bit of torque here, and is released all the
        # same.
        self._step(before, high)
        return high, inactive

    def _step(self, before: FloatArray, step: float) -> None:
        """Take one time step [s] from a state, and find the forces at its end."""
        substeps = self._substeps()
        self._restore(before)
        self.correction.settle(self.data)
        self.model.opt.timestep = step / substeps
        self.correction.begin_step()
        mujoco.mj_step(self.model, self.data, substeps)
        self.correction.forward(self.data)
        self.samples.steps += substeps

    def _inactive(self) -> list[str]:
        """Stops that were active and now carry no torque."""
        return [name for name in self.active if self.data.sensordata[self.columns[name]] == 0]

    def _release(self, inactive: list[str], t: float) -> None:
        """Release stops, and those that become inactive by their release."""
        while inactive:
            self.events.release(inactive, t)
            for name in inactive:
                self.active.remove(name)
                if not self.options.keep_limits:
                    self.constraints[name].remove(self.model)
            self.correction.forward(self.data)
            inactive = self._inactive()

    def _state(self) -> FloatArray:
        state = np.empty(self.size)
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        return state

    def _restore(self, state: FloatArray) -> None:
        mujoco.mj_setState(self.model, self.data, state, _STATE)

    def _record(self, t: float) -> None:
        self.samples.add(np.array([t]), self._state()[None], self.data.sensordata[None].copy())
