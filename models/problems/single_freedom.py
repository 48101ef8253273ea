"""Mechanisms of one degree of freedom without losses: their motion follows from the energy by quadrature.

With I(a) the inertia reduced to the coordinate a and V(a) the potential energy, I a'^2 / 2 + V = E,
so the time from one position to another is the integral of sqrt(I / (2 (E - V))) (e.g. Whittaker,
Analytical Dynamics, 1937, Ch. III).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.integrate import quad


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

    def slowness(a: float) -> float:
        return math.sqrt(inertia(a) / (2 * (energy - potential(a))))

    # Over a whole turn the integrand is periodic and smooth: pieces of a quarter turn are
    # integrated to rounding.
    pieces = max(1, math.ceil(abs(end - start) / (math.pi / 4)))
    knots = [start + (end - start) * k / pieces for k in range(pieces + 1)]
    parts = (quad(slowness, a, b, epsabs=0.0, epsrel=1e-13)[0] for a, b in pairwise(knots))
    return abs(math.fsum(parts))


def swing_period(
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

    knots = [math.pi * k / 16 for k in range(17)]
    return 2 * math.fsum(
        quad(slowness, a, b, epsabs=0.0, epsrel=1e-13)[0] for a, b in pairwise(knots)
    )
