"""Reading MuJoCo's sensors, in the mechanism's coordinates, names and signs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...models.applied_forces import AppliedForces
from ...models.arrays import FloatArray
from ...models.elements import (
    FORCE_ELEMENTS,
    GROUND,
    AnyJoint,
    ConstantForce,
    ConstantTorque,
    CubicTorsionSpring,
    ElementTable,
    RotationalSpringDamper,
    SpringDamper,
)
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from ...models.mjcf.tree import hinge_chain, slide_joints
from ...models.mjcf.writer import (
    KINETIC_ENERGY,
    POTENTIAL_ENERGY,
    force_sensor,
    mjcf_names,
    position_sensor,
    torque_sensor,
    velocity_sensor,
)
from ...models.trajectory import PointMotion
from ..events import ContactEvents
from ..protocol import Recording
from .build import UnilateralConstraint
from .compat import counts_tendons_in_reactions

IN_PLANE = [0, 2]  # MuJoCo's x and z are our x and y


@dataclass
class Samples:
    """Times, states (MuJoCo's layout: time, qpos, qvel, ...) and sensors of a run."""

    steps: int = 0
    """Steps of MuJoCo, repeated ones included."""
    times: list[FloatArray] = field(default_factory=list[FloatArray])
    states: list[FloatArray] = field(default_factory=list[FloatArray])
    sensors: list[FloatArray] = field(default_factory=list[FloatArray])

    def add(self, times: FloatArray, states: FloatArray, sensors: FloatArray) -> None:
        """Append samples; shapes (n,), (n, n_state), (n, n_sensor)."""
        self.times.append(times)
        self.states.append(states)
        self.sensors.append(sensors)

    def last_time(self) -> float:
        """Time of the last sample [s]."""
        return float(next(times[-1] for times in reversed(self.times) if len(times)))

    def drop_last(self) -> None:
        """Remove the last sample."""
        while not len(self.times[-1]):
            self._cut(None)
        self._cut(-1)

    def _cut(self, end: int | None) -> None:
        for parts in (self.times, self.states, self.sensors):
            last = parts.pop()
            if end is not None:
                parts.append(last[:end])


def _always() -> bool:
    return True


def _never() -> bool:
    return False


TAKEN_OFF: ElementTable[Callable[[], bool]] = ElementTable(
    "MuJoCo's joint reactions",
    FORCE_ELEMENTS,
    {
        SpringDamper: counts_tendons_in_reactions,
        ConstantForce: _never,  # actuators are not
        # Torques have no force to be taken off.
        RotationalSpringDamper: _always,
        CubicTorsionSpring: _always,
        ConstantTorque: _always,
    },
)
"""Whether a `force` sensor takes off what an element does to the bodies beyond its joint."""


@dataclass(frozen=True)
class _Reader:
    mechanism: Mechanism
    model: Any
    positions: FloatArray
    speeds: FloatArray
    sensors: FloatArray

    def sensor(self, name: str) -> FloatArray:
        """A sensor's values, shape (n, size), by the writer's name."""
        of = self.model.sensor(mjcf_names(self.mechanism)[name])
        start, size = int(of.adr[0]), int(of.dim[0])
        return self.sensors[:, start : start + size]

    def markers(self) -> dict[str, PointMotion]:
        return {
            marker.name: PointMotion(
                self.sensor(position_sensor(marker.name))[:, IN_PLANE],
                self.sensor(velocity_sensor(marker.name))[:, IN_PLANE],
            )
            for marker in self.mechanism.markers
        }

    def torque(self, stop: str, constraint: UnilateralConstraint) -> FloatArray:
        """A stop's torque [N m], or force [N] if it is on a point."""
        return constraint.torque(self.sensor(torque_sensor(stop))[:, 0], self.positions, self.model)

    def reactions(self, q: FloatArray, u: FloatArray) -> dict[str, FloatArray]:
        """Forces on the children in the world frame [N]; MuJoCo gives the tree's in the child's.

        A joint that closes a loop is on a massless welded body; MuJoCo's sensor gives the force on
        that body from the body it is welded to, the opposite of the joint's. Of the tree's joints
        it gives what the bodies beyond them need besides the forces of gravity, contacts and (since
        3.14) springs; those of actuators are not taken off.
        """
        kinematics, left_out = Kinematics(self.mechanism), self._left_out(q, u)
        tree = {
            joint.name: self._in_world(joint, kinematics, q) - left_out.get(joint.name, 0.0)
            for joint in self.mechanism.tree_joints
            if joint.held_directions
        }
        return tree | {
            joint.name: -self._in_world(joint, kinematics, q)
            for joint in self.mechanism.loop_joints
        }

    def _left_out(self, q: FloatArray, u: FloatArray) -> dict[str, FloatArray]:
        """Sum of the forces beyond each joint of the tree that MuJoCo does not take off [N].

        Its `force` sensors give what the bodies beyond a joint need besides gravity, contacts and
        what :data:`TAKEN_OFF` says.
        """
        elements = tuple(e for e in self.mechanism.force_elements if not TAKEN_OFF[e]())
        alone = self.mechanism.model_copy(update={"force_elements": elements})
        sums: dict[str, FloatArray] = {}
        for name, force in AppliedForces(Kinematics(alone)).on_bodies(q, u).items():
            body = name
            while body != GROUND:
                joint = self.mechanism.joint_of(body)
                sums[joint.name] = sums.get(joint.name, 0.0) + force
                body = joint.parent
        return sums

    def _in_world(self, joint: AnyJoint, kinematics: Kinematics, q: FloatArray) -> FloatArray:
        """A force sensor's values in the world frame, shape (n, 2)."""
        a, b = self.sensor(force_sensor(joint.name))[:, IN_PLANE].T
        angle = kinematics.angle(joint.child).value(q)
        cos, sin = np.cos(angle), np.sin(angle)
        return np.stack([a * cos + b * sin, b * cos - a * sin], axis=1)


def recording(
    mechanism: Mechanism,
    model: Any,
    constraints: Mapping[str, UnilateralConstraint],
    samples: Samples,
    events: ContactEvents,
) -> Recording:
    """The samples and events as the engines' common record."""
    states = np.concatenate(samples.states)
    n_q, n_v = int(model.nq), int(model.nv)
    positions, speeds = states[:, 1 : 1 + n_q], states[:, 1 + n_q : 1 + n_q + n_v]
    reader = _Reader(mechanism, model, positions, speeds, np.concatenate(samples.sensors))
    sums = absolute_from_relative(mechanism, model)
    q, u = np.array(mechanism.start) + positions @ sums.T, speeds @ sums.T
    return Recording(
        t=np.concatenate(samples.times),
        q=q,
        u=u,
        markers=reader.markers(),
        kinetic_energy=reader.sensor(KINETIC_ENERGY)[:, 0],
        potential_energy=reader.sensor(POTENTIAL_ENERGY)[:, 0],
        stop_torques={
            name: reader.torque(name, constraint) for name, constraint in constraints.items()
        },
        release_times=events.releases,
        joint_reactions=reader.reactions(q, u),
        impacts=tuple(events.impacts),
        steps=samples.steps,
    )


def absolute_from_relative(mechanism: Mechanism, model: Any) -> FloatArray:
    """C with q = start + C qpos and u = C qvel, shape (n_q, n_v): angles are sums of hinges."""
    names = mjcf_names(mechanism)
    matrix = np.zeros((len(mechanism.coordinates), int(model.nv)))
    turning = [body.name for body in mechanism.bodies if body.angle is not None]
    for i, body in enumerate(turning):
        for joint in hinge_chain(mechanism, body):
            matrix[i, model.joint(names[joint]).dofadr[0]] = 1.0
    slides = [name for joint in mechanism.tree_joints for name in slide_joints(joint)]
    for i, name in enumerate(slides, start=len(turning)):
        matrix[i, model.joint(names[name]).dofadr[0]] = 1.0
    return matrix
