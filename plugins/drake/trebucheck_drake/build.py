"""The Drake plant of a mechanism: a tree in the x-y plane, turning about -z, which is clockwise.

A slide is a prismatic joint. Where the child turns as well, it is on a body without mass that
slides, which a revolute joint follows; welds are Drake's. :func:`add_link` is in a program of a run
as it is here.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    LinearSpringDamper,
    PrismaticJoint,
    RevoluteJoint,
    RevoluteSpring,
    RotationalInertia,
    SpatialInertia,
    WeldJoint,
)
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND, AnyForceElement, AnyJoint, SpringDamper
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck_toolkit.given_forces import springs_of_joints
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.schemes import State

Point = tuple[float, float]


class Link(NamedTuple):
    """A body with the joint that it is on."""

    name: str
    joint: str
    parent: str
    angle: float
    """Of the joint's frame on the parent, clockwise [rad]."""
    place: Point
    """Of the joint's frame on the parent [m]."""
    child_place: Point
    """Of the joint on the body [m]."""
    slides: tuple[Point, ...]
    """Directions in the parent's frame."""
    turns: bool
    mass: float
    centre: Point
    inertia: float


def link_of(body: Body, joint: AnyJoint) -> Link:
    """The link of a body."""
    slides = tuple((each.real, each.imag) for each in joint.free_directions)
    on_parent = joint.parent, joint.turned_by or 0.0, joint.parent_point
    own = body.mass, body.centre, body.inertia
    turns = body.angle is not None
    return Link(body.name, joint.name, *on_parent, joint.child_point, slides, turns, *own)


def add_link(
    plant: Any,
    bodies: dict[str, Any],
    name: str,
    joint: str,
    parent: str,
    angle: float,
    place: tuple[float, float],
    child_place: tuple[float, float],
    slides: tuple[tuple[float, float], ...],
    turns: bool,
    mass: float,
    centre: tuple[float, float],
    inertia: float,
) -> list[Any]:
    """Add a body to a plant and to the `bodies` by name; return the joints that it is on."""
    # Of a flat body the inertias in its plane are half of that about its normal.
    moments = RotationalInertia(0.5 * inertia, 0.5 * inertia, inertia)
    spatial = SpatialInertia.MakeFromCentralInertia(mass, np.array([*centre, 0.0]), moments)
    bodies[name] = link = plant.AddRigidBody(name, spatial)
    turned = RotationMatrix.MakeZRotation(-angle)
    at, on = RigidTransform(turned, np.array([*place, 0.0])), bodies[parent]
    before = plant.AddFrame(FixedOffsetFrame(f"{joint} on {on.name()}", on, at))
    at = RigidTransform(np.array([*child_place, 0.0]))
    onto = plant.AddFrame(FixedOffsetFrame(f"{joint} child on {name}", link, at))
    joints = []
    for k, slide in enumerate(slides):
        after = onto
        if turns or k < len(slides) - 1:  # a body without mass, which the next joint is on
            after = plant.AddRigidBody(f"{joint} slide {k}", SpatialInertia.Zero()).body_frame()
        # The direction is in the parent's frame, and the joint's frame may be turned from it.
        axis = turned.inverse() @ np.array([*slide, 0.0])
        joints.append(plant.AddJoint(PrismaticJoint(f"{joint} {k}", before, after, axis)))
        before = after
    if turns:
        axis = np.array([0.0, 0.0, -1.0])
        joints.append(plant.AddJoint(RevoluteJoint(joint, before, onto, axis)))
    elif not slides:
        joints.append(plant.AddJoint(WeldJoint(joint, before, onto, RigidTransform())))
    return joints


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
            joints = add_link(self.plant, self.bodies, *link_of(body, joint))
            self.carriers[joint.name] = joints[-1]
            self.moving += [each for each in joints if each.num_velocities()]

    def end(self, body: str, point: tuple[float, float]) -> tuple[Any, FloatArray]:
        """A point of a body, as Drake's constraints and springs take it."""
        return self.bodies[body], in_space(point)

    def add_springs(self, but: Collection[int] = ()) -> None:
        """Add those springs that Drake has; joint coordinates `but` get none."""
        self.joint_springs = springs_of_joints(self.coordinates, but=but)
        for index, (stiffness, rest, damping) in self.joint_springs.values():
            self.plant.AddForceElement(RevoluteSpring(self.moving[index], rest, stiffness))
            self.moving[index].set_default_damping_vector([damping])
        every = self.mechanism.force_elements
        self.springs = [each for each in every if has_length(each)]
        for each in self.springs:
            ends = (
                *self.end(each.relative_to, each.relative_point),
                *self.end(each.body, each.point),
            )
            law = each.rest_length, each.stiffness, each.damping
            self.plant.AddForceElement(LinearSpringDamper(*ends, *law))
        own = {*self.joint_springs, *(each.name for each in self.springs)}
        others = tuple(each for each in every if each.name not in own)
        self.pushed = self.mechanism.model_copy(update={"force_elements": others})
        """The mechanism with the other springs, and loads, alone."""

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


def has_length(element: AnyForceElement) -> bool:
    """Tell whether it is a spring that Drake has: one of no length at rest is not among them."""
    return isinstance(element, SpringDamper) and element.rest_length > 0


def in_space(point: tuple[float, float] | FloatArray) -> FloatArray:
    """A vector of the plane in space."""
    return np.array([*point, 0.0])
