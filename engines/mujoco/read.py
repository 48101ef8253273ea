"""Reading MuJoCo's sensors, in the mechanism's coordinates, names and signs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...models import elements
from ...models.applied_forces import AppliedForces
from ...models.arrays import ComplexArray, FloatArray, as_vectors
from ...models.elements import FORCE_ELEMENTS, GROUND, AnyJoint, ElementTable
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
from ..reading import timed_reading
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
        """Remove the last sample, and empty parts behind it."""
        while not len(self.times[-1]):
            for parts in (self.times, self.states, self.sensors):
                parts.pop()
        for parts in (self.times, self.states, self.sensors):
            parts[-1] = parts[-1][:-1]


TAKEN_OFF: ElementTable[Callable[[], bool]] = ElementTable(
    "MuJoCo's joint reactions",
    FORCE_ELEMENTS,
    {
        elements.SpringDamper: counts_tendons_in_reactions,
        elements.ConstantForce: lambda: False,  # actuators are not
        # Torques have no force to be taken off.
        elements.RotationalSpringDamper: lambda: True,
        elements.CubicTorsionSpring: lambda: True,
        elements.ConstantTorque: lambda: True,
        elements.RotorInertia: lambda: True,
        elements.SlideSpringDamper: lambda: False,  # forces of joints are not
        elements.SlideInertia: lambda: True,  # its part along the slide is taken off below
        elements.RecordedForce: lambda: False,
        elements.RecordedTorque: lambda: False,
    },
)
"""Whether a `force` sensor takes off what an element does to the bodies beyond its joint."""


@timed_reading()
def recording(
    mechanism: Mechanism,
    model: Any,
    constraints: Mapping[str, UnilateralConstraint],
    samples: Samples,
    events: ContactEvents,
) -> Recording:
    """The samples and events as the engines' common record."""
    states, sensors = np.concatenate(samples.states), np.concatenate(samples.sensors)
    n_q, n_v = int(model.nq), int(model.nv)
    positions, speeds = states[:, 1 : 1 + n_q], states[:, 1 + n_q : 1 + n_q + n_v]
    sums, names = absolute_from_relative(mechanism, model), mjcf_names(mechanism)
    q, u = np.array(mechanism.start) + positions @ sums.T, speeds @ sums.T

    def sensor(name: str) -> FloatArray:
        """Values of shape (n, size), by the writer's name."""
        of = model.sensor(names[name])
        start, size = int(of.adr[0]), int(of.dim[0])
        return sensors[:, start : start + size]

    markers = dict[str, PointMotion]()
    for marker in mechanism.markers:
        position = sensor(position_sensor(marker.name))[:, IN_PLANE]
        markers[marker.name] = PointMotion(
            position, sensor(velocity_sensor(marker.name))[:, IN_PLANE]
        )
    torques = dict[str, FloatArray]()
    for name, constraint in constraints.items():
        torques[name] = constraint.torque(sensor(torque_sensor(name))[:, 0], positions)
    return Recording(
        t=np.concatenate(samples.times),
        q=q,
        u=u,
        markers=markers,
        kinetic_energy=sensor(KINETIC_ENERGY)[:, 0],
        potential_energy=sensor(POTENTIAL_ENERGY)[:, 0],
        stop_torques=torques,
        release_times=events.releases,
        joint_reactions=_reactions(mechanism, sensor, np.concatenate(samples.times), q, u),
        impacts=tuple(events.impacts),
        steps=samples.steps,
    )


def _reactions(
    mechanism: Mechanism,
    sensor: Callable[[str], FloatArray],
    t: FloatArray,
    q: FloatArray,
    u: FloatArray,
) -> dict[str, FloatArray]:
    """Forces of the joints on their children in the world frame [N].

    A `force` sensor of a joint of the tree gives what the bodies beyond it need besides gravity,
    contacts and what :data:`TAKEN_OFF` says; along a slide that is the force of its coupler or
    drive, not of its joint, which holds nothing there. A joint that closes a loop is on a massless
    welded body; its sensor gives the force on that body from the body it is welded to, the opposite
    of the joint's.
    """
    left_in = tuple(e for e in mechanism.force_elements if not TAKEN_OFF[e]())
    alone = Kinematics(mechanism.model_copy(update={"force_elements": left_in}))
    beyond: dict[str, FloatArray] = {}
    for i, acting in AppliedForces(alone).at_times(t):
        for name, force in acting.on_bodies(q[i], u[i]).items():
            body = name
            while body != GROUND:
                joint = mechanism.joint_of(body)
                beyond.setdefault(joint.name, np.zeros((len(t), 2)))[i] += force
                body = joint.parent

    def in_world(joint: AnyJoint) -> FloatArray:
        a, b = sensor(force_sensor(joint.name))[:, IN_PLANE].T
        angle = alone.angle(joint.child).value(q)
        cos, sin = np.cos(angle), np.sin(angle)
        return np.stack([a * cos + b * sin, b * cos - a * sin], axis=1)

    driven = {name for coupler in mechanism.couplers for name in coupler.coordinates}
    drives = (e for e in mechanism.force_elements if isinstance(e, elements.SlideInertia))
    driven.update(drive.coordinate for drive in drives)
    reactions: dict[str, FloatArray] = {}
    for joint in mechanism.tree_joints:
        if joint.held_directions:
            force = in_world(joint) - beyond.get(joint.name, 0.0)
            if driven.intersection(joint.slides):
                force = _across(force, alone.slide_axis(joint.slides[0], q))
            reactions[joint.name] = force
    for joint in mechanism.loop_joints:
        reactions[joint.name] = -in_world(joint)
    return reactions


def _across(forces: FloatArray, axis: ComplexArray) -> FloatArray:
    """Parts of forces (n, 2) across axes (n,), x + i y of length 1."""
    along = as_vectors(axis)
    return forces - np.sum(forces * along, axis=-1)[:, None] * along


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
