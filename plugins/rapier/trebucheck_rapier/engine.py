"""Rapier 2D: Cartesian bodies, joints and limits by impulses in substeps, single precision.

A body is a dynamic body with additional mass properties, a pin a revolute joint, a slider a
prismatic joint, a weld a fixed joint, all of them impulse joints: multibody joints have a damping
of their own, which the interface cannot take out. A stop is the limit of a revolute joint; by
itself it is set once and stays there for the whole run, and those that a release-once law leaves
out are left out. With assistance limits are moved to where Rapier knows their angles and go with
their stops, and slots have carriages (:mod:`.build`). Springs, dampers and motors are forces and
torques given to the bodies before each step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field
from trebucheck.engines.protocol import Capabilities
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance, Part, has_stops
from trebucheck.models.elements import SlotJoint
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.gap_releases import OPENING
from trebucheck_toolkit.node_engine import ALONE, NodeEngine
from trebucheck_toolkit.node_package import NodePackage
from trebucheck_toolkit.node_scene import NodeScene, body_capabilities, joint_limits

from .build import RapierScene
from .study import STUDY

OWN: Mapping[str, Any] = {
    "timestep": float(np.float32(1 / 60)),  # a number of single precision
    "substeps": 4,
    "passes": 1,
    "allow_sleep": True,
}
"""Rapier's own options."""
_ALONE: Mapping[str, object] = {**ALONE, "carriage": None, "move_limits": False, "opening": None}


class RapierEngine(NodeEngine):
    """Rapier's world with impulse joints in Node.js.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    substeps: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=8,
        description="of a step, each with its own impulses (Rapier's numSolverIterations)",
    )
    passes: Annotated[int, Field(ge=1, le=10_000)] = Field(
        default=4, description="over all joints in a substep (Rapier's numInternalPgsIterations)"
    )
    allow_sleep: bool = Field(
        default=False, description="let bodies that hardly move for some time stand still"
    )
    carriage: Annotated[float | None, Field(gt=0.0, le=1.0)] = Field(
        default=1e-3,
        description="mass of the body that runs in a slot, as a part of that of the body it "
        "carries: Rapier has no joint that both slides and turns; None: no slots",
    )
    move_limits: bool = Field(
        default=True,
        description="put the nearest stop of a pin where Rapier's angle of it is zero, and its "
        "limit on within a quarter turn: Rapier knows an angle within half a turn",
    )
    opening: Annotated[float | None, Field(gt=0.0, le=0.1)] = Field(
        default=1e-4,
        description="gap at which a stop that releases for good is taken out [rad]; its release is "
        "looked back for. None: every stop stays for the whole run",
    )

    npm: ClassVar[NodePackage] = NodePackage(
        "Rapier 2D",
        "@dimforge/rapier2d-compat",
        module="trebucheck_rapier",
        folder=Path(__file__).parent / "node",
    )
    name: ClassVar[str] = "rapier"
    package: ClassVar[str] = "trebucheck-rapier"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = replace(
        body_capabilities(
            "Cartesian coordinates in single precision, joints and limits by impulses in "
            "substeps, semi-implicit Euler"
        ),
        joint_reactions=False,
        stop_torques=False,
    )
    default_options: ClassVar[Mapping[str, object] | None] = {**_ALONE, **OWN}
    settings_options: ClassVar[Mapping[str, object] | None] = {**_ALONE, "timestep": 2.5e-4}
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
        *(NodeEngine.assistance or ()),
        Assistance(
            Part.MODEL,
            "runs a small body in each slot, which the other one is pinned to",
            "carriage",
            off=None,
            acts_on=lambda mechanism: any(isinstance(j, SlotJoint) for j in mechanism.joints),
        ),
        Assistance(
            Part.MODEL,
            "turns the frames of a joint to its nearest stop, and has its limit on near to it",
            "move_limits",
            off=False,
            acts_on=has_stops,
        ),
        Assistance(
            Part.EVENTS,
            "takes the limits of stops that are open for good out of the model",
            "opening",
            off=None,
            acts_on=has_stops,
        ),
    )

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Slots, where they have no carriages."""
        slots = frozenset[Basic | Feature]({Basic.SLOT, Feature.MOVING_SLOT})
        return slots if self.carriage is None else frozenset()

    @property
    def release_gap(self) -> float:
        """Gap at which stops are taken out, if they are [rad]."""
        return self.opening or OPENING

    def _scene(self, mechanism: Mechanism) -> NodeScene:
        return RapierScene(mechanism, self.carriage)

    def _limits(
        self, problem: Problem, scene: NodeScene
    ) -> dict[int, tuple[float | None, float | None]]:
        return joint_limits(problem, scene, within_half_a_turn=not self.move_limits)

    def _values(self, scene: NodeScene) -> Mapping[str, Any]:
        del scene
        return {"own": OWN}
