"""Box2D 3 as a program with nothing but pyb2d3's interface, which a run executes.

A body is a dynamic body with its mass data, a pin a revolute joint, a slot a wheel joint without a
spring, a slider a prismatic joint, a weld a weld joint, a stop the limit of a revolute joint.
Box2D's springs are soft joints, given by a frequency of whatever mass they hold, not by a
stiffness; so springs, dampers and motors are forces given before each step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from trebucheck.engines.point_masses import spread_masses
from trebucheck.engines.protocol import Recording
from trebucheck.models.elements import FreeJoint
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.problem import Problem, StopLaw
from trebucheck_toolkit.alone import BodySteps
from trebucheck_toolkit.body_program import UprightScene, body_program, run_program, scene_states
from trebucheck_toolkit.node_scene import MIRROR, NodeScene, joint_limits, lawful_stops

WIDEST = 0.99 * math.pi  # [rad] greatest limit that Box2D takes
ANGLES = 2.8e-5  # [rad] greatest error of the arc tangent by which Box2D's limits measure angles
OPEN = 1e-3  # [rad] from a limit, beyond which a stop that releases for good is taken out


@dataclass
class Plan:
    """A problem's program for Box2D.

    Args:
        problem: what is moved.
        options: those of the engine.
        as_described: whether point masses are left without inertia, as they are only read back.

    Raises:
        UnsupportedProblemError: the mechanism has a part that the adapter builds no element for.
    """

    problem: Problem
    options: Any
    as_described: bool = False

    def __post_init__(self) -> None:
        """Build the scene, and refuse stops that cannot be limits."""
        original, stops = self.problem.mechanism, lawful_stops(self.problem)
        self.spread = spread_masses(original, None, "pyb2d3")
        self.scene = NodeScene(original if self.as_described else self.spread.mechanism, "pyb2d3")
        self.frames, pace = UprightScene(self.scene), self.options.world_step or 0.0
        self.pace = max(1.0, pace / self.options.timestep)
        """Seconds of Box2D's world in one second."""
        self.names = [each.name for each in original.joints if not isinstance(each, FreeJoint)]
        """Names of the scene's joints."""
        self.stops = {stop.name: self.scene.stop(stop) for stop in stops}
        limits = joint_limits(self.problem, self.scene, within_half_a_turn=True)
        self.ranges = {
            self.names[joint]: (-WIDEST if high is None else -high, WIDEST if low is None else -low)
            for joint, (low, high) in limits.items()
        }
        """Least and greatest angle of each joint with stops, anticlockwise [rad]."""
        once = self.problem.stop_law is StopLaw.RELEASE_ONCE and not self.options.keep_limits
        sides = {self.names[stop["joint"]]: -stop["side"] for stop in self.stops.values()}
        self.waiting = sides if once else {}
        """Joints of stops that are to be taken out, with the sign of their opening angles."""
        if any(max(map(abs, ends)) > WIDEST for ends in self.ranges.values()):
            raise UnsupportedProblemError(
                "Box2D's limits are within 0.99 of half a turn from the start; a stop is beyond."
            )
        if once and len(self.waiting) < len(self.stops):
            raise UnsupportedProblemError(
                "pyb2d3 sets no limit anew: our adapter takes out none of two stops on a pin."
            )

    def program(self) -> str:
        """The program of the run."""
        return body_program(
            __name__, self.frames, self.problem, self.options.timestep, plan=self, open=OPEN
        )

    def run(self) -> Recording:
        """Step Box2D from the start to the problem's end or just beyond, and read its bodies."""
        found, joints = run_program(self.program()), len(self.names)
        forces, limits = np.split(found["told"], [2 * joints], axis=1)
        torques = dict(zip(self.ranges, limits.T, strict=True))
        return BodySteps(
            self.problem,
            self.scene,
            self.spread,
            found["t"],
            scene_states(self.frames, self.scene, found["states"]),
            forces=forces.reshape(len(forces), joints, 2) * MIRROR,
            torques={
                name: np.maximum(0.0, -stop["side"] * torques[self.names[stop["joint"]]])
                for name, stop in self.stops.items()
            },
            slop=ANGLES,
            at_end=True,
        ).recording(found["q"], found["u"])
