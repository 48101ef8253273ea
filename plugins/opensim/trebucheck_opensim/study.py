"""What studies need to know of OpenSim."""

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
        Cause("limit forces", "stops are springs with dampers, which give way and begin without force",
              Intervention({"limits": "locks"})),
        Cause("accuracy", "the local error that the integrator is asked for", Intervention({"accuracy": 1e-12})),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )  # fmt: skip


_NEED = "error-controlled Runge-Kutta-Merson of order 4, at most 1 ms a step, an accuracy of 1e-11"
STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        "tuned": StepOrder(
            None,
            "error-controlled Runge-Kutta-Merson: the step is only an upper bound",
            "error-controlled Runge-Kutta, joint coordinates",
        ),
        "stock": StepOrder(
            None,
            "error-controlled Runge-Kutta-Merson, stops as springs: the step is an upper bound",
            "error-controlled Runge-Kutta, joint coordinates",
        ),
    },
    option_sets=(STOCK_SET, TUNED_SET),
    tolerances=(
        Tolerance("tuned", "position_max", 1e-8, 1e-3, 4, _NEED),
        Tolerance("tuned", "release_time", 1e-9, 1e-3, 4, _NEED),
        Tolerance("tuned", "stop_torque_max", 1e-9, 1e-3, 4, _NEED, per="peak"),
    ),
    colour="#a0522d",
)
