"""matter-js's entries for studies: orders and causes."""

from __future__ import annotations

from typing import Any

from trebucheck.engines.presets import ASSISTED, DEFAULT, SETTINGS
from trebucheck.engines.study import (
    ASSISTED_SET,
    DEFAULT_SET,
    HALF_THE_STEP,
    REFINEMENT,
    SETTINGS_SET,
    Cause,
    ConstraintKinds,
    EngineStudy,
    Intervention,
    MaintainersNote,
    Refinement,
    StepOrder,
    multiplied,
    time_step_cause,
)
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem

FINE = 1e6
"""Pixels of a metre with which a pin's error of inertia, one pixel^2, is far below any other."""


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (
        Cause("air friction", "every body loses speed", Intervention({"air_friction": 0.0})),
        Cause(
            "unit of length",
            "a pin turns a body as if each kilogram had an inertia of one pixel^2 more",
            Intervention({"pixels": FINE}),
        ),
        Cause(
            "iterations",
            "the pins' gaps are taken back in part",
            Intervention({"iterations": 20 * int(settings["iterations"])}),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


def _snippets(engine: Any, mechanism: Mechanism, duration: float) -> dict[str, str]:
    if engine.assisted_by:
        return {}
    return {"matter-js in Node.js": engine.script(Problem(mechanism, duration=duration))}


_SCHEME = "semi-implicit Euler, impulses"
_REASON = "Verlet's step from a start of speeds, and corrections of positions after it"
STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        DEFAULT: StepOrder(None, "air friction and the unit of length stay at every step", _SCHEME),
        **{preset: StepOrder(1.0, _REASON, _SCHEME) for preset in (SETTINGS, ASSISTED)},
    },
    refinements=(
        HALF_THE_STEP,
        Refinement("iterations", "twice as many", multiplied("iterations", 2)),
    ),
    option_sets=(DEFAULT_SET, SETTINGS_SET, ASSISTED_SET),
    snippets=_snippets,
    title="matter-js",
    binding="the npm package `matter-js`, moved by Node.js",
    maintainers_note=MaintainersNote(
        chosen="TODO",
        not_possible="TODO",
        would_change="TODO",
    ),
    colour="#4b5562",
)
