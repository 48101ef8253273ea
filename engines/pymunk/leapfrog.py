"""Steps of a Chipmunk space as a leapfrog, with joints kept to a higher order than by Chipmunk.

A step of Chipmunk moves the bodies with their old velocities, then finds impulses at the new
position. So a velocity increment at a given position is that of a step for which the bodies have
been moved back by one step before.

States are rows of x, y, angle, vx, vy and angular velocity, one body after the other; corrections
of rods and pins follow from them.
"""

from __future__ import annotations

import cmath
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, cast

import numpy as np
import pymunk
import pymunk.batch
from numpy.typing import NDArray
from pymunk import constraints

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from ..reading import read_each_step
from .bodies import Assembly, Rod
from .loads import Pose, set_forces
from .passes import convergence
from .read import BodySamples

Row = list[float]
STEP = 1.0  # [s] of the step whose velocity increment is settled
STARTED = 1e-9  # of the increment at the start: change in a round
_FIELDS = (
    pymunk.batch.BodyFields.POSITION
    | pymunk.batch.BodyFields.ANGLE
    | pymunk.batch.BodyFields.VELOCITY
    | pymunk.batch.BodyFields.ANGULAR_VELOCITY
)
_WIDTH = 6  # x, y, angle, vx, vy, angular velocity of each body
# The accuracy of the impulses is an option of a run, not of the model: passes are doubled until
# they converge.
_FIRST_PASSES, _ROUNDS = 500, 12
_SETTLED = 5e-14  # change of the velocities in a round: some 200 roundings, the noise that remains
_ENOUGH = 1e-11  # a tenth of the tolerance of model comparisons; rounding errors add up
_MOST = 1e-10  # that tolerance: rounding errors of impulses that have converged may be no larger
_MOST_START_PASSES = 200_000  # in one of the rounds, twice as many as before each
_LAST_BITS = 1e-15  # of the reach: rounding error of a position, which a joint undoes in the step


class CorrectedRod(ABC):
    """A rod whose length is kept to a higher order than by Chipmunk alone, in steps of h [s].

    Chipmunk corrects the distance along the line between the ends. Because the ends also move
    across the line and on arcs, the rod is longer by s = O(h^2) at the end of the step. A target
    distance that is shorter by s, extrapolated from the last two steps, leaves an error of O(h^4),
    as SHAKE would. It takes no force into account. Bodies have their offsets in a row by identity.
    """

    def __init__(self, rod: Rod, offsets: Mapping[int, int], h: float) -> None:
        self.joint, self._length, self._h = rod.joint, rod.length, h
        self._a, self._b = (offsets.get(end.id, -1) for end in (rod.joint.a, rod.joint.b))
        self._last = 0.0

    def prepare(self, start: Row) -> None:
        """Correct the increment at the start, of which half is kept: twice the even stretch."""
        stretch = (self._stretch(start, self._h) + self._stretch(start, -self._h)) / 2
        self.joint.distance = self._length - 2.0 * stretch

    def meet(self, half: Row) -> None:
        """Correct the same increment so that the first step, from `half`, ends at the length."""
        self.joint.distance = self._length - 2.0 * self._stretch(half, self._h)

    def begin(self, earlier: Row, first: Row) -> None:
        """Correct the first step, from the states after and before the start's increment."""
        self._last = self._stretch(earlier, self._h)
        self.aim(first)

    def aim(self, row: Row) -> None:
        """Correct the next step, from the state after this one."""
        # This state's velocities fix the stretch s of the next step; the increment in it acts on
        # the step after, whose stretch is extrapolated from this one and the last.
        s = self._stretch(row, self._h)
        self.joint.distance = self._length - (2.0 * s - self._last)
        self._last = s

    @abstractmethod
    def _stretch(self, row: Row, h: float) -> float:
        """Tell how much longer the rod is after a step than by its rate of change [m].

        Summed from small terms: the difference of two distances would bring their rounding errors
        into the forces.
        """


class FixedRod(CorrectedRod):
    """Between two points of bodies, or from a point of the ground to one of a body."""

    def __init__(self, rod: Rod, offsets: Mapping[int, int], h: float) -> None:
        super().__init__(rod, offsets, h)
        assert self._b >= 0
        self._ax, self._ay = rod.joint.anchor_a
        self._bx, self._by = rod.joint.anchor_b

    def _stretch(self, row: Row, h: float) -> float:
        b, a = self._b, self._a
        dx, dy, cx, cy = _arc(row[b + 2], h * row[b + 5], self._bx, self._by)
        x, y = row[b] + dx, row[b + 1] + dy
        px, py = h * (row[b + 3] - row[b + 5] * dy), h * (row[b + 4] + row[b + 5] * dx)
        if a < 0:
            x, y = x - self._ax, y - self._ay
        else:
            dx, dy, ax, ay = _arc(row[a + 2], h * row[a + 5], self._ax, self._ay)
            x, y, cx, cy = x - row[a] - dx, y - row[a + 1] - dy, cx - ax, cy - ay
            px = px - h * (row[a + 3] - row[a + 5] * dy)
            py = py - h * (row[a + 4] + row[a + 5] * dx)
        distance = math.hypot(x, y)
        along = (x * cx + y * cy) / distance
        across = (x * (py + cy) - y * (px + cx)) / distance
        expected = distance + (x * px + y * py) / distance + along
        return along + across * across / (math.hypot(expected, across) + expected)


class SlidingRod(CorrectedRod):
    """Across a line of a body (or of the ground), along which one end follows the other one."""

    def __init__(self, rod: Rod, axis: complex, offsets: Mapping[int, int], h: float) -> None:
        super().__init__(rod, offsets, h)
        self._end_a, self._end_b = complex(*rod.joint.anchor_a), complex(*rod.joint.anchor_b)
        self._axis = axis

    def move_anchor(self, row: Row) -> None:
        """Move the end on the line across from where the other end is after the next step."""
        self._end_a = self._anchor_across(row, self._h)
        self.joint.anchor_a = (self._end_a.real, self._end_a.imag)

    def _anchor_across(self, row: Row, h: float) -> complex:
        """End on the line across from the other one, if both bodies keep their velocities."""
        local = _predicted(row, self._b, self._end_b, h)
        if self._a >= 0:
            local = (local - _predicted(row, self._a, 0j, h)) * _turned(row, self._a, h).conjugate()
        along = ((local - self._end_a) * self._axis.conjugate()).real
        return self._end_a + along * self._axis

    def _stretch(self, row: Row, h: float) -> float:
        # With n across the line, d from anchor to point and the line's rotation e: Re(conj(e n) d)
        # after the step.
        a, b = self._a, self._b
        normal = 1j * self._axis * _turned(row, a, 0.0)
        speed, bent = _advance(row, b, self._end_b, h)
        if a < 0:
            return (normal.conjugate() * bent).real
        speed_a, bent_a = _advance(row, a, self._anchor_across(row, 0.0), h)
        moved = h * (speed - speed_a) * normal.conjugate()
        bent = (bent - bent_a) * normal.conjugate()
        turn = h * row[a + 5]
        sine, less = math.sin(turn), 2.0 * math.sin(turn / 2) ** 2
        return sine * (moved + bent).imag - less * (self._length + moved + bent).real + bent.real


class Pivot:
    """A pin in the ground whose start is corrected.

    The point of the body is aside of the pin by what its arc leaves the tangent in a step, which is
    hardly anything: the body's centre is close to its pin. Where that changes at the start it would
    be seen in the forces.
    """

    def __init__(self, joint: constraints.PivotJoint, offset: int, h: float) -> None:
        self._joint, self._offset, self._h = joint, offset, h
        self._pin, self._arm = complex(*joint.anchor_a), complex(*joint.anchor_b)

    def prepare(self, start: Row) -> None:
        """Correct the increment at the start, as that of a rod."""
        self._aim(self._bent(start, self._h) + self._bent(start, -self._h))

    def meet(self, half: Row) -> None:
        """Correct it so that the first step ends at the pin."""
        self._aim(2.0 * self._bent(half, self._h))

    def begin(self, half: Row) -> None:
        """Aim the following steps."""
        self._aim(self._bent(half, self._h))

    def _bent(self, row: Row, h: float) -> complex:
        return _advance(row, self._offset, self._arm, h)[1]

    def _aim(self, short: complex) -> None:
        anchor = self._pin - short
        self._joint.anchor_a = (anchor.real, anchor.imag)


def _predicted(row: Row, k: int, arm: complex, h: float) -> complex:
    """Position of a body's point after a while at constant rates; of the ground, the arm [m]."""
    if k < 0:
        return arm
    centre = complex(row[k] + h * row[k + 3], row[k + 1] + h * row[k + 4])
    return centre + arm * _turned(row, k, h) if arm else centre


def _turned(row: Row, k: int, h: float) -> complex:
    return cmath.exp(1j * (row[k + 2] + h * row[k + 5])) if k >= 0 else 1.0 + 0j


def _advance(row: Row, k: int, arm: complex, h: float) -> tuple[complex, complex]:
    """Velocity of a body's point [m/s], and its arc's deviation from the tangent [m]."""
    if k < 0:
        return 0j, 0j
    arm *= _turned(row, k, 0.0)
    dx, dy = arm.real, arm.imag
    turn = h * row[k + 5]
    inwards, behind = -2.0 * math.sin(turn / 2) ** 2, math.sin(turn) - turn
    bent = complex(inwards * dx - behind * dy, inwards * dy + behind * dx)
    return complex(row[k + 3], row[k + 4]) + 1j * row[k + 5] * arm, bent


def _arc(angle: float, turn: float, x: float, y: float) -> tuple[float, float, float, float]:
    """A local point from the body's centre, and its arc's deviation from the tangent [m]."""
    if x == 0.0 == y:
        return 0.0, 0.0, 0.0, 0.0
    c, s = math.cos(angle), math.sin(angle)
    dx, dy = c * x - s * y, s * x + c * y
    sine = math.sin(turn / 2)
    inwards, behind = -2.0 * sine * sine, math.sin(turn) - turn
    return dx, dy, inwards * dx - behind * dy, inwards * dy + behind * dx


class Stepper:
    """Moves an assembly step by step, and keeps its states for as many steps as it is made for.

    Row k is the state after step k: positions at t = k h, velocities half a step later in a
    leapfrog. The first step of a leapfrog only finds the velocity increment at the start, half of
    which is kept.
    """

    def __init__(self, assembly: Assembly, h: float, hold_lengths: bool, steps: int = 0) -> None:
        self.assembly, self.h, self.leapfrog, self.steps = assembly, h, False, 0
        self._space, self._buffer = assembly.space, cast("Any", pymunk.batch.Buffer())
        # The space gets its static body when it is first asked for: rows are made after that.
        ground = assembly.space.static_body
        pymunk.batch.get_space_bodies(self._space, pymunk.batch.BodyFields.BODY_ID, self._buffer)
        identities = memoryview(self._buffer.int_buf()).cast("P").tolist()
        self._offsets = {identity: _WIDTH * i for i, identity in enumerate(identities)}
        # Chipmunk appends to this memory. A row is to spare: what it finds full it would grow, and
        # that is not its own.
        self._rows = np.zeros((steps + 2, _WIDTH * len(identities)))
        self._buffer.set_float_buf(self._rows)
        self._initial = self._half = self._rows[0]
        rods: list[CorrectedRod] = []
        for rod in assembly.rods:
            if rod.axis is None:
                rods.append(FixedRod(rod, self._offsets, h))
            else:
                rods.append(SlidingRod(rod, rod.axis, self._offsets, h))
        self._pivots = [
            Pivot(joint, self._offsets[joint.b.id], h)
            for joint in assembly.space.constraints
            if isinstance(joint, constraints.PivotJoint) and joint.a is ground
        ]
        self._holds_lengths = hold_lengths
        self._corrected = rods if hold_lengths else []
        self._sliding = [rod for rod in rods if isinstance(rod, SlidingRod)]
        self._take_row: Callable[[], None] = partial(
            pymunk.batch.get_space_bodies, self._space, _FIELDS, self._buffer
        )
        if not (self._corrected or self._sliding):  # else rows are for the corrections as well
            self._take_row = read_each_step(self._take_row)

    def start(self, iterations: int, leapfrog: bool, settle: bool = False) -> None:
        """Make the first row; in a leapfrog, with the velocities of half a step later.

        Args:
            iterations: passes of the impulse solver.
            leapfrog: whether velocities are half a step ahead.
            settle: whether a leapfrog's start has as many passes as its impulses need to converge.
                It has none to start from, so passes that follow their changes from step to step may
                find a part of them only.
        """
        self.leapfrog, rates = leapfrog, self.assembly.rates
        self._initial = self._half = self._first_row()
        moves = leapfrog and self._holds_lengths and bool(np.any(rates))
        joints = [*self._corrected, *self._pivots] if moves else self._corrected
        if leapfrog:
            row = self._initial.tolist()
            for joint in joints:
                joint.prepare(row)
            self._keep_half(rates, iterations, settle)
            self._half = self._first_row()
        if moves:
            # Half an increment misses the rods' lengths by O(h^3) where forces change at the start.
            # To undo that in the step after would be an error of O(h) in the forces, so the
            # velocities of the first step get what makes it end at those lengths.
            row = self._half.tolist()
            for joint in joints:
                joint.meet(row)
            self._keep_half(rates, iterations, settle)
            for pivot in self._pivots:
                pivot.begin(row)
            self._first_row()
        # One step before the start, by the first velocity increment backwards.
        earlier, first = self._before_start(), self._rows[0].tolist()
        bodies = earlier.reshape(-1, _WIDTH)
        bodies[:, :3] -= self.h * bodies[:, 3:]
        for rod in self._corrected:
            rod.begin(earlier.tolist(), first)

    def _first_row(self) -> FloatArray:
        """The present state, taken for the first row."""
        self._buffer.clear()
        pymunk.batch.get_space_bodies(self._space, _FIELDS, self._buffer)
        return self._rows[0].copy()

    def _keep_half(self, before: FloatArray, iterations: int, settle: bool) -> None:
        """Give the bodies their rates at the start, and half of their increment there."""
        places, h = _places(self.assembly), self.h
        _step_to(self.assembly, places, before, h, iterations)
        increment, passes = self.assembly.rates - before, iterations
        rounding = _LAST_BITS * max(abs(complex(*position)) for position, _ in places) / h
        while settle and passes <= _MOST_START_PASSES:
            # The step is repeated from the same state, and starts with the impulses found so far.
            _step_to(self.assembly, places, before, h, passes)
            last, increment = increment, self.assembly.rates - before
            if np.abs(increment - last).max() <= max(STARTED * np.abs(increment).max(), rounding):
                break
            passes *= 2
        self.assembly.rates = before + increment / 2

    def run(
        self, steps: int, iterations: int, after_step: Callable[[], None] | None = None
    ) -> None:
        """Take some steps; a row each.

        Raises:
            SimulationError: ends of a rod meet, or numbers are not finite: impulses diverged.
        """
        space, h, loads = self._space, self.h, self.assembly.loads
        assert self.steps + steps <= len(self._rows) - 2, "no memory for so many steps"
        space.iterations = iterations
        row = self._rows[self.steps].tolist()
        try:
            for _ in range(steps):
                for rod in self._sliding:
                    rod.move_anchor(row)
                if loads:
                    set_forces(loads, self._next_poses())
                space.step(h)
                self._take_row()
                self.steps += 1
                # Where no rod is corrected, rows are read at the end, all at once.
                if self._corrected or self._sliding:
                    row = self._rows[self.steps].tolist()
                    for rod in self._corrected:
                        rod.aim(row)
                if after_step is not None:
                    after_step()
        except (ArithmeticError, ValueError):
            raise SimulationError(
                f"pymunk lost the joints of {self.assembly.mechanism.name!r} "
                f"{self.steps * self.h:.6g} s after the start or the last "
                "impact; a shorter timestep or more iterations may help."
            ) from None

    def release(self, stop: str) -> None:
        """Remove a stop's joint."""
        joint = self.assembly.stops.pop(stop)
        self._space.remove(joint)
        self._corrected = [rod for rod in self._corrected if rod.joint is not joint]
        self._sliding = [rod for rod in self._sliding if rod.joint is not joint]

    def samples(self, first: int, last: int | None = None) -> BodySamples:
        """Samples from one to another, both included; to the present one if left out.

        In a leapfrog, the velocity at a sample is the mean of those half a step before and after
        it: the energy of this state does not drift. Forces are those of the velocity increment at
        the sample, of second order there.
        """
        columns = [self._offsets[body.id] // _WIDTH for body in self.assembly.bodies]

        def by_body(rows: FloatArray) -> FloatArray:
            return np.reshape(rows, (len(rows), -1, _WIDTH))[:, columns]

        last = self.steps if last is None else last
        rows = by_body(self._rows[max(first - 1, 0) : last + 1])
        before, after, places = rows[:-1], rows[1:], rows[1:]
        if first == 0:
            # The start's increment is the one found there, continued backwards.
            start = by_body(np.array([self._before_start(), self._half]))
            before, after = np.concatenate([start[:1], before]), np.concatenate([start[1:], after])
            places = rows
        share = 0.5 if self.leapfrog else 1.0

        def with_rates(
            values: NDArray[Any], before: NDArray[Any], after: NDArray[Any]
        ) -> NDArray[Any]:
            mean = share * after + (1 - share) * before
            return np.stack([values, mean, (after - before) / self.h])

        positions = places[..., 0] + 1j * places[..., 1]
        velocities = (state[..., 3] + 1j * state[..., 4] for state in (before, after))
        return BodySamples(
            with_rates(positions, *velocities),
            with_rates(places[..., 2], before[..., 5], after[..., 5]),
        )

    def _before_start(self) -> FloatArray:
        """The start's state with velocities that its increment has not changed yet."""
        if self.leapfrog:
            return 2 * self._initial - self._half
        return 2 * self._rows[0] - self._rows[min(1, self.steps)]

    def _next_poses(self) -> Callable[[pymunk.Body], Pose]:
        """Poses after the next step, with speeds extrapolated from the last two half steps."""
        h, row = self.h, self._rows[self.steps].tolist()
        before = row
        if self.leapfrog:
            earlier = self._rows[self.steps - 1] if self.steps else self._before_start()
            before = earlier.tolist()

        def pose_of(body: pymunk.Body) -> Pose:
            k = self._offsets[body.id]
            x, y, angle, vx, vy, spin = row[k : k + _WIDTH]
            bx, by, spin_before = before[k + 3 : k + _WIDTH]
            return Pose(
                position=complex(x + h * vx, y + h * vy),
                angle=angle + h * spin,
                velocity=complex(1.5 * vx - 0.5 * bx, 1.5 * vy - 0.5 * by),
                spin=1.5 * spin - 0.5 * spin_before,
            )

        return pose_of


_Place = tuple[pymunk.Vec2d, float]  # position [m] and angle [rad] of a body


def settled_increment(assembly: Assembly) -> FloatArray:
    """Change of the rates in a step of `STEP` to the present position, with impulses converged.

    The rates are those before afterwards; shape (n_bodies, 3).

    Raises:
        SimulationError: the impulses do not converge.
    """
    before, places = assembly.rates, _places(assembly)
    # A joint's error has the rounding of its ends' positions, however small the accelerations are.
    reach = max(abs(complex(*position)) for position, _ in places) / STEP
    needed, taken = convergence(assembly).passes_to(_SETTLED), 0
    increment, change, enough = np.full_like(before, np.inf), math.inf, _ENOUGH
    for doublings in range(_ROUNDS):
        # The step is repeated from the same state, and starts with the impulses found so far.
        passes = _FIRST_PASSES * 2**doublings
        _step_to(assembly, places, before, STEP, passes)
        taken += passes
        last, increment = increment, assembly.rates - before
        size, previous = max(float(np.abs(increment).max()), reach), change
        difference = float(np.abs(increment - last).max())
        # At rest at the origin nothing has a size.
        change = difference / size if size > 0 else difference
        enough = _MOST if taken >= needed else _ENOUGH
        if change <= _SETTLED or ((previous < change or taken >= needed) and change <= enough):
            break
    if not change <= enough:
        raise SimulationError(
            f"pymunk's impulses on {assembly.mechanism.name!r} are not settled after "
            f"{assembly.space.iterations} passes, which change them by {change:.2g} still: its "
            "masses differ too much, or constraints are nearly parallel."
        )
    assembly.rates = before
    return increment


def _places(assembly: Assembly) -> list[_Place]:
    return [(body.position, body.angle) for body in assembly.bodies]


def _step_to(
    assembly: Assembly, places: Sequence[_Place], rates: FloatArray, h: float, iterations: int
) -> None:
    """Take a step of h [s] that brings the bodies to these places and changes these rates there."""
    assembly.rates = rates
    for body, (position, angle) in zip(assembly.bodies, places, strict=True):
        body.position = position - h * body.velocity
        body.angle = angle - h * body.angular_velocity
    if assembly.loads:
        there: dict[pymunk.Body, Pose] = {}
        for body, (position, angle), (vx, vy, spin) in zip(
            assembly.bodies, places, rates.tolist(), strict=True
        ):
            there[body] = Pose(complex(*position), angle, complex(vx, vy), spin)
        set_forces(assembly.loads, there.__getitem__)
    assembly.space.iterations = iterations
    assembly.space.step(h)
