"""A mechanism as a DART skeleton: its dynamics, its limits and steps, and what it shows.

Every joint of the skeleton has one coordinate: a slide is a prismatic joint onto a body without
mass, which a revolute joint follows. The tree turns about -z, which is clockwise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import dartpy
import numpy as np
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND, AnyJoint
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck_toolkit.event_driver import Observation
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.schemes import State

_CLOCKWISE = np.array([0.0, 0.0, -1.0])


class DartTree:
    """A skeleton in a world of its own."""

    def __init__(self, mechanism: Mechanism, timestep: float = 1e-3) -> None:
        self.mechanism, self.coordinates = mechanism, JointCoordinates(mechanism)
        self.world: Any = dartpy.simulation.World()
        self.world.setGravity(_in_space(mechanism.gravity_vector))
        self.world.setTimeStep(timestep)
        self.skeleton: Any = dartpy.dynamics.Skeleton(mechanism.name)
        self.bodies: dict[str, Any] = {GROUND: None}
        self.moving: list[Any] = []
        """DART's joints in the order of the joint coordinates."""
        for body, joint in self.coordinates.links:
            self._add(body, joint)
        self.world.addSkeleton(self.skeleton)
        self.markers = {each.name: (each.body, _in_space(each.point)) for each in mechanism.markers}

    # --- Building
    # ---------------------------------------------------------------------------------------------

    def _add(self, body: Body, joint: AnyJoint) -> None:
        parent, frame = (
            self.bodies[joint.parent],
            _frame(joint.turned_by or 0.0, joint.parent_point),
        )
        slides = list(joint.free_directions)
        for k, direction in enumerate(slides):
            last = k == len(slides) - 1 and body.angle is None
            properties = dartpy.dynamics.PrismaticJointProperties()
            # The axis is in the joint's frame, which may be turned from the parent's.
            properties.mAxis = frame.rotation().T @ _in_space((direction.real, direction.imag))
            parent = self._joined(
                parent, "Prismatic", properties, f"{joint.name} {k}", frame, body, joint, last
            )
            frame = _frame(0.0, (0.0, 0.0))
        if body.angle is not None:
            properties = dartpy.dynamics.RevoluteJointProperties()
            properties.mAxis = _CLOCKWISE
            self._joined(parent, "Revolute", properties, joint.name, frame, body, joint, True)
        elif not slides:
            self._weld(parent, frame, body, joint)

    def _joined(
        self,
        parent: Any,
        kind: str,
        properties: Any,
        name: str,
        frame: Any,
        body: Body,
        joint: AnyJoint,
        last: bool,
    ) -> Any:
        """Body node on a joint: the mechanism's body on its last joint, else one without mass."""
        properties.mName, properties.mT_ParentBodyToJoint = name, frame
        if last:
            properties.mT_ChildBodyToJoint = _frame(0.0, joint.child_point)
        aspect = dartpy.dynamics.BodyNodeAspectProperties(body.name if last else f"{name} carrier")
        create = getattr(self.skeleton, f"create{kind}JointAndBodyNodePair")
        made, node = create(parent, properties, dartpy.dynamics.BodyNodeProperties(aspect))
        node.setInertia(
            _inertia(body) if last else dartpy.dynamics.Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
        )
        self.moving.append(made)
        if last:
            self.bodies[body.name] = node
        return node

    def _weld(self, parent: Any, frame: Any, body: Body, joint: AnyJoint) -> None:
        """Properties of a weld are not to be had in Python: it is set after it has been made."""
        made, node = self.skeleton.createWeldJointAndBodyNodePair(
            *([] if parent is None else [parent])
        )
        made.setName(joint.name)
        made.setTransformFromParentBodyNode(frame)
        made.setTransformFromChildBodyNode(_frame(0.0, joint.child_point))
        node.setName(body.name)
        node.setInertia(_inertia(body))
        self.bodies[body.name] = node

    # --- Dynamics
    # ---------------------------------------------------------------------------------------------

    def mass_matrix(self, j: FloatArray) -> FloatArray:
        """Mass matrix by `getMassMatrix`."""
        self.skeleton.setPositions(j)
        return np.array(self.skeleton.getMassMatrix())

    def bias(self, j: FloatArray, v: FloatArray) -> FloatArray:
        """Bias forces by `getCoriolisAndGravityForces`."""
        self.place(j, v)
        return np.array(self.skeleton.getCoriolisAndGravityForces())

    def total_mass(self) -> float:
        """Mass of all bodies [kg]."""
        return float(self.skeleton.getMass())

    def centres(self, j: FloatArray) -> dict[str, FloatArray]:
        """Centre of mass of each body in the world [m]."""
        self.skeleton.setPositions(j)
        return {
            each.name: np.array(self.bodies[each.name].getCOM()[:2])
            for each in self.mechanism.bodies
        }

    # --- Steps
    # ---------------------------------------------------------------------------------------------

    def place(self, j: FloatArray, v: FloatArray) -> None:
        """Set the state."""
        self.skeleton.setPositions(j)
        self.skeleton.setVelocities(v)

    def limit(self, index: int, low: float, high: float) -> None:
        """Set the range of a joint coordinate."""
        joint = self.moving[index]
        joint.setPositionLowerLimit(0, low)
        joint.setPositionUpperLimit(0, high)
        joint.setLimitEnforcement(True)

    def state(self) -> State:
        """The present state."""
        return np.array(self.skeleton.getPositions()), np.array(self.skeleton.getVelocities())

    def step(self, forces: FloatArray) -> Mapping[str, FloatArray]:
        """Take one step; reactions are DART's body forces, in the bodies' frames at its start."""
        turned = {name: self._pose(name)[:2, :2] for name in self.bodies if name != GROUND}
        self.skeleton.setForces(forces)
        self.world.step()
        return {
            joint.name: turned[joint.child] @ self.bodies[joint.child].getBodyForce()[3:5]
            for joint in self.mechanism.tree_joints
        }

    # --- What it shows
    # ---------------------------------------------------------------------------------------------

    def observe(self, j: FloatArray, v: FloatArray, a: FloatArray) -> Observation:
        """Readings of the skeleton; reactions are the body forces of its inverse dynamics."""
        skeleton = self.skeleton
        self.place(j, v)
        skeleton.setAccelerations(a)
        skeleton.computeInverseDynamics()
        return Observation(
            points={name: self._point(*place) for name, place in self.markers.items()},
            kinetic_energy=float(skeleton.computeKineticEnergy()),
            potential_energy=float(skeleton.computePotentialEnergy()),
            reactions={
                joint.name: self._pose(joint.child)[:2, :2]
                @ self.bodies[joint.child].getBodyForce()[3:5]
                for joint in self.mechanism.tree_joints
            },
        )

    def _pose(self, name: str) -> FloatArray:
        return np.array(self.bodies[name].getWorldTransform().matrix())

    def _point(self, name: str, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        pose = self._pose(name)
        return (pose[:3, :3] @ point + pose[:3, 3])[:2], np.array(
            self.bodies[name].getLinearVelocity(point)[:2]
        )


def _inertia(body: Body) -> Any:
    """Inertia tensor of a flat body: in-plane moments are half of that about its normal."""
    moment = np.diag([0.5 * body.inertia, 0.5 * body.inertia, body.inertia])
    return dartpy.dynamics.Inertia(body.mass, _in_space(body.centre), moment)


def _in_space(point: tuple[float, float]) -> FloatArray:
    return np.array([*point, 0.0])


def _frame(angle: float, place: tuple[float, float]) -> Any:
    """A frame turned by an angle, positive clockwise [rad], at a place [m]."""
    cos, sin = math.cos(angle), math.sin(angle)
    found = dartpy.math.Isometry3()
    found.set_rotation(np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]))
    found.set_translation(_in_space(place))
    return found
