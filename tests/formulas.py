"""A motion given by formulas, in the place of a reference solution: what comparisons measure is
then known exactly.

A trolley on a level slot carries an arm, which its rest holds until RELEASE and which turns evenly
from then on. The motion need not obey any law: a comparison only compares.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import trebucheck as tb
from mechanisms import pin
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND, PointStop, SlotJoint, Stop
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.launch import Launch
from trebucheck.models.mechanism import Body, Marker
from trebucheck.models.trajectory import PointMotion, Provenance
from trebucheck.reference.singular import SingularPassage

RELEASE, TURN, ARM = 0.5, 1.0, 2.0
"""When the rest opens [s], speed of the arm from then on [rad/s], and its length [m]."""
LAUNCH = RELEASE + math.pi / 4 / TURN
"""The tip moves straight up at first, and so at 45 degrees after an eighth of a turn [s]."""
END = 1.5
WAY = ARM * math.hypot(1 - math.cos(END - RELEASE), math.sin(END - RELEASE))
"""Diagonal of the rectangle around the path of the tip, which turns by a radian [m]."""

REST = Stop(name="rest", body="arm", sense=1, limit=math.pi, closed=True)
BUFFER = Stop(name="buffer", body="arm", sense=-1, limit=-10.0, closed=False)
WALL = PointStop(name="wall", body="arm", point=(ARM, 0), normal=(0, 1), offset=-4.0, closed=False)
SLOT = SlotJoint(
    name="slot",
    child="trolley",
    parent_point=(0, 0),
    child_point=(0, 0),
    axis=(1.0, 0.0),
    coordinate="s",
)


def trolley(**changes: object) -> tb.Mechanism:
    """3 kg on the slot and 2 kg of arm on it; 3 m in size, sqrt(1/3) s in characteristic time."""
    fields: dict[str, object] = {
        "name": "trolley",
        "bodies": (
            Body(name="trolley", angle="tilt", mass=3.0, centre=(0, 0), inertia=3.0),
            Body(name="arm", angle="beta", mass=2.0, centre=(0, 0), inertia=0.5),
        ),
        "joints": (SLOT, pin("pivot", "trolley", "arm")),
        "stops": (REST, BUFFER, WALL),
        "markers": (
            Marker(name="projectile", body="arm", point=(ARM, 0)),
            Marker(name="hook", body="trolley", point=(0.5, 0)),
        ),
        "gravity": 9.0,
        "start": (0.0, math.pi, 0.0),
    }
    return tb.Mechanism(**(fields | changes))


def _turned(t: FloatArray) -> FloatArray:
    return TURN * np.maximum(t - RELEASE, 0.0)


@dataclass(frozen=True)
class Formula:
    """The motion; every field can be replaced."""

    mechanism: tb.Mechanism = field(default_factory=trolley)
    law: tb.StopLaw = tb.StopLaw.RELEASE_ONCE
    release_times: Mapping[str, float | None] = field(default_factory=lambda: {"rest": RELEASE})
    impacts: tuple[tuple[float, dict[str, float]], ...] = ()
    singular_passages: tuple[SingularPassage, ...] = ()
    segments: tuple[()] = ()
    launches: Mapping[str, Launch] = field(
        default_factory=lambda: {
            "projectile": Launch(LAUNCH, ARM * TURN, (math.sqrt(2), math.sqrt(2)))
        }
    )
    undetermined_joints: tuple[str, ...] = ()
    undetermined_stops: tuple[str, ...] = ()
    q: Callable[[FloatArray], list[FloatArray]] = lambda t: [0 * t, math.pi + _turned(t), 0 * t]
    u: Callable[[FloatArray], list[FloatArray]] = lambda t: [0 * t, TURN * (t > RELEASE), 0 * t]
    torques: Mapping[str, Callable[[FloatArray], FloatArray]] = field(
        default_factory=lambda: {
            "rest": lambda t: np.maximum(40.0 * (RELEASE - t), 0.0),
            "buffer": lambda t: 0 * t,
            "wall": lambda t: 0 * t,
        }
    )
    reactions: Mapping[str, Callable[[FloatArray], FloatArray]] = field(
        default_factory=lambda: {
            "slot": lambda t: np.stack([0 * t, 45.0 + 0 * t], axis=1),
            "pivot": lambda t: np.stack([3.0 + t, 4.0 * t], axis=1),
        }
    )
    kinetic: Callable[[FloatArray], FloatArray] = lambda t: 50.0 * t
    potential: Callable[[FloatArray], FloatArray] = lambda t: 20.0 - 50.0 * t

    @property
    def problem(self) -> tb.Problem:
        return tb.Problem(self.mechanism, duration=2.0, stop_law=self.law)

    def launch_at(self, _: float, marker: str = "projectile") -> Launch | None:
        return self.launches.get(marker)

    def trajectory(self, t: FloatArray) -> tb.Trajectory:
        """At times t [s], shape (n,)."""
        q, u = (
            np.stack([np.asarray(values, dtype=float) for values in of(t)], axis=1)
            for of in (self.q, self.u)
        )
        return tb.Trajectory(
            mechanism=self.mechanism,
            t=t,
            q=q,
            u=u,
            markers={marker.name: self._point(marker, q, u) for marker in self.mechanism.markers},
            kinetic_energy=self.kinetic(t),
            potential_energy=self.potential(t),
            stop_torques={stop.name: self.torques[stop.name](t) for stop in self.mechanism.stops},
            release_times=dict(self.release_times),
            joint_reactions={
                joint.name: self.reactions[joint.name](t) for joint in self.mechanism.joints
            },
            provenance=Provenance("formula", "1", "assisted", {}, "", 2.0, self.law.value, 1, 0.0),
            impacts=self.impacts,
        )

    def _point(self, marker: Marker, q: FloatArray, u: FloatArray) -> PointMotion:
        kinematics = Kinematics(self.mechanism)
        row = kinematics.point(marker.body, marker.point)
        return PointMotion(kinematics.position(row, q), kinematics.velocity(row, q, u))


def times(step: float = 0.01, end: float = 2.0) -> FloatArray:
    """Evenly spaced [s]."""
    return np.linspace(0.0, end, round(end / step) + 1)


def pinned(**changes: object) -> dict[str, Any]:
    """Fields of a further body that hangs on the ground, beside the trolley."""
    other = Body(name="post", angle="gamma", mass=1.0, centre=(0, 0), inertia=1.0)
    bodies = (*trolley().bodies, other)
    return {
        "bodies": bodies,
        "joints": (*trolley().joints, pin("foot", GROUND, "post", (5, 0))),
        "start": (0.0, math.pi, 0.0, 0.0),
        **changes,
    }
