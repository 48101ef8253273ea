"""Energies and joint forces of a state in balls."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from ...models.elements import (
    FORCE_ELEMENTS,
    ConstantForce,
    ConstantTorque,
    CubicTorsionSpring,
    ElementTable,
    RecordedForce,
    RecordedTorque,
    RotationalSpringDamper,
    RotorInertia,
    SlideInertia,
    SlideSpringDamper,
    SpringDamper,
)
from ...models.functions import weighted
from ..reactions import distributed
from .balls import Ball, acb, arb, squared
from .numbers import BallKinematics, Complex, Coordinates


class SolvedForces(NamedTuple):
    """Accelerations and the multipliers of constraints in one state."""

    accelerations: Coordinates
    """Second derivatives of the coordinates [rad/s^2 or m/s^2]."""
    loops: Sequence[Ball]
    """Multipliers of the loop joints' constraints [N or N m]."""
    torques: Mapping[str, Ball]
    """Torques (forces) of the closed stops [N m or N]."""


def kinetic_energy(kinematics: BallKinematics, q: Coordinates, u: Coordinates) -> Ball:
    """T [J]."""
    flow, total = kinematics.flow(q, u, kinematics.rates(q)), arb(0)
    for body, centre in zip(kinematics.mechanism.bodies, kinematics.centres, strict=True):
        velocity: Complex = weighted(flow, centre)
        total += body.mass * (squared(velocity.real) + squared(velocity.imag))
    for inertia, speed in zip(kinematics.inertias, u, strict=True):
        total += inertia * squared(speed.real)
    for element in kinematics.mechanism.force_elements:
        total += _ELEMENTS[element].doubled_kinetic_energy(kinematics, element, u)
    return total / 2


def potential_energy(kinematics: BallKinematics, q: Coordinates) -> Ball:
    """Energy of gravity, zero at the world's origin, and of springs [J]."""
    mechanism, total = kinematics.mechanism, arb(0)
    x, y = mechanism.gravity_direction
    for body in mechanism.bodies:
        at: Complex = kinematics.vector(kinematics.point(body.name, body.centre), q)
        total -= body.mass * mechanism.gravity * (at.real * x + at.imag * y)
    for element in mechanism.force_elements:
        total += _ELEMENTS[element].energy(kinematics, element, q)
    return total


def half_square(velocity: Complex) -> Ball:
    """Kinetic energy of a unit mass [J/kg]."""
    return (squared(velocity.real) + squared(velocity.imag)) / 2


def range_without_drag(position: Complex, velocity: Complex, gravity: float) -> Ball:
    """Where what is let go comes back to y = 0 without air [m]; not finite if it may not.

    Of (x, y) and (vx, vy) it is x + vx T, g T = vy + sqrt(vy^2 + 2 g y).
    """
    fall = (squared(velocity.imag) + 2 * gravity * position.imag).sqrt()
    return position.real + velocity.real * (velocity.imag + fall) / gravity


def joint_reactions(
    kinematics: BallKinematics, q: Coordinates, u: Coordinates, forces: SolvedForces
) -> dict[str, Complex]:
    """Force on each joint's child, x + i y in the world [N]; of a free joint none."""
    mechanism = kinematics.mechanism
    gravity = acb(*mechanism.gravity_direction) * mechanism.gravity
    second, needed = kinematics.second_flow(q, u, forces.accelerations), dict[str, Complex]()
    for body, centre in zip(mechanism.bodies, kinematics.centres, strict=True):
        needed[body.name] = body.mass * (weighted(second, centre) - gravity)
    for element in mechanism.force_elements:
        own, motion = _ELEMENTS[element], (q, u, forces.accelerations)
        for body, force in own.on_bodies(kinematics, element, *motion):
            if body in needed:
                needed[body] -= force

    def in_world(body: str, direction: complex) -> Complex:
        return kinematics.in_world(body, direction, q)

    pushes = {stop.name: forces.torques.get(stop.name, arb(0)) for stop in mechanism.stops}
    return distributed(mechanism, needed, iter(forces.loops), pushes, in_world)


# --- Force elements, whose own formulas take arrays of doubles


class _Element(NamedTuple):
    """Formulas of a force element."""

    energy: Callable[[BallKinematics, Any, Coordinates], Ball]
    on_bodies: Callable[
        [BallKinematics, Any, Coordinates, Coordinates, Coordinates],
        Iterator[tuple[str, Complex]],
    ]
    """Forces by coordinates, speeds and accelerations."""
    doubled_kinetic_energy: Callable[[BallKinematics, Any, Coordinates], Ball]


def _length(vector: Complex) -> Ball:
    return (squared(vector.real) + squared(vector.imag)).sqrt()


def _spring_energy(kinematics: BallKinematics, e: SpringDamper, q: Coordinates) -> Ball:
    stretch = _length(kinematics.vector(e.direction(kinematics), q)) - e.rest_length
    return e.stiffness * squared(stretch) / 2


def _spring_forces(
    kinematics: BallKinematics, e: SpringDamper, q: Coordinates, u: Coordinates, _: Coordinates
) -> Iterator[tuple[str, Complex]]:
    direction = e.direction(kinematics)
    vector: Complex = kinematics.vector(direction, q)
    force = -e.stiffness * vector
    if e.rest_length or e.damping:
        length, rate = _length(vector), kinematics.rate(direction, q, u)
        stretching = (vector.conjugate() * rate).real / length
        force += (e.stiffness * e.rest_length - e.damping * stretching) * vector / length
    yield e.body, force
    yield e.relative_to, -force


def _twist(
    kinematics: BallKinematics, e: RotationalSpringDamper | CubicTorsionSpring, q: Coordinates
) -> Ball:
    return e.direction(kinematics).value(q).real - e.rest_angle


def _rotational_energy(
    kinematics: BallKinematics, e: RotationalSpringDamper, q: Coordinates
) -> Ball:
    return e.stiffness * squared(_twist(kinematics, e, q)) / 2


def _cubic_energy(kinematics: BallKinematics, e: CubicTorsionSpring, q: Coordinates) -> Ball:
    square = squared(_twist(kinematics, e, q))
    return e.stiffness * square / 2 + e.cubic_stiffness * squared(square) / 4


def _constant_force(
    _: BallKinematics, e: ConstantForce, *__: Coordinates
) -> Iterator[tuple[str, Complex]]:
    yield e.body, acb(*e.force)


def _rotor_energy(
    kinematics: BallKinematics, e: RotorInertia | SlideInertia, u: Coordinates
) -> Ball:
    """J w^2 or J v^2 [J]."""
    senses = e.direction(kinematics).coefficients
    rate = sum((float(g) * speed.real for g, speed in zip(senses, u, strict=True)), arb(0))
    return e.inertia * squared(rate)


def _slide_energy(kinematics: BallKinematics, e: SlideSpringDamper, q: Coordinates) -> Ball:
    stretch = e.direction(kinematics).value(q).real - e.rest_position
    return e.stiffness * squared(stretch) / 2


def _slide_forces(
    kinematics: BallKinematics, e: SlideSpringDamper, q: Coordinates, u: Coordinates, _: Coordinates
) -> Iterator[tuple[str, Complex]]:
    slide = e.direction(kinematics)
    stretch, rate = slide.value(q).real - e.rest_position, slide.value(u).real
    size = e.force - e.stiffness * stretch - e.damping * rate
    force = size * kinematics.slide_axis(e.coordinate, q)
    yield e.body, force
    yield e.relative_to, -force


def _drive_forces(
    kinematics: BallKinematics, e: SlideInertia, q: Coordinates, _: Coordinates, a: Coordinates
) -> Iterator[tuple[str, Complex]]:
    rate = e.direction(kinematics).value(a).real
    force = -e.inertia * rate * kinematics.slide_axis(e.coordinate, q)
    yield e.body, force
    yield e.relative_to, -force


def _no_energy(*_: object) -> Ball:
    return arb(0)


def _no_forces(*_: object) -> Iterator[tuple[str, Complex]]:
    return iter(())


_ELEMENTS: ElementTable[_Element] = ElementTable(
    "A proof's energies and joint forces",
    FORCE_ELEMENTS,
    {
        SpringDamper: _Element(_spring_energy, _spring_forces, _no_energy),
        RotationalSpringDamper: _Element(_rotational_energy, _no_forces, _no_energy),
        CubicTorsionSpring: _Element(_cubic_energy, _no_forces, _no_energy),
        ConstantForce: _Element(_no_energy, _constant_force, _no_energy),
        ConstantTorque: _Element(_no_energy, _no_forces, _no_energy),
        RotorInertia: _Element(_no_energy, _no_forces, _rotor_energy),
        SlideSpringDamper: _Element(_slide_energy, _slide_forces, _no_energy),
        SlideInertia: _Element(_no_energy, _drive_forces, _rotor_energy),
    },
    {
        RecordedForce: "a record of efforts changes over time",
        RecordedTorque: "a record of efforts changes over time",
    },
)
