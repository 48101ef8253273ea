"""Variants of a mechanism's MJCF: without sensors, with finite inertias, or with the throw.

Finite inertia costs nothing where a body hangs on a pin. Mass that is moved from the parent's end
of the pin to the child's leaves the equations of motion as they are, and with its mass and centre
the child's inertia changes: its mass m, first moment S and second moment J about the pin give the
inertia J - S^2 / m, which grows with m (these are the regrouped inertial parameters of robot
identification; Gautier and Khalil, IEEE Trans. Robot. Autom. 6 (1990) 368).

In the throw an equality ties the projectile to the machine until its release. Until then the
machine shall move as the model without it. MuJoCo's equalities are soft: what hangs on one with its
weight moves otherwise, and contacts of the sling, whose softness follows from its mass, lose and
find their walls in other steps. So the machine keeps the projectile's mass, but for a millionth,
and that is what hangs on the equality. :func:`released` gives the projectile its mass, and the
machine what is left; its flight does not depend on it.

The projectile's joints are slides in the frame of the body that carries it, on which they are at
rest at zero in all stages of a step. Tied to a point of the world it would be off by what the
stages of RK4 differ in the two sets of coordinates, some 1e-6 m at a step of 1 ms.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import takewhile
from typing import Any

from ..elements import GROUND
from ..errors import InputError, UnsupportedProblemError
from ..mechanism import Marker, Mechanism
from ..spec import Vector
from .tree import add, from_origin, joints_of, outwards

POINT_INERTIA = 2e-15
"""Moment of inertia that stands for none [kg m^2]: twice the least that MuJoCo takes (mjMINVAL).

It counts relative to m r^2: 1e-6 costs 1.6e-8 m on Table I, 1e-12 shows in the model of a machine
of a few grams.
"""
_SHARE = 1e-3  # least moment of inertia, in parts of the second moment about the body's pin


@dataclass(frozen=True)
class Numerics:
    """MuJoCo's numerical options in a file; None: not written, so that its own default holds."""

    timestep: float | None = None  # [s]
    integrator: str | None = None
    solver: str | None = None
    tolerance: float | None = None
    iterations: int | None = None
    solref: tuple[float, float] | None = None
    """Softness of limits, as MuJoCo reads it: time constant [s] and ratio, or both negative."""
    solref_of_points: tuple[float, float] | None = None
    """Of contacts and equalities."""
    solimp: tuple[float, ...] | None = None
    margin: float | None = None
    """Distance from a limit below which it acts [rad]; strictly below, so 0 misses the start."""
    margin_of_slots: float | None = None
    """Distance below which both sides of a slot that closes a loop push [m]."""


@dataclass(frozen=True)
class Variant:
    """Differences from the committed files."""

    numerics: Numerics | None = None
    """Numerical options; None: those that follow from the time step."""

    sensors: bool = True
    """Sensors alone ask for MuJoCo 3.3."""
    finite_inertia: bool = False
    """Whether point masses on pins get an inertia; the motion is the same, pin forces differ."""
    throw: bool = False
    """Whether the projectile is a body tied by an equality that :func:`throw` releases."""


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
        place = from_origin(origin, (self.centre.real, self.centre.imag))
        inertia = max(self.inertia, POINT_INERTIA)
        add(element, "inertial", pos=place, mass=self.mass, diaginertia=(inertia,) * 3)

    def second_moment(self, point: complex) -> float:
        """About a point [kg m^2]."""
        return self.inertia + self.mass * abs(self.centre - point) ** 2


def inertias(mechanism: Mechanism, variant: Variant) -> dict[str, MassProperties]:
    """Mass, centre and inertia of each body by name, as they are written."""
    properties = {
        body.name: MassProperties(body.mass, complex(*body.centre), body.inertia)
        for body in mechanism.bodies
    }
    if not variant.finite_inertia:
        return properties
    for body in reversed(mechanism.bodies):
        joint = mechanism.joint_of(body.name)
        child, at = properties[body.name], complex(*joint.child_point)
        needed = _SHARE * child.second_moment(at)
        if joint.kind != "pin" or child.inertia >= needed:
            continue
        # As much mass moves from the parent to the child as gives the child its least inertia. Not
        # if the parent then had a negative inertia that it could not get from the ground: the third
        # point mass of a chain stays one.
        first = child.mass * abs(child.centre - at)
        moved = first**2 / (child.second_moment(at) - needed) - child.mass
        if joint.parent != GROUND:
            smaller = properties[joint.parent].with_mass_at(complex(*joint.parent_point), -moved)
            carrier = mechanism.joint_of(joint.parent)
            from_ground = carrier.kind == "pin" and carrier.parent == GROUND
            if smaller.mass <= 0 or (smaller.inertia <= 0 and not from_ground):
                continue
            properties[joint.parent] = smaller
        properties[body.name] = child.with_mass_at(at, moved)
    return properties


PROJECTILE, HOLD, LANDING = "thrown_projectile", "hold_projectile", "landing_ground"
"""Names of the body and its ball, of the equality, and of the plane that it lands on."""

HANDED_OVER = "thrown_mass"
"""Name of the number for the mass that the machine hands over to the projectile [kg]."""

_KEPT = 0.1  # of the projectile's mass, by a sling that has no other
_TIED = 1e-6  # of the mass that is thrown, on the equality


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
            raise UnsupportedProblemError(
                f"{self.mechanism.name!r} has no marker 'projectile' with a mass to throw."
            )
        return marker

    @cached_property
    def mass(self) -> float:
        """Mass of the body that flies [kg]."""
        mass = self.mechanism.thrown_mass(self.marker) or 0.0
        whole = self.mechanism.body(self.marker.body).mass
        return mass if mass < (1 - _KEPT) * whole else (1 - _KEPT) * mass

    @cached_property
    def tied(self) -> MassProperties:
        """The part of it that the equality holds."""
        return MassProperties(_TIED * self.mass, 0j, 0.0)

    def take_from(self, inertias: dict[str, MassProperties]) -> None:
        """Take what is tied from the body that carries it."""
        body, point = self.marker.body, complex(*self.marker.point)
        lighter = inertias[body].with_mass_at(point, -self.tied.mass)
        if not inertias[body].inertia:
            lighter = MassProperties(lighter.mass, point, 0.0)
        inertias[body] = lighter

    def with_its_own(self, values: Sequence[float]) -> list[float]:
        """Positions or speeds of MuJoCo's joints with those of the projectile, which are zero."""
        bodies = [body.name for body in outwards(self.mechanism)]
        before = [*takewhile(lambda name: name != self.marker.body, bodies), self.marker.body]
        n = sum(len(joints_of(self.mechanism.joint_of(name))) for name in before)
        return [*values[:n], 0.0, 0.0, *values[n:]]

    def add_body(self, element: ET.Element, body: str, radius: float, look: str) -> None:
        """Fix the projectile, which does not turn, on the body that carries it."""
        if body != self.marker.body:
            return
        origin = self.mechanism.joint_of(body).child_point
        ball = add(element, "body", name=PROJECTILE, pos=from_origin(origin, self.marker.point))
        self.tied.add_to(ball, (0.0, 0.0))
        for axis, way in (("x", "1 0 0"), ("z", "0 0 1")):
            add(ball, "joint", name=f"{PROJECTILE}_{axis}", type="slide", axis=way)
        add(ball, "site", name=PROJECTILE)
        add(ball, "geom", name=PROJECTILE, type="sphere", size=radius, rgba=look)

    def add_ground(self, world: ET.Element, level: float) -> None:
        """The ground that it lands on, at a height [m]."""
        place = (0, 0, level)
        add(world, "geom", group="4", name=LANDING, type="plane", pos=place, size="0 0 1")

    def add_constraints(self, root: ET.Element) -> None:
        """The equality, the contact with the ground, and the mass that is handed over."""
        contact, equality = root.find("contact"), root.find("equality")
        if contact is None:
            contact = add(root, "contact")
        soft, pair = (2 * self.timestep, 1), {"geom1": LANDING, "geom2": PROJECTILE}
        add(contact, "pair", {"name": LANDING} | pair, solref=soft, condim="3")
        if equality is None:
            equality = add(root, "equality")
        add(
            equality, "connect", name=HOLD, site1=PROJECTILE, site2=self.marker.name,
            solref=(-1 / self.timestep**2, -2 / self.timestep),
            solimp="0.9999 0.9999 0.001 0.5 2",
        )  # fmt: skip
        custom = add(root, "custom")
        add(custom, "numeric", name=HANDED_OVER, data=self.mass - self.tied.mass)


def _mujoco() -> Any:
    """MuJoCo, which has no types; imported where it is needed, as MJCF is written without it."""
    import mujoco

    return mujoco


def released(model: Any, data: Any) -> Any:
    """Release the projectile of a model written with `throw=True`, and hand over its mass.

    Args:
        model: a `mujoco.MjModel`; it stays as it is.
        data: its `mujoco.MjData`, whose equality is switched off.

    Returns:
        The model to go on with: the projectile has its mass, and the machine has it no longer.
    """
    mujoco = _mujoco()
    data.eq_active[model.equality(HOLD).id] = 0
    ball, handed = model.body(PROJECTILE).id, float(model.numeric(HANDED_OVER).data[0])
    carrier, after = int(model.body_parentid[ball]), copy.copy(model)
    place, middle = model.body_pos[ball], model.body_ipos[carrier]
    at, centre = complex(place[0], place[2]), complex(middle[0], middle[2])
    mass, inertia = float(model.body_mass[carrier]), float(model.body_inertia[carrier, 1])
    whole = MassProperties(mass, centre, inertia)
    left = whole.with_mass_at(at, -handed)
    after.body_mass[[carrier, ball]] = left.mass, model.body_mass[ball] + handed
    after.body_ipos[carrier] = left.centre.real, 0.0, left.centre.imag
    after.body_inertia[carrier] = max(left.inertia, POINT_INERTIA)
    after.body_sameframe[carrier] = 0
    mujoco.mj_setConst(after, mujoco.MjData(after))
    return after


def throw(model: Any, data: Any, release_time: float | None = None, longest: float = 60.0) -> float:
    """Step a model written with `throw=True` to the release, and on until its projectile lands.

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
    mujoco = _mujoco()
    at = float(model.key("launch").time[0]) if release_time is None else release_time
    while data.time < at:
        mujoco.mj_step(model, data)
    after, pair = released(model, data), model.pair(LANDING)
    wanted = {int(pair.geom1[0]), int(pair.geom2[0])}
    while not data.ncon or not any(
        set(contact.geom.tolist()) == wanted for contact in data.contact
    ):
        if data.time > longest:
            raise InputError(f"the projectile has not landed by {longest:g} s.")
        mujoco.mj_step(after, data)
    return float(data.body(PROJECTILE).xpos[0])
