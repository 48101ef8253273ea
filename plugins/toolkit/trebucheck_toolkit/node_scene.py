"""Scene of a mechanism for engines of rigid bodies, in Cartesian coordinates.

Bodies stand about their centres of mass, and joints between them. Such engines' angles are
anticlockwise: the scene is the mirror image with y downwards, where clockwise ones are so. Every
body stands at the angle 0 at the start, so that its limits are measured from there, and no angle is
taken into half a turn where a body is made.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from trebucheck.engines.protocol import Capabilities
from trebucheck.engines.rotors import rotors_of
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import (
    GROUND,
    JOINTS,
    STOPS,
    AnyJoint,
    AnyStop,
    CubicTorsionSpring,
    ElementTable,
    FreeJoint,
    PinJoint,
    PointStop,
    PrismaticJoint,
    RecordedForce,
    RecordedTorque,
    RotorInertia,
    SlideInertia,
    SlideSpringDamper,
    SlotJoint,
    Stop,
    TranslationJoint,
    WeldJoint,
)
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.features import COVERED_BY_FEATURES, Basic, Feature
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import Vector

Json = dict[str, Any]
MIRROR = np.array([1.0, -1.0])
REFUSED: Mapping[type, str] = {
    CubicTorsionSpring: "its springs are linear",
    SlideInertia: "our adapter adds no inertia along slides",
    RecordedForce: "our adapter follows no record of efforts",
    RecordedTorque: "our adapter follows no record of efforts",
}
"""Force elements that programs of bodies do not have, each with the reason."""
BUILT: frozenset[type] = COVERED_BY_FEATURES | {RotorInertia, SlideSpringDamper}
"""Classes of elements that a scene and its programs build; an engine may lack joints of them."""


def body_capabilities(formulation: str, *without: Basic | Feature) -> Capabilities:
    """Capabilities of an engine of bodies that builds all that a scene has, and tells its forces.

    Args:
        formulation: coordinates and treatment of constraints, in a few words.
        without: elements that it cannot build, besides walls for points and restitution.
    """
    whole = Capabilities(
        joint_reactions=True,
        joint_gaps=True,
        located_releases=False,
        stop_laws=frozenset(StopLaw),
        formulation=formulation,
        features=frozenset(Feature) - {Feature.MOVING_WALL},
        elements=BUILT,
        lacking=frozenset({Basic.POINT_STOP, Basic.REBOUND}),
    )
    return whole.without(without)


def turned(angle: float | FloatArray, vector: FloatArray) -> FloatArray:
    """A mirrored vector turned by an angle, shape (..., 2)."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]], axis=-1)


def lawful_stops(problem: Problem) -> list[AnyStop]:
    """The stops that have a part in a problem: under release-once those that are closed."""
    once = problem.stop_law is StopLaw.RELEASE_ONCE
    return [stop for stop in problem.mechanism.stops if stop.closed or not once]


def joint_limits(
    problem: Problem, scene: NodeScene, *, within_half_a_turn: bool
) -> dict[int, tuple[float | None, float | None]]:
    """Limits of joints by their index, angles from the start [rad]; None: no limit on that side.

    Args:
        problem: for its stops and their law.
        scene: what is moved.
        within_half_a_turn: whether the engine knows no angle beyond.

    Raises:
        UnsupportedProblemError: the engine knows no angle beyond half a turn, and a stop is there.
    """
    ranges: dict[int, tuple[float | None, float | None]] = {}
    for stop in lawful_stops(problem):
        made = scene.stop(stop)
        joint, angle = made["joint"], made["angle"]
        if within_half_a_turn and abs(angle) >= math.pi:
            raise UnsupportedProblemError(
                f"our adapter sets limits of {scene.engine}'s joints within half a turn from the "
                f"start, as {scene.engine} knows an angle within that; stop {stop.name!r} is "
                f"{angle:.3g} rad from it."
            )
        low, high = ranges.get(joint, (None, None))
        if made["side"] > 0:
            low = angle if low is None else max(low, angle)
        else:
            high = angle if high is None else min(high, angle)
        ranges[joint] = low, high
    return ranges


class NodeScene:
    """A mechanism's scene.

    Args:
        mechanism: what is built; each body has an inertia.
        engine: its name, for messages.
    """

    def __init__(self, mechanism: Mechanism, engine: str) -> None:
        self.mechanism, self.engine = mechanism, engine
        self.kinematics, (self.q, self.u) = Kinematics(mechanism), initial_state(mechanism)
        self.index = {GROUND: -1} | {body.name: i for i, body in enumerate(mechanism.bodies)}
        self.angles = {
            name: float(self.kinematics.angle(name).value(self.q)) for name in self.index
        }
        self._rotors = rotors_of(mechanism, engine)
        self.bodies = [self._body(body) for body in mechanism.bodies]
        """Those that an engine needs besides come after the mechanism's."""
        self.others: list[str] = []
        """Names of those that come after."""
        self.joints: list[Json] = []
        self.pins: dict[tuple[str, str], int] = {}
        """Joints that carry limits, by the names of parent and child."""
        for joint in mechanism.joints:
            getattr(self, _JOINTS[joint])(joint, self._ends(joint))

    @property
    def names(self) -> list[str]:
        """Names of the bodies, in their order."""
        return [*(body.name for body in self.mechanism.bodies), *self.others]

    def offset(self, body: str, point: Vector) -> FloatArray:
        """Vector from a body's centre of mass to a point at the start; of the ground the point."""
        centre = (0.0, 0.0) if body == GROUND else self.mechanism.body(body).centre
        return turned(self.angles[body], np.subtract(point, centre) * MIRROR)

    def axis(self, joint: AnyJoint) -> FloatArray:
        """A slide's coordinate at the start."""
        direction = complex(joint.free_directions[0])
        return self.turned_at_start(joint.parent, (direction.real, direction.imag))

    def turned_at_start(self, body: str, vector: Vector) -> FloatArray:
        """A vector of a body's frame at the start."""
        return turned(self.angles[body], np.array(vector) * MIRROR)

    def _body(self, body: Body) -> Json:
        row = self.kinematics.point(body.name, body.centre)
        return {
            "position": (self.kinematics.position(row, self.q) * MIRROR).tolist(),
            "velocity": (self.kinematics.velocity(row, self.q, self.u) * MIRROR).tolist(),
            "speed": float(self.kinematics.angle(body.name).coefficients @ self.u),
            "mass": body.mass,
            "inertia": body.inertia + self._rotors.get(body.name, 0.0),
        }

    def _ends(self, joint: AnyJoint) -> Json:
        return {
            "a": self.index[joint.parent],
            "b": self.index[joint.child],
            "pointA": self.offset(joint.parent, joint.parent_point).tolist(),
            "pointB": self.offset(joint.child, joint.child_point).tolist(),
        }

    def _weld(self, joint: WeldJoint, ends: Json) -> None:
        self.joints.append(ends | {"kind": "weld"})

    def _slide(self, joint: PrismaticJoint, ends: Json) -> None:
        self.joints.append(ends | {"kind": "slide", "axis": self.axis(joint).tolist()})

    def _free(self, joint: FreeJoint, ends: Json) -> None:
        """Add nothing: nothing is held."""

    def _pin(self, joint: AnyJoint, ends: Json) -> None:
        self.pins[joint.parent, joint.child] = len(self.joints)
        self.joints.append(ends | {"kind": "pin"})

    def _join_slot(self, joint: SlotJoint, ends: Json) -> None:
        """One joint that slides and turns; engines without it build another."""
        self.joints.append(ends | {"kind": "slot", "axis": self.axis(joint).tolist()})

    def stop(self, stop: AnyStop) -> Json:
        """Limit of a pin on the child's angle less the parent's; side 1 is the least."""
        _STOPS[stop]  # refuses stops on points by name
        assert isinstance(stop, Stop)
        for (parent, child), joint in self.pins.items():
            if {parent, child} == {stop.body, stop.relative_to}:
                side = stop.sense if child == stop.body else -stop.sense
                between = self.angles[stop.body] - self.angles[stop.relative_to]
                gap = 0.0 if stop.closed else stop.sense * between - stop.limit
                return {"joint": joint, "side": side, "angle": -side * gap, "closed": stop.closed}
        raise UnsupportedProblemError(
            f"our adapter builds stops for {self.engine} as limits of pins, and stop "
            f"{stop.name!r} is on none."
        )


_WHO = "the scene for Node.js"
_JOINTS: ElementTable[str] = ElementTable(
    _WHO,
    JOINTS,
    {
        SlotJoint: "_join_slot",
        PinJoint: "_pin",
        WeldJoint: "_weld",
        PrismaticJoint: "_slide",
        FreeJoint: "_free",
    },
    {TranslationJoint: "our adapter builds no joint that holds an angle alone"},
)
"""Names of methods, which scenes of engines may override."""
_STOPS: ElementTable[str] = ElementTable(
    _WHO, STOPS, {Stop: "limit of a pin"}, {PointStop: "it has no walls for points"}
)
