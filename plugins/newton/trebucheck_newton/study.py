"""Newton's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from trebucheck.engines.presets import ASSISTED, DEFAULT
from trebucheck.engines.study import (
    ASSISTED_SET,
    DEFAULT_SET,
    EngineStudy,
    MaintainersNote,
    StepOrder,
    Tolerance,
)
from trebucheck_toolkit.scheme_tables import EULER_STEPS, EULER_TOLERANCES

STUDY = EngineStudy(
    step_orders={
        ASSISTED: StepOrder(
            None,
            "MuJoCo's RK4 between states of single precision, whose floor it is at",
            "RK4, joint coordinates",
        ),
        DEFAULT: EULER_STEPS,
    },
    option_sets=(DEFAULT_SET, ASSISTED_SET),
    single_precision=lambda _: True,
    tolerances=(
        Tolerance(
            ASSISTED,
            "release_time",
            2e-3,
            1e-3,
            1,
            "at a step's end, of limits that have settled in 0.1 s",
        ),
        *EULER_TOLERANCES,
    ),
    title="Newton",
    binding="the Python wheel `newton`, on the processor",
    maintainers_note=MaintainersNote(
        chosen="`SolverMuJoCo` by RK4 in the place of `SolverFeatherstone`: "
        "{{ plain.agrees }} problems agree with the one, {{ best.agrees }} with the other.",
        not_possible="A state has single precision between steps with either solver; "
        "`SolverFeatherstone` tells no torques of its limits, and its joint forces are wrong "
        "at any step. Our adapter builds no loops and no stops on points.",
        would_change="A state in double precision, and limits that begin with their force.",
    ),
    colour="#76b900",
)
