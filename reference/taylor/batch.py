"""Launches of many machines at once, each in a lane of the processor's vectors.

One compiled batch integrator serves all active sets (:mod:`.compiled`), so a lane changes its stops without
regard to the others; a lane whose machine has launched takes the next one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import InputError
from ...models.kinematics import Kinematics, initial_state
from ...models.launch import is_launch
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ..contact import ActiveSet
from ..equations import Equations
from ..reactions import refuse_dependent
from .compiled import batch_pool, torque_function
from .machine import PROJECTILE, Structure, numbers_of, projectile_row, relevant_stops, rests_of, structure_of
from .system import heyoka

BATCH_TOLERANCE = 1e-12


@dataclass(frozen=True)
class BatchLaunches:
    """Launches of n machines; NaN where a stop did not open before the launch, or a machine did not launch."""

    release_times: Mapping[str, FloatArray]
    """[s], each of shape (n,)."""
    launched: np.ndarray[Any, np.dtype[np.bool_]]
    """Whether there was a launch within the duration, shape (n,)."""
    time: FloatArray
    """[s], shape (n,)."""
    velocity: FloatArray
    """Of the projectile [m/s], shape (n, 2)."""
    q: FloatArray
    """At the launch, shape (n, n_q) [rad or m]."""
    u: FloatArray
    """At the launch, shape (n, n_q) [rad/s or m/s]."""

    @property
    def speed(self) -> FloatArray:
        """Of the projectile at the launch [m/s], shape (n,)."""
        return np.hypot(self.velocity[:, 0], self.velocity[:, 1])


def launch_batch(
    mechanisms: Sequence[Mechanism], duration: float = 4.0, tolerance: float = BATCH_TOLERANCE
) -> BatchLaunches:
    """Launches of machines of one kind under the release-once law.

    Args:
        mechanisms: alike but for their numbers: same coordinates, stops and projectile.
        duration: the launch is searched up to here [s].
        tolerance: relative local error.

    Raises:
        EngineNotInstalledError: heyoka is not here.
        InputError: the machines are not alike, throw nothing, or the duration or the tolerance is not usable.
    """
    if not 2.3e-16 <= tolerance <= 1e-2:
        raise InputError(f"tolerance = {tolerance!r} is not between 2.3e-16 and 0.01.")
    if not mechanisms:
        raise InputError("mechanisms is empty; at least one is needed.")
    _refuse_unlike(mechanisms)
    first = Problem(mechanisms[0], duration)
    # Copies: each mechanism is valid already, and to validate it again takes as long as to integrate it.
    machines = _Machines([first.model_copy(update={"mechanism": mechanism}) for mechanism in mechanisms])
    lanes = int(heyoka().recommended_simd_size())
    with batch_pool(machines.structure, tolerance, lanes).lend() as integrator:
        return _Lanes(integrator, machines, duration).run()


def _refuse_unlike(mechanisms: Sequence[Mechanism]) -> None:
    def kind(mechanism: Mechanism) -> tuple[object, ...]:
        stops: list[object] = [(s.name, s.body, s.relative_to, s.sense, s.closed) for s in mechanism.angle_stops]
        stops += [(s.name, s.body, s.closed) for s in mechanism.point_stops]
        thrown = [marker.body for marker in mechanism.markers if marker.name == PROJECTILE]
        return (mechanism.coordinates, stops, thrown, [(j.name, j.kind) for j in mechanism.loop_joints])

    first = kind(mechanisms[0])
    if not first[2]:
        raise InputError(f"mechanism {mechanisms[0].name!r} has no marker 'projectile' that could be launched.")
    for i, mechanism in enumerate(mechanisms):
        if kind(mechanism) != first:
            raise InputError(
                f"mechanisms[{i}] ({mechanism.name!r}) differs from the first ({mechanisms[0].name!r}) in its "
                "coordinates, stops, loops or projectile; a batch needs machines of one kind."
            )


class _Machines:
    """The machines' parameters and starts as arrays, one column for each."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        first = problems[0]
        self.names = tuple(stop.name for stop in first.mechanism.stops)
        self.stops = relevant_stops(first)
        self.problems = problems
        self.kinematics = [Kinematics(problem.mechanism) for problem in problems]
        both = zip(problems, self.kinematics, strict=True)
        numbers = np.array([numbers_of(problem, kinematics, np.float64) for problem, kinematics in both])
        present = np.any(numbers != 0, axis=0)
        self.structure: Structure = structure_of(first, self.kinematics[0], present)
        self.parameters = np.zeros((self.structure.n_parameters, len(problems)))
        self.parameters[: self.structure.n_numbers] = numbers[:, present].T
        starts = [np.concatenate(initial_state(problem.mechanism)) for problem in problems]
        self.states = np.ascontiguousarray(np.array(starts).T)
        self.released_at_start = np.zeros((len(problems), len(self.stops)), dtype=bool)
        self._begin()
        self.projectiles = [projectile_row(k.mechanism, k) for k in self.kinematics]
        self.speed_scales = [k.speed_scale(row) for k, row in zip(self.kinematics, self.projectiles, strict=True)]
        self.rests = np.array([name in rests_of(first.mechanism) for name in self.stops], dtype=bool)

    def _begin(self) -> None:
        """All touching stops active; machines where some would have to pull, or with start speeds, one by one."""
        active = self.structure.active
        self.parameters[active] = 1.0
        plain = np.ones(len(self.problems), dtype=bool)
        if self.stops:
            function = torque_function(self.structure, np.float64)
            plain = np.all(function(self.states, pars=self.parameters[: active.stop]) >= 0, axis=0)
        if self.structure.n_loops or any(problem.mechanism.start_speeds for problem in self.problems):
            plain[:] = False
        for i in np.flatnonzero(~plain).tolist():
            equations = Equations(self.problems[i].mechanism)
            initial = ActiveSet(self.problems[i], equations).begin()
            refuse_dependent(equations, initial.q, initial.closed, "the Taylor integrator")
            self.states[:, i] = np.concatenate([initial.q, initial.u])
            self.released_at_start[i] = [name not in initial.closed for name in self.stops]
        self.parameters[active] = ~self.released_at_start.T

    def velocity(self, i: int, state: FloatArray) -> FloatArray:
        """Of the projectile of machine i [m/s], shape (2,)."""
        n_q = self.structure.n_q
        return self.kinematics[i].velocity(self.projectiles[i], state[:n_q], state[n_q:])


class _Lanes:
    """Steps all lanes together; each has a machine, or none when there are no more."""

    def __init__(self, integrator: Any, machines: _Machines, duration: float) -> None:
        self.integrator = integrator
        self.machines = machines
        self.structure = machines.structure
        self.duration = duration
        self.state, self.pars = integrator.state, integrator.pars
        n = len(machines.problems)
        self.waiting = iter(range(n))
        self.machine = [-1] * int(integrator.batch_size)
        self.releases = np.where(machines.released_at_start, 0.0, np.nan)
        self.time = np.full(n, np.nan)
        self.at_launch = np.full((n, 2 * self.structure.n_q), np.nan)
        self.velocity = np.full((n, 2), np.nan)

    def run(self) -> BatchLaunches:
        """Until every machine has launched, or not within the duration."""
        success = heyoka().taylor_outcome.success
        for lane in range(len(self.machine)):
            self._load(lane)
        while max(self.machine) >= 0:
            self.integrator.step()
            late = (self.integrator.time > self.duration).tolist()
            for lane, (outcome, _) in enumerate(self.integrator.step_res):
                if self.machine[lane] < 0:
                    continue
                if late[lane]:
                    self._load(lane)
                elif outcome != success:
                    self._event(lane, int(outcome))
        n_q = self.structure.n_q
        releases = {name: np.full(len(self.time), np.nan) for name in self.machines.names}
        releases |= dict(zip(self.machines.stops, self.releases.T, strict=True))
        launched = np.isfinite(self.time)
        return BatchLaunches(
            releases, launched, self.time, self.velocity, self.at_launch[:, :n_q], self.at_launch[:, n_q:]
        )

    def _load(self, lane: int) -> None:
        """Give a lane the next machine; without one its results are ignored."""
        i = next(self.waiting, -1)
        self.machine[lane] = i
        self.state[:-1, lane] = self.machines.states[:, i]
        self.state[-1, lane] = 0.0
        self.pars[:, lane] = self.machines.parameters[:, i]
        self._look_for_launch(lane)
        high, low = (part.copy() for part in self.integrator.dtime)
        high[lane] = low[lane] = 0.0
        self.integrator.set_dtime(high, low)
        self.integrator.reset_cooldowns(lane)

    def _look_for_launch(self, lane: int) -> None:
        active = self.pars[self.structure.active, lane] > 0
        self.pars[self.structure.launch, lane] = float(not np.any(active & self.machines.rests))

    def _event(self, lane: int, outcome: int) -> None:
        stop = -outcome - 1
        if stop > len(self.machines.stops):  # the state is not finite: no launch
            self._load(lane)
        elif stop < len(self.machines.stops):
            self._release(lane, stop)
        elif self._is_launch(lane):
            self._load(lane)

    def _release(self, lane: int, stop: int) -> None:
        active = self.structure.active
        opened = np.zeros(len(self.machines.stops), dtype=bool)
        opened[stop] = True
        while np.any(opened):  # stops that would have to pull now open at the same instant
            self.releases[self.machine[lane], opened] = self.integrator.time[lane]
            self.pars[active, lane][opened] = 0.0
            if not np.any(self.pars[active, lane]):
                break
            pars = self.pars[: active.stop, lane].copy()
            opened = torque_function(self.structure, np.float64)(self.state[:-1, lane].copy(), pars=pars) < 0
        self._look_for_launch(lane)

    def _is_launch(self, lane: int) -> bool:
        """Record a launch, if it is one: not the opposite direction, nor a start from rest."""
        i, time, state = self.machine[lane], float(self.integrator.time[lane]), self.state[:-1, lane].copy()
        velocity = self.machines.velocity(i, state)
        if not is_launch(velocity, scale=self.machines.speed_scales[i]):
            return False
        self.time[i], self.at_launch[i], self.velocity[i] = time, state, velocity
        return True
