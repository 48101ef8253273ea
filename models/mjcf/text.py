"""Numbers, vectors and elements as MJCF text."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from ..spec import Vector


def number(value: float) -> str:
    """The shortest decimal that reads back to the same float64."""
    text = repr(float(value) + 0.0)  # + 0.0 turns -0.0 into 0.0
    return text.removesuffix(".0")


def numbers(*values: float) -> str:
    """Several numbers, as :func:`number`, with blanks between them."""
    return " ".join(number(value) for value in values)


def spatial(vector: Vector) -> str:
    """A planar vector in MuJoCo's x-z plane."""
    return numbers(vector[0], 0, vector[1])


def from_origin(origin: Vector, point: Vector) -> str:
    """A point as seen from a frame's origin, both in that frame's axes."""
    return spatial((point[0] - origin[0], point[1] - origin[1]))


def as_text(root: ET.Element) -> str:
    """An element and all below it, indented."""
    ET.indent(root, space="  ")
    return ET.tostring(root, encoding="unicode") + "\n"
