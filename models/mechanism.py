"""A planar mechanism, described once and without any engine.

World: x to the right, y up. A body's frame coincides with the world's at angle zero; angles are
absolute, from +x, positive **clockwise** (the paper's convention), so a body point (a, b) stands at
(a cos q + b sin q, -a sin q + b cos q) from the frame's origin.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from .arrays import FloatArray, IndexArray
from .elements import (
    GROUND,
    AnyElement,
    AnyJoint,
    AnyStop,
    Coupler,
    ForceElement,
    Joint,
    PointStop,
    Stop,
)
from .elements.base import refuse_other_lengths
from .model_source import ModelSource
from .shown import Shown
from .spec import Name, NonNegative, Positive, Real, Spec, Vector, schema_text

_DOWNWARDS = (0.0, -1.0)
_CLOSED_GAP = 1e-12  # [rad], [m per m] a start gap below this is rounding, not an opening


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
    """Joints that carry bodies, joints that close loops, coordinates; computed once."""

    angle_names: Mapping[str, str | None]
    """Name of each body's angle coordinate, parents before children."""
    all_joints: tuple[AnyJoint, ...]

    @cached_property
    def joints(self) -> tuple[AnyJoint, ...]:
        """Joints of the bodies to their parents, in the order of the bodies."""
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


class Body(Spec):
    """A rigid body; its coordinate is its absolute angle, if its joint in the tree lets it turn."""

    name: Name
    angle: Name | None = Field(
        default=None,
        exclude_if=lambda name: name is None,
        description="name of its angle coordinate; none where its joint in the tree holds its "
        "angle",
    )
    mass: Positive = Field(description="[kg]")
    centre: Vector = Field(description="centre of mass in the body's frame [m]")
    inertia: NonNegative = Field(
        description="about the centre of mass [kg m^2]; 0 for a point mass"
    )


class Marker(Spec):
    """A named point of a body."""

    name: Name
    body: Name
    point: Vector = Field(description="in the body's frame [m]")
    mass: Positive | None = Field(
        default=None,
        description="what leaves the machine there, if it is not the whole body [kg]; "
        "part of the body's",
    )


class Mechanism(Shown, Spec):
    """Bodies, joints, stops, force elements, couplers, markers, gravity and the start.

    Bodies stand in an order in which each one's first joint as a child leads to the ground or to an
    earlier
    body: those joints make the tree, any further joint closes a loop. Coordinates q are the angles
    of the bodies that have one [rad] in that order, then the slides of the tree's joints [m] in the
    order of the bodies.

    Raises:
        InputError: names clash or point nowhere, the tree is broken, or a stop's `closed` belies
            its gap.
    """

    largest_file: ClassVar[int] = 1_000_000  # some five thousand bodies
    not_content: ClassVar[frozenset[str]] = frozenset({"source"})

    name: Name
    bodies: tuple[Body, ...] = Field(min_length=1)
    joints: tuple[Joint, ...] = Field(min_length=1)
    stops: tuple[AnyStop, ...] = ()
    markers: tuple[Marker, ...] = ()
    force_elements: tuple[ForceElement, ...] = Field(
        default=(), exclude_if=lambda elements: not elements
    )
    couplers: tuple[Coupler, ...] = Field(default=(), exclude_if=lambda couplers: not couplers)
    gravity: NonNegative = Field(description="its size [m/s^2]")
    gravity_direction: Vector = Field(
        default=_DOWNWARDS,
        exclude_if=lambda direction: direction == _DOWNWARDS,
        description="length 1",
    )
    start: tuple[Real, ...] = Field(description="q at t = 0 [rad or m]")
    start_speeds: tuple[Real, ...] = Field(
        default=(), description="u at t = 0 [rad/s or m/s]; empty: at rest"
    )
    source: ModelSource | None = Field(
        default=None,
        exclude_if=lambda source: source is None,
        description="the model file that it was read from; the preset `given` moves that file",
    )

    def headline(self) -> str:
        """Its name, and how many of what it has."""
        counts = {
            ("body", "bodies"): len(self.bodies),
            ("joint", "joints"): len(self.joints),
            ("stop", "stops"): len(self.stops),
            ("force element", "force elements"): len(self.force_elements),
            ("coupler", "couplers"): len(self.couplers),
        }
        parts = [f"{n} {names[0 if n == 1 else 1]}" for names, n in counts.items() if n]
        coordinates = ", ".join(self.coordinates)
        return f"Mechanism {self.name!r}: {', '.join(parts)}; coordinates {coordinates}"

    def facts(self) -> Iterator[tuple[str, str]]:
        """Its elements by name."""
        start = zip(self.coordinates, self.start, strict=True)
        stops = [f"{stop.name} ({'closed' if stop.closed else 'open'})" for stop in self.stops]
        yield "bodies", ", ".join(f"{body.name} ({body.mass:g} kg)" for body in self.bodies)
        yield "joints", ", ".join(f"{joint.name} ({joint.kind})" for joint in self.joints)
        yield "stops", ", ".join(stops)
        yield "force elements", ", ".join(f"{e.name} ({e.kind})" for e in self.force_elements)
        if self.couplers:
            yield "couplers", ", ".join(coupler.name for coupler in self.couplers)
        yield "markers", ", ".join(marker.name for marker in self.markers)
        yield "start", ", ".join(f"{name} = {value:.6g}" for name, value in start)
        yield "hash", self.content_hash[:16]
        if self.source is not None:
            yield "read from", str(self.source.path or "a text")

    @property
    def tree(self) -> Tree:
        """Its joints and coordinates."""
        return self._tree

    @cached_property
    def _tree(self) -> Tree:  # no field has this name: `dict` of a mechanism has its fields alone
        return Tree({body.name: body.angle for body in self.bodies}, self.joints)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with some fields changed; pydantic's own would keep the tree of the original."""
        copied = super().model_copy(update=update, deep=deep)
        vars(copied).pop("_tree", None)
        return copied

    @property
    def angles(self) -> tuple[str, ...]:
        """Names of the angle coordinates, the first of q."""
        return self.tree.angles

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of q, in order."""
        return self.tree.coordinates

    @property
    def slides(self) -> tuple[Slide, ...]:
        """The slide coordinates, the last of q."""
        return self.tree.slides

    @property
    def attitudes(self) -> dict[str, tuple[int | None, float]]:
        """Angle that each body (and the ground) turns with, as :attr:`Tree.attitudes`."""
        return self.tree.attitudes

    @property
    def elements(self) -> tuple[AnyElement, ...]:
        """Its joints, stops, force elements and couplers."""
        return (*self.joints, *self.stops, *self.force_elements, *self.couplers)

    @property
    def instants(self) -> tuple[float, ...]:
        """Times at which the law of an element changes, ascending [s]; none usually."""
        return tuple(sorted({t for element in self.force_elements for t in element.instants}))

    def at(self, t: float) -> Self:
        """The mechanism with the laws that act from a time [s] to the next instant.

        Its start stays the same.
        """
        elements = tuple(element.at(t) for element in self.force_elements)
        return self.model_copy(update={"force_elements": elements})

    def at_times(self, t: FloatArray) -> Iterator[tuple[IndexArray, Self]]:
        """Indices of times (n,) [s] between the same instants, and the mechanism as of :meth:`at`.

        All of them and this one, where no law changes.
        """
        if not self.instants:
            yield np.arange(len(t)), self
            return
        stages = np.searchsorted(self.instants, t, side="right")
        for stage in np.unique(stages).tolist():
            yield np.flatnonzero(stages == stage), self.at((0.0, *self.instants)[stage])

    @property
    def gravity_vector(self) -> Vector:
        """Acceleration of gravity [m/s^2]."""
        return self.gravity * self.gravity_direction[0], self.gravity * self.gravity_direction[1]

    @property
    def tree_joints(self) -> tuple[AnyJoint, ...]:
        """Joints of the bodies in the tree, to their parents, in the order of the bodies."""
        return self.tree.joints

    @property
    def loop_joints(self) -> tuple[AnyJoint, ...]:
        """Joints that close a loop."""
        return self.tree.loop_joints

    @property
    def bound_by(self) -> tuple[str, ...]:
        """Names of what binds its coordinates to each other: loop joints and couplers."""
        return tuple(each.name for each in (*self.loop_joints, *self.couplers))

    @property
    def coupler_residual(self) -> dict[str, float]:
        """Error of each coupler's coordinate at the start [rad or m]."""
        start = dict(zip(self.coordinates, self.start, strict=True))
        return {
            coupler.name: sum(weight * start[name] for name, weight in coupler.weights.items())
            - coupler.offset
            for coupler in self.couplers
        }

    @property
    def loop_closure_residual(self) -> dict[str, float]:
        """Distance of the points of each loop joint at the start, along what it holds [m]."""
        start, residuals = self.tree.configuration(self.start), dict[str, float]()
        for joint in self.loop_joints:
            vector = start.point(joint.child, joint.child_point)
            vector -= start.point(joint.parent, joint.parent_point)
            vector *= cmath.exp(1j * start.angles[joint.parent])
            components = [(vector * d.conjugate()).real for d in joint.held_directions]
            residuals[joint.name] = math.hypot(*components)
        return residuals

    @property
    def loop_angle_residual(self) -> dict[str, float]:
        """Error of each angle that a loop joint holds at the start, without full turns [rad]."""
        angles, residuals = self.tree.configuration(self.start).angles, dict[str, float]()
        for joint in self.loop_joints:
            if joint.turned_by is not None:
                error = angles[joint.child] - angles[joint.parent] - joint.turned_by
                residuals[joint.name] = abs(math.remainder(error, 2 * math.pi))
        return residuals

    @property
    def loops_apart(self) -> dict[str, float]:
        """Another name of :attr:`loop_closure_residual`."""
        return self.loop_closure_residual

    def slide(self, coordinate: str) -> Slide:
        """The slide of that coordinate."""
        return next(slide for slide in self.slides if slide.coordinate == coordinate)

    def body(self, name: str) -> Body:
        """The body of that name."""
        return next(body for body in self.bodies if body.name == name)

    def stop(self, name: str) -> Stop | PointStop:
        """The stop of that name."""
        return next(stop for stop in self.stops if stop.name == name)

    def marker(self, name: str) -> Marker | None:
        """The marker of that name; None if there is none."""
        return next((marker for marker in self.markers if marker.name == name), None)

    def joint_of(self, body: str) -> AnyJoint:
        """A body's joint in the tree, to its parent."""
        return next(joint for joint in self.joints if joint.child == body)

    def thrown_mass(self, marker: Marker) -> float | None:
        """Mass thrown at a marker [kg]: its own, or that of a point mass there; None: not known."""
        body = self.body(marker.body) if marker.body != GROUND else None
        if marker.mass is not None or body is None:
            return marker.mass
        return body.mass if body.centre == marker.point and body.inertia == 0 else None

    @property
    def force_unit(self) -> str:
        """Unit of the forces of the stops that are closed at the start."""
        units = dict.fromkeys(stop.force_unit for stop in self.stops if stop.closed)
        return " or ".join(units) or "N m"

    @property
    def angle_stops(self) -> tuple[Stop, ...]:
        """Stops on relative angles."""
        return tuple(stop for stop in self.stops if isinstance(stop, Stop))

    @property
    def point_stops(self) -> tuple[PointStop, ...]:
        """Stops on where a point may be."""
        return tuple(stop for stop in self.stops if isinstance(stop, PointStop))

    def children(self, name: str) -> tuple[Body, ...]:
        """Children of a body (or of the ground) in the tree."""
        return tuple(self.body(joint.child) for joint in self.tree_joints if joint.parent == name)

    def subtree(self, name: str) -> Iterator[Body]:
        """A body and all its descendants in the tree."""
        members = {name}
        for body, joint in zip(self.bodies, self.tree_joints, strict=True):
            if body.name in members or joint.parent in members:
                members.add(body.name)
                yield body

    @model_validator(mode="after")
    def _names_fit(self) -> Self:
        _refuse_repeats("body", (body.name for body in self.bodies))
        _refuse_repeats("joint", (joint.name for joint in self.joints))
        _refuse_repeats("stop", (stop.name for stop in self.stops))
        _refuse_repeats("marker", (marker.name for marker in self.markers))
        _refuse_repeats("force element", (element.name for element in self.force_elements))
        # Their multipliers stand beside those of joints.
        bound = (each.name for each in (*self.joints, *self.couplers))
        _refuse_repeats("joint or coupler", bound)
        refuse_other_lengths("gravity_direction", self.gravity_direction)
        for joint in self.joints:
            if joint.child == GROUND:
                raise ValueError(
                    f"joint {joint.name!r} has the ground as its child; "
                    "the ground can only be a parent"
                )
        known = {GROUND} | {body.name for body in self.bodies}
        used = [(f"joint {j.name!r}", name) for j in self.joints for name in j.bodies]
        used += [(f"stop {s.name!r}", name) for s in self.stops for name in s.bodies]
        used += [(f"marker {m.name!r}", m.body) for m in self.markers]
        for element in self.force_elements:
            used += [(f"force element {element.name!r}", name) for name in element.bodies]
        for user, name in used:
            if name not in known:
                raise ValueError(f"{user} names the body {name!r}; there are {sorted(known)}")
        return self

    @model_validator(mode="after")
    def _tree_holds(self) -> Self:
        placed = {GROUND}
        for body in self.bodies:
            joint = next((joint for joint in self.joints if joint.child == body.name), None)
            if joint is None:
                raise ValueError(f"body {body.name!r} hangs on no joint")
            if joint.parent not in placed:
                raise ValueError(
                    f"body {body.name!r} hangs on {joint.parent!r}, which must be listed before it"
                )
            if len(joint.slides) != len(joint.free_directions):
                raise ValueError(
                    f"joint {joint.name!r} carries a body and so needs a coordinate for its slide"
                )
            if joint.holds_angle != (body.angle is None):
                needs = "no angle of its own" if joint.holds_angle else "a name for its angle"
                raise ValueError(
                    f"body {body.name!r} hangs on the {joint.kind} joint {joint.name!r} "
                    f"and needs {needs}"
                )
            placed.add(body.name)
        for joint in self.loop_joints:
            if not joint.held_directions:
                raise ValueError(
                    f"{joint.kind} joint {joint.name!r} is not the first of {joint.child!r} "
                    "and so does nothing"
                )
            if joint.slides:
                raise ValueError(
                    f"joint {joint.name!r} closes a loop and so has no coordinate of its own"
                )
        _refuse_repeats("coordinate", self.coordinates)
        for element in self.force_elements:
            if element.body != GROUND:
                element.refuse_joint(self.joint_of(element.body))
        return self

    @model_validator(mode="after")
    def _couplers_fit(self) -> Self:
        for coupler in self.couplers:
            for name in coupler.coordinates:
                if name not in self.coordinates:
                    raise ValueError(
                        f"coupler {coupler.name!r} names the coordinate {name!r}; there are "
                        f"{sorted(self.coordinates)}"
                    )
        return self

    @model_validator(mode="after")
    def _start_fits(self) -> Self:
        names, n, n_speeds = self.coordinates, len(self.start), len(self.start_speeds)
        if n != len(names):
            raise ValueError(f"start has {n} values for {len(names)} coordinates {names}")
        if self.start_speeds and n_speeds != len(names):
            raise ValueError(f"start_speeds has {n_speeds} values for {len(names)} coordinates")
        start = self.tree.configuration(self.start)
        for stop in self.stops:
            # The farther the points are from the origin, the farther rounding moves the gap.
            sizes = [1.0]

            def position_of(body: str, point: Vector, sizes: list[float] = sizes) -> complex:
                at = start.point(body, point)
                sizes.append(abs(at))
                return at

            gap = stop.component(start.angles.__getitem__, position_of) - stop.position
            rounding, unit = _CLOSED_GAP * max(sizes), stop.gap_unit
            if stop.closed and abs(gap) > rounding:
                raise ValueError(
                    f"stop {stop.name!r} is closed, "
                    f"but its gap at the start is {gap:.3g} {unit}, not 0"
                )
            if not stop.closed and gap <= rounding:
                raise ValueError(
                    f"stop {stop.name!r} is open, "
                    f"but its gap at the start is {gap:.3g} {unit}, not positive"
                )
        for element in self.force_elements:
            element.refuse_start(start.angles.__getitem__, start.point)
        return self


def _refuse_repeats(what: str, names: Iterable[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen or name == GROUND:
            raise ValueError(f"{what} name {name!r} is used twice or reserved")
        seen.add(name)


def mechanism_schema() -> str:
    """JSON schema of a mechanism as text, as it stands in models/schemas/."""
    return schema_text(Mechanism)
