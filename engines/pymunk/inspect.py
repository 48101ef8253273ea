"""The built Chipmunk assembly in single states: the inertia of its bodies, and what one step does.

A step solves M (v+ - v) / h = F + J^T lam with J v+ = -C / h for the velocities v+ after it, where
C is the error of each joint from its target. The bodies are put into the state itself, and each
joint's target is displaced by h^2 times the centripetal part of its acceleration: (v+ - v) / h is
then the acceleration at the state for a step of any length, without truncation error. A long step
keeps the rounding error of positions small, which enters accelerations divided by h^2.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pymunk
from pymunk import constraints

from ...models.arrays import FloatArray, as_vectors
from ...models.elements import GROUND, STOPS, AnyStop, ElementTable, PointStop, Stop
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Mechanism
from ..inspection import Dynamics, Inspection, State
from .bodies import Assembly, Rod, is_pin
from .build import build
from .leapfrog import STEP, settled_increment
from .options import PymunkOptions
from .reactions import forces_of
from .read import MotionReading, reading_of


def inspect(mechanism: Mechanism, states: Sequence[State], options: PymunkOptions) -> Inspection:
    """Inspect the built assembly in each state.

    Raises:
        UnsupportedProblemError: the mechanism has a part that has no counterpart here.
        SimulationError: Chipmunk's impulses do not settle: masses differ too much, or constraints
            are nearly parallel.
    """
    touching = [stop.name for stop in mechanism.stops if stop.closed]
    built = build(mechanism, touching, 0.0, options.pivot_mass)
    start, start_speeds = reading_of(built).coordinates()
    return Inspection(
        start=start[0],
        start_speeds=start_speeds[0],
        dynamics=tuple(_dynamics(built, state, options.pivot_mass) for state in states),
        total_mass=_total_mass(built, options.pivot_mass),
    )


def _total_mass(assembly: Assembly, pivot_mass: float) -> float | None:
    """Mass of all bodies [kg]; None where mass on the ground is changed or left out."""
    pinned = [
        joint
        for joint in assembly.rigid.tree_joints
        if joint.parent == GROUND and is_pin(joint) and assembly.parts[joint.child].turns
    ]
    grounded = any(
        place.carrier == GROUND for name, place in assembly.placements.items() if name != GROUND
    )
    changed = any(
        pivot_mass != 1 or assembly.rigid.body(joint.child).inertia == 0 for joint in pinned
    )
    return None if changed or grounded else float(sum(body.mass for body in assembly.bodies))


def _dynamics(built: Assembly, state: State, pivot_mass: float) -> Dynamics:
    # Not validated: stops keep the word on whether they are closed at the start, which decides what
    # bodies are made of.
    placed = built.mechanism.model_copy(
        update={"start": tuple(state.q), "start_speeds": tuple(state.u)}
    )
    assembly = build(placed, state.closed, 0.0, pivot_mass)
    mass, forces = _inertia(assembly)
    reading = _stepped(assembly)
    return Dynamics(
        accelerations=reading.accelerations()[0],
        stop_torques={
            name: float(torque[0])
            for name, torque in forces_of(reading, state.closed).torques.items()
        },
        mass_matrix=mass,
        forces=forces,
        centres={
            body.name: as_vectors(reading.point(body.name, body.centre).position)[0]
            for body in placed.bodies
        },
        stop_gaps={name: _gap(built, placed.stop(name), reading) for name in state.closed},
    )


def _inertia(assembly: Assembly) -> tuple[FloatArray, FloatArray]:
    """M and f of the engine's bodies.

    M is the sum of m J^T J + I j^T j, f that of J^T m (a - centrifugal acceleration) + j^T I s. The
    accelerations a and s of a body are those that gravity and force elements give it where no joint
    holds it. A body that does not turn has no angle of its own (its moment is infinite): it
    is a point mass. Mass on a pin in the ground does not move, and so is in neither.
    """
    kinematics, attitudes = Kinematics(assembly.mechanism), assembly.mechanism.attitudes
    q, u = initial_state(assembly.mechanism)
    rates = kinematics.rates(q)
    mass, forces = np.zeros((len(q), len(q))), np.zeros(len(q))
    for part, (x, y, spin) in zip(
        assembly.parts.values(), _free_accelerations(assembly), strict=True
    ):
        row = kinematics.point(part.name, (part.reference.real, part.reference.imag))
        jacobian = kinematics.gradient(row.coefficients, q, rates)
        centripetal = complex(*kinematics.acceleration(row, q, u, np.zeros_like(q)))
        mass += part.body.mass * np.outer(jacobian.conj(), jacobian).real
        forces += part.body.mass * (jacobian.conj() * (complex(x, y) - centripetal)).real
        index, _ = attitudes[part.name]
        if part.turns and index is not None:
            mass[index, index] += part.body.moment
            forces[index] -= part.body.moment * spin
    return mass, forces


def _free_accelerations(assembly: Assembly) -> FloatArray:
    """Accelerations of the bodies by Chipmunk without joints and stops, shape (n_bodies, 3)."""
    joints = [joint for joint in assembly.space.constraints if not isinstance(joint, _SPRINGS)]
    if joints:
        assembly.space.remove(*joints)
    accelerations = settled_increment(assembly) / STEP
    if joints:
        assembly.space.add(*joints)
    return accelerations


def _stepped(assembly: Assembly) -> MotionReading:
    """One step to the present state, whose change of velocity is the acceleration there."""
    _set_targets(assembly)
    return reading_of(assembly, settled_increment(assembly) / STEP)


def _set_targets(assembly: Assembly) -> None:
    """Displace the joints' targets by h^2 times centripetal accelerations; gears have none."""
    for rod in assembly.rods:
        rod.joint.distance = rod.length - STEP**2 * _lengthening(rod)
    for joint in assembly.space.constraints:
        if isinstance(joint, constraints.PivotJoint):
            end = _End.of(joint.b, joint.anchor_b)
            anchor = complex(*joint.anchor_a) - STEP**2 * end.centripetal
            joint.anchor_a = (anchor.real, anchor.imag)


_SPRINGS = (constraints.DampedSpring, constraints.DampedRotarySpring)


@dataclass(frozen=True)
class _End:
    """End of a joint on a body: position, velocity, acceleration at constant rates [m, s]."""

    position: complex
    velocity: complex
    centripetal: complex

    @classmethod
    def of(cls, body: pymunk.Body, anchor: tuple[float, float]) -> _End:
        arm, spin = complex(*anchor) * cmath.exp(1j * body.angle), body.angular_velocity
        return cls(
            complex(*body.position) + arm,
            complex(*body.velocity) + 1j * spin * arm,
            -(spin**2) * arm,
        )


def _lengthening(rod: Rod) -> float:
    """Second derivative of a rod's length [m/s^2], at constant rates of its bodies.

    |d|'' = n . d'' + (n x d')^2 / |d| with n = d / |d|. The anchor of a sliding rod leaves no
    velocity across in the frame of its line, which turns with w: then n . d'' + 2 w (n x d') - w^2
    |d|.
    """
    a, b = _End.of(rod.joint.a, rod.joint.anchor_a), _End.of(rod.joint.b, rod.joint.anchor_b)
    difference, velocity = b.position - a.position, b.velocity - a.velocity
    distance = abs(difference)
    along = difference.conjugate() / distance
    across = (along * velocity).imag
    bent = (along * (b.centripetal - a.centripetal)).real
    if rod.axis is None:
        return bent + across**2 / distance
    spin = rod.joint.a.angular_velocity
    return bent + 2 * spin * across - spin**2 * distance


def _gap(built: Assembly, stop: AnyStop, reading: MotionReading) -> float:
    """Gap of a stop [rad or m] at the bodies' present positions, by its joint as built."""
    joint, stop = built.stops[stop.name], built.rigid.stop(stop.name)
    rod = next((rod for rod in built.rods if rod.joint is joint), None)
    return _GAPS[stop](built, stop, reading, rod)


def _point_gap(built: Assembly, stop: PointStop, reading: MotionReading, rod: Rod | None) -> float:
    assert rod is not None
    other = built.parts.get(stop.relative_to)
    anchor = complex(*rod.end_a) + (other.reference if other is not None else 0j)
    wall = reading.frames[stop.relative_to]
    point = reading.point(stop.body, stop.point).position
    difference = complex((point - wall.point(anchor).position)[0])
    normal = complex(wall.world(complex(*stop.normal))[0])
    return (difference * normal.conjugate()).real - rod.length


def _angle_gap(built: Assembly, stop: Stop, reading: MotionReading, rod: Rod | None) -> float:
    q = {name: float(frame.q[0]) for name, frame in reading.frames.items()}
    between = q[stop.body] - q[stop.relative_to]
    if rod is None:
        gear = built.stops[stop.name]
        assert isinstance(gear, constraints.GearJoint)
        return stop.sense * (between + gear.phase)
    return stop.sense * math.remainder(between - _braced_angle(built, rod, stop), 2 * math.pi)


_GAPS: ElementTable[Callable[[Assembly, Any, MotionReading, Rod | None], float]] = ElementTable(
    "pymunk's inspection", STOPS, {Stop: _angle_gap, PointStop: _point_gap}
)


def _braced_angle(built: Assembly, rod: Rod, stop: Stop) -> float:
    """Angle of the stop's body relative to the other one [rad], at which a brace keeps it.

    Brace, bob's rod and the line from the pin to the brace's anchor are a triangle, whose sides
    give its angle.
    """
    bob, base = stop.body, stop.relative_to
    if built.parts[bob].turns:
        bob, base = base, bob
    part = built.parts[bob]
    pin = built.rigid.joint_of(bob).parent_point
    origin = 0j if base == GROUND else built.parts[base].reference
    anchor = origin + complex(*rod.end_a) - complex(*pin)
    arm, far, brace = abs(part.reference - part.pin), abs(anchor), rod.joint.distance
    corner = math.acos((far**2 + arm**2 - brace**2) / (2 * far * arm))
    # The anchor is counter-clockwise of the bob; angles of the mechanism are clockwise.
    direction = anchor * cmath.exp(-1j * corner)
    clockwise = -cmath.phase(direction / (part.reference - part.pin))
    return clockwise if bob == stop.body else -clockwise
