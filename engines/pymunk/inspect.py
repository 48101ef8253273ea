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
from typing import Any

import numpy as np
import pymunk
from pymunk import constraints

from ...models.arrays import FloatArray, as_vectors
from ...models.elements import GROUND, STOPS, ElementTable, PointStop, Stop
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Mechanism
from ..inspection import Dynamics, Inspection, State
from .bodies import Assembly, Rod, is_pin
from .build import build
from .leapfrog import STEP, settled_increment
from .options import PymunkOptions
from .read import MotionReading, forces_of, reading_of


def inspect(mechanism: Mechanism, states: Sequence[State], options: PymunkOptions) -> Inspection:
    """Inspect the built assembly in each state.

    Raises:
        UnsupportedProblemError: the mechanism has a part that has no counterpart here.
        SimulationError: Chipmunk's impulses do not converge.
    """
    touching = [stop.name for stop in mechanism.stops if stop.closed]
    built = build(mechanism, touching, 0.0, options.pivot_mass)
    start, start_speeds, _ = reading_of(built).motion
    # Mass that is welded or given to the ground is in no body, or in too heavy a one.
    total_mass: float | None = float(sum(body.mass for body in built.bodies))
    for body in mechanism.bodies:
        if built.placements[body.name].carrier == GROUND:
            total_mass = None
    for joint in built.rigid.tree_joints:
        heavier = options.pivot_mass != 1 or built.rigid.body(joint.child).inertia == 0
        pinned = joint.parent == GROUND and is_pin(joint) and built.parts[joint.child].turns
        if pinned and heavier:
            total_mass = None
    return Inspection(
        start=start[0],
        start_speeds=start_speeds[0],
        dynamics=tuple(_dynamics(built, state, options.pivot_mass) for state in states),
        total_mass=total_mass,
    )


def _dynamics(built: Assembly, state: State, pivot_mass: float) -> Dynamics:
    # Not validated: stops keep the word on whether they are closed at the start, which decides what
    # bodies are made of.
    placed = built.mechanism.model_copy(
        update={"start": tuple(state.q), "start_speeds": tuple(state.u)}
    )
    assembly = build(placed, state.closed, 0.0, pivot_mass)
    mass, forces = _inertia(assembly)
    # One step to the present state, with targets displaced by h^2 times centripetal accelerations.
    # Gears have none. The change of velocity is the acceleration there.
    for rod in assembly.rods:
        rod.joint.distance = rod.length - STEP**2 * _lengthening(rod)
    for joint in assembly.space.constraints:
        if isinstance(joint, constraints.PivotJoint):
            _, _, centripetal = _end(joint.b, joint.anchor_b)
            anchor = complex(*joint.anchor_a) - STEP**2 * centripetal
            joint.anchor_a = (anchor.real, anchor.imag)
    reading = reading_of(assembly, settled_increment(assembly) / STEP)
    _, torques = forces_of(reading, state.closed)
    centres = {body.name: reading.point(body.name, body.centre) for body in placed.bodies}
    gaps: dict[str, float] = {}
    for name in state.closed:
        stop = built.rigid.stop(name)
        gaps[name] = _GAPS[stop](built, stop, reading)
    return Dynamics(
        accelerations=reading.motion[2][0],
        stop_torques={name: float(torque[0]) for name, torque in torques.items()},
        mass_matrix=mass,
        forces=forces,
        centres={name: as_vectors(at[0])[0] for name, at in centres.items()},
        stop_gaps=gaps,
    )


def _inertia(assembly: Assembly) -> tuple[FloatArray, FloatArray]:
    """M and f of the engine's bodies.

    M is the sum of m J^T J + I j^T j, f that of J^T m (a - centrifugal acceleration) + j^T I s. The
    accelerations a and s of a body are those that gravity and force elements give it where no joint
    holds it. A body that does not turn has no angle of its own (its moment is infinite): it
    is a point mass. Mass on a pin in the ground does not move, and so is in neither.
    """
    springs = (constraints.DampedSpring, constraints.DampedRotarySpring)
    joints = [joint for joint in assembly.space.constraints if not isinstance(joint, springs)]
    if joints:
        assembly.space.remove(*joints)
    free_accelerations = settled_increment(assembly) / STEP
    if joints:
        assembly.space.add(*joints)

    kinematics, attitudes = Kinematics(assembly.mechanism), assembly.mechanism.attitudes
    q, u = initial_state(assembly.mechanism)
    rates = kinematics.rates(q)
    mass, forces = np.zeros((len(q), len(q))), np.zeros(len(q))
    for part, (x, y, spin) in zip(assembly.parts.values(), free_accelerations, strict=True):
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


def _end(body: pymunk.Body, anchor: tuple[float, float]) -> tuple[complex, complex, complex]:
    """End of a joint: position, velocity, acceleration at constant rates of its body [m, s]."""
    arm, spin = complex(*anchor) * cmath.exp(1j * body.angle), body.angular_velocity
    velocity = complex(*body.velocity) + 1j * spin * arm
    return complex(*body.position) + arm, velocity, -(spin**2) * arm


def _lengthening(rod: Rod) -> float:
    """Second derivative of a rod's length [m/s^2], at constant rates of its bodies.

    |d|'' = n . d'' + (n x d')^2 / |d| with n = d / |d|. The anchor of a sliding rod leaves no
    velocity across in the frame of its line, which turns with w: then n . d'' + 2 w (n x d') - w^2
    |d|.
    """
    position_a, velocity_a, centripetal_a = _end(rod.joint.a, rod.joint.anchor_a)
    position_b, velocity_b, centripetal_b = _end(rod.joint.b, rod.joint.anchor_b)
    difference = position_b - position_a
    distance = abs(difference)
    along = difference.conjugate() / distance
    across = (along * (velocity_b - velocity_a)).imag
    bent = (along * (centripetal_b - centripetal_a)).real
    if rod.axis is None:
        return bent + across**2 / distance
    spin = rod.joint.a.angular_velocity
    return bent + 2 * spin * across - spin**2 * distance


# --- Gaps of stops at the bodies' present positions, by their joints as built


def _rod_of(built: Assembly, stop: str) -> Rod | None:
    return next((rod for rod in built.rods if rod.joint is built.stops[stop]), None)


def _point_gap(built: Assembly, stop: PointStop, reading: MotionReading) -> float:
    rod, other = _rod_of(built, stop.name), built.parts.get(stop.relative_to)
    assert rod is not None
    anchor = complex(*rod.joint.anchor_a) + (0j if other is None else other.reference)
    wall = reading.frames[stop.relative_to]
    point = reading.point(stop.body, stop.point)
    difference = complex((point - wall.point(anchor))[0, 0])
    normal = complex(wall.world(complex(*stop.normal))[0])
    return (difference * normal.conjugate()).real - rod.length


def _angle_gap(built: Assembly, stop: Stop, reading: MotionReading) -> float:
    body, other = (float(reading.frames[name].q[0]) for name in (stop.body, stop.relative_to))
    rod, gear = _rod_of(built, stop.name), built.stops[stop.name]
    if rod is None:
        assert isinstance(gear, constraints.GearJoint)
        return stop.sense * (body - other + gear.phase)
    # Brace, bob's rod and the line from the pin to the brace's anchor are a triangle, whose sides
    # give the angle of the stop's body relative to the other one at which the brace keeps it.
    bob, base = stop.body, stop.relative_to
    if built.parts[bob].turns:
        bob, base = base, bob
    part = built.parts[bob]
    origin = 0j if base == GROUND else built.parts[base].reference
    pin = complex(*built.rigid.joint_of(bob).parent_point)
    anchor = origin + complex(*rod.joint.anchor_a) - pin
    arm, far, brace = abs(part.reference - part.pin), abs(anchor), rod.joint.distance
    corner = math.acos((far**2 + arm**2 - brace**2) / (2 * far * arm))
    # The anchor is counter-clockwise of the bob; angles of the mechanism are clockwise.
    braced = -cmath.phase(anchor * cmath.exp(-1j * corner) / (part.reference - part.pin))
    braced = braced if bob == stop.body else -braced
    return stop.sense * math.remainder(body - other - braced, 2 * math.pi)


_GAPS: ElementTable[Callable[[Assembly, Any, MotionReading], float]] = ElementTable(
    "pymunk's inspection", STOPS, {Stop: _angle_gap, PointStop: _point_gap}
)
