"""Elements that not every solver has: what a mechanism needs, and how a solver refuses it."""

from __future__ import annotations

from collections.abc import Collection

from .elements import (
    ConstantForce,
    ConstantTorque,
    FreeJoint,
    PinJoint,
    PointStop,
    PrismaticJoint,
    RotationalSpringDamper,
    SlotJoint,
    SpringDamper,
    Stop,
    WeldJoint,
)
from .elements.base import Basic, Feature
from .errors import UnsupportedProblemError
from .mechanism import Mechanism
from .problem import StopLaw

__all__ = [
    "COVERED_BY_FEATURES",
    "Basic",
    "Feature",
    "features_of",
    "missing_elements",
    "refuse_features",
]

COVERED_BY_FEATURES: frozenset[type] = frozenset(
    {
        PinJoint, WeldJoint, SlotJoint, PrismaticJoint, FreeJoint, Stop, PointStop,
        SpringDamper, RotationalSpringDamper, ConstantForce, ConstantTorque,
    }
)  # fmt: skip
"""Classes that a solver has if it declares their features; closed.

Engines of earlier releases declare `frozenset(Feature)` and so would claim each new feature before
they have it. A class that is not here must be claimed itself.
"""


def _needs(mechanism: Mechanism) -> dict[Feature | Basic, list[str]]:
    """Names of the elements of every feature, in the order of the enumerations."""
    needs: dict[Feature | Basic, list[str]] = {need: [] for need in (*Feature, *Basic)}
    for element in mechanism.elements:
        for feature in element.features:
            needs[feature].append(element.name)
    if mechanism.gravity_direction != (0.0, -1.0):
        needs[Feature.GRAVITY_DIRECTION].append("gravity")
    needs[Basic.LOOP] += [joint.name for joint in mechanism.loop_joints]
    needs[Basic.POINT_MASS] += [body.name for body in mechanism.bodies if body.inertia == 0]
    return needs


def features_of(mechanism: Mechanism) -> dict[Feature, tuple[str, ...]]:
    """Features that a mechanism has, each with the names of its elements."""
    needs = _needs(mechanism)
    return {feature: tuple(needs[feature]) for feature in Feature if needs[feature]}


def missing_elements(
    mechanism: Mechanism,
    known: Collection[Feature],
    lacking: Collection[Basic] = (),
    law: StopLaw = StopLaw.UNILATERAL,
    classes: Collection[type] = COVERED_BY_FEATURES,
) -> dict[str, tuple[str, ...]]:
    """Needs of a mechanism that a solver lacks, each with the names of its elements.

    Args:
        known: features that the solver has.
        lacking: elements of every solver that this one lacks.
        law: of the stops; under the release-once law none is met, and a restitution is nothing to
            be followed.
        classes: of the elements that the solver has.
    """
    needs = _needs(mechanism)
    missing: dict[str, list[str]] = {f: needs[f] for f in Feature if f not in known and needs[f]}
    for basic in Basic:
        followed = basic is not Basic.REBOUND or law is not StopLaw.RELEASE_ONCE
        if basic in lacking and needs[basic] and followed:
            missing[basic] = needs[basic]
    for element in mechanism.elements:
        if type(element) not in classes and not any(f in missing for f in element.features):
            kind = f"elements of the class {type(element).__name__}"
            missing.setdefault(kind, []).append(element.name)
    return {need: tuple(names) for need, names in missing.items()}


def refuse_features(
    mechanism: Mechanism,
    known: Collection[Feature],
    who: str,
    lacking: Collection[Basic] = (),
    law: StopLaw = StopLaw.UNILATERAL,
    classes: Collection[type] = COVERED_BY_FEATURES,
) -> None:
    """Refuse a mechanism with elements that a solver does not have.

    Args:
        mechanism, known, lacking, law, classes: as :func:`missing_elements`.
        who: the engine; it is its adapter that refuses, whatever else the engine could build.

    Raises:
        UnsupportedProblemError: the sentence names the elements.
    """
    missing = missing_elements(mechanism, known, lacking, law, classes)
    if not missing:
        return
    texts = [f"{need} ({', '.join(map(repr, names))})" for need, names in missing.items()]
    raise UnsupportedProblemError(
        f"the adapter of {who} builds no {' and no '.join(texts)}, which {mechanism.name!r} has."
    )
