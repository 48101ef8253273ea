"""cannon-es: rigid bodies held in a plane, joints and limits by regularized impulses.

A body is a dynamic body with its mass and inertia that may move in the plane only, a pin a hinge
constraint, a weld a lock constraint. A pin with stops is a cone-twist constraint, whose cone lies
in the plane: of a stop on one side its other edge is three quarters of a turn on. Stops stay there
for the whole run unless `let_go` takes them out; those that a release-once law leaves out are left
out.
Springs, dampers and motors are forces and torques given to the bodies before each step.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import Field
from trebucheck.engines.point_masses import LeastInertia
from trebucheck.engines.protocol import Capabilities
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance, Part, has_stops
from trebucheck.models.features import Basic, Feature
from trebucheck.models.spec import Positive
from trebucheck_toolkit.gap_releases import OPENING
from trebucheck_toolkit.node_engine import ALONE, NodeEngine
from trebucheck_toolkit.node_package import NodePackage
from trebucheck_toolkit.node_scene import NodeScene, body_capabilities

from .study import STUDY

OWN: Mapping[str, Any] = {
    "timestep": 1 / 60,
    "iterations": 10,
    "tolerance": 1e-7,
    "stiffness": 1e7,
    "relaxation": 4.0,
    "equation_step": 1 / 60,
    "damping": 0.01,
}
"""cannon-es's own options; the step is that of `fixedStep`."""
_ALONE: Mapping[str, object] = {**ALONE, "let_go": False}


class CannonEngine(NodeEngine):
    """cannon-es's world in Node.js.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    timestep: Positive = Field(default=1e-4, le=1.0, description="step size [s]")
    iterations: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        default=2000, description="of the solver in each step, at most"
    )
    tolerance: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=1e-12,
        description="sum of the changes of impulses in an iteration at which the solver ends [N s]",
    )
    stiffness: Positive = Field(
        default=1e14, le=1e30, description="of every constraint [N/m, N m/rad]"
    )
    relaxation: Positive = Field(
        default=1.0, le=1e6, description="steps in which an error of a constraint is taken back"
    )
    equation_step: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.0, description="step for which constraints are set [s]; 0: the step that is taken"
    )
    damping: Annotated[float, Field(ge=0.0, lt=1.0)] = Field(
        default=0.0, description="part of its speeds that every body loses in a second"
    )
    plane: bool = Field(
        default=True, description="let bodies move in the plane only; else joints hold them there"
    )

    least_inertia: LeastInertia = 3e-2  # with less the solver takes several times the iterations
    let_go: bool = Field(
        default=True, description="take a stop out once it is open, where the law is release-once"
    )

    npm: ClassVar[NodePackage] = NodePackage(
        "cannon-es", "cannon-es", module="trebucheck_cannon", folder=Path(__file__).parent / "node"
    )
    name: ClassVar[str] = "cannon"
    package: ClassVar[str] = "trebucheck-cannon"
    tables: ClassVar[EngineStudy] = STUDY
    within_half_a_turn: ClassVar[bool] = True
    capabilities: ClassVar[Capabilities] = body_capabilities(
        "Cartesian coordinates, joints and limits by regularized impulses, semi-implicit Euler",
        Feature.MOVING_SLOT,
        Feature.PRISMATIC,
        Basic.SLOT,
    )
    default_options: ClassVar[Mapping[str, object] | None] = {**_ALONE, **OWN}
    settings_options: ClassVar[Mapping[str, object] | None] = _ALONE
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
        Assistance(
            Part.EVENTS,
            "takes a stop out once it is open, where it is let go for good",
            "let_go",
            off=False,
            acts_on=has_stops,
        ),
        *(NodeEngine.assistance or ()),
    )

    def _values(self, scene: NodeScene) -> Mapping[str, Any]:
        del scene
        solver = {"iterations": self.iterations, "tolerance": self.tolerance}
        equations = ("stiffness", "relaxation", "equation_step")
        return {
            "own": OWN,
            "solver": {name: value for name, value in solver.items() if value != OWN[name]},
            "sets_equations": any(getattr(self, name) != OWN[name] for name in equations),
            "opening": OPENING,
        }
