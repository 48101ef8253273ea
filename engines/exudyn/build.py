"""Exudyn's system of a mechanism: redundant coordinates, joints and stops as algebraic constraints.

Items: a pin is a revolute joint; a slot is a prismatic joint that leaves the rotation free, which a
prismatic joint holds; a weld is a revolute joint and a constraint of two rotations; a free joint is
nothing. Angles that follow from other conditions are left out (:mod:`.loops`). Stops are described
in :mod:`.read`; springs and dampers are connectors, constant forces and torques are loads.

Every body is a 2D node at its centre of mass, with a rotation that is positive *anticlockwise*: the
mechanism's angles have the opposite sign. Recorded quantities are the outputs of Exudyn's sensors.
"""

from __future__ import annotations

import cmath
import importlib
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from ...models.elements import (
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
from ...models.errors import UnsupportedProblemError
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Marker, Mechanism
from ...models.problem import StopLaw
from ...models.spec import Vector
from ..events import refuse_moving_gaps
from .loops import implied_angles
from .read import (
    AngleLimit,
    LineContact,
    RelativePoint,
    SensorKey,
    Spring,
    System,
    UnilateralConstraint,
    exu,
    on_joint,
    on_wall,
    rest_displacement,
)

items: Any = importlib.import_module("exudyn.itemInterface")


@contextmanager
def silence() -> Generator[None]:
    """Keep Exudyn from writing to the console, as it does when a step fails."""
    before = exu.config.printToConsole, exu.config.suppressWarnings
    exu.config.printToConsole, exu.config.suppressWarnings = False, True
    try:
        yield
    finally:
        exu.config.printToConsole, exu.config.suppressWarnings = before


def build(
    mechanism: Mechanism,
    springs: Mapping[str, Spring] | None = None,
    law: StopLaw = StopLaw.RELEASE_ONCE,
) -> System:
    """Build and assemble the system at its start.

    Args:
        mechanism: what to build.
        springs: of the stops that act; none: the stops that touch are constraints.
        law: of the stops; under the unilateral one those that are open at the start are built, too.

    Raises:
        UnsupportedProblemError: an element is refused, a closed stop's gap changes at the start, a
            stop is on a point of the body that it stands on, or a spring is to stand on a body.
    """
    _refuse_what_cannot_be_built(mechanism, springs or {})
    container = exu.SystemContainer()
    left_out = implied_angles(mechanism)
    system = System(
        mechanism, container, container.AddSystem(), springs=springs or {}, left_out=left_out
    )
    builder = _Builder(system)
    builder.add_bodies()
    for joint in mechanism.joints:
        JOINT_BUILDERS[joint](builder, joint)
    for element in mechanism.force_elements:
        FORCE_BUILDERS[element](builder, element)
    for stop in mechanism.stops:
        add_stop = STOP_BUILDERS[stop]
        acts = stop.name in springs if springs else stop.closed or law is StopLaw.UNILATERAL
        if acts:
            add_stop(builder, stop)
    for marker in mechanism.markers:
        builder.observe_point("marker", marker.name, marker)
    system.main.Assemble()
    return system


def _refuse_what_cannot_be_built(mechanism: Mechanism, springs: Mapping[str, Spring]) -> None:
    # Index 2 would hold the gap's speed at zero from the first step: an impact.
    refuse_moving_gaps(mechanism, "exudyn")
    for stop in mechanism.point_stops:
        if stop.body == stop.relative_to:
            wall = f"{stop.body!r}, on which its wall stands as well"
            body = "the ground" if stop.body == GROUND else wall
            raise UnsupportedProblemError(
                f"exudyn cannot build {stop.name!r}: a stop on a point of {body}."
            )
        if stop.name in springs and stop.relative_to != GROUND:
            # Exudyn's linear spring pushes its first marker, not the point of contact: the torque
            # would be wrong.
            raise UnsupportedProblemError(
                f"exudyn cannot build {stop.name!r} as a spring: its springs along a line are "
                f"right for walls of the ground only, and this wall stands on "
                f"{stop.relative_to!r}; leave stop_stiffness out."
            )


class _Builder:
    """Adds bodies, joints, force elements, stops and sensors to a system."""

    def __init__(self, system: System) -> None:
        self.system, self.main, self.mechanism = system, system.main, system.mechanism

    def add_bodies(self) -> None:
        """Add the bodies with their weight, and the ground."""
        kinematics, (q, u) = Kinematics(self.mechanism), initial_state(self.mechanism)
        weight = [*self.mechanism.gravity_vector, 0.0]
        for body in self.mechanism.bodies:
            row, angle = kinematics.point(body.name, body.centre), kinematics.angle(body.name)
            at, speed = kinematics.position(row, q), kinematics.velocity(row, q, u)
            turn, spin = -float(angle.value(q)), -float(angle.coefficients @ u)
            node = self.main.AddNode(
                items.NodeRigidBody2D(
                    referenceCoordinates=[*at.tolist(), turn],
                    initialVelocities=[*speed.tolist(), spin],
                )
            )
            number = self.main.AddObject(
                items.ObjectRigidBody2D(mass=body.mass, inertia=body.inertia, nodeNumber=node)
            )
            on = self.main.AddMarker(items.MarkerBodyMass(bodyNumber=number))
            self.main.AddLoad(items.LoadMassProportional(markerNumber=on, loadVector=weight))
            self.system.nodes[body.name], self.system.bodies[body.name] = int(node), int(number)
            for quantity in ("CoordinatesTotal", "Coordinates", "Coordinates_t"):
                self._observe(items.SensorNode, ("body", body.name, quantity), nodeNumber=node)
            key = ("body", body.name, "KineticEnergy")
            self._observe(items.SensorBody, key, bodyNumber=number)
        self.system.bodies[GROUND] = int(self.main.AddObject(items.ObjectGround()))
        self.system.nodes[GROUND] = int(self.main.AddNode(items.NodePointGround()))

    def observe_point(
        self,
        kind: str,
        name: str,
        marker: Marker,
        quantities: tuple[str, ...] = ("Position", "Velocity"),
    ) -> None:
        """Add sensors of a body's point."""
        number = self.system.bodies[marker.body]
        local = self.system.local(marker.body, marker.point)
        for quantity in quantities:
            key = (kind, name, quantity)
            self._observe(items.SensorBody, key, bodyNumber=number, localPosition=local)

    def _observe(self, sensor: Any, key: SensorKey, **where: Any) -> None:
        variable = getattr(exu.OutputVariableType, key[2])
        stored = sensor(outputVariableType=variable, storeInternal=True, writeToFile=False, **where)
        self.system.sensors[key] = int(self.main.AddSensor(stored))

    def _observe_relative(self, relative: RelativePoint, *more: str) -> None:
        quantities = ("Position", "Velocity", *more)
        ends = ((relative.kind, relative.point), (relative.anchor_kind, relative.anchor))
        for kind, point in ends:
            if point.body != GROUND:
                self.observe_point(kind, point.name, point, quantities)

    def _observe_object(self, item: Any, kind: str, name: str, *quantities: str) -> int:
        """Add a connector and sensors of it; the connector's number."""
        number = int(self.main.AddObject(item))
        for quantity in quantities:
            self._observe(items.SensorObject, (kind, name, quantity), objectNumber=number)
        return number

    def _frame(self, body: str, point: Vector) -> int:
        """Marker on a body's point."""
        at = self.system.local(body, point)
        number = self.system.bodies[body]
        marker = items.MarkerBodyRigid(bodyNumber=number, localPosition=at)
        return int(self.main.AddMarker(marker))

    def _rotations(self, *bodies: str) -> list[int]:
        """Markers on the rotations of bodies."""
        return [
            int(
                self.main.AddMarker(
                    items.MarkerNodeCoordinate(
                        nodeNumber=self.system.nodes[body], coordinate=0 if body == GROUND else 2
                    )
                )
            )
            for body in bodies
        ]

    def _joint_frames(self, joint: AnyJoint) -> list[int]:
        child = self._frame(joint.child, joint.child_point)
        return [child, self._frame(joint.parent, joint.parent_point)]

    # Joints.

    def add_free(self, joint: FreeJoint) -> None:
        """Add the sensors of a joint that holds nothing."""
        self._observe_relative(on_joint(joint))

    def add_pin(self, joint: PinJoint | WeldJoint) -> None:
        """Add a revolute joint."""
        item = items.ObjectJointRevolute2D(markerNumbers=self._joint_frames(joint))
        self._observe_object(item, "joint", joint.name, "Force", "Displacement")

    def add_weld(self, joint: WeldJoint) -> None:
        """Add a revolute joint and a constraint that holds the angle it has at the start."""
        self.add_pin(joint)
        if joint.name not in self.system.left_out:
            rotations = self._rotations(joint.parent, joint.child)
            self.main.AddObject(items.ObjectConnectorCoordinate(markerNumbers=rotations))

    def add_slot(self, joint: SlotJoint | PrismaticJoint) -> None:
        """Add a prismatic joint, which leaves the rotation free unless the joint holds it."""
        self._observe_relative(on_joint(joint))
        (normal,) = map(complex, joint.held_directions)
        angle = None if joint.name in self.system.left_out else joint.turned_by
        item = self._line(self._joint_frames(joint), (normal.real, normal.imag), angle)
        self._observe_object(item, "joint", joint.name, "ForceLocal")

    def _line(self, markers: list[int], normal: Vector, angle: float | None = None) -> Any:
        """A point (marker 0) on a line of the ground or a body (marker 1), by its normal.

        The normal lives in marker 1's frame, so the line's body must be marker 1: the other way
        round the line silently turns with the point's body. The force comes in marker 0's frame.

        Args:
            angle: of marker 0's body less that of the line's, clockwise, if it is held [rad]; None:
                it turns freely.
        """
        x, y = normal
        # The line in the frame of marker 0, at that angle.
        along = complex(y, -x) * cmath.exp(1j * (angle or 0.0))
        return items.ObjectJointPrismatic2D(
            markerNumbers=markers,
            axisMarker0=[along.real, along.imag, 0.0],
            normalMarker1=[x, y, 0.0],
            constrainRotation=angle is not None,
        )

    # Force elements.

    def add_force(self, element: ConstantForce) -> None:
        """Add the load of a constant force, whose direction does not turn with the body."""
        load = items.LoadForceVector(
            markerNumber=self._frame(element.body, element.point),
            loadVector=[*element.force, 0.0],
            bodyFixed=False,
        )
        self.main.AddLoad(load)

    def add_torque(self, element: ConstantTorque) -> None:
        """Add the loads of a constant torque on its two bodies; Exudyn's are anticlockwise."""
        for body, sense in zip(element.bodies, (1, -1), strict=True):
            load = items.LoadTorqueVector(
                markerNumber=self._frame(body, (0.0, 0.0)),
                loadVector=[0.0, 0.0, -sense * element.torque],
            )
            self.main.AddLoad(load)

    def add_point_spring(self, spring: SpringDamper) -> None:
        """Add a spring between points; without rest length and damping they may meet."""
        markers = [
            self._frame(spring.relative_to, spring.relative_point),
            self._frame(spring.body, spring.point),
        ]
        if spring.rest_length or spring.damping:
            item = items.ObjectConnectorSpringDamper(
                markerNumbers=markers,
                stiffness=spring.stiffness,
                damping=spring.damping,
                referenceLength=spring.rest_length,
            )
        else:
            item = items.ObjectConnectorCartesianSpringDamper(
                markerNumbers=markers, stiffness=[spring.stiffness] * 2 + [0.0]
            )
        self._observe_object(item, "spring", spring.name, "Distance")

    def add_rotational_spring(self, spring: RotationalSpringDamper) -> None:
        """Add a spring between two rotations: full turns count."""
        item = items.ObjectConnectorCoordinateSpringDamper(
            markerNumbers=self._rotations(spring.relative_to, spring.body),
            stiffness=spring.stiffness,
            damping=spring.damping,
            offset=rest_displacement(spring, self.mechanism),
        )
        self._observe_object(item, "spring", spring.name, "Displacement")

    def add_cubic_spring(self, spring: CubicTorsionSpring) -> None:
        """Add a spring between two rotations whose torque is a user function in Python."""
        cubic_stiffness = spring.cubic_stiffness

        def torque(
            _main: Any,
            _time: float,
            _item: int,
            displacement: float,
            _velocity: float,
            stiffness: float,
            _damping: float,
            offset: float,
        ) -> float:
            # An odd function: of anticlockwise angles as of clockwise ones.
            stretch = displacement - offset
            return stretch * (stiffness + cubic_stiffness * stretch * stretch)

        item = items.ObjectConnectorCoordinateSpringDamper(
            markerNumbers=self._rotations(spring.relative_to, spring.body),
            stiffness=spring.stiffness,
            offset=rest_displacement(spring, self.mechanism),
            springForceUserFunction=torque,
        )
        self._observe_object(item, "spring", spring.name, "Displacement")

    # Stops.

    def add_angle_limit(self, stop: Stop) -> None:
        """Add a constraint, or a spring, between two rotations."""
        spring = self.system.springs.get(stop.name)
        markers = self._rotations(stop.relative_to, stop.body)
        if spring:
            fields = _spring_fields(spring, stop.sense, markers)
            item = items.ObjectConnectorCoordinateSpringDamper(**fields)
        else:
            # Coordinates count from the reference, and a closed stop's gap is zero there: it needs
            # no offset.
            gap = 0.0
            if not stop.closed:
                start = np.array(self.mechanism.start)
                gap = float(Kinematics(self.mechanism).gap(stop.name, start))
            item = items.ObjectConnectorCoordinate(markerNumbers=markers, offset=stop.sense * gap)
        self._add_stop(AngleLimit(stop, spring), item)

    def add_point_contact(self, stop: PointStop) -> None:
        """Add a point on a line, or a spring across that."""
        spring = self.system.springs.get(stop.name)
        self._observe_relative(on_wall(stop), "Acceleration")
        x, y = stop.normal
        point = self._frame(stop.body, stop.point)
        line = self._frame(stop.relative_to, (x * stop.offset, y * stop.offset))
        if spring:
            fields = _spring_fields(spring, 1, [line, point])
            item = items.ObjectConnectorLinearSpringDamper(axisMarker0=[-x, -y, 0.0], **fields)
        else:
            item = self._line([point, line], (x, y))
        self._add_stop(LineContact(stop, spring), item)

    def _add_stop(self, constraint: UnilateralConstraint, item: Any) -> None:
        name = constraint.stop.name
        number = self._observe_object(item, "stop", name, constraint.force_sensor)
        self.system.stops[name], self.system.constraints[name] = number, constraint


def _spring_fields(spring: Spring, sense: int, markers: list[int]) -> dict[str, Any]:
    """Parameters of a connector whose torque grows as the gap closes."""
    return {
        "markerNumbers": markers,
        "stiffness": spring.stiffness,
        "damping": spring.damping,
        "offset": spring.offset(sense, spring.torque),
    }


_Add = Callable[[_Builder, Any], None]

JOINT_BUILDERS: ElementTable[_Add] = ElementTable(
    "exudyn",
    JOINTS,
    {
        PinJoint: _Builder.add_pin,
        WeldJoint: _Builder.add_weld,
        SlotJoint: _Builder.add_slot,
        PrismaticJoint: _Builder.add_slot,
        FreeJoint: _Builder.add_free,
    },
)
STOP_BUILDERS: ElementTable[_Add] = ElementTable(
    "exudyn", STOPS, {Stop: _Builder.add_angle_limit, PointStop: _Builder.add_point_contact}
)
FORCE_BUILDERS: ElementTable[_Add] = ElementTable(
    "exudyn",
    FORCE_ELEMENTS,
    {
        SpringDamper: _Builder.add_point_spring,
        RotationalSpringDamper: _Builder.add_rotational_spring,
        CubicTorsionSpring: _Builder.add_cubic_spring,
        ConstantForce: _Builder.add_force,
        ConstantTorque: _Builder.add_torque,
    },
)
