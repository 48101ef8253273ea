"""Exudyn's system of a mechanism: redundant coordinates, joints and stops as algebraic constraints.

Items: a pin is a revolute joint; a slot is a prismatic joint that leaves the rotation free, which a
prismatic joint holds; a weld is a revolute joint and a constraint of two rotations; a free joint is
nothing. Angles that follow from other conditions are left out (:func:`implied_angles`). Stops are
described in :mod:`.read`; springs and dampers are connectors, constant forces and torques loads.

Every body is a 2D node at its centre of mass, with a rotation that is positive *anticlockwise*: the
mechanism's angles have the opposite sign. Recorded quantities are the outputs of Exudyn's sensors.
"""

from __future__ import annotations

import cmath
from bisect import bisect_left
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from exudyn import itemInterface

from ...models import elements
from ...models.arrays import FloatArray
from ...models.elements import ELEMENTS, GROUND, AnyJoint, ElementTable
from ...models.errors import UnsupportedProblemError
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Marker, Mechanism
from ...models.problem import StopLaw
from ...models.spec import Vector
from ..events import refuse_moving_gaps
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
    sliding,
)
from .solver import DEPENDENT, LoopConstraints

items: Any = itemInterface  # it has no types

_SUMMED = 1e-9  # [s] Exudyn's times are sums of steps: more than their rounding, less than a step
_AWAY = 0.1  # [rad, m] of positions beside the start, which may itself be singular
_WELL_HELD = 1e-3  # of the largest singular value: the least one of the conditions that are left
_FOLLOWS = 1e-9  # of a row: what others leave of it


def kind_of(item: Any) -> str:
    """The kind of an item, with which its class' name begins; a system has `Add` + kind for it."""
    kinds = ("Node", "Object", "Marker", "Load", "Sensor")
    return next(kind for kind in kinds if type(item).__name__.startswith(kind))


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
    # Index 2 would hold the gap's speed at zero from the first step: an impact.
    refuse_moving_gaps(mechanism, "exudyn")
    springs = springs or {}
    for stop in mechanism.point_stops:
        refuse_own_wall(stop)
        if stop.name in springs and stop.relative_to != GROUND:
            # Exudyn's linear spring pushes its first marker, not the point of contact: the torque
            # would be wrong.
            raise UnsupportedProblemError(
                f"exudyn cannot build {stop.name!r} as a spring: its springs along a line are "
                f"right for walls of the ground only, and this wall stands on "
                f"{stop.relative_to!r}; leave stop_stiffness out."
            )

    builder = Builder(mechanism, springs)
    for stop in mechanism.stops:
        add_stop = BUILDERS[stop]
        acts = stop.name in springs if springs else stop.closed or law is StopLaw.UNILATERAL
        if acts:
            add_stop(builder, stop)
    return builder.finished()


def refuse_own_wall(stop: elements.PointStop) -> None:
    """Raise UnsupportedProblemError for a stop on a point of the body that its wall stands on."""
    if stop.body == stop.relative_to:
        wall = f"{stop.body!r}, on which its wall stands as well"
        body = "the ground" if stop.body == GROUND else wall
        raise UnsupportedProblemError(
            f"exudyn cannot build {stop.name!r}: a stop on a point of {body}."
        )


def implied_angles(mechanism: Mechanism) -> frozenset[str]:
    """Loop joints whose held angle follows from the other conditions in every position.

    Built, they would contradict the others by the drift of the positions, and Newton's iteration
    does not get below that. The bodies of such a joint do not move relative to each other. The
    forces of the joints between them, which are not unique, are those without the torque of that
    joint. None is left out where the loops hold the gap of a closed stop: which of all these is
    redundant is then decided by the forces.
    """
    kinematics, (q, u) = Kinematics(mechanism), initial_state(mechanism)
    if not any(joint.turned_by is not None for joint in mechanism.loop_joints):
        return frozenset()
    # The start, and positions to both sides of it in which the loops are closed.
    rows = kinematics.loop_jacobian(q)
    away = np.cos(np.arange(len(q)))
    away -= np.linalg.pinv(rows, rcond=DEPENDENT) @ (rows @ away)
    loops = LoopConstraints(kinematics, ())
    positions = [q, *(loops.projected(q + side * away, u)[0] for side in (_AWAY, -_AWAY))]
    for position in positions:
        rows = kinematics.loop_jacobian(position)
        for stop in mechanism.stops:
            gap = kinematics.gap_jacobian(stop.name, position)[None]
            if stop.closed and _holds(rows, gap):
                return frozenset()
    left_out = frozenset[str]()
    for joint in reversed(mechanism.loop_joints):
        candidates = left_out | {joint.name}
        if joint.turned_by is not None and all(
            _holds_without(kinematics, position, joint, candidates) for position in positions
        ):
            left_out = candidates
    return left_out


def _loop_rows(kinematics: Kinematics, q: FloatArray, left_out: frozenset[str]) -> FloatArray:
    """Jacobian of the loops' conditions but for the angles of some joints, shape (n, n_q)."""
    keep: list[bool] = []
    for joint in kinematics.mechanism.loop_joints:
        keep += [True] * len(joint.held_directions)
        keep += [joint.name not in left_out] * (joint.turned_by is not None)
    keep += [True] * len(kinematics.mechanism.couplers)
    return kinematics.loop_jacobian(q)[np.array(keep, dtype=bool)]


def _holds(rows: FloatArray, moved: FloatArray) -> bool:
    """Tell whether conditions of Jacobian `rows` hold quantities of Jacobian `moved` constant."""
    rest = moved - moved @ np.linalg.pinv(rows, rcond=DEPENDENT) @ rows
    return bool(np.abs(rest).max() <= _FOLLOWS * np.abs(moved).max())


def _holds_without(
    kinematics: Kinematics, q: FloatArray, joint: AnyJoint, left_out: frozenset[str]
) -> bool:
    """Tell whether the child is at rest relative to the parent without its angle being held."""
    rows, rates = _loop_rows(kinematics, q, left_out), kinematics.rates(q)
    values = np.linalg.svd(rows, compute_uv=False)
    held = values[values > DEPENDENT * values[0]]
    point = kinematics.between(joint.child, joint.child_point, joint.parent, joint.parent_point)
    along = [
        kinematics.component(axis, joint.parent, point).jacobian(q, rates)
        for axis in (1.0 + 0.0j, 1.0j)
    ]
    motion = np.stack([kinematics.angle(joint.child, joint.parent).coefficients, *along])
    return bool(held.min(initial=np.inf) > _WELL_HELD * values[0]) and _holds(rows, motion)


@dataclass(frozen=True)
class _CubicTorque:
    """Torque of a cubic spring as a user function, which its repr is the Python text of."""

    cubic_stiffness: float

    def __call__(self, *state: Any) -> float:
        # An odd function: of anticlockwise angles as of clockwise ones.
        _main, _time, _item, displacement, _velocity, stiffness, _damping, offset = state
        stretch = displacement - offset
        return stretch * (stiffness + self.cubic_stiffness * stretch * stretch)

    def __repr__(self) -> str:
        return (
            "lambda mbs, t, item, q, v, k, d, rest: "
            f"(q - rest) * (k + {self.cubic_stiffness!r} * (q - rest) * (q - rest))"
        )


@dataclass(frozen=True)
class _Held:
    """Effort of a record in the step that ends at a time, as a user function.

    Its repr is the Python text of it.
    """

    times: tuple[float, ...]
    """Ends of steps after which the next effort acts [s]."""
    efforts: tuple[Any, ...]
    """Forces [N], or vectors of torques [N m]."""

    def __call__(self, _main: Any, time: float, *_state: Any) -> Any:
        return self.efforts[bisect_left(self.times, time)]

    def __repr__(self) -> str:
        return f"lambda mbs, t, *_: {self.efforts!r}[np.searchsorted({self.times!r}, t)]"


class Builder:
    """Builds a system: bodies, joints and force elements at once, then stops and sensors.

    Args:
        mechanism: what to build.
        springs: of the stops that act, if they are springs.
        alone: whether Exudyn follows records of efforts by itself; otherwise it has their values at
            the start until :meth:`.read.System.set_efforts` gives it others.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        springs: Mapping[str, Spring] | None = None,
        *,
        alone: bool = False,
    ) -> None:
        container, left_out = exu.SystemContainer(), implied_angles(mechanism)
        start, _ = initial_state(mechanism)
        rows = _loop_rows(Kinematics(mechanism), start, left_out)
        redundant = len(rows) > 0 and int(np.linalg.matrix_rank(rows, rtol=DEPENDENT)) < len(rows)
        self.mechanism, self.main, self.alone = mechanism, container.AddSystem(), alone
        self.system = System(
            mechanism,
            container,
            self.main,
            springs=springs or {},
            left_out=left_out,
            redundant=redundant,
        )
        self._add_bodies()
        for element in (*mechanism.joints, *mechanism.force_elements, *mechanism.couplers):
            BUILDERS[element](self, element)

    def add(self, item: Any) -> int:
        """Add an item of any kind; its number among those of its kind."""
        self.system.items.append(item)
        return int(getattr(self.main, f"Add{kind_of(item)}")(item))

    def finished(self) -> System:
        """Observe the markers, and assemble the system at its start."""
        for marker in self.mechanism.markers:
            self.observe_point("marker", marker)
        self.main.Assemble()
        return self.system

    def _add_bodies(self) -> None:
        """Add the bodies with their weight, and the ground."""
        kinematics, (q, u) = Kinematics(self.mechanism), initial_state(self.mechanism)
        weight = [*self.mechanism.gravity_vector, 0.0]
        for body in self.mechanism.bodies:
            row, angle = kinematics.point(body.name, body.centre), kinematics.angle(body.name)
            position, velocity = kinematics.position(row, q), kinematics.velocity(row, q, u)
            node = self.add(
                items.NodeRigidBody2D(
                    name=body.name,
                    referenceCoordinates=[*position.tolist(), -float(angle.value(q))],
                    initialVelocities=[*velocity.tolist(), -float(angle.coefficients @ u)],
                )
            )
            item = items.ObjectRigidBody2D(mass=body.mass, inertia=body.inertia, nodeNumber=node)
            number = self.add(item)
            on = self.add(items.MarkerBodyMass(bodyNumber=number))
            self.add(items.LoadMassProportional(markerNumber=on, loadVector=weight))
            self.system.nodes[body.name], self.system.bodies[body.name] = node, number
            for quantity in ("CoordinatesTotal", "Coordinates", "Coordinates_t"):
                self.observe(items.SensorNode, ("body", body.name, quantity), nodeNumber=node)
            key = ("body", body.name, "KineticEnergy")
            self.observe(items.SensorBody, key, bodyNumber=number)
        self.system.bodies[GROUND] = self.add(items.ObjectGround())
        self.system.nodes[GROUND] = self.add(items.NodePointGround())

    # Sensors.

    def observe(self, sensor: Any, key: SensorKey, **where: Any) -> None:
        """Add a sensor of the quantity that is the key's third part."""
        variable = getattr(exu.OutputVariableType, key[2])
        stored = sensor(outputVariableType=variable, storeInternal=True, writeToFile=False, **where)
        self.system.sensors[key] = self.add(stored)

    def observe_point(self, kind: str, marker: Marker, *more: str) -> None:
        """Add sensors of a body's point: position, velocity, and more quantities."""
        number = self.system.bodies[marker.body]
        local = self.system.local(marker.body, marker.point)
        for quantity in ("Position", "Velocity", *more):
            key = (kind, marker.name, quantity)
            self.observe(items.SensorBody, key, bodyNumber=number, localPosition=local)

    def observe_relative(self, relative: RelativePoint, *more: str) -> None:
        """Add sensors of both ends of a relative point, but for those on the ground."""
        for kind, point in relative.ends:
            if point.body != GROUND:
                self.observe_point(kind, point, *more)

    def connect(self, item: Any, kind: str, name: str, *quantities: str) -> int:
        """Add a connector and sensors of it; the connector's number."""
        item.name = f"{kind} {name}"
        number = self.add(item)
        for quantity in quantities:
            self.observe(items.SensorObject, (kind, name, quantity), objectNumber=number)
        return number

    # Exudyn's markers.

    def frame(self, body: str, point: Vector) -> int:
        """Add a marker of a body's frame at a point; its number."""
        number, local = self.system.bodies[body], self.system.local(body, point)
        marker = items.MarkerBodyRigid(bodyNumber=number, localPosition=local)
        return self.add(marker)

    def _frames(self, joint: AnyJoint) -> list[int]:
        child = self.frame(joint.child, joint.child_point)
        return [child, self.frame(joint.parent, joint.parent_point)]

    def rotations(self, *bodies: str) -> list[int]:
        """Add markers of the rotations of bodies; their numbers."""
        markers: list[int] = []
        for body in bodies:
            coordinate, node = 0 if body == GROUND else 2, self.system.nodes[body]
            marker = items.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate)
            markers.append(self.add(marker))
        return markers

    # Joints.

    def add_free(self, joint: elements.FreeJoint) -> None:
        """Add the sensors of a joint that holds nothing."""
        self.observe_relative(on_joint(joint))

    def add_translation(self, joint: elements.TranslationJoint) -> None:
        """Add the sensors of a joint, and a constraint that holds the angle alone."""
        self.add_free(joint)
        rotations = self.rotations(joint.parent, joint.child)
        self.add(items.ObjectConnectorCoordinate(markerNumbers=rotations))

    def add_pin(self, joint: elements.PinJoint | elements.WeldJoint) -> None:
        """Add a revolute joint."""
        item = items.ObjectJointRevolute2D(markerNumbers=self._frames(joint))
        self.connect(item, "joint", joint.name, "Force", "Displacement")

    def add_weld(self, joint: elements.WeldJoint) -> None:
        """Add a revolute joint and a constraint that holds the angle it has at the start."""
        self.add_pin(joint)
        if joint.name not in self.system.left_out:
            rotations = self.rotations(joint.parent, joint.child)
            self.add(items.ObjectConnectorCoordinate(markerNumbers=rotations))

    def add_slot(self, joint: elements.SlotJoint | elements.PrismaticJoint) -> None:
        """Add a prismatic joint, which leaves the rotation free unless the joint holds it."""
        self.observe_relative(on_joint(joint))
        (normal,) = map(complex, joint.held_directions)
        angle = None if joint.name in self.system.left_out else joint.turned_by
        item = self._line(self._frames(joint), (normal.real, normal.imag), angle)
        self.connect(item, "joint", joint.name, "ForceLocal")

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

    def add_force(self, element: elements.ConstantForce) -> None:
        """Add the load of a constant force, whose direction does not turn with the body."""
        load = items.LoadForceVector(
            markerNumber=self.frame(element.body, element.point),
            loadVector=[*element.force, 0.0],
            bodyFixed=False,
        )
        self.add(load)

    def add_torque(self, element: elements.ConstantTorque) -> None:
        """Add the loads of a constant torque on its two bodies; Exudyn's are anticlockwise."""
        for body, torque in zip(element.bodies, _couple(element.torque), strict=True):
            marker = self.frame(body, (0.0, 0.0))
            self.add(items.LoadTorqueVector(markerNumber=marker, loadVector=torque))

    def add_recorded_torque(self, record: elements.RecordedTorque) -> None:
        """Add the loads of a recorded torque on its two bodies."""
        couples = zip(*map(_couple, record.efforts), strict=True)
        for body, torques in zip(record.bodies, couples, strict=True):
            marker = self.frame(body, (0.0, 0.0))
            load = items.LoadTorqueVector(markerNumber=marker, loadVector=torques[0])
            load.loadVectorUserFunction = self._user_function(record, torques)
            setter = partial(self.main.SetLoadParameter, self.add(load), "loadVector")
            self.system.records.append((record, torques, setter))

    def add_recorded_force(self, record: elements.RecordedForce) -> None:
        """Add a recorded force along a joint's line."""
        forces = tuple(-force for force in record.efforts)
        item = self._along_slide(record.coordinate, force=forces[0])
        item.springForceUserFunction = self._user_function(record, forces)
        setter = partial(self.main.SetObjectParameter, self.add(item), "force")
        self.system.records.append((record, forces, setter))

    def _user_function(self, record: elements.RecordedEffort, efforts: tuple[Any, ...]) -> Any:
        """Efforts as a function of the time; Exudyn's 0 where there is none."""
        if not self.alone or not record.instants:
            return 0
        return _Held(tuple(instant + _SUMMED for instant in record.instants), efforts)

    def add_point_spring(self, spring: elements.SpringDamper) -> None:
        """Add a spring between points; without rest length and damping they may meet."""
        other_end = self.frame(spring.relative_to, spring.relative_point)
        markers = [other_end, self.frame(spring.body, spring.point)]
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
        self._connect_spring(item, spring.name, "Distance", spring.rest_length)

    def add_slide_spring(self, spring: elements.SlideSpringDamper) -> None:
        """Add a spring, damper and force along a joint's line, on which the child's point is."""
        item = self._along_slide(
            spring.coordinate,
            stiffness=spring.stiffness,
            damping=spring.damping,
            offset=spring.rest_position,
            force=-spring.force,
        )
        self.connect(item, "spring", spring.name)
        slide, rest = self.mechanism.slide(spring.coordinate), spring.rest_position
        self.system.stretches[spring.name] = lambda values: sliding(slide, values) - rest

    def add_rotor(self, rotor: elements.RotorInertia) -> None:
        """Add the inertia of a relative rotation to the equations of its bodies' nodes."""
        senses = dict(zip(rotor.bodies, (1.0, -1.0), strict=True))
        senses.pop(GROUND, None)
        nodes = [self.system.nodes[body] for body in senses]
        direction = np.kron(list(senses.values()), [0.0, 0.0, 1.0])
        mass = rotor.inertia * np.outer(direction, direction) + 0.0  # no zeros with a sign
        self.add(items.ObjectGenericODE2(nodeNumbers=nodes, massMatrix=mass))

    def _along_slide(self, coordinate: str, **law: float) -> Any:
        """A connector along the line of a slide coordinate."""
        slide = self.mechanism.slide(coordinate)
        joint, along = slide.joint, slide.direction
        line = self.frame(joint.parent, joint.parent_point)
        return items.ObjectConnectorLinearSpringDamper(
            markerNumbers=[line, self.frame(joint.child, joint.child_point)],
            axisMarker0=[along.real, along.imag, 0.0],
            **law,
        )

    def add_rotational_spring(self, spring: elements.RotationalSpringDamper) -> None:
        """Add a spring between two rotations: full turns count."""
        self._add_torsion(spring, damping=spring.damping)

    def add_cubic_spring(self, spring: elements.CubicTorsionSpring) -> None:
        """Add a spring between two rotations whose torque is a user function in Python."""
        self._add_torsion(spring, springForceUserFunction=_CubicTorque(spring.cubic_stiffness))

    def _add_torsion(
        self, spring: elements.RotationalSpringDamper | elements.CubicTorsionSpring, **fields: Any
    ) -> None:
        angle = Kinematics(self.mechanism).angle(spring.body, spring.relative_to)
        # Displacements count from the start, anticlockwise.
        rest = float(angle.value(np.array(self.mechanism.start))) - spring.rest_angle
        item = items.ObjectConnectorCoordinateSpringDamper(
            markerNumbers=self.rotations(spring.relative_to, spring.body),
            stiffness=spring.stiffness,
            offset=rest,
            **fields,
        )
        self._connect_spring(item, spring.name, "Displacement", rest)

    def _connect_spring(self, item: Any, name: str, output: str, rest: float) -> None:
        """Add a spring whose connector tells its length or angle [m, rad]."""
        self.connect(item, "spring", name, output)
        key = "spring", name, output
        self.system.stretches[name] = lambda values: values(key)[:, 0] - rest

    # Couplers.

    def add_coupler(self, coupler: elements.Coupler) -> None:
        """Add a constraint of the coordinates of bodies, which the start fulfils."""
        rows = dict[str, FloatArray]()
        for name, weight in coupler.weights.items():
            body, row = self._of_a_body(name, coupler)
            rows[body] = rows.get(body, 0.0) + weight * row
        nodes, row = [self.system.nodes[body] for body in rows], np.concatenate([*rows.values()])
        places = [self.main.GetNode(node)["referenceCoordinates"] for node in nodes]
        # An object without mass or stiffness stands for all coordinates of its nodes.
        body = self.add(items.ObjectGenericODE2(nodeNumbers=nodes))
        item = items.ObjectConnectorCoordinateVector(
            name=f"coupler {coupler.name}",
            markerNumbers=[
                self.add(items.MarkerNodeCoordinates(nodeNumber=self.system.nodes[GROUND])),
                self.add(items.MarkerObjectODE2Coordinates(objectNumber=body)),
            ],
            scalingMarker1=row[None],
            offset=[float(row @ np.concatenate(places))],
        )
        self.add(item)

    def _of_a_body(self, coordinate: str, coupler: elements.Coupler) -> tuple[str, FloatArray]:
        """Body whose x, y and rotation tell a coordinate, and the coordinate's derivatives by them.

        Raises:
            UnsupportedProblemError: it is a slide, and not linear in them.
        """
        for body in self.mechanism.bodies:
            if body.angle == coordinate:
                return body.name, np.array([0.0, 0.0, -1.0])
        slide = self.mechanism.slide(coordinate)
        joint, along = slide.joint, slide.direction
        at_centre = joint.child_point == self.mechanism.body(joint.child).centre
        if joint.parent != GROUND or not (at_centre or joint.turned_by is not None):
            raise UnsupportedProblemError(
                f"our adapter couples slides of the ground whose bodies do not turn, or slide by "
                f"their centres of mass; {coordinate!r} of {coupler.name!r} is none."
            )
        return joint.child, np.array([along.real, along.imag, 0.0])

    # Stops.

    def add_angle_limit(self, stop: elements.Stop) -> None:
        """Add a constraint, or a spring, between two rotations."""
        limit = AngleLimit(stop, self.system.springs.get(stop.name))
        markers = self.rotations(stop.relative_to, stop.body)
        if limit.spring:
            item = items.ObjectConnectorCoordinateSpringDamper(
                **_spring_fields(limit.spring, stop.sense, markers)
            )
        else:
            # Coordinates count from the reference, and a closed stop's gap is zero there: it needs
            # no offset.
            gap = 0.0
            if not stop.closed:
                start = np.array(self.mechanism.start)
                gap = float(Kinematics(self.mechanism).gap(stop.name, start))
            item = items.ObjectConnectorCoordinate(markerNumbers=markers, offset=stop.sense * gap)
        self._add_stop(limit, item)

    def add_point_contact(self, stop: elements.PointStop) -> None:
        """Add a point on a line, or a spring across that."""
        contact = LineContact(stop, self.system.springs.get(stop.name))
        self.observe_relative(on_wall(stop), "Acceleration")
        x, y = stop.normal
        point = self.frame(stop.body, stop.point)
        line = self.frame(stop.relative_to, (x * stop.offset, y * stop.offset))
        if contact.spring:
            fields = _spring_fields(contact.spring, 1, [line, point])
            item = items.ObjectConnectorLinearSpringDamper(axisMarker0=[-x, -y, 0.0], **fields)
        else:
            item = self._line([point, line], (x, y))
        self._add_stop(contact, item)

    def _add_stop(self, constraint: UnilateralConstraint, item: Any) -> None:
        name = constraint.stop.name
        self.system.stops[name] = self.connect(item, "stop", name, constraint.force_sensor)
        self.system.constraints[name] = constraint


def _couple(torque: float) -> tuple[list[float], list[float]]:
    """Exudyn's vectors, anticlockwise, of a clockwise torque on a body and its opposite [N m]."""
    return [0.0, 0.0, -torque], [0.0, 0.0, torque]


def _spring_fields(spring: Spring, sense: int, markers: list[int]) -> dict[str, Any]:
    """Parameters of a connector whose torque grows as the gap closes."""
    return {
        "markerNumbers": markers,
        "stiffness": spring.stiffness,
        "damping": spring.damping,
        "offset": spring.offset(sense, spring.torque),
    }


BUILDERS: ElementTable[Callable[[Builder, Any], None]] = ElementTable(
    "exudyn",
    ELEMENTS,
    {
        elements.PinJoint: Builder.add_pin,
        elements.WeldJoint: Builder.add_weld,
        elements.SlotJoint: Builder.add_slot,
        elements.PrismaticJoint: Builder.add_slot,
        elements.FreeJoint: Builder.add_free,
        elements.TranslationJoint: Builder.add_translation,
        elements.Stop: Builder.add_angle_limit,
        elements.PointStop: Builder.add_point_contact,
        elements.SpringDamper: Builder.add_point_spring,
        elements.RotationalSpringDamper: Builder.add_rotational_spring,
        elements.CubicTorsionSpring: Builder.add_cubic_spring,
        elements.ConstantForce: Builder.add_force,
        elements.ConstantTorque: Builder.add_torque,
        elements.SlideSpringDamper: Builder.add_slide_spring,
        elements.Coupler: Builder.add_coupler,
        elements.RecordedForce: Builder.add_recorded_force,
        elements.RecordedTorque: Builder.add_recorded_torque,
        elements.RotorInertia: Builder.add_rotor,
    },
    {
        elements.SlideInertia: "our adapter adds no inertia along slides",
    },
)
