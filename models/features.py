"""Features: elements that not every solver of mechanisms has; a solver declares which it has."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from enum import StrEnum

from .errors import UnsupportedProblemError
from .force_elements import ConstantForce, ConstantTorque, RotationalSpringDamper, SpringDamper
from .joints import GROUND, FreeJoint, PrismaticJoint, SlotJoint, WeldJoint
from .mechanism import Mechanism
from .problem import StopLaw
from .stops import Stop


class Basic(StrEnum):
    """An element that solvers have unless they say that they lack it; its text is its name in the plural."""

    SLOT = "slots in the ground"
    LOOP = "loops of joints"
    POINT_MASS = "bodies without inertia about their centre of mass"
    STOP = "stops on angles"
    POINT_STOP = "stops on points"
    REBOUND = "stops with a restitution"


class Feature(StrEnum):
    """An element beside pins, slots in the ground and stops against it; its text is its name in the plural."""

    FREE_JOINT = "free joints"
    MOVING_SLOT = "slots in moving bodies"
    PRISMATIC = "prismatic joints"
    WELD = "welds"
    MOVING_WALL = "stops against moving bodies"
    SPRING = "springs and dampers between points"
    ROTATIONAL_SPRING = "springs and dampers between angles"
    FORCE = "constant forces"
    TORQUE = "constant torques"
    GRAVITY_DIRECTION = "gravity in another direction than downwards"


_OF_MECHANISMS: dict[Feature, Callable[[Mechanism], Iterable[str]]] = {
    Feature.FREE_JOINT: lambda m: (j.name for j in m.joints if isinstance(j, FreeJoint)),
    Feature.MOVING_SLOT: lambda m: (
        j.name for j in m.joints if isinstance(j, SlotJoint) and j.parent != GROUND
    ),
    Feature.PRISMATIC: lambda m: (j.name for j in m.joints if isinstance(j, PrismaticJoint)),
    Feature.WELD: lambda m: (j.name for j in m.joints if isinstance(j, WeldJoint)),
    Feature.MOVING_WALL: lambda m: (s.name for s in m.point_stops if s.relative_to != GROUND),
    Feature.SPRING: lambda m: (e.name for e in m.force_elements if isinstance(e, SpringDamper)),
    Feature.ROTATIONAL_SPRING: lambda m: (
        e.name for e in m.force_elements if isinstance(e, RotationalSpringDamper)
    ),
    Feature.FORCE: lambda m: (e.name for e in m.force_elements if isinstance(e, ConstantForce)),
    Feature.TORQUE: lambda m: (e.name for e in m.force_elements if isinstance(e, ConstantTorque)),
    Feature.GRAVITY_DIRECTION: lambda m: ("gravity",) if m.gravity_direction != (0.0, -1.0) else (),
}


_BASICS: dict[Basic, Callable[[Mechanism], Iterable[str]]] = {
    Basic.SLOT: lambda m: (
        j.name for j in m.joints if isinstance(j, SlotJoint) and j.parent == GROUND
    ),
    Basic.LOOP: lambda m: (j.name for j in m.loop_joints),
    Basic.POINT_MASS: lambda m: (b.name for b in m.bodies if b.inertia == 0),
    Basic.STOP: lambda m: (s.name for s in m.stops if isinstance(s, Stop)),
    Basic.POINT_STOP: lambda m: (s.name for s in m.point_stops),
    Basic.REBOUND: lambda m: (s.name for s in m.stops if s.restitution),
}


def features_of(mechanism: Mechanism) -> dict[Feature, tuple[str, ...]]:
    """The features that a mechanism has, and the names of its elements of each."""
    found = {feature: tuple(names(mechanism)) for feature, names in _OF_MECHANISMS.items()}
    return {feature: names for feature, names in found.items() if names}


def missing_elements(
    mechanism: Mechanism,
    known: Collection[Feature],
    lacking: Collection[Basic] = (),
    law: StopLaw = StopLaw.UNILATERAL,
) -> dict[Feature | Basic, tuple[str, ...]]:
    """What a mechanism needs and a solver does not have, and the names of its elements of each.

    Args:
        known: features that the solver has.
        lacking: elements of every solver that this one lacks.
        law: of the stops; under the release-once law none is met, and a restitution is nothing to
            be followed.
    """
    missing: dict[Feature | Basic, tuple[str, ...]] = {
        feature: names for feature, names in features_of(mechanism).items() if feature not in known
    }
    basics = {basic: tuple(_BASICS[basic](mechanism)) for basic in Basic if basic in lacking}
    if law is StopLaw.RELEASE_ONCE:
        basics.pop(Basic.REBOUND, None)
    return missing | {basic: names for basic, names in basics.items() if names}


def refuse_features(
    mechanism: Mechanism,
    known: Collection[Feature],
    who: str,
    lacking: Collection[Basic] = (),
    law: StopLaw = StopLaw.UNILATERAL,
) -> None:
    """Refuse a mechanism with elements that a solver does not have.

    Args:
        known: features that the solver has.
        who: the solver, as the sentence begins.
        lacking: elements of every solver that this one lacks.
        law: of the stops.

    Raises:
        UnsupportedProblemError: the sentence names the elements.
    """
    missing = missing_elements(mechanism, known, lacking, law)
    if missing:
        texts = [
            f"{feature} ({', '.join(repr(name) for name in names)})"
            for feature, names in missing.items()
        ]
        raise UnsupportedProblemError(
            f"{who} cannot move {mechanism.name!r}: it has no {' and no '.join(texts)}."
        )
