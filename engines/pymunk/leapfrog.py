"""Steps of a Chipmunk space: a leapfrog with its half step at the start, and the velocity increment of a single step.

A step of Chipmunk moves the bodies with their old velocities, then finds impulses at the new position. So a velocity
increment at a given position is that of a step for which the bodies have been moved back by one step before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import pymunk
import pymunk.batch

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from .build import Assembly, Rod

_FIELDS = (
    pymunk.batch.BodyFields.POSITION
    | pymunk.batch.BodyFields.ANGLE
    | pymunk.batch.BodyFields.VELOCITY
    | pymunk.batch.BodyFields.ANGULAR_VELOCITY
)
_WIDTH = 6  # x, y, angle, vx, vy, angular velocity of each body

STEP = 1.0  # [s] of the step whose velocity increment is settled
# The accuracy of the impulses is an option of a run, not of the model: passes are doubled until they converge.
_FIRST_PASSES, _ROUNDS = 500, 12
_SETTLED = 5e-14  # change of the velocities in a round: some 200 roundings, the noise that remains
_ENOUGH = 1e-11  # a tenth of the tolerance to which models are compared; rounding errors add up over the passes

Row = list[float]


class Stepper:
    """Moves an assembly step by step and keeps its states.

    `rows[k]` is the state after step k: positions at t = k h, velocities half a step later in a leapfrog. The first
    step of a leapfrog only finds the velocity increment at the start, half of which is kept.
    """

    def __init__(self, assembly: Assembly, h: float, hold_lengths: bool) -> None:
        self.assembly, self.h = assembly, h
        self.rows: list[Row] = []
        self.leapfrog = False
        self._initial: Row = []
        self._space = assembly.space
        self._buffer: Any = pymunk.batch.Buffer()
        self._offsets = self._body_offsets()
        rods = [_CorrectedRod(rod, self._offsets, h) for rod in assembly.rods]
        self._corrected = rods if hold_lengths else []
        self._sliding = [rod for rod in rods if rod.rod.axis is not None]

    def start(self, iterations: int, leapfrog: bool) -> None:
        """Make `rows[0]`; in a leapfrog, with the velocities of half a step later."""
        self.leapfrog, self._initial = leapfrog, self._read()
        if leapfrog:
            self._half_step(iterations)
        self.rows = [self._read()]
        earlier = self._step_before()
        for rod in self._corrected:
            rod.begin(earlier, self.rows[0])

    def run(self, steps: int, iterations: int) -> None:
        """Take some steps; a row each."""
        space, h, rows = self._space, self.h, self.rows
        space.iterations = iterations
        for _ in range(steps):
            for rod in self._sliding:
                rod.move_anchor(rows[-1])
            space.step(h)
            row = self._read()
            rows.append(row)
            for rod in self._corrected:
                rod.aim(row)

    def release(self, stop: str) -> None:
        """Remove a stop's joint."""
        joint = self.assembly.stops.pop(stop)
        self._space.remove(joint)
        self._corrected = [rod for rod in self._corrected if rod.joint is not joint]
        self._sliding = [rod for rod in self._sliding if rod.joint is not joint]

    @property
    def steps(self) -> int:
        """Steps taken since the start."""
        return len(self.rows) - 1

    def states(self, first: int) -> FloatArray:
        """Rows from the one before `first` on, bodies in the mechanism's order, shape (n, n_bodies, 6).

        The row before the start continues the first velocity increment backwards.
        """
        rows = np.array(self.rows[max(first - 1, 0) :])
        if first == 0:
            rows = np.concatenate([[self._before_start()], rows])
        columns = [self._offsets[body.id] // _WIDTH for body in self.assembly.bodies]
        return rows.reshape(len(rows), -1, _WIDTH)[:, columns]

    def _step_before(self) -> Row:
        """The state one step before the start, by the first velocity increment backwards."""
        row = self._before_start()
        bodies = row.reshape(-1, _WIDTH)
        bodies[:, :3] -= self.h * bodies[:, 3:]
        return cast("Row", row.tolist())

    def _before_start(self) -> FloatArray:
        if self.leapfrog:
            return 2 * np.array(self._initial) - np.array(self.rows[0])
        return 2 * np.array(self.rows[0]) - np.array(self.rows[min(1, self.steps)])

    def _body_offsets(self) -> dict[int, int]:
        pymunk.batch.get_space_bodies(self._space, pymunk.batch.BodyFields.BODY_ID, self._buffer)
        ids = memoryview(self._buffer.int_buf()).cast("P").tolist()
        return {identity: _WIDTH * i for i, identity in enumerate(ids)}

    def _read(self) -> Row:
        self._buffer.clear()
        pymunk.batch.get_space_bodies(self._space, _FIELDS, self._buffer)
        return cast("Row", memoryview(self._buffer.float_buf()).cast("d").tolist())

    def _half_step(self, iterations: int) -> None:
        for rod in self._corrected:
            rod.prepare(self._initial)
        before = self.assembly.rates
        _step_to(self.assembly, _places(self.assembly), before, self.h, iterations)
        self.assembly.rates = (self.assembly.rates + before) / 2


class _CorrectedRod:
    """A rod whose length is kept to a higher order than by Chipmunk alone.

    Chipmunk corrects the distance along the line between the ends. Because the ends also move across the line and on
    arcs, the rod is longer by s = O(h^2) at the end of the step. A target distance that is shorter by s, extrapolated
    from the last two steps, leaves an error of O(h^4), as SHAKE would. It takes no force into account.
    """

    __slots__ = ("_a", "_ax", "_ay", "_b", "_bx", "_by", "_h", "_last", "_nx", "_ny", "_slides", "joint", "rod")

    def __init__(self, rod: Rod, offsets: dict[int, int], h: float) -> None:
        self.rod, self.joint = rod, rod.joint
        self._a = -1 if rod.a is None else offsets[rod.a.id]
        self._b = offsets[rod.b.id]
        self._ax, self._ay = rod.end_a
        self._bx, self._by = rod.end_b
        self._h = h
        self._slides = rod.axis is not None
        across = 1j * (rod.axis or 0j)
        self._nx, self._ny = across.real, across.imag
        self._last = 0.0

    def prepare(self, start: Row) -> None:
        """Correct the increment at the start, half of which is kept: by twice the stretch without its odd orders."""
        stretch = (self._stretch(start, self._h) + self._stretch(start, -self._h)) / 2
        self.joint.distance = self.rod.length - 2.0 * stretch

    def begin(self, earlier: Row, first: Row) -> None:
        """Correct the first step, from the state after the start's increment and the one before it."""
        self._last = self._stretch(earlier, self._h)
        self.aim(first)

    def aim(self, row: Row) -> None:
        """Correct the next step, from the state after this one."""
        # This state's velocities fix the stretch s of the next step; the increment in it acts on the step after, whose
        # stretch is extrapolated from this one and the last.
        s = self._stretch(row, self._h)
        self.joint.distance = self.rod.length - (2.0 * s - self._last)
        self._last = s

    def _stretch(self, row: Row, h: float) -> float:
        """How much longer the rod is after a step than by its rate of change [m].

        Summed from small terms: the difference of two distances would bring their rounding errors into the forces.
        """
        b, a = self._b, self._a
        dx, dy, cx, cy = _arc(row[b + 2], h * row[b + 5], self._bx, self._by)
        x, y = row[b] + dx, row[b + 1] + dy
        px, py = h * (row[b + 3] - row[b + 5] * dy), h * (row[b + 4] + row[b + 5] * dx)
        if a < 0:
            x, y = x - self._ax, y - self._ay
        else:
            dx, dy, ax, ay = _arc(row[a + 2], h * row[a + 5], self._ax, self._ay)
            x, y, cx, cy = x - row[a] - dx, y - row[a + 1] - dy, cx - ax, cy - ay
            px, py = px - h * (row[a + 3] - row[a + 5] * dy), py - h * (row[a + 4] + row[a + 5] * dx)
        if self._slides:  # the anchor moves along: nothing moves across
            return cx * self._nx + cy * self._ny
        distance = math.hypot(x, y)
        along = (x * cx + y * cy) / distance
        across = (x * (py + cy) - y * (px + cx)) / distance
        expected = distance + (x * px + y * py) / distance + along
        return along + across * across / (math.hypot(expected, across) + expected)

    def move_anchor(self, row: Row) -> None:
        """Move the end on the ground along its line to where the other end is predicted to be."""
        axis = self.rod.axis
        assert axis is not None
        b, h = self._b, self._h
        angle = row[b + 2] + h * row[b + 5]
        c, s = math.cos(angle), math.sin(angle)
        x = row[b] + h * row[b + 3] + c * self._bx - s * self._by
        y = row[b + 1] + h * row[b + 4] + s * self._bx + c * self._by
        along = (x - self._ax) * axis.real + (y - self._ay) * axis.imag
        self._ax += along * axis.real
        self._ay += along * axis.imag
        self.joint.anchor_a = (self._ax, self._ay)


def _arc(angle: float, turn: float, x: float, y: float) -> tuple[float, float, float, float]:
    """A body's local point from its centre, and the deviation of its arc from the tangent in a rotation [m]."""
    if x == 0.0 == y:
        return 0.0, 0.0, 0.0, 0.0
    c, s = math.cos(angle), math.sin(angle)
    dx, dy = c * x - s * y, s * x + c * y
    sine = math.sin(turn / 2)
    inwards, behind = -2.0 * sine * sine, math.sin(turn) - turn
    return dx, dy, inwards * dx - behind * dy, inwards * dy + behind * dx


_Place = tuple[pymunk.Vec2d, float]  # position [m] and angle [rad] of a body


def settled_increment(assembly: Assembly) -> FloatArray:
    """Change of the assembly's rates in a step of `STEP` to its present position, with its impulses converged.

    The rates are those before afterwards; shape (n_bodies, 3).

    Raises:
        SimulationError: the impulses do not converge, because masses differ too much.
    """
    before, places = assembly.rates, _places(assembly)
    # A joint's error has the rounding of its ends' positions, however small the accelerations are.
    reach = max(abs(complex(*position)) for position, _ in places) / STEP
    increment, change = np.full_like(before, np.inf), math.inf
    for doublings in range(_ROUNDS):
        # The step is repeated from the same state, and starts with the impulses found so far.
        _step_to(assembly, places, before, STEP, _FIRST_PASSES * 2**doublings)
        last, increment = increment, assembly.rates - before
        size, previous = max(float(np.abs(increment).max()), reach), change
        difference = float(np.abs(increment - last).max())
        change = difference / size if size > 0 else difference  # at rest at the origin nothing has a size
        if change <= _SETTLED or previous < change <= _ENOUGH:
            break
    if not change <= _ENOUGH:
        raise SimulationError(
            f"pymunk's impulses on {assembly.mechanism.name!r} are not settled after "
            f"{assembly.space.iterations} passes: its masses differ too much for them."
        )
    assembly.rates = before
    return increment


def _places(assembly: Assembly) -> list[_Place]:
    return [(body.position, body.angle) for body in assembly.bodies]


def _step_to(assembly: Assembly, places: Sequence[_Place], rates: FloatArray, h: float, iterations: int) -> None:
    """Take a step of h [s] that brings the bodies to these places and changes these rates there."""
    assembly.rates = rates
    for body, (position, angle) in zip(assembly.bodies, places, strict=True):
        body.position = position - h * body.velocity
        body.angle = angle - h * body.angular_velocity
    assembly.space.iterations = iterations
    assembly.space.step(h)
