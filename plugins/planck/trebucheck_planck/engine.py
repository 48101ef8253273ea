"""planck.js: Cartesian bodies, joints and limits by sequential impulses, double precision.

A body is a dynamic body with its mass data, a pin a revolute joint, a slot a wheel joint without a
spring, a slider a prismatic joint, a weld a weld joint. A stop is the limit of a revolute joint; by
itself it stays there for the whole run, and those that a release-once law leaves out are left out.
With assistance a stop that pushes is held from both sides, and limits go with their stops.
planck.js's springs are soft joints, given by a frequency of whatever mass they hold, not by a
stiffness; so springs, dampers and motors are forces and torques given to the bodies before each
step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field
from trebucheck.engines.protocol import Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance
from trebucheck.models.arrays import FloatArray
from trebucheck.models.problem import Problem
from trebucheck.models.spec import Positive
from trebucheck_toolkit.kept_limits import HELD_FROM_BOTH_SIDES, LIMITS_TAKEN_OUT, KeepLimits
from trebucheck_toolkit.node_engine import ALONE, NodeEngine
from trebucheck_toolkit.node_package import NodePackage
from trebucheck_toolkit.node_scene import NodeScene, body_capabilities, lawful_stops

from .study import STUDY

OWN: Mapping[str, Any] = {
    "timestep": 1 / 60,
    "first_iterations": 8,
    "velocity_iterations": 8,
    "position_iterations": 3,
    "linear_slop": 5e-3,
    "angular_slop": 2.0 / 180.0 * math.pi,
    "allow_sleep": True,
}
"""planck.js's own options; `step` has no step size of its own: that of its HelloWorld.ts."""
_ALONE: Mapping[str, object] = {**ALONE, "hold": False, "keep_limits": True}
_Iterations = Annotated[int, Field(ge=1, le=1_000_000)]


class PlanckEngine(NodeEngine):
    """planck.js's world in Node.js.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    timestep: Positive = Field(default=1e-4, le=1.0, description="step size [s]")
    velocity_iterations: _Iterations = Field(
        default=30, description="of the impulses of the joints, each step"
    )
    first_iterations: _Iterations = Field(
        default=3000,
        description="those of the first step, which begins without impulses of one before",
    )
    position_iterations: _Iterations = Field(
        default=30,
        description="of the correction of the joints' drift, each step; it ends within the slops",
    )
    linear_slop: Positive = Field(
        default=1e-9, le=1.0, description="drift of joints that is let be [m]"
    )
    angular_slop: Positive = Field(
        default=1e-9, le=0.1, description="drift of angles and limits that is let be [rad]"
    )
    allow_sleep: bool = Field(
        default=False, description="let bodies that hardly move for half a second stand still"
    )
    hold: bool = Field(
        default=True,
        description="whether a stop that pushes is held from both sides until it would pull: the "
        "correction of pins turns bodies, and opens a limit that holds from one side",
    )
    keep_limits: KeepLimits = False

    npm: ClassVar[NodePackage] = NodePackage(
        "planck.js", "planck", module="trebucheck_planck", folder=Path(__file__).parent / "node"
    )
    name: ClassVar[str] = "planck"
    package: ClassVar[str] = "trebucheck-planck"
    tables: ClassVar[EngineStudy] = STUDY
    slop: ClassVar[float] = OWN["angular_slop"]
    capabilities: ClassVar[Capabilities] = body_capabilities(
        "Cartesian coordinates, joints and limits by sequential impulses, semi-implicit Euler",
    )
    default_options: ClassVar[Mapping[str, object] | None] = {**_ALONE, **OWN}
    settings_options: ClassVar[Mapping[str, object] | None] = _ALONE
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
        HELD_FROM_BOTH_SIDES,
        LIMITS_TAKEN_OUT,
        *(NodeEngine.assistance or ()),
    )

    @property
    def _moves_limits(self) -> bool:
        """Tell whether limits change in a run; the program then tells the torque of each stop."""
        return self.hold or not self.keep_limits

    def _values(self, scene: NodeScene) -> Mapping[str, Any]:
        del scene
        slops = {"linearSlop": "linear_slop", "angularSlop": "angular_slop"}
        given = {name: getattr(self, option) for name, option in slops.items()}
        return {
            "slops": {name: given[name] for name in slops if given[name] != OWN[slops[name]]},
            "moves_limits": self._moves_limits,
        }

    def _torques(
        self, problem: Problem, scene: NodeScene, told: FloatArray
    ) -> Mapping[str, FloatArray]:
        if not self._moves_limits:
            return super()._torques(problem, scene, told)
        return dict(zip([stop.name for stop in lawful_stops(problem)], told.T, strict=True))

    def _run(self, problem: Problem) -> Recording:
        found = super()._run(problem)
        if not (self.assisted_by and np.any(problem.mechanism.start_speeds)):
            return found
        # Impulses bring the velocities of the step before, along its directions, into those of this
        # one; the first step's already are, so that it tells nothing of centripetal forces.
        return replace(
            found,
            joint_reactions=_first_repeated(found.joint_reactions),
            stop_torques=_first_repeated(found.stop_torques),
        )


def _first_repeated(forces: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Forces whose first sample has the second one's."""
    return {name: np.concatenate([force[1:2], force[1:]]) for name, force in forces.items()}
