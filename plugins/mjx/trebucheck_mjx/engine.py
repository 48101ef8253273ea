"""MJX: MuJoCo rewritten in JAX."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

from pydantic import Field
from trebucheck.engines.protocol import Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.mujoco_models import (
    DEFAULTS,
    OWN,
    CompiledModel,
    MujocoModelEngine,
    capabilities_of,
    held_by_multipliers,
    program,
)

from .study import STUDY


class MjxEngine(MujocoModelEngine):
    """MJX on the MJCF of trebucheck; the defaults are the assisted preset.

    By itself (:mod:`.alone`) MJX steps the model that MuJoCo by itself has. The default preset is
    MuJoCo's empty model in JAX's single precision; the settings are those of MuJoCo in double
    precision. Assisted, in double precision, it moves the tree of joints
    (:mod:`trebucheck_toolkit.mujoco_models`).

    Raises:
        InputError: an option is unknown or outside its range, or one of MJX's is changed where
            multipliers hold what it is about.
    """

    name: ClassVar[str] = "mjx"
    package: ClassVar[str] = "mujoco-mjx"
    module: ClassVar[str | None] = "mujoco.mjx"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = capabilities_of("double")
    default_options: ClassVar[Mapping[str, object] | None] = {**DEFAULTS, "precision": "single"}
    assistance: ClassVar[tuple[Assistance, ...] | None] = held_by_multipliers("MJX")
    own: ClassVar[tuple[str, ...]] = ("precision", *OWN)

    precision: Literal["double", "single"] = Field(
        default="double", description="of MJX's numbers (`jax_enable_x64`)"
    )

    # Imported here so that the class, its options and its documentation need no MJX.

    def _run_alone(self, problem: Problem) -> Recording:
        from .alone import run_alone

        return run_alone(problem, self.of_mujoco, double=self.precision == "double")

    def _built(self, mechanism: Mechanism) -> CompiledModel:
        from .build import Built

        return Built(mechanism, self.timestep, double=True)

    def _script(self, problem: Problem) -> str:
        from .alone import CHUNK

        double = self.precision == "double"
        return program(__name__, problem, self.of_mujoco, double=double, chunk=CHUNK)
