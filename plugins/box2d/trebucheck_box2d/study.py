"""What studies need to know of Box2D."""

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
    time_step_cause,
)


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (
        Cause("iterations", "sequential impulses end before the joints hold",
              Intervention({"velocity_iterations": 10_000, "position_iterations": 1000})),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )  # fmt: skip


_SCHEME = "semi-implicit Euler, impulses"
_REASON = "semi-implicit Euler in Cartesian coordinates; at short steps the floor of single precision"
STUDY = EngineStudy(
    causes=_causes,
    step_orders={"tuned": StepOrder(1.0, _REASON, _SCHEME), "stock": StepOrder(1.0, _REASON, _SCHEME)},
    option_sets=(STOCK_SET, TUNED_SET),
    colour="#ff8c00",
)
