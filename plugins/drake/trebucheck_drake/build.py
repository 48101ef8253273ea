"""The Drake plant of a mechanism: a tree in the x-y plane, turning about -z, which is clockwise.

A slide is a prismatic joint. Where the child turns as well, it is on a body without mass that
slides, which a revolute joint follows; welds are Drake's.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    PrismaticJoint,
    RevoluteJoint,
    RotationalInertia,
    SpatialInertia,
    WeldJoint,
)
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND, AnyJoint
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.schemes import State

_CLOCKWISE = np.array([0.0, 0.0, -1.0])


class Built:
    """A mechanism's plant."""

    def __init__(self, mechanism: Mechanism, timestep: float = 0.0) -> None:
        """Build the plant: continuous, or discrete with a time step [s]."""
        self.mechanism = mechanism
        self.coordinates = JointCoordinates(mechanism)
        self.plant: Any = MultibodyPlant(time_step=timestep)
        self.plant.mutable_gravity_field().set_gravity_vector(in_space(mechanism.gravity_vector))
        self.bodies: dict[str, Any] = {GROUND: self.plant.world_body()}
        self.carriers: dict[str, Any] = {}
        """Drake's joint that carries each body, by the name of the mechanism's joint."""
        self.moving: list[Any] = []
        """Drake's joints in the order of the joint coordinates."""
        for body, joint in self.coordinates.links:
            self._add(body, joint)

    def finalize(self) -> None:
        """End the building."""
        self.plant.Finalize()
        self.positions = np.array([joint.position_start() for joint in self.moving], dtype=int)
        """Index of each joint coordinate among Drake's positions."""
        self.speeds = np.array([joint.velocity_start() for joint in self.moving], dtype=int)

    def in_order(self, values: FloatArray, places: FloatArray) -> FloatArray:
        """Values of the joint coordinates in the order of Drake's, by their places there."""
        ordered = np.zeros(len(values))
        ordered[places] = values
        return ordered

    def coordinates_of(self, state: FloatArray) -> State:
        """The mechanism's coordinates and speeds of Drake's positions and velocities."""
        n, to = self.plant.num_positions(), self.coordinates
        return to.mechanism_positions(state[:n][self.positions]), to.mechanism_speeds(
            state[n:][self.speeds]
        )

    def _add(self, body: Body, joint: AnyJoint) -> None:
        # Of a flat body the inertias in its plane are half of that about its normal.
        inertia = RotationalInertia(0.5 * body.inertia, 0.5 * body.inertia, body.inertia)
        inertia = SpatialInertia.MakeFromCentralInertia(body.mass, in_space(body.centre), inertia)
        self.bodies[body.name] = link = self.plant.AddRigidBody(body.name, inertia)
        at = RigidTransform(_turned(joint.turned_by or 0.0), in_space(joint.parent_point))
        before, onto = (
            self._frame(self.bodies[joint.parent], at, joint.name),
            self._child_frame(link, joint),
        )
        slides = list(joint.free_directions)
        for k, direction in enumerate(slides):
            last = k == len(slides) - 1 and body.angle is None
            after = onto if last else self._massless(f"{joint.name} slide {k}").body_frame()
            # The direction is in the parent's frame, and the joint's frame may be turned from it.
            axis = _turned(joint.turned_by or 0.0).inverse() @ in_space(
                (direction.real, direction.imag)
            )
            self._add_joint(joint, PrismaticJoint(f"{joint.name} {k}", before, after, axis))
            before = after
        if body.angle is not None:
            self._add_joint(joint, RevoluteJoint(joint.name, before, onto, _CLOCKWISE))
        elif not slides:
            self.carriers[joint.name] = self.plant.AddJoint(
                WeldJoint(joint.name, before, onto, RigidTransform())
            )

    def _add_joint(self, joint: AnyJoint, made: Any) -> None:
        self.carriers[joint.name] = self.plant.AddJoint(made)
        self.moving.append(self.carriers[joint.name])

    def _frame(self, body: Any, at: Any, name: str) -> Any:
        return self.plant.AddFrame(FixedOffsetFrame(f"{name} on {body.name()}", body, at))

    def _child_frame(self, link: Any, joint: AnyJoint) -> Any:
        return self._frame(link, RigidTransform(in_space(joint.child_point)), f"{joint.name} child")

    def _massless(self, name: str) -> Any:
        return self.plant.AddRigidBody(name, SpatialInertia.Zero())


def in_space(point: tuple[float, float]) -> FloatArray:
    """A vector of the plane in space."""
    return np.array([*point, 0.0])


def _turned(angle: float) -> Any:
    """Rotation by an angle, positive clockwise [rad]."""
    return RotationMatrix.MakeZRotation(-angle)
