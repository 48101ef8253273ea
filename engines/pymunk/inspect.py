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
from .alone import DocumentedSpace, StopShapes, spring_torque
from .alone import build as build_documented
from .bodies import Assembly, Rod, is_pin
from .build import build
from .leapfrog import STEP, settled_increment
from .options import PymunkOptions
from .read import MotionReading, forces_of, reading_of

_SINGULAR = 1e-10  # of the largest singular value: dependent constraints share their force


def inspect(mechanism: Mechanism, states: Sequence[State], options: PymunkOptions) -> Inspection:
    """Inspect the built assembly in each state.

    Raises:
        UnsupportedProblemError: the mechanism has a part that has no counterpart here.
        SimulationError: Chipmunk's impulses do not converge.
    """
    if options.joints == "documented":
        return _documented(mechanism, states, options)
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
    mass, forces = _inertia(assembly, _free_accelerations(assembly))
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


def _free_accelerations(assembly: Assembly) -> FloatArray:
    """Accelerations of the bodies where no joint holds them, by one step, (n_bodies, 3)."""
    springs = (constraints.DampedSpring, constraints.DampedRotarySpring)
    joints = [joint for joint in assembly.space.constraints if not isinstance(joint, springs)]
    if joints:
        assembly.space.remove(*joints)
    accelerations = settled_increment(assembly) / STEP
    if joints:
        assembly.space.add(*joints)
    return accelerations


def _inertia(assembly: Assembly, free_accelerations: FloatArray) -> tuple[FloatArray, FloatArray]:
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


# --- Chipmunk's documented elements.
#
# Their accelerations are not found by a step: limits and grooves have the wrong velocities after
# one. The attributes of the bodies and constraints that were built make the equations of motion of
# the bodies instead, M a = F + J^T lam with J a = g.


def _documented(
    mechanism: Mechanism, states: Sequence[State], options: PymunkOptions
) -> Inspection:
    dynamics: list[Dynamics] = []
    for state in states:
        placed = mechanism.model_copy(
            update={"start": tuple(state.q), "start_speeds": tuple(state.u)}
        )
        dynamics.append(_BodyEquations(build_documented(placed, options)).dynamics(state.closed))
    start, start_speeds, _ = reading_of(build_documented(mechanism, options).assembly).motion
    return Inspection(start=start[0], start_speeds=start_speeds[0], dynamics=tuple(dynamics))


class _BodyEquations:
    """Equations of motion of the bodies of a space, from what it is made of."""

    def __init__(self, made: DocumentedSpace) -> None:
        self.made, self.assembly = made, made.assembly
        bodies, gravity = self.assembly.bodies, self.assembly.space.gravity
        self.first = {body: 3 * k for k, body in enumerate(bodies)}
        self.mass = np.array([[body.mass, body.mass, body.moment] for body in bodies]).ravel()
        self.forces = self.mass * np.array([[*gravity, 0.0] for _ in bodies]).ravel()
        self.rows: list[FloatArray] = []
        self.targets: list[float] = []  # g of each row
        made.push([record.value for record in made.records])
        self.forces += np.array([[*body.force, body.torque] for body in bodies]).ravel()
        for joint in self.assembly.space.constraints:
            self.add(joint)

    def row(self, body: pymunk.Body, at: complex, along: complex) -> FloatArray:
        """Velocity of a body's point along a direction, by the velocities of all bodies."""
        row = np.zeros(len(self.mass))
        if body in self.first:
            arm, k = at - complex(*body.position), self.first[body]
            row[k : k + 3] = along.real, along.imag, (along.conjugate() * 1j * arm).real
        return row

    def turn(self, joint: constraints.Constraint, ratio: float = 1.0) -> FloatArray:
        """Angular velocity of b, times a ratio, less that of a."""
        row = np.zeros(len(self.mass))
        for body, share in ((joint.a, -1.0), (joint.b, ratio)):
            if body in self.first:
                row[self.first[body] + 2] += share
        return row

    def push(self, body: pymunk.Body, at: complex, force: complex) -> None:
        self.forces += abs(force) * self.row(body, at, force / abs(force)) if force else 0.0

    def hold(
        self, a: pymunk.Body, at_a: complex, b: pymunk.Body, at_b: complex, along: complex
    ) -> None:
        """Hold a component of the vector between two points, along a direction that turns with a.

        The point of a is one that moves with the body; if b's slides along it, it is the same.
        """
        arms = [at - complex(*body.position) for body, at in ((a, at_a), (b, at_b))]
        v_a, v_b = (
            complex(*body.velocity) + 1j * body.angular_velocity * arm
            for body, arm in zip((a, b), arms, strict=True)
        )
        centripetal = a.angular_velocity**2 * arms[0] - b.angular_velocity**2 * arms[1]
        coriolis = 2j * a.angular_velocity * (v_b - v_a)
        self.rows.append(self.row(b, at_b, along) - self.row(a, at_a, along))
        self.targets.append((along.conjugate() * (coriolis - centripetal)).real)

    def add(self, joint: constraints.Constraint) -> None:
        """Add the rows of a joint, or the forces of a spring; a limit is added where it is closed.

        Raises:
            TypeError: there is no such joint among the documented ones.
        """
        a, b = joint.a, joint.b
        match joint:
            case constraints.RotaryLimitJoint():
                pass
            case constraints.PivotJoint():
                at_a, at_b = _end(a, joint.anchor_a)[0], _end(b, joint.anchor_b)[0]
                for along in (1.0 + 0j, 1j):
                    self.hold(a, at_a, b, at_b, along)
            case constraints.GrooveJoint():
                at = _end(b, joint.anchor_b)[0]
                line = _end(a, joint.groove_b)[0] - _end(a, joint.groove_a)[0]
                self.hold(a, at, b, at, 1j * line / abs(line))
            case constraints.GearJoint():
                self.rows.append(self.turn(joint, joint.ratio))
                self.targets.append(0.0)
            case constraints.DampedSpring():
                (at_a, v_a, _), (at_b, v_b, _) = _end(a, joint.anchor_a), _end(b, joint.anchor_b)
                between, length = at_b - at_a, abs(at_b - at_a)
                along = between / length if length else 0j
                rate = (along.conjugate() * (v_b - v_a)).real
                pull = joint.stiffness * (length - joint.rest_length) + joint.damping * rate
                self.push(a, at_a, pull * along)
                self.push(b, at_b, -pull * along)
            case constraints.DampedRotarySpring():
                torque = spring_torque(joint, a.angle - b.angle)
                torque += joint.damping * (a.angular_velocity - b.angular_velocity)
                self.forces += torque * self.turn(joint)
            case _:
                raise TypeError(f"no element is built as a {type(joint).__name__}")

    def dynamics(self, closed: Sequence[str]) -> Dynamics:
        """The mechanism's equations, these stops held."""
        gaps: dict[str, float] = {}
        n_joints = len(self.rows)
        for name, limit in self.made.limits.items():
            angle, most = limit.b.angle - limit.a.angle, limit.max < math.inf
            gaps[name] = limit.max - angle if most else angle - limit.min
        for name, wall in self.made.walls.items():
            gaps[name] = _gap_and_normal(wall)[0]
        for name in closed:
            if name in self.made.limits:
                limit = self.made.limits[name]
                self.rows.append(self.turn(limit) * (-1.0 if limit.max < math.inf else 1.0))
                self.targets.append(0.0)
            else:
                wall = self.made.walls[name]
                at = _end(wall.body, wall.circle.offset)[0]
                self.hold(wall.base, at, wall.body, at, _gap_and_normal(wall)[1])
        free = self.forces / self.mass
        accelerations, multipliers = free, np.zeros(0)
        if self.rows:
            jacobian, roots = np.array(self.rows), np.sqrt(self.mass)
            inverse = np.linalg.pinv(jacobian / roots, rcond=_SINGULAR)
            increments = inverse @ (np.array(self.targets) - jacobian @ free)
            accelerations, multipliers = free + increments / roots, inverse.T @ increments
        mass, forces = _inertia(self.assembly, free.reshape(-1, 3))
        reading = reading_of(self.assembly, accelerations.reshape(-1, 3))
        centres: dict[str, FloatArray] = {}
        for body in self.assembly.mechanism.bodies:
            centres[body.name] = as_vectors(reading.point(body.name, body.centre)[0])[0]
        return Dynamics(
            accelerations=reading.motion[2][0],
            stop_torques=dict(zip(closed, multipliers[n_joints:].tolist(), strict=True)),
            mass_matrix=mass,
            forces=forces,
            centres=centres,
            stop_gaps=gaps,
        )


def _gap_and_normal(wall: StopShapes) -> tuple[float, complex]:
    """Gap between a point's circle and its wall [m], and the wall's normal towards the point."""
    at = _end(wall.body, wall.circle.offset)[0]
    start, end = (_end(wall.base, point)[0] for point in (wall.segment.a, wall.segment.b))
    normal = 1j * (end - start) / abs(end - start)
    distance = ((at - start) * normal.conjugate()).real
    radii = wall.circle.radius + wall.segment.radius
    return abs(distance) - radii, math.copysign(1.0, distance) * normal
