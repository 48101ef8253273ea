"""Havok's build for the web: Cartesian bodies, joints and limits by impulses, single precision.

A body is a dynamic body without a shape, a joint a constraint with locked axes: a pin leaves the
angle about z free, a slot the angle and a way, a slide a way, a weld nothing. A stop is a limit of
a pin's angle and stays there for the whole run; those that a release-once law leaves out are left
out. Springs, dampers and motors are impulses given to the bodies before each step. Forces and
torques of joints and limits are the impulses that Havok tells of a step, over its length.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import Field
from trebucheck.engines.protocol import Capabilities
from trebucheck.engines.study import EngineStudy
from trebucheck.models.spec import Positive
from trebucheck_toolkit.gap_releases import OPENING
from trebucheck_toolkit.node_engine import ALONE, NodeEngine
from trebucheck_toolkit.node_package import NodePackage
from trebucheck_toolkit.node_scene import NodeScene, body_capabilities

from .study import STUDY

OWN: Mapping[str, Any] = {
    "timestep": 1 / 60,
    "ideal_step": 1 / 60,
    "locks_plane": True,
    "angular_damping": 0.1,
    "stabilization": True,
    "speed_limit": 200.0,
    "turning_limit": 100.0,
    "allow_sleep": True,
}
"""Havok's own options; its world has no step size of its own: Babylon.js's, whose constraint HINGE
locks the axes out of the plane too."""


class HavokEngine(NodeEngine):
    """Havok's world in Node.js.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    timestep: Positive = Field(default=1e-3, le=1.0, description="step size [s]")
    ideal_step: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.0,
        description="step for which the solver is made [s]: a step has four substeps for each of "
        "these, 1 to 8 in all; four at any step where it is 0",
    )
    locks_plane: bool = Field(
        default=False,
        description="lock the axes of pins and slots out of the plane, which makes them stiffer",
    )
    angular_damping: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.0, description="part of its angular speed that every body loses in a second"
    )
    stabilization: bool = Field(
        default=False,
        description="brake bodies slower than 0.1 m/s by 0.031 of the world's gravity, as Havok "
        "does; without it the world's gravity is little and each body's factor of it great",
    )
    speed_limit: Positive = Field(default=1e6, le=1e9, description="of every body [m/s]")
    turning_limit: Positive = Field(default=1e6, le=1e9, description="of every body [rad/s]")
    allow_sleep: bool = Field(default=False, description="let bodies that hardly move sleep")

    npm: ClassVar[NodePackage] = NodePackage(
        "Havok", "@babylonjs/havok", "trebucheck_havok", Path(__file__).parent / "node"
    )
    name: ClassVar[str] = "havok"
    package: ClassVar[str] = "trebucheck-havok"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = body_capabilities(
        "Cartesian coordinates, joints and limits by impulses in substeps, semi-implicit Euler",
    )
    default_options: ClassVar[Mapping[str, object] | None] = {**ALONE, **OWN}
    settings_options: ClassVar[Mapping[str, object] | None] = ALONE

    @property
    def roundoff(self) -> float:
        """Part of a thousand of what eight bits of inverse masses leave of an acceleration.

        It is read off impulses, with two such roundings; the check allows a thousand.
        """
        return 2.0**-7 / 1000

    @property
    def release_gap(self) -> float:
        """Gap from which releases are looked back for, though torques are told [rad].

        Single precision opens a limit by 2e-6 rad; in steps of 1/60 s the pins' drift by some
        1e-3 rad, and by the square of the step in shorter ones.
        """
        return max(1e-5, OPENING * (60.0 * self.timestep) ** 2)

    def _values(self, scene: NodeScene) -> Mapping[str, Any]:
        del scene
        return {"own": OWN}
