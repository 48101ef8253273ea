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
from ...models.mechanism import Mechanism
from ..events import Contacts
from .read import MotionReading

_SINGULAR = 1e-10  # of the largest singular value: dependent constraints share their force


@dataclass(frozen=True)
class ConstraintForces:
    """Forces of joints and stops at the samples."""

    reactions: Mapping[str, ComplexArray]
    """Force of each joint on its child [N], complex, shape (n,)."""
    torques: Mapping[str, FloatArray]
    """Torque of each active stop [N m, or N for one on a point], shape (n,)."""


def forces_of(reading: MotionReading, active: Contacts) -> ConstraintForces:
    """Forces of all joints and of the active stops."""
    mechanism, needed = reading.mechanism, _needed(reading)
    points = [stop for stop in mechanism.point_stops if stop.name in active]
    turn_together = any(joint.holds_angle for joint in mechanism.tree_joints)
    # A stop's torque is known from the body farther out, but not those of two stops from one body.
    outer = {_outer(mechanism, stop) for stop in mechanism.angle_stops if stop.name in active}
    one_by_one = not (points or turn_together) and len(outer) == len(active)
    if not mechanism.loop_joints and (not active or one_by_one):
        reactions = _tree_reactions(mechanism, needed)
        return ConstraintForces(reactions, _angle_torques(reading, reactions, active))
    multipliers = _multipliers(reading, needed, active)
    loops = _loop_forces(reading, multipliers)
    torques = dict(zip(active, multipliers.T[multipliers.shape[1] - len(active) :], strict=True))
    for joint in mechanism.loop_joints:
        _act(needed, joint.child, -loops[joint.name])
        _act(needed, joint.parent, loops[joint.name])
    for stop in points:
        push = reading.frames[stop.relative_to].world(complex(*stop.normal)) * torques[stop.name]
        _act(needed, stop.body, -push)
        _act(needed, stop.relative_to, push)
    return ConstraintForces(_tree_reactions(mechanism, needed) | loops, torques)


def _needed(reading: MotionReading) -> dict[str, ComplexArray]:
    """Force that each body's momentum needs beyond gravity and force elements [N]."""
    mechanism, needed = reading.mechanism, dict[str, ComplexArray]()
    weight = complex(*mechanism.gravity_vector)
    for body in mechanism.bodies:
        centre = reading.point(body.name, body.centre)
        needed[body.name] = body.mass * (centre.acceleration - weight)
    if mechanism.force_elements:
        for name, force in reading.applied_on_bodies.items():
            _act(needed, name, -force)
    return needed


def _act(needed: dict[str, ComplexArray], body: str, force: ComplexArray) -> None:
    if body != GROUND:
        needed[body] = needed[body] + force


def _tree_reactions(
    mechanism: Mechanism, needed: Mapping[str, ComplexArray]
) -> dict[str, ComplexArray]:
    forces: dict[str, ComplexArray] = {}
    for joint in mechanism.tree_joints:
        force = np.zeros_like(needed[joint.child])
        for body in mechanism.subtree(joint.child):
            force += needed[body.name]
        forces[joint.name] = force
    return forces


def _angle_torques(
    reading: MotionReading, reactions: Mapping[str, ComplexArray], active: Contacts
) -> dict[str, FloatArray]:
    """Torques of active stops on angles, if all joints are of the tree."""
    if not active:
        return {}
    by_name = {stop.name: stop for stop in reading.mechanism.angle_stops}
    stops = [by_name[name] for name in active]
    outer = sorted({_outer(reading.mechanism, stop) for stop in stops})
    names = [body.name for body in reading.mechanism.bodies]
    couples = [_couple(reading, names[i], reactions) for i in outer]
    if reading.mechanism.force_elements:
        couples = [
            couple - reading.applied_couples[:, i] for i, couple in zip(outer, couples, strict=True)
        ]
    rows = np.array([[_share(stop, names[i]) for i in outer] for stop in stops])
    # The large forces nearer to the ground do not enter the equation of a stop's outer body.
    solved = np.linalg.lstsq(rows.T, np.array(couples), rcond=None)[0]
    return dict(zip(active, solved, strict=True))


def _outer(mechanism: Mechanism, stop: Stop) -> int:
    names = [body.name for body in mechanism.bodies]
    return max(names.index(name) for name in (stop.body, stop.relative_to) if name != GROUND)


def _share(stop: Stop, body: str) -> float:
    """Derivative of the stop's gap by the body's angle."""
    return float(stop.sense * ((body == stop.body) - (body == stop.relative_to)))


def _couple(reading: MotionReading, name: str, reactions: Mapping[str, ComplexArray]) -> FloatArray:
    """Clockwise couple that acts on a body besides gravity and the tree's forces [N m]."""
    body, frame = reading.mechanism.body(name), reading.frames[name]
    centre = reading.point(name, body.centre).position
    couple = body.inertia * frame.a
    for joint in reading.mechanism.tree_joints:
        if joint.child == name:
            couple = couple + _cross(
                reading.point(name, joint.child_point).position - centre, reactions[joint.name]
            )
        elif joint.parent == name:
            at = (name, joint.parent_point)
            if joint.free_directions:  # a child that slides pushes where it is
                at = (joint.child, joint.child_point)
            couple = couple - _cross(reading.point(*at).position - centre, reactions[joint.name])
    return couple


def _multipliers(
    reading: MotionReading, needed: Mapping[str, ComplexArray], active: Contacts
) -> FloatArray:
    """Multipliers of the loop joints' components, then of the active stops, (n, n_constraints).

    Errors of r are those of accelerations times the mass matrix M, so the inverse of M is their
    weight: the equation of a light body determines a small force better than that of a heavy one
    nearer to the ground.
    """
    kinematics = Kinematics(reading.mechanism)
    q = reading.coordinates()[0]
    rows = _rows(kinematics, q, active)
    root = np.linalg.cholesky(mass_matrix(kinematics, q))
    columns = np.linalg.solve(root, np.swapaxes(rows, 1, 2))
    missing = np.linalg.solve(root, _missing(reading, needed)[..., None])
    return np.asarray(
        (np.linalg.pinv(columns, rcond=_SINGULAR) @ missing)[..., 0], dtype=np.float64
    )


def _missing(reading: MotionReading, needed: Mapping[str, ComplexArray]) -> FloatArray:
    """r, shape (n, n_q): the generalized forces that no joint of the tree exerts [N m or N]."""
    mechanism = reading.mechanism
    reactions = _tree_reactions(mechanism, needed)
    missing = np.zeros((reading.samples.points.shape[1], len(mechanism.coordinates)))
    for body in mechanism.bodies:
        index, _ = mechanism.attitudes[body.name]
        if index is not None:
            missing[:, index] += _couple(reading, body.name, reactions)
    if mechanism.force_elements:
        missing[:, : len(mechanism.angles)] -= reading.applied_couples
    for k, slide in enumerate(mechanism.slides, start=len(mechanism.angles)):
        along = reading.frames[slide.joint.parent].world(slide.direction)
        missing[:, k] = (reactions[slide.joint.name] * along.conjugate()).real
    return missing


def _rows(kinematics: Kinematics, q: FloatArray, active: Contacts) -> FloatArray:
    """G: Jacobian of loop joints' and active stops' gaps, shape (n, n_constraints, n_q)."""
    rows = list(np.moveaxis(kinematics.loop_jacobian(q), -2, 0))
    rows += [kinematics.gap_jacobian(name, q) for name in active]
    return np.stack(rows, axis=-2)


def mass_matrix(kinematics: Kinematics, q: FloatArray) -> FloatArray:
    """M(q), shape (n, n_q, n_q)."""
    jacobian = kinematics.gradient(
        kinematics.centres, q[:, None, :], kinematics.rates(q)[:, None, :]
    )
    products = (np.swapaxes(jacobian.conj(), 1, 2) * kinematics.masses) @ jacobian
    return products.real + np.diag(kinematics.inertias)


def _loop_forces(reading: MotionReading, multipliers: FloatArray) -> dict[str, ComplexArray]:
    """Force of each loop joint on its child [N]."""
    forces: dict[str, ComplexArray] = {}
    columns = iter(multipliers.T)
    for joint in reading.mechanism.loop_joints:
        frame = reading.frames[joint.parent if joint.free_directions else GROUND]
        held = [next(columns) * frame.world(direction) for direction in joint.held_directions]
        forces[joint.name] = np.sum(held, axis=0)
        if joint.holds_angle:
            next(columns)  # a couple
    return forces


def _cross(arm: ComplexArray, force: ComplexArray) -> FloatArray:
    """Moment, counter-clockwise."""
    return (arm.conjugate() * force).imag
