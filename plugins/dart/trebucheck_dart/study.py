"""DART's entries for studies: tolerances, orders and causes."""

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
from trebucheck_toolkit.scheme_tables import (
    EULER_STEPS,
    EULER_TOLERANCES,
    RK4_LOCATED,
    located_tolerances,
)


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (
        Cause(
            "own step",
            "semi-implicit Euler with limits, releases at a step's end",
            Intervention({"mode": "dynamics"}),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


STUDY = EngineStudy(
    causes=_causes,
    step_orders={"tuned": RK4_LOCATED, "stock": EULER_STEPS},
    option_sets=(STOCK_SET, TUNED_SET),
    tolerances=(*located_tolerances(), *EULER_TOLERANCES),
    colour="#c71585",
)
