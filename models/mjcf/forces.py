"""Force elements as MJCF: springs and dampers are tendons, constant forces and torques are actuators without control.

A spring between points is a spatial tendon between two sites; one between angles is a fixed tendon
over the hinges between the two bodies. A constant force is an actuator on a site whose directions
are those of a site of the world, a constant torque one on a fixed tendon; the bias of the actuator
is the force, so that it acts without any control.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import TypeVar

from ..elements import GROUND, ConstantForce, ConstantTorque, RotationalSpringDamper, SpringDamper
from ..mechanism import Mechanism
from ..spec import Vector
from .appearance import reach_of
from .text import from_origin, number, spatial
from .tree import add_angle_tendon, start_angles

_WORLD = "ground/directions"
_E = TypeVar("_E")


@dataclass(frozen=True)
class Forces:
    """Elements for all springs, dampers and motors of a mechanism."""

    mechanism: Mechanism

    def add_sites(self, element: ET.Element, body: str, origin: Vector) -> None:
        """On a body (or the world), the points that forces act on."""
        if body == GROUND and self._of(ConstantForce):
            ET.SubElement(element, "site", name=_WORLD)
        for spring in self._of(SpringDamper):
            for end, (name, point) in zip(_ends(spring), _points(spring), strict=True):
                if name == body:
                    ET.SubElement(element, "site", name=end, pos=from_origin(origin, point))
        for force in self._of(ConstantForce):
            if force.body == body:
                ET.SubElement(
                    element, "site", name=_site(force), pos=from_origin(origin, force.point)
                )

    @property
    def needs_tendons(self) -> bool:
        """Whether any element is, or acts on, a tendon."""
        return any(
            not isinstance(element, ConstantForce) for element in self.mechanism.force_elements
        )

    def add_tendons(self, tendon: ET.Element) -> None:
        """Springs and dampers, and what constant torques act on."""
        for spring in self._of(SpringDamper):
            spatial_tendon = ET.SubElement(
                tendon,
                "spatial",
                _strength(spring),
                name=_tendon(spring),
                springlength=number(spring.rest_length),
                width=number(round(0.006 * reach_of(self.mechanism), 6)),
                rgba="0.35 0.45 0.60 1",
            )
            for end in _ends(spring):
                ET.SubElement(spatial_tendon, "site", site=end)
        angles = start_angles(self.mechanism)
        for spring in self._of(RotationalSpringDamper):
            rest = spring.rest_angle - (angles[spring.body] - angles[spring.relative_to])
            # MuJoCo takes a length of -1 for none.
            add_angle_tendon(
                tendon, self.mechanism, spring.bodies, 1 if rest >= 0 else -1,
                name=_tendon(spring), **_strength(spring), springlength=number(abs(rest)),
            )  # fmt: skip
        for torque in self._of(ConstantTorque):
            add_angle_tendon(tendon, self.mechanism, torque.bodies, name=_tendon(torque))

    def add_actuators(self, root: ET.Element) -> None:
        """Constant forces and torques."""
        forces, torques = self._of(ConstantForce), self._of(ConstantTorque)
        if not forces and not torques:
            return
        actuator = ET.SubElement(root, "actuator")
        constant = {"gainprm": "0", "biastype": "affine"}
        for force in forces:
            gear = f"{spatial(force.force)} 0 0 0"
            on = {"site": _site(force), "refsite": _WORLD, "gear": gear}
            ET.SubElement(actuator, "general", constant, name=force.name, biasprm="1", **on)
        for torque in torques:
            of = {"tendon": _tendon(torque), "biasprm": number(torque.torque)}
            ET.SubElement(actuator, "general", constant, name=torque.name, **of)

    def _of(self, kind: type[_E]) -> tuple[_E, ...]:
        return tuple(
            element for element in self.mechanism.force_elements if isinstance(element, kind)
        )


def _points(spring: SpringDamper) -> tuple[tuple[str, Vector], tuple[str, Vector]]:
    """Both bodies and their points."""
    return (spring.body, spring.point), (spring.relative_to, spring.relative_point)


def _ends(spring: SpringDamper) -> tuple[str, str]:
    """Names of the sites at its two points."""
    return f"{spring.name}/point", f"{spring.name}/relative point"


def _site(force: ConstantForce) -> str:
    return f"{force.name}/force"


def _tendon(element: SpringDamper | RotationalSpringDamper | ConstantTorque) -> str:
    """Name of its tendon, beside those of stops."""
    return f"{element.name}/{element.kind}"


def _strength(spring: SpringDamper | RotationalSpringDamper) -> dict[str, str]:
    return {"stiffness": number(spring.stiffness), "damping": number(spring.damping)}
