"""A mechanism as an Exudyn system: redundant coordinates, joints and stops as algebraic constraints.

Items: a pin is a revolute joint; a slot is a prismatic joint that leaves the rotation free, which a
prismatic joint holds; a weld is a revolute joint and a constraint of two rotations; a free joint is
nothing. Angles that follow from other conditions are left out (:mod:`.rigid_loops`). Stops: see
:mod:`.constraints`; springs, dampers and constant
forces: see :mod:`.forces`.

Every body is a 2D node at its centre of mass, with a rotation that is positive *anticlockwise*: the
mechanism's angles have the opposite sign. Recorded quantities are the outputs of Exudyn's sensors.
"""

from __future__ import annotations

import cmath
import importlib
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import UnsupportedProblemError
from ...models.force_elements import ConstantForce, ConstantTorque, SpringDamper
from ...models.joints import GROUND, AnyJoint, WeldJoint
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Marker, Mechanism
from ...models.problem import StopLaw
from ...models.spec import Vector
from ...models.stops import PointStop, Stop
from ..contact_events import Contacts, refuse_moving_gaps
from . import forces
from .constraints import AngleLimit, PointContact, Spring, UnilateralConstraint
from .lines import RelativePoint, on_joint, on_wall
from .rigid_loops import implied_angles
from .sensors import SensorKey

exu: Any = importlib.import_module("exudyn")
items: Any = importlib.import_module("exudyn.itemInterface")


@dataclass(frozen=True)
class System:
    """An assembled Exudyn system and the numbers of its items."""

    mechanism: Mechanism
    container: Any
    """Owns the system: it must live as long."""
    main: Any
    nodes: dict[str, int] = field(default_factory=dict[str, int])
    bodies: dict[str, int] = field(default_factory=dict[str, int])
    stops: dict[str, int] = field(default_factory=dict[str, int])
    """Items of the stops: of all under the unilateral law, else of those that touch at the start: no other acts."""
    constraints: dict[str, UnilateralConstraint] = field(
        default_factory=dict[str, UnilateralConstraint]
    )
    """Of the same stops."""
    springs: Mapping[str, Spring] = field(default_factory=dict[str, Spring])
    """Of the stops, where they are springs; empty where they are constraints."""
    sensors: dict[SensorKey, int] = field(default_factory=dict[SensorKey, int])
    left_out: frozenset[str] = frozenset()
    """Loop joints whose held angle is not built, because it follows from the other conditions."""

    def torque(self, stop: str) -> float:
        """Torque (or force) of a stop at the current state [N m, N]."""
        return float(self.constraints[stop].torque(self.now)[0])

    def now(self, sensor: SensorKey) -> FloatArray:
        """Values of a sensor at the current state, shape (1, components)."""
        return np.atleast_2d(
            np.asarray(self.main.GetSensorValues(self.sensors[sensor]), dtype=np.float64)
        )

    @property
    def active(self) -> Contacts:
        """The stops that act."""
        items = self.stops.items()
        return tuple(
            name
            for name, number in items
            if self.main.GetObjectParameter(number, "activeConnector")
        )

    def set_active(self, active: Contacts) -> None:
        """Make exactly these stops act."""
        for name, number in self.stops.items():
            self.main.SetObjectParameter(number, "activeConnector", name in active)

    def gap(self, stop: str) -> float:
        """Gap of a stop that touches at the start, by its connector's own measure [rad, m]."""
        return self.constraints[stop].connector_gap(
            lambda variable: self._output(stop, variable), self.now
        )

    def _output(self, stop: str, variable: str) -> FloatArray:
        return np.asarray(
            self.main.GetObjectOutput(self.stops[stop], getattr(exu.OutputVariableType, variable))
        )

    def preload(self, stop: str, torque: float) -> None:
        """Give a stop's spring this torque (or force) with the gap closed and at rest [N m, N]."""
        offset = _offset(self.springs[stop], self.constraints[stop].sense, torque)
        self.main.SetObjectParameter(self.stops[stop], "offset", offset)

    def local(self, body: str, point: Vector) -> list[float]:
        """A point of a body from its centre of mass, where Exudyn's node is [m]."""
        if body == GROUND:
            return [*point, 0.0]
        centre = self.mechanism.body(body).centre
        return [point[0] - centre[0], point[1] - centre[1], 0.0]


def _offset(spring: Spring, sense: int, torque: float) -> float:
    return -sense * torque / spring.stiffness


@contextmanager
def silence() -> Generator[None]:
    """Keep Exudyn from writing to the console, as it does when a step fails, and leave it as it was."""
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
        UnsupportedProblemError: a closed stop's gap changes at the start, a stop is on a point of
            the body that it stands on, or a spring is to stand on a body.
    """
    _refuse_what_cannot_be_built(mechanism, springs or {})
    container = exu.SystemContainer()
    left_out = implied_angles(mechanism)
    system = System(
        mechanism, container, container.AddSystem(), springs=springs or {}, left_out=left_out
    )
    return _Builder(system, law).build()


def _refuse_what_cannot_be_built(mechanism: Mechanism, springs: Mapping[str, Spring]) -> None:
    refuse_moving_gaps(
        mechanism, "exudyn"
    )  # index 2 would hold the gap's speed at zero from the first step: an impact
    for stop in mechanism.point_stops:
        if stop.body == stop.relative_to:
            on = (
                "the ground"
                if stop.body == GROUND
                else f"{stop.body!r}, on which its wall stands as well"
            )
            raise UnsupportedProblemError(
                f"exudyn cannot build {stop.name!r}: a stop on a point of {on}."
            )
        if stop.name in springs and stop.relative_to != GROUND:
            # Exudyn's linear spring pushes its first marker, not the point of contact: the torque
            # would be wrong.
            raise UnsupportedProblemError(
                f"exudyn cannot build {stop.name!r} as a spring: its springs along a line are right for walls of the "
                f"ground only, and this wall stands on {stop.relative_to!r}; leave stop_stiffness out."
            )


@dataclass(frozen=True)
class _Builder:
    system: System
    law: StopLaw

    def build(self) -> System:
        self._add_bodies()
        ground = self.system.main.AddObject(items.ObjectGround())
        self.system.bodies[GROUND] = int(ground)
        self.system.nodes[GROUND] = int(self.system.main.AddNode(items.NodePointGround()))
        for joint in self.system.mechanism.joints:
            self._add_joint(joint)
        self._add_force_elements()
        for stop in self.system.mechanism.stops:
            if self._acts(stop):
                self._add_stop(stop)
        for marker in self.system.mechanism.markers:
            self._observe_point("marker", marker.name, marker)
        self.system.main.Assemble()
        return self.system

    def _acts(self, stop: Stop | PointStop) -> bool:
        if self.system.springs:
            return stop.name in self.system.springs
        return stop.closed or self.law is StopLaw.UNILATERAL

    def _add_bodies(self) -> None:
        mechanism, main = self.system.mechanism, self.system.main
        kinematics, (q, u) = Kinematics(mechanism), initial_state(mechanism)
        weight = [*mechanism.gravity_vector, 0.0]
        for body in mechanism.bodies:
            row, angle = kinematics.point(body.name, body.centre), kinematics.angle(body.name)
            at, speed = kinematics.position(row, q), kinematics.velocity(row, q, u)
            turn, spin = -float(angle.value(q)), -float(angle.coefficients @ u)
            node = main.AddNode(
                items.NodeRigidBody2D(
                    referenceCoordinates=[*at.tolist(), turn],
                    initialVelocities=[*speed.tolist(), spin],
                )
            )
            number = main.AddObject(
                items.ObjectRigidBody2D(mass=body.mass, inertia=body.inertia, nodeNumber=node)
            )
            on = main.AddMarker(items.MarkerBodyMass(bodyNumber=number))
            main.AddLoad(items.LoadMassProportional(markerNumber=on, loadVector=weight))
            self.system.nodes[body.name], self.system.bodies[body.name] = int(node), int(number)
            self._observe_body(body.name)

    def _observe_body(self, name: str) -> None:
        for quantity in ("CoordinatesTotal", "Coordinates", "Coordinates_t"):
            self._observe(
                items.SensorNode, ("body", name, quantity), nodeNumber=self.system.nodes[name]
            )
        self._observe(
            items.SensorBody, ("body", name, "KineticEnergy"), bodyNumber=self.system.bodies[name]
        )

    def _observe_point(
        self,
        kind: str,
        name: str,
        marker: Marker,
        quantities: tuple[str, ...] = ("Position", "Velocity"),
    ) -> None:
        number, local = (
            self.system.bodies[marker.body],
            self.system.local(marker.body, marker.point),
        )
        for quantity in quantities:
            self._observe(
                items.SensorBody, (kind, name, quantity), bodyNumber=number, localPosition=local
            )

    def _observe(self, sensor: Any, key: SensorKey, **where: Any) -> None:
        variable = getattr(exu.OutputVariableType, key[2])
        stored = sensor(outputVariableType=variable, storeInternal=True, writeToFile=False, **where)
        self.system.sensors[key] = int(self.system.main.AddSensor(stored))

    def _frame(self, body: str, point: Vector) -> int:
        at = self.system.local(body, point)
        return int(
            self.system.main.AddMarker(
                items.MarkerBodyRigid(bodyNumber=self.system.bodies[body], localPosition=at)
            )
        )

    def _observe_relative(self, relative: RelativePoint, *more: str) -> None:
        quantities = ("Position", "Velocity", *more)
        for kind, point in (
            (relative.kind, relative.point),
            (relative.anchor_kind, relative.anchor),
        ):
            if point.body != GROUND:
                self._observe_point(kind, point.name, point, quantities)

    def _add_joint(self, joint: AnyJoint) -> None:
        if joint.free_directions:
            self._observe_relative(on_joint(joint))
        if not joint.held_directions:
            return
        markers = [
            self._frame(joint.child, joint.child_point),
            self._frame(joint.parent, joint.parent_point),
        ]
        if joint.free_directions:
            self._add_slot(joint, markers)
            return
        number = int(self.system.main.AddObject(items.ObjectJointRevolute2D(markerNumbers=markers)))
        for quantity in ("Force", "Displacement"):
            self._observe(items.SensorObject, ("joint", joint.name, quantity), objectNumber=number)
        if (
            isinstance(joint, WeldJoint) and joint.name not in self.system.left_out
        ):  # displacements from the start: its angle is held as it is there
            rotations = [self._rotation(joint.parent), self._rotation(joint.child)]
            self.system.main.AddObject(items.ObjectConnectorCoordinate(markerNumbers=rotations))

    def _add_slot(self, joint: AnyJoint, markers: list[int]) -> None:
        (normal,) = map(complex, joint.held_directions)
        angle = None if joint.name in self.system.left_out else joint.turned_by
        item = self._line(markers, (normal.real, normal.imag), angle)
        number = int(self.system.main.AddObject(item))
        self._observe(items.SensorObject, ("joint", joint.name, "ForceLocal"), objectNumber=number)

    def _add_force_elements(self) -> None:
        main, mechanism = self.system.main, self.system.mechanism
        for element in mechanism.force_elements:
            if isinstance(element, ConstantForce):
                main.AddLoad(forces.force(element, self._frame(element.body, element.point)))
            elif isinstance(element, ConstantTorque):
                for body, sense in zip(element.bodies, (1, -1), strict=True):
                    main.AddLoad(forces.torque(element, self._frame(body, (0.0, 0.0)), sense))
            else:
                if isinstance(element, SpringDamper):
                    ends = (
                        (element.relative_to, element.relative_point),
                        (element.body, element.point),
                    )
                    item = forces.point_spring(element, [self._frame(*end) for end in ends])
                else:
                    rotations = [self._rotation(element.relative_to), self._rotation(element.body)]
                    item = forces.rotational_spring(element, mechanism, rotations)
                number = int(main.AddObject(item))
                key = ("spring", element.name, forces.measure(element))
                self._observe(items.SensorObject, key, objectNumber=number)

    def _add_stop(self, stop: Stop | PointStop) -> None:
        spring = self.system.springs.get(stop.name)
        if isinstance(stop, PointStop):
            constraint, item = PointContact(stop, spring), self._point_contact(stop, spring)
        else:
            constraint, item = AngleLimit(stop, spring), self._angle_limit(stop, spring)
        number = int(self.system.main.AddObject(item))
        self.system.stops[stop.name], self.system.constraints[stop.name] = number, constraint
        self._observe(
            items.SensorObject, ("stop", stop.name, constraint.force_sensor), objectNumber=number
        )

    def _angle_limit(self, stop: Stop, spring: Spring | None) -> Any:
        # Coordinates count from the reference, and a closed stop's gap is zero there: it needs no
        # offset.
        markers = [self._rotation(stop.relative_to), self._rotation(stop.body)]
        if spring:
            return items.ObjectConnectorCoordinateSpringDamper(
                **_spring_fields(spring, stop.sense, markers)
            )
        mechanism = self.system.mechanism
        open_by = (
            0.0
            if stop.closed
            else float(Kinematics(mechanism).gap(stop.name, np.array(mechanism.start)))
        )
        return items.ObjectConnectorCoordinate(markerNumbers=markers, offset=stop.sense * open_by)

    def _point_contact(self, stop: PointStop, spring: Spring | None) -> Any:
        self._observe_relative(on_wall(stop), "Acceleration")
        x, y = stop.normal
        point = self._frame(stop.body, stop.point)
        line = self._frame(stop.relative_to, (x * stop.offset, y * stop.offset))
        if spring:
            fields = _spring_fields(spring, 1, [line, point])
            return items.ObjectConnectorLinearSpringDamper(axisMarker0=[-x, -y, 0.0], **fields)
        return self._line([point, line], (x, y))

    def _line(self, markers: list[int], normal: Vector, angle: float | None = None) -> Any:
        """A point (marker 0) on a line of the ground or a body (marker 1), by its normal.

        The normal lives in marker 1's frame, so the line's body must be marker 1: the other way
        round the line silently turns with the point's body. The force comes in marker 0's frame.

        Args:
            angle: of marker 0's body less that of the line's, clockwise, if it is held [rad]; None:
                it turns freely.
        """
        x, y = normal
        along = complex(y, -x) * cmath.exp(
            1j * (angle or 0.0)
        )  # the line in the frame of marker 0, at that angle
        return items.ObjectJointPrismatic2D(
            markerNumbers=markers,
            axisMarker0=[along.real, along.imag, 0.0],
            normalMarker1=[x, y, 0.0],
            constrainRotation=angle is not None,
        )

    def _rotation(self, body: str) -> int:
        coordinate = 0 if body == GROUND else 2
        marker = items.MarkerNodeCoordinate(
            nodeNumber=self.system.nodes[body], coordinate=coordinate
        )
        return int(self.system.main.AddMarker(marker))


def _spring_fields(spring: Spring, sense: int, markers: list[int]) -> dict[str, Any]:
    """Of the item of a spring whose torque grows as the gap closes."""
    return {
        "markerNumbers": markers,
        "stiffness": spring.stiffness,
        "damping": spring.damping,
        "offset": _offset(spring, sense, spring.torque),
    }
