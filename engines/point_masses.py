"""Mechanisms without point masses, for engines that cannot move a body without inertia.

An engine in Cartesian coordinates divides by each body's inertia about its centre of mass. Giving a
point mass a little inertia changes the motion. Moving mass along a pin does not: two bodies share
the pin's point, so that a mass m more on the one and m less on the other have the same kinetic
energy and the same power of gravity in every motion the joint permits. A body of mass M whose pin
is at the distance d from its centre of mass gains M m / (M + m) d^2 by it about its new centre of
mass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from pydantic import Field

from ..models.arrays import FloatArray
from ..models.elements import GROUND, PinJoint
from ..models.errors import UnsupportedProblemError
from ..models.mechanism import Body, Mechanism
from ..models.spec import Vector

LeastInertia = Annotated[
    float | None,
    Field(
        gt=0.0, le=0.1,
        description="of a body about its centre of mass, as a part of m d^2, d the distance of "
        "its pin: what is missing is made up by mass moved along the pin, which changes no "
        "motion; None: bodies are as they are, and point masses alone get some",
    ),
]  # fmt: skip
"""An engine's option; None: as :func:`spread_masses` says."""

_ADDED = 1e-5
"""Least inertia in all cases, of m d^2; for a body without a pin it changes the motion."""
_LENT = 0.5  # most that a body gives of its mass and of its inertia for one pin
_OF_POINTS = 0.1  # greatest :data:`LeastInertia`


@dataclass
class NoPointMasses:
    """A mechanism of the same motion, whose bodies have inertia.

    Joints, stops, force elements, markers and coordinates are those of the mechanism; masses,
    inertias and centres of mass of its bodies are others, and so are the reactions of pins along
    which mass was moved (:meth:`reaction` has the original's) and the zero of the potential energy
    (:attr:`extra_potential_energy`).

    Args:
        original: any mechanism.
        least: see :data:`LeastInertia`; at most this much is made up for, less where the other body
            is too light.
        points_only: whether bodies that have any inertia keep theirs, however little it is.
    """

    original: Mechanism
    least: float
    points_only: bool = False
    mechanism: Mechanism = field(init=False)
    moved: dict[str, float] = field(init=False)
    """By the pin's name: the mass that its child has gained, and its parent lost [kg]."""
    added: dict[str, float] = field(init=False)
    """By the body's name: inertia that no pin could bring, which changes the motion [kg m^2]."""

    def __post_init__(self) -> None:
        """Move the masses outwards from the ground: a body has its inertia before it lends any."""
        bodies = {body.name: body for body in self.original.bodies}
        self.moved, self.added = {}, {}
        for name in bodies:
            self._fill_up(name, bodies)
        for body in bodies.values():
            points = [
                joint.child_point for joint in self.original.joints if joint.child == body.name
            ]
            points += [
                joint.parent_point for joint in self.original.joints if joint.parent == body.name
            ]
            reach2 = max(_distance2(body, point) for point in points) or 1.0
            least = _ADDED * body.mass * reach2
            if body.inertia < least and not self._keeps(body):
                bodies[body.name] = body.model_copy(update={"inertia": least})
                self.added[body.name] = least - body.inertia
        # Not validated: what it is made of was.
        self.mechanism = self.original.model_copy(update={"bodies": tuple(bodies.values())})

    @property
    def extra_potential_energy(self) -> float:
        """Potential energy of this mechanism less that of the original one [J].

        It is the same at all times: mass that was moved to a body along a pin in the ground has
        come from the ground, and its weight acts at the pin. Subtract it from the potential
        energy that is read from this mechanism. The kinetic energy is the original's.
        """
        weight = np.zeros(2)
        for joint in self.original.joints:
            if joint.parent == GROUND:
                weight += self.moved.get(joint.name, 0.0) * np.array(joint.parent_point)
        return -float(weight @ np.array(self.original.gravity_vector))

    def reaction(self, joint: str, force: FloatArray, acceleration: FloatArray) -> FloatArray:
        """A joint's force on its child in the original mechanism [N].

        Args:
            joint: its name.
            force: the same force in this mechanism, in the world's frame [N], shape (2,).
            acceleration: of the joint's point, in the world's frame [m/s^2], shape (2,).
        """
        return force - self.moved.get(joint, 0.0) * (
            acceleration - np.array(self.original.gravity_vector)
        )

    def _keeps(self, body: Body) -> bool:
        """Tell whether a body keeps what inertia it has."""
        return self.points_only and body.inertia > 0

    def _fill_up(self, name: str, bodies: dict[str, Body]) -> None:
        """Move mass to a body along the first of its pins that can bring inertia."""
        if self._keeps(bodies[name]):
            return
        for joint in self.original.joints:
            body = bodies[name]
            distance2 = _distance2(body, joint.child_point)
            if joint.child != name or not isinstance(joint, PinJoint) or not distance2:
                continue
            # Mass that the joint's parent can lend at it [kg].
            most = np.inf
            if joint.parent != GROUND:
                parent = bodies[joint.parent]
                parent2 = _distance2(parent, joint.parent_point)
                reduced = _LENT * parent.inertia / parent2 if parent2 else np.inf
                spare = parent.mass / (parent.mass / reduced + 1.0) if reduced else 0.0
                most = min(_LENT * parent.mass, spare)
            missing = self.least * body.mass - body.inertia / distance2
            lent = min(body.mass * missing / (body.mass - missing), most)
            if missing > 0.0 and lent > 0.0:
                bodies[name] = _with_mass(body, lent, joint.child_point)
                if joint.parent != GROUND:
                    bodies[joint.parent] = _with_mass(
                        bodies[joint.parent], -lent, joint.parent_point
                    )
                self.moved[joint.name] = lent
                return


def spread_masses(mechanism: Mechanism, least: float | None, engine: str) -> NoPointMasses:
    """The mechanism of the same motion that an engine is given.

    Args:
        mechanism: any.
        least: inertia that each body gets, see :data:`LeastInertia`. None: point masses alone get
            some, a part of that of what turns with them or by mass moved along their pins, and all
            other bodies are as they are.
        engine: its name, for messages.

    Raises:
        UnsupportedProblemError: `least` is None, and a point mass has no pin.
    """
    if least is not None:
        return NoPointMasses(mechanism, least)
    made = NoPointMasses(shared_inertia(mechanism), _OF_POINTS, points_only=True)
    for name in made.added:
        raise UnsupportedProblemError(
            f"our adapter gives a point mass the moment that bodies of {engine} need by mass moved "
            f"along its pin; {name!r} has no pin that it could be moved along."
        )
    return made


def spreads_masses(mechanism: Mechanism) -> bool:
    """Tell whether :data:`LeastInertia` can change what an engine is given of a mechanism."""
    return bool(NoPointMasses(mechanism, _OF_POINTS).mechanism != mechanism)


def shared_inertia(mechanism: Mechanism) -> Mechanism:
    """The mechanism with point masses that have a part of the inertia that turns with them.

    Where bodies turn together only its sum counts; where they do not turn it counts for nothing.
    """
    together: dict[int | None, list[Body]] = {}
    for body in mechanism.bodies:
        together.setdefault(mechanism.attitudes[body.name][0], []).append(body)
    inertias: dict[str, float] = {}
    for index, group in together.items():
        share = math.fsum(body.inertia for body in group) / len(group)
        for body in group:
            inertias[body.name] = body.inertia
            if index is None:
                inertias[body.name] = body.inertia or body.mass
            elif any(other.inertia == 0 for other in group):
                inertias[body.name] = share
    bodies = (b.model_copy(update={"inertia": inertias[b.name]}) for b in mechanism.bodies)
    return mechanism.model_copy(update={"bodies": tuple(bodies)})


def _distance2(body: Body, point: Vector) -> float:
    """Square of the distance of a body's point from its centre of mass [m^2]."""
    return (point[0] - body.centre[0]) ** 2 + (point[1] - body.centre[1]) ** 2


def _with_mass(body: Body, mass: float, point: Vector) -> Body:
    """The body with a mass more at a point of it [kg]."""
    total = body.mass + mass
    x, y = ((body.mass * c + mass * p) / total for c, p in zip(body.centre, point, strict=True))
    inertia = body.inertia + body.mass * mass / total * _distance2(body, point)
    return body.model_copy(update={"mass": total, "centre": (x, y), "inertia": inertia})
