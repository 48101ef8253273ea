"""OpenSim's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from typing import Any

from trebucheck.engines.presets import ASSISTED, DEFAULT, SETTINGS
from trebucheck.engines.study import (
    ASSISTED_SET,
    DEFAULT_SET,
    HALF_THE_STEP,
    REFINEMENT,
    SETTINGS_SET,
    Cause,
    ConstraintKinds,
    EngineStudy,
    Intervention,
    MaintainersNote,
    OptionSet,
    Refinement,
    multiplied,
    time_step_cause,
    with_readout,
)
from trebucheck_toolkit.alone import own_program
from trebucheck_toolkit.scheme_tables import error_controlled, located_tolerances

PYTHON = "OpenSim in Python"


def _causes(settings: Any, constraints: ConstraintKinds) -> tuple[Cause, ...]:
    accuracy = Cause(
        "accuracy",
        "the local error that the integrator is asked for",
        Intervention({"samples": "steps", "accuracy": min(1e-12, float(settings["accuracy"]))}),
    )
    step = time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT})
    if settings["limits"] == "locks" or not constraints.angles:
        return with_readout(accuracy, step)
    return with_readout(
        Cause(
            "limit forces",
            "stops are springs with dampers, which give way and begin without force",
            Intervention({"limits": "locks", "samples": "steps"}),
        ),
        accuracy,
        step,
    )


STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        DEFAULT: error_controlled(
            "Runge-Kutta-Merson in steps of its own, whatever the time step: errors follow the "
            "accuracy"
        ),
        SETTINGS: error_controlled(
            "Runge-Kutta-Merson, stops as springs: the step is only an upper bound"
        ),
        ASSISTED: error_controlled("Runge-Kutta-Merson: the step is only an upper bound"),
    },
    refinements=(
        HALF_THE_STEP,
        Refinement("accuracy", "a hundredth of the accuracy", multiplied("accuracy", 0.01)),
    ),
    option_sets=(
        DEFAULT_SET,
        OptionSet(
            "accuracy of 1e-6",
            "default, with a state at every step and an accuracy of 1e-6",
            DEFAULT,
            {"accuracy": 1e-6, "samples": "steps"},
        ),
        SETTINGS_SET,
        ASSISTED_SET,
    ),
    tolerances=located_tolerances(
        4,
        "error-controlled Runge-Kutta-Merson of order 4, at most 1 ms a step, an accuracy of 1e-11",
    ),
    snippets=own_program(PYTHON),
    title="OpenSim",
    binding="the Python wheel `opensim`, with its own build of Simbody",
    maintainers_note=MaintainersNote(
        chosen="Its default is a Manager of which nothing is set, with the softest "
        "`CoordinateLimitForce`, as it is made; a finer accuracy, a state at every step and "
        "stiffer limits are what options add: of the free swing "
        "{{ plain.error('free-swing', 'position') }} by itself, "
        "{{ alone.error('free-swing', 'position') }} with its options.",
        not_possible="A limit force begins without its load, chatters and has no restitution; our "
        "adapter builds no contacts, and no loops that hold an angle, though OpenSim has both. "
        "Where a fine accuracy asks for them, small steps halt at a singular position of a loop, "
        "which longer ones pass over.",
        would_change="A limit that starts with its load, and an adapter that builds contacts and "
        "welds in loops.",
    ),
    colour="#a0522d",
)
