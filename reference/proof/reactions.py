"""SolvedForces of the joints in balls, by Newton's law; as :mod:`..reactions` in doubles."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, cast

from ...models.elements import (
    FORCE_ELEMENTS,
    GROUND,
    STOPS,
    ConstantForce,
    ConstantTorque,
    CubicTorsionSpring,
    ElementTable,
    PointStop,
    RotationalSpringDamper,
    SpringDamper,
    Stop,
)
from .balls import Ball, acb, squared
from .motion import SolvedForces, State
from .numbers import BallGeometry, Complex

_BodyForces = Callable[[BallGeometry, Any, State], Iterator[tuple[str, Complex]]]


def joint_reactions(
    geometry: BallGeometry, state: State, forces: SolvedForces
) -> dict[str, Complex]:
    """Force on each joint's child, x + i y in the world [N]; of a free joint none."""
    mechanism, (q, u) = geometry.mechanism, state
    x, y = mechanism.gravity_direction
    gravity = acb(x, y) * mechanism.gravity
    left: dict[str, Complex] = {}
    for body, (mass, centre) in zip(mechanism.bodies, geometry.centres, strict=True):
        acceleration = geometry.acceleration(centre, q, u, forces.accelerations)
        left[body.name] = mass * (acceleration - gravity)

    def act(body: str, other: str, force: Complex) -> None:
        """Take a known force on a body, and the opposite one on another, off what they need."""
        for name, sign in ((body, -1), (other, 1)):
            if name in left:
                left[name] += sign * force

    for element in mechanism.force_elements:
        for body, force in _ON_BODIES[element](geometry, element, state):
            act(body, GROUND, force)
    loops, multipliers = dict[str, Complex](), iter(forces.loops)
    for joint in mechanism.loop_joints:
        frame = joint.parent if joint.free_directions else GROUND
        force = acb(0)
        for direction in joint.held_directions:
            force += next(multipliers) * geometry.turned(frame, direction, q)
        if joint.holds_angle:
            next(multipliers)  # a torque
        loops[joint.name] = force
        act(joint.child, joint.parent, force)
    for stop in mechanism.stops:
        normal = _NORMALS[stop](geometry, stop, q)
        if normal is not None and stop.name in forces.torques:
            act(stop.body, stop.relative_to, forces.torques[stop.name] * normal)
    for joint in reversed(mechanism.tree_joints):  # from the tips to the ground
        if joint.parent != GROUND:
            left[joint.parent] += left[joint.child]
    carried = (joint for joint in mechanism.tree_joints if joint.held_directions)
    return {joint.name: left[joint.child] for joint in carried} | loops


def _pull(geometry: BallGeometry, e: SpringDamper, state: State) -> Iterator[tuple[str, Complex]]:
    direction, (q, u) = e.direction(cast("Any", geometry)), state
    vector, rate = geometry.position(direction, q), geometry.velocity(direction, q, u)
    force = -e.stiffness * vector
    if e.rest_length or e.damping:
        length = (squared(vector.real) + squared(vector.imag)).sqrt()
        stretching = (vector.conjugate() * rate).real / length
        force += (e.stiffness * e.rest_length - e.damping * stretching) * vector / length
    yield e.body, force
    yield e.relative_to, -force


def _constant(_: BallGeometry, e: ConstantForce, __: State) -> Iterator[tuple[str, Complex]]:
    yield e.body, acb(*e.force)


def _none(*_: object) -> Iterator[tuple[str, Complex]]:
    return iter(())


_ON_BODIES: ElementTable[_BodyForces] = ElementTable(
    "The joint forces of a proved motion",
    FORCE_ELEMENTS,
    {
        SpringDamper: _pull,
        RotationalSpringDamper: _none,
        CubicTorsionSpring: _none,
        ConstantForce: _constant,
        ConstantTorque: _none,
    },
)
_NORMALS: ElementTable[Callable[[BallGeometry, Any, Sequence[Ball]], Complex | None]] = (
    ElementTable(
        "The joint forces of a proved motion",
        STOPS,
        {
            Stop: lambda geometry, stop, q: None,  # a torque needs no force of a joint
            PointStop: lambda geometry, stop, q: geometry.turned(
                stop.relative_to, complex(*stop.normal), q
            ),
        },
    )
)
