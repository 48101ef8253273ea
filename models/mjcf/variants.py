"""Variants of a mechanism's MJCF for other readers: without sensors, with finite inertias.

Finite inertia costs nothing where a body hangs on a pin. Mass that is moved from the parent's end
of the pin to the child's leaves the equations of motion as they are, and with its mass and centre
the child's inertia changes: its mass m, first moment S and second moment J about the pin give the
inertia J - S^2 / m, which grows with m (these are the regrouped inertial parameters of robot
identification; Gautier and Khalil, IEEE Trans. Robot. Autom. 6 (1990) 368).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

from ..elements import GROUND, AnyJoint
from ..mechanism import Mechanism
from ..spec import Vector
from .tree import from_origin, number, numbers

POINT_INERTIA = 2e-15
"""Moment of inertia that stands for none [kg m^2]: twice the least that MuJoCo takes (mjMINVAL).

It counts relative to m r^2: 1e-6 costs 1.6e-8 m on Table I, 1e-12 shows in the model of a machine
of a few grams.
"""

_SHARE = 1e-3  # least moment of inertia, in parts of the second moment about the body's pin


@dataclass(frozen=True)
class Variant:
    """Differences from the committed files."""

    sensors: bool = True
    """Sensors alone ask for MuJoCo 3.3."""
    finite_inertia: bool = False
    """Whether point masses on pins get an inertia; the motion is the same, pin forces differ."""
    throw: bool = False
    """Whether the projectile is a body tied by an equality that :func:`.throw.throw` releases."""


@dataclass(frozen=True)
class MassProperties:
    """Mass [kg], centre [m] and moment of inertia about it [kg m^2] of a body, in its frame."""

    mass: float
    centre: complex
    inertia: float

    def with_mass_at(self, point: complex, mass: float) -> MassProperties:
        """The sum with a point mass [kg], which may be negative."""
        total = self.mass + mass
        centre = (self.mass * self.centre + mass * point) / total
        about = self.mass * abs(self.centre - centre) ** 2 + mass * abs(point - centre) ** 2
        return MassProperties(total, centre, self.inertia + about)

    def add_to(self, element: ET.Element, origin: Vector) -> None:
        """Give them to a body in MJCF whose frame's origin is at a point of ours."""
        ET.SubElement(
            element, "inertial", pos=from_origin(origin, (self.centre.real, self.centre.imag)),
            mass=number(self.mass), diaginertia=numbers(*[max(self.inertia, POINT_INERTIA)] * 3),
        )  # fmt: skip

    def second_moment(self, point: complex) -> float:
        """About a point [kg m^2]."""
        return self.inertia + self.mass * abs(self.centre - point) ** 2


def inertias(mechanism: Mechanism, variant: Variant) -> dict[str, MassProperties]:
    """Mass, centre and inertia of each body by name, as they are written."""
    properties = {
        body.name: MassProperties(body.mass, complex(*body.centre), body.inertia)
        for body in mechanism.bodies
    }
    if variant.finite_inertia:
        for body in reversed(mechanism.bodies):
            _enlarge(mechanism, properties, mechanism.joint_of(body.name))
    return properties


def _enlarge(mechanism: Mechanism, properties: dict[str, MassProperties], joint: AnyJoint) -> None:
    """Move as much mass from the parent to the child of a pin as gives the child its least inertia.

    Not if the parent then had a negative inertia that it could not get from the ground: the third
    point mass of a chain stays one.
    """
    child, at = properties[joint.child], complex(*joint.child_point)
    needed = _SHARE * child.second_moment(at)
    if joint.kind != "pin" or child.inertia >= needed:
        return
    first = child.mass * abs(child.centre - at)
    moved = first**2 / (child.second_moment(at) - needed) - child.mass
    if joint.parent != GROUND:
        smaller = properties[joint.parent].with_mass_at(complex(*joint.parent_point), -moved)
        carrier = mechanism.joint_of(joint.parent)
        from_ground = carrier.kind == "pin" and carrier.parent == GROUND
        if smaller.mass <= 0 or (smaller.inertia <= 0 and not from_ground):
            return
        properties[joint.parent] = smaller
    properties[joint.child] = child.with_mass_at(at, moved)
