"""Forces in the members and at the ground: tension, compression, and wheels that would lift off.

A massless rod between a pin and a point mass (the sling, the hanger) is a two-force member: the
pin's force on it, taken along the rod, is its axial force. A rope in its place would be slack
wherever that is a compression.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from pydantic import Field
from scipy.optimize import brentq, minimize_scalar

from ...models.arrays import FloatArray
from ...models.elements import (
    GROUND,
    JOINTS,
    AnyJoint,
    ElementTable,
    FreeJoint,
    PinJoint,
    PrismaticJoint,
    SlotJoint,
    TranslationJoint,
    WeldJoint,
)
from ...models.errors import InputError
from ...models.mechanism import Body, Mechanism
from ...models.spec import Real, Spec, Vector
from ..solution import Solution

_SCAN = 1500  # samples between which a force changes its sign at most once: 2 ms apart on Table I
_UPRIGHT = 1e-9  # [rad] a slot nearer to upright than this carries nothing: rounding of its axis
_ROUNDING = 1e-9  # of the largest force: a smaller compression is rounding of a force that is zero
Interval = tuple[Real, Real]  # From, to [s]


class MemberForce(Spec):
    """Axial force of a body over a motion; tension is positive, compression negative."""

    name: str
    joint: str = Field(
        description="the joint whose force is taken along the line from it to the centre of mass"
    )
    two_force: bool = Field(
        description="a massless rod with nothing hung on it but at its ends; otherwise the force "
        "is its end's only"
    )
    peak_tension: Real = Field(description="largest [N]; negative if it is always in compression")
    peak_tension_time: Real = Field(description="[s]")
    peak_compression: Real = Field(description="least [N]; positive if it is always in tension")
    peak_compression_time: Real = Field(description="[s]")
    compressed: tuple[Interval, ...] = Field(description="when a rope would be slack there [s]")


class SupportForce(Spec):
    """Force of the ground on the machine over a motion."""

    joint: str
    rolls: bool = Field(
        description="a slot that carries the machine: wheels without mass that can only push"
    )
    peak: Real = Field(description="largest magnitude [N]")
    peak_time: Real = Field(description="[s]")
    peak_direction: Real = Field(description="of the largest, from +x, above the horizontal [rad]")
    least: Real | None = Field(
        description="least upward part (a slot: normal to it) [N]; negative pulls the machine "
        "down; None: an upright slot, which guides and carries nothing"
    )
    least_time: Real | None = Field(description="[s]")
    pulls_down: tuple[Interval, ...] = Field(
        description="when wheels would lift off, or a frame must be anchored [s]"
    )


@dataclass(frozen=True)
class Member:
    """A body whose axial force is computed."""

    body: Body
    joint: AnyJoint
    two_force: bool


def members(mechanism: Mechanism) -> tuple[Member, ...]:
    """Massless rods and other bodies whose parent is not the ground."""
    selected: list[Member] = []
    for body, joint in zip(mechanism.bodies, mechanism.tree_joints, strict=True):
        rod = body.inertia == 0 or joint.parent != GROUND
        if not rod or not joint.held_directions or body.centre == joint.child_point:
            continue
        pulled = any(body.name in element.bodies for element in mechanism.force_elements)
        two_force = body.inertia == 0 and not pulled
        for other in mechanism.joints:
            sides = (other.parent, other.parent_point), (other.child, other.child_point)
            for name, point in sides:
                if name == body.name:
                    at_end = point in (joint.child_point, body.centre)
                    two_force = two_force and at_end and not other.holds_angle
        selected.append(Member(body, joint, two_force))
    return tuple(selected)


def axial_force(solution: Solution, member: Member, t: FloatArray) -> FloatArray:
    """Tension (positive) or compression of a member [N], shape (n,)."""
    kinematics, motion = solution.equations.kinematics, solution.motion(t)
    pin = kinematics.point(member.body.name, member.joint.child_point)
    centre = kinematics.point(member.body.name, member.body.centre)
    along = kinematics.position(centre, motion.q) - kinematics.position(pin, motion.q)
    along /= math.dist(member.joint.child_point, member.body.centre)
    return -np.sum(solution.joint_reactions(motion)[member.joint.name] * along, axis=1)


def member_forces(solution: Solution, until: float) -> tuple[MemberForce, ...]:
    """Axial forces of all members from the start until a time within the motion [s]."""
    times = _times(solution, until)
    forces: list[MemberForce] = []
    for member in members(solution.problem.mechanism):
        tension = partial(axial_force, solution, member)
        most_time, most = _extreme(tension, times, 1)
        least_time, least = _extreme(tension, times, -1)
        force = MemberForce(
            name=member.body.name,
            joint=member.joint.name,
            two_force=member.two_force,
            peak_tension=most,
            peak_tension_time=most_time,
            peak_compression=least,
            peak_compression_time=least_time,
            compressed=negative_intervals(tension, times),
        )
        forces.append(force)
    return tuple(forces)


def supports(mechanism: Mechanism) -> tuple[AnyJoint, ...]:
    """Joints on the ground that hold something there: not those of free bodies."""
    return tuple(
        joint for joint in mechanism.joints if joint.parent == GROUND and joint.held_directions
    )


def carries(joint: AnyJoint) -> bool:
    """Tell whether a joint on the ground can bear weight; an upright slot only guides."""
    return any(abs(direction.imag) > _UPRIGHT for direction in joint.held_directions)


def upward_force(solution: Solution, joint: AnyJoint, t: FloatArray) -> FloatArray:
    """Upward force of the ground [N], shape (n,): of a slot normal to it, away from the ground.

    Args:
        joint: one that :func:`carries`.
    """
    up = np.array(_UPWARDS[joint](joint))
    return solution.joint_reactions(solution.motion(t))[joint.name] @ up


def _vertical(joint: AnyJoint) -> Vector:
    return (0.0, 1.0)


def _normal_to_slot(joint: SlotJoint) -> Vector:
    x, y = joint.axis
    return (-y, x) if x > 0 else (y, -x)


_UPWARDS: ElementTable[Callable[[Any], Vector]] = ElementTable(
    "The table of forces at the ground",
    JOINTS,
    {
        PinJoint: _vertical,
        WeldJoint: _vertical,
        PrismaticJoint: _vertical,
        SlotJoint: _normal_to_slot,
    },
    {FreeJoint: "it holds nothing", TranslationJoint: "it holds no force"},
)


def support_forces(solution: Solution, until: float) -> tuple[SupportForce, ...]:
    """Forces of the ground from the start until a time within the motion [s]."""
    times = _times(solution, until)
    forces: list[SupportForce] = []
    for joint in supports(solution.problem.mechanism):

        def size(t: FloatArray, name: str = joint.name) -> FloatArray:
            return np.hypot(*solution.joint_reactions(solution.motion(t))[name].T)

        peak_time, peak = _extreme(size, times, 1)
        peak_motion = solution.motion(np.array([peak_time]))
        x, y = solution.joint_reactions(peak_motion)[joint.name][0]
        upward = partial(upward_force, solution, joint)
        least_time, least = _extreme(upward, times, -1) if carries(joint) else (None, None)
        force = SupportForce(
            joint=joint.name,
            rolls=_UPWARDS[joint] is _normal_to_slot and carries(joint),
            peak=peak,
            peak_time=peak_time,
            peak_direction=math.atan2(y, x),
            least=least,
            least_time=least_time,
            pulls_down=negative_intervals(upward, times, peak) if carries(joint) else (),
        )
        forces.append(force)
    return tuple(forces)


def _times(solution: Solution, until: float) -> FloatArray:
    end = solution.segments[-1].end
    if not 0 <= until <= end:
        raise InputError(f"until = {until!r} s must lie within the motion, from 0 to {end:.6g} s.")
    events = [segment.end for segment in solution.segments if segment.end < until]
    return np.unique(np.concatenate([np.linspace(0.0, until, _SCAN), events]))


def _extreme(
    value: Callable[[FloatArray], FloatArray], times: FloatArray, sign: int
) -> tuple[float, float]:
    """Time and size of the largest value (or the least, of sign -1).

    It is the largest sample, refined between its neighbours.
    """
    samples = sign * value(times)
    i = int(np.argmax(samples))
    low, high = float(times[max(i - 1, 0)]), float(times[min(i + 1, len(times) - 1)])
    sample = float(times[i]), float(samples[i])
    if low < high:
        optimum: Any = minimize_scalar(
            lambda t: -sign * float(value(np.array([t]))[0]),
            bounds=(low, high),
            method="bounded",
            options={"xatol": 1e-10},
        )
        if -float(optimum.fun) > sample[1]:
            sample = float(optimum.x), -float(optimum.fun)
    return sample[0], sign * sample[1]


def negative_intervals(
    value: Callable[[FloatArray], FloatArray], times: FloatArray, size: float = 0.0
) -> tuple[Interval, ...]:
    """Intervals in which a value is negative, between its roots, or the first or last time [s].

    Args:
        value: continuous but for jumps at impacts, which are located as well.
        times: samples [s], shape (n,), that no two roots lie between.
        size: of what the value is a part of, which rounds it; its own largest if that is larger.
    """
    samples = value(times)
    negative = samples < 0
    deep = -_ROUNDING * float(np.max(np.abs(samples), initial=size))
    if np.min(samples, initial=0.0) >= deep:
        return ()  # and no roots are sought in noise
    if len(samples) > 1 and abs(samples[0]) <= -deep:  # starts from zero: it is what it becomes
        negative[0] = negative[1]
    turns = np.flatnonzero(negative[1:] != negative[:-1])
    edges = [float(times[0])] if negative[0] else []
    for i in turns:
        low, high = float(times[i]), float(times[i + 1])
        root = brentq(lambda t: float(value(np.array([t]))[0]), low, high, xtol=1e-14, rtol=1e-14)
        edges.append(float(root))
    if negative[-1]:
        edges.append(float(times[-1]))
    intervals: list[Interval] = []
    for start, end in list(pairwise(edges))[::2]:
        inside = samples[(times >= start) & (times <= end)]
        if np.min(inside, initial=0.0) < deep:
            intervals.append((start, end))
    return tuple(intervals)
