"""Newton's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from trebucheck.engines.study import STOCK_SET, TUNED_SET, EngineStudy, StepOrder, Tolerance
from trebucheck_toolkit.scheme_tables import EULER_STEPS, EULER_TOLERANCES

STUDY = EngineStudy(
    step_orders={
        "tuned": StepOrder(
            None,
            "MuJoCo's RK4 between states of single precision, whose floor it is at",
            "RK4, joint coordinates",
        ),
        "stock": EULER_STEPS,
    },
    option_sets=(STOCK_SET, TUNED_SET),
    single_precision=lambda _: True,
    tolerances=(
        Tolerance(
            "tuned",
            "release_time",
            2e-3,
            1e-3,
            1,
            "at a step's end, of limits that have settled in 0.1 s",
        ),
        *EULER_TOLERANCES,
    ),
    colour="#76b900",
)
