"""Rotors as a part of a body's moment of inertia, for engines of bodies.

A rotor whose relative angle is that of one body alone (the other one is the ground, or does not
turn) adds its inertia to that body's about the centre of mass, and changes no force of a joint. One
between two bodies that both turn would couple their rotations.
"""

from __future__ import annotations

from collections.abc import Mapping

from ..models.elements import GROUND, RotorInertia
from ..models.errors import UnsupportedProblemError
from ..models.mechanism import Mechanism


def rotors_of(mechanism: Mechanism, engine: str) -> Mapping[str, float]:
    """Inertia of the rotors that turn with a body, by its name [kg m^2].

    Of bodies that turn together it is the first.

    Args:
        mechanism: with any force elements.
        engine: its name, for messages.

    Raises:
        UnsupportedProblemError: a rotor turns with the angle between two bodies that both turn.
    """
    found: dict[str, float] = {}
    for rotor in mechanism.force_elements:
        if not isinstance(rotor, RotorInertia):
            continue
        ends = {None if name == GROUND else mechanism.attitudes[name][0] for name in rotor.bodies}
        turning = ends - {None}
        if len(turning) > 1:
            raise UnsupportedProblemError(
                f"our adapter builds rotors as a part of a body's moment in {engine}; "
                f"{rotor.name!r} turns with the angle between "
                f"{' and '.join(map(repr, rotor.bodies))}, which both turn."
            )
        if len(ends) > 1:
            (index,) = turning
            name = next(name for name, (own, _) in mechanism.attitudes.items() if own == index)
            found[name] = found.get(name, 0.0) + rotor.inertia
    return found
