"""Moving a mechanism with Exudyn from its start to the end, over the releases of its stops: release-once."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray
from ...models.mechanism import GROUND, PointStop
from ...models.problem import Problem
from ..protocol import Recording
from .build import build
from .options import ExudynOptions
from .read import Reader, recording
from .solver import Balance, Closed, Solver, State
from .springs import springs

_WHOLE = 1e-6  # of a step: so near to a whole number of steps, it is one
SAME_TIME = 1e-12  # [s]
RESOLVED = 1e-13  # [s] rounding of a torque over its slope
MOST_PROBES = 12  # a torque is all but straight within a step: four are enough


@dataclass(frozen=True)
class Piece:
    """A stretch of motion under the same closed stops, and what follows from its end."""

    table: FloatArray
    """All sensors, the first and the last time included, shape (n, columns)."""
    state: State
    """At the end, after whatever happens there."""
    closed: Closed
    """Stops that act from there on."""


class Motion:
    """Moves one problem; `releases` and `impacts` tell what its stops did."""

    def __init__(self, problem: Problem, options: ExudynOptions) -> None:
        self.mechanism = problem.mechanism
        self.duration = problem.duration
        self.options = options
        self.system = build(problem.mechanism, law=problem.stop_law)
        self.solver = Solver(self.system, options)
        self.releases: dict[str, float | None] = {stop.name: None for stop in problem.mechanism.stops}
        self.impacts: list[tuple[float, dict[str, float]]] = []
        """Time [s] and impulse of each stop that took part [N m s, N s]."""

    def recording(self) -> Recording:
        """Move from the start to the end, and read out."""
        state = self.solver.start()
        closed = self._pushing(state, tuple(stop.name for stop in self.mechanism.stops if stop.closed))
        if closed and self.options.stop_stiffness is not None:
            self._soften(state, closed, self.options.stop_stiffness)
        pieces: list[FloatArray] = []
        while not pieces or self.duration - state.t > SAME_TIME:
            piece = self._piece(state, closed)
            pieces.append(piece.table)
            state, closed = piece.state, piece.closed
        # Where two pieces meet, the later one tells the forces of what holds from there on.
        table = np.concatenate([*(piece[:-1] for piece in pieces[:-1]), pieces[-1]])
        table[:, 0] = np.minimum(table[:, 0], self.duration)  # Exudyn's sum of steps may end a rounding later
        reader = Reader(self.system, self.solver.columns, table)
        return recording(reader, self._torques(reader), self.releases, tuple(self.impacts), self.solver.steps)

    def _torques(self, reader: Reader) -> dict[str, FloatArray]:
        return {name: reader.torque(name, released) for name, released in self.releases.items()}

    def _soften(self, state: State, closed: Closed, stiffness: float) -> None:
        """Go on with springs in place of the constraints that push at the start."""
        found = springs(self.solver, state, closed, stiffness, self.options.stop_damping_ratio)
        self.system = build(self.mechanism, found)
        self.solver = Solver(self.system, self.options)

    def _piece(self, state: State, closed: Closed) -> Piece:
        """Move to the next release or the end."""
        if not self.options.located_releases:
            return self._released_after_steps(state, closed)
        table = self.solver.run(
            state,
            closed,
            self.duration,
            self._steps_from(state),
            (lambda _: self._all_push(closed)) if closed else None,
        )
        if not closed or self._all_push(closed):
            return self._going_on(table, closed)
        found = self._first_release(table, closed)
        return self._opened(*found, closed) if found else self._going_on(table, closed)

    def _steps_from(self, state: State) -> int:
        return max(1, math.ceil((self.duration - state.t) / self.options.timestep - _WHOLE))

    def _going_on(self, table: FloatArray, closed: Closed) -> Piece:
        return Piece(table, self.solver.state(table, -1), closed)

    def _all_push(self, closed: Closed) -> bool:
        return all(self.system.torque(name) >= 0.0 for name in closed)

    def _released_after_steps(self, state: State, closed: Closed) -> Piece:
        """Move to the end, switching a stop off after the step in which its torque fell below zero."""
        held = list(closed)

        def release(time: float) -> bool:
            for name in [name for name in held if self.system.torque(name) < 0.0]:
                held.remove(name)
                self.releases[name] = time
                self.system.set_closed(tuple(held))
            return True

        table = self.solver.run(state, closed, self.duration, self._steps_from(state), release if held else None)
        return self._going_on(table, tuple(held))

    def _first_release(self, table: FloatArray, closed: Closed) -> tuple[FloatArray, str] | None:
        """A table whose last step went beyond a release, cut down to steps onto it, and which stop lets go there.

        None where it was only the error of the integrator's multiplier: a run may go on from there, free of it.
        """
        row = self.solver.balance(self.solver.state(table, -1), closed).row
        pulling = [name for name in closed if self.solver.torque(row, name) < 0.0]
        found = [(*self._onto_zero(table, closed, name), name) for name in pulling]
        _, earliest, name = min(found, key=lambda release: release[0], default=(0.0, table, None))
        return None if name is None else (earliest, name)

    def _opened(self, table: FloatArray, name: str, closed: Closed) -> Piece:
        """What follows where a stop lets go at the end of a table."""
        state = self.solver.state(table, -1)
        self._note_release(name, state.t)
        return Piece(table, state, self._pushing(state, tuple(other for other in closed if other != name)))

    def _note_release(self, name: str, time: float) -> None:
        """The first opening counts: it is the one the throw depends on."""
        if self.releases[name] is None and self.mechanism.stop(name).closed:
            self.releases[name] = time

    def _onto_zero(self, table: FloatArray, closed: Closed, name: str) -> tuple[float, FloatArray]:
        """When the torque of a stop is zero, near the last step of a table [s], and a table up to there.

        The steps onto it start two steps back, so that they are longer than half a step wherever it lies. The
        torque is that of the state, not the integrator's: a smooth function of the time, for the secant rule.
        """
        last = len(table) - 1
        first = max(last - 2, 0)
        begin = self.solver.state(table, first)

        def torque(rows: FloatArray, row: int) -> float:
            return self.solver.torque(self.solver.balance(self.solver.state(rows, row), closed).row, name)

        ends = [float(table[last - 1, 0]), float(table[last, 0])]
        values = [torque(table, last - 1), torque(table, last)]
        found = table
        for _ in range(MOST_PROBES):
            slope = (values[-1] - values[-2]) / (ends[-1] - ends[-2])
            end = min(ends[-1] - values[-1] / slope, float(table[last, 0])) if slope else ends[-1]
            if end - begin.t <= SAME_TIME:
                return begin.t, table[: first + 1]
            if abs(end - ends[-1]) <= RESOLVED:
                break
            rows = self.solver.run(begin, closed, end, last - first)
            found = np.concatenate([table[: first + 1], rows[1:]])
            ends.append(end)
            values.append(torque(rows, -1))
        return ends[-1], found

    def _pushing(self, state: State, touching: Closed) -> Closed:
        """Which of the touching stops push while the others open, all decided at once; those are released.

        Murty's pivoting: one stop on the wrong side changes sides at a time, always the first one in the list. It
        ends because the problem (0 <= torque, complementary to gap acceleration >= 0) has one solution.
        """
        closed, tried = touching, set[Closed]()
        while closed not in tried and (wrong := self._first_wrong(state, touching, closed)):
            tried.add(closed)  # the same choice twice: zeros, of which rounding decides the sign
            closed = tuple(name for name in touching if (name in closed) != (name == wrong))
        for name in touching:
            if name not in closed:
                self._note_release(name, state.t)
        return closed

    def _first_wrong(self, state: State, touching: Closed, closed: Closed) -> str | None:
        balance = self.solver.balance(state, closed)
        for name in touching:
            if name not in closed and self.system.springs:
                continue  # a preloaded spring lets go with its gap open: which way that moves then does not matter
            if (self.solver.torque(balance.row, name) if name in closed else self._opening(name, balance)) < 0.0:
                return name
        return None

    def _opening(self, name: str, balance: Balance) -> float:
        """Acceleration of a stop's gap [rad/s^2, m/s^2]."""
        stop = self.mechanism.stop(name)
        if isinstance(stop, PointStop):
            point = balance.row[self.solver.columns["stop", name, "Acceleration"]]
            return float(point[:2] @ np.array(stop.normal))
        names = (body.name for body in self.mechanism.bodies)
        rotations = dict(zip(names, balance.accelerations[2::3].tolist(), strict=True)) | {GROUND: 0.0}
        # Exudyn's rotations are anticlockwise, hence the minus.
        return -stop.sense * (rotations[stop.body] - rotations[stop.relative_to])
