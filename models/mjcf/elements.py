"""Elements beyond the tree as MJCF: stops on points, joints that close loops, force elements.

A stop on a point is a frictionless contact of a ball with a plane, or with a box on a body that
moves. A slot that closes a loop is two of them, a ball between the two planes of a rail. A pin that
closes a loop is a `connect` equality of two sites, and an angle that a loop's weld or slider holds
is an equality of a tendon over hinges. Each hangs on a body of its own without mass or joint,
welded where the point is: MuJoCo then scales the softness of the contact with the inertia that is
felt there and not at the centre of mass, and a force sensor has a place to stand.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Generic, TypeVar, cast

from ..elements import (
    FORCE_ELEMENTS,
    GROUND,
    AnyJoint,
    ConstantForce,
    ConstantTorque,
    Coupler,
    CubicTorsionSpring,
    ElementTable,
    PointStop,
    RecordedEffort,
    RecordedForce,
    RecordedTorque,
    RotationalSpringDamper,
    RotorInertia,
    SlideInertia,
    SlideSpringDamper,
    SpringDamper,
)
from ..errors import UnsupportedProblemError
from ..mechanism import Mechanism
from ..spec import Vector
from .appearance import reach_of
from .tree import (
    add,
    add_angle_tendon,
    from_origin,
    hinge_weights,
    joint_weights,
    number,
    numbers,
    slide_joints,
    spatial,
    start_angles,
)
from .variants import Numerics

_E = TypeVar("_E")
RAIL_SIDES = ("left", "right")
"""Sides of a slot, seen along its axis."""


def torque_sensor(stop: str) -> str:
    """Name of the sensor of a stop's torque [N m], of a stop on a point's force [N]."""
    return f"{stop}/torque"


def force_sensor(joint: str) -> str:
    """Name of the sensor of a joint's force [N], in the frame of its child."""
    return f"{joint}/force"


def rail_contact(slot: str, side: str) -> str:
    """Name of the contact of a slot that closes a loop with one of its two sides."""
    return f"{slot}/{side}"


_THICKNESS = 4.0  # radii of a ball: half of it is that of a wall on a moving body
_BEYOND = 1e4  # lengths of the machine: half the extent of such a wall, whose end no point reaches


@dataclass(frozen=True)
class Wall:
    """A half-plane that a point of a body must not enter."""

    name: str
    """Name of the contact."""
    holder: str
    """Name of the stop or joint."""
    body: str
    """Body that has the wall, or 'ground'."""
    normal: Vector
    offset: float
    """Distance from the origin of the body's frame along the normal [m]."""
    visible: bool

    @property
    def geoms(self) -> dict[str, str]:
        """The contact's plane and ball."""
        return {"geom1": f"{self.name}/wall", "geom2": f"{self.holder}/ball"}


def _wall(stop: PointStop) -> Wall:
    return Wall(stop.name, stop.name, stop.relative_to, stop.normal, stop.offset, visible=True)


def _rail_walls(slot: AnyJoint) -> Iterator[Wall]:
    """The two walls of a slot, the left one pushing to the right."""
    (axis,) = slot.free_directions
    left = (-axis.imag, axis.real)
    for side, sense in zip(RAIL_SIDES, (-1, 1), strict=True):
        normal = (sense * left[0], sense * left[1])
        offset = normal[0] * slot.parent_point[0] + normal[1] * slot.parent_point[1]
        name = rail_contact(slot.name, side)
        yield Wall(name, slot.name, slot.parent, normal, offset, visible=False)


@dataclass(frozen=True)
class Points:
    """Elements for all held points of a mechanism.

    Raises:
        UnsupportedProblemError: a stop is on a point of a body, or the ground, against the same
            one.
    """

    mechanism: Mechanism

    def __post_init__(self) -> None:
        for stop in self.mechanism.point_stops:
            if stop.body == stop.relative_to:
                message = f"stop {stop.name!r} holds a point of {stop.body!r} against itself."
                raise UnsupportedProblemError(message)

    @cached_property
    def reach(self) -> float:
        """A length no point of the machine is farther from its ground joints [m]."""
        return reach_of(self.mechanism)

    @property
    def slots(self) -> tuple[AnyJoint, ...]:
        """Slots and sliders that close loops."""
        return tuple(joint for joint in self.mechanism.loop_joints if joint.free_directions)

    @property
    def pins(self) -> tuple[AnyJoint, ...]:
        """Pins and welds that close loops."""
        return tuple(joint for joint in self.mechanism.loop_joints if not joint.free_directions)

    @property
    def turned(self) -> tuple[AnyJoint, ...]:
        """Joints that close loops and hold an angle."""
        return tuple(joint for joint in self.mechanism.loop_joints if joint.holds_angle)

    @cached_property
    def walls(self) -> tuple[Wall, ...]:
        """One a stop, two a slot."""
        walls = [_wall(stop) for stop in self.mechanism.point_stops]
        for slot in self.slots:
            walls += _rail_walls(slot)
        return tuple(walls)

    @cached_property
    def _radius(self) -> float:
        return round(0.01 * self.reach, 6)

    def add_defaults(self, default: ET.Element, numerics: Numerics) -> None:
        """Softness of contacts and equalities; the margin [m] is that of a machine of a metre."""
        soft = written(replace(numerics, solref=numerics.solref_of_points), "solref", "solimp")
        if self.walls:
            pair = add(default, "pair", soft, condim="1")
            if numerics.margin is not None:  # what rounding makes of a gap of zero
                pair.set("margin", number(numerics.margin * max(1.0, self.reach)))
        if soft and (self.pins or self.turned or self.mechanism.couplers):
            add(default, "equality", soft)

    def add_points(self, element: ET.Element, body: str, origin: Vector) -> None:
        """Add walls, anchors and held points of a body, or of the ground.

        A wall is behind the points' own half-plane by the radius of the balls. MuJoCo has no planes
        on moving bodies: there it is a box whose ends no point reaches. A held point is a body
        without mass; a pin that closes a loop ties it to an anchor.
        """
        size, thickness = round(1.5 * self.reach, 3), _THICKNESS * self._radius
        beyond = _BEYOND * self.reach
        for wall in self.walls:
            if wall.body != body:
                continue
            behind = wall.offset - self._radius
            if body == GROUND:
                kind, sizes = "plane", (size, 0.1 * size, size)
            else:
                kind, sizes = "box", (beyond, beyond, thickness)
                behind -= thickness
            centre = wall.normal[0] * behind, wall.normal[1] * behind
            add(
                element, "geom", group="4", name=wall.geoms["geom1"], type=kind, size=sizes,
                pos=from_origin(origin, centre), zaxis=spatial(wall.normal),
            )  # fmt: skip
        for pin in self.pins:
            if pin.parent == body:
                place = from_origin(origin, pin.parent_point)
                add(element, "site", name=f"{pin.name}/anchor", pos=place)
        for stop in self.mechanism.point_stops:
            if stop.body == body:
                self._add_ball(self._add_point(element, stop.name, origin, stop.point), stop.name)
        for joint in self.mechanism.loop_joints:
            if joint.child == body:
                point = self._add_point(element, joint.name, origin, joint.child_point)
                add(point, "site", name=f"{joint.name}/joint")
                if joint.free_directions:
                    self._add_ball(point, joint.name)

    def _add_point(
        self, element: ET.Element, name: str, origin: Vector, point: Vector
    ) -> ET.Element:
        return add(element, "body", name=f"{name}/point", pos=from_origin(origin, point))

    def _add_ball(self, element: ET.Element, name: str) -> None:
        add(element, "geom", name=f"{name}/ball", type="sphere", group="4", size=self._radius)

    def add_constraints(self, root: ET.Element, numerics: Numerics) -> None:
        """Contacts and equalities."""
        if self.walls:
            contact = add(root, "contact")
            for wall in self.walls:
                pair = add(contact, "pair", wall.geoms, name=wall.name)
                if not wall.visible and numerics.margin_of_slots is not None:
                    pair.set("margin", number(numerics.margin_of_slots))
        couplers = self.mechanism.couplers
        if self.pins or self.turned or couplers:
            equality, angles = add(root, "equality"), start_angles(self.mechanism)
            for pin in self.pins:
                sites = {"site1": f"{pin.name}/joint", "site2": f"{pin.name}/anchor"}
                add(equality, "connect", sites, name=pin.name)
            for joint in self.turned:
                # The rounding error of the angle at the start [rad].
                missing = (joint.turned_by or 0.0) - (angles[joint.child] - angles[joint.parent])
                held, name = (math.remainder(missing, 2 * math.pi), 0, 0, 0, 0), _angle(joint)
                add(equality, "tendon", name=name, tendon1=name, polycoef=held)
            residual = self.mechanism.coupler_residual
            for coupler in couplers:
                held, name = (-residual[coupler.name], 0, 0, 0, 0), _sum(coupler)
                add(equality, "tendon", name=name, tendon1=name, polycoef=held)

    def add_tendons(self, tendon: ET.Element) -> None:
        """Angles that joints that close loops hold, and sums that couplers do."""
        for joint in self.turned:
            bodies = (joint.child, joint.parent)
            add_angle_tendon(tendon, self.mechanism, bodies, name=_angle(joint))
        for coupler in self.mechanism.couplers:
            fixed = add(tendon, "fixed", name=_sum(coupler))
            for name, weight in joint_weights(self.mechanism, coupler.weights).items():
                add(fixed, "joint", joint=name, coef=weight)

    @property
    def needs_tendons(self) -> bool:
        """Tell whether any of them is a tendon."""
        return bool(self.turned or self.mechanism.couplers)

    def add_stop_sensor(self, sensor: ET.Element, stop: PointStop) -> None:
        """Add the force of a stop on a point: first component in the contact's frame [N]."""
        add(sensor, "contact", _wall(stop).geoms, name=torque_sensor(stop.name), data="force")


def _sum(coupler: Coupler) -> str:
    """Name of the tendon and the equality of what a coupler holds."""
    return f"{coupler.name}/{coupler.kind}"


def _angle(joint: AnyJoint) -> str:
    """Name of the tendon and the equality of the angle that a joint holds."""
    return f"{joint.name}/angle"


def written(numerics: Numerics, *names: str) -> dict[str, str]:
    """The attributes of those numerical options that are set."""
    attributes = dict[str, str]()
    for name in names:
        value = getattr(numerics, name)
        if isinstance(value, tuple):
            attributes[name] = numbers(*cast("tuple[float, ...]", value))
        elif value is not None:
            attributes[name] = value if isinstance(value, str) else number(value)
    return attributes


def felt_from(mechanism: Mechanism, timestep: float) -> float:
    """Margin of a contact [m] that shall not matter: it scales with a step's curvature.

    Both walls of a slot are pressed in by it. As long as both push they are one two-sided
    constraint without play: with a stiffness of 1/timestep^2, up to accelerations of some 1e4 of
    that named here. The forces that cancel cost five digits of sixteen.
    """
    return 10.0 * max(mechanism.gravity, reach_of(mechanism)) * timestep**2


# --- Force elements

_WORLD = "ground/directions"
_CONSTANT = {"gainprm": "0", "biastype": "affine"}  # an actuator with a force and no control


@dataclass(frozen=True)
class OfJoint:
    """Numbers that elements add to a hinge or slide, whose position is zero at the start."""

    armature: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    pull: float = 0.0
    """Stiffness times the position at rest."""

    def __add__(self, other: OfJoint) -> OfJoint:
        return OfJoint(
            self.armature + other.armature,
            self.stiffness + other.stiffness,
            self.damping + other.damping,
            self.pull + other.pull,
        )

    @property
    def attributes(self) -> dict[str, float]:
        """Attributes of the joint, those that are not zero."""
        rest = self.pull / self.stiffness if self.stiffness else 0.0
        values = {
            "armature": self.armature,
            "stiffness": self.stiffness,
            "damping": self.damping,
            "springref": rest,
        }
        return {name: value for name, value in values.items() if value}


@dataclass(frozen=True)
class _ForceWriter(Generic[_E]):
    """Functions that write a class of force elements; None where it has no such part."""

    add_sites: Callable[[_E, ET.Element, str, Vector], None] | None = None
    """Sites on a body (or the world), whose frame has an origin."""
    add_tendon: Callable[[_E, ET.Element, Mechanism], None] | None = None
    add_actuator: Callable[[_E, ET.Element, Mechanism], None] | None = None
    of_joint: Callable[[_E, Mechanism], tuple[str, OfJoint]] | None = None
    """Name of a hinge or slide, and what the element adds to it."""
    control: Callable[[_E, float], float] | None = None
    """Control of the actuator from a time [s] on; 0 where there is none."""


@dataclass(frozen=True)
class Forces:
    """Writes all force elements of a mechanism, class by class.

    Springs and dampers are tendons: spatial ones between two sites, or fixed ones over the hinges
    between two bodies. A constant force is an actuator on a site with the directions of a site of
    the world, a constant torque one on a fixed tendon; the bias of the actuator is the force, so
    that it acts without any control. A record is the control of an actuator. An inertia is the
    armature of a hinge or slide; a spring, damper or constant force along a slide is the slide's
    own, the force by an actuator.

    Raises:
        UnsupportedProblemError: MJCF cannot express an element; the sentence names it.
    """

    mechanism: Mechanism

    def __post_init__(self) -> None:
        for element in self.mechanism.force_elements:
            writer = FORCE_WRITERS[element]  # refuses what it does not know
            if writer.of_joint:
                writer.of_joint(element, self.mechanism)  # refuses what is on several hinges

    def _by_class(self) -> Iterator[tuple[Any, _ForceWriter[Any]]]:
        """Elements with their writers, in the order of the table: that of the file."""
        for kind, writer in FORCE_WRITERS.handlers.items():
            for element in self.mechanism.force_elements:
                if type(element) is kind:
                    yield element, writer

    def add_sites(self, element: ET.Element, body: str, origin: Vector) -> None:
        """Add to a body (or the world) the points that forces act on."""
        kinds = {type(force) for force in self.mechanism.force_elements}
        if body == GROUND and ConstantForce in kinds:
            add(element, "site", name=_WORLD)
        for force, writer in self._by_class():
            if writer.add_sites:
                writer.add_sites(force, element, body, origin)

    def of_joint(self, joint: str) -> dict[str, str]:
        """Attributes of a hinge or slide, on which several elements add up."""
        total = OfJoint()
        for force, writer in self._by_class():
            if writer.of_joint:
                name, own = writer.of_joint(force, self.mechanism)
                total = total + own if name == joint else total
        return {name: number(value) for name, value in total.attributes.items()}

    @property
    def needs_tendons(self) -> bool:
        """Tell whether any element is, or acts on, a tendon."""
        return any(writer.add_tendon for _, writer in self._by_class())

    def add_tendons(self, tendon: ET.Element) -> None:
        """Add springs and dampers, and what constant torques act on."""
        for force, writer in self._by_class():
            if writer.add_tendon:
                writer.add_tendon(force, tendon, self.mechanism)

    def add_actuators(self, root: ET.Element) -> None:
        """Add constant forces and torques."""
        if not any(writer.add_actuator for _, writer in self._by_class()):
            return
        actuator = add(root, "actuator")
        for force, writer in self._by_class():
            if writer.add_actuator:
                writer.add_actuator(force, actuator, self.mechanism)

    def controls(self, root: ET.Element, t: float) -> list[float]:
        """Controls of all actuators of the file from a time [s] on; none without a record."""
        controls = {
            force.name: writer.control(force, t) for force, writer in self._by_class()
            if writer.control
        }  # fmt: skip
        names = [each.get("name", "") for each in root.iterfind("actuator/*")]
        return [controls.get(name, 0.0) for name in names] if controls else []


def _ends(spring: SpringDamper) -> tuple[str, str]:
    """Names of the sites at its two points."""
    return f"{spring.name}/point", f"{spring.name}/relative point"


def _tendon(
    element: SpringDamper
    | RotationalSpringDamper
    | CubicTorsionSpring
    | ConstantTorque
    | RecordedTorque,
) -> str:
    """Name of its tendon, beside those of stops."""
    return f"{element.name}/{element.kind}"


def _strength(spring: SpringDamper | RotationalSpringDamper) -> dict[str, str]:
    return {"stiffness": number(spring.stiffness), "damping": number(spring.damping)}


def _add_spring_sites(spring: SpringDamper, element: ET.Element, body: str, origin: Vector) -> None:
    for site, (name, point) in zip(_ends(spring), spring.ends, strict=True):
        if name == body:
            add(element, "site", name=site, pos=from_origin(origin, point))


def _add_spring(spring: SpringDamper, tendon: ET.Element, mechanism: Mechanism) -> None:
    line = add(
        tendon, "spatial", _strength(spring), name=_tendon(spring), springlength=spring.rest_length,
        width=round(0.006 * reach_of(mechanism), 6), rgba="0.35 0.45 0.60 1",
    )  # fmt: skip
    for site in _ends(spring):
        add(line, "site", site=site)


def _cubic_strength(spring: CubicTorsionSpring) -> dict[str, str]:
    # Coefficients of the stiffness k + 0 |x| + k3 x^2: MuJoCo 4 reads them, 3.10 does not.
    return {"stiffness": numbers(spring.stiffness, 0, spring.cubic_stiffness)}


def _angle_spring(
    strength: Callable[[Any], dict[str, str]],
) -> Callable[[Any, ET.Element, Mechanism], None]:
    """Add a spring over the hinges between two bodies, of this strength."""

    def add_spring(spring: Any, tendon: ET.Element, mechanism: Mechanism) -> None:
        angles = start_angles(mechanism)
        rest = spring.rest_angle - (angles[spring.body] - angles[spring.relative_to])
        # MuJoCo takes a length of -1 for none.
        add_angle_tendon(
            tendon, mechanism, spring.bodies, 1 if rest >= 0 else -1,
            name=_tendon(spring), **strength(spring), springlength=abs(rest),
        )  # fmt: skip

    return add_spring


def _add_torque_tendon(
    torque: ConstantTorque | RecordedTorque, tendon: ET.Element, mechanism: Mechanism
) -> None:
    add_angle_tendon(tendon, mechanism, torque.bodies, name=_tendon(torque))


def _add_torque(torque: ConstantTorque, actuator: ET.Element, _: Mechanism) -> None:
    name, tendon = torque.name, _tendon(torque)
    add(actuator, "general", _CONSTANT, name=name, tendon=tendon, biasprm=torque.torque)


def _add_force_site(force: ConstantForce, element: ET.Element, body: str, origin: Vector) -> None:
    if force.body == body:
        add(element, "site", name=f"{force.name}/force", pos=from_origin(origin, force.point))


def _add_force(force: ConstantForce, actuator: ET.Element, _: Mechanism) -> None:
    add(
        actuator, "general", _CONSTANT, name=force.name, biasprm="1", site=f"{force.name}/force",
        refsite=_WORLD, gear=f"{spatial(force.force)} 0 0 0",
    )  # fmt: skip


def _of_hinge(rotor: RotorInertia, mechanism: Mechanism) -> tuple[str, OfJoint]:
    hinges = hinge_weights(mechanism, *rotor.bodies)
    if len(hinges) != 1:
        raise UnsupportedProblemError(
            f"the MJCF writer cannot write {rotor.name!r}: between its bodies there are "
            f"{len(hinges)} hinges, and an armature belongs to one."
        )
    return next(iter(hinges)), OfJoint(armature=rotor.inertia)


def _of_slide(spring: SlideSpringDamper, mechanism: Mechanism) -> tuple[str, OfJoint]:
    start = dict(zip(mechanism.coordinates, mechanism.start, strict=True))[spring.coordinate]
    pull = spring.stiffness * (spring.rest_position - start)
    own = OfJoint(stiffness=spring.stiffness, damping=spring.damping, pull=pull)
    return _slide(spring, mechanism), own


def _of_drive(drive: SlideInertia, mechanism: Mechanism) -> tuple[str, OfJoint]:
    return _slide(drive, mechanism), OfJoint(armature=drive.inertia)


def _add_motor(record: RecordedTorque, actuator: ET.Element, _: Mechanism) -> None:
    add(actuator, "motor", name=record.name, tendon=_tendon(record))


def _add_slide_motor(record: RecordedForce, actuator: ET.Element, mechanism: Mechanism) -> None:
    add(actuator, "motor", name=record.name, joint=_slide(record, mechanism))


def _held(record: RecordedEffort, t: float) -> float:
    (effort,) = record.at(t).efforts
    return effort


def _slide(element: SlideSpringDamper | SlideInertia | RecordedForce, mechanism: Mechanism) -> str:
    joint = mechanism.joint_of(element.body)
    return slide_joints(joint)[joint.slides.index(element.coordinate)]


def _add_slide_force(spring: SlideSpringDamper, actuator: ET.Element, mechanism: Mechanism) -> None:
    if spring.force:
        joint = _slide(spring, mechanism)
        add(actuator, "general", _CONSTANT, name=spring.name, joint=joint, biasprm=spring.force)


# Sites, tendons and actuators stand in this order in the files.
FORCE_WRITERS: ElementTable[_ForceWriter[Any]] = ElementTable(
    "the MJCF writer",
    FORCE_ELEMENTS,
    {
        SpringDamper: _ForceWriter(add_sites=_add_spring_sites, add_tendon=_add_spring),
        RotationalSpringDamper: _ForceWriter(add_tendon=_angle_spring(_strength)),
        CubicTorsionSpring: _ForceWriter(add_tendon=_angle_spring(_cubic_strength)),
        ConstantForce: _ForceWriter(add_sites=_add_force_site, add_actuator=_add_force),
        ConstantTorque: _ForceWriter(add_tendon=_add_torque_tendon, add_actuator=_add_torque),
        RotorInertia: _ForceWriter(of_joint=_of_hinge),
        SlideSpringDamper: _ForceWriter(of_joint=_of_slide, add_actuator=_add_slide_force),
        SlideInertia: _ForceWriter(of_joint=_of_drive),
        RecordedTorque: _ForceWriter(
            add_tendon=_add_torque_tendon, add_actuator=_add_motor, control=_held
        ),
        RecordedForce: _ForceWriter(add_actuator=_add_slide_motor, control=_held),
    },
)
