"""Forces of joints and stops, from the motion of Chipmunk's bodies.

They come from the bodies' changes of momentum in a step, because Chipmunk gives only the magnitude
of a joint's impulse: constraint forces are the rates of change of momentum and angular momentum,
less gravity and what the force elements exert. A joint of the tree carries all bodies that it
supports; the forces of joints that close a loop and of active stops are the least-squares solution
of G^T lam = r, with the residual r of the equations of motion without them:

    r_k = for an angle, the couple on the bodies that turn with it beyond gravity, force elements
          and the tree's forces; for a slide, the force along it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...models.arrays import ComplexArray, FloatArray
from ...models.elements import GROUND, Stop
from ...models.kinematics import Kinematics
from ..events import Contacts
from ..impact import mass_matrix
from .read import MotionReading

_SINGULAR = 1e-10  # of the largest singular value: dependent constraints share their force
_Forces = dict[str, ComplexArray]


@dataclass(frozen=True)
class ConstraintForces:
    """Forces of joints and stops at the samples."""

    reactions: Mapping[str, ComplexArray]
    """Force of each joint on its child [N], complex, shape (n,)."""
    torques: Mapping[str, FloatArray]
    """Torque of each active stop [N m, or N for one on a point], shape (n,)."""


def forces_of(reading: MotionReading, active: Contacts) -> ConstraintForces:
    """Forces of all joints and of the active stops."""
    mechanism = reading.mechanism
    # The force that each body's momentum needs beyond gravity and force elements [N].
    needed: _Forces = {}
    weight = complex(*mechanism.gravity_vector)
    for body in mechanism.bodies:
        centre = reading.point(body.name, body.centre)
        needed[body.name] = body.mass * (centre.acceleration - weight)
    if mechanism.force_elements:
        for name, force in reading.applied_on_bodies.items():
            _act(needed, name, -force)

    points = [stop for stop in mechanism.point_stops if stop.name in active]
    turn_together = any(joint.holds_angle for joint in mechanism.tree_joints)
    # A stop's torque is known from the body farther out, but not those of two stops from one body.
    outer = {_outer(reading, stop) for stop in mechanism.angle_stops if stop.name in active}
    one_by_one = not (points or turn_together) and len(outer) == len(active)
    if not mechanism.loop_joints and (not active or one_by_one):
        reactions = _tree_reactions(reading, needed)
        return ConstraintForces(reactions, _angle_torques(reading, reactions, active))

    multipliers = iter(_multipliers(reading, needed, active).T)
    loops: _Forces = {}
    for joint in mechanism.loop_joints:
        frame = reading.frames[joint.parent if joint.free_directions else GROUND]
        held = [next(multipliers) * frame.world(along) for along in joint.held_directions]
        force = loops[joint.name] = np.sum(held, axis=0)
        if joint.holds_angle:
            next(multipliers)  # a couple
        _act(needed, joint.child, -force)
        _act(needed, joint.parent, force)
    torques = dict(zip(active, multipliers, strict=True))
    for stop in points:
        push = reading.frames[stop.relative_to].world(complex(*stop.normal)) * torques[stop.name]
        _act(needed, stop.body, -push)
        _act(needed, stop.relative_to, push)
    return ConstraintForces(_tree_reactions(reading, needed) | loops, torques)


def _act(needed: _Forces, body: str, force: ComplexArray) -> None:
    if body != GROUND:
        needed[body] = needed[body] + force


def _tree_reactions(reading: MotionReading, needed: _Forces) -> _Forces:
    """Force of each joint of the tree on its child [N]."""
    forces: _Forces = {}
    for joint in reading.mechanism.tree_joints:
        force = np.zeros_like(needed[joint.child])
        for body in reading.mechanism.subtree(joint.child):
            force += needed[body.name]
        forces[joint.name] = force
    return forces


def _outer(reading: MotionReading, stop: Stop) -> int:
    """Index of the stop's body that is farther out in the tree."""
    names = [body.name for body in reading.mechanism.bodies]
    return max(names.index(name) for name in (stop.body, stop.relative_to) if name != GROUND)


def _angle_torques(
    reading: MotionReading, reactions: _Forces, active: Contacts
) -> dict[str, FloatArray]:
    """Torques of active stops on angles, if all joints are of the tree.

    The large forces nearer to the ground do not enter the equation of a stop's outer body.
    """
    if not active:
        return {}
    mechanism = reading.mechanism
    by_name = {stop.name: stop for stop in mechanism.angle_stops}
    stops = [by_name[name] for name in active]
    couples: list[FloatArray] = []
    columns: list[list[float]] = []  # derivatives of the stops' gaps by the body's angle
    for i in sorted({_outer(reading, stop) for stop in stops}):
        name = mechanism.bodies[i].name
        couple = _couple(reading, name, reactions)
        if mechanism.force_elements:
            couple = couple - reading.applied_couples[:, i]
        couples.append(couple)
        columns.append(
            [float(s.sense * ((name == s.body) - (name == s.relative_to))) for s in stops]
        )
    solved = np.linalg.lstsq(np.array(columns), np.array(couples), rcond=None)[0]
    return dict(zip(active, solved, strict=True))


def _couple(reading: MotionReading, name: str, reactions: _Forces) -> FloatArray:
    """Clockwise couple that acts on a body besides gravity and the tree's forces [N m]."""
    body, frame = reading.mechanism.body(name), reading.frames[name]
    centre = reading.point(name, body.centre).position
    couple = body.inertia * frame.a
    for joint in reading.mechanism.tree_joints:
        if joint.child == name:
            arm = reading.point(name, joint.child_point).position - centre
            couple = couple + (arm.conjugate() * reactions[joint.name]).imag
        elif joint.parent == name:
            at = (name, joint.parent_point)
            if joint.free_directions:  # a child that slides pushes where it is
                at = (joint.child, joint.child_point)
            arm = reading.point(*at).position - centre
            couple = couple - (arm.conjugate() * reactions[joint.name]).imag
    return couple


def _multipliers(reading: MotionReading, needed: _Forces, active: Contacts) -> FloatArray:
    """Multipliers of the loop joints' components, then of the active stops, (n, n_constraints).

    Errors of r are those of accelerations times the mass matrix M, so the inverse of M is their
    weight: the equation of a light body determines a small force better than that of a heavy one
    nearer to the ground.
    """
    mechanism, kinematics = reading.mechanism, Kinematics(reading.mechanism)
    q = reading.motion[0]
    # r: the generalized forces that no joint of the tree exerts [N m or N].
    reactions = _tree_reactions(reading, needed)
    residual = np.zeros(q.shape)
    for body in mechanism.bodies:
        index, _ = mechanism.attitudes[body.name]
        if index is not None:
            residual[:, index] += _couple(reading, body.name, reactions)
    if mechanism.force_elements:
        residual[:, : len(mechanism.angles)] -= reading.applied_couples
    for k, slide in enumerate(mechanism.slides, start=len(mechanism.angles)):
        along = reading.frames[slide.joint.parent].world(slide.direction)
        residual[:, k] = (reactions[slide.joint.name] * along.conjugate()).real
    # G: Jacobian of the loop joints' and active stops' gaps, shape (n, n_constraints, n_q).
    rows = list(np.moveaxis(kinematics.loop_jacobian(q), -2, 0))
    rows += [kinematics.gap_jacobian(name, q) for name in active]
    root = np.linalg.cholesky(mass_matrix(kinematics, q))
    columns = np.linalg.solve(root, np.swapaxes(np.stack(rows, axis=-2), 1, 2))
    weighted = np.linalg.solve(root, residual[..., None])
    solution = np.linalg.pinv(columns, rcond=_SINGULAR) @ weighted
    return np.asarray(solution[..., 0], dtype=np.float64)
