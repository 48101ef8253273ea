"""The links of a mechanism's tree as plain values, and how a skeleton of DART's gets them.

Every joint of the skeleton has one coordinate: a slide is a prismatic joint onto a body without
mass, which a revolute joint follows. The tree turns about -z, which is clockwise. The functions are
in a program of a run as they are here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import dartpy
import numpy as np
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND, AnyJoint
from trebucheck.models.mechanism import Body
from trebucheck_toolkit.joint_coordinates import JointCoordinates

Point = tuple[float, float]
_LEAST = 1e-300  # [kg, kg m^2] above zero, and nothing beside any other


class Link(NamedTuple):
    """A body node with the joint that it is on."""

    name: str
    joint: str
    kind: str
    """Of the joint: Revolute, Prismatic or Weld."""
    parent: str | None
    axis: Point | None
    """Direction of a slide in the joint's frame."""
    angle: float
    """Of the joint's frame on the parent, clockwise [rad]."""
    place: Point
    """Of the joint's frame on the parent [m]."""
    child_place: Point
    """Of the joint on the body [m]."""
    mass: float
    centre: Point
    inertia: float


def links(to: JointCoordinates) -> Iterator[Link]:
    """The links of a tree, parents first."""
    for body, joint in to.links:
        yield from _links_of(body, joint)


def _links_of(body: Body, joint: AnyJoint) -> Iterator[Link]:
    parent = None if joint.parent == GROUND else joint.parent
    at: tuple[float, Point] = joint.turned_by or 0.0, joint.parent_point
    own = joint.child_point, body.mass, body.centre, body.inertia
    nothing = (0.0, 0.0), 0.0, (0.0, 0.0), 0.0
    slides = list(joint.free_directions)
    for k, direction in enumerate(slides):
        last = k == len(slides) - 1 and body.angle is None
        # The axis is in the joint's frame, which may be turned from the parent's.
        along = frame(*at).rotation().T @ np.array([direction.real, direction.imag, 0.0])
        name, axis = f"{joint.name} {k}", (float(along[0]), float(along[1]))
        node = body.name if last else f"{name} carrier"
        yield Link(node, name, "Prismatic", parent, axis, *at, *(own if last else nothing))
        parent, at = node, (0.0, (0.0, 0.0))
    if body.angle is not None:
        yield Link(body.name, joint.name, "Revolute", parent, None, *at, *own)
    elif not slides:
        yield Link(body.name, joint.name, "Weld", parent, None, *at, *own)


def frame(angle: float, place: tuple[float, float]) -> Any:
    """A frame turned by an angle, positive clockwise [rad], at a place [m]."""
    cos, sin = math.cos(angle), math.sin(angle)
    found = dartpy.math.Isometry3()
    found.set_rotation(np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]))
    found.set_translation(np.array([*place, 0.0]))
    return found


def inertia_of(mass: float, centre: tuple[float, float], inertia: float) -> Any:
    """Inertia of a flat body: in-plane moments are half of that about its normal.

    DART prints a line for each number that is zero, so those are the least that it takes.
    """
    moment = np.diag(np.maximum([0.5 * inertia, 0.5 * inertia, inertia], _LEAST))
    return dartpy.dynamics.Inertia(max(mass, _LEAST), np.array([*centre, 0.0]), moment)


def add_link(
    skeleton: Any,
    parent: Any,
    name: str,
    joint: str,
    kind: str,
    axis: tuple[float, float] | None,
    angle: float,
    place: tuple[float, float],
    child_place: tuple[float, float],
    inertia: Any,
) -> tuple[Any, Any]:
    """Add a body node on a joint to a node of a skeleton, or to the world; return joint, node."""
    if kind == "Weld":  # its properties are set after it has been made
        before = [] if parent is None else [parent]
        made, node = skeleton.createWeldJointAndBodyNodePair(*before)
        made.setName(joint)
        made.setTransformFromParentBodyNode(frame(angle, place))
        made.setTransformFromChildBodyNode(frame(0.0, child_place))
        node.setName(name)
    else:
        properties = getattr(dartpy.dynamics, f"{kind}JointProperties")()
        properties.mAxis = np.array([0.0, 0.0, -1.0] if axis is None else [*axis, 0.0])
        properties.mName = joint
        properties.mT_ParentBodyToJoint = frame(angle, place)
        properties.mT_ChildBodyToJoint = frame(0.0, child_place)
        aspect = dartpy.dynamics.BodyNodeAspectProperties(name)
        create = getattr(skeleton, f"create{kind}JointAndBodyNodePair")
        made, node = create(parent, properties, dartpy.dynamics.BodyNodeProperties(aspect))
    node.setInertia(inertia)
    return made, node


class Skeleton:
    """A mechanism's skeleton in a world of its own."""

    def __init__(self, to: JointCoordinates) -> None:
        self.world: Any = dartpy.simulation.World()
        gravity = to.mechanism.gravity_vector
        self.world.setGravity(np.array([*gravity, 0.0]))
        self.skeleton: Any = dartpy.dynamics.Skeleton(to.mechanism.name)
        self.bodies: dict[str | None, Any] = {None: None}
        self.moving: list[Any] = []
        """DART's joints in the order of the joint coordinates."""
        for link in links(to):
            made, self.bodies[link.name] = add_link(
                self.skeleton,
                self.bodies[link.parent],
                link.name,
                link.joint,
                link.kind,
                link.axis,
                link.angle,
                link.place,
                link.child_place,
                inertia_of(link.mass, link.centre, link.inertia),
            )
            if link.kind != "Weld":
                self.moving.append(made)

    def place(self, j: FloatArray, v: FloatArray) -> None:
        """Set the state."""
        self.skeleton.setPositions(j)
        self.skeleton.setVelocities(v)
