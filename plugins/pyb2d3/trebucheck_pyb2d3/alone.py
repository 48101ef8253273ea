"""Box2D 3 as a program with nothing but pyb2d3's interface, which a run executes.

A body is a dynamic body with its mass data, a pin a revolute joint, a slot a wheel joint without a
spring, a slider a prismatic joint, a weld a weld joint, a stop the limit of a revolute joint.
Box2D's springs are soft joints, given by a frequency of whatever mass they hold, not by a
stiffness; so springs, dampers and motors are forces given before each step.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

from trebucheck.models.elements import FreeJoint
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.problem import Problem
from trebucheck_toolkit.body_plan import BodyPlan

OPEN = 1e-3  # [rad] from a limit, beyond which a stop that releases for good is taken out


class Plan(BodyPlan):
    """A problem's program for Box2D."""

    engine: ClassVar[str] = "pyb2d3"
    widest: ClassVar[float] = 0.99 * math.pi
    within_half_a_turn: ClassVar[bool] = True
    slop: ClassVar[float] = 2.8e-5
    """Greatest error of the arc tangent by which Box2D's limits measure angles [rad]."""
    at_end: ClassVar[bool] = True

    def __init__(self, problem: Problem, options: Any, *, as_described: bool = False) -> None:
        super().__init__(problem, options, as_described=as_described)
        self.pace = max(1.0, (options.world_step or 0.0) / options.timestep)
        """Seconds of Box2D's world in one second."""
        joints = problem.mechanism.joints
        self.names = [each.name for each in joints if not isinstance(each, FreeJoint)]
        """Names of the scene's joints."""
        sides = {self.names[stop["joint"]]: -stop["side"] for stop in self.stops.values()}
        self.waiting = sides if self.drops else {}
        """Joints of stops that are to be taken out, with the sign of their opening angles."""
        if any(max(map(abs, ends)) > self.widest for ends in self.ranges.values()):
            raise UnsupportedProblemError(
                "Box2D's limits are within 0.99 of half a turn from the start; a stop is beyond."
            )
        if self.drops and len(self.waiting) < len(self.stops):
            raise UnsupportedProblemError(
                "pyb2d3 sets no limit anew: our adapter takes out none of two stops on a pin."
            )

    def values(self) -> dict[str, Any]:
        """Further values of the template."""
        return {"open": OPEN, "limited": [self.names[joint] for joint in self.ranges]}
