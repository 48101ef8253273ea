r"""Infinitely many impacts of one stop in a finite time, after which it stays closed.

After an impact with the restitution e the gap opens with a speed v. As long as its acceleration is
within [-A, -a], a > 0, each flight lasts between 2 v / A and 2 v / a and ends with a speed between
v sqrt(a / A) and v sqrt(A / a); the next one begins with e times that. With r = sqrt(A / a) and
e r < 1 all flights together last

    2 v / (A (1 - e / r)) <= T <= 2 v / (a (1 - e r)),

and the impacts change the gap's speed by no more than S = (1 + e) r v / (1 - e r) in all (for
constant acceleration, A = a: Brogliato, *Nonsmooth Mechanics*, 3rd ed., 2016, ch. 1). So far the
state comes; where it is within a box over which A and a are taken, no motion leaves the box. At
the end the gap has no speed, which says how much the impacts have changed all speeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from .balls import Ball, arb, between
from .tape import Tape

_TRIALS = 12  # of a box, each wider
_WIDER = 1.25
_LONGEST = 1e-3  # time that the flights may last [s]; boxes over more are wide


class Rest(NamedTuple):
    """The end of a sequence of impacts."""

    time: Ball
    """Since the impact [s]."""
    q: list[Ball]
    u: list[Ball]


@dataclass(frozen=True)
class Impacts:
    """Impacts of one stop, without another that is closed.

    Args:
        flight: accelerations, the gap's speed, and functions that must not pass zero meanwhile.
        jump: changes of the speeds in an impact without rebound.
        numbers: of the mechanism.
        restitution: e, between 0 and 1.
    """

    flight: Tape
    jump: Tape
    numbers: Sequence[Ball]
    restitution: float

    def rest(self, q: list[Ball], u: list[Ball]) -> Rest | None:
        """Enclose the time and the state in which the gap comes to rest; None: it may not.

        Args:
            q, u: after an impact.
        """
        e, (_, speed, rate, _) = self.restitution, self._flight(q, u)
        if not (0.0 < e < 1.0 and speed > 0 and rate < 0 and 2 * speed < -rate * _LONGEST):
            return None
        # A direction in which the gap opens with a speed of one.
        along = [(-x / speed).mid() for x in self.jump.values(self.numbers, q, u)]
        box = q, u
        for _ in range(_TRIALS):
            reached = self._reached(q, u, speed, box, along)
            if reached is None:
                return None
            inside, rest = reached
            pairs = [*zip(box[0], inside[0], strict=True), *zip(box[1], inside[1], strict=True)]
            if all(b.contains(x) for b, x in pairs):
                return rest
            wider = [[x.mid() + (x - x.mid()) * _WIDER for x in part] for part in inside]
            box = wider[0], wider[1]
        return None

    def _reached(
        self,
        q: list[Ball],
        u: list[Ball],
        speed: Ball,
        box: tuple[list[Ball], list[Ball]],
        along: list[Ball],
    ) -> tuple[tuple[list[Ball], list[Ball]], Rest] | None:
        """States that are come to as long as they are in a box, and the last one of them.

        Args:
            q, u, speed: after the impact, and of the gap.
            box: of coordinates and speeds.
            along: speeds with which the gap opens.
        """
        e, (accelerations, _, rate, functions) = self.restitution, self._flight(*box)
        opening = self._gap_speed(box[0], along)
        if not (rate < 0 and opening > 0) or any(x.contains(0) for x in functions):
            return None
        least, most = -rate.upper(), -rate.lower()
        r = (most / least).sqrt()
        if not e * r < 1:
            return None
        longest = (2 * speed / (least * (1 - e * r))).upper()
        shortest = (2 * speed / (most * (1 - e / r))).lower()
        change = ((1 + e) * r * speed / (1 - e * r)).upper()
        changes = self.jump.values(self.numbers, box[0], along)
        direction = [-x / opening for x in changes]
        until, by = between(arb(0), longest), between(arb(0), change)
        q_inside = [x + until * v for x, v in zip(q, box[1], strict=True)]
        u_inside = [
            v + until * a + by * d for v, a, d in zip(u, accelerations, direction, strict=True)
        ]
        time = between(shortest, longest)
        q_end = [x + time * v for x, v in zip(q, box[1], strict=True)]
        fallen = [v + time * a for v, a in zip(u, accelerations, strict=True)]
        left = self._gap_speed(q_end, fallen) / self._gap_speed(q_end, direction)
        u_end = [v - left * d for v, d in zip(fallen, direction, strict=True)]
        return (q_inside, u_inside), Rest(time, q_end, u_end)

    def _flight(self, q: list[Ball], u: list[Ball]) -> tuple[list[Ball], Ball, Ball, list[Ball]]:
        """Accelerations, speed and acceleration of the gap, and the functions."""
        expansion = self.flight.expand(self.numbers, q, u, 1)
        series = [expansion.output(i) for i in range(len(self.flight.outputs))]
        n = len(q)
        return (
            [x[0] for x in series[:n]],
            series[n][0],
            series[n][1],
            [x[0] for x in series[n + 1 :]],
        )

    def _gap_speed(self, q: list[Ball], u: list[Ball]) -> Ball:
        return self.flight.values(self.numbers, q, u)[len(q)]
