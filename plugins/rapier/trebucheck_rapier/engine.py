"""Rapier 2D: Cartesian bodies, joints and limits by impulses in substeps, single precision."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field
from trebucheck.engines.point_masses import LeastInertia, NoPointMasses
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Part, Supplied
from trebucheck.models.features import Basic, Feature
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import Positive
from trebucheck_toolkit.node_samples import NodeSamples

from .bridge import RAPIER
from .build import Built
from .motion import releases
from .study import STUDY


class RapierEngine(BuiltinEngine):
    """Rapier's world with impulse joints in Node.js; the default preset is Rapier's own defaults.

    Its multibody joints are no choice: they have a damping of their own, which its interface cannot
    take out.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "rapier"
    package: ClassVar[str] = "trebucheck-rapier"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=False,
        joint_gaps=True,
        stop_torques=False,
        located_releases=False,
        stop_laws=frozenset(StopLaw),
        formulation="Cartesian coordinates in single precision, joints and limits by impulses in "
        "substeps, semi-implicit Euler",
        lacking=frozenset({Basic.POINT_STOP, Basic.REBOUND}),
        features=frozenset(Feature) - {Feature.MOVING_WALL},
    )
    default_options: ClassVar[Mapping[str, object] | None] = {"substeps": 4, "passes": 1}

    substeps: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=8,
        description="of a step, each with its own impulses (Rapier's numSolverIterations)",
    )
    passes: Annotated[int, Field(ge=1, le=10_000)] = Field(
        default=4, description="over all joints in a substep (Rapier's numInternalPgsIterations)"
    )
    least_inertia: LeastInertia = 1e-3
    carriage: Positive = Field(
        default=1e-3,
        le=1.0,
        description="mass of the body that runs in a slot, as a part of that of the body it "
        "carries: Rapier has no joint that both slides and turns",
    )
    opening: Positive = Field(
        default=1e-4,
        le=0.1,
        description="gap at which a stop has opened [rad]; its release is looked back for",
    )

    @property
    def supplied(self) -> Supplied:
        """Springs and motors are forces on the bodies, which Rapier's users apply themselves."""
        return {Part.ELEMENTS: ""}

    @classmethod
    def is_installed(cls) -> bool:
        """Tell whether Node.js is on the path and Rapier beside this package."""
        return RAPIER.is_installed()

    @classmethod
    def version(cls) -> str:
        """Version of Rapier's npm package; 'not installed' if there is none."""
        return RAPIER.version()

    @classmethod
    def absence(cls) -> str:
        """Missing program or package and how to install it, in one sentence."""
        return RAPIER.absence()

    def _run(self, problem: Problem) -> Recording:
        spread = NoPointMasses(problem.mechanism, self.least_inertia)
        built = Built(spread.mechanism, self.carriage)
        steps = math.ceil(problem.duration / self.timestep - 1e-9)
        scene = built.description(problem, problem.duration / steps, steps) | {
            "substeps": self.substeps,
            "passes": self.passes,
            "opening": self.opening,
        }
        samples = NodeSamples(
            built, np.linspace(0.0, problem.duration, steps + 1), RAPIER.move(scene)
        )
        found = samples.recording()
        potential = found.potential_energy - spread.extra_potential_energy
        return replace(
            found, potential_energy=potential, release_times=releases(samples, self.opening)
        )
