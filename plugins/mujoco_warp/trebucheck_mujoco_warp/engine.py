"""MuJoCo Warp: MuJoCo rewritten for NVIDIA Warp, here on the processor, in single precision."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field
from trebucheck.engines.protocol import Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck.models.spec import Real
from trebucheck_toolkit.mujoco_models import (
    DEFAULTS,
    CompiledModel,
    MujocoModelEngine,
    capabilities_of,
    held_by_multipliers,
)

from .study import LEAST_TOLERANCE, STUDY


class MujocoWarpEngine(MujocoModelEngine):
    """MuJoCo Warp on the MJCF of trebucheck; the defaults are the assisted preset.

    By itself it steps the model that MuJoCo by itself has: the default preset is an empty model's
    options, the settings are RK4 with the hardest constraints that a step can bear. Assisted it
    moves the tree of joints (:mod:`trebucheck_toolkit.mujoco_models`). Its numbers have 24 bits.
    """

    name: ClassVar[str] = "mujoco_warp"
    package: ClassVar[str] = "mujoco-warp"
    module: ClassVar[str | None] = "mujoco_warp"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = capabilities_of("single")
    default_options: ClassVar[Mapping[str, object] | None] = DEFAULTS | {
        "tolerance": LEAST_TOLERANCE
    }
    # Nearer to 1 the impedance multiplies the rounding of a redundant loop's forces.
    settings_options: ClassVar[Mapping[str, object] | None] = {
        "limits": "soft",
        "solimp": (0.99, 0.99, 0.001, 0.5, 2.0),
    }
    assistance: ClassVar[tuple[Assistance, ...] | None] = held_by_multipliers("MuJoCo Warp")

    tolerance: Real = Field(
        default=LEAST_TOLERANCE,
        ge=LEAST_TOLERANCE,
        description="gain at which the solver stops; `put_model` raises smaller ones to 1e-6",
    )

    def _run_alone(self, problem: Problem) -> Recording:
        # Imported here so that the class, its options and its documentation need no Warp.
        from .world import run_alone

        return run_alone(problem, self.of_mujoco)

    def _built(self, mechanism: Mechanism) -> CompiledModel:
        from .world import Built

        return Built(mechanism, self.timestep)
