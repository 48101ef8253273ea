"""DART's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from typing import Any

from trebucheck.engines.presets import ASSISTED, DEFAULT, SETTINGS
from trebucheck.engines.study import (
    ASSISTED_SET,
    DEFAULT_SET,
    REFINEMENT,
    SETTINGS_SET,
    Cause,
    ConstraintKinds,
    EngineStudy,
    Intervention,
    MaintainersNote,
    time_step_cause,
)
from trebucheck_toolkit.scheme_tables import (
    EULER_STEPS,
    RK4_LOCATED,
    euler_tolerances,
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
    step_orders={DEFAULT: EULER_STEPS, SETTINGS: EULER_STEPS, ASSISTED: RK4_LOCATED},
    option_sets=(DEFAULT_SET, SETTINGS_SET, ASSISTED_SET),
    tolerances=(
        *located_tolerances(),
        *euler_tolerances(DEFAULT),
        *euler_tolerances(SETTINGS),
    ),
    title="DART",
    binding="the Python wheel `dartpy`",
    maintainers_note=MaintainersNote(
        chosen="Its own steps have no option but their length, so that default and settings are "
        "one: semi-implicit Euler in joint coordinates, order {{ alone.order }}; limits are "
        "enforced, which DART does not do where it is not asked to.",
        not_possible="Its Python wheel tells what constraints that close loops do to joints, not "
        "to bodies: our adapter reads the forces of such pins off the bodies' accelerations and "
        "the other joints' forces. There are springs of joints and none between points, so that "
        "their forces are given before each step; our adapter closes loops by pins alone, and "
        "builds no stops on points and no restitution from DART's own elements.",
        would_change="The impulses of constraints on bodies in Python, as those of joints are "
        "there (`Joint.getConstraintImpulse`); a step of higher order: the same mass matrix and "
        "forces are right to rounding, as the model check shows.",
    ),
    colour="#c71585",
)
