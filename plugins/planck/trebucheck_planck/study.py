"""planck.js's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from typing import Any

from trebucheck.engines.study import (
    REFINEMENT,
    STOCK_SET,
    TUNED_SET,
    Cause,
    ConstraintKinds,
    EngineStudy,
    Intervention,
    StepOrder,
    Tolerance,
    time_step_cause,
)


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (
        Cause(
            "iterations",
            "sequential impulses end before the joints hold",
            Intervention(
                {"first_iterations": 3000, "velocity_iterations": 1000, "position_iterations": 1000}
            ),
        ),
        Cause(
            "slops",
            "drift of joints and limits that is let be",
            Intervention({"linear_slop": 1e-9, "angular_slop": 1e-9}),
        ),
        Cause(
            "stops held from one side",
            "the correction of pins turns bodies, and opens limits",
            Intervention({"hold": True}),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


_SCHEME = "semi-implicit Euler, impulses"
_REASON = "semi-implicit Euler in Cartesian coordinates"
STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        "tuned": StepOrder(1.0, _REASON, _SCHEME),
        "stock": StepOrder(1.0, _REASON, _SCHEME),
    },
    option_sets=(STOCK_SET, TUNED_SET),
    tolerances=(
        Tolerance(
            "tuned", "position_max", 1e-2, 1e-4, 1, "first order: up to 100 m/s times a step"
        ),
        Tolerance("tuned", "release_time", 2e-4, 1e-4, 1, "two steps by scheme and end"),
        Tolerance(
            "tuned",
            "stop_torque_max",
            1e-3,
            1e-4,
            1,
            "a step of the tenth of a second in which one ends",
            per="peak",
        ),
    ),
    colour="#2e8b57",
)
