"""What studies need to know of DART."""

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
        Cause("own step", "semi-implicit Euler with limits, releases at a step's end",
              Intervention({"mode": "dynamics"})),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )  # fmt: skip


_NEED = "fourth order: RK4 with located releases"
_FIRST = "first order: the projectile, at up to 40 m/s, is a step's time off"
STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        "tuned": StepOrder(4.0, "RK4 in joint coordinates, events located to rounding", "RK4, joint coordinates"),
        "stock": StepOrder(
            1.0,
            "semi-implicit Euler in joint coordinates, releases at a step's end",
            "semi-implicit Euler, joint coordinates",
        ),
    },
    option_sets=(STOCK_SET, TUNED_SET),
    tolerances=(
        Tolerance("tuned", "position_max", 1e-8, 1e-3, 4, _NEED),
        Tolerance("tuned", "release_time", 1e-9, 1e-3, 4, _NEED),
        Tolerance("tuned", "stop_torque_max", 1e-9, 1e-3, 4, _NEED, per="peak"),
        Tolerance("stock", "position_max", 4e-2, 1e-3, 1, _FIRST),
        Tolerance("stock", "release_time", 2e-3, 1e-3, 1, "first order: a step late by the scheme, one by its end"),
    ),
    colour="#c71585",
)
