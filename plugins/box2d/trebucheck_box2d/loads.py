"""Springs, dampers, motors and constant forces, applied to Box2D's bodies before each step."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import AnyForceElement, ConstantForce, ConstantTorque, SpringDamper

PointMotion = Callable[[str, tuple[float, float]], tuple[FloatArray, FloatArray]]
"""Position and velocity of a body's point, by the body's name and the point in its frame."""
Turning = Callable[[str], tuple[float, float]]
"""Angle of a body and its speed, clockwise."""


def forces(
    element: AnyForceElement, point: PointMotion
) -> Iterator[tuple[str, FloatArray, FloatArray]]:
    """Forces of an element on bodies: body name, point and force in world axes."""
    if isinstance(element, ConstantForce):
        yield element.body, point(element.body, element.point)[0], np.array(element.force)
    if isinstance(element, SpringDamper):
        at, speed = point(element.body, element.point)
        other, other_speed = point(element.relative_to, element.relative_point)
        length = float(np.linalg.norm(at - other))
        along = (at - other) / length if length else np.zeros(2)
        rate = float(along @ (speed - other_speed))
        pull = element.stiffness * (length - element.rest_length) + element.damping * rate
        yield element.body, at, -pull * along
        yield element.relative_to, other, pull * along


def torques(element: AnyForceElement, turning: Turning) -> Iterator[tuple[str, float]]:
    """Torques of an element on bodies, clockwise [N m]."""
    if isinstance(element, ConstantForce | SpringDamper):
        return
    torque = element.torque if isinstance(element, ConstantTorque) else 0.0
    if not isinstance(element, ConstantTorque):
        (angle, speed), (other, other_speed) = turning(element.body), turning(element.relative_to)
        torque = -element.stiffness * (angle - other - element.rest_angle) - element.damping * (
            speed - other_speed
        )
    yield element.body, torque
    yield element.relative_to, -torque
