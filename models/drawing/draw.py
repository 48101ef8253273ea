"""The drawing of any mechanism from its description, for one motion of it."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..mechanism import Mechanism
from .bodies import add_bodies
from .shapes import ROLES, Box, Drawing, Shape
from .sketch import Sketch
from .symbols import add_force_element, add_joint, add_stop

_MARGIN = 0.03  # around the motion, in parts of its size
_BESIDE = 0.1  # of the size, by which stops widen the view at most


def draw(mechanism: Mechanism, q: FloatArray | None = None) -> Drawing:
    """Draw a mechanism.

    Args:
        mechanism: any.
        q: its motion, shape (n, n_q), from which the view and the lengths of guides and walls
            follow; the start where left out.
    """
    q = np.array([mechanism.start], dtype=np.float64) if q is None else q
    sketch = Sketch(mechanism, q)
    joints = {j.name: sketch.point(j.child, complex(*j.child_point)) for j in mechanism.joints}
    add_bodies(sketch)
    for joint in mechanism.joints:
        add_joint(sketch, joint)
    stops = {stop.name: add_stop(sketch, stop) for stop in mechanism.stops}
    for element in mechanism.force_elements:
        add_force_element(sketch, element)
    markers = {
        marker.name: sketch.point(marker.body, complex(*marker.point))
        for marker in mechanism.markers
    }
    for index in markers.values():
        sketch.add("disc", "marker", (index,), 0.004 * sketch.size)
    centres = tuple(sketch.point(body.name, complex(*body.centre)) for body in mechanism.bodies)
    compared = tuple(dict.fromkeys(markers.values())) or centres
    shapes = tuple(sorted(sketch.shapes, key=lambda shape: ROLES.index(shape.role)))
    box = _box(sketch, shapes)
    return Drawing(
        mechanism, tuple(sketch.points), shapes, markers, compared, joints, stops, box, sketch.size
    )


def _box(sketch: Sketch, shapes: tuple[Shape, ...]) -> Box:
    """Around all that is drawn, during the whole motion; of stops only what is not far beside the rest."""
    xy = sketch.positions()
    least, most = xy.min(axis=0), xy.max(axis=0)
    low, high = _around([shape for shape in shapes if shape.role != "stop"], least, most)
    if any(shape.role == "stop" for shape in shapes):
        beside = _around([shape for shape in shapes if shape.role == "stop"], least, most)
        low = np.maximum(np.minimum(low, beside[0]), low - _BESIDE * sketch.size)
        high = np.minimum(np.maximum(high, beside[1]), high + _BESIDE * sketch.size)
    margin = _MARGIN * sketch.size
    return (
        float(low[0] - margin),
        float(low[1] - margin),
        float(high[0] + margin),
        float(high[1] + margin),
    )


def _around(
    shapes: list[Shape], least: FloatArray, most: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Corners of the box around shapes, from the least and greatest positions of the points."""
    drawn = [(i, _reach(shape)) for shape in shapes for i in shape.points[: _ENDS.get(shape.kind)]]
    indices, reach = [i for i, _ in drawn], np.array([[r] for _, r in drawn])
    return (least[indices] - reach).min(axis=0), (most[indices] + reach).max(axis=0)


_ENDS = {"disc": 1, "spiral": 1, "wheel": 1, "turn": 1}
"""How many of a shape's points are drawn themselves; all of those not listed. The others give directions."""


def _reach(shape: Shape) -> float:
    """How far it extends from its points [m]."""
    if shape.kind in ("disc", "spiral", "wheel", "turn", "hatch"):
        return shape.size
    return max((abs(aside) for _, aside in shape.path), default=shape.size / 2)
