r"""How bouncing ends: infinitely many impacts by a finite time, of which the last are summed in closed form.

For 0 < e < 1 rebounds follow each other ever faster. Once they are short, what pulls the gap g back
is linear in time and in the gap's speed, g'' = -(a + j t + c g'), with t along the resting motion.
With rebound speed v after an impact at t, the series of the remaining flights sums, to first order
in j and c, to

    rest = t + tau (1 - tau (j / (3 a) + c / 6)),        tau = 2 v / (a (1 - e)).

The sum errs by the cube of tau over the motion's own time, and an impact is located to the rounding
of its gap over its
speed: the time of rest is taken where both are small (`_SUMMED`), while impacts are followed
further (`SETTLED`), so that states err by a rebound some 1e-13 times as high as the first fall.

Both limits are parts of one speed scale; from which speed on a stop rebounds is the rule of
:mod:`...models.rebound`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..models.arrays import FloatArray
from ..models.rebound import SETTLED, speed_scale
from .equations import Equations

_SUMMED = 1e-4  # of the speed scale, times 1 - e: the time of rest is taken from the first rebound that is slower


class Bouncing:
    """Restitution of the stops of one motion, and when each came to rest."""

    def __init__(self, equations: Equations) -> None:
        self.equations = equations
        self._restitution = {stop.name: stop.restitution for stop in equations.mechanism.stops}
        self.rest_times: dict[str, list[float]] = {name: [] for name in self._restitution}
        """By stop, the instants at which it ceased to bounce, or was met without rebound [s]."""
        self._energy = 0.0
        self._summed: dict[str, float] = {}

    def restitution(self, q: FloatArray, u: FloatArray, speeds: Mapping[str, float]) -> FloatArray:
        """What each touching stop's gap speed is multiplied with, 0 where it is met too slowly to rebound.

        Args:
            q, u: state before the impact, shape (n_q,).
            speeds: gap speeds by stop [its speed_unit].
        """
        self._energy = max(self._energy, float(self.equations.kinematics.kinetic_energy(q, u)))
        return np.array(
            [
                self._restitution[n] if v < -SETTLED * self._scale(n, q) else 0.0
                for n, v in speeds.items()
            ]
        )

    def note_impact(
        self,
        t: float,
        q: FloatArray,
        u: FloatArray,
        closed: Sequence[str],
        speeds: Mapping[str, float],
    ) -> None:
        """Note which of the stops that were met are at rest now, and when those that bounce will be.

        Args:
            t: when [s].
            q, u: the state after, shape (n_q,).
            closed: stops that are active after it.
            speeds: gap speeds before it, of stops that were not active.
        """
        self._summed = {name: rest for name, rest in self._summed.items() if set(speeds) == {name}}
        for name, speed in speeds.items():
            e = self._restitution[name]
            slow = 0.0 < e < 1.0 and e * abs(speed) < _SUMMED * (1.0 - e) * self._scale(name, q)
            if slow and name not in self._summed:
                self._summed[name] = t + self._remaining(name, q, u, closed, e, abs(speed))
            elif not slow:
                self._summed.pop(name, None)
            if name in closed:
                self.rest_times[name].append(self._summed.pop(name, t))

    def interrupt(self) -> None:
        """Forget what was summed: another stop has opened."""
        self._summed.clear()

    def _scale(self, name: str, q: FloatArray) -> float:
        row = self._row(name, q)
        return speed_scale(self._energy, float(row @ self.equations.response(q, row)))

    def _row(self, name: str, q: FloatArray) -> FloatArray:
        return self.equations.kinematics.gap_jacobian(name, q)

    def _remaining(
        self, name: str, q: FloatArray, u: FloatArray, closed: Sequence[str], e: float, speed: float
    ) -> float:
        """Time that the remaining rebounds take of a stop met with a gap speed [s]; 0 if nothing pulls back."""
        others = tuple(other for other in closed if other != name)
        row = self._row(name, q)
        response = self.equations.response(q, row)
        along = response / (
            row @ response
        )  # speeds that an impulse of the stop causes, for a gap speed of 1
        resting = u - along * (row @ u)
        pull = self._pull(name, q, resting, others)
        if pull <= 0.0:
            return 0.0
        tau = 2.0 * e * speed / (pull * (1.0 - e))
        acceleration = self.equations.solve(q, resting, (*others, name))[0]
        later = self._pull(name, q + tau * resting, resting + tau * acceleration, others)
        up, down = (
            self._pull(name, q, resting + sign * speed * along, others) for sign in (1.0, -1.0)
        )
        return tau * (1.0 - (later - pull) / (3.0 * pull) - tau * (up - down) / (12.0 * speed))

    def _pull(self, name: str, q: FloatArray, u: FloatArray, others: Sequence[str]) -> float:
        """The gap's acceleration towards zero without the stop, the others being active."""
        free = self.equations.solve(q, u, others)[0]
        return -float(self._row(name, q) @ free + self.equations.kinematics.gap_bias(name, q, u))
