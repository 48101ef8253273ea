"""What is built of a mechanism in a Chipmunk space: its bodies, rods, stops and loads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pymunk
from pymunk import constraints

from ...models.arrays import FloatArray
from ...models.joints import GROUND
from ...models.mechanism import Mechanism
from .loads import Loads
from .welds import Placement


@dataclass
class Part:
    """How a body of the mechanism is represented in the space."""

    name: str
    body: pymunk.Body
    reference: complex
    """The engine body's centre, in the mechanism's body frame [m]."""
    pin: complex
    """Where the body is pinned, in its own frame [m]."""
    turns: bool
    """Whether the engine body's angle is that of the mechanism's; a bob has none of its own."""


@dataclass
class Rod:
    """A PinJoint and its two ends; None is the ground."""

    joint: constraints.PinJoint
    a: pymunk.Body | None
    b: pymunk.Body | None
    end_a: tuple[float, float]
    end_b: tuple[float, float]
    length: float
    """[m]"""
    axis: complex | None = None
    """Direction in the frame of a of the line along which the end on a follows the other one; None if it is fixed."""


@dataclass
class Assembly:
    """A space with what is needed to step and to read it."""

    space: pymunk.Space
    mechanism: Mechanism
    rigid: Mechanism
    """The mechanism with each group of welded bodies as one body: what the space is made of."""
    placements: Mapping[str, Placement]
    """Of all bodies of the mechanism in those."""
    parts: dict[str, Part] = field(default_factory=dict[str, Part])
    """In the order of the bodies of `rigid`."""
    rods: list[Rod] = field(default_factory=list[Rod])
    stops: dict[str, constraints.Constraint] = field(
        default_factory=dict[str, constraints.Constraint]
    )
    loads: Loads | None = None
    """What acts besides joints, springs and gravity; None if nothing does."""

    @property
    def bodies(self) -> list[pymunk.Body]:
        """Engine bodies in the order of the parts."""
        return [part.body for part in self.parts.values()]

    def end(self, name: str, point: complex) -> tuple[pymunk.Body | None, tuple[float, float]]:
        """A point of a body (or of the ground) as an end of a joint: engine body and anchor; None is the ground."""
        if name == GROUND:
            return None, (point.real, point.imag)
        part = self.parts[name]
        arm = point - part.reference
        return part.body, (arm.real, arm.imag)

    @property
    def rates(self) -> FloatArray:
        """Velocities and angular velocities of the bodies, shape (n_bodies, 3); can be set."""
        return np.array([[*body.velocity, body.angular_velocity] for body in self.bodies])

    @rates.setter
    def rates(self, rates: FloatArray) -> None:
        for body, (x, y, spin) in zip(self.bodies, rates.tolist(), strict=True):
            body.velocity, body.angular_velocity = (x, y), spin
