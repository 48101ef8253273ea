"""Moving a mechanism with Exudyn from its start to the end, over the releases of its stops."""

from __future__ import annotations

import math

import numpy as np

from ..models.arrays import FloatArray
from ..models.mechanism import GROUND
from ..models.problem import Problem
from ._exudyn_build import build, silence
from ._exudyn_read import recording
from ._exudyn_soft import springs
from ._exudyn_solver import Closed, Solver, State
from .exudyn_ import ExudynEngine
from .protocol import Recording

_WHOLE = 1e-6  # of a step: so near to a whole number of steps, it is one
_SAME_TIME = 1e-12  # [s]
_RESOLVED = 1e-13  # [s] rounding of a torque over its slope
_MOST_PROBES = 12  # a torque is all but straight within a step: four are enough


def run(problem: Problem, options: ExudynEngine) -> Recording:
    """Build, move and read out.

    Raises:
        UnsupportedProblemError: the mechanism cannot be built, or not from this start.
        SimulationError: Exudyn's solver gave up before the end.
    """
    with silence():
        return _Motion(problem, options).recording()


class _Motion:
    def __init__(self, problem: Problem, options: ExudynEngine) -> None:
        self.mechanism = problem.mechanism
        self.duration = problem.duration
        self.options = options
        self.system = build(problem.mechanism)
        self.solver = Solver(self.system, options)
        self.releases: dict[str, float | None] = {stop.name: None for stop in problem.mechanism.stops}

    def recording(self) -> Recording:
        state = self.solver.start()
        closed = self._pushing(state, tuple(self.system.stops))
        if closed and self.options.stop_stiffness is not None:
            self._soften(state, closed, self.options.stop_stiffness)
        pieces: list[FloatArray] = []
        while not pieces or self.duration - state.t > _SAME_TIME:
            piece, closed = self._piece(state, closed)
            pieces.append(piece)
            state = self.solver.state(piece, -1)
        # Where two pieces meet, the later one tells the forces of what holds from there on.
        table = np.concatenate([*(piece[:-1] for piece in pieces[:-1]), pieces[-1]])
        table[:, 0] = np.minimum(table[:, 0], self.duration)  # Exudyn's sum of steps may end a rounding later
        return recording(self.system, self.solver.columns, table, self.releases, self.solver.steps)

    def _soften(self, state: State, closed: Closed, stiffness: float) -> None:
        """Go on with springs in place of the constraints that push at the start."""
        found = springs(self.solver, state, closed, stiffness, self.options.stop_damping_ratio)
        self.system = build(self.mechanism, found)
        self.solver = Solver(self.system, self.options)

    def _piece(self, state: State, closed: Closed) -> tuple[FloatArray, Closed]:
        """Move to the next release or the end; also which stops are closed after it."""
        steps = max(1, math.ceil((self.duration - state.t) / self.options.timestep - _WHOLE))
        if not self.options.located_releases:
            return self._released_after_steps(state, closed, steps)
        table = self.solver.run(
            state, closed, self.duration, steps, (lambda _: self._all_push(closed)) if closed else None
        )
        if not closed or self._all_push(closed):
            return table, closed
        return self._released(table, closed)

    def _all_push(self, closed: Closed) -> bool:
        return all(self.system.torque(name) >= 0.0 for name in closed)

    def _released_after_steps(self, state: State, closed: Closed, steps: int) -> tuple[FloatArray, Closed]:
        """Move to the end, switching a stop off after the step in which its torque fell below zero."""
        held = list(closed)

        def release(time: float) -> bool:
            for name in [name for name in held if self.system.torque(name) < 0.0]:
                held.remove(name)
                self.releases[name] = time
                self.system.set_closed(tuple(held))
            return True

        return self.solver.run(state, closed, self.duration, steps, release if held else None), tuple(held)

    def _released(self, table: FloatArray, closed: Closed) -> tuple[FloatArray, Closed]:
        """Replace the end of a table, whose last step went beyond a release, by steps onto the release."""
        row = self.solver.balance(self.solver.state(table, -1), closed).row
        pulling = [name for name in closed if self.solver.torque(row, name) < 0.0]
        found = [(*self._onto_zero(table, closed, name), name) for name in pulling]
        if not found:  # it was only the error of the integrator's multiplier: go on from there, free of it
            return table, closed
        _, table, name = min(found, key=lambda release: release[0])
        state = self.solver.state(table, -1)
        self.releases[name] = state.t
        return table, self._pushing(state, tuple(other for other in closed if other != name))

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
        for _ in range(_MOST_PROBES):
            slope = (values[-1] - values[-2]) / (ends[-1] - ends[-2])
            end = min(ends[-1] - values[-1] / slope, float(table[last, 0])) if slope else ends[-1]
            if end - begin.t <= _SAME_TIME:
                return begin.t, table[: first + 1]
            if abs(end - ends[-1]) <= _RESOLVED:
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
                self.releases[name] = state.t
        return closed

    def _first_wrong(self, state: State, touching: Closed, closed: Closed) -> str | None:
        balance = self.solver.balance(state, closed)
        names = (body.name for body in self.mechanism.bodies)
        rotations = dict(zip(names, balance.accelerations[2::3].tolist(), strict=True))
        rotations[GROUND] = 0.0
        for name in touching:
            stop = self.mechanism.stop(name)
            # Exudyn's rotations are anticlockwise, hence the minus.
            opening = -stop.sense * (rotations[stop.body] - rotations[stop.relative_to])
            if name not in closed and self.system.springs:
                continue  # a preloaded spring lets go with its gap open: which way that moves then does not matter
            if (self.solver.torque(balance.row, name) if name in closed else opening) < 0.0:
                return name
        return None
