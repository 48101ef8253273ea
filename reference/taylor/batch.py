"""Launches of many machines at once, each in a lane of the processor's vectors.

One compiled batch integrator serves all active sets (:mod:`.expressions`), so a lane changes its
stops without regard to the others; a lane whose machine has launched takes the next one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import islice
from operator import itemgetter
from typing import Any

import numpy as np

from ...models.arrays import BoolArray, FloatArray, IndexArray
from ...models.errors import InputError, SimulationError
from ...models.kinematics import Kinematics, PointCoefficients, initial_state
from ...models.launch import is_launch
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ...models.spec import Spec, number_units
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
from .solve import taylor_quantities

BATCH_TOLERANCE = 1e-12
_CHUNK = 4096  # machines whose numbers are held at a time
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


def launch_batch(
    mechanisms: Iterable[Mechanism], duration: float = 4.0, tolerance: float = BATCH_TOLERANCE
) -> BatchLaunches:
    """Launches of machines of one kind under the release-once law.

    A machine that comes near a singular position is solved alone, as by
    :func:`.solve.taylor_quantities`.

    Args:
        mechanisms: alike but for their numbers: same coordinates, stops and projectile. Of an
            iterator that makes them one by one no more than some thousands are held at a time.
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
    source, parts = iter(mechanisms), list[BatchLaunches]()
    problem: Problem | None = None  # of the first machine
    structure: Structure | None = None
    lanes = int(heyoka().recommended_simd_size())
    while chunk := list(islice(source, _CHUNK)):
        problem = problem or Problem(chunk[0], duration)
        if problem.mechanism.marker(PROJECTILE) is None:
            raise InputError(
                f"mechanism {chunk[0].name!r} has no marker 'projectile' that could be launched."
            )
        machines = _Machines(chunk, problem, len(parts) * _CHUNK, structure)
        structure = machines.structure
        with batch_pool(structure, tolerance, lanes).lend() as integrator:
            parts.append(_Lanes(integrator, machines, duration, tolerance).run())
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


class _Machines:
    """The machines' parameters and starts as arrays, one column for each.

    All are like the problem `example`; `first` is the index of the first of them among all, and
    `before` the structure of those before it.
    """

    def __init__(
        self,
        mechanisms: Sequence[Mechanism],
        example: Problem,
        first: int,
        before: Structure | None,
    ) -> None:
        self.mechanisms, self._example, self._first = mechanisms, example, first
        self.guard: _RankGuard | None = None
        self.names = tuple(stop.name for stop in mechanisms[0].stops)
        self.stops = relevant_stops(example)
        groups: list[tuple[IndexArray, Problem, Kinematics]] = []
        for indices, alike in stacked(mechanisms):
            i = int(indices[0])
            if _properties(mechanisms[i]) != _properties(example.mechanism):
                raise self._refusal(i)
            groups.append((indices, self.problem(alike), Kinematics(alike)))
        numbers = self._take_structure(groups, before)
        n, n_q = len(mechanisms), self.structure.n_q
        self.parameters = np.zeros((self.structure.n_parameters, n))
        self.parameters[: self.structure.n_numbers] = numbers[:, np.array(self.structure.present)].T
        self.states, self.speed_scales = np.empty((2 * n_q, n)), np.empty(n)
        self.projectiles = np.empty((n, n_q), dtype=np.complex128)
        self.plain = np.empty(n, dtype=bool)
        for indices, problem, kinematics in groups:
            projectile = projectile_row(problem.mechanism, kinematics)
            self.states[:, indices] = np.concatenate(initial_state(problem.mechanism), axis=-1).T
            self.speed_scales[indices] = kinematics.speed_scale(projectile)
            self.projectiles[indices] = projectile.coefficients
            self.plain[indices] = starts_at_rest(kinematics, self.stops)
        self.kinematics = groups[0][2]
        self._begin()
        self.rests = np.array([name in rests_of(mechanisms[0]) for name in self.stops], dtype=bool)

    def problem(self, mechanism: Mechanism) -> Problem:
        """Problem of a valid mechanism: not validated again, which takes as long as its motion."""
        return self._example.model_copy(update={"mechanism": mechanism})

    def _refusal(self, i: int) -> InputError:
        return InputError(
            f"mechanisms[{self._first + i}] ({self.mechanisms[i].name!r}) differs from the first "
            f"({self._example.mechanism.name!r}) in its coordinates, stops, loops, force elements "
            "or projectile; a batch needs machines of one kind."
        )

    def _take_structure(
        self, groups: Sequence[tuple[IndexArray, Problem, Kinematics]], before: Structure | None
    ) -> FloatArray:
        """Numbers, shape (n, n_numbers); the structure has those that any machine has."""
        none = np.zeros(0, dtype=bool)
        structures = [structure_of(problem, kinematics, none) for _, problem, kinematics in groups]
        if before is not None:
            structures.append(replace(before, present=()))
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
            present |= np.array(before.present)
        self.structure = replace(common, present=tuple(present.tolist()))
        return numbers

    def _begin(self) -> None:
        """Touching stops active but one that would have to pull; other starts one by one."""
        active = self.structure.active
        self.parameters[active] = 1.0
        if self.stops:
            # Where one stop alone would have to pull, its gap opens without it, for the Delassus
            # matrix is definite.
            pulls = ~(self._torques() >= 0)
            self.parameters[active] = ~(pulls & (pulls.sum(axis=0) == 1))
            self.plain &= np.all(self._torques() >= 0, axis=0)
        self.released_at_start = self.parameters[active].T == 0
        self.alone = np.zeros(len(self.mechanisms), dtype=bool)
        if self.structure.n_loops:
            q = self.states[: self.structure.n_q]
            self.guard = _RankGuard(self.structure, self.parameters, q)
            self.alone = self.guard.near_at_start
        for i in np.flatnonzero(~self.plain & ~self.alone).tolist():
            equations = Equations(self.mechanisms[i])
            initial = ActiveSet(self.problem(self.mechanisms[i]), equations).begin()
            refuse_dependent(equations, initial.q, initial.closed, "the Taylor integrator")
            self.states[:, i] = np.concatenate([initial.q, initial.u])
            self.released_at_start[i] = [name not in initial.closed for name in self.stops]
        self.parameters[active] = ~self.released_at_start.T

    def _torques(self) -> FloatArray:
        parameters = self.parameters[: self.structure.active.stop]
        return np.asarray(torque_function(self.structure, np.float64)(self.states, pars=parameters))

    def velocity(self, i: int, state: FloatArray) -> FloatArray:
        """Velocity of the projectile of machine i [m/s], shape (2,)."""
        n_q, row = self.structure.n_q, PointCoefficients(0j, self.projectiles[i])
        return self.kinematics.velocity(row, state[:n_q], state[n_q:])


def _properties(mechanism: Mechanism) -> tuple[object, ...]:
    """Properties that all machines of a batch share."""
    stops = [(type(stop), _reader(type(stop))(vars(stop))) for stop in mechanism.stops]
    thrown = [marker.body for marker in mechanism.markers if marker.name == PROJECTILE]
    loops = [(joint.name, joint.kind) for joint in mechanism.loop_joints]
    return mechanism.coordinates, stops, thrown, loops


class _Lanes:
    """Steps all lanes together; each has a machine, or none when there are no more."""

    def __init__(
        self, integrator: Any, machines: _Machines, duration: float, tolerance: float
    ) -> None:
        self.integrator, self.machines = integrator, machines
        self.structure = machines.structure
        self.active, self.launch = self.structure.active, self.structure.launch
        self.torques = torque_function(self.structure, np.float64) if machines.stops else None
        self.duration, self.tolerance = duration, tolerance
        self.failures: dict[int, str] = {}
        self.state, self.pars = integrator.state, integrator.pars
        n = len(machines.mechanisms)
        together = np.flatnonzero(~machines.alone).tolist()
        self.waiting, self.last = iter(together), together[-1] if together else 0
        self.machine = [-1] * int(integrator.batch_size)
        self.releases = np.where(machines.released_at_start, 0.0, np.nan)
        self.time = np.full(n, np.nan)
        self.at_launch = np.full((n, 2 * self.structure.n_q), np.nan)
        self.velocity = np.full((n, 2), np.nan)

    def run(self) -> BatchLaunches:
        """Run until every machine has launched, or to the end of the duration."""
        machines, guard = self.machines, self.machines.guard
        outcomes = heyoka().taylor_outcome
        for i in np.flatnonzero(machines.alone).tolist():
            self._solve_alone(i)
        for lane in range(len(self.machine)):
            self._load(lane)
        while max(self.machine) >= 0:
            self.integrator.step(write_tc=guard is not None)
            late = (self.integrator.time > self.duration).tolist()
            near = [False] * len(late)
            if guard is not None:
                near = guard.after_step(self.integrator, np.array(self.machine)).tolist()
            for lane, (outcome, _) in enumerate(self.integrator.step_res):
                if self.machine[lane] < 0:
                    if outcome == outcomes.err_nf_state:
                        self._load(lane)
                elif near[lane]:
                    self._solve_alone(self.machine[lane])
                    self._load(lane)
                elif late[lane]:
                    self._load(lane)
                elif outcome != outcomes.success:
                    self._event(lane, -int(outcome) - 1)
        releases = {name: np.full(len(self.time), np.nan) for name in machines.names}
        releases |= dict(zip(machines.stops, self.releases.T, strict=True))
        launched, n_q = np.isfinite(self.time), self.structure.n_q
        q, u = self.at_launch[:, :n_q], self.at_launch[:, n_q:]
        return BatchLaunches(releases, launched, self.time, self.velocity, q, u, self.failures)

    def _solve_alone(self, i: int) -> None:
        """Solve a machine that the lanes cannot take, or note why it cannot be solved."""
        self.releases[i] = np.nan
        try:
            problem = self.machines.problem(self.machines.mechanisms[i])
            throw = taylor_quantities(problem, "double", self.tolerance)
        except SimulationError as error:
            self.failures[i] = str(error)
            return
        for k, name in enumerate(self.machines.stops):
            if (time := throw.release_times[name]) is not None:
                self.releases[i, k] = time
        if throw.launch_q is not None and throw.launch_u is not None:
            self.time[i], self.velocity[i] = throw.launch_time, throw.launch_velocity
            self.at_launch[i] = np.concatenate([throw.launch_q, throw.launch_u])

    def _load(self, lane: int) -> None:
        """Give a lane the next machine; without one, the last again, whose results are ignored."""
        self.machine[lane] = next(self.waiting, -1)
        i = self.last if self.machine[lane] < 0 else self.machine[lane]
        self.state[:-1, lane] = self.machines.states[:, i]
        self.state[-1, lane] = 0.0
        self.pars[:, lane] = self.machines.parameters[:, i]
        self._look_for_launch(lane)
        high, low = (part.copy() for part in self.integrator.dtime)
        high[lane] = low[lane] = 0.0
        if not np.isfinite(high).all():  # another lane's failure in this step is not seen yet
            high[~np.isfinite(high)] = low[~np.isfinite(high)] = 0.0
        self.integrator.set_dtime(high, low)
        self.integrator.reset_cooldowns(lane)

    def _look_for_launch(self, lane: int) -> None:
        """A launch is an event from when none of the projectile's own rests holds it."""
        held = self.pars[self.active, lane] @ self.machines.rests
        self.pars[self.launch, lane] = 0.0 if held else 1.0

    def _event(self, lane: int, event: int) -> None:
        """Open a stop, or record a launch, and go on with the next machine."""
        i = self.machine[lane]
        state = self.state[:-1, lane].copy()
        if event < len(self.machines.stops):
            active = self.pars[self.active, lane]
            opened = np.zeros(len(active), dtype=bool)
            opened[event] = True
            while opened.any():  # stops that would have to pull now open at the same instant
                self.releases[i, opened] = self.integrator.time[lane]
                active[opened] = 0.0
                if self.torques is None or not active.any():
                    break
                pars = self.pars[: self.active.stop, lane].copy()
                opened = self.torques(state, pars=pars) < 0
            self._look_for_launch(lane)
        elif event > len(self.machines.stops):  # the state is not finite
            self._solve_alone(i)
            self._load(lane)
        else:
            velocity = self.machines.velocity(i, state)
            # Neither in the opposite direction, nor a start from rest.
            if is_launch(velocity, scale=self.machines.speed_scales[i]):
                self.time[i] = float(self.integrator.time[lane])
                self.at_launch[i], self.velocity[i] = state, velocity
                self._load(lane)


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


_PARTS = ("bodies", "joints", "stops", "markers", "force_elements")


def stacked(mechanisms: Sequence[Mechanism]) -> Iterator[tuple[IndexArray, Mechanism]]:
    """Indices of the mechanisms of each kind, and these mechanisms as one.

    Mechanisms are of one kind if they differ in their numbers and in their own name alone. A
    stacked mechanism is for :class:`...models.kinematics.Kinematics` alone, whose arrays then have
    a first axis more: each of its numbers (lengths, masses, the start) is an array over the
    mechanisms, shape (n,). It is not validated.
    """
    kinds: dict[tuple[object, ...], list[int]] = {}
    for i, mechanism in enumerate(mechanisms):
        fields = mechanism.__dict__
        kind: list[object] = [len(fields["start"]), len(fields["start_speeds"])]
        for name in _PARTS:
            kind.append(name)
            for part in fields[name]:
                kind += (type(part), _reader(type(part))(part.__dict__))
        kinds.setdefault(tuple(kind), []).append(i)
    for indices in kinds.values():
        alike = [mechanisms[i] for i in indices]
        columns = _columns(alike)
        for name in _PARTS:
            parts = zip(*(getattr(mechanism, name) for mechanism in alike), strict=True)
            columns[name] = tuple(part[0].model_copy(update=_columns(part)) for part in parts)
        yield np.array(indices), alike[0].model_copy(update=columns)


def _columns(specs: Sequence[Spec]) -> dict[str, Any]:
    """Numbers of objects of a class as arrays over them; of vectors each component."""
    columns: dict[str, Any] = {}
    for name in number_units(type(specs[0])):
        column = np.array([getattr(spec, name) for spec in specs], dtype=np.float64)
        columns[name] = column if column.ndim == 1 else tuple(np.ascontiguousarray(column.T))
    return columns


@lru_cache
def _reader(cls: type[Spec]) -> Callable[[dict[str, Any]], object]:
    """Reads the fields that hold no numbers."""
    return itemgetter(*(name for name in cls.model_fields if name not in number_units(cls)))
