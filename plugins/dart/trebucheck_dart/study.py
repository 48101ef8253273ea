"""DART's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from typing import Any

from trebucheck.engines.presets import ASSISTED, DEFAULT
from trebucheck.engines.study import (
    ASSISTED_SET,
    DEFAULT_SET,
    REFINEMENT,
    Cause,
    ConstraintKinds,
    EngineStudy,
    Intervention,
    MaintainersNote,
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
    step_orders={ASSISTED: RK4_LOCATED, DEFAULT: EULER_STEPS},
    option_sets=(DEFAULT_SET, ASSISTED_SET),
    tolerances=(*located_tolerances(), *EULER_TOLERANCES),
    title="DART",
    binding="the Python wheel `dartpy`",
    maintainers_note=MaintainersNote(
        chosen="Its own steps have no option but their length: semi-implicit Euler in joint "
        "coordinates, order {{ plain.order }}.",
        not_possible="Limits are on joints alone, and forces of constraints that close loops "
        "are not told; our adapter builds no loops, no stops on points and no restitution "
        "from DART's own elements.",
        would_change="A step of higher order: the same mass matrix and forces are right to "
        "rounding, as the model check shows.",
    ),
    colour="#c71585",
)
