"""What studies need to know of MJX."""

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
        Cause("soft limits", "stops are springs with dampers of MuJoCo's stock stiffness, which give way",
              Intervention({"limits": "multipliers"})),
        Cause("precision", "numbers of 24 bits", Intervention({"precision": "double"})),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )  # fmt: skip


_NEED = "fourth order: RK4 with located releases"
STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        "tuned": StepOrder(
            4.0, "RK4 in joint coordinates, double precision, events located to rounding", "RK4, joint coordinates"
        ),
        "stock": StepOrder(None, "RK4 in single precision: its floor, and soft limits", "RK4, joint coordinates"),
    },
    option_sets=(STOCK_SET, TUNED_SET),
    tolerances=(
        Tolerance("tuned", "position_max", 1e-8, 1e-3, 4, _NEED),
        Tolerance("tuned", "release_time", 1e-9, 1e-3, 4, _NEED),
        Tolerance("tuned", "stop_torque_max", 1e-9, 1e-3, 4, _NEED, per="peak"),
    ),
    colour="#6a3d9a",
)
