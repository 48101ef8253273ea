"""Least speed of a rebound: one rule for the reference and for adapters with impacts.

With 0 < e < 1 rebounds follow each other ever faster without an end. A stop that is met more slowly
than `SETTLED` of a speed scale does not rebound (e = 0 there). The scale is sqrt(2 T A): how fast
the gap could move with the largest kinetic energy T that the mechanism has had at an impact, A
being the inverse inertia that the stop meets. It has the unit of the gap's speed, so no unit,
length, mass or gravity matters.
"""

from __future__ import annotations

import math

import numpy as np

from .arrays import FloatArray
from .kinematics import Kinematics
from .mechanism import Mechanism

SETTLED = (
    5e-7  # of the speed scale: rebounds that are left out are 1e-13 times as high as the first fall
)


def speed_scale(energy: float, inverse_inertia: float) -> float:
    """Speed of a gap [rad/s, m/s] that would take all of an energy [J]."""
    return math.sqrt(2.0 * energy * max(inverse_inertia, 0.0))


class Rebounds:
    """Least speeds at which the stops of one motion rebound."""

    def __init__(self, mechanism: Mechanism) -> None:
        self._kinematics = Kinematics(mechanism)
        self._energy = 0.0

    def note_impact(self, q: FloatArray, u: FloatArray) -> None:
        """Take the state before an impact into account, each of shape (n_q,)."""
        self._energy = max(self._energy, float(self._kinematics.kinetic_energy(q, u)))

    def least_speed(self, stop: str, q: FloatArray, u: FloatArray | None = None) -> float:
        """Closing speed of a stop's gap below which it does not rebound [rad/s, m/s].

        Args:
            stop: its name.
            q: position, shape (n_q,).
            u: speeds there, to be taken into account without an impact.
        """
        now = 0.0 if u is None else float(self._kinematics.kinetic_energy(q, u))
        return SETTLED * speed_scale(max(self._energy, now), self._inverse_inertia(stop, q))

    def _inverse_inertia(self, stop: str, q: FloatArray) -> float:
        """Speed of a gap by a unit impulse of its stop, loops kept closed [1/(kg m^2), 1/kg]."""
        row, loops = self._kinematics.gap_jacobian(stop, q), self._kinematics.loop_jacobian(q)
        n, m = len(row), len(loops)
        mass, system = self._mass_matrix(q), np.zeros((n + m, n + m))
        size = float(np.abs(mass).max())
        system[:n, :n], system[n:, :n], system[:n, n:] = mass / size, loops, loops.T
        # Loops may be redundant: the motion is unique all the same.
        response = np.linalg.lstsq(system, np.append(row / size, np.zeros(m)))[0][:n]
        return float(row @ response)

    def _mass_matrix(self, q: FloatArray) -> FloatArray:
        k = self._kinematics
        jacobian = k.gradient(k.centres, q, k.rates(q))
        return ((jacobian.conj().T * k.masses) @ jacobian).real + np.diag(k.inertias)
