"""PhysX: rigid bodies held in a plane, joints and limits by impulses, single precision.

A body is a dynamic actor without a shape, with its mass and inertia, that may move in the plane
only; a pin a revolute joint, a slide a prismatic one, a weld a fixed one, a slot a joint of six
axes of which one translation and the rotation about z are free. A stop is a limit of a revolute
joint and stays there for the whole run; those that a release-once law leaves out are left out.
Springs, dampers and motors are forces and torques given to the bodies before each step.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

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
    "position_iterations": 4,
    "velocity_iterations": 1,
    "angular_damping": 0.05,
    "max_angular_velocity": 100.0,
    "sleep_threshold": 0.005,
}
"""PhysX's own options; `simulate` has no step of its own: that of PhysX's SnippetHelloWorld."""
_SETTERS: Mapping[str, tuple[str, ...]] = {
    "setSolverIterationCounts": ("position_iterations", "velocity_iterations"),
    "setAngularDamping": ("angular_damping",),
    "setMaxAngularVelocity": ("max_angular_velocity",),
    "setSleepThreshold": ("sleep_threshold",),
}
"""Methods of a body, each with the options that it takes."""
_ALONE = {**ALONE, "hold": False}
Iterations = Annotated[int, Field(ge=1, le=255)]
"""PhysX counts them in eight bits."""


class PhysxEngine(NodeEngine):
    """PhysX's scene in Node.js.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    timestep: Positive = Field(default=2.5e-4, le=1.0, description="step size [s]")
    position_iterations: Iterations = Field(
        default=30, description="iterations of impulses that also take gaps of joints back"
    )
    velocity_iterations: Iterations = Field(
        default=100, description="iterations after them, of speeds alone, whose impulses are told"
    )
    angular_damping: Annotated[float, Field(ge=0.0)] = Field(
        default=0.0, description="rate at which every body loses its angular speed [1/s]"
    )
    max_angular_velocity: Positive = Field(default=1e6, le=1e15, description="of bodies [rad/s]")
    sleep_threshold: Annotated[float, Field(ge=0.0)] = Field(
        default=0.0, description="kinetic energy over mass below which a body falls asleep [J/kg]"
    )
    plane: bool = Field(
        default=True, description="let bodies move in the plane only; else joints hold them there"
    )
    hold: bool = Field(default=True, description="hold closed stops from both sides till they pull")

    npm: ClassVar[NodePackage] = NodePackage(
        "PhysX", "physx-js-webidl", "trebucheck_physx", Path(__file__).parent / "node"
    )
    name: ClassVar[str] = "physx"
    package: ClassVar[str] = "trebucheck-physx"
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
        del scene
        given = {
            method: [getattr(self, option) for option in options]
            for method, options in _SETTERS.items()
        }
        changed = {
            method: values
            for method, values in given.items()
            if values != [OWN[option] for option in _SETTERS[method]]
        }
        return {"changed": changed.items()}
