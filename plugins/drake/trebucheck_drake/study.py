"""What studies need to know of Drake."""

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
        Cause("discrete plant", "semi-implicit Euler with compliant limits, where the continuous plant has neither",
              Intervention({"mode": "continuous"})),
        Cause("accuracy", "the local error that the integrator is asked for", Intervention({"accuracy": 1e-13})),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )  # fmt: skip


_NEED = "error-controlled Runge-Kutta of order 5, at most 1 ms a step, an accuracy of 1e-10"
STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        "tuned": StepOrder(
            None,
            "error-controlled RK5 (Dormand-Prince): the step is only an upper bound",
            "error-controlled Runge-Kutta, joint coordinates",
        ),
        "stock": StepOrder(
            1.0,
            "semi-implicit Euler in joint coordinates, limits as compliant constraints",
            "semi-implicit Euler, joint coordinates",
        ),
    },
    option_sets=(STOCK_SET, TUNED_SET),
    tolerances=(
        Tolerance("tuned", "position_max", 1e-8, 1e-3, 5, _NEED),
        Tolerance("tuned", "release_time", 1e-9, 1e-3, 5, _NEED),
        Tolerance("tuned", "stop_torque_max", 1e-9, 1e-3, 5, _NEED, per="peak"),
    ),
    colour="#1f4e9e",
)
