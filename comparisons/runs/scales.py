"""Scales of a compared motion: differences are measured in parts of them, without units.

Positions are parts of the longest way of a point, angles of the largest turn, times of the
characteristic time, speeds and forces of the largest ones of the reference, energies of what the
motion exchanges: an energy has an arbitrary zero, its change has none. Each scale has a least
value, so that a mechanism at rest, or a joint without load, can be judged as well.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from pydantic import Field, model_validator

from ...models.applied_forces import AppliedForces
from ...models.arrays import BoolArray, FloatArray
from ...models.elements import (
    GROUND,
    AnyForceElement,
    FreeJoint,
    refuse_unknown,
)
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Body, Mechanism
from ...models.spec import NonNegative, Positive, Spec
from ...models.trajectory import Trajectory

if TYPE_CHECKING:  # it imports SciPy's integrators, which processes that throw machines do without
    from ...reference.solution import Solution

# Growth of small errors beyond which nothing is judged but invariants and when motions first part.
# A hundred-thousandth of a body's inertia, less than any is known to, then moves something by the
# default tolerance.
LIMIT = 100.0
_SAMPLES = 801
_LONGEST = 10.0  # characteristic time in parts of the end, for motions that hardly move
_LEAST = 1e-6  # speed and force in parts of those that gravity gives: a swing of 0.001 degrees
# The same, times the least singular value of the constraints, with lengths in parts of the size. A
# position that constraints hold is known to four roundings of the size over that value. In a step
# of 1e-4 of the characteristic time, the shortest that is usual, this makes 1e-11 of the speed that
# gravity gives, which is a thousandth of this least speed: what is judged by default. A wall that
# is nearly parallel to the motion that it stops has such small values.
_LEAST_HELD = 1e-8
_DEPENDENT = 1e-6  # of constraints with a smaller singular value some follow from the others
_IN_A_SEGMENT = 9  # positions in which they are computed
_BESIDE = 0.1  # characteristic times
_SHORTEST = 1e-9  # characteristic times: an end before that has no speed of its own
_LEAST_ENERGY = 1e-9  # of the sum of energies: a thousandth of it is well above rounding
_LEAST_TORQUE = 1e-3  # of the largest force times the size: of a stop that never pushes


class Scales(Spec):
    """Scales of one mechanism and its reference motion, up to the end of the comparison."""

    # The farthest way along a slide on the ground, or the greatest length of a spring on a free
    # body, if that is longer
    length: Positive = Field(description="sum of lengths of bodies and of slides on bodies [m]")
    angle: Positive = Field(default=1.0, description="[rad]")
    way: Positive = Field(
        description="longest of any marker, centre of mass and slide: diagonal of the rectangle "
        "around its path [m]"
    )
    turn: Positive = Field(description="largest of any angle, or way over length if more [rad]")
    time: Positive = Field(
        description="characteristic time: least of length over speed, sqrt(length / gravity), "
        "sqrt(mass / stiffness) of each spring and ten times the end [s]"
    )
    speed: Positive = Field(description="largest of any centre of mass or marker [m/s]")
    angular_speed: Positive = Field(
        description="largest of any body, or speed over length if more [rad/s]"
    )
    mass: Positive = Field(description="of all bodies [kg]")
    force: Positive = Field(description="largest of any joint, point stop, or body's springs [N]")
    torques: dict[str, Positive] = Field(description="largest of each stop [N m, N on a point]")
    energy: Positive = Field(description="largest kinetic, plus change of potential [J]")
    largest_energy: NonNegative = Field(description="largest energies, whatever their zero [J]")

    @model_validator(mode="before")
    @classmethod
    def _read_earlier(cls, fields: Any) -> Any:
        """Take a file of a release whose positions and angles were parts of length and angle."""
        if not isinstance(fields, Mapping):
            return fields
        given = dict(cast("Mapping[str, Any]", fields))
        earlier = {"way": given.get("length"), "turn": given.get("angle", 1.0)}
        return {**earlier, **given}


def size(mechanism: Mechanism) -> float:
    """Sum of the bodies' lengths [m], each as :func:`extent`."""
    return sum(extent(mechanism, body) for body in mechanism.bodies)


def extent(mechanism: Mechanism, body: Body) -> float:
    """Length of a body [m]: from its joint to its farthest point, or its radius of gyration."""
    pivot = mechanism.joint_of(body.name).child_point
    points = [body.centre, *(m.point for m in mechanism.markers if m.body == body.name)]
    points += [j.parent_point for j in mechanism.joints if j.parent == body.name]
    points += [j.child_point for j in mechanism.joints if j.child == body.name]
    points += [s.point for s in mechanism.point_stops if s.body == body.name]
    ends = [end for element in mechanism.force_elements for end in element.ends]
    points += [point for name, point in ends if name == body.name]
    return max(math.sqrt(body.inertia / body.mass), *(math.dist(pivot, point) for point in points))


def scales_until(solution: Solution, end: float) -> Scales:
    """Scales of a reference motion up to the end of the comparison [s]."""
    reference = solution.trajectory(np.linspace(0.0, end, _SAMPLES))
    mechanism = reference.mechanism
    mass, gravity = sum(body.mass for body in mechanism.bodies), mechanism.gravity
    length = _length(reference)
    natural = math.sqrt(length / gravity) if gravity else math.inf
    end = max(end, _SHORTEST * (natural if gravity else 1.0))
    # Of a motion that hardly moves the speed is the least that can be judged.
    usual, speed = max(math.sqrt(gravity * length), length / end), _largest_speed(reference)
    least = _LEAST * usual
    if speed < _LEAST_HELD / _DEPENDENT * usual:
        least = max(least, _LEAST_HELD / _independence(solution, end, length) * usual)
    speed = max(speed, least)
    turn = float(np.abs(reference.u[:, : len(mechanism.angles)]).max(initial=0.0))
    times = [length / speed, _LONGEST * end, natural]
    refuse_unknown("The characteristic time", mechanism.force_elements)
    times += [_spring_time(mechanism, element) for element in mechanism.force_elements]
    away = away_from_poles(solution, reference.t, min(times))
    force = max(_largest_force(reference, away), _LEAST * mass * max(gravity, speed**2 / length))
    torques: dict[str, float] = {}
    for name, torque in reference.stop_torques.items():
        arm = length if mechanism.stop(name).effort == "torque" else 1.0
        torques[name] = max(_largest(torque[away]), _LEAST_TORQUE * force * arm)
    kinetic, potential = reference.kinetic_energy, reference.potential_energy
    energies = float(np.abs(kinetic).max() + np.abs(potential).max() + mass * gravity * length)
    exchanged = float(kinetic.max()) + float(np.ptp(potential))
    way = max(_way(reference), _LEAST * length)
    turned = np.ptp(reference.q[:, : len(mechanism.angles)], axis=0).max(initial=0.0)
    return Scales(
        length=length,
        way=way,
        turn=max(float(turned), way / length),
        time=min(times),
        speed=speed,
        angular_speed=max(turn, speed / length),
        mass=mass,
        force=force,
        torques=torques,
        energy=max(exchanged, _LEAST_ENERGY * energies, 0.5 * mass * least**2),
        largest_energy=energies,
    )


def _independence(solution: Solution, end: float, length: float) -> float:
    """Least singular value of the constraints where they are the most independent of each other."""
    values: list[float] = []
    for segment in solution.segments:
        t = np.linspace(segment.start, max(segment.start, min(segment.end, end)), _IN_A_SEGMENT)
        q = solution.motion(t).q
        if segment.start <= end:
            values.append(float(solution.equations.independence(q, segment.closed, length).max()))
    return max(_DEPENDENT, max(values, default=math.inf))


def away_from_poles(solution: Solution, t: FloatArray, time: float) -> BoolArray:
    """Times that are not beside a singular position, where forces grow beyond all bounds.

    `time` is the characteristic time [s].
    """
    away = np.ones(len(t), dtype=bool)
    for passage in solution.singular_passages:
        away &= np.abs(t - passage.time) > _BESIDE * time
    return away


def _length(reference: Trajectory) -> float:
    """Length scale: bodies and slides on them, or slides on the ground, or springs if longer."""
    mechanism, kinematics = reference.mechanism, reference.kinematics
    places = reference.q[:, len(mechanism.angles) :]
    ways, arms = np.ptp(places, axis=0), np.abs(places).max(axis=0)
    free = np.array([isinstance(slide.joint, FreeJoint) for slide in mechanism.slides], dtype=bool)
    moving = np.array([slide.joint.parent != GROUND for slide in mechanism.slides], dtype=bool)
    lengths = [size(mechanism) + float(arms[moving].sum())]
    lengths.append(float(ways[~free & ~moving].max(initial=0.0)))
    # Greatest length of each spring on a free body
    floating = {joint.child for joint in mechanism.tree_joints if isinstance(joint, FreeJoint)}
    for element in mechanism.force_elements:
        if element.ends and floating.intersection(element.bodies):
            (body, point), (other, other_point) = element.ends
            between = kinematics.between(body, point, other, other_point)
            lengths.append(_largest(kinematics.position(between, reference.q)))
    return max(lengths) or float(ways.max(initial=0.0)) or 1.0


def _way(reference: Trajectory) -> float:
    """Longest way of any marker, centre of mass or slide [m]."""
    kinematics, mechanism = reference.kinematics, reference.mechanism
    paths = [marker.position for marker in reference.markers.values()]
    for body in mechanism.bodies:
        centre = kinematics.point(body.name, body.centre)
        paths.append(kinematics.position(centre, reference.q))
    ways = [float(np.linalg.norm(np.ptp(path, axis=0))) for path in paths]
    slides = np.ptp(reference.q[:, len(mechanism.angles) :], axis=0)
    return max(*ways, float(slides.max(initial=0.0)))


def _spring_time(mechanism: Mechanism, element: AnyForceElement) -> float:
    """sqrt(inertia / stiffness) of the lightest body at a spring [s]; infinite without one."""
    kinematics, (start, _) = Kinematics(mechanism), initial_state(mechanism)
    stiffness = element.stiffness_at(kinematics, start)
    bodies = [mechanism.body(name) for name in element.bodies if name != GROUND]
    if element.acts_along == "angle":
        inertia = min(body.mass * extent(mechanism, body) ** 2 + body.inertia for body in bodies)
    else:
        inertia = min(body.mass for body in bodies)
    return math.sqrt(inertia / stiffness) if inertia > 0 and stiffness > 0 else math.inf


def _largest_speed(reference: Trajectory) -> float:
    """Largest speed of any centre of mass or marker [m/s]."""
    kinematics = reference.kinematics
    rows = [kinematics.point(body.name, body.centre) for body in reference.mechanism.bodies]
    velocities = [kinematics.velocity(row, reference.q, reference.u) for row in rows]
    velocities += [marker.velocity for marker in reference.markers.values()]
    return max(map(_largest, velocities))


def _largest_force(reference: Trajectory, away: BoolArray) -> float:
    """Largest force of any joint, of a stop on a point, or of force elements on a body [N]."""
    forces = [force[away] for force in reference.joint_reactions.values()]
    for i, acting in AppliedForces(reference.kinematics).at_times(reference.t):
        forces += acting.on_bodies(reference.q[i], reference.u[i]).values()
    forces += [reference.stop_torques[s.name][away] for s in reference.mechanism.point_stops]
    return max(map(_largest, forces), default=0.0)


def _largest(values: FloatArray) -> float:
    """Largest magnitude; of vectors along a second axis the largest length."""
    magnitudes = np.abs(values) if values.ndim == 1 else np.linalg.norm(values, axis=-1)
    return float(magnitudes.max(initial=0.0))
