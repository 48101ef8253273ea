"""Shapes of bodies from their points, mass and inertia, for drawings and MJCF's looks."""

from __future__ import annotations

import numpy as np

from .arrays import ComplexArray
from .mechanism import Body


def distinct(points: list[complex], centre: complex, size: float) -> list[complex]:
    """Those of the points that are not the centre."""
    return [point for point in points if abs(point - centre) > 1e-9 * size]


def on_a_line(points: ComplexArray) -> bool:
    """Whether points lie on one straight line."""
    spread = np.stack([points.real, points.imag], axis=1)
    values = np.linalg.svd(spread - spread.mean(axis=0), compute_uv=False)
    return bool(values[-1] <= 1e-9 * values[0])


def loaded_rod(body: Body, a: complex, b: complex) -> tuple[float, float, float] | None:
    """Mass of a uniform rod from a to b and of points at a and b, in parts of a body's.

    Mass, centre and inertia of the three are the body's; None where that needs a negative mass.
    """
    length = abs(b - a)
    middle = ((complex(*body.centre) - a) / (b - a)).real
    inertia = body.inertia / (body.mass * length**2) + middle**2
    # mass, first and second moment about a, all in parts of the body's mass and the length
    moments = np.array([[1.0, 1.0, 1.0], [0.5, 0.0, 1.0], [1 / 3, 0.0, 1.0]])
    rod, at_a, at_b = np.linalg.solve(moments, [1.0, middle, inertia])
    return None if min(rod, at_a, at_b) < -1e-6 else (float(rod), float(at_a), float(at_b))
