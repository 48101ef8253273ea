"""Elements of a mechanism: every class of joint, stop and force element, in one table.

A consumer (the reference, an engine's builder, a drawing, ...) owns an
:class:`~.base.ElementTable` over one of these groups; what it meets and does not know, it refuses
by name. To add an element: one module here, one row in a group below and in its union, and a line
in each consumer's table (docs/extending.md).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, cast

from pydantic import Discriminator, Field, Tag

from ..errors import UnsupportedProblemError
from .angle_stop import Stop
from .base import CONSUMERS, GROUND, Basic, ElementTable, Feature, TwoBodyForceElement, refusal
from .constant_force import ConstantForce
from .constant_torque import ConstantTorque
from .coupler import Coupler, CouplerTerm
from .cubic_torsion_spring import CubicTorsionSpring
from .free import FreeJoint
from .pin import PinJoint
from .point_stop import PointStop
from .prismatic import PrismaticJoint
from .recorded_effort import RecordedEffort, RecordedForce, RecordedTorque, efforts_during
from .rotational_spring_damper import RotationalSpringDamper
from .rotor_inertia import RotorInertia
from .slide_inertia import SlideInertia
from .slide_spring_damper import SlideSpringDamper
from .slot import SlotJoint
from .spring_damper import SpringDamper
from .translation import TranslationJoint
from .weld import WeldJoint

__all__ = [
    "CONSUMERS",
    "COUPLERS",
    "ELEMENTS",
    "FORCE_ELEMENTS",
    "GROUND",
    "JOINTS",
    "STOPS",
    "AnyElement",
    "AnyForceElement",
    "AnyJoint",
    "AnyStop",
    "Basic",
    "ConstantForce",
    "ConstantTorque",
    "Coupler",
    "CouplerTerm",
    "CubicTorsionSpring",
    "ElementTable",
    "Feature",
    "ForceElement",
    "FreeJoint",
    "Joint",
    "PinJoint",
    "PointStop",
    "PrismaticJoint",
    "RecordedEffort",
    "RecordedForce",
    "RecordedTorque",
    "RotationalSpringDamper",
    "RotorInertia",
    "SlideInertia",
    "SlideSpringDamper",
    "SlotJoint",
    "SpringDamper",
    "Stop",
    "TranslationJoint",
    "TwoBodyForceElement",
    "WeldJoint",
    "efforts_during",
    "refuse_unknown",
]

JOINTS: tuple[type, ...] = (
    PinJoint,
    WeldJoint,
    SlotJoint,
    PrismaticJoint,
    FreeJoint,
    TranslationJoint,
)
STOPS: tuple[type, ...] = (Stop, PointStop)
FORCE_ELEMENTS: tuple[type, ...] = (
    SpringDamper,
    RotationalSpringDamper,
    CubicTorsionSpring,
    ConstantForce,
    ConstantTorque,
    RotorInertia,
    SlideSpringDamper,
    RecordedTorque,
    RecordedForce,
    SlideInertia,
)
COUPLERS: tuple[type, ...] = (Coupler,)
ELEMENTS: tuple[type, ...] = (*JOINTS, *STOPS, *FORCE_ELEMENTS, *COUPLERS)


def refuse_unknown(consumer: str, elements: Iterable[object]) -> None:
    """Refuse elements of classes that are in no group, by name.

    For consumers that need nothing but what an element says of itself.

    Raises:
        UnsupportedProblemError: one is of such a class; `consumer` begins the sentence.
    """
    for element in elements:
        if type(element) not in ELEMENTS:
            raise UnsupportedProblemError(refusal(consumer, element, None))


AnyJoint = PinJoint | WeldJoint | SlotJoint | PrismaticJoint | FreeJoint | TranslationJoint
Joint = Annotated[AnyJoint, Field(discriminator="kind")]

# In the order of the schemas, in which an element of a later release comes last.
AnyForceElement = (
    SpringDamper
    | RotationalSpringDamper
    | ConstantForce
    | ConstantTorque
    | CubicTorsionSpring
    | RotorInertia
    | SlideSpringDamper
    | RecordedTorque
    | RecordedForce
    | SlideInertia
)
ForceElement = Annotated[AnyForceElement, Field(discriminator="kind")]

_POINT_STOP_FIELDS = {"point", "normal", "offset"}


def _tag_of_stop(value: object) -> str:
    """Tag of a stop, as an object or as the fields of one."""
    if isinstance(value, dict):
        is_point_stop = bool(_POINT_STOP_FIELDS & cast("dict[str, object]", value).keys())
    else:
        is_point_stop = isinstance(value, PointStop)
    return "point stop" if is_point_stop else "stop"


# Stops are told apart by their fields: a `kind` would change the content, and so the hash, of every
# mechanism there is.
AnyStop = Annotated[
    Annotated[Stop, Tag("stop")] | Annotated[PointStop, Tag("point stop")],
    Discriminator(_tag_of_stop),
]
AnyElement = AnyJoint | Stop | PointStop | AnyForceElement | Coupler
