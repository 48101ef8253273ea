"""Reading a table of Exudyn's sensors, in the mechanism's coordinates, names and signs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray
from ...models.joints import AnyJoint, Joint, SlotJoint
from ...models.mechanism import Slide
from ...models.trajectory import PointMotion
from ..contact_events import ContactEvents
from ..protocol import Recording
from .build import System
from .constraints import SensorKey, turned


def recording(reader: Reader, torques: Mapping[str, FloatArray], events: ContactEvents, steps: int) -> Recording:
    """Read a run out.

    Args:
        reader: of all sensors at all times.
        torques: of all stops [N m, N], each of shape (n,).
        events: of the run.
        steps: how many steps the solver took.
    """
    mechanism = reader.system.mechanism
    return Recording(
        t=reader.table[:, 0],
        q=reader.coordinates(),
        u=reader.speeds(),
        markers={marker.name: reader.point("marker", marker.name) for marker in mechanism.markers},
        kinetic_energy=np.sum([reader.scalar("body", body.name, "KineticEnergy") for body in mechanism.bodies], axis=0),
        potential_energy=reader.potential_energy(),
        stop_torques=torques,
        release_times=events.releases,
        joint_reactions={joint.name: reader.reaction(joint) for joint in mechanism.joints},
        joint_gaps={joint.name: reader.gap(joint) for joint in mechanism.joints},
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
        """q, shape (n, n_q); Exudyn's rotations are anticlockwise."""
        angles = [-self.scalar("body", body.name, "CoordinatesTotal", 2) for body in self.system.mechanism.bodies]
        slides = [self._along(slide) for slide in self.system.mechanism.slides]
        return np.stack([*angles, *slides], axis=-1)

    def speeds(self) -> FloatArray:
        """u, shape (n, n_q)."""
        angles = [-self.scalar("body", body.name, "Coordinates_t", 2) for body in self.system.mechanism.bodies]
        slides = [
            self.plane("joint", slide.joint.name, "Velocity") @ _vector(slide.direction)
            for slide in self.system.mechanism.slides
        ]
        return np.stack([*angles, *slides], axis=-1)

    def potential_energy(self) -> FloatArray:
        """Energy of weight [J], shape (n,); Exudyn's own sensor counts elastic energy only."""
        mechanism = self.system.mechanism
        heights = [self.scalar("body", body.name, "CoordinatesTotal", 1) for body in mechanism.bodies]
        return mechanism.gravity * np.array([body.mass for body in mechanism.bodies]) @ np.array(heights)

    def torque(self, stop: str, release: float | None) -> FloatArray:
        """Torque (or force) of a stop [N m, N], shape (n,); from its release on, 0."""
        if stop not in self.system.stops:
            return np.zeros(len(self.table))
        torque = self.system.constraints[stop].torque(self.values)
        return torque if release is None else np.where(self.table[:, 0] < release, torque, 0.0)

    def reaction(self, joint: Joint) -> FloatArray:
        """Force of a joint on its child, world frame [N], shape (n, 2)."""
        if not isinstance(joint, SlotJoint):
            return self.plane("joint", joint.name, "Force")
        rotation = self.scalar("body", joint.child, "CoordinatesTotal", 2)
        return turned(self.plane("joint", joint.name, "ForceLocal"), rotation)

    def gap(self, joint: Joint) -> FloatArray:
        """Constraint drift: distance of a joint's points, or of the point from the slot's line [m], shape (n,)."""
        if isinstance(joint, SlotJoint):
            return np.abs(self._from_slot(joint) @ np.array([-joint.axis[1], joint.axis[0]]))
        return np.linalg.norm(self.plane("joint", joint.name, "Displacement"), axis=1)

    def _along(self, slide: Slide) -> FloatArray:
        return self._from_slot(slide.joint) @ _vector(slide.direction)

    def _from_slot(self, joint: AnyJoint) -> FloatArray:
        return self.plane("joint", joint.name, "Position") - np.array(joint.parent_point)


def _vector(direction: complex) -> FloatArray:
    return np.array([direction.real, direction.imag])
