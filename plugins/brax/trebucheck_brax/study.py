"""Brax's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from typing import Any

from trebucheck.engines.presets import ASSISTED, PRESETS
from trebucheck.engines.study import (
    ASSISTED_SET,
    DEFAULT_SET,
    REFINEMENT,
    SETTINGS_SET,
    Cause,
    ConstraintKinds,
    EngineStudy,
    Intervention,
    MaintainersNote,
    StepOrder,
    Tolerance,
    time_step_cause,
)
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem


def _causes(settings: Any, constraints: ConstraintKinds) -> tuple[Cause, ...]:
    return (time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),)


STUDY = EngineStudy(causes=_causes, title="Brax", colour="#d4267f")
