"""Moving a mechanism with Exudyn under the unilateral law: stops that open may be met again.

An open stop's gap is looked at after every step. Where it has fallen below zero the run goes back and steps onto the
zero; there the speeds jump (:func:`.impact.strike`), and the stops that rest hold from there on. What begins
and ends within one step, a touch of at most its length squared times an eighth of the gap's acceleration, is not seen.
"""

from __future__ import annotations

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from .build import Values
from .impact import gap, gap_speed, strike
from .read import Reader
from .solver import Closed, State
from .step import MOST_PROBES, RESOLVED, SAME_TIME, Motion, Piece

_REST_SPEED = 1e-6  # [rad/s], [m/s] met more slowly a stop does not bounce: a rebound would be 1e-13 high
_AT_REST = 1e-9  # [rad/s], [m/s] gap speeds below this are rounding of an impact's solution
_TOUCHING = 1e-11  # [rad], [m] an open stop with a gap below this takes part in an impact
_TOGETHER = 1e-9  # [s] impacts closer than this are one: two stops may throw a machine to and fro ever faster
_MOST_IMPACTS = 10_000


class UnilateralMotion(Motion):
    """Moves one problem whose stops may be met."""

    def _piece(self, state: State, closed: Closed) -> Piece:
        """Move to the next release or impact, or to the end."""
        table = self.solver.run(
            state, closed, self.duration, self._steps_from(state), lambda _: self._is_undisturbed(closed)
        )
        met = self._met(closed, self._row(table, -1))
        opened = self._let_go(table, closed)
        times = [(*self._onto_gap(table, closed, name), name) for name in met]
        first, shortest, name = min(times, key=lambda event: event[0], default=(np.inf, table, None))
        if opened and opened[0][-1, 0] < first:
            return self._opened(*opened, closed)
        return self._going_on(table, closed) if name is None else self._struck(shortest, closed, name)

    def _let_go(self, table: FloatArray, closed: Closed) -> tuple[FloatArray, str] | None:
        """The stop that opens in the last step of a table, if one does, and a table up to there."""
        pulling = (name for name in closed if self.solver.torque(table[-1], name) < 0.0)
        name = next(pulling, None)
        if name is None or self.options.located_releases:
            return None if name is None else self._first_release(table, closed)
        return table, name

    def _is_undisturbed(self, closed: Closed) -> bool:
        return self._all_push(closed) and not self._met(closed, self.system.now)

    def _met(self, closed: Closed, values: Values) -> list[str]:
        """Open stops that have been run into; one that has just let go may stand below zero by the drift it had."""
        return [
            name
            for name in self.system.stops
            if name not in closed and gap(self.system, name, values) < 0.0 > gap_speed(self.system, name, values)
        ]

    def _onto_gap(self, table: FloatArray, closed: Closed, name: str) -> tuple[float, FloatArray]:
        """When the gap of a stop is zero, in the last steps of a table [s], and a table up to there.

        Newton's iteration from the far end: after a rebound lower than a step is long the gap is zero at both of its
        ends, and what is wanted is the later one.
        """
        last, first = len(table) - 1, max(len(table) - 3, 0)
        begin, found = self.solver.state(table, first), table
        for _ in range(MOST_PROBES):
            time = float(found[-1, 0])
            end = self._newton(time, self._row(found, -1), name, float(table[-1, 0]))
            if end - begin.t <= SAME_TIME:
                return begin.t, table[: first + 1]
            if abs(end - time) <= RESOLVED:
                break
            rows = self.solver.run(begin, closed, end, last - first)
            found = np.concatenate([table[: first + 1], rows[1:]])
        return float(found[-1, 0]), found

    def _newton(self, time: float, values: Values, name: str, latest: float) -> float:
        """The next guess of when a gap is zero [s]; half way back where the gap grows, on the wrong side of a turn."""
        speed = gap_speed(self.system, name, values)
        return (time + latest) / 2 if speed >= 0 else min(time - gap(self.system, name, values) / speed, latest)

    def _row(self, table: FloatArray, row: int) -> Values:
        return lambda sensor: table[row, self.solver.columns[sensor]][None]

    def _struck(self, table: FloatArray, closed: Closed, name: str) -> Piece:
        """What follows where a stop is met at the end of a table."""
        if len(self.impacts) >= _MOST_IMPACTS:
            raise SimulationError(f"exudyn gave up at t = {table[-1, 0]:.6g} s: {_MOST_IMPACTS} impacts, and no end.")
        state, values = self.solver.state(table, -1), self._row(table, -1)
        touching = tuple(
            other
            for other in self.system.stops
            if other == name or other in closed or self._also_touches(other, state.t, values)
        )
        after, impulses = strike(self.system, state, touching, self._restitution(touching, values))
        self.impacts.append((state.t, impulses))
        return Piece(table, after, self._resting(after, touching))

    def _also_touches(self, name: str, time: float, values: Values) -> bool:
        together = any(
            time - before <= _TOGETHER and impulses.get(name, 0.0) > 0 for before, impulses in self.impacts[-10:]
        )
        return together or abs(gap(self.system, name, values)) <= _TOUCHING

    def _restitution(self, touching: Closed, values: Values) -> FloatArray:
        return np.array(
            [
                self.mechanism.stop(name).restitution if gap_speed(self.system, name, values) < -_REST_SPEED else 0.0
                for name in touching
            ]
        )

    def _resting(self, state: State, touching: Closed) -> Closed:
        """Of the stops that touch after an impact, those that neither part nor would have to pull."""
        table = self.solver.balance(state, ()).row[None]
        values = self._row(table, 0)
        resting = tuple(name for name in touching if abs(gap_speed(self.system, name, values)) <= _AT_REST)
        for name in touching:
            if name not in resting:
                self._note_release(name, state.t)
        return self._pushing(state, resting)

    def _torques(self, reader: Reader) -> dict[str, FloatArray]:
        """Of all stops: the multiplier of one that is open is zero."""
        return {name: reader.torque(name, None) for name in self.releases}
