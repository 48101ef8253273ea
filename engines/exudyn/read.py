"""A built Exudyn system and what its sensors say, in the mechanism's coordinates, names and signs.

Exudyn's rotations are positive anticlockwise, the mechanism's angles clockwise. Points that lie in
frames of other bodies (slides along lines, distances from walls) are :class:`RelativePoint`; gaps
and forces of stops follow from their connectors (:class:`AngleLimit`, :class:`LineContact`); a
:class:`Reader` reads a table of all sensors out.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from ...models.arrays import ComplexArray, FloatArray
from ...models.elements import (
    FORCE_ELEMENTS,
    GROUND,
    AnyJoint,
    ConstantForce,
    ConstantTorque,
    CubicTorsionSpring,
    ElementTable,
    PointStop,
    RotationalSpringDamper,
    SpringDamper,
    Stop,
)
from ...models.kinematics import Kinematics
from ...models.mechanism import Marker, Mechanism
from ...models.spec import Vector
from ...models.trajectory import PointMotion
from ..events import ContactEvents, Contacts
from ..protocol import Recording

exu: Any = importlib.import_module("exudyn")

SensorKey = tuple[str, str, str]
"""Kind of item (body, marker, joint, stop, spring), its name, the quantity as Exudyn calls it."""

Values = Callable[[SensorKey], FloatArray]
"""Values of a sensor, shape (n, components): over a table, or one row of the present."""


def rotation(body: str, values: Values, quantity: str = "CoordinatesTotal") -> FloatArray:
    """Rotation of a body [rad] or its derivative, shape (n,); of the ground 0, shape (1,)."""
    return np.zeros(1) if body == GROUND else values(("body", body, quantity))[:, 2]


def turned(local: FloatArray, angle: FloatArray) -> FloatArray:
    """Vectors (n, 2) of a frame that is turned anticlockwise by angles [rad], shape (n,)."""
    world = (local[:, 0] + 1j * local[:, 1]) * np.exp(1j * angle)
    return np.stack([world.real, world.imag], axis=-1)


@dataclass(frozen=True)
class RelativePoint:
    """A point of a body in the frame of another one (or of the ground), by sensors of both."""

    point: Marker
    """Its name is that of the sensors."""
    kind: str
    """Kind of the point's sensors; what stands on the ground has none."""
    frame: str
    """The other body."""
    origin: Vector
    """Where the frame's anchor is in it [m]."""

    @property
    def anchor(self) -> Marker:
        """The frame's anchor as a point to observe."""
        return Marker(name=self.point.name, body=self.frame, point=self.origin)

    @property
    def anchor_kind(self) -> str:
        """Kind of the anchor's sensors."""
        return f"{self.kind} anchor"

    def place(self, values: Values) -> ComplexArray:
        """From the anchor, in the frame [m], shape (n,)."""
        return self._apart(values, "Position") * self._back(values)

    def speed(self, values: Values) -> ComplexArray:
        """Derivative of the place [m/s], shape (n,)."""
        spin = rotation(self.frame, values, "Coordinates_t")
        speed = self._apart(values, "Velocity") - 1j * spin * self._apart(values, "Position")
        return speed * self._back(values)

    def acceleration(self, values: Values, rotational: float) -> ComplexArray:
        """Its second derivative [m/s^2], shape (n,); `rotational` is the frame's [rad/s^2]."""
        spin = rotation(self.frame, values, "Coordinates_t")
        turning = 2j * spin * self._apart(values, "Velocity")
        turning = turning + (1j * rotational + spin**2) * self._apart(values, "Position")
        return (self._apart(values, "Acceleration") - turning) * self._back(values)

    def _apart(self, values: Values, quantity: str) -> ComplexArray:
        point = _motion(self.kind, self.point, values, quantity)
        return point - _motion(self.anchor_kind, self.anchor, values, quantity)

    def _back(self, values: Values) -> ComplexArray:
        return np.exp(-1j * rotation(self.frame, values))


def on_joint(joint: AnyJoint) -> RelativePoint:
    """The child's point of a joint from the parent's, in the parent's frame."""
    child = Marker(name=joint.name, body=joint.child, point=joint.child_point)
    return RelativePoint(child, "joint", joint.parent, joint.parent_point)


def on_wall(stop: PointStop) -> RelativePoint:
    """The point of a stop from the origin of the wall's frame, in that."""
    point = Marker(name=stop.name, body=stop.body, point=stop.point)
    return RelativePoint(point, "stop", stop.relative_to, (0.0, 0.0))


def _motion(kind: str, point: Marker, values: Values, quantity: str) -> ComplexArray:
    """Position, velocity or acceleration of a point; one of the ground needs no sensor."""
    if point.body == GROUND:
        return np.full(1, complex(*point.point) if quantity == "Position" else 0.0)
    vectors = values((kind, point.name, quantity))
    return vectors[:, 0] + 1j * vectors[:, 1]


ROUNDING = 1e-15
"""[rad] of the difference of two angles of some radians; [m per m] of a point's position."""

Output = Callable[[str], Any]
"""An output variable of a connector at the current state, by its name."""


@dataclass(frozen=True)
class Spring:
    """A stop as a spring and damper between two rotations, or between a point and its line."""

    stiffness: float
    """[N m/rad, N/m]"""
    damping: float = 0.0
    """[N m s/rad, N s/m]"""
    torque: float = 0.0
    """Torque (or force) with the gap closed and at rest [N m, N]."""

    def offset(self, sense: int, torque: float) -> float:
        """Exudyn's offset of a connector that has this torque (or force) with the gap closed."""
        return -sense * torque / self.stiffness


@dataclass(frozen=True)
class AngleLimit:
    """A stop on a relative angle: a connector of two rotations."""

    force_sensor: ClassVar[str] = "Force"
    """Exudyn's name of the connector's force."""

    stop: Stop
    spring: Spring | None

    @property
    def sense(self) -> int:
        """Sign of the connector's displacement that closes the gap: 1 or -1."""
        return self.stop.sense

    def torque(self, values: Values) -> FloatArray:
        """Torque while it is active [N m], shape (n,)."""
        return self.stop.sense * values(("stop", self.stop.name, self.force_sensor))[:, 0]

    def connector_gap(self, output: Output, values: Values) -> float:
        """Gap by the connector's own measure at the current state [rad].

        A constraint's equation includes its offset; the offset of a spring is its preload, and no
        gap.
        """
        return -self.sense * float(output("Displacement" if self.spring else "ConstraintEquation"))

    def gap(self, values: Values) -> float:
        """Gap by the bodies' rotations, of one row of sensors [rad]."""
        return self._turn(lambda body: float(rotation(body, values)[0])) - self.stop.limit

    def gap_speed(self, values: Values) -> float:
        """Speed of the gap, of one row of sensors [rad/s]."""
        return self._turn(lambda body: float(rotation(body, values, "Coordinates_t")[0]))

    def gap_acceleration(self, values: Values, rotations: Mapping[str, float]) -> float:
        """Acceleration of the gap [rad/s^2], by the bodies' rotational accelerations [rad/s^2]."""
        return self._turn(lambda body: rotations.get(body, 0.0))

    def _turn(self, rotation_of: Callable[[str], float]) -> float:
        """Relative angle, clockwise and in the stop's sense, or a derivative of it."""
        stop = self.stop
        return -stop.sense * (rotation_of(stop.body) - rotation_of(stop.relative_to))

    def rounding(self, values: Values) -> float:
        """Rounding error of the gap [rad]."""
        return ROUNDING


@dataclass(frozen=True)
class LineContact:
    """A stop on a point: a line of the ground or of another body, without friction."""

    force_sensor: ClassVar[str] = "ForceLocal"
    sense: ClassVar[int] = 1

    stop: PointStop
    spring: Spring | None

    def torque(self, values: Values) -> FloatArray:
        """Force along the normal while it is active [N], shape (n,)."""
        force = values(("stop", self.stop.name, self.force_sensor))
        return force[:, 0] if self.spring else self._along_normal(force, values)

    def connector_gap(self, output: Output, values: Values) -> float:
        """Gap by the connector's displacement at the current state [m]."""
        displacement = output("DisplacementLocal")
        if self.spring:
            return -float(displacement)
        return -float(self._along_normal(np.atleast_2d(displacement), values)[0])

    def gap(self, values: Values) -> float:
        """Gap by the bodies' coordinates, of one row of sensors [m]."""
        return self._along(on_wall(self.stop).place(values)) - self.stop.offset

    def gap_speed(self, values: Values) -> float:
        """Speed of the gap, of one row of sensors [m/s]."""
        return self._along(on_wall(self.stop).speed(values))

    def gap_acceleration(self, values: Values, rotations: Mapping[str, float]) -> float:
        """Acceleration of the gap [m/s^2], by the bodies' rotational accelerations [rad/s^2]."""
        turning = rotations.get(self.stop.relative_to, 0.0)
        return self._along(on_wall(self.stop).acceleration(values, turning))

    def _along(self, place: ComplexArray) -> float:
        x, y = self.stop.normal
        return x * float(place[0].real) + y * float(place[0].imag)

    def rounding(self, values: Values) -> float:
        """Rounding error of the gap [m]."""
        position = values(("stop", self.stop.name, "Position"))
        return ROUNDING * max(1.0, float(np.abs(position).max()))

    def _along_normal(self, local: FloatArray, values: Values) -> FloatArray:
        # Forces and displacements of a constraint come in the frame of the point's body.
        angle = rotation(self.stop.body, values) - rotation(self.stop.relative_to, values)
        return turned(local, angle) @ np.array(self.stop.normal)


UnilateralConstraint = AngleLimit | LineContact


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
    """Items of the stops: all under the unilateral law, else those that touch at the start."""
    constraints: dict[str, UnilateralConstraint] = field(
        default_factory=dict[str, UnilateralConstraint]
    )
    """Connectors and sensors of the same stops."""
    springs: Mapping[str, Spring] = field(default_factory=dict[str, Spring])
    """Stops that are springs; empty where they are constraints."""
    sensors: dict[SensorKey, int] = field(default_factory=dict[SensorKey, int])
    left_out: frozenset[str] = frozenset()
    """Loop joints whose held angle is not built, because it follows from the other conditions."""

    def torque(self, stop: str) -> float:
        """Torque (or force) of a stop at the current state [N m, N]."""
        return float(self.constraints[stop].torque(self.now)[0])

    def now(self, sensor: SensorKey) -> FloatArray:
        """Values of a sensor at the current state, shape (1, components)."""
        values = self.main.GetSensorValues(self.sensors[sensor])
        return np.atleast_2d(np.asarray(values, dtype=np.float64))

    @property
    def active(self) -> Contacts:
        """The stops that act."""
        parameter, stops = self.main.GetObjectParameter, self.stops.items()
        return tuple(name for name, item in stops if parameter(item, "activeConnector"))

    def set_active(self, active: Contacts) -> None:
        """Make exactly these stops act."""
        for name, number in self.stops.items():
            self.main.SetObjectParameter(number, "activeConnector", name in active)

    def gap(self, stop: str) -> float:
        """Gap of a stop that touches at the start, by its connector's own measure [rad, m]."""

        def output(variable: str) -> FloatArray:
            kind = getattr(exu.OutputVariableType, variable)
            return np.asarray(self.main.GetObjectOutput(self.stops[stop], kind))

        return self.constraints[stop].connector_gap(output, self.now)

    def preload(self, stop: str, torque: float) -> None:
        """Give a stop's spring this torque (or force) with the gap closed and at rest [N m, N]."""
        offset = self.springs[stop].offset(self.constraints[stop].sense, torque)
        self.main.SetObjectParameter(self.stops[stop], "offset", offset)

    def local(self, body: str, point: Vector) -> list[float]:
        """A point of a body from its centre of mass, where Exudyn's node is [m]."""
        if body == GROUND:
            return [*point, 0.0]
        centre = self.mechanism.body(body).centre
        return [point[0] - centre[0], point[1] - centre[1], 0.0]


def _point_spring_energy(spring: SpringDamper, _: Mechanism, values: Values) -> FloatArray:
    distance = values(("spring", spring.name, "Distance"))[:, 0]
    return 0.5 * spring.stiffness * (distance - spring.rest_length) ** 2


def _rotational_spring_energy(
    spring: RotationalSpringDamper | CubicTorsionSpring, mechanism: Mechanism, values: Values
) -> FloatArray:
    rest = rest_displacement(spring, mechanism)
    displacement = values(("spring", spring.name, "Displacement"))[:, 0]
    return 0.5 * spring.stiffness * (displacement - rest) ** 2


def _cubic_spring_energy(
    spring: CubicTorsionSpring, mechanism: Mechanism, values: Values
) -> FloatArray:
    displacement = values(("spring", spring.name, "Displacement"))[:, 0]
    quartic = 0.25 * (displacement - rest_displacement(spring, mechanism)) ** 4
    linear = _rotational_spring_energy(spring, mechanism, values)
    return linear + spring.cubic_stiffness * quartic


def _no_energy(*_: object) -> FloatArray:
    return np.zeros(1)


ENERGIES: ElementTable[Callable[[Any, Mechanism, Values], FloatArray]] = ElementTable(
    "exudyn's reader",
    FORCE_ELEMENTS,
    {
        SpringDamper: _point_spring_energy,
        RotationalSpringDamper: _rotational_spring_energy,
        CubicTorsionSpring: _cubic_spring_energy,
        ConstantForce: _no_energy,
        ConstantTorque: _no_energy,
    },
)
"""Potential energy of a force element by its connector's own distance or displacement [J], (n,)."""


def rest_displacement(
    spring: RotationalSpringDamper | CubicTorsionSpring, mechanism: Mechanism
) -> float:
    """Displacement at the rest angle [rad]: anticlockwise as Exudyn's rotations, from the start."""
    angle = Kinematics(mechanism).angle(spring.body, spring.relative_to)
    return float(angle.value(np.array(mechanism.start))) - spring.rest_angle


class BodyCoordinates:
    """Exudyn's coordinates z(q) of the bodies (x, y, rotation by body) and their Jacobian."""

    def __init__(self, kinematics: Kinematics) -> None:
        bodies = kinematics.mechanism.bodies
        self.kinematics = kinematics
        self.rows = [kinematics.point(body.name, body.centre) for body in bodies]
        self.angles = [kinematics.angle(body.name) for body in bodies]

    def placed(self, q: FloatArray) -> FloatArray:
        """z(q), shape (3 n_bodies,)."""
        centres = [self.kinematics.position(row, q) for row in self.rows]
        return np.concatenate(
            [[*at, -angle.value(q)] for at, angle in zip(centres, self.angles, strict=True)]
        )

    def jacobian(self, q: FloatArray) -> FloatArray:
        """J = dz/dq, shape (3 n_bodies, n_q)."""
        rates = self.kinematics.rates(q)
        moved = [self.kinematics.gradient(row.coefficients, q, rates) for row in self.rows]
        turns = [-angle.coefficients for angle in self.angles]
        return np.concatenate(
            [[point.real, point.imag, turn] for point, turn in zip(moved, turns, strict=True)]
        )


def recording(
    reader: Reader, torques: Mapping[str, FloatArray], events: ContactEvents, steps: int
) -> Recording:
    """Read a run out.

    Args:
        reader: of all sensors at all times.
        torques: of all stops [N m, N], each of shape (n,).
        events: of the run.
        steps: how many steps the solver took.
    """
    mechanism = reader.system.mechanism
    holding = [joint for joint in mechanism.joints if joint.held_directions]
    return Recording(
        t=reader.table[:, 0],
        q=reader.coordinates(),
        u=reader.speeds(),
        markers={marker.name: reader.point("marker", marker.name) for marker in mechanism.markers},
        kinetic_energy=np.sum(
            [reader.scalar("body", body.name, "KineticEnergy") for body in mechanism.bodies], axis=0
        ),
        potential_energy=reader.potential_energy(),
        stop_torques=torques,
        release_times=events.releases,
        joint_reactions={joint.name: reader.reaction(joint) for joint in holding},
        joint_gaps={joint.name: reader.gap(joint) for joint in holding},
        impacts=tuple(events.impacts),
        steps=steps,
    )


@dataclass(frozen=True)
class Reader:
    """Quantities of a run (or of one state) from its table."""

    system: System
    columns: Mapping[SensorKey, slice]
    table: FloatArray

    def values(self, sensor: SensorKey) -> FloatArray:
        """All components of a sensor, shape (n, components)."""
        return self.table[:, self.columns[sensor]]

    def plane(self, kind: str, name: str, quantity: str) -> FloatArray:
        """The x and y of a sensor, shape (n, 2)."""
        return self.values((kind, name, quantity))[:, :2]

    def scalar(self, kind: str, name: str, quantity: str, component: int = 0) -> FloatArray:
        """One component of a sensor, shape (n,)."""
        return self.values((kind, name, quantity))[:, component]

    def point(self, kind: str, name: str) -> PointMotion:
        """Motion of a point of a body."""
        return PointMotion(self.plane(kind, name, "Position"), self.plane(kind, name, "Velocity"))

    def coordinates(self) -> FloatArray:
        """q, shape (n, n_q)."""
        return coordinates(self.system.mechanism, self.values)

    def speeds(self) -> FloatArray:
        """u, shape (n, n_q)."""
        columns = _angles(self.system.mechanism, self.values, "Coordinates_t")
        for slide in self.system.mechanism.slides:
            speed = on_joint(slide.joint).speed(self.values)
            columns.append((speed * slide.direction.conjugate()).real)
        return np.stack(columns, axis=-1)

    def potential_energy(self) -> FloatArray:
        """Energy of weight and springs [J], shape (n,), which no sensor of Exudyn's gives."""
        mechanism, bodies = self.system.mechanism, self.system.mechanism.bodies
        places = np.array([self.plane("body", body.name, "CoordinatesTotal") for body in bodies])
        heights = places @ -np.array(mechanism.gravity_direction)
        weight = mechanism.gravity * np.array([body.mass for body in bodies]) @ heights
        energies = (ENERGIES[e](e, mechanism, self.values) for e in mechanism.force_elements)
        return weight + sum(energies)

    def torque(self, stop: str, release: float | None) -> FloatArray:
        """Torque (or force) of a stop [N m, N], shape (n,); from its release on, 0."""
        if stop not in self.system.stops:
            return np.zeros(len(self.table))
        torque = self.system.constraints[stop].torque(self.values)
        return torque if release is None else np.where(self.table[:, 0] < release, torque, 0.0)

    def reaction(self, joint: AnyJoint) -> FloatArray:
        """Force of a joint on its child, world frame [N], shape (n, 2)."""
        if not joint.free_directions:
            return self.plane("joint", joint.name, "Force")
        local = self.plane("joint", joint.name, "ForceLocal")
        return turned(local, rotation(joint.child, self.values))

    def gap(self, joint: AnyJoint) -> FloatArray:
        """Constraint drift: distance of a joint's points, or of point and line [m], shape (n,)."""
        if not joint.free_directions:
            return np.linalg.norm(self.plane("joint", joint.name, "Displacement"), axis=1)
        (across,) = joint.held_directions
        return np.abs((on_joint(joint).place(self.values) * complex(across).conjugate()).real)


def coordinates(mechanism: Mechanism, values: Values) -> FloatArray:
    """The coordinates q by sensors, shape (n, n_q); Exudyn's rotations are anticlockwise."""
    columns = _angles(mechanism, values, "CoordinatesTotal")
    for slide in mechanism.slides:
        columns.append((on_joint(slide.joint).place(values) * slide.direction.conjugate()).real)
    return np.stack(columns, axis=-1)


def _angles(mechanism: Mechanism, values: Values, quantity: str) -> list[FloatArray]:
    names = [body.name for body in mechanism.bodies if body.angle is not None]
    return [-rotation(name, values, quantity) for name in names]
