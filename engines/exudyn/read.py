"""A built Exudyn system and what its sensors say, in the mechanism's coordinates, names and signs.

Exudyn's rotations are positive anticlockwise, the mechanism's angles clockwise. Points that lie in
frames of other bodies (slides along lines, distances from walls) are :class:`RelativePoint`; gaps
and forces of stops follow from their connectors (:class:`AngleLimit`, :class:`LineContact`).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol, TypeVar

import exudyn
import numpy as np

from ...models import elements
from ...models.arrays import ComplexArray, FloatArray
from ...models.elements import FORCE_ELEMENTS, GROUND, AnyJoint, ElementTable
from ...models.kinematics import Kinematics
from ...models.mechanism import Marker, Mechanism, Slide
from ...models.spec import Vector
from ...models.trajectory import PointMotion
from ..events import ContactEvents, Contacts
from ..protocol import Recording
from ..reading import timed_reading

exu: Any = exudyn  # it has no types

_V = TypeVar("_V", float, FloatArray)
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
    def ends(self) -> tuple[tuple[str, Marker], ...]:
        """Kind of the sensors and place of the point, then of the frame's anchor."""
        anchor = Marker(name=self.point.name, body=self.frame, point=self.origin)
        return (self.kind, self.point), (f"{self.kind} anchor", anchor)

    def place(self, values: Values) -> ComplexArray:
        """Place from the anchor, in the frame [m], shape (n,)."""
        return self._in_frame(self._difference(values, "Position"), values)

    def speed(self, values: Values) -> ComplexArray:
        """Derivative of the place [m/s], shape (n,)."""
        spin = rotation(self.frame, values, "Coordinates_t")
        turning = 1j * spin * self._difference(values, "Position")
        return self._in_frame(self._difference(values, "Velocity") - turning, values)

    def acceleration(self, values: Values, rotational: float) -> ComplexArray:
        """Its second derivative [m/s^2], shape (n,); `rotational` is the frame's [rad/s^2]."""
        spin = rotation(self.frame, values, "Coordinates_t")
        turning = 2j * spin * self._difference(values, "Velocity")
        turning = turning + (1j * rotational + spin**2) * self._difference(values, "Position")
        return self._in_frame(self._difference(values, "Acceleration") - turning, values)

    def _difference(self, values: Values, quantity: str) -> ComplexArray:
        """Motion of the point less that of the anchor, in the world frame."""
        motions: list[ComplexArray] = []
        for kind, marker in self.ends:
            if marker.body == GROUND:  # it needs no sensor
                at_rest = complex(*marker.point) if quantity == "Position" else 0.0
                motions.append(np.full(1, at_rest))
            else:
                vectors = values((kind, marker.name, quantity))
                motions.append(vectors[:, 0] + 1j * vectors[:, 1])
        return motions[0] - motions[1]

    def _in_frame(self, vectors: ComplexArray, values: Values) -> ComplexArray:
        return vectors * np.exp(-1j * rotation(self.frame, values))


def on_joint(joint: AnyJoint) -> RelativePoint:
    """The child's point of a joint from the parent's, in the parent's frame."""
    child = Marker(name=joint.name, body=joint.child, point=joint.child_point)
    return RelativePoint(child, "joint", joint.parent, joint.parent_point)


def on_wall(stop: elements.PointStop) -> RelativePoint:
    """The point of a stop from the origin of the wall's frame, in that."""
    point = Marker(name=stop.name, body=stop.body, point=stop.point)
    return RelativePoint(point, "stop", stop.relative_to, (0.0, 0.0))


_ROUNDING = 1e-15  # [rad] of the difference of some radians; [m per m] of a point's position


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


# Both kinds of stops have the same methods. Gaps and their derivatives are those by the bodies'
# sensors in one row, in the units of the gap [rad, m]; a connector's gap is its own measure.


@dataclass(frozen=True)
class AngleLimit:
    """A stop on a relative angle: a connector of two rotations."""

    force_sensor: ClassVar[str] = "Force"
    """Exudyn's name of the connector's force."""

    stop: elements.Stop
    spring: Spring | None

    @property
    def sense(self) -> int:
        """Sign of the connector's displacement that closes the gap: 1 or -1."""
        return self.stop.sense

    def torque(self, values: Values) -> FloatArray:
        """Torque while it is active [N m], shape (n,)."""
        return self.stop.sense * values(("stop", self.stop.name, self.force_sensor))[:, 0]

    def connector_gap(self, system: System) -> float:
        """Gap by the connector at the current state."""
        # A constraint's equation includes its offset; that of a spring is its preload, and no gap.
        variable = "Displacement" if self.spring else "ConstraintEquation"
        return -self.sense * float(system.output(system.stops[self.stop.name], variable))

    def gap(self, values: Values) -> float:
        """Gap."""
        return self._closing(lambda body: float(rotation(body, values)[0])) - self.stop.limit

    def gap_speed(self, values: Values) -> float:
        """Speed of the gap."""
        return float(self.gap_speeds(values)[0])

    def gap_speeds(self, values: Values) -> FloatArray:
        """Speed of the gap in all rows, shape (n,)."""
        return self._closing(lambda body: rotation(body, values, "Coordinates_t"))

    def gap_acceleration(self, values: Values, rotations: Mapping[str, float]) -> float:
        """Acceleration of the gap, by the bodies' rotational accelerations [rad/s^2]."""
        return self._closing(lambda body: rotations.get(body, 0.0))

    def _closing(self, rotation_of: Callable[[str], _V]) -> _V:
        """Relative angle, clockwise and in the stop's sense, or a derivative of it."""
        stop = self.stop
        return -stop.sense * (rotation_of(stop.body) - rotation_of(stop.relative_to))

    def rounding(self, values: Values) -> float:
        """Rounding error of the gap."""
        return _ROUNDING


@dataclass(frozen=True)
class LineContact:
    """A stop on a point: a line of the ground or of another body, without friction."""

    force_sensor: ClassVar[str] = "ForceLocal"
    sense: ClassVar[int] = 1

    stop: elements.PointStop
    spring: Spring | None

    def torque(self, values: Values) -> FloatArray:
        """Force along the normal while it is active [N], shape (n,)."""
        force = values(("stop", self.stop.name, self.force_sensor))
        return force[:, 0] if self.spring else self._from_body(force, values)

    def connector_gap(self, system: System) -> float:
        """Gap by the connector at the current state."""
        displacement = system.output(system.stops[self.stop.name], "DisplacementLocal")
        if self.spring:
            return -float(displacement)
        return -float(self._from_body(np.atleast_2d(displacement), system.now)[0])

    def _from_body(self, local: FloatArray, values: Values) -> FloatArray:
        """Component along the normal of a constraint's vectors, which come in the body's frame."""
        angle = rotation(self.stop.body, values) - rotation(self.stop.relative_to, values)
        return turned(local, angle) @ np.array(self.stop.normal)

    def gap(self, values: Values) -> float:
        """Gap."""
        return self._along_normal(on_wall(self.stop).place(values)) - self.stop.offset

    def gap_speed(self, values: Values) -> float:
        """Speed of the gap."""
        return self._along_normal(on_wall(self.stop).speed(values))

    def gap_acceleration(self, values: Values, rotations: Mapping[str, float]) -> float:
        """Acceleration of the gap, by the bodies' rotational accelerations [rad/s^2]."""
        turning = rotations.get(self.stop.relative_to, 0.0)
        return self._along_normal(on_wall(self.stop).acceleration(values, turning))

    def _along_normal(self, vector: ComplexArray) -> float:
        x, y = self.stop.normal
        return x * float(vector[0].real) + y * float(vector[0].imag)

    def rounding(self, values: Values) -> float:
        """Rounding error of the gap."""
        position = values(("stop", self.stop.name, "Position"))
        return _ROUNDING * max(1.0, float(np.abs(position).max()))


UnilateralConstraint = AngleLimit | LineContact


class OwnLimit(Protocol):
    """A stop that is an element of Exudyn's in which it holds itself."""

    def torque(self, values: Values) -> FloatArray:
        """Torque or force [N m, N], shape (n,)."""
        ...

    def connector_gap(self, system: System) -> float:
        """Gap by the connector at the current state [rad, m]."""
        ...


@dataclass(frozen=True)
class System:
    """An assembled Exudyn system and the numbers of its items."""

    mechanism: Mechanism
    container: Any
    """Owns the system: it must live as long."""
    main: Any
    items: list[Any] = field(default_factory=list[Any])
    """All items of Exudyn's interface, in the order in which they were added."""
    nodes: dict[str, int] = field(default_factory=dict[str, int])
    bodies: dict[str, int] = field(default_factory=dict[str, int])
    stops: dict[str, int] = field(default_factory=dict[str, int])
    """Items of the stops: all under the unilateral law, else those that touch at the start."""
    constraints: dict[str, UnilateralConstraint] = field(default_factory=dict[str, Any])
    """Connectors and sensors of the same stops."""
    limits: dict[str, OwnLimit] = field(default_factory=dict[str, Any])
    """Stops that are Exudyn's own unilateral elements; they are in none of the mappings above."""
    springs: Mapping[str, Spring] = field(default_factory=dict[str, Spring])
    """Stops that are springs; empty where they are constraints."""
    stretches: dict[str, Callable[[Values], FloatArray]] = field(
        default_factory=dict[str, "Callable[[Values], FloatArray]"]
    )
    """Stretch of each spring of the mechanism by the sensors [m, rad], shape (n,)."""
    records: list[tuple[elements.RecordedEffort, tuple[Any, ...], Callable[[Any], None]]] = field(
        default_factory=list[Any]
    )
    """Records of efforts, each effort as Exudyn has it, and what gives it to the system."""
    sensors: dict[SensorKey, int] = field(default_factory=dict[SensorKey, int])
    left_out: frozenset[str] = frozenset()
    """Loop joints whose held angle is not built, because it follows from the other conditions."""
    redundant: bool = False
    """Whether conditions of the loops, as they are built, follow from others at the start."""

    def stretch(self, element: str, values: Values) -> FloatArray:
        """Stretch of a spring by the sensors [m, rad], shape (n,); zero if it is no spring."""
        stretch = self.stretches.get(element)
        return np.zeros(1) if stretch is None else stretch(values)

    def torque(self, stop: str) -> float:
        """Torque (or force) of a stop at the current state [N m, N]."""
        return float(self.constraints[stop].torque(self.now)[0])

    def now(self, sensor: SensorKey) -> FloatArray:
        """Values of a sensor at the current state, shape (1, components)."""
        values = self.main.GetSensorValues(self.sensors[sensor])
        return np.array(values, dtype=np.float64, ndmin=2)

    def columns(self) -> dict[SensorKey, slice]:
        """Columns of each sensor in a table; column 0 is the time [s]."""
        ends = np.cumsum([1, *(self.now(sensor).shape[1] for sensor in self.sensors)]).tolist()
        return {
            key: slice(a, b) for key, a, b in zip(self.sensors, ends[:-1], ends[1:], strict=True)
        }

    @timed_reading()
    def stored(self) -> FloatArray:
        """Table of what all sensors stored in the last run, shape (n, columns)."""
        data = [np.asarray(self.main.GetSensorStoredData(n)) for n in self.sensors.values()]
        return np.hstack([data[0][:, :1], *(values[:, 1:] for values in data)])

    @property
    def active(self) -> Contacts:
        """The stops that act."""
        parameter, stops = self.main.GetObjectParameter, self.stops.items()
        return tuple(name for name, item in stops if parameter(item, "activeConnector"))

    def set_active(self, active: Contacts) -> None:
        """Make exactly these stops act."""
        for name, number in self.stops.items():
            self.main.SetObjectParameter(number, "activeConnector", name in active)

    def set_efforts(self, time: float) -> None:
        """Give the system the efforts that act from a time [s]."""
        for record, efforts, give in self.records:
            give(efforts[bisect_right(record.instants, time)])

    def output(self, connector: int, variable: str) -> FloatArray:
        """An output variable of a connector at the current state."""
        kind = getattr(exu.OutputVariableType, variable)
        return np.asarray(self.main.GetObjectOutput(connector, kind))

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


def _quadratic_energy(spring: Any, stretch: FloatArray) -> FloatArray:
    return 0.5 * spring.stiffness * stretch**2


def _cubic_spring_energy(spring: elements.CubicTorsionSpring, stretch: FloatArray) -> FloatArray:
    return _quadratic_energy(spring, stretch) + spring.cubic_stiffness * (0.25 * stretch**4)


def _no_energy(_: Any, stretch: FloatArray) -> FloatArray:
    return np.zeros_like(stretch)


ENERGIES: ElementTable[Callable[[Any, FloatArray], FloatArray]] = ElementTable(
    "exudyn's reader",
    FORCE_ELEMENTS,
    {
        elements.SpringDamper: _quadratic_energy,
        elements.RotationalSpringDamper: _quadratic_energy,
        elements.CubicTorsionSpring: _cubic_spring_energy,
        elements.ConstantForce: _no_energy,
        elements.ConstantTorque: _no_energy,
        elements.RotorInertia: _no_energy,
        elements.SlideInertia: _no_energy,
        elements.SlideSpringDamper: _quadratic_energy,
        elements.RecordedForce: _no_energy,
        elements.RecordedTorque: _no_energy,
    },
)
"""Potential energy of a force element [J] by the stretch of its connector [m, rad], shape (n,)."""


def coordinates(mechanism: Mechanism, values: Values, *, speeds: bool = False) -> FloatArray:
    """Coordinates q, or speeds u, by sensors, shape (n, n_q)."""
    quantity = "Coordinates_t" if speeds else "CoordinatesTotal"
    turning = [body.name for body in mechanism.bodies if body.angle is not None]
    columns = [-rotation(name, values, quantity) for name in turning]
    columns += [sliding(slide, values, speeds=speeds) for slide in mechanism.slides]
    return np.stack(columns, axis=-1)


def sliding(slide: Slide, values: Values, *, speeds: bool = False) -> FloatArray:
    """Slide coordinate [m], or its speed [m/s], by sensors, shape (n,)."""
    point = on_joint(slide.joint)
    motion = point.speed(values) if speeds else point.place(values)
    return np.asarray((motion * slide.direction.conjugate()).real)


class BodyCoordinates:
    """Exudyn's coordinates z(q) of the bodies (x, y, rotation by body) and their Jacobian."""

    def __init__(self, kinematics: Kinematics) -> None:
        bodies = kinematics.mechanism.bodies
        self.kinematics = kinematics
        self.rows = [kinematics.point(body.name, body.centre) for body in bodies]
        self.angles = [kinematics.angle(body.name) for body in bodies]

    def placed(self, q: FloatArray) -> FloatArray:
        """z(q), shape (3 n_bodies,)."""
        placed: list[FloatArray] = []
        for row, angle in zip(self.rows, self.angles, strict=True):
            placed.append(np.array([*self.kinematics.position(row, q), -angle.value(q)]))
        return np.concatenate(placed)

    def jacobian(self, q: FloatArray) -> FloatArray:
        """J = dz/dq, shape (3 n_bodies, n_q)."""
        rates, rows = self.kinematics.rates(q), list[FloatArray]()
        for row, angle in zip(self.rows, self.angles, strict=True):
            gradient = self.kinematics.gradient(row.coefficients, q, rates)
            rows += [gradient.real, gradient.imag, -angle.coefficients]
        return np.stack(rows)


@timed_reading()
def recording(
    system: System,
    columns: Mapping[SensorKey, slice],
    table: FloatArray,
    events: ContactEvents,
    steps: int,
    *,
    reopens: bool,
) -> Recording:
    """The run in the mechanism's terms.

    Args:
        system: as built.
        columns: of each sensor in the table.
        table: all sensors at all times.
        events: of the run.
        steps: how many the solver took.
        reopens: whether stops may act again after their first release; Exudyn's multiplier of an
            open one is then zero.
    """
    mechanism, times = system.mechanism, table[:, 0]

    def values(sensor: SensorKey) -> FloatArray:
        return table[:, columns[sensor]]

    def plane(kind: str, name: str, quantity: str) -> FloatArray:
        return values((kind, name, quantity))[:, :2]

    markers = dict[str, PointMotion]()
    for marker in mechanism.markers:
        position = plane("marker", marker.name, "Position")
        markers[marker.name] = PointMotion(position, plane("marker", marker.name, "Velocity"))

    kinetic = [values(("body", body.name, "KineticEnergy"))[:, 0] for body in mechanism.bodies]
    u = coordinates(mechanism, values, speeds=True)
    kinetic.append(Kinematics(mechanism).rotor_energy(u))
    # Exudyn has no sensor of the potential energy.
    places = [plane("body", body.name, "CoordinatesTotal") for body in mechanism.bodies]
    heights = np.array(places) @ -np.array(mechanism.gravity_direction)
    weight = mechanism.gravity * np.array([body.mass for body in mechanism.bodies]) @ heights
    energies = (ENERGIES[e](e, system.stretch(e.name, values)) for e in mechanism.force_elements)

    torques = dict[str, FloatArray]()
    for name, release in events.releases.items():
        torques[name] = np.zeros(len(table))
        stop = system.limits.get(name) or system.constraints.get(name)
        if stop is not None:
            torques[name] = stop.torque(values)
            if release is not None and not reopens:
                torques[name] = np.where(times < release, torques[name], 0.0)

    reactions, drift = dict[str, FloatArray](), dict[str, FloatArray]()
    for joint in mechanism.joints:
        if not joint.held_directions:
            continue
        if joint.free_directions:  # a point on a line, whose force comes in the child's frame
            local = plane("joint", joint.name, "ForceLocal")
            reactions[joint.name] = turned(local, rotation(joint.child, values))
            (across,) = joint.held_directions
            place = on_joint(joint).place(values)
            drift[joint.name] = np.abs((place * complex(across).conjugate()).real)
        else:
            reactions[joint.name] = plane("joint", joint.name, "Force")
            apart = plane("joint", joint.name, "Displacement")
            drift[joint.name] = np.linalg.norm(apart, axis=1)

    return Recording(
        t=times,
        q=coordinates(mechanism, values),
        u=u,
        markers=markers,
        kinetic_energy=np.sum(kinetic, axis=0),
        potential_energy=weight + sum(energies),
        stop_torques=torques,
        release_times=events.releases,
        joint_reactions=reactions,
        joint_gaps=drift,
        impacts=tuple(events.impacts),
        steps=steps,
    )
