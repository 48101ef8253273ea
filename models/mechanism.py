"""A planar mechanism, described once and without any engine.

World: x to the right, y up. A body's frame coincides with the world's at angle zero; angles are absolute,
from +x, positive **clockwise** (the paper's convention), so a body point (a, b) stands at
(a cos q + b sin q, -a sin q + b cos q) from the frame's origin.
"""

from __future__ import annotations

import cmath
from collections.abc import Callable, Iterable, Iterator
from typing import Annotated, ClassVar, Literal, Self, cast

from pydantic import Discriminator, Field, Tag, model_validator

from .spec import Name, NonNegative, Positive, Real, Spec, Vector, schema_text

GROUND = "ground"
_CLOSED_GAP = 1e-12  # [rad], [m per m] a start gap below this is rounding, not an opening


class Body(Spec):
    """A rigid body; its coordinate is its absolute angle."""

    name: Name
    angle: Name = Field(description="name of its angle coordinate")
    mass: Positive = Field(description="[kg]")
    centre: Vector = Field(description="centre of mass in the body's frame [m]")
    inertia: NonNegative = Field(description="about the centre of mass [kg m^2]; 0 for a point mass")


class PinJoint(Spec):
    """Two points of two bodies coincide."""

    kind: Literal["pin"] = "pin"
    name: Name
    parent: Name = Field(description="a body, or 'ground'")
    child: Name
    parent_point: Vector = Field(description="in the parent's frame [m]")
    child_point: Vector = Field(description="in the child's frame [m]")


class SlotJoint(Spec):
    """A point of a body slides along a straight slot in the ground (pin in slot)."""

    kind: Literal["pin-in-slot"] = "pin-in-slot"
    name: Name
    parent: Literal["ground"] = GROUND
    child: Name
    parent_point: Vector = Field(description="a point of the slot, where its coordinate is zero [m]")
    child_point: Vector = Field(description="in the child's frame [m]")
    axis: Vector = Field(description="direction of the slot, length 1")
    coordinate: Name | None = Field(
        default=None, description="name of its slide coordinate; none where it closes a loop"
    )

    @model_validator(mode="after")
    def _axis_has_length_one(self) -> Self:
        if abs(self.axis[0] ** 2 + self.axis[1] ** 2 - 1.0) > 1e-12:
            raise ValueError(f"axis of {self.name!r} must have length 1")
        return self


Joint = Annotated[PinJoint | SlotJoint, Field(discriminator="kind")]


class Stop(Spec):
    """A unilateral constraint on a relative angle: gap = sense * (angle - angle of the other) - limit >= 0.

    Its torque is the generalised force conjugate to the gap: >= 0 while it pushes, 0 when open.
    """

    gap_unit: ClassVar[str] = "rad"
    speed_unit: ClassVar[str] = "rad/s"
    force_unit: ClassVar[str] = "N m"
    impulse_unit: ClassVar[str] = "N m s"
    effort: ClassVar[Literal["torque", "force"]] = "torque"
    """What it pushes with."""
    position_field: ClassVar[Literal["limit", "offset"]] = "limit"
    """Name of the field that holds its position."""

    name: Name
    body: Name
    relative_to: Name = GROUND
    sense: Literal[1, -1]
    limit: Real = Field(description="[rad]")
    closed: bool = Field(description="whether it touches at the start")
    restitution: Annotated[Real, Field(ge=0, le=1)] = Field(
        default=0.0, description="gap speed after an impact over the one before, under the unilateral law"
    )

    @property
    def bodies(self) -> tuple[str, ...]:
        """The bodies it acts between."""
        return (self.body, self.relative_to)

    @property
    def position(self) -> float:
        """Its limit [rad]."""
        return self.limit

    def component(self, angle: Callable[[str], float], point: Callable[[str, Vector], complex]) -> float:
        """The component of a motion along the gap, which is linear in it.

        Of angles and places it is gap + position, of velocities the gap's speed, of accelerations the gap's
        acceleration; so the gap of any stop follows from how bodies turn and points move, in whatever coordinates.

        Args:
            angle: of a body other than the ground, positive clockwise [rad], or its derivative.
            point: of a body and a point in its frame: where it is in the world, x + i y [m], or its derivative.
        """
        own, other = (0.0 if body == GROUND else angle(body) for body in self.bodies)
        return self.sense * (own - other)


class PointStop(Spec):
    """A unilateral constraint on where a point may be: gap = normal . position - offset >= 0, a half-plane.

    A trough, a floor, a wall without friction. Its force is along the normal: >= 0 while it pushes, 0 when open.
    """

    gap_unit: ClassVar[str] = "m"
    speed_unit: ClassVar[str] = "m/s"
    force_unit: ClassVar[str] = "N"
    impulse_unit: ClassVar[str] = "N s"
    effort: ClassVar[Literal["torque", "force"]] = "force"
    """What it pushes with."""
    position_field: ClassVar[Literal["limit", "offset"]] = "offset"
    """Name of the field that holds its position."""

    name: Name
    body: Name
    point: Vector = Field(description="of the body, in its frame [m]")
    normal: Vector = Field(description="from the wall towards where the point may be, length 1")
    offset: Real = Field(description="distance of the wall from the world's origin along the normal [m]")
    closed: bool = Field(description="whether it touches at the start")
    restitution: Annotated[Real, Field(ge=0, le=1)] = Field(
        default=0.0, description="gap speed after an impact over the one before, under the unilateral law"
    )

    @model_validator(mode="after")
    def _normal_has_length_one(self) -> Self:
        if abs(self.normal[0] ** 2 + self.normal[1] ** 2 - 1.0) > 1e-12:
            raise ValueError(f"normal of {self.name!r} must have length 1")
        return self

    @property
    def bodies(self) -> tuple[str, ...]:
        """The body it acts on."""
        return (self.body,)

    @property
    def position(self) -> float:
        """Its offset [m]."""
        return self.offset

    def component(self, angle: Callable[[str], float], point: Callable[[str, Vector], complex]) -> float:
        """The component of a motion along the gap, as for a :class:`Stop`: here that of the point along the normal."""
        at = point(self.body, self.point)
        return self.normal[0] * at.real + self.normal[1] * at.imag


def _tag_of_stop(value: object) -> str:
    if isinstance(value, dict):
        return "point stop" if {"point", "normal", "offset"} & cast("dict[str, object]", value).keys() else "stop"
    return "point stop" if isinstance(value, PointStop) else "stop"


# Distinguished by their fields: a `kind` would change the content, and so the hash, of every mechanism there is.
AnyStop = Annotated[Annotated[Stop, Tag("stop")] | Annotated[PointStop, Tag("point stop")], Discriminator(_tag_of_stop)]


class Marker(Spec):
    """A named point of a body."""

    name: Name
    body: Name
    point: Vector = Field(description="in the body's frame [m]")
    mass: Positive | None = Field(
        default=None, description="what leaves the machine there, if it is not the whole body [kg]; part of the body's"
    )


class Mechanism(Spec):
    """Bodies, joints, stops, markers, gravity and the start.

    Bodies stand in an order in which each one's first joint as a child leads to the ground or to an earlier
    body: those joints make the tree, any further joint closes a loop. Coordinates q are the bodies' angles
    [rad] in that order, then the slides of slots [m] in the order of the joints.

    Raises:
        InputError: names clash or point nowhere, the tree is broken, or a stop's `closed` belies its gap.
    """

    largest_file: ClassVar[int] = 1_000_000  # some five thousand bodies

    name: Name
    bodies: tuple[Body, ...] = Field(min_length=1)
    joints: tuple[Joint, ...] = Field(min_length=1)
    stops: tuple[AnyStop, ...] = ()
    markers: tuple[Marker, ...] = ()
    gravity: NonNegative = Field(description="downwards [m/s^2]")
    start: tuple[Real, ...] = Field(description="q at t = 0 [rad or m]")
    start_speeds: tuple[Real, ...] = Field(default=(), description="u at t = 0 [rad/s or m/s]; empty: at rest")

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of q, in order."""
        angles = tuple(body.angle for body in self.bodies)
        return angles + tuple(joint.coordinate for joint in self.slides if joint.coordinate is not None)

    @property
    def slides(self) -> tuple[SlotJoint, ...]:
        """Slots of the tree, each with a coordinate."""
        return tuple(joint for joint in self.tree_joints if isinstance(joint, SlotJoint))

    @property
    def tree_joints(self) -> tuple[PinJoint | SlotJoint, ...]:
        """Each body's joint in the tree, to its parent, in the order of the bodies."""
        first = {joint.child: joint for joint in reversed(self.joints)}
        return tuple(first[body.name] for body in self.bodies)

    @property
    def loop_joints(self) -> tuple[PinJoint | SlotJoint, ...]:
        """Joints that close a loop."""
        tree = {joint.name for joint in self.tree_joints}
        return tuple(joint for joint in self.joints if joint.name not in tree)

    @property
    def loop_closure_residual(self) -> dict[str, float]:
        """Distance at the start of the two points of each joint that closes a loop; of a slot: from its line [m]."""
        residuals: dict[str, float] = {}
        for joint in self.loop_joints:
            child = self._start_position(joint.child, joint.child_point)
            residual = child - self._start_position(joint.parent, joint.parent_point)
            across = (residual * complex(*joint.axis).conjugate()).imag if isinstance(joint, SlotJoint) else residual
            residuals[joint.name] = abs(across)
        return residuals

    @property
    def loops_apart(self) -> dict[str, float]:
        """Another name of :attr:`loop_closure_residual`."""
        return self.loop_closure_residual

    def body(self, name: str) -> Body:
        """The body of that name."""
        return next(body for body in self.bodies if body.name == name)

    def stop(self, name: str) -> Stop | PointStop:
        """The stop of that name."""
        return next(stop for stop in self.stops if stop.name == name)

    def marker(self, name: str) -> Marker | None:
        """The marker of that name; None if there is none."""
        return next((marker for marker in self.markers if marker.name == name), None)

    def joint_of(self, body: str) -> PinJoint | SlotJoint:
        """A body's joint in the tree, to its parent."""
        return next(joint for joint in self.joints if joint.child == body)

    def thrown_mass(self, marker: Marker) -> float | None:
        """Mass thrown at a marker [kg]: its own, or its body's if that is a point mass there; None: not known."""
        body = self.body(marker.body) if marker.body != GROUND else None
        if marker.mass is not None or body is None:
            return marker.mass
        return body.mass if body.centre == marker.point and body.inertia == 0 else None

    @property
    def force_unit(self) -> str:
        """Unit of what the stops that are closed at the start push with, for quantities of whichever of them."""
        return " or ".join(dict.fromkeys(stop.force_unit for stop in self.stops if stop.closed)) or "N m"

    @property
    def angle_stops(self) -> tuple[Stop, ...]:
        """Stops on relative angles."""
        return tuple(stop for stop in self.stops if isinstance(stop, Stop))

    @property
    def point_stops(self) -> tuple[PointStop, ...]:
        """Stops on where a point may be."""
        return tuple(stop for stop in self.stops if isinstance(stop, PointStop))

    def children(self, name: str) -> tuple[Body, ...]:
        """Children of a body (or of the ground) in the tree."""
        return tuple(self.body(joint.child) for joint in self.tree_joints if joint.parent == name)

    def subtree(self, name: str) -> Iterator[Body]:
        """A body and all its descendants in the tree."""
        yield self.body(name)
        for child in self.children(name):
            yield from self.subtree(child.name)

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        _refuse_repeats("body", (body.name for body in self.bodies))
        _refuse_repeats("joint", (joint.name for joint in self.joints))
        _refuse_repeats("stop", (stop.name for stop in self.stops))
        _refuse_repeats("marker", (marker.name for marker in self.markers))
        self._refuse_unknown_bodies()
        self._refuse_a_broken_tree()
        _refuse_repeats("coordinate", self.coordinates)
        self._refuse_a_start_of_the_wrong_length()
        self._refuse_wrong_gaps()
        return self

    def _refuse_unknown_bodies(self) -> None:
        known = {GROUND} | {body.name for body in self.bodies}
        used = [(f"joint {j.name!r}", n) for j in self.joints for n in (j.parent, j.child)]
        used += [(f"stop {s.name!r}", n) for s in self.stops for n in s.bodies]
        used += [(f"marker {m.name!r}", m.body) for m in self.markers]
        for joint in self.joints:
            if joint.child == GROUND:
                raise ValueError(f"joint {joint.name!r} has the ground as its child; the ground can only be a parent")
        for user, name in used:
            if name not in known:
                raise ValueError(f"{user} names the body {name!r}; there are {sorted(known)}")

    def _refuse_a_broken_tree(self) -> None:
        placed = {GROUND}
        for body in self.bodies:
            joint = next((joint for joint in self.joints if joint.child == body.name), None)
            if joint is None:
                raise ValueError(f"body {body.name!r} hangs on no joint")
            if joint.parent not in placed:
                raise ValueError(f"body {body.name!r} hangs on {joint.parent!r}, which must be listed before it")
            if isinstance(joint, SlotJoint) and joint.coordinate is None:
                raise ValueError(f"slot {joint.name!r} carries a body and so needs a coordinate")
            placed.add(body.name)
        for joint in self.loop_joints:
            if isinstance(joint, SlotJoint) and joint.coordinate is not None:
                raise ValueError(f"slot {joint.name!r} closes a loop and so has no coordinate of its own")

    def _refuse_a_start_of_the_wrong_length(self) -> None:
        expected = len(self.coordinates)
        if len(self.start) != expected:
            raise ValueError(f"start has {len(self.start)} values for {expected} coordinates {self.coordinates}")
        if self.start_speeds and len(self.start_speeds) != expected:
            raise ValueError(f"start_speeds has {len(self.start_speeds)} values for {expected} coordinates")

    def _refuse_wrong_gaps(self) -> None:
        for stop in self.stops:
            (gap, rounding), unit = self._start_gap(stop), stop.gap_unit
            if stop.closed and abs(gap) > rounding:
                raise ValueError(f"stop {stop.name!r} is closed, but its gap at the start is {gap:.3g} {unit}, not 0")
            if not stop.closed and gap <= rounding:
                raise ValueError(
                    f"stop {stop.name!r} is open, but its gap at the start is {gap:.3g} {unit}, not positive"
                )

    def _start_gap(self, stop: Stop | PointStop) -> tuple[float, float]:
        """A stop's gap at the start, and how far rounding can move it."""
        sizes = [1.0]

        def position_of(body: str, point: Vector) -> complex:
            at = self._start_position(body, point)
            sizes.append(abs(at))
            return at

        angle = {body.name: self.start[i] for i, body in enumerate(self.bodies)}
        gap = stop.component(angle.__getitem__, position_of) - stop.position
        return gap, _CLOSED_GAP * max(sizes)

    def _start_position(self, body: str, point: Vector) -> complex:
        """Position of a body's point at the start, x + i y [m]."""
        if body == GROUND:
            return complex(*point)
        start = dict(zip(self.coordinates, self.start, strict=True))
        joint = self.joint_of(body)
        position = self._start_position(joint.parent, joint.parent_point)
        if isinstance(joint, SlotJoint) and joint.coordinate is not None:
            position += start[joint.coordinate] * complex(*joint.axis)
        arm = complex(*point) - complex(*joint.child_point)
        return position + arm * cmath.exp(-1j * start[self.body(body).angle])


def mechanism_schema() -> str:
    """JSON schema of a mechanism as text, as it stands in models/schemas/."""
    return schema_text(Mechanism)


def _refuse_repeats(what: str, names: Iterable[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen or name == GROUND:
            raise ValueError(f"{what} name {name!r} is used twice or reserved")
        seen.add(name)
