"""Reading a table of Exudyn's sensors, in the mechanism's coordinates, names and signs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray
from ...models.force_elements import RotationalSpringDamper, SpringDamper
from ...models.joints import AnyJoint
from ...models.mechanism import Mechanism
from ...models.trajectory import PointMotion
from ..contact_events import ContactEvents
from ..protocol import Recording
from .build import System
from .forces import spring_energy
from .lines import on_joint
from .sensors import SensorKey, Values, rotation, turned


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
        slides = [
            (on_joint(slide.joint).speed(self.values) * slide.direction.conjugate()).real
            for slide in self.system.mechanism.slides
        ]
        return np.stack(
            [*_angles(self.system.mechanism, self.values, "Coordinates_t"), *slides], axis=-1
        )

    def potential_energy(self) -> FloatArray:
        """Energy of weight and springs [J], shape (n,); Exudyn's own sensor counts that of elastic bodies only."""
        mechanism = self.system.mechanism
        places = np.array(
            [self.plane("body", body.name, "CoordinatesTotal") for body in mechanism.bodies]
        )
        heights = places @ -np.array(mechanism.gravity_direction)
        weight = mechanism.gravity * np.array([body.mass for body in mechanism.bodies]) @ heights
        springs = (
            e
            for e in mechanism.force_elements
            if isinstance(e, SpringDamper | RotationalSpringDamper)
        )
        return weight + sum(spring_energy(spring, mechanism, self.values) for spring in springs)

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
        return turned(
            self.plane("joint", joint.name, "ForceLocal"), rotation(joint.child, self.values)
        )

    def gap(self, joint: AnyJoint) -> FloatArray:
        """Constraint drift: distance of a joint's points, or of the point from the slot's line [m], shape (n,)."""
        if not joint.free_directions:
            return np.linalg.norm(self.plane("joint", joint.name, "Displacement"), axis=1)
        (across,) = joint.held_directions
        return np.abs((on_joint(joint).place(self.values) * complex(across).conjugate()).real)


def coordinates(mechanism: Mechanism, values: Values) -> FloatArray:
    """The coordinates q by sensors, shape (n, n_q); Exudyn's rotations are anticlockwise."""
    slides = [
        (on_joint(s.joint).place(values) * s.direction.conjugate()).real for s in mechanism.slides
    ]
    return np.stack([*_angles(mechanism, values, "CoordinatesTotal"), *slides], axis=-1)


def _angles(mechanism: Mechanism, values: Values, quantity: str) -> list[FloatArray]:
    return [
        -rotation(body.name, values, quantity)
        for body in mechanism.bodies
        if body.angle is not None
    ]
