"""Drake's entries for studies: tolerances, orders and causes."""

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
    StepOrder,
    time_step_cause,
)
from trebucheck_toolkit.scheme_tables import EULER_STEPS, error_controlled, located_tolerances


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (
        Cause(
            "plant with time steps",
            "semi-implicit Euler where nothing has to be held and a continuous plant would do",
            Intervention({"continuous_plant": True}),
        ),
        Cause(
            "discrete plant",
            "semi-implicit Euler with compliant limits, where the continuous plant has neither",
            Intervention({"mode": "continuous"}),
        ),
        Cause(
            "accuracy",
            "the local error that the integrator is asked for",
            Intervention({"accuracy": 1e-13}),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        DEFAULT: EULER_STEPS,
        SETTINGS: StepOrder(
            None,
            "of first order with stops, loops or loads; else error-controlled RK5",
            "semi-implicit Euler, joint coordinates",
        ),
        ASSISTED: error_controlled("RK5 (Dormand-Prince): the step is only an upper bound"),
    },
    option_sets=(DEFAULT_SET, SETTINGS_SET, ASSISTED_SET),
    tolerances=located_tolerances(
        5, "error-controlled Runge-Kutta of order 5, at most 1 ms a step, an accuracy of 1e-10"
    ),
    title="Drake",
    binding="the Python wheel `drake`",
    maintainers_note=MaintainersNote(
        chosen="A plant with time steps is what `MultibodyPlantConfig` makes, of order "
        "{{ plain.order }}; where nothing has to be held, settings take a continuous plant and an "
        "error-controlled Runge-Kutta rule to an accuracy that is set.",
        not_possible="A continuous plant has no joint limits and no constraints. A discrete one "
        "counts the forces of constraints that close loops in the reactions of joints, and has "
        "no port that tells them: our adapter reads those of pins off the bodies' accelerations "
        "and the joints' reactions. It closes loops by pins alone, and builds no stops on "
        "points and no restitution from Drake's own elements.",
        would_change="Limits and constraints in continuous plants; an output port of the forces "
        "of constraints in discrete ones.",
    ),
    colour="#1f4e9e",
)
