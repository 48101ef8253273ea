"""Rapier's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from typing import Any

from trebucheck.engines.study import (
    HALF_THE_STEP,
    REFINEMENT,
    STOCK_SET,
    TUNED_SET,
    Cause,
    ConstraintKinds,
    EngineStudy,
    Refinement,
    StepOrder,
    multiplied,
    time_step_cause,
)


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),)


_SCHEME = "semi-implicit Euler, impulses"
_REASON = (
    "semi-implicit Euler in substeps of Cartesian coordinates; at short steps the floor of single "
    "precision"
)
STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        "tuned": StepOrder(1.0, _REASON, _SCHEME),
        "stock": StepOrder(1.0, _REASON, _SCHEME),
    },
    refinements=(
        HALF_THE_STEP,
        Refinement("mass in slots", "a tenth of it", multiplied("carriage", 0.1)),
    ),
    option_sets=(STOCK_SET, TUNED_SET),
    single_precision=lambda _: True,
    colour="#b8860b",
)
