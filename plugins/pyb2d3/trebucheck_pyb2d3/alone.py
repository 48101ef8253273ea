"""Box2D 3 as a program with nothing but pyb2d3's interface, which a run executes.

A body is a dynamic body with its mass data, a pin a revolute joint, a slot a wheel joint without a
spring, a slider a prismatic joint, a weld a weld joint, a stop the limit of a revolute joint.
Box2D's springs are soft joints, given by a frequency of whatever mass they hold, not by a
stiffness; so springs, dampers and motors are forces and torques given before each step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from trebucheck.engines.point_masses import spread_masses
from trebucheck.engines.protocol import EngineOptions, Recording
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import FreeJoint
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.problem import Problem, StopLaw
from trebucheck_toolkit.alone import BodySteps
from trebucheck_toolkit.body_program import UprightScene, body_program, run_program, scene_states
from trebucheck_toolkit.node_scene import MIRROR, Json, NodeScene, lawful_stops

WIDEST = 0.99 * math.pi
"""Greatest angle of a limit that Box2D takes [rad]."""
ANGLES = 2.8e-5
"""Greatest error of the arc tangent by which Box2D's limits measure their angles [rad]."""
OPEN = 1e-3
"""Angle from a limit, beyond which a stop that releases for good is taken out [rad]."""
_KINDS: Mapping[str, tuple[str, Json]] = {
    "pin": ("revolute", {}),
    "slide": ("prismatic", {}),
    "slot": ("wheel", {"enable_spring": False}),  # it has a spring of 1 Hz where nothing is set
    "weld": ("weld", {}),
}


@dataclass
class Plan:
    """A problem's program for Box2D.

    Raises:
        UnsupportedProblemError: the mechanism has a part that the adapter builds no element for.
    """

    problem: Problem
    options: Any
    as_described: bool = False
    """Whether point masses are left without inertia, as they are only read back."""

    def __post_init__(self) -> None:
        """Build the scene, with inertias that every body needs."""
        self.spread = spread_masses(self.problem.mechanism, None, "pyb2d3")
        mechanism = self.problem.mechanism if self.as_described else self.spread.mechanism
        self.scene = NodeScene(mechanism, "pyb2d3")
        self.frames = UprightScene(self.scene)
        self.stops = {stop.name: self.scene.stop(stop) for stop in lawful_stops(self.problem)}

    @property
    def pace(self) -> float | None:
        """Seconds of Box2D's world in one second; None: the same."""
        pace = (self.options.world_step or 0.0) / self.options.timestep
        return pace if pace > 1.0 else None

    @cached_property
    def names(self) -> list[str]:
        """Names of the joints that hold anything, in the scene's order."""
        joints = self.scene.mechanism.joints
        return [joint.name for joint in joints if not isinstance(joint, FreeJoint)]

    @cached_property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Least and greatest angle of each pin with stops, anticlockwise from the start [rad]."""
        once = self.problem.stop_law is StopLaw.RELEASE_ONCE and not self.options.keep_limits
        limits: dict[str, tuple[float, float]] = {}
        for name, stop in self.stops.items():
            joint, angle = self.names[stop["joint"]], -stop["angle"]
            if abs(angle) > WIDEST or (once and joint in limits):
                why = (
                    f"Box2D's limits are within {WIDEST:.4g} rad of the angle at the start"
                    if abs(angle) > WIDEST
                    else "pyb2d3 sets no limit of a joint anew, so that of two on one pin none goes"
                )
                raise UnsupportedProblemError(f"{why}, and stop {name!r} would need it.")
            low, high = limits.get(joint, (-WIDEST, WIDEST))
            limits[joint] = (low, angle) if stop["side"] > 0 else (angle, high)
        return limits

    def program(self) -> str:
        """The program of the run."""
        options, pace, scene = self.options, self.pace or 1.0, self.scene
        bodies = {index: name for name, index in scene.index.items()}
        joints: list[Json] = []
        for name, joint in zip(self.names, scene.joints, strict=True):
            kind, arguments = _KINDS[joint["kind"]]
            points = {f"local_anchor_{end.lower()}": joint[f"point{end}"] for end in "AB"}
            if "axis" in joint:
                points["local_axis_a"] = joint["axis"]
            arguments = {key: _upright(point) for key, point in points.items()} | arguments
            if name in self.limits:
                low, high = self.limits[name]
                arguments |= {"enable_limit": True, "lower_angle": low, "upper_angle": high}
            ends = {"parent": bodies[joint["a"]], "child": bodies[joint["b"]]}
            joints.append({"name": name, "kind": kind, "arguments": arguments, **ends})
        once = self.problem.stop_law is StopLaw.RELEASE_ONCE and not options.keep_limits
        sides = {self.names[stop["joint"]]: -float(stop["side"]) for stop in self.stops.values()}
        return body_program(
            __name__,
            self.frames,
            self.problem,
            options.timestep,
            options=options,
            pace=self.pace,
            gravity=_upright(np.array(scene.mechanism.gravity_vector) * MIRROR / pace**2),
            bodies=[
                {
                    "mass": body["mass"],
                    "inertia": body["inertia"],
                    "position": _upright(body["position"]),
                    "velocity": _upright(np.array(body["velocity"]) / pace),
                    "speed": -body["speed"] / pace,
                }
                for body in scene.bodies
            ],
            joints=joints,
            limited=[*self.limits],
            releases=sides if once else {},
            open=OPEN,
            moves_mass=bool(self.spread.moved),
            zip=zip,
        )


def run(problem: Problem, options: EngineOptions) -> Recording:
    """Step Box2D from the start to a problem's end or just beyond, and read its bodies."""
    plan = Plan(problem, options)
    found = run_program(plan.program())
    forces, torques = np.split(found["told"], [2 * len(plan.names)], axis=1)
    limited = [*plan.limits]
    return BodySteps(
        problem,
        plan.scene,
        plan.spread,
        found["t"],
        scene_states(plan.frames, plan.scene, found["states"]),
        forces=forces.reshape(len(forces), -1, 2) * MIRROR,
        torques={
            name: np.maximum(
                0.0, -stop["side"] * torques[:, limited.index(plan.names[stop["joint"]])]
            )
            for name, stop in plan.stops.items()
        },
        slop=ANGLES,
        at_end=True,
    ).recording(found["q"], found["u"])


def _upright(vector: Any) -> tuple[float, ...]:
    """A vector of the scene with y upwards."""
    mirrored: FloatArray = np.array(vector) * MIRROR
    return tuple((mirrored + 0.0).tolist())
