"""Draws any mechanism from its description: bodies, and the symbols of its elements.

Bodies are beams, links, plates and masses, from their points, mass and inertia alone. An element
that the tables of symbols do not know is refused by name.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from ....models.arrays import FloatArray
from ....models.elements import (
    FORCE_ELEMENTS,
    GROUND,
    JOINTS,
    STOPS,
    AnyJoint,
    ConstantForce,
    ConstantTorque,
    CubicTorsionSpring,
    ElementTable,
    FreeJoint,
    PinJoint,
    PointStop,
    PrismaticJoint,
    RotationalSpringDamper,
    SlotJoint,
    SpringDamper,
    Stop,
    WeldJoint,
)
from ....models.mechanism import Body, Mechanism
from ....models.mjcf.appearance import distinct, loaded_rod, on_a_line
from .sketch import ROLES, Box, Drawing, Role, Shape, Sketch

_LEAST_SHARE = 0.01  # of a body's mass, below which a point mass in it is not drawn
_UNIFORM = 0.02  # by which the inertia of a rod may differ from a uniform one's


def add_bodies(sketch: Sketch) -> None:
    """All bodies, with sizes that compare their masses: widths and radii grow as the cube root."""
    parts = _Parts(sketch)
    for body in sketch.mechanism.bodies:
        parts.add(body)
    parts.draw()


@dataclass
class _Parts:
    """Beams, plates and point masses that bodies are drawn as."""

    sketch: Sketch
    beams: list[tuple[tuple[int, ...], float, bool]] = field(
        default_factory=list[tuple[tuple[int, ...], float, bool]]
    )
    """Points, mass [kg], and whether it is a plate."""
    masses: list[tuple[int, float]] = field(default_factory=list[tuple[int, float]])
    """Point and mass [kg]."""

    def add(self, body: Body) -> None:
        """A body, by what is known of it."""
        centre = complex(*body.centre)
        points = distinct(self.sketch.outlines[body.name], centre, self.sketch.size)
        if body.inertia == 0 or (not points and self._shows_no_turn(body, centre)):
            self._point_mass(body, points, centre)
        elif not points:
            self._wheel(body, centre)
        elif len(points) == 1:
            self._rod(body, points[0], centre)
        elif on_a_line(np.array([*points, centre])):
            self._loaded_rod(body, points, centre)
        else:
            self._plate(body, points, centre)

    def _shows_no_turn(self, body: Body, centre: complex) -> bool:
        """Whether a disc would say little: its joint holds its angle, or a stop its centre."""
        mechanism = self.sketch.mechanism
        stops = (stop for stop in mechanism.point_stops if stop.body == body.name)
        return mechanism.joint_of(body.name).holds_angle or any(
            complex(*stop.point) == centre for stop in stops
        )

    def _point_mass(self, body: Body, points: list[complex], centre: complex) -> None:
        """A mass on ropes or light links."""
        end = self.sketch.point(body.name, centre)
        for point in points:
            self.sketch.add(
                "line", "rope", (self.sketch.point(body.name, point), end), 0.004 * self.sketch.size
            )
        self.masses.append((end, body.mass))

    def _wheel(self, body: Body, centre: complex) -> None:
        """A uniform disc of the body's inertia, with a spoke that shows how it turns."""
        sketch = self.sketch
        radius = min(math.sqrt(2 * body.inertia / body.mass), sketch.size)
        middle, rim = sketch.point(body.name, centre), sketch.point(body.name, centre + radius)
        sketch.add("disc", "body", (middle,), radius)
        sketch.add("line", "centre", (middle, rim), 0.004 * sketch.size)
        self.centre(middle)

    def _rod(self, body: Body, point: complex, centre: complex) -> None:
        """A uniform rod of the body's inertia through its point; else a bob on a link."""
        half = math.sqrt(3 * body.inertia / body.mass)
        arm = centre - point
        if half >= abs(arm) * (1 - _UNIFORM):
            half = abs(arm) if half < abs(arm) * (1 + _UNIFORM) else half
            along = arm / abs(arm) * half
            ends = tuple(self.sketch.point(body.name, centre + sign * along) for sign in (-1, 1))
            self.beams.append((ends, body.mass, False))
            self.centre(self.sketch.point(body.name, centre))
            return
        ends = tuple(self.sketch.point(body.name, at) for at in (point, centre))
        self.sketch.add("line", "rope", ends, 0.006 * self.sketch.size)
        self.masses.append((ends[1], body.mass))

    def _loaded_rod(self, body: Body, points: list[complex], centre: complex) -> None:
        """A uniform rod with point masses at its ends, if the body is one; else a beam."""
        ends = _extremes([*points, centre])
        indices = tuple(self.sketch.point(body.name, end) for end in ends)
        shares = loaded_rod(body, *ends)
        if shares is None:
            self.beams.append((indices, body.mass, False))
            self.centre(self.sketch.point(body.name, centre))
            return
        self.beams.append((indices, shares[0] * body.mass, False))
        if shares[0] > 1 - _LEAST_SHARE:
            self.centre(self.sketch.point(body.name, centre))
        heavy = [
            (index, share)
            for index, share in zip(indices, shares[1:], strict=True)
            if share > _LEAST_SHARE
        ]
        self.masses += [(index, share * body.mass) for index, share in heavy]

    def _plate(self, body: Body, points: list[complex], centre: complex) -> None:
        corners = [*points, centre]
        hull = ConvexHull([(corner.real, corner.imag) for corner in corners]).vertices
        self.beams.append(
            (tuple(self.sketch.point(body.name, corners[k]) for k in hull), body.mass, True)
        )
        self.centre(self.sketch.point(body.name, centre))

    def centre(self, index: int) -> None:
        """The sign of a centre of mass."""
        self.sketch.add("disc", "centre", (index,), 0.005 * self.sketch.size * self._crowd)

    @property
    def _crowd(self) -> float:
        """Less than 1 where many bodies must find room."""
        return min(1.0, 9.0 / len(self.sketch.mechanism.bodies))

    def draw(self) -> None:
        """Add them as shapes, their sizes in proportion."""
        size, add = self.sketch.size * self._crowd, self.sketch.add
        widest = max((mass for _, mass, _ in self.beams), default=1.0)
        for points, mass, plate in self.beams:
            share = max(mass / widest, 0.0) ** (1 / 3) if widest > 0 else 0.0
            role: Role = "body" if share > 0.05 else "rope"
            add("area" if plate else "line", role, points, size * (0.006 + 0.012 * share))
        heaviest = max((mass for _, mass in self.masses), default=1.0)
        for index, mass in self.masses:
            add("disc", "mass", (index,), size * max(0.01, 0.04 * (mass / heaviest) ** (1 / 3)))


def _extremes(points: list[complex]) -> tuple[complex, complex]:
    """The two ends of points on a line."""
    far = max(points, key=lambda point: abs(point - points[0]))
    return max(points, key=lambda point: abs(point - far)), far


_TEETH = 9
_FAR = 0.4  # of the size: a wall that stays farther away is not drawn
_LEVEL = 0.1  # a ground's slot whose direction has less of gravity's is a track for a wheel


def _add_pin(sketch: Sketch, joint: PinJoint) -> None:
    """A disc, on a support where the pin is fixed to the ground."""
    index = sketch.point(joint.child, complex(*joint.child_point))
    sketch.add("disc", "joint", (index,), _unit(sketch) * 0.7)
    _add_support(sketch, joint)


def _unit(sketch: Sketch) -> float:
    """A hundredth of the whole, less where many bodies must find room [m]."""
    return 0.01 * sketch.size * min(1.0, 12.0 / len(sketch.mechanism.bodies))


def _add_support(sketch: Sketch, joint: AnyJoint) -> None:
    """A foot on hatched ground, where the joint's parent is the ground."""
    if joint.parent != GROUND:
        return
    at = complex(*joint.parent_point)
    unit, down = _unit(sketch), sketch.down
    side = 1j * down
    left, right = (
        sketch.point(GROUND, at + unit * (4 * down + sign * 2.4 * side)) for sign in (-1, 1)
    )
    sketch.add("area", "ground", (sketch.point(GROUND, at), left, right), 0.3 * unit)
    ends = (sketch.point(GROUND, at + unit * (4 * down + sign * 3.6 * side)) for sign in (-1, 1))
    sketch.add("hatch", "ground", tuple(ends), unit)


def _guide(sketch: Sketch, joint: SlotJoint | PrismaticJoint) -> tuple[complex, complex, complex]:
    """Direction of a joint's line, and the ends of what is drawn of it, in the parent's frame."""
    (axis,) = joint.free_directions
    a, b = sketch.guide(joint)
    beyond = 4 * _unit(sketch) * axis
    return axis, a - beyond, b + beyond


def _add_slider(sketch: Sketch, joint: PrismaticJoint) -> None:
    """A block between two rails."""
    unit = _unit(sketch)
    axis, a, b = _guide(sketch, joint)
    sketch.point(joint.child, complex(*joint.child_point))
    _add_rails(sketch, joint.parent, a, b, 1.6 * unit)
    corners = (sketch.point(joint.child, corner) for corner in _block(joint, axis, unit))
    sketch.add("area", "joint", tuple(corners), 0.3 * unit)


def _add_slot(sketch: Sketch, joint: SlotJoint) -> None:
    """A wheel on a level track of the ground, else a pin between two rails."""
    unit = _unit(sketch)
    axis, a, b = _guide(sketch, joint)
    pin = sketch.point(joint.child, complex(*joint.child_point))
    if joint.parent == GROUND and abs((axis.conjugate() * sketch.down).real) < _LEVEL:
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


def _add_wall(sketch: Sketch, stop: PointStop) -> tuple[int, int]:
    """A hatched line; returns the points at which the stop acts, and along its normal."""
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
    """A bracket beside the body's line at gap zero, on the side that the body cannot go to."""
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


def _add_force(sketch: Sketch, element: ConstantForce) -> None:
    """An arrow."""
    direction, at = complex(*element.force), complex(*element.point)
    if direction:
        arm = 10 * _unit(sketch) * direction / abs(direction)
        ends = sketch.point(element.body, at), sketch.point(element.body, at, GROUND, arm)
        sketch.add("arrow", "load", ends, 2.4 * _unit(sketch))


def _add_torque(sketch: Sketch, element: ConstantTorque) -> None:
    """An arc with a head."""
    if element.torque:
        centre, _, _ = _directions(sketch, element)
        sweep = math.copysign(4.4, element.torque)
        sketch.add("turn", "load", (centre,), 5 * _unit(sketch), ((sweep, 0.0),))


def _add_torsion_spring(
    sketch: Sketch, element: RotationalSpringDamper | CubicTorsionSpring
) -> None:
    """A spiral."""
    stiff = element.stiffness or getattr(element, "cubic_stiffness", 0.0)
    role: Role = "spring" if stiff else "damper"
    sketch.add("spiral", role, _directions(sketch, element), 6 * _unit(sketch))


def _directions(
    sketch: Sketch, element: RotationalSpringDamper | CubicTorsionSpring | ConstantTorque
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
    sides = (aside - width, aside + width)
    teeth = ((0.2 + 0.6 * (k + 0.5) / _TEETH, sides[k % 2]) for k in range(_TEETH))
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


def _add_nothing(sketch: Sketch, joint: FreeJoint) -> None:
    """A free joint holds nothing, so nothing is drawn."""


JOINT_SYMBOLS: ElementTable[Callable[[Sketch, Any], None]] = ElementTable(
    "the drawing",
    JOINTS,
    {
        PinJoint: _add_pin,
        WeldJoint: _add_support,
        SlotJoint: _add_slot,
        PrismaticJoint: _add_slider,
        FreeJoint: _add_nothing,
    },
)
STOP_SYMBOLS: ElementTable[Callable[[Sketch, Any], tuple[int, int]]] = ElementTable(
    "the drawing", STOPS, {Stop: _add_rest, PointStop: _add_wall}
)
FORCE_SYMBOLS: ElementTable[Callable[[Sketch, Any], None]] = ElementTable(
    "the drawing",
    FORCE_ELEMENTS,
    {
        SpringDamper: _add_spring_damper,
        RotationalSpringDamper: _add_torsion_spring,
        CubicTorsionSpring: _add_torsion_spring,
        ConstantForce: _add_force,
        ConstantTorque: _add_torque,
    },
)

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
        JOINT_SYMBOLS[joint](sketch, joint)
    stops = {stop.name: STOP_SYMBOLS[stop](sketch, stop) for stop in mechanism.stops}
    for element in mechanism.force_elements:
        FORCE_SYMBOLS[element](sketch, element)
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
    """Box around all that is drawn during the motion, but for stops far beside the rest."""
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
"""Number of a shape's points that are drawn; the others give directions. Not listed: all."""


def _reach(shape: Shape) -> float:
    """How far it extends from its points [m]."""
    if shape.kind in ("disc", "spiral", "wheel", "turn", "hatch"):
        return shape.size
    return max((abs(aside) for _, aside in shape.path), default=shape.size / 2)
