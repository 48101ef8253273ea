"""Drake's entries for studies: tolerances, orders and causes."""

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
    time_step_cause,
)
from trebucheck_toolkit.scheme_tables import EULER_STEPS, error_controlled, located_tolerances


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (
        Cause(
            "discrete plant",
            "semi-implicit Euler with compliant limits, where the continuous plant has neither",
            Intervention({"mode": "continuous"}),
        ),
        Cause(
            "accuracy",
            "the local error that the integrator is asked for",
            Intervention({"accuracy": 1e-13}),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        "tuned": error_controlled("RK5 (Dormand-Prince): the step is only an upper bound"),
        "stock": EULER_STEPS,
    },
    option_sets=(STOCK_SET, TUNED_SET),
    tolerances=located_tolerances(
        5, "error-controlled Runge-Kutta of order 5, at most 1 ms a step, an accuracy of 1e-10"
    ),
    colour="#1f4e9e",
)
