"""Draws any mechanism from its description: points that move with bodies, and shapes over them.

Every renderer (canvas in a page, Matplotlib for files) draws the same shapes from the positions of
the points alone. So the drawing of a run with magnified deviations is that of the points z + k (z'
- z), z the reference's and z' the run's.

Bodies are beams, links, plates and masses, from their points, mass and inertia alone. An element
that the tables of symbols do not know is refused by name.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
from scipy.spatial import ConvexHull

from ....models.arrays import ComplexArray, FloatArray, as_vectors
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
    RecordedForce,
    RecordedTorque,
    RotationalSpringDamper,
    RotorInertia,
    SlideInertia,
    SlideSpringDamper,
    SlotJoint,
    SpringDamper,
    Stop,
    TranslationJoint,
    WeldJoint,
)
from ....models.kinematics import Kinematics, PointCoefficients
from ....models.mechanism import Body, Mechanism
from ....models.mjcf.appearance import distinct, loaded_rod, on_a_line
from ....models.spec import Vector

Kind = Literal["line", "area", "disc", "hatch", "between", "spiral", "wheel", "arrow", "turn"]
"""How a shape is drawn:

line, area: through its points, open or closed, `size` the width of the stroke.
disc: around a point, `size` its radius.
hatch: a line of two points with short strokes on its right-hand side, `size` their distance.
between: the polyline `path`, in parts of the way from the first point to the second and metres to
the left of it.
spiral: about the first point from the direction of the second to that of the third, `size` the
outer radius.
wheel: about the first point, turned by its way from the second along the direction to the third,
`size` the radius.
arrow: from the first point to the second, `size` the length of its head.
turn: an arc with a head about a point, `size` the radius, `path[0][0]` the sweep [rad], clockwise
positive.
"""
Role = Literal[
    "ground", "guide", "stop", "rope", "body", "spring", "damper", "mass", "centre", "joint",
    "load", "marker",
]  # fmt: skip
ROLES: tuple[Role, ...] = Role.__args__
"""From what is drawn first, farthest behind, to what is drawn last."""
MOVING: frozenset[Role] = frozenset({"rope", "body", "mass", "spring", "damper", "marker"})
"""Roles that are drawn again for each run, over the reference."""
Box = tuple[float, float, float, float]  # least x and y, greatest x and y [m]
Path = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class FramePoint:
    """A point of a body, or at an arm from it that turns with another body's frame."""

    body: str
    at: complex  # place in the body's frame [m]
    frame: str = GROUND
    arm: complex = 0j  # vector in the frame of `frame` [m]

    def coefficients(self, kinematics: Kinematics) -> PointCoefficients:
        """Coefficients of its position."""
        row = kinematics.point(self.body, (self.at.real, self.at.imag))
        arm = kinematics.between(self.frame, (self.arm.real, self.arm.imag), self.frame, (0.0, 0.0))
        return PointCoefficients(row.offset + arm.offset, row.coefficients + arm.coefficients)


@dataclass(frozen=True)
class Shape:
    """A shape over indices of points; lengths in metres."""

    kind: Kind
    role: Role
    points: tuple[int, ...]
    size: float = 0.0
    path: Path = ()
    stop: str = ""  # the stop that it shows; it is gone when that has opened for good


@dataclass(frozen=True)
class Drawing:
    """A mechanism's points and shapes, and the part of the plane that its motion needs."""

    kinematics: Kinematics
    points: tuple[FramePoint, ...]
    rows: tuple[PointCoefficients, ...]  # coefficients of the points' positions
    shapes: tuple[Shape, ...]
    markers: dict[str, int]  # index of each marker's point, by name
    compared: tuple[int, ...]
    """Indices of the points whose distance from the reference's counts: the markers', else the
    bodies' centres of mass."""
    joints: dict[str, int]  # index of the point at which each joint's force acts
    stops: dict[str, tuple[int, int]]
    """Index of the point at which each stop acts; for a stop on a point also of a point along its
    normal, else the same index again."""
    box: Box
    size: float  # a length [m] of the whole, from which the sizes of symbols follow

    def positions(self, q: FloatArray) -> FloatArray:
        """World positions [m] in states q of shape (n, n_q); shape (n, n_points, 2)."""
        return _positions(self.kinematics, self.rows, q)

    def deviations(self, q: FloatArray, d: FloatArray) -> FloatArray:
        """Positions in states q + d less those in q [m], (n, n_points, 2), to the digits of d.

        Subtracting the positions would leave the rounding of q + d; exp(-i d) - 1 is formed as
        -2 sin^2(d / 2) - i sin(d) instead.
        """
        kinematics = self.kinematics
        turned = -2.0 * np.sin(d / 2) ** 2 - 1j * np.sin(d)
        phasors = np.exp(-1j * q)
        change = np.where(kinematics.is_angle > 0, phasors * turned, d)
        for k, c in kinematics.carried:
            slid = (q[..., k] + d[..., k]) * turned[..., c] + d[..., k]
            change[..., k] = phasors[..., c] * slid
        coefficients = np.array([row.coefficients for row in self.rows])
        return as_vectors(change @ coefficients.T)


def _positions(
    kinematics: Kinematics, rows: Sequence[PointCoefficients], q: FloatArray
) -> FloatArray:
    offsets = np.array([row.offset for row in rows])
    coefficients = np.array([row.coefficients for row in rows])
    return as_vectors(offsets + kinematics.phasors(q) @ coefficients.T)


# --- Collecting points and shapes


@dataclass
class Sketch:
    """Points and shapes of a mechanism, collected."""

    mechanism: Mechanism
    q: FloatArray
    """Its motion, shape (n, n_q): extents of guides, walls and the whole follow from it."""
    points: dict[FramePoint, int] = field(default_factory=dict[FramePoint, int])
    shapes: list[Shape] = field(default_factory=list[Shape])
    beams: list[tuple[tuple[int, ...], float, bool]] = field(default_factory=list[Any])
    """Points and mass [kg] of what is drawn as a beam, or (True) a plate."""
    masses: list[tuple[int, float]] = field(default_factory=list[Any])
    """Point and mass [kg] of what is drawn as a point mass."""

    def point(self, body: str, at: complex, frame: str = GROUND, arm: complex = 0j) -> int:
        """Index of a point; the same for the same point."""
        point = FramePoint(body, complex(at), frame, complex(arm))
        return self.points.setdefault(point, len(self.points))

    def add(
        self, kind: Kind, role: Role, points: Sequence[int], size: float, path: Path = (),
        stop: str = "",
    ) -> None:  # fmt: skip
        """Add a shape."""
        self.shapes.append(Shape(kind, role, tuple(points), size, path, stop))

    @cached_property
    def kinematics(self) -> Kinematics:
        """Kinematics of the mechanism."""
        return Kinematics(self.mechanism)

    @cached_property
    def down(self) -> complex:
        """Direction of gravity, in the world."""
        return complex(*self.mechanism.gravity_direction)

    @cached_property
    def size(self) -> float:
        """Longer side of what the bodies' points and centres sweep [m]; 1 for a point at rest."""
        points = [FramePoint(name, at) for name, ats in self.outlines.items() for at in ats]
        points += [FramePoint(body.name, complex(*body.centre)) for body in self.mechanism.bodies]
        xy = _positions(self.kinematics, self.rows(points), self.q).reshape(-1, 2)
        spread = float(np.max(xy.max(axis=0) - xy.min(axis=0)))
        return spread if math.isfinite(spread) and spread > 0 else 1.0

    @cached_property
    def unit(self) -> float:
        """A hundredth of the whole, less where many bodies must find room [m]."""
        return 0.01 * self.size * min(1.0, 12.0 / len(self.mechanism.bodies))

    @cached_property
    def body_size(self) -> float:
        """The whole, less where many bodies must find room [m]."""
        return self.size * min(1.0, 9.0 / len(self.mechanism.bodies))

    @cached_property
    def outlines(self) -> dict[str, list[complex]]:
        """Points of each body, and of the ground, at which something is fixed, each once."""
        mechanism = self.mechanism
        fixed: list[tuple[str, complex]] = []
        for joint in mechanism.joints:
            if joint.held_directions:
                fixed.append((joint.child, complex(*joint.child_point)))
                fixed += [(joint.parent, at) for at in self.guide(joint)]
        for each in (*mechanism.markers, *mechanism.point_stops):
            fixed.append((each.body, complex(*each.point)))
        for element in mechanism.force_elements:
            fixed += [(body, complex(*at)) for body, at in element.attachments]
        points: dict[str, list[complex]] = {body.name: [] for body in mechanism.bodies}
        points[GROUND] = []
        for name, at in fixed:
            if not any(abs(at - other) <= 1e-12 * (1 + abs(at)) for other in points[name]):
                points[name].append(at)
        return points

    def guide(self, joint: AnyJoint) -> list[complex]:
        """Ends of what the motion uses of a joint's line, in the parent's frame; a pin's point."""
        at = complex(*joint.parent_point)
        if len(joint.free_directions) != 1:
            return [at]
        (axis,) = joint.free_directions
        ends = joint.child_point, joint.parent_point
        along = self.component(axis, joint.parent, joint.child, *ends)
        return [at + axis * along.min(), at + axis * along.max()]

    def component(
        self, direction: complex, of: str, body: str, point: Vector, origin: Vector = (0.0, 0.0)
    ) -> FloatArray:
        """A body's point along a direction of another body's frame, during the motion [m]."""
        vector = self.kinematics.between(body, point, of, origin)
        return self.kinematics.component(direction, of, vector).value(self.q)

    def hinge(self, body: str, other: str) -> complex:
        """Find where a body turns against another, in its frame: their joint, or else its own."""
        joints = self.mechanism.joints
        common = [joint for joint in joints if {joint.parent, joint.child} == {body, other}]
        joint = (*common, self.mechanism.joint_of(body))[0]
        return complex(*(joint.child_point if joint.child == body else joint.parent_point))

    def rows(self, points: Iterable[FramePoint]) -> tuple[PointCoefficients, ...]:
        """Coefficients of the positions of points."""
        return tuple(point.coefficients(self.kinematics) for point in points)


# --- Bodies

_LEAST_SHARE = 0.01  # of a body's mass, below which a point mass in it is not drawn
_UNIFORM = 0.02  # by which the inertia of a rod may differ from a uniform one's


def add_bodies(sketch: Sketch) -> None:
    """Bodies, with sizes that compare their masses: widths and radii grow as the cube root."""
    for body in sketch.mechanism.bodies:
        _add_body(sketch, body)
    # Beams, plates and masses are added last: their sizes are in proportion to the largest.
    size = sketch.body_size
    widest = max((mass for _, mass, _ in sketch.beams), default=1.0)
    for points, mass, plate in sketch.beams:
        share = max(mass / widest, 0.0) ** (1 / 3) if widest > 0 else 0.0
        role: Role = "body" if share > 0.05 else "rope"
        sketch.add("area" if plate else "line", role, points, size * (0.006 + 0.012 * share))
    heaviest = max((mass for _, mass in sketch.masses), default=1.0)
    for index, mass in sketch.masses:
        radius = size * max(0.01, 0.04 * (mass / heaviest) ** (1 / 3))
        sketch.add("disc", "mass", (index,), radius)


def _add_body(sketch: Sketch, body: Body) -> None:
    """A body, by what is known of it: its points, mass and inertia."""
    name, centre = body.name, complex(*body.centre)
    points = distinct(sketch.outlines[name], centre, sketch.size)
    # A disc would say little where a joint holds its angle, or a stop its centre.
    shows_no_turn = sketch.mechanism.joint_of(name).holds_angle
    for stop in sketch.mechanism.point_stops:
        shows_no_turn |= stop.body == name and complex(*stop.point) == centre
    if body.inertia == 0 or (not points and shows_no_turn):
        # A mass on ropes or light links.
        end = sketch.point(name, centre)
        for point in points:
            sketch.add("line", "rope", (sketch.point(name, point), end), 0.004 * sketch.size)
        sketch.masses.append((end, body.mass))
        return
    shows_centre = True
    if not points:
        # A uniform disc of the body's inertia, with a spoke that shows how it turns.
        radius = min(math.sqrt(2 * body.inertia / body.mass), sketch.size)
        middle, rim = sketch.point(name, centre), sketch.point(name, centre + radius)
        sketch.add("disc", "body", (middle,), radius)
        sketch.add("line", "centre", (middle, rim), 0.004 * sketch.size)
    elif len(points) == 1:
        shows_centre = _add_rod(sketch, body, points[0], centre)
    elif on_a_line(np.array([*points, centre])):
        shows_centre = _add_loaded_rod(sketch, body, [*points, centre])
    else:
        corners = [*points, centre]
        hull = ConvexHull([(corner.real, corner.imag) for corner in corners]).vertices
        indices = tuple(sketch.point(name, corners[k]) for k in hull)
        sketch.beams.append((indices, body.mass, True))
    if shows_centre:
        index = sketch.point(name, centre)
        sketch.add("disc", "centre", (index,), 0.005 * sketch.body_size)


def _add_rod(sketch: Sketch, body: Body, point: complex, centre: complex) -> bool:
    """A uniform rod of the body's inertia through its point (True); else a bob on a link."""
    arm, half = centre - point, math.sqrt(3 * body.inertia / body.mass)
    if half < abs(arm) * (1 - _UNIFORM):
        ends = tuple(sketch.point(body.name, at) for at in (point, centre))
        sketch.add("line", "rope", ends, 0.006 * sketch.size)
        sketch.masses.append((ends[1], body.mass))
        return False
    half = abs(arm) if half < abs(arm) * (1 + _UNIFORM) else half
    along = arm / abs(arm) * half
    ends = tuple(sketch.point(body.name, centre + sign * along) for sign in (-1, 1))
    sketch.beams.append((ends, body.mass, False))
    return True


def _add_loaded_rod(sketch: Sketch, body: Body, points: list[complex]) -> bool:
    """A uniform rod with point masses at its ends, if the body is one; else a beam.

    Returns whether all the mass is the rod's.
    """
    far = max(points, key=lambda point: abs(point - points[0]))
    ends = max(points, key=lambda point: abs(point - far)), far
    indices = tuple(sketch.point(body.name, end) for end in ends)
    rod, *at_ends = loaded_rod(body, *ends) or (1.0, 0.0, 0.0)
    sketch.beams.append((indices, rod * body.mass, False))
    for index, share in zip(indices, at_ends, strict=True):
        if share > _LEAST_SHARE:
            sketch.masses.append((index, share * body.mass))
    return rod > 1 - _LEAST_SHARE


# --- Symbols of elements

_TEETH = 9
_FAR = 0.4  # of the size: a wall that stays farther away is not drawn
_LEVEL = 0.1  # a ground's slot whose direction has less of gravity's is a track for a wheel


def _add_pin(sketch: Sketch, joint: PinJoint) -> None:
    """A disc, on a support where the pin is fixed to the ground."""
    index = sketch.point(joint.child, complex(*joint.child_point))
    sketch.add("disc", "joint", (index,), sketch.unit * 0.7)
    _add_support(sketch, joint)


def _add_support(sketch: Sketch, joint: AnyJoint) -> None:
    """A foot on hatched ground, where the joint's parent is the ground."""
    if joint.parent != GROUND:
        return
    at, unit, down = complex(*joint.parent_point), sketch.unit, sketch.down

    def feet(aside: float) -> tuple[int, int]:
        left = sketch.point(GROUND, at + unit * (4 * down - aside * (1j * down)))
        return left, sketch.point(GROUND, at + unit * (4 * down + aside * (1j * down)))

    left, right = feet(2.4)
    sketch.add("area", "ground", (sketch.point(GROUND, at), left, right), 0.3 * unit)
    sketch.add("hatch", "ground", feet(3.6), unit)


def _guide(sketch: Sketch, joint: SlotJoint | PrismaticJoint) -> tuple[complex, complex, complex]:
    """Direction of a joint's line, and the ends of what is drawn of it, in the parent's frame."""
    (axis,) = joint.free_directions
    a, b = sketch.guide(joint)
    beyond = 4 * sketch.unit * axis
    return axis, a - beyond, b + beyond


def _add_rails(sketch: Sketch, body: str, a: complex, b: complex, apart: float) -> None:
    """Two lines beside the line from a to b."""
    across = 1j * (b - a) / abs(b - a) * apart
    for side in (-across, across):
        ends = sketch.point(body, a + side), sketch.point(body, b + side)
        sketch.add("line", "guide", ends, 0.3 * sketch.unit)


def _add_slider(sketch: Sketch, joint: PrismaticJoint) -> None:
    """A block between two rails."""
    unit, at = sketch.unit, complex(*joint.child_point)
    axis, a, b = _guide(sketch, joint)
    sketch.point(joint.child, at)
    _add_rails(sketch, joint.parent, a, b, 1.6 * unit)
    along = axis * cmath.exp(1j * joint.angle) * unit  # in the frame of the child
    corners = (-2.6 - 1.3j, 2.6 - 1.3j, 2.6 + 1.3j, -2.6 + 1.3j)
    points = [sketch.point(joint.child, at + along * corner) for corner in corners]
    sketch.add("area", "joint", points, 0.3 * unit)


def _add_slot(sketch: Sketch, joint: SlotJoint) -> None:
    """A wheel on a level track of the ground, else a pin between two rails."""
    unit, down = sketch.unit, sketch.down
    axis, a, b = _guide(sketch, joint)
    pin = sketch.point(joint.child, complex(*joint.child_point))
    if joint.parent != GROUND or abs((axis.conjugate() * down).real) >= _LEVEL:
        _add_rails(sketch, joint.parent, a, b, 1.1 * unit)
        sketch.add("disc", "joint", (pin,), unit)
        return
    # The strokes of the hatch are on the right-hand side of its line: below.
    if ((-1j * (b - a)).conjugate() * down).real <= 0:
        a, b = b, a
    radius, zero = 2.2 * unit, complex(*joint.parent_point)
    track = [sketch.point(GROUND, end + radius * down) for end in (a, b)]
    sketch.add("hatch", "ground", track, 1.4 * unit)
    along = sketch.point(GROUND, zero), sketch.point(GROUND, zero + (b - a))
    sketch.add("wheel", "joint", (pin, *along), radius)


def _add_nothing(sketch: Sketch, joint: FreeJoint) -> None:
    """A free joint holds nothing, so nothing is drawn."""


def _add_wall(sketch: Sketch, stop: PointStop) -> tuple[int, int]:
    """A hatched line; returns the points at which the stop acts, and along its normal."""
    normal, unit, at = complex(*stop.normal), sketch.unit, complex(*stop.point)
    along = -1j * normal
    reached = sketch.component(along, stop.relative_to, stop.body, stop.point)
    ends = float(reached.min() - 12 * unit), float(reached.max() + 12 * unit)
    points = [sketch.point(stop.relative_to, normal * stop.offset + along * end) for end in ends]
    if sketch.kinematics.gaps[stop.name].value(sketch.q).min() < _FAR * sketch.size:
        sketch.add("hatch", "stop", points, 1.4 * unit, stop=stop.name)
    acts = sketch.point(stop.body, at)
    return acts, sketch.point(stop.body, at, stop.relative_to, normal * sketch.size)


def _add_rest(sketch: Sketch, stop: Stop) -> tuple[int, int]:
    """A bracket beside the body's line at gap zero, on the side that the body cannot go to."""
    pivot, unit = sketch.hinge(stop.body, stop.relative_to), sketch.unit
    centre = complex(*sketch.mechanism.body(stop.body).centre)
    arms = [at - pivot for at in (*sketch.outlines[stop.body], centre)]
    arm = max(arms, key=abs, default=0j)
    length, reach, direction = abs(arm), 9 * unit, 1.0 + 0j
    if length > 0:
        reach, direction = min(reach, 0.6 * length), arm / length
    contact = direction * cmath.exp(-1j * stop.sense * stop.limit)
    away = 1j * stop.sense * contact * unit
    along = contact * reach
    corners = along * 0.35 + away, along + away, along * 0.95 + 2.6 * away
    points = [sketch.point(stop.body, pivot, stop.relative_to, corner) for corner in corners]
    sketch.add("area", "stop", points, 0.3 * unit, stop=stop.name)
    at = sketch.point(stop.body, pivot)
    return at, at


def _add_force(sketch: Sketch, element: ConstantForce) -> None:
    """An arrow."""
    direction, at = complex(*element.force), complex(*element.point)
    if direction:
        arm = 10 * sketch.unit * direction / abs(direction)
        ends = sketch.point(element.body, at), sketch.point(element.body, at, GROUND, arm)
        sketch.add("arrow", "load", ends, 2.4 * sketch.unit)


def _add_torque(sketch: Sketch, element: ConstantTorque) -> None:
    """An arc with a head."""
    if element.torque:
        _add_turn(sketch, element, element.torque)


def _add_record(sketch: Sketch, element: RecordedTorque) -> None:
    """Draw the torque of the start."""
    if any(element.torques):
        _add_turn(sketch, element, element.torques[0])


def _add_no_symbol(_sketch: Sketch, _element: RecordedForce | SlideInertia) -> None:
    """Nothing: a force whose size and sense change."""


def _add_turn(sketch: Sketch, element: ConstantTorque | RecordedTorque, torque: float) -> None:
    centre, *_ = _directions(sketch, element)
    sketch.add("turn", "load", (centre,), 5 * sketch.unit, ((math.copysign(4.4, torque), 0.0),))


def _add_torsion_spring(
    sketch: Sketch, element: RotationalSpringDamper | CubicTorsionSpring
) -> None:
    """A spiral."""
    stiff = element.stiffness or getattr(element, "cubic_stiffness", 0.0)
    role: Role = "spring" if stiff else "damper"
    sketch.add("spiral", role, _directions(sketch, element), 6 * sketch.unit)


def _add_slide_spring(sketch: Sketch, element: SlideSpringDamper) -> None:
    """A spring, or a dashpot, from the zero of the slide to the point that slides."""
    joint = sketch.mechanism.joint_of(element.body)
    shown = SpringDamper(
        name=element.name,
        body=joint.child,
        point=joint.child_point,
        relative_to=joint.parent,
        relative_point=joint.parent_point,
        stiffness=element.stiffness,
        damping=element.damping,
    )
    _add_spring_damper(sketch, shown)


def _add_rotor(sketch: Sketch, element: RotorInertia) -> None:
    """A disc about the hinge."""
    pivot = sketch.hinge(element.body, element.relative_to)
    sketch.add("disc", "mass", (sketch.point(element.body, pivot),), 2 * sketch.unit)


def _directions(
    sketch: Sketch,
    element: RotationalSpringDamper | CubicTorsionSpring | ConstantTorque | RecordedTorque,
) -> tuple[int, int, int]:
    """Find where two bodies turn against each other, and a point along each frame's x axis."""
    pivot = sketch.hinge(element.body, element.relative_to)
    along_other = sketch.point(element.body, pivot, element.relative_to, sketch.size)
    along_body = sketch.point(element.body, pivot, element.body, sketch.size)
    return sketch.point(element.body, pivot), along_other, along_body


def _add_spring_damper(sketch: Sketch, element: SpringDamper) -> None:
    """A zigzag, a dashpot (rod and piston, and the cylinder), or both beside each other."""
    ends = (
        sketch.point(element.relative_to, complex(*element.relative_point)),
        sketch.point(element.body, complex(*element.point)),
    )
    width, line = 1.4 * sketch.unit, 0.35 * sketch.unit
    side = width * 1.3 if element.stiffness > 0 and element.damping > 0 else 0.0
    if element.stiffness > 0 or not element.damping:
        start, end = (0, 0), (1, 0)
        teeth = [(0.2 + 0.6 * (k + 0.5) / _TEETH, side + width * (-1) ** (k + 1))
                 for k in range(_TEETH)]  # fmt: skip
        zigzag = (start, (0.1, 0), (0.1, side), (0.2, side), *teeth, (0.8, side), (0.9, side),
                  (0.9, 0), end)  # fmt: skip
        sketch.add("between", "spring", ends, line, zigzag)
    if element.damping > 0:
        width *= 0.8
        side = -side
        up, down, tip = side + width, side - width, 0.7 * width
        rod = (0, 0), (0.1, 0), (0.1, side), (0.5, side), (0.5, side + tip), (0.5, side - tip)
        cylinder = (0.35, up), (0.65, up), (0.65, side), (0.9, side), (0.9, 0), (1, 0)
        for path in (rod, cylinder, ((0.65, side), (0.65, down), (0.35, down))):
            sketch.add("between", "damper", ends, line, path)


JOINT_SYMBOLS: ElementTable[Callable[[Sketch, Any], None]] = ElementTable(
    "the drawing",
    JOINTS,
    {
        PinJoint: _add_pin,
        WeldJoint: _add_support,
        SlotJoint: _add_slot,
        PrismaticJoint: _add_slider,
        FreeJoint: _add_nothing,
        TranslationJoint: _add_nothing,
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
        RotorInertia: _add_rotor,
        SlideSpringDamper: _add_slide_spring,
        RecordedTorque: _add_record,
        RecordedForce: _add_no_symbol,
        SlideInertia: _add_no_symbol,
    },
)


# --- The drawing

_MARGIN = 0.03  # around the motion, in parts of its size
_BESIDE = 0.1  # of the size, by which stops widen the view at most
# Shapes around their first point, as far as their size; others of their points give directions
_ROUND = ("disc", "spiral", "wheel", "turn")
_MOST_HATCHES = 400


def draw(mechanism: Mechanism, q: FloatArray | None = None) -> Drawing:
    """Draw a mechanism.

    The view, and lengths of guides and walls, follow from its motion `q`, shape (n, n_q); from the
    start where left out.
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
    markers = {m.name: sketch.point(m.body, complex(*m.point)) for m in mechanism.markers}
    for index in markers.values():
        sketch.add("disc", "marker", (index,), 0.004 * sketch.size)
    centres = tuple(sketch.point(body.name, complex(*body.centre)) for body in mechanism.bodies)
    compared = tuple(dict.fromkeys(markers.values())) or centres
    shapes = tuple(sorted(sketch.shapes, key=lambda shape: ROLES.index(shape.role)))
    kinematics, points, rows = sketch.kinematics, tuple(sketch.points), sketch.rows(sketch.points)
    box, size = _box(sketch, shapes, _positions(kinematics, rows, q)), sketch.size
    named = markers, compared, joints, stops
    return Drawing(kinematics, points, rows, shapes, *named, box, size)


def _box(sketch: Sketch, shapes: tuple[Shape, ...], xy: FloatArray) -> Box:
    """Box around all that is drawn during the motion, but for stops far beside the rest."""
    least, most = xy.min(axis=0), xy.max(axis=0)

    def around(shapes: list[Shape]) -> tuple[FloatArray, FloatArray]:
        indices: list[int] = []
        reach: list[list[float]] = []  # how far a shape extends from its points [m]
        for shape in shapes:
            drawn, extent = shape.points, shape.size
            if shape.kind in _ROUND:
                drawn = shape.points[:1]
            elif shape.kind != "hatch":
                extent = max((abs(aside) for _, aside in shape.path), default=shape.size / 2)
            indices += drawn
            reach += [[extent]] * len(drawn)
        low, high = least[indices] - np.array(reach), most[indices] + np.array(reach)
        return low.min(axis=0), high.max(axis=0)

    low, high = around([shape for shape in shapes if shape.role != "stop"])
    stops = [shape for shape in shapes if shape.role == "stop"]
    if stops:
        beside = around(stops)
        low = np.maximum(np.minimum(low, beside[0]), low - _BESIDE * sketch.size)
        high = np.minimum(np.maximum(high, beside[1]), high + _BESIDE * sketch.size)
    margin = _MARGIN * sketch.size
    (left, lower), (right, upper) = (low - margin).tolist(), (high + margin).tolist()
    return left, lower, right, upper


def polylines(shape: Shape, z: ComplexArray) -> list[ComplexArray]:
    """Lines of a shape [m], x + i y, from its points; none of circles, arrows and turns."""
    size, lines = shape.size, list[ComplexArray]()
    match shape.kind:
        case "area":
            lines = [np.append(z, z[0])]
        case "line":
            lines = [z]
        case "between":
            (a, b), way = z, np.array(shape.path)
            length = abs(b - a) or math.inf
            lines = [a + way[:, 0] * (b - a) + 1j * way[:, 1] * (b - a) / length]
        case "spiral":
            centre, a, b = z
            start = cmath.phase(a - centre)
            part = np.linspace(0.0, 1.0, 61)
            sweep = cmath.phase(b - centre) - start + 4 * math.pi
            turns = np.exp(1j * (start + sweep * part))
            line = centre + size * (0.25 + 0.75 * part) * turns
            lines = [np.asarray(line, dtype=np.complex128)]
        case "wheel":  # its spokes
            centre, origin, along = z
            direction = (along - origin) / abs(along - origin)
            rolled = ((centre - origin) * direction.conjugate()).real / size
            arms = [0.92 * size * cmath.exp(1j * (k * math.pi / 3 - rolled)) for k in range(3)]
            lines = [np.array([centre - arm, centre + arm]) for arm in arms]
        case "hatch":
            a, b = z
            length = abs(b - a)
            count = min(max(round(length / size), 1), _MOST_HATCHES)
            stroke = 0.75 * size * (1 + 1j) * (b - a) / (length or 1.0)
            feet = [a + (k + 1) / count * (b - a) for k in range(count)]
            lines = [np.array([a, b]), *(np.array([foot, foot - stroke]) for foot in feet)]
        case _:
            pass
    return lines
