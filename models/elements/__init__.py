"""Elements of a mechanism: every class of joint, stop and force element, in one table.

A consumer (the reference, an engine's builder, a drawing, ...) owns an
:class:`~.table.ElementTable` over one of these groups; what it meets and does not know, it refuses
by name.
"""

from __future__ import annotations

from ..force_elements import (
    ConstantForce,
    ConstantTorque,
    RotationalSpringDamper,
    SpringDamper,
)
from ..joints import FreeJoint, PinJoint, PrismaticJoint, SlotJoint, WeldJoint
from ..stops import PointStop, Stop
from .cubic_torsion_spring import CubicTorsionSpring
from .table import CONSUMERS, ElementTable

__all__ = [
    "CONSUMERS",
    "ELEMENTS",
    "FORCE_ELEMENTS",
    "JOINTS",
    "STOPS",
    "ConstantForce",
    "ConstantTorque",
    "CubicTorsionSpring",
    "ElementTable",
    "FreeJoint",
    "PinJoint",
    "PointStop",
    "PrismaticJoint",
    "RotationalSpringDamper",
    "SlotJoint",
    "SpringDamper",
    "Stop",
    "WeldJoint",
]

JOINTS: tuple[type, ...] = (PinJoint, WeldJoint, SlotJoint, PrismaticJoint, FreeJoint)
STOPS: tuple[type, ...] = (Stop, PointStop)
FORCE_ELEMENTS: tuple[type, ...] = (
    SpringDamper,
    RotationalSpringDamper,
    CubicTorsionSpring,
    ConstantForce,
    ConstantTorque,
)
ELEMENTS: tuple[type, ...] = (*JOINTS, *STOPS, *FORCE_ELEMENTS)
