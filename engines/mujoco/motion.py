"""A run of MuJoCo: its own loop between events, smaller steps to the events of stops.

Under the unilateral law MuJoCo's own limits and contacts would be met as stiff, damped springs,
which give back what the step makes of them. A stop that is open is therefore removed, the instant
at which its gap is zero is found inside the step, the impulses of all contacts that touch there
change the speeds, and those at rest afterwards are put back, preloaded.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, ClassVar

import numpy as np
from mujoco import rollout as untyped

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from ...models.mjcf.writer import mjcf_names, torque_sensor
from ...models.problem import Problem, StopLaw
from ..events import (
    ContactEvents,
    Contacts,
    EventDriver,
    Halt,
    RestitutionRule,
    State,
    SteppedMotion,
    Watch,
    impact_by_rule,
    may_be_met,
    resting,
)
from ..impact import Inertia
from ..protocol import Recording
from .build import (
    controls_of,
    correction_of,
    load,
    preload,
    recorded_actuators,
    slot_contacts,
    start_data,
    stop_constraints,
)
from .compat import CALLBACK, mass_matrix, mujoco
from .options import MujocoOptions
from .read import Samples, absolute_from_relative, recording

rollout: Any = untyped.rollout  # it has no types
"""MuJoCo's own loop over steps."""
STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
_HALVINGS = 45  # of the step in which a release is: to 3e-14 of it


def run(problem: Problem, options: MujocoOptions) -> Recording:
    """Simulate a problem.

    Raises:
        SimulationError: MuJoCo refused the model, or warned that it diverged; or impacts follow
            each other without end.
        UnsupportedProblemError: the mechanism cannot be built, or starts with a closed stop whose
            gap changes where impacts are not resolved.
    """
    impacts = problem.stop_law is StopLaw.UNILATERAL and not options.keep_limits
    motion = MujocoMotion(problem, options, impacts=impacts)
    with raised_warnings():
        return EventDriver(problem, motion, "mujoco", impacts=impacts).run()


@contextmanager
def raised_warnings() -> Generator[None]:
    """Raise SimulationError at the end where MuJoCo has warned.

    At a warning MuJoCo fills the missing states and writes a log file, unless there is a handler;
    there is one for all threads of a process, as there is one callback.
    """
    warnings: list[str] = []
    with CALLBACK:
        before = mujoco.get_mju_user_warning()
        mujoco.set_mju_user_warning(warnings.append)
        try:
            yield
        finally:
            mujoco.set_mju_user_warning(before)
    if warnings:
        # It ends with "... at DOF 0. The simulation is unstable. Time = 0.0800.".
        what = warnings[0].replace(" The simulation is unstable.", "").rstrip(".")
        raise SimulationError(f"MuJoCo gave up: {what}.")


class MujocoMotion(SteppedMotion[FloatArray]):
    """MuJoCo's model of a problem, stepped and recorded; a saved state is MuJoCo's own layout.

    Raises:
        SimulationError: MuJoCo refuses the model.
        UnsupportedProblemError: the mechanism cannot be written as MJCF.
    """

    records_release_at_start: ClassVar[bool] = False
    at_once: ClassVar[int] = 256  # at most these are repeated at an event

    def __init__(self, problem: Problem, options: MujocoOptions, *, impacts: bool) -> None:
        super().__init__(problem, options.timestep, locate=options.locate_releases)
        self.mechanism, self.options = problem.mechanism, options
        self.model = load(self.mechanism, options)
        self.data = start_data(self.model)
        self.constraints = stop_constraints(self.mechanism, self.model)
        self.correction = correction_of(self.mechanism, self.model, options)
        self.sums = absolute_from_relative(self.mechanism, self.model)
        self.records = recorded_actuators(self.mechanism, self.model)
        self.columns: dict[str, int] = {}
        """Each stop's column among the sensors."""
        names = mjcf_names(self.mechanism)
        for stop in self.constraints:
            self.columns[stop] = int(self.model.sensor(names[torque_sensor(stop)]).adr[0])
        self.samples = Samples()
        self._closed = tuple(stop.name for stop in self.mechanism.stops if stop.closed)
        self._as_built = True
        """Whether the closed stops are as the MJCF has them: none was taken out or put back."""
        if not options.keep_limits:
            for name in self.constraints.keys() - set(self._closed):
                self.constraints[name].remove()
        if impacts:  # which need the mass matrix of the start
            with self.correction.applied():
                self.correction.forward(self.data)

    # --- States

    def save(self) -> FloatArray:
        """MuJoCo's state: time, qpos, qvel, ..."""
        state = np.empty(mujoco.mj_stateSize(self.model, STATE))
        mujoco.mj_getState(self.model, self.data, state, STATE)
        return state

    def _restore(self, state: FloatArray) -> None:
        mujoco.mj_setState(self.model, self.data, state, STATE)

    def state(self) -> State:
        """Coordinates and speeds of the mechanism."""
        return self._coordinates(self.save())

    def coordinates(self, states: Sequence[FloatArray]) -> State:
        """Coordinates and speeds of the mechanism in MuJoCo's states, each of shape (n, n_q)."""
        return self._coordinates(np.stack(states))

    def _coordinates(self, states: FloatArray) -> State:
        n = self.model.nv
        q = np.array(self.mechanism.start) + states[..., 1 : 1 + n] @ self.sums.T
        return q, states[..., 1 + n : 1 + 2 * n] @ self.sums.T

    def record(self, time: float) -> None:
        """Add the present state and sensors as the sample at a time [s]."""
        if self.samples.times and self.samples.last_time() == time:
            self.samples.drop_last()
        sensors = self.data.sensordata[None].copy()
        self.samples.add(np.array([time]), self.save()[None], sensors)

    def recording(self, events: ContactEvents) -> Recording:
        """The samples and events as the engines' common record."""
        return recording(self.mechanism, self.model, self.constraints, self.samples, events)

    # --- Steps

    def proceed(self, start: float, end: float, watch: Watch) -> Halt:
        """Move to the next event, the reference accelerations corrected."""
        with self.correction.applied():
            return super().proceed(start, end, watch)

    def _controls(self, t: FloatArray) -> FloatArray | None:
        """Controls of the steps that begin at times (n,) [s], shape (n, nu)."""
        return controls_of(self.records, self.model, t, self.timestep)

    def _set_controls(self) -> None:
        """Let the controls of the present time act."""
        controls = self._controls(np.array([self.data.time]))
        if controls is not None:
            self.data.ctrl[:] = controls[0]

    def _begin_step(self, step: float) -> int:
        """Prepare steps of MuJoCo in place of a time step [s]; their number."""
        substeps = 1 if self.held else self.options.free_substeps
        self.model.opt.timestep = step / substeps
        self.correction.begin_step()
        return substeps

    def step(self, before: FloatArray, step: float) -> None:
        """Take one time step [s] from a state, and find the forces at its end."""
        self._restore(before)
        self._set_controls()
        if step > 0.0:
            self.correction.settle(self.data)
            substeps = self._begin_step(step)
            mujoco.mj_step(self.model, self.data, substeps)
            self.samples.steps += substeps
            self._set_controls()
        self.correction.forward(self.data)

    def ahead(self, first: int, n: int, watch: Watch) -> int:
        """Take n time steps by MuJoCo's own loop, and record those before the first event."""
        before, start = self.save(), self.state()
        substeps = self._begin_step(self.options.timestep)
        controls = self._controls(self.times(np.arange(first, first + n)))
        if controls is not None:
            controls = np.repeat(controls, substeps, axis=0)[None]
        rolled, sensed = rollout(self.model, self.data, before[None], controls, nstep=n * substeps)
        self.samples.steps += n * substeps
        # Its sensors are those before each step, and the data are left at the last stage of RK4.
        self._restore(rolled[0, -1])
        self._set_controls()
        self.correction.forward(self.data)
        after = np.concatenate([sensed[0, 1:], self.data.sensordata[None]])
        # States and sensors after each time step, of shapes (n, n_state) and (n, n_sensor).
        states, sensors = rolled[0, substeps - 1 :: substeps], after[substeps - 1 :: substeps]

        event = (sensors[:, [self.columns[name] for name in self.held]] == 0).any(axis=1)
        coordinates = self._coordinates(np.concatenate([before[None], states]))
        for name in watch.open:
            gap, speed = self.gaps(name, coordinates)
            event |= may_be_met(gap, speed, watch.least_speed(name, *start), self.timestep)
        clear = int(np.argmax(event)) if event.any() else n
        times = self.times(np.arange(first + 1, first + clear + 1))
        self.samples.add(times, states[:clear], sensors[:clear])
        if clear < n:
            self._restore(states[clear - 1] if clear else before)
        return clear

    # --- Releases

    def pulling(self) -> Contacts:
        """Stops that were held and now carry no torque."""
        sensed = self.data.sensordata
        return tuple(name for name in self.held if sensed[self.columns[name]] == 0)

    def opening(self, before: FloatArray, step: float, pulling: Contacts) -> tuple[float, Contacts]:
        """Go to the shortest part of a step [s] after which stops carry no torque, by bisection.

        Limits and contacts only push: their forces have no change of sign that could be a root.
        """
        low, high = 0.0, step
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            self.step(before, middle)
            if pulling_at_middle := self.pulling():
                high, pulling = middle, pulling_at_middle
            else:
                low = middle
        # The solver's warm start makes the last bit of a torque depend on the steps before: a stop
        # that was found inactive above may carry a last bit of torque here, and is released all the
        # same.
        self.step(before, high)
        return high, pulling

    def let_go(self, names: Contacts) -> None:
        """Take stops out of the model, unless limits are to stay."""
        if not self.options.keep_limits:
            for name in names:
                self.constraints[name].remove()
        self.correction.forward(self.data)

    def hold(self, rest: Contacts, time: float) -> Contacts:
        """Put back the stops at rest, let go those that do not push, and preload the others."""
        if not (self._as_built and rest == self._closed):
            for name, constraint in self.constraints.items():
                if name not in rest:
                    constraint.remove()
            for name in rest:
                self.constraints[name].restore()
                self.constraints[name].activate(self.data, self.correction)
        self._as_built, self.held = False, rest
        with self.correction.applied():
            self.correction.forward(self.data)
            while pulling := self.pulling():
                self.held = tuple(name for name in self.held if name not in pulling)
                self.let_go(pulling)
        if self.options.preload:
            held = [self.constraints[name] for name in self.held]
            slots = slot_contacts(self.mechanism, self.model)
            preload(self.data, held + slots, self.correction)
        self.record(time)
        return self.held

    # --- Impacts

    def impact(
        self, touching: Contacts, rule: RestitutionRule, kept: frozenset[str]
    ) -> tuple[Mapping[str, float], Contacts]:
        """Change the speeds by the impact of all contacts that touch, through the mass matrix."""
        q, _ = self.state()
        gaps = {name: self.kinematics.gap_jacobian(name, q) @ self.sums for name in touching}
        loops = self.kinematics.loop_jacobian(q) @ self.sums
        inertia = Inertia(mass_matrix(self.model, self.data), loops)
        # Loops and contacts are springs: a drift of 1e-11 m that was in balance with its rate
        # before the impact is a force of 1e-3 N after it, which takes some steps to settle.
        drift = np.append(
            self.kinematics.loop_residual(q), [self.kinematics.gap(name, q) for name in touching]
        )
        rows = np.reshape(list(gaps.values()), (-1, self.model.nv))
        self.data.qpos[:] += inertia.move_onto(rows, drift)
        impact = impact_by_rule(
            inertia,
            self.data.qvel,
            gaps,
            self.held,
            lambda closing, speeds: rule(closing, q, self.sums @ speeds),
            "mujoco",
        )
        self.data.qvel[:] = impact.speeds
        return impact.impulses, resting(impact.left)
