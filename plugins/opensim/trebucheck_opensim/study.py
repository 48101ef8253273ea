"""OpenSim's entries for studies: tolerances, orders and causes."""

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
from trebucheck_toolkit.scheme_tables import error_controlled, located_tolerances


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (
        Cause(
            "limit forces",
            "stops are springs with dampers, which give way and begin without force",
            Intervention({"limits": "locks"}),
        ),
        Cause(
            "accuracy",
            "the local error that the integrator is asked for",
            Intervention({"accuracy": 1e-12}),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        "tuned": error_controlled("Runge-Kutta-Merson: the step is only an upper bound"),
        "stock": error_controlled(
            "Runge-Kutta-Merson, stops as springs: the step is only an upper bound"
        ),
    },
    option_sets=(STOCK_SET, TUNED_SET),
    tolerances=located_tolerances(
        4,
        "error-controlled Runge-Kutta-Merson of order 4, at most 1 ms a step, an accuracy of 1e-11",
    ),
    colour="#a0522d",
)
