"""Mechanisms and joints that several models of the zoo are made of."""

from __future__ import annotations

from typing import Any

from trebucheck.api.mechanics import (
    GROUND,
    AnyForceElement,
    AnyJoint,
    AnyStop,
    Body,
    Mechanism,
    PinJoint,
    PrismaticJoint,
    Vector,
)

from .model import JointCoordinate

GRAVITY = 9.81
ALONG_X: Vector = (0.3, 0.0)
"""Centre of mass of the rod that most models have, seen from its pin [m]."""


def of(joint: str, zero: float = 0.0, /, **weights: float) -> JointCoordinate:
    """A joint by the weights of the mechanism's coordinates in its value."""
    return JointCoordinate(joint, weights, zero)


def body(name: str, angle: str | None, mass: float, centre: Vector, inertia: float) -> Body:
    """A body; without the name of an angle, one that does not turn relative to its parent."""
    return Body(name=name, angle=angle, mass=mass, centre=centre, inertia=inertia)


def pin(name: str, parent: str, child: str, at: Vector = (0, 0), on: Vector = (0, 0)) -> PinJoint:
    """A pin at a point of the parent and a point of the child."""
    return PinJoint(name=name, parent=parent, child=child, parent_point=at, child_point=on)


def rail(
    name: str,
    child: str,
    axis: Vector,
    coordinate: str,
    parent: str = GROUND,
    at: Vector = (0, 0),
    angle: float = 0.0,
) -> PrismaticJoint:
    """A body's origin on a line through a point of its parent."""
    return PrismaticJoint(
        name=name,
        parent=parent,
        child=child,
        parent_point=at,
        child_point=(0, 0),
        axis=axis,
        coordinate=coordinate,
        angle=angle,
    )


def mechanism(
    name: str,
    bodies: tuple[Body, ...],
    joints: tuple[AnyJoint, ...],
    start: tuple[float, ...],
    *,
    stops: tuple[AnyStop, ...] = (),
    forces: tuple[AnyForceElement, ...] = (),
    **changes: Any,
) -> Mechanism:
    """A mechanism under gravity."""
    fields: dict[str, Any] = {"name": name, "gravity": GRAVITY, **changes}
    return Mechanism(
        bodies=bodies, joints=joints, start=start, stops=stops, force_elements=forces, **fields
    )


def rod(
    name: str,
    *,
    start: float | tuple[float, ...] = 0.2,
    centre: Vector = ALONG_X,
    inertia: float = 0.06,
    mass: float = 2.0,
    joint: AnyJoint | None = None,
    **changes: Any,
) -> Mechanism:
    """A rod on a pin at the origin; its angle is `a`."""
    hinge = joint or pin("pivot", GROUND, "rod")
    started = start if isinstance(start, tuple) else (start,)
    return mechanism(name, (body("rod", "a", mass, centre, inertia),), (hinge,), started, **changes)


def block(
    name: str, axis: Vector = (0, 1), *, start: float = 0.0, mass: float = 2.0, **changes: Any
) -> Mechanism:
    """A block on a straight rail through the origin; its slide is `s`."""
    return mechanism(
        name,
        (body("block", None, mass, (0, 0), 0.01),),
        (rail("rail", "block", axis, "s"),),
        (start,),
        **changes,
    )
