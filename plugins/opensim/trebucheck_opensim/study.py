"""OpenSim's entries for studies: tolerances, orders and causes."""

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
from trebucheck_toolkit.scheme_tables import error_controlled, located_tolerances


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (
        Cause(
            "limit forces",
            "stops are springs with dampers, which give way and begin without force",
            Intervention({"limits": "locks"}),
        ),
        Cause(
            "accuracy",
            "the local error that the integrator is asked for",
            Intervention({"accuracy": 1e-12}),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        ASSISTED: error_controlled("Runge-Kutta-Merson: the step is only an upper bound"),
        DEFAULT: error_controlled(
            "Runge-Kutta-Merson, stops as springs: the step is only an upper bound"
        ),
    },
    option_sets=(DEFAULT_SET, ASSISTED_SET),
    tolerances=located_tolerances(
        4,
        "error-controlled Runge-Kutta-Merson of order 4, at most 1 ms a step, an accuracy of 1e-11",
    ),
    title="OpenSim",
    binding="the Python wheel `opensim`, with its own build of Simbody",
    maintainers_note=MaintainersNote(
        chosen="Simbody's error control to a finer accuracy, with a coordinate locked while "
        "its stop holds: `CoordinateLimitForce` begins without force and chatters. "
        "{{ plain.agrees }} problems agree without that, {{ best.agrees }} with it.",
        not_possible="Our adapter builds loops, springs, motors and stops that are on no "
        "joint as multipliers and forces of its own, not as Simbody's constraints and forces.",
        would_change="An adapter that builds them as Simbody's, and a limit that starts with "
        "its load.",
    ),
    colour="#a0522d",
)
