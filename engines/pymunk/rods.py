"""Joints that are kept to a higher order than by Chipmunk alone: rods, and the start of pins in the ground.

They are moved by the bodies' states in rows of x, y, angle, vx, vy and angular velocity, one body
after the other.
"""

from __future__ import annotations

import cmath
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping

from pymunk import constraints

from .assembly import Rod

Row = list[float]


class CorrectedRod(ABC):
    """A rod whose length is kept to a higher order than by Chipmunk alone.

    Chipmunk corrects the distance along the line between the ends. Because the ends also move
    across the line and on arcs, the rod is longer by s = O(h^2) at the end of the step. A target
    distance that is shorter by s, extrapolated from the last two steps, leaves an error of O(h^4),
    as SHAKE would. It takes no force into account.
    """

    __slots__ = ("_h", "_last", "_length", "joint")

    def __init__(self, rod: Rod, h: float) -> None:
        self.joint, self._length = rod.joint, rod.length
        self._h = h
        self._last = 0.0

    def prepare(self, start: Row) -> None:
        """Correct the increment at the start, half of which is kept: by twice the stretch without its odd orders."""
        stretch = (self._stretch(start, self._h) + self._stretch(start, -self._h)) / 2
        self.joint.distance = self._length - 2.0 * stretch

    def meet(self, half: Row) -> None:
        """Correct the same increment so that the first step ends at the rod's length.

        Args:
            half: the bodies at the start, with their velocities of half a step later.
        """
        self.joint.distance = self._length - 2.0 * self._stretch(half, self._h)

    def begin(self, earlier: Row, first: Row) -> None:
        """Correct the first step, from the state after the start's increment and the one before it."""
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
        """How much longer the rod is after a step than by its rate of change [m].

        Summed from small terms: the difference of two distances would bring their rounding errors
        into the forces.
        """


def corrected(rod: Rod, offsets: Mapping[int, int], h: float) -> CorrectedRod:
    """How a rod is kept to its length in steps of h [s]; `offsets` are those of the bodies in a row, by identity."""
    return FixedRod(rod, offsets, h) if rod.axis is None else SlidingRod(rod, rod.axis, offsets, h)


class FixedRod(CorrectedRod):
    """Between two points of bodies, or from a point of the ground to one of a body."""

    __slots__ = ("_a", "_ax", "_ay", "_b", "_bx", "_by")

    def __init__(self, rod: Rod, offsets: Mapping[int, int], h: float) -> None:
        super().__init__(rod, h)
        assert rod.b is not None
        self._a = -1 if rod.a is None else offsets[rod.a.id]
        self._b = offsets[rod.b.id]
        self._ax, self._ay = rod.end_a
        self._bx, self._by = rod.end_b

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
            px, py = (
                px - h * (row[a + 3] - row[a + 5] * dy),
                py - h * (row[a + 4] + row[a + 5] * dx),
            )
        distance = math.hypot(x, y)
        along = (x * cx + y * cy) / distance
        across = (x * (py + cy) - y * (px + cx)) / distance
        expected = distance + (x * px + y * py) / distance + along
        return along + across * across / (math.hypot(expected, across) + expected)


class SlidingRod(CorrectedRod):
    """Across a line of a body (or of the ground), along which one end follows the other one."""

    __slots__ = ("_a", "_axis", "_b", "_end_a", "_end_b")

    def __init__(self, rod: Rod, axis: complex, offsets: Mapping[int, int], h: float) -> None:
        super().__init__(rod, h)
        self._a, self._b = (-1 if body is None else offsets[body.id] for body in (rod.a, rod.b))
        self._end_a, self._end_b = complex(*rod.end_a), complex(*rod.end_b)
        self._axis = axis

    def move_anchor(self, row: Row) -> None:
        """Move the end on the line to where the other end will be across from it after the next step."""
        self._end_a = self._foot(row, self._h)
        self.joint.anchor_a = (self._end_a.real, self._end_a.imag)

    def _foot(self, row: Row, h: float) -> complex:
        """The end on the line across from the other one, if both bodies keep their velocities for a while."""
        point = _predicted(row, self._b, h) + self._end_b * _turned(row, self._b, h)
        local = (point - _predicted(row, self._a, h)) * _turned(row, self._a, h).conjugate()
        along = ((local - self._end_a) * self._axis.conjugate()).real
        return self._end_a + along * self._axis

    def _stretch(self, row: Row, h: float) -> float:
        # With n across the line, d from foot to point and the line's rotation e: Re(conj(e n) d)
        # after the step.
        a, b = self._a, self._b
        normal = 1j * self._axis * _turned(row, a, 0.0)
        speed, bent = _advance(row, b, self._end_b, h)
        if a < 0:
            return (normal.conjugate() * bent).real
        speed_a, bent_a = _advance(row, a, self._foot(row, 0.0), h)
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


def _predicted(row: Row, k: int, h: float) -> complex:
    """Position of a body after a while at constant velocity; of the ground, its origin [m]."""
    return complex(row[k] + h * row[k + 3], row[k + 1] + h * row[k + 4]) if k >= 0 else 0j


def _turned(row: Row, k: int, h: float) -> complex:
    return cmath.exp(1j * (row[k + 2] + h * row[k + 5])) if k >= 0 else 1.0 + 0j


def _advance(row: Row, k: int, arm: complex, h: float) -> tuple[complex, complex]:
    """Velocity of a body's point [m/s], and the deviation of its arc from the tangent in a step [m]."""
    if k < 0:
        return 0j, 0j
    arm *= _turned(row, k, 0.0)
    dx, dy = arm.real, arm.imag
    turn = h * row[k + 5]
    inwards, behind = -2.0 * math.sin(turn / 2) ** 2, math.sin(turn) - turn
    bent = complex(inwards * dx - behind * dy, inwards * dy + behind * dx)
    return complex(row[k + 3], row[k + 4]) + 1j * row[k + 5] * arm, bent


def _arc(angle: float, turn: float, x: float, y: float) -> tuple[float, float, float, float]:
    """A body's local point from its centre, and the deviation of its arc from the tangent in a rotation [m]."""
    if x == 0.0 == y:
        return 0.0, 0.0, 0.0, 0.0
    c, s = math.cos(angle), math.sin(angle)
    dx, dy = c * x - s * y, s * x + c * y
    sine = math.sin(turn / 2)
    inwards, behind = -2.0 * sine * sine, math.sin(turn) - turn
    return dx, dy, inwards * dx - behind * dy, inwards * dy + behind * dx
