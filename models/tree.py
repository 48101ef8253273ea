"""The tree of a mechanism: joints that carry bodies, coordinates, positions of bodies."""

from __future__ import annotations

import cmath
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from .elements import GROUND, AnyJoint
from .spec import Vector


@dataclass(frozen=True)
class Slide:
    """A slide coordinate of the tree: distance of a joint's child point along a direction."""

    coordinate: str
    joint: AnyJoint
    direction: complex
    """Unit vector in the frame of the joint's parent."""


@dataclass(frozen=True)
class Configuration:
    """Positions of the bodies (and the ground) in one position of the mechanism."""

    angles: dict[str, float]
    """[rad]"""
    carried: dict[str, tuple[complex, complex]]
    """The point of each body that its joint carries: in the world and in the body's frame [m]."""

    def point(self, body: str, point: Vector) -> complex:
        """World position of a body's point, x + i y [m]."""
        at, body_point = self.carried[body]
        return at + (complex(*point) - body_point) * cmath.exp(-1j * self.angles[body])


@dataclass(frozen=True)
class Tree:
    """Structure of a mechanism's bodies and joints, computed once."""

    angle_names: Mapping[str, str | None]
    """Name of each body's angle coordinate, parents before children."""
    all_joints: tuple[AnyJoint, ...]

    @cached_property
    def joints(self) -> tuple[AnyJoint, ...]:
        """Each body's joint to its parent, in the order of the bodies."""
        first = {joint.child: joint for joint in reversed(self.all_joints)}
        return tuple(first[body] for body in self.angle_names)

    @cached_property
    def loop_joints(self) -> tuple[AnyJoint, ...]:
        """Joints that close a loop."""
        names = {joint.name for joint in self.joints}
        return tuple(joint for joint in self.all_joints if joint.name not in names)

    @cached_property
    def angles(self) -> tuple[str, ...]:
        """Names of the angle coordinates, the first of q."""
        return tuple(angle for angle in self.angle_names.values() if angle is not None)

    @cached_property
    def slides(self) -> tuple[Slide, ...]:
        """The slide coordinates, the last of q."""
        return tuple(
            Slide(name, joint, direction)
            for joint in self.joints
            for name, direction in zip(joint.slides, joint.free_directions, strict=True)
        )

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        """Names of q, in order."""
        return self.angles + tuple(slide.coordinate for slide in self.slides)

    @cached_property
    def attitudes(self) -> dict[str, tuple[int | None, float]]:
        """Index of the angle that each body (and the ground) turns with, plus a constant [rad].

        No index: it does not turn.
        """
        indices = {name: i for i, name in enumerate(self.angles)}
        attitudes: dict[str, tuple[int | None, float]] = {GROUND: (None, 0.0)}
        for (body, angle), joint in zip(self.angle_names.items(), self.joints, strict=True):
            if joint.turned_by is None:
                attitudes[body] = (indices[angle or ""], 0.0)
            else:
                index, turned = attitudes[joint.parent]
                attitudes[body] = (index, turned + joint.turned_by)
        return attitudes

    def configuration(self, q: Sequence[float]) -> Configuration:
        """Positions of the bodies, from the ground outwards.

        Args:
            q: coordinates [rad or m].
        """
        values = dict(zip(self.coordinates, q, strict=True))
        angles = {
            body: turned if index is None else q[index] + turned
            for body, (index, turned) in self.attitudes.items()
        }
        configuration = Configuration(angles, {GROUND: (0j, 0j)})
        for joint in self.joints:
            at = configuration.point(joint.parent, joint.parent_point)
            turned = cmath.exp(-1j * angles[joint.parent])
            for name, direction in zip(joint.slides, joint.free_directions, strict=True):
                at += values[name] * direction * turned
            configuration.carried[joint.child] = at, complex(*joint.child_point)
        return configuration
