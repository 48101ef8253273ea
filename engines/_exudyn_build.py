"""A mechanism as an Exudyn system: redundant coordinates, joints and stops as algebraic constraints.

Every body is a 2D node at its centre of mass, with a rotation that is positive *anticlockwise*: the mechanism's
angles have the opposite sign. What is to be reported is asked of Exudyn by sensors.
"""

from __future__ import annotations

import importlib
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..models.arrays import FloatArray
from ..models.errors import UnsupportedProblemError
from ..models.kinematics import Kinematics
from ..models.mechanism import GROUND, Joint, Marker, Mechanism, SlotJoint, Stop
from ..models.spec import Vector

exu: Any = importlib.import_module("exudyn")
items: Any = importlib.import_module("exudyn.itemInterface")

_STILL = 1e-12  # [rad/s] a gap speed below this is rounding of the two bodies' speeds

SensorKey = tuple[str, str, str]
"""Kind of item (body, marker, joint, stop), its name, the quantity as Exudyn calls it."""


@dataclass(frozen=True)
class Spring:
    """A stop as a spring and damper between the rotations."""

    stiffness: float
    """[N m/rad]"""
    damping: float = 0.0
    """[N m s/rad]"""
    torque: float = 0.0
    """With the gap closed and at rest [N m]."""


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
    """Items of the stops that touch at the start; the others never act under the release-once law."""
    springs: Mapping[str, Spring] = field(default_factory=dict[str, Spring])
    """Of the stops, where they are springs; empty where they are constraints."""
    sensors: dict[SensorKey, int] = field(default_factory=dict[SensorKey, int])

    def torque(self, stop: str) -> float:
        """Torque of a stop at the current state [N m]."""
        force = self.main.GetObjectOutput(self.stops[stop], exu.OutputVariableType.Force)
        return self.mechanism.stop(stop).sense * float(force)

    def set_closed(self, closed: tuple[str, ...]) -> None:
        """Make exactly these stops act."""
        for name, number in self.stops.items():
            self.main.SetObjectParameter(number, "activeConnector", name in closed)

    def gap(self, stop: str) -> float:
        """Gap of a stop that touches at the start, by Exudyn's own coordinates [rad]."""
        # A constraint's own equation includes its offset; a spring's is its preload, and no gap.
        variable = exu.OutputVariableType.Displacement if self.springs else exu.OutputVariableType.ConstraintEquation
        return -self.mechanism.stop(stop).sense * float(self.main.GetObjectOutput(self.stops[stop], variable))

    def preload(self, stop: str, torque: float) -> None:
        """Give a stop's spring this torque with the gap closed and at rest [N m]."""
        self.main.SetObjectParameter(self.stops[stop], "offset", self._offset(stop, torque))

    def _offset(self, stop: str, torque: float) -> float:
        return -self.mechanism.stop(stop).sense * torque / self.springs[stop].stiffness

    def local(self, body: str, point: Vector) -> list[float]:
        """A point of a body from its centre of mass, where Exudyn's node stands [m]."""
        if body == GROUND:
            return [*point, 0.0]
        centre = self.mechanism.body(body).centre
        return [point[0] - centre[0], point[1] - centre[1], 0.0]

    def spring(self, stop: str, markers: list[int]) -> Any:
        """The item of a stop's spring: its torque grows as the gap closes."""
        spring = self.springs[stop]
        return items.ObjectConnectorCoordinateSpringDamper(
            markerNumbers=markers,
            stiffness=spring.stiffness,
            damping=spring.damping,
            offset=self._offset(stop, spring.torque),
        )


@contextmanager
def silence() -> Generator[None]:
    """Keep Exudyn from writing to the console, as it does when a step fails, and leave it as it was."""
    before = exu.config.printToConsole, exu.config.suppressWarnings
    exu.config.printToConsole, exu.config.suppressWarnings = False, True
    try:
        yield
    finally:
        exu.config.printToConsole, exu.config.suppressWarnings = before


def build(mechanism: Mechanism, springs: Mapping[str, Spring] | None = None) -> System:
    """Build and assemble the system at its start.

    Args:
        mechanism: what to build.
        springs: of the stops that act; none: the stops that touch are constraints.

    Raises:
        UnsupportedProblemError: a touching stop is being left or hit at the start, or a slot carries the ground.
    """
    _refuse_what_cannot_be_built(mechanism)
    container = exu.SystemContainer()
    system = System(mechanism, container, container.AddSystem(), springs=springs or {})
    return _Builder(system).build()


def _refuse_what_cannot_be_built(mechanism: Mechanism) -> None:
    kinematics, u = Kinematics(mechanism), start_speeds(mechanism)
    for stop in mechanism.stops:
        # Index 2 would hold the gap's speed at zero from the first step: an impact nobody asked for.
        speed = float(kinematics.gap_row(stop.name) @ u)
        if stop.closed and abs(speed) > _STILL:
            raise UnsupportedProblemError(
                f"exudyn cannot start with stop {stop.name!r} closed while its gap changes at {speed:.3g} rad/s."
            )
    for joint in mechanism.joints:
        if isinstance(joint, SlotJoint) and joint.child == GROUND:
            raise UnsupportedProblemError(f"exudyn cannot build {joint.name!r}: a slot in the ground holds the ground.")


def start_speeds(mechanism: Mechanism) -> FloatArray:
    """Speeds at t = 0 [rad/s or m/s], shape (n_q,)."""
    return np.array(mechanism.start_speeds or [0.0] * len(mechanism.coordinates))


@dataclass(frozen=True)
class _Builder:
    system: System

    def build(self) -> System:
        self._add_bodies()
        ground = self.system.main.AddObject(items.ObjectGround())
        self.system.bodies[GROUND] = int(ground)
        self.system.nodes[GROUND] = int(self.system.main.AddNode(items.NodePointGround()))
        for joint in self.system.mechanism.joints:
            self._add_joint(joint)
        for stop in self.system.mechanism.stops:
            if stop.closed and (not self.system.springs or stop.name in self.system.springs):
                self._add_stop(stop)
        for marker in self.system.mechanism.markers:
            self._observe_point("marker", marker.name, marker)
        self.system.main.Assemble()
        return self.system

    def _add_bodies(self) -> None:
        mechanism, main = self.system.mechanism, self.system.main
        kinematics, q, u = Kinematics(mechanism), np.array(mechanism.start), start_speeds(mechanism)
        for i, body in enumerate(mechanism.bodies):
            row = kinematics.point(body.name, body.centre)
            at, speed = kinematics.position(row, q), kinematics.velocity(row, q, u)
            node = main.AddNode(
                items.NodeRigidBody2D(
                    referenceCoordinates=[*at.tolist(), -float(q[i])], initialVelocities=[*speed.tolist(), -float(u[i])]
                )
            )
            number = main.AddObject(items.ObjectRigidBody2D(mass=body.mass, inertia=body.inertia, nodeNumber=node))
            weight = [0.0, -mechanism.gravity, 0.0]
            on = main.AddMarker(items.MarkerBodyMass(bodyNumber=number))
            main.AddLoad(items.LoadMassProportional(markerNumber=on, loadVector=weight))
            self.system.nodes[body.name], self.system.bodies[body.name] = int(node), int(number)
            self._observe_body(body.name)

    def _observe_body(self, name: str) -> None:
        for quantity in ("CoordinatesTotal", "Coordinates", "Coordinates_t"):
            self._observe(items.SensorNode, ("body", name, quantity), nodeNumber=self.system.nodes[name])
        self._observe(items.SensorBody, ("body", name, "KineticEnergy"), bodyNumber=self.system.bodies[name])

    def _observe_point(self, kind: str, name: str, marker: Marker) -> None:
        number, local = self.system.bodies[marker.body], self.system.local(marker.body, marker.point)
        for quantity in ("Position", "Velocity"):
            self._observe(items.SensorBody, (kind, name, quantity), bodyNumber=number, localPosition=local)

    def _observe(self, sensor: Any, key: SensorKey, **where: Any) -> None:
        variable = getattr(exu.OutputVariableType, key[2])
        stored = sensor(outputVariableType=variable, storeInternal=True, writeToFile=False, **where)
        self.system.sensors[key] = int(self.system.main.AddSensor(stored))

    def _frame(self, body: str, point: Vector) -> int:
        at = self.system.local(body, point)
        return int(
            self.system.main.AddMarker(items.MarkerBodyRigid(bodyNumber=self.system.bodies[body], localPosition=at))
        )

    def _add_joint(self, joint: Joint) -> None:
        markers = [self._frame(joint.child, joint.child_point), self._frame(joint.parent, joint.parent_point)]
        if isinstance(joint, SlotJoint):
            self._add_slot(joint, markers)
            return
        number = int(self.system.main.AddObject(items.ObjectJointRevolute2D(markerNumbers=markers)))
        for quantity in ("Force", "Displacement"):
            self._observe(items.SensorObject, ("joint", joint.name, quantity), objectNumber=number)

    def _add_slot(self, joint: SlotJoint, markers: list[int]) -> None:
        # The slot's normal lives in marker 1's frame, so the ground must be marker 1: the other way round the
        # slot silently turns with the body. The force comes in marker 0's frame, which does turn.
        x, y = joint.axis
        slot = items.ObjectJointPrismatic2D(
            markerNumbers=markers, axisMarker0=[x, y, 0.0], normalMarker1=[-y, x, 0.0], constrainRotation=False
        )
        number = int(self.system.main.AddObject(slot))
        self._observe(items.SensorObject, ("joint", joint.name, "ForceLocal"), objectNumber=number)
        self._observe_point("joint", joint.name, Marker(name=joint.name, body=joint.child, point=joint.child_point))

    def _add_stop(self, stop: Stop) -> None:
        # Coordinates count from the reference, and a closed stop's gap is zero there: no offset is needed.
        others = self._rotation(stop.relative_to)
        markers = [others, self._rotation(stop.body)]
        connector = (
            self.system.spring(stop.name, markers)
            if self.system.springs
            else items.ObjectConnectorCoordinate(markerNumbers=markers)
        )
        number = int(self.system.main.AddObject(connector))
        self.system.stops[stop.name] = number
        self._observe(items.SensorObject, ("stop", stop.name, "Force"), objectNumber=number)

    def _rotation(self, body: str) -> int:
        coordinate = 0 if body == GROUND else 2
        marker = items.MarkerNodeCoordinate(nodeNumber=self.system.nodes[body], coordinate=coordinate)
        return int(self.system.main.AddMarker(marker))
