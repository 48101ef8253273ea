"""Launches of many machines at once, each in a lane of the processor's vectors.

A motion is made of legs: from its start, or an event, to its next event. One compiled batch
integrator serves all active sets (:mod:`.expressions`), so that legs of any machines stand in its
lanes side by side. It runs without a stop: where a lane comes to an event, its state is kept and
the next leg takes its place. What follows from the events is decided for all legs at once, in
arrays, and the motions that are not over are the legs of the next round. Those that no stop holds
any more are moved by the shorter equations of the machine without stops, if there are many.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, islice
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...models.arrays import BoolArray, FloatArray, IndexArray, as_vectors
from ...models.errors import InputError, SimulationError
from ...models.kinematics import Kinematics, initial_state
from ...models.launch import is_launch
from ...models.library.registry import Model, varied
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ...models.stacked import Stack, kind_of, stacked
from ..contact import ActiveSet, starts_at_rest
from ..equations import Equations, scales_of
from ..reactions import refuse_dependent
from .expressions import batch_pool, heyoka, jacobian_function, torque_function
from .numbers import (
    PROJECTILE,
    Structure,
    numbers_of,
    projectile_row,
    relevant_stops,
    rests_of,
    structure_of,
)

BATCH_TOLERANCE = 1e-12
_CHUNK = 4096  # machines whose numbers are held at a time
_STRETCH = 32  # steps after which motions beyond the duration are looked for
_FAR = 1e15  # [s] of the integrator's own time, which all legs of a lane share
_MOST_STOPS = 4  # of which all sets are tried
_MANY = 1000  # machines for which a second compilation pays
_LATE, _LAUNCH, _ALONE = -1, -2, -3
"""Ends of a leg but for the opening of a stop: the duration, the launch, a state that is not finite
or near a singular position, of a machine that is solved alone."""
# Singular value below which a lane is near: there the other integrators try a window.
_NEAR = 0.15
_POSITIONS = 32  # random ones, for the largest arms
_SAMPLES = np.linspace(0.0, 1.0, 17)  # of a step


@dataclass(frozen=True)
class BatchLaunches:
    """Launches of n machines; NaN where a stop did not open, or a machine did not launch."""

    release_times: Mapping[str, FloatArray]  # [s], each of shape (n,)
    launched: BoolArray  # whether there was a launch within the duration, shape (n,)
    time: FloatArray  # [s], shape (n,)
    velocity: FloatArray  # of the projectile [m/s], shape (n, 2)
    q: FloatArray  # at the launch, shape (n, n_q) [rad or m]
    u: FloatArray  # at the launch, shape (n, n_q) [rad/s or m/s]
    failures: Mapping[int, str] = field(default_factory=dict[int, str])
    """Index of machines whose motion is not known so far, and a sentence that says why.

    They are not among those launched.
    """

    @property
    def speed(self) -> FloatArray:
        """Speed of the projectile at the launch [m/s], shape (n,)."""
        return np.hypot(self.velocity[:, 0], self.velocity[:, 1])


def launches(
    model: Model,
    values: Mapping[str, ArrayLike],
    *,
    duration: float = 4.0,
    tolerance: float = 1e-10,
) -> BatchLaunches:
    """Launches of many machines, from arrays of what they differ in, under the release-once law.

    The launch is where the velocity of the marker "projectile" comes down to 45 degrees.

        >>> import trebucheck as tb
        >>> thrown = tb.launches("rolling", {"l1": [9.0, 9.5, 10.0], "m_cw": 2500.0})
        >>> thrown.speed.round(3).tolist()  # [m/s]
        [99.764, 102.061, 103.874]

    Args:
        model: a name, the path of a .json file, a mechanism or a problem.
        values: parameters of a named machine, such as "l1", or numbers of the mechanism by the path
            of their field, such as "bodies.arm.mass", "joints.sling pin.parent_point.0" or
            "start.1"; each a sequence of n numbers, or one number for all machines.
        duration: the launch is searched up to here [s]; Table I's machine launches at 2.7 s, one of
            n times its lengths sqrt(n) times as late.
        tolerance: relative local error of a step of the integrator.

    Raises:
        EngineNotInstalledError: heyoka is not here.
        InputError: values are no arrays of one length, or not valid: the sentence names the field,
            the machine and its values; or the mechanism throws nothing, or the duration or the
            tolerance is not usable.
        UnsupportedProblemError: constraints of a machine depend on each other.
    """
    return launch_batch(varied(model, values), duration, tolerance)


def launch_batch(
    mechanisms: Iterable[Mechanism], duration: float = 4.0, tolerance: float = BATCH_TOLERANCE
) -> BatchLaunches:
    """Launches of machines of one kind under the release-once law.

    A machine that comes near a singular position is solved alone, as by
    :func:`.solve.taylor_quantities`.

    Args:
        mechanisms: alike but for their numbers: same coordinates, stops and projectile; of an
            iterator no more than some thousands are held at a time. From arrays they are made a
            hundred times as quickly (:func:`launches`).
        duration: the launch is searched up to here [s].
        tolerance: relative local error.

    Raises:
        EngineNotInstalledError: heyoka is not here.
        InputError: the machines are not alike, throw nothing, or the duration or the tolerance is
            not usable; or the loops of one do not close at the start.
        UnsupportedProblemError: constraints of a machine depend on each other.
    """
    if not 2.3e-16 <= tolerance <= 1e-2:
        raise InputError(f"tolerance = {tolerance!r} is not between 2.3e-16 and 0.01.")
    parts = list[BatchLaunches]()
    problem: Problem | None = None  # of the first machine
    machines: _Machines | None = None
    for chunk in _chunks(mechanisms):
        problem = problem or Problem(chunk[0], duration)
        if problem.mechanism.marker(PROJECTILE) is None:
            raise InputError(
                f"mechanism {chunk[0].name!r} has no marker 'projectile' that could be launched."
            )
        machines = _Machines(chunk, problem, len(parts) * _CHUNK, machines)
        parts.append(_Motions(machines, duration, tolerance).run())
    if not parts:
        raise InputError("mechanisms is empty; at least one is needed.")
    columns: dict[str, Any] = {}
    for name in ("launched", "time", "velocity", "q", "u"):
        columns[name] = np.concatenate([getattr(part, name) for part in parts])
    releases: dict[str, FloatArray] = {}
    for name in parts[0].release_times:
        releases[name] = np.concatenate([part.release_times[name] for part in parts])
    failures: dict[int, str] = {}
    for k, part in enumerate(parts):
        failures |= {k * _CHUNK + i: text for i, text in part.failures.items()}
    return BatchLaunches(release_times=releases, failures=failures, **columns)


def _chunks(mechanisms: Iterable[Mechanism]) -> Iterator[Sequence[Mechanism]]:
    """Parts of the machines in their order."""
    if isinstance(mechanisms, Stack):
        for first in range(0, len(mechanisms), _CHUNK):
            yield mechanisms[first : first + _CHUNK]
        return
    source = iter(mechanisms)
    while chunk := list(islice(source, _CHUNK)):
        yield chunk


@dataclass(frozen=True)
class _System:
    """Equations of motion of the machines: what is compiled, and the numbers of each."""

    structure: Structure
    parameters: FloatArray  # switches are 0, shape (n, n_parameters)


_Group = tuple[IndexArray, Problem, Kinematics]
"""Indices of machines of one kind, and these stacked."""


class _Machines:
    """The machines' equations and starts as arrays, a row for each.

    All are like the problem `example`; `first` is the index of the first of them among all, and
    `before` are those before it.
    """

    def __init__(
        self,
        mechanisms: Sequence[Mechanism],
        example: Problem,
        first: int,
        before: _Machines | None,
    ) -> None:
        self.mechanisms, self._example, self._first = mechanisms, example, first
        self.guard: _RankGuard | None = None
        self.names = tuple(stop.name for stop in example.mechanism.stops)
        self.stops = relevant_stops(example)
        groups: list[_Group] = []
        for indices, alike in stacked(mechanisms):
            if _properties(alike) != _properties(example.mechanism):
                raise self._refusal(int(indices[0]))
            groups.append((indices, self.problem(alike), Kinematics(alike)))
        self.system = self._system(groups, before and before.system)
        self.structure = self.system.structure
        self.free: _System | None = None
        """Equations without stops; none where they would not pay."""
        if self.stops and not self.structure.n_loops and len(mechanisms) >= _MANY:
            free: list[_Group] = []
            for indices, problem, _ in groups:
                alike = problem.mechanism.model_copy(update={"stops": ()})
                free.append((indices, self.problem(alike), Kinematics(alike)))
            self.free = self._system(free, before and before.free)
        n, n_q = len(mechanisms), self.structure.n_q
        self.states, self._speed_scales = np.empty((n, 2 * n_q)), np.empty(n)
        self._projectiles = np.empty((n, n_q), dtype=np.complex128)
        self._at_rest = np.empty(n, dtype=bool)
        for indices, problem, kinematics in groups:
            projectile = projectile_row(problem.mechanism, kinematics)
            self.states[indices] = np.concatenate(initial_state(problem.mechanism), axis=-1)
            self._speed_scales[indices] = kinematics.speed_scale(projectile)
            self._projectiles[indices] = projectile.coefficients
            self._at_rest[indices] = starts_at_rest(kinematics, self.stops)
        self._phasors = groups[0][2]  # alike for all
        # The same in Python's numbers, of which the integrator's calls take one after another
        self._rows: list[list[complex]] = self._projectiles.tolist()
        self._scales: list[float] = self._speed_scales.tolist()
        self.rests = np.array(
            [name in rests_of(example.mechanism) for name in self.stops], dtype=bool
        )
        self._begin()

    def problem(self, mechanism: Mechanism) -> Problem:
        """Problem of a valid mechanism: not validated again, which takes as long as its motion."""
        return self._example.model_copy(update={"mechanism": mechanism})

    def _refusal(self, i: int) -> InputError:
        return InputError(
            f"mechanisms[{self._first + i}] ({self.mechanisms[i].name!r}) differs from the first "
            f"({self._example.mechanism.name!r}) in its coordinates, stops, loops, force elements "
            "or projectile; a batch needs machines of one kind."
        )

    def _system(self, groups: Sequence[_Group], before: _System | None) -> _System:
        """Equations with all numbers that any machine has, or had in those before."""
        none = np.zeros(0, dtype=bool)
        structures = [structure_of(problem, kinematics, none) for _, problem, kinematics in groups]
        if before is not None:
            structures.append(replace(before.structure, present=()))
        columns = zip(*(structure.springs for structure in structures), strict=False)
        springs = tuple(any(flags) for flags in columns)
        common = replace(structures[0], springs=springs)
        for (indices, _, _), structure in zip(groups, structures, strict=False):
            if replace(structure, springs=springs) != common:
                raise self._refusal(int(indices[0]))
        rows = [numbers_of(problem, kinematics, np.float64) for _, problem, kinematics in groups]
        numbers = np.empty((len(self.mechanisms), rows[0].shape[1]))
        for (indices, _, _), row in zip(groups, rows, strict=True):
            numbers[indices] = row
        present = np.any(numbers != 0, axis=0)
        if before is not None:
            present |= np.array(before.structure.present)
        structure = replace(common, present=tuple(present.tolist()))
        parameters = np.zeros((len(numbers), structure.n_parameters))
        parameters[:, : structure.n_numbers] = numbers[:, present]
        return _System(structure, parameters)

    def _begin(self) -> None:
        """Decide which of the touching stops are active at the start, and who is solved alone."""
        everyone = np.arange(len(self.mechanisms))
        touching = np.ones((len(everyone), len(self.stops)), dtype=bool)
        self.closed, undecided = self.pushing(everyone, self.states, touching)
        self.alone = np.zeros(len(everyone), dtype=bool)
        if self.structure.n_loops:
            parameters = self.switched(self.system, everyone, self.closed)
            positions = self.states[:, : self.structure.n_q]
            self.guard = _RankGuard(self.structure, parameters.T, positions.T)
            self.alone = self.guard.near_at_start
        undecided |= ~self._at_rest
        for i in np.flatnonzero(undecided & ~self.alone).tolist():
            equations = Equations(self.mechanisms[i])
            initial = ActiveSet(self.problem(self.mechanisms[i]), equations).begin()
            refuse_dependent(equations, initial.q, initial.closed, "the Taylor integrator")
            self.states[i] = np.concatenate([initial.q, initial.u])
            self.closed[i] = [name in initial.closed for name in self.stops]

    def switched(self, system: _System, machines: IndexArray, closed: BoolArray) -> FloatArray:
        """Parameters of machines whose closed stops, (m, n_stops), are active; (m, n_parameters).

        A launch is an event while none of the projectile's own rests holds it.
        """
        parameters, structure = system.parameters[machines], system.structure
        if structure.n_stops:
            parameters[:, structure.active] = closed
        if structure.throws:
            parameters[:, structure.launch] = ~np.any(closed & self.rests, axis=1)
        return parameters

    def pushing(
        self, machines: IndexArray, states: FloatArray, touching: BoolArray
    ) -> tuple[BoolArray, BoolArray]:
        """Select the touching stops that push, as :func:`..contact.active_contacts` does.

        With a set of stops active, one that is not would have to pull if it were active as well
        where its gap opens: the Delassus matrix is definite. So the torques of all sets decide.

        Args:
            machines: indices, shape (m,).
            states: (m, 2 n_q).
            touching: (m, n_stops).

        Returns:
            The stops, (m, n_stops), and whether none of the sets is the one, (m,).
        """
        closed, undecided = touching.copy(), np.zeros(len(machines), dtype=bool)
        if not self.stops:
            return closed, undecided
        torques = self._torques(machines, states, touching)
        rows = np.flatnonzero(np.any(touching & ~(torques >= 0), axis=1))
        everything = range(len(self.stops))
        for size in reversed(everything if len(everything) <= _MOST_STOPS else ()):
            for chosen in combinations(everything, size):
                if not len(rows):
                    break
                active = np.zeros((len(rows), len(everything)), dtype=bool)
                active[:, chosen] = True
                data = machines[rows], states[rows]
                fits = np.all(touching[rows] >= active, axis=1)
                fits &= np.all((self._torques(*data, active) > 0) | ~active, axis=1)
                for other in set(everything).difference(chosen):
                    active[:, other] = True
                    pulls = self._torques(*data, active)[:, other] <= 0
                    fits &= pulls | ~touching[rows, other]
                    active[:, other] = False
                closed[rows[fits]] = active[fits]
                rows = rows[~fits]
        undecided[rows] = True
        return closed, undecided

    def _torques(self, machines: IndexArray, states: FloatArray, active: BoolArray) -> FloatArray:
        """Torques of the stops, (m, n_stops): of states (m, 2 n_q) and active stops."""
        numbers = self.system.parameters[machines, : self.structure.active.stop]
        parameters = numbers.T.copy()
        parameters[self.structure.active] = active.T
        function = torque_function(self.structure, np.float64)
        return np.asarray(function(states.T.copy(), pars=parameters)).T

    def is_launch(self, i: int, state: Sequence[float]) -> bool:
        """Tell whether machine i launches: not in the opposite direction, nor from rest."""
        n_q = self.structure.n_q
        velocity = self._phasors.rate_alone(self._rows[i], state[:n_q], state[n_q : 2 * n_q])
        return is_launch((velocity.real, velocity.imag), scale=self._scales[i])

    def velocities(self, machines: IndexArray, states: FloatArray) -> FloatArray:
        """Velocities of the projectiles [m/s], shape (m, 2)."""
        q, u = np.split(states, 2, axis=1)
        flow = self._phasors.flow(q, u, self._phasors.rates(q))
        return as_vectors(np.sum(flow * self._projectiles[machines], axis=1))


def _properties(mechanism: Mechanism) -> tuple[object, ...]:
    """Properties that all machines of a batch share."""
    stops = [kind_of(stop) for stop in mechanism.stops]
    thrown = [marker.body for marker in mechanism.markers if marker.name == PROJECTILE]
    loops = [(joint.name, joint.kind) for joint in mechanism.loop_joints]
    return mechanism.coordinates, stops, thrown, loops, mechanism.couplers


@dataclass
class _Legs:
    """Legs of motions, a row for each: who moves, from when [s], and held by which stops."""

    machines: IndexArray  # shape (m,)
    times: FloatArray  # shape (m,)
    states: FloatArray  # with the integrator's observer, shape (m, 2 n_q + 1)
    closed: BoolArray  # shape (m, n_stops)

    def of(self, rows: BoolArray) -> _Legs:
        """Select some of the legs."""
        return _Legs(self.machines[rows], self.times[rows], self.states[rows], self.closed[rows])


class _Lanes:
    """Takes legs to their next events; each lane has one of them, or none when no more wait."""

    def __init__(
        self, integrator: Any, machines: _Machines, system: _System, duration: float
    ) -> None:
        self._integrator, self._duration = integrator, duration
        self._machines, self._system = machines, system
        # Views that stay true. The integrator's own time is that of all legs of a lane.
        self._columns, self._numbers = list(integrator.state.T), list(integrator.pars.T)
        self._high, self._low = integrator.dtime
        self._n_stops = system.structure.n_stops
        self._lanes = range(int(integrator.batch_size))
        self._settings: dict[str, Any] = {"max_steps": _STRETCH}
        if machines.guard is not None:
            self._settings |= {"callback": self._after_step, "write_tc": True}
        self._met: list[tuple[int, int]] = []
        # Of each lane: its leg, -1 for none, and its own time at the leg's start.
        self._leg = [-1] * len(self._lanes)
        self._began = [(0.0, 0.0)] * len(self._lanes)

    def take(self, legs: _Legs) -> IndexArray:
        """Move legs, in place, to the next event of each: a stop's index, or what else it is."""
        integrator, failed = self._integrator, heyoka().taylor_outcome.err_nf_state
        self._legs, self._events = legs, [_LATE] * len(legs.machines)
        self._waiting, self._busy = iter(range(len(legs.machines))), len(self._lanes)
        self._parameters = self._machines.switched(self._system, legs.machines, legs.closed)
        self._idle = legs.states[0].copy(), self._system.parameters[legs.machines[0]]
        for event in integrator.t_events:
            event.callback.receiver = self._meet
        start = np.zeros(len(self._lanes))
        integrator.set_dtime(start, start)
        for lane in self._lanes:
            self._load(lane, (0.0, 0.0))
        while self._busy:
            integrator.propagate_until(start + _FAR, **self._settings)
            finite = np.isfinite(self._high + self._low)
            integrator.set_dtime(
                np.where(finite, self._high, 0.0), np.where(finite, self._low, 0.0)
            )
            for lane, (outcome, *_) in enumerate(integrator.propagate_res):
                if self._leg[lane] < 0:
                    self._park(lane)
                elif outcome == failed:
                    self._end(lane, _ALONE)
                elif self._legs.times[self._leg[lane]] + self._elapsed(lane) > self._duration:
                    self._end(lane, _LATE)
        for event in integrator.t_events:
            event.callback.receiver = None
        return np.array(self._events)

    def _elapsed(self, lane: int) -> float:
        """Time since a lane's leg began [s]."""
        high, low = self._began[lane]
        return (self._high.item(lane) - high) + (self._low.item(lane) - low)

    def _meet(self, event: int, lane: int) -> bool:
        """Take note of an event of a lane; whether the integrator is to go on."""
        leg = self._leg[lane]
        if leg < 0:
            return True
        if event == self._n_stops:
            machine = self._legs.machines.item(leg)
            if not self._machines.is_launch(machine, self._columns[lane].tolist()):
                return True
            event = _LAUNCH
        if self._machines.guard is not None:
            self._met.append((lane, event))  # what the step has passed is looked at first
            return True
        self._end(lane, event)
        return self._busy > 0

    def _after_step(self, _: Any) -> bool:
        """End legs that came near a singular position, or to an event, in the last step."""
        guard = self._machines.guard
        assert guard is not None
        ends = dict(self._met)
        self._met.clear()
        near = guard.after_step(self._integrator, self._legs.machines[self._leg])
        ends |= dict.fromkeys(np.flatnonzero(near).tolist(), _ALONE)
        for lane, event in ends.items():
            if self._leg[lane] >= 0:
                self._end(lane, event)
        return self._busy > 0

    def _end(self, lane: int, event: int) -> None:
        """End the leg of a lane, and begin the next one there."""
        leg, legs = self._leg[lane], self._legs
        legs.times[leg] += self._elapsed(lane)
        legs.states[leg] = self._columns[lane]
        self._events[leg] = event
        self._load(lane, (self._high.item(lane), self._low.item(lane)))

    def _load(self, lane: int, now: tuple[float, float]) -> None:
        """Begin the next leg in a lane, if one waits."""
        leg = self._leg[lane] = next(self._waiting, -1)
        if leg < 0:
            self._busy -= 1
            self._park(lane)
            return
        self._columns[lane][:] = self._legs.states[leg]
        self._numbers[lane][:] = self._parameters[leg]
        self._began[lane] = now
        self._integrator.reset_cooldowns(lane)

    def _park(self, lane: int) -> None:
        """Let a lane go through a motion without events."""
        self._columns[lane][:], self._numbers[lane][:] = self._idle


class _Motions:
    """Motions of the machines of a chunk, from event to event."""

    def __init__(self, machines: _Machines, duration: float, tolerance: float) -> None:
        self.machines, self.duration, self.tolerance = machines, duration, tolerance
        self.failures: dict[int, str] = {}
        n = len(machines.mechanisms)
        self.releases = np.where(machines.closed, np.nan, 0.0)
        self.time = np.full(n, np.nan)
        self.at_launch = np.full((n, 2 * machines.structure.n_q), np.nan)
        self.velocity = np.full((n, 2), np.nan)

    def run(self) -> BatchLaunches:
        """Run until every machine has launched, or to the end of the duration."""
        machines = self.machines
        self._solve_alone(np.flatnonzero(machines.alone))
        others = np.flatnonzero(~machines.alone)
        states = np.pad(machines.states[others], ((0, 0), (0, 1)))
        legs = _Legs(others, np.zeros(len(others)), states, machines.closed[others])
        if machines.free is not None:
            legs = self._rounds(machines.system, legs, without_stops=False)
        self._rounds(machines.free or machines.system, legs)
        releases = {name: np.full(len(self.time), np.nan) for name in machines.names}
        releases |= dict(zip(machines.stops, self.releases.T, strict=True))
        q, u = np.split(self.at_launch, 2, axis=1)
        launched = np.isfinite(self.time)
        return BatchLaunches(releases, launched, self.time, self.velocity, q, u, self.failures)

    def _rounds(self, system: _System, legs: _Legs, without_stops: bool = True) -> _Legs:
        """Move all legs to their ends, or those that a stop holds; the other legs."""
        others: list[_Legs] = []
        many = system is self.machines.free
        with batch_pool(system.structure, self.tolerance, many).lend() as integrator:
            lanes = _Lanes(integrator, self.machines, system, self.duration)
            while True:
                held = np.any(legs.closed, axis=1) | without_stops
                others.append(legs.of(~held))
                legs = legs.of(held)
                if not len(legs.machines):
                    break
                events = lanes.take(legs)
                self._solve_alone(legs.machines[events == _ALONE])
                events[legs.times > self.duration] = _LATE
                self._launch(legs.of(events == _LAUNCH))
                legs = self._release(legs.of(events >= 0), events[events >= 0])
        columns = zip(*(vars(part).values() for part in others), strict=True)
        return _Legs(*(np.concatenate(column) for column in columns))

    def _launch(self, legs: _Legs) -> None:
        i, states = legs.machines, legs.states[:, :-1]
        self.time[i], self.at_launch[i] = legs.times, states
        self.velocity[i] = self.machines.velocities(i, states)

    def _release(self, legs: _Legs, events: IndexArray) -> _Legs:
        """Open a stop of each leg, and those that would have to pull without it."""
        touching = legs.closed.copy()
        touching[np.arange(len(events)), events] = False
        states = legs.states[:, :-1]
        closed, undecided = self.machines.pushing(legs.machines, states, touching)
        rows, opened = np.nonzero(legs.closed & ~closed)
        self.releases[legs.machines[rows], opened] = legs.times[rows]
        self._solve_alone(legs.machines[undecided])
        return replace(legs, closed=closed).of(~undecided)

    def _solve_alone(self, machines: IndexArray) -> None:
        """Solve machines that the lanes cannot take, or note why they cannot be solved."""
        if not len(machines):
            return
        # Half a second, which launches of machines that the lanes take do not need
        from .solve import taylor_quantities

        for i in machines.tolist():
            self.releases[i] = np.nan
            try:
                problem = self.machines.problem(self.machines.mechanisms[i])
                throw = taylor_quantities(problem, "double", self.tolerance)
            except SimulationError as error:
                self.failures[i] = str(error)
                continue
            for k, name in enumerate(self.machines.stops):
                if (time := throw.release_times[name]) is not None:
                    self.releases[i, k] = time
            if throw.launch_q is not None and throw.launch_u is not None:
                self.time[i], self.velocity[i] = throw.launch_time, throw.launch_velocity
                self.at_launch[i] = np.concatenate([throw.launch_q, throw.launch_u])


class _RankGuard:
    """Finds the lanes of a batch that come near a singular position (:mod:`..singular`).

    The singular values of the constraints' Jacobian are taken at both ends of each step. They
    change no faster than the Jacobian does; where they may have been small in between, the step's
    Taylor polynomials are sampled. Parameters are those of all machines, (n_parameters, n); q is
    their start, (n_q, n).
    """

    def __init__(self, structure: Structure, parameters: FloatArray, q: FloatArray) -> None:
        self._structure, self._function = structure, jacobian_function(structure)
        random, arms = np.random.default_rng(1), np.zeros(())
        for _ in range(_POSITIONS):
            beside = q + random.uniform(-np.pi, np.pi, (len(q), 1))
            arms = np.maximum(arms, np.abs(self._jacobian(beside, parameters)))
        scales = scales_of(np.sum(arms**2, axis=-2), arms)
        self._scales = scales.rows[..., None] * scales.columns[..., None, :]
        self._slopes = np.linalg.norm(self._scales * arms, axis=-2)
        everyone = np.arange(q.shape[1])
        self.near_at_start: BoolArray = ~(self._least(q[:, None], parameters, everyone)[0] > _NEAR)
        """Whether each machine starts there, shape (n,)."""

    def after_step(self, integrator: Any, machines: Any) -> BoolArray:
        """Tell whether each lane came near a singular position in the last step, (lanes,).

        `machines` are the indices of the lanes' machines.
        """
        coefficients, parameters = integrator.tc[: self._structure.n_q], integrator.pars
        degrees = np.arange(coefficients.shape[1])
        terms = coefficients * integrator.last_h ** degrees[:, None]
        q = np.einsum("ikl,sk->isl", terms, _SAMPLES[:, None] ** degrees)  # (n_q, samples, lanes)
        changes = np.abs(np.diff(q, axis=1)).sum(axis=1)
        variation = np.sum(changes * self._slopes[machines].T, axis=0)
        at_ends = self._least(q[:, [0, -1]], parameters, machines).sum(axis=0)
        near = ~(0.5 * (at_ends - variation) > _NEAR)
        if np.any(near):
            sampled = self._least(q[:, :, near], parameters[:, near], machines[near])
            near[near] = ~(sampled.min(axis=0) > _NEAR)
        return near

    def _jacobian(self, q: FloatArray, parameters: FloatArray) -> FloatArray:
        """Shape (n, n_constraints, n_q); zero where the coordinates are not finite."""
        parameters = np.ascontiguousarray(parameters[: self._function.nparams])
        values = self._function(np.ascontiguousarray(q), pars=parameters)
        values = values if np.all(np.isfinite(values)) else np.nan_to_num(values)
        return values.T.reshape(q.shape[1], -1, self._structure.n_q)

    def _least(self, q: FloatArray, parameters: FloatArray, machines: Any) -> FloatArray:
        """Least singular value of the active constraints at q (n_q, samples, n): (samples, n)."""
        jacobian = self._jacobian(q.reshape(len(q), -1), np.tile(parameters, q.shape[1]))
        stops = parameters[self._structure.active].T > 0
        loops = np.ones((len(stops), self._structure.n_loops), dtype=bool)
        active = np.concatenate([loops, stops], axis=1)
        scales = self._scales[machines] * active[..., None]
        scaled = jacobian.reshape(*q.shape[1:], *jacobian.shape[1:]) * scales
        values, rank = np.linalg.svd(scaled, compute_uv=False), active.sum(axis=1)
        least = values[..., np.arange(len(rank)), np.minimum(rank, values.shape[-1]) - 1]
        return np.where(rank > values.shape[-1], 0.0, least)
