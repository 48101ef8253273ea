"""Jolt Physics: rigid bodies held in a plane, joints and limits by impulses, single precision.

A body is a dynamic body with its mass and inertia that may move in the plane only; a pin a hinge, a
slider a slider constraint, a weld and a slot constraints of six axes: all of them are fixed, or one
translation and the rotation about z are free. A stop is a limit of a hinge and stays there for the
whole run; those that a release-once law leaves out are left out. Springs, dampers and motors are
forces and torques given to the bodies before each step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field
from trebucheck.engines.protocol import Capabilities
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance
from trebucheck.models.spec import Positive
from trebucheck_toolkit.kept_limits import HELD_FROM_BOTH_SIDES
from trebucheck_toolkit.node_engine import ALONE, NodeEngine
from trebucheck_toolkit.node_package import NodePackage
from trebucheck_toolkit.node_scene import NodeScene, body_capabilities

from .study import STUDY

OWN: Mapping[str, Any] = {
    "timestep": 1 / 60,
    "collision_steps": 1,
    "first_velocity_steps": 10,
    "velocity_steps": 10,
    "position_steps": 2,
    "baumgarte": 0.2,
    "damping": 0.05,
    "max_linear_velocity": 500.0,
    "max_angular_velocity": 0.25 * math.pi * 60,
    "gyroscopic_force": False,
    "allow_sleep": True,
}
"""Jolt's own options; `Step` has no step size of its own: that of Jolt's HelloWorld.cpp."""
_ALONE = {**ALONE, "hold": False}
Steps = Annotated[int, Field(ge=1, le=100_000)]


class JoltEngine(NodeEngine):
    """Jolt Physics' world in Node.js.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    timestep: Positive = Field(default=2.5e-4, le=1.0, description="step size [s]")
    collision_steps: Steps = Field(default=1, description="parts of each step")
    first_velocity_steps: Steps = Field(
        default=10_000, description="iterations of impulses in the first step, which begins without"
    )
    velocity_steps: Steps = Field(default=100, description="iterations of impulses in each step")
    position_steps: Steps = Field(
        default=1, description="iterations that move bodies to where their joints are"
    )
    baumgarte: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=1.0, description="part of a joint's gap that such an iteration takes back"
    )
    damping: Annotated[float, Field(ge=0.0)] = Field(
        default=0.0, description="rate at which every body loses its speeds [1/s]"
    )
    max_linear_velocity: Positive = Field(default=1e6, le=1e15, description="of bodies [m/s]")
    max_angular_velocity: Positive = Field(default=1e6, le=1e15, description="of bodies [rad/s]")
    gyroscopic_force: bool = Field(default=False, description="of bodies that turn")
    allow_sleep: bool = Field(default=False, description="stop bodies that hardly move")
    plane: bool = Field(
        default=True, description="let bodies move in the plane only; else joints hold them there"
    )

    hold: bool = Field(default=True, description="hold closed stops from both sides till they pull")

    npm: ClassVar[NodePackage] = NodePackage(
        "Jolt Physics",
        "jolt-physics",
        module="trebucheck_jolt",
        folder=Path(__file__).parent / "node",
    )
    name: ClassVar[str] = "jolt"
    package: ClassVar[str] = "trebucheck-jolt"
    tables: ClassVar[EngineStudy] = STUDY
    within_half_a_turn: ClassVar[bool] = True
    capabilities: ClassVar[Capabilities] = body_capabilities(
        "Cartesian coordinates in single precision, joints and limits by sequential "
        "impulses, semi-implicit Euler",
    )
    default_options: ClassVar[Mapping[str, object] | None] = {**_ALONE, **OWN}
    settings_options: ClassVar[Mapping[str, object] | None] = _ALONE
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
        HELD_FROM_BOTH_SIDES,
        *(NodeEngine.assistance or ()),
    )

    def _values(self, scene: NodeScene) -> Mapping[str, Any]:
        physics = {
            "mNumVelocitySteps": "first_velocity_steps",
            "mNumPositionSteps": "position_steps",
            "mBaumgarte": "baumgarte",
        }
        bodies = {
            "mLinearDamping": "damping",
            "mAngularDamping": "damping",
            "mMaxLinearVelocity": "max_linear_velocity",
            "mMaxAngularVelocity": "max_angular_velocity",
            "mApplyGyroscopicForce": "gyroscopic_force",
            "mAllowSleeping": "allow_sleep",
        }
        axes = [f"{kind}{axis}" for kind in ("Translation", "Rotation") for axis in "XYZ"]
        # In the plane Jolt would lock its rotation with these two, whose axes rounding tilts.
        tilts = () if self.plane else ("RotationY", "RotationZ")
        return {
            "physics": self._set(physics),
            "motion": self._set(bodies),
            "axes": axes,
            "slot_axes": ["TranslationX", "TranslationZ", *tilts],
            "reaches": [_reach(scene, index) for index in range(len(scene.bodies))],
        }

    def _set(self, names: Mapping[str, str]) -> dict[str, Any]:
        """Options that are not Jolt's own, by Jolt's names of them."""
        given = {name: getattr(self, option) for name, option in names.items()}
        return {name: value for name, value in given.items() if value != OWN[names[name]]}


def _reach(scene: NodeScene, index: int) -> float:
    """Distance of a body's farthest joint from its centre of mass [m]; 1 m where there is none."""
    points = [
        joint[point]
        for joint in scene.joints
        for body, point in (("a", "pointA"), ("b", "pointB"))
        if joint[body] == index
    ]
    return max((float(np.hypot(*point)) for point in points), default=0.0) or 1.0
