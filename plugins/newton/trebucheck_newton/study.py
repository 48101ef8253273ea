"""What studies need to know of Newton."""

from __future__ import annotations

from trebucheck.engines.study import STOCK_SET, TUNED_SET, EngineStudy, StepOrder

STUDY = EngineStudy(
    step_orders={
        "tuned": StepOrder(
            None, "MuJoCo's RK4 between states of single precision, whose floor it is at", "RK4, joint coordinates"
        ),
        "stock": StepOrder(1.0, "semi-implicit Euler in joint coordinates", "semi-implicit Euler, joint coordinates"),
    },
    option_sets=(STOCK_SET, TUNED_SET),
    colour="#76b900",
)
