"""Closed forms of a pendulum's motion, by Jacobi's elliptic functions.

With psi the angle from the lowest position and omega^2 = (mass times centre's distance times
gravity) / (inertia about the pivot), psi'' = -omega^2 sin psi. E.g. Whittaker, Analytical Dynamics
(1937), Ch. IV. What moves like a pendulum (a trammel, a parallelogram's cranks) has the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import quad
from scipy.special import ellipj, ellipkm1

from ..arrays import FloatArray
from .benchmark import KnownValue, coordinate, path_figure, period

LOWEST = math.pi / 2  # [rad] angle of a link that hangs straight down


def swing_period(omega: float, amplitude: float) -> float:
    """Period of a swing [s].

    Args:
        omega: of small swings [rad/s].
        amplitude: from the lowest position, below pi [rad].
    """
    return 4.0 * float(ellipkm1(math.cos(amplitude / 2) ** 2)) / omega


def swing(omega: float, amplitude: float, t: FloatArray) -> FloatArray:
    """Angle from the lowest position at times t [s], let go at `amplitude` [rad], shape (n,)."""
    modulus = math.sin(amplitude / 2)
    _, cn, dn, _ = ellipj(omega * t, modulus**2)
    return np.asarray(2.0 * np.arcsin(np.clip(modulus * cn / dn, -1.0, 1.0)), dtype=np.float64)


def turn_period(omega: float, top_speed: float) -> float:
    """Time of a turn of a pendulum that goes over the top [s].

    Args:
        omega: of small swings [rad/s].
        top_speed: in the highest position [rad/s].
    """
    bottom = math.sqrt(top_speed**2 + 4.0 * omega**2)
    return 4.0 * float(ellipkm1((top_speed / bottom) ** 2)) / bottom


def turn(omega: float, top_speed: float, t: FloatArray) -> FloatArray:
    """Angle since the highest position at times t [s] of a turning pendulum, shape (n,)."""
    bottom = math.sqrt(top_speed**2 + 4.0 * omega**2)
    half = turn_period(omega, top_speed) / 2.0
    # From the lowest position it is 2 am(bottom t / 2); the quarter period of am is half a turn.
    _, _, _, amplitude = ellipj(bottom * (t - half) / 2.0, (2.0 * omega / bottom) ** 2)
    return np.asarray(2.0 * amplitude + math.pi, dtype=np.float64)


@dataclass(frozen=True)
class Swing:
    """The motion of what is let go from rest and moves like a pendulum."""

    angle: str
    """Name of the coordinate."""
    omega: float
    """Frequency of small swings [rad/s]."""
    amplitude: float
    """From the lowest position [rad]."""
    lowest: float = LOWEST
    """The coordinate in the lowest position [rad]."""

    @property
    def period(self) -> float:
        """[s]."""
        return swing_period(self.omega, self.amplitude)

    def at(self, t: FloatArray) -> FloatArray:
        """The coordinate at times t [s], shape (n,) [rad]."""
        return self.lowest + swing(self.omega, self.amplitude, t)

    def figures(
        self, end: float, time_tolerance: float, angle_tolerance: float
    ) -> tuple[KnownValue, ...]:
        """Its period and its path up to `end` [s], with their tolerances [s, rad]."""
        quantity, name = coordinate(self.angle), "largest error of the angle"
        read = period(quantity, self.lowest, end)
        return (
            KnownValue("period", self.period, "s", time_tolerance, read),
            path_figure(name, "rad", angle_tolerance, quantity, self.at, end),
        )


def time_between(
    start: float,
    end: float,
    start_speed: float,
    inertia: Callable[[float], float],
    potential: Callable[[float], float],
) -> float:
    """Time of a motion that does not turn back [s].

    Args:
        start, end: of the coordinate [rad or m].
        start_speed: of the coordinate, not zero.
        inertia: reduced to the coordinate [kg m^2 or kg].
        potential: energy [J].
    """
    energy = inertia(start) * start_speed**2 / 2 + potential(start)
    # Over a whole turn the integrand is periodic and smooth: pieces of a quarter turn are
    # integrated to rounding.
    pieces = max(1, math.ceil(abs(end - start) / (math.pi / 4)))
    knots = [start + (end - start) * k / pieces for k in range(pieces + 1)]
    return abs(_integral(lambda a: math.sqrt(inertia(a) / (2 * (energy - potential(a)))), knots))


def slow_swing_period(
    middle: float, amplitude: float, most: float, inertia: Callable[[float], float]
) -> float:
    """Period of a swing in the potential -most cos(a - middle) [s].

    With a = middle + amplitude cos(c) and the difference of the cosines as a product, what vanishes
    at the turning points cancels: the integrand over c is smooth.

    Args:
        middle: lowest position [rad].
        amplitude: of the swing, below pi [rad].
        most: amplitude of the potential energy [J].
        inertia: reduced to the coordinate [kg m^2].
    """

    def slowness(c: float) -> float:
        # (1 - cos(c)) / 2 and (1 + cos(c)) / 2 of the amplitude are left to the two turning points.
        left = np.sinc(amplitude / math.pi * np.array([math.sin(c / 2) ** 2, math.cos(c / 2) ** 2]))
        return math.sqrt(inertia(middle + amplitude * math.cos(c)) / (most * float(left.prod())))

    return 2 * _integral(slowness, [math.pi * k / 16 for k in range(17)])


def _integral(function: Callable[[float], float], knots: list[float]) -> float:
    pieces = pairwise(knots)
    return math.fsum(quad(function, a, b, epsabs=0.0, epsrel=1e-13)[0] for a, b in pieces)
