"""The throw in MJCF: the projectile is a body of its own, tied to the machine by an equality that is switched off.

What it weighs is taken from the body that carries it; a massless sling keeps a tenth of it. The tie is soft like all of
MuJoCo's constraints, and softer the lighter the sling is, since its regularisation is in proportion to the inverse
masses; a stiffer one than the machine's stops have is not more exact with RK4. At the step of 0.25 ms that `tb.mjcf`
takes for it, the machines with angle stops move as without the tie to 1e-6 m. Where points are held by contacts, plain
steps lose and find them again, and two models that differ at all differ by what that costs.
"""

from __future__ import annotations

import importlib
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import InputError, UnsupportedProblemError
from ..kinematics import Kinematics
from ..mechanism import Marker, Mechanism
from .text import number, numbers, spatial
from .variants import Inertia

PROJECTILE, HOLD, LANDING = "thrown_projectile", "hold_projectile", "landing_ground"
"""Names of the body and its ball, of the equality, and of the plane that it lands on."""
_KEPT = 0.1  # of the projectile's mass, by a sling that has no other


@dataclass(frozen=True)
class Thrown:
    """The projectile of a mechanism as a body of its own.

    Raises:
        UnsupportedProblemError: it has no marker 'projectile' whose mass is known.
    """

    mechanism: Mechanism
    timestep: float

    @cached_property
    def marker(self) -> Marker:
        """The point at which it is held."""
        marker = self.mechanism.marker("projectile")
        if marker is None or self.mechanism.thrown_mass(marker) is None:
            raise UnsupportedProblemError(f"{self.mechanism.name!r} has no marker 'projectile' with a mass to throw.")
        return marker

    @cached_property
    def mass(self) -> float:
        """Of the body that flies [kg]."""
        mass, whole = self.mechanism.thrown_mass(self.marker) or 0.0, self.mechanism.body(self.marker.body).mass
        return mass if mass < (1 - _KEPT) * whole else (1 - _KEPT) * mass

    def take_from(self, inertias: dict[str, Inertia]) -> None:
        """Take its mass from the body that carries it."""
        body, point = self.marker.body, complex(*self.marker.point)
        lighter = inertias[body].with_mass_at(point, -self.mass)
        inertias[body] = lighter if inertias[body].inertia else Inertia(lighter.mass, point, 0.0)

    def place(self, q: tuple[float, ...]) -> list[float]:
        """By how much the point has moved since the start [m], x and y."""
        kinematics = Kinematics(self.mechanism)
        row = kinematics.point(self.marker.body, self.marker.point)
        there, start = (kinematics.position(row, np.array(each)) for each in (q, self.mechanism.start))
        return (there - start).tolist()

    def speed(self, q: tuple[float, ...], u: tuple[float, ...]) -> list[float]:
        """Velocity of the point [m/s]."""
        kinematics = Kinematics(self.mechanism)
        row = kinematics.point(self.marker.body, self.marker.point)
        return kinematics.velocity(row, np.array(q), np.array(u)).tolist()

    def add_body(self, world: ET.Element, radius: float, ground: float, look: str) -> None:
        """The projectile, which moves in the plane without turning, and the ground that it lands on."""
        kinematics = Kinematics(self.mechanism)
        row = kinematics.point(self.marker.body, self.marker.point)
        x, y = kinematics.position(row, np.array(self.mechanism.start)).tolist()
        ET.SubElement(world, "geom", group="4", name=LANDING, type="plane", pos=numbers(0, 0, ground), size="0 0 1")
        body = ET.SubElement(world, "body", name=PROJECTILE, pos=spatial((x, y)))
        turn = 0.4 * self.mass * radius**2
        ET.SubElement(body, "inertial", pos="0 0 0", mass=number(self.mass), diaginertia=numbers(turn, turn, turn))
        for axis, way in (("x", "1 0 0"), ("z", "0 0 1")):
            ET.SubElement(body, "joint", name=f"{PROJECTILE}_{axis}", type="slide", axis=way)
        ET.SubElement(body, "site", name=PROJECTILE)
        ET.SubElement(body, "geom", name=PROJECTILE, type="sphere", size=number(radius), rgba=look)

    def add_constraints(self, root: ET.Element) -> None:
        """The tie, and the contact with the ground."""
        contact = root.find("contact")
        contact = ET.SubElement(root, "contact") if contact is None else contact
        solref = numbers(2 * self.timestep, 1)
        ET.SubElement(contact, "pair", name=LANDING, geom1=LANDING, geom2=PROJECTILE, solref=solref, condim="3")
        equality = root.find("equality")
        equality = ET.SubElement(root, "equality") if equality is None else equality
        ET.SubElement(
            equality, "connect", name=HOLD, site1=PROJECTILE, site2=self.marker.name,
            solref=solref, solimp="0.9999 0.9999 0.001 0.5 2",
        )  # fmt: skip


def throw(model: Any, data: Any, release_time: float | None = None, longest: float = 60.0) -> float:
    """Step a model written with `throw=True` to the release, let the projectile go, and step until it lands.

    Args:
        model: a `mujoco.MjModel`.
        data: its `mujoco.MjData`, at the start or any time before the release.
        release_time: when it is let go [s]; that of the keyframe `launch` if left out.
        longest: time after which it must have landed [s].

    Returns:
        Where it lands, x [m].

    Raises:
        InputError: it has not landed by then.
    """
    mujoco: Any = importlib.import_module("mujoco")
    at = float(model.key("launch").time[0]) if release_time is None else release_time
    while data.time < at:
        mujoco.mj_step(model, data)
    data.eq_active[model.equality(HOLD).id] = 0
    pair = model.pair(LANDING)
    wanted = {int(pair.geom1[0]), int(pair.geom2[0])}
    while not data.ncon or not any(set(contact.geom.tolist()) == wanted for contact in data.contact):
        if data.time > longest:
            raise InputError(f"the projectile has not landed by {longest:g} s.")
        mujoco.mj_step(model, data)
    return float(data.body(PROJECTILE).xpos[0])
