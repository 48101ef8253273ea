"""Energies of a state in balls."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

from ...models.elements import (
    FORCE_ELEMENTS,
    ConstantForce,
    ConstantTorque,
    CubicTorsionSpring,
    ElementTable,
    RotationalSpringDamper,
    SpringDamper,
)
from .balls import Ball, arb, squared
from .numbers import BallGeometry

_Energy = Callable[[BallGeometry, Any, Sequence[Ball]], Ball]


def kinetic_energy(geometry: BallGeometry, q: Sequence[Ball], u: Sequence[Ball]) -> Ball:
    """T [J]."""
    total = arb(0)
    for mass, centre in geometry.centres:
        velocity = geometry.velocity(centre, q, u)
        total += mass * (squared(velocity.real) + squared(velocity.imag))
    for inertia, speed in zip(geometry.inertias, u, strict=True):
        total += inertia * squared(speed)
    return total / 2


def potential_energy(geometry: BallGeometry, q: Sequence[Ball]) -> Ball:
    """Energy of gravity, zero at the world's origin, and of springs [J]."""
    mechanism, total = geometry.mechanism, arb(0)
    x, y = mechanism.gravity_direction
    for mass, centre in geometry.centres:
        at = geometry.position(centre, q)
        total -= mass * mechanism.gravity * (at.real * x + at.imag * y)
    for element in mechanism.force_elements:
        total += _ENERGIES[element](geometry, element, q)
    return total


def _of_length(geometry: BallGeometry, e: SpringDamper, q: Sequence[Ball]) -> Ball:
    vector = geometry.position(e.direction(cast("Any", geometry)), q)
    stretch = (squared(vector.real) + squared(vector.imag)).sqrt() - e.rest_length
    return e.stiffness * squared(stretch) / 2


def _turned(
    geometry: BallGeometry, e: RotationalSpringDamper | CubicTorsionSpring, q: Sequence[Ball]
) -> Ball:
    angle = e.direction(cast("Any", geometry))
    value = arb(0) + angle.constant - e.rest_angle
    for sense, q_k in zip(angle.coefficients, q, strict=True):
        value += float(sense) * q_k
    return value


def _of_angle(geometry: BallGeometry, e: RotationalSpringDamper, q: Sequence[Ball]) -> Ball:
    return e.stiffness * squared(_turned(geometry, e, q)) / 2


def _of_cubic(geometry: BallGeometry, e: CubicTorsionSpring, q: Sequence[Ball]) -> Ball:
    square = squared(_turned(geometry, e, q))
    return e.stiffness * square / 2 + e.cubic_stiffness * squared(square) / 4


def _none(*_: object) -> Ball:
    return arb(0)


_ENERGIES: ElementTable[_Energy] = ElementTable(
    "The energy of a proved motion",
    FORCE_ELEMENTS,
    {
        SpringDamper: _of_length,
        RotationalSpringDamper: _of_angle,
        CubicTorsionSpring: _of_cubic,
        ConstantForce: _none,
        ConstantTorque: _none,
    },
)
