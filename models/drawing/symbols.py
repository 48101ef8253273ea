"""Symbols of joints, stops and force elements."""

from __future__ import annotations

import cmath
import math

from ..force_elements import ConstantForce, ConstantTorque, RotationalSpringDamper, SpringDamper
from ..joints import GROUND, AnyJoint, FreeJoint, PinJoint, PrismaticJoint
from ..stops import PointStop, Stop
from .sketch import Sketch

_TEETH = 9
_FAR = 0.4  # of the size: a wall that stays farther away is not drawn
_LEVEL = 0.1  # a ground's slot whose direction has less of gravity's is a track for a wheel


def add_joint(sketch: Sketch, joint: AnyJoint) -> None:
    """A pin with its support, a slot or guide over the length that the motion uses; nothing where nothing is held."""
    if isinstance(joint, FreeJoint):
        return
    if joint.free_directions:
        _add_guide(sketch, joint)
    elif isinstance(joint, PinJoint):
        index = sketch.point(joint.child, complex(*joint.child_point))
        sketch.add("disc", "joint", (index,), _unit(sketch) * 0.7)
    if joint.parent == GROUND and not joint.free_directions:
        _add_support(sketch, complex(*joint.parent_point))


def _unit(sketch: Sketch) -> float:
    """A hundredth of the whole, less where many bodies must find room [m]."""
    return 0.01 * sketch.size * min(1.0, 12.0 / len(sketch.mechanism.bodies))


def _add_support(sketch: Sketch, at: complex) -> None:
    """A foot on hatched ground."""
    unit, down = _unit(sketch), sketch.down
    side = 1j * down
    left, right = (
        sketch.point(GROUND, at + unit * (4 * down + sign * 2.4 * side)) for sign in (-1, 1)
    )
    sketch.add("area", "ground", (sketch.point(GROUND, at), left, right), 0.3 * unit)
    ends = (sketch.point(GROUND, at + unit * (4 * down + sign * 3.6 * side)) for sign in (-1, 1))
    sketch.add("hatch", "ground", tuple(ends), unit)


def _add_guide(sketch: Sketch, joint: AnyJoint) -> None:
    (axis,) = joint.free_directions
    unit = _unit(sketch)
    a, b = sketch.guide(joint)
    a, b = a - 4 * unit * axis, b + 4 * unit * axis
    pin = sketch.point(joint.child, complex(*joint.child_point))
    if isinstance(joint, PrismaticJoint):
        _add_rails(sketch, joint.parent, a, b, 1.6 * unit)
        corners = _block(joint, axis, unit)
        sketch.add(
            "area",
            "joint",
            tuple(sketch.point(joint.child, corner) for corner in corners),
            0.3 * unit,
        )
    elif joint.parent == GROUND and abs((axis.conjugate() * sketch.down).real) < _LEVEL:
        _add_track(sketch, pin, (a, b), complex(*joint.parent_point))
    else:
        _add_rails(sketch, joint.parent, a, b, 1.1 * unit)
        sketch.add("disc", "joint", (pin,), unit)


def _add_rails(sketch: Sketch, body: str, a: complex, b: complex, apart: float) -> None:
    """Two lines beside the line from a to b."""
    across = 1j * (b - a) / abs(b - a) * apart
    for side in (-across, across):
        ends = sketch.point(body, a + side), sketch.point(body, b + side)
        sketch.add("line", "guide", ends, 0.3 * _unit(sketch))


def _block(joint: PrismaticJoint, axis: complex, unit: float) -> list[complex]:
    """Corners of a slider, in the frame of the child."""
    along = axis * cmath.exp(1j * joint.angle) * unit
    at = complex(*joint.child_point)
    return [at + along * complex(2.6 * x, 1.3 * y) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def _add_track(sketch: Sketch, pin: int, ends: tuple[complex, complex], zero: complex) -> None:
    """A wheel on level ground."""
    unit, (a, b) = _unit(sketch), ends
    radius = 2.2 * unit
    # the strokes of the hatch are on the right-hand side of its line: below
    below = -1j * (b - a)
    a, b = (a, b) if (below.conjugate() * sketch.down).real > 0 else (b, a)
    track = tuple(sketch.point(GROUND, end + radius * sketch.down) for end in (a, b))
    sketch.add("hatch", "ground", track, 1.4 * unit)
    sketch.add(
        "wheel",
        "joint",
        (pin, sketch.point(GROUND, zero), sketch.point(GROUND, zero + (b - a))),
        radius,
    )


def add_stop(sketch: Sketch, stop: Stop | PointStop) -> tuple[int, int]:
    """A rest that turns with the other body, or a wall; the points at which it acts, and along its normal."""
    return _add_wall(sketch, stop) if isinstance(stop, PointStop) else _add_rest(sketch, stop)


def _add_wall(sketch: Sketch, stop: PointStop) -> tuple[int, int]:
    normal, unit = complex(*stop.normal), _unit(sketch)
    along = -1j * normal
    reached = sketch.component(along, stop.relative_to, stop.body, stop.point)
    low, high = (float(end) for end in (reached.min() - 12 * unit, reached.max() + 12 * unit))
    ends = (
        sketch.point(stop.relative_to, normal * stop.offset + along * end) for end in (low, high)
    )
    points = tuple(ends)
    if sketch.kinematics.gaps[stop.name].value(sketch.q).min() < _FAR * sketch.size:
        sketch.add("hatch", "stop", points, 1.4 * unit, stop=stop.name)
    at = complex(*stop.point)
    return sketch.point(stop.body, at), sketch.point(
        stop.body, at, stop.relative_to, normal * sketch.size
    )


def _add_rest(sketch: Sketch, stop: Stop) -> tuple[int, int]:
    """A bracket beside where the body's line stands when the gap is zero, on the side it cannot go to."""
    pivot, _ = sketch.hinge(stop.body, stop.relative_to)
    arms = [
        at - pivot
        for at in (*sketch.outlines[stop.body], complex(*sketch.mechanism.body(stop.body).centre))
    ]
    arm = max(arms, key=abs, default=0j)
    length, unit = abs(arm), _unit(sketch)
    reach = min(9 * unit, 0.6 * length) if length > 0 else 9 * unit
    contact = (arm / length if length > 0 else 1.0) * cmath.exp(-1j * stop.sense * stop.limit)
    away = 1j * stop.sense * contact * unit
    corners = (
        contact * reach * 0.35 + away,
        contact * reach + away,
        contact * reach * 0.95 + 2.6 * away,
    )
    points = tuple(sketch.point(stop.body, pivot, stop.relative_to, corner) for corner in corners)
    sketch.add("area", "stop", points, 0.3 * unit, stop=stop.name)
    at = sketch.point(stop.body, pivot)
    return at, at


def add_force_element(
    sketch: Sketch, element: SpringDamper | RotationalSpringDamper | ConstantForce | ConstantTorque
) -> None:
    """A spring, a damper, or the arrow of a constant force or torque."""
    unit = _unit(sketch)
    if isinstance(element, SpringDamper):
        _add_spring_damper(sketch, element)
    elif isinstance(element, ConstantForce):
        direction = complex(*element.force)
        if direction:
            tail = sketch.point(element.body, complex(*element.point))
            tip = sketch.point(
                element.body,
                complex(*element.point),
                GROUND,
                10 * unit * direction / abs(direction),
            )
            sketch.add("arrow", "load", (tail, tip), 2.4 * unit)
    elif isinstance(element, ConstantTorque):
        if element.torque:
            centre, _, _ = _directions(sketch, element)
            sketch.add(
                "turn", "load", (centre,), 5 * unit, ((math.copysign(4.4, element.torque), 0.0),)
            )
    else:
        role = "spring" if element.stiffness else "damper"
        sketch.add("spiral", role, _directions(sketch, element), 6 * unit)


def _directions(
    sketch: Sketch, element: RotationalSpringDamper | ConstantTorque
) -> tuple[int, int, int]:
    """Where two bodies turn against each other, and a point beyond it along each frame's x axis."""
    pivot, _ = sketch.hinge(element.body, element.relative_to)
    other, own = (
        sketch.point(element.body, pivot, frame, sketch.size)
        for frame in (element.relative_to, element.body)
    )
    return sketch.point(element.body, pivot), other, own


def _add_spring_damper(sketch: Sketch, element: SpringDamper) -> None:
    ends = (
        sketch.point(element.relative_to, complex(*element.relative_point)),
        sketch.point(element.body, complex(*element.point)),
    )
    width, line = 1.4 * _unit(sketch), 0.35 * _unit(sketch)
    both = element.stiffness > 0 and element.damping > 0
    if element.stiffness > 0 or not element.damping:
        sketch.add("between", "spring", ends, line, _zigzag(width, width * 1.3 if both else 0.0))
    if element.damping > 0:
        for path in _dashpot(0.8 * width, -width * 1.3 if both else 0.0):
            sketch.add("between", "damper", ends, line, path)


def _zigzag(width: float, aside: float) -> tuple[tuple[float, float], ...]:
    teeth = (
        (0.2 + 0.6 * (k + 0.5) / _TEETH, aside + (width if k % 2 else -width)) for k in range(_TEETH)
    )  # fmt: skip
    return (
        (0, 0),
        (0.1, 0),
        (0.1, aside),
        (0.2, aside),
        *teeth,
        (0.8, aside),
        (0.9, aside),
        (0.9, 0),
        (1, 0),
    )


def _dashpot(width: float, aside: float) -> tuple[tuple[tuple[float, float], ...], ...]:
    """Rod and piston, and the cylinder."""
    up, down = aside + width, aside - width
    rod = (
        (0, 0),
        (0.1, 0),
        (0.1, aside),
        (0.5, aside),
        (0.5, aside + 0.7 * width),
        (0.5, aside - 0.7 * width),
    )
    cylinder = ((0.35, up), (0.65, up), (0.65, aside), (0.9, aside), (0.9, 0), (1, 0))
    return rod, cylinder, ((0.65, aside), (0.65, down), (0.35, down))
