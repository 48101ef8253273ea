"""Shapes as polylines in the plane, as the script of an animation (assets/animation.js) draws them."""

from __future__ import annotations

import cmath
import math

import numpy as np

from ..arrays import ComplexArray
from .shapes import Shape

_MOST_HATCHES = 400


def polylines(shape: Shape, z: ComplexArray) -> list[ComplexArray]:
    """The lines of a shape [m], x + i y; of a disc and the rim of a wheel none, for they are circles.

    Args:
        shape: but for arrows and turns.
        z: positions of the shape's points.
    """
    if shape.kind == "area":
        return [np.append(z, z[0])]
    if shape.kind == "line":
        return [z]
    if shape.kind == "between":
        return [_between(shape, *z)]
    if shape.kind == "spiral":
        return [np.asarray(_spiral(shape.size, *z))]
    if shape.kind == "wheel":
        return _spokes(shape.size, *z)
    return _hatch(shape.size, *z) if shape.kind == "hatch" else []


def _between(shape: Shape, a: complex, b: complex) -> ComplexArray:
    way = np.array(shape.path)
    length = abs(b - a) or math.inf
    return a + way[:, 0] * (b - a) + 1j * way[:, 1] * (b - a) / length


def _spiral(size: float, centre: complex, a: complex, b: complex) -> ComplexArray:
    start = cmath.phase(a - centre)
    part = np.linspace(0.0, 1.0, 61)
    sweep = cmath.phase(b - centre) - start + 4 * math.pi
    return np.asarray(
        centre + size * (0.25 + 0.75 * part) * np.exp(1j * (start + sweep * part)),
        dtype=np.complex128,
    )


def _spokes(size: float, centre: complex, origin: complex, along: complex) -> list[ComplexArray]:
    direction = (along - origin) / abs(along - origin)
    rolled = ((centre - origin) * direction.conjugate()).real / size
    arms = (0.92 * size * cmath.exp(1j * (k * math.pi / 3 - rolled)) for k in range(3))
    return [np.array([centre - arm, centre + arm]) for arm in arms]


def _hatch(size: float, a: complex, b: complex) -> list[ComplexArray]:
    length = abs(b - a)
    count = min(max(round(length / size), 1), _MOST_HATCHES)
    stroke = 0.75 * size * (1 + 1j) * (b - a) / (length or 1.0)
    feet = (a + (k + 1) / count * (b - a) for k in range(count))
    return [np.array([a, b]), *(np.array([foot, foot - stroke]) for foot in feet)]
