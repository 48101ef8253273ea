"""Pinocchio's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from typing import Any

from trebucheck.engines.presets import ASSISTED
from trebucheck.engines.study import (
    ASSISTED_SET,
    REFINEMENT,
    Cause,
    ConstraintKinds,
    EngineStudy,
    Intervention,
    MaintainersNote,
    OptionSet,
    time_step_cause,
)
from trebucheck_toolkit.scheme_tables import RK4_LOCATED, located_tolerances


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (
        Cause(
            "event location",
            "a stop is let go at the end of the step in which its torque vanishes",
            Intervention({"locate_releases": True}),
        ),
        Cause(
            "scheme",
            "what semi-implicit Euler leaves out of a step",
            Intervention({"scheme": "RK4"}),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


STUDY = EngineStudy(
    causes=_causes,
    step_orders={ASSISTED: RK4_LOCATED},
    option_sets=(
        OptionSet(
            "semi-implicit Euler",
            "the loop of Pinocchio's examples, releases at a step's end",
            ASSISTED,
            {"scheme": "semi-implicit Euler", "locate_releases": False},
        ),
        ASSISTED_SET,
    ),
    tolerances=located_tolerances(),
    title="Pinocchio",
    binding="the Python wheel `pin`",
    maintainers_note=MaintainersNote(
        chosen="There is nothing to set: Pinocchio computes the dynamics of trees and has no "
        "time steps; those of the runs are trebucheck's.",
        not_possible="Stops, events and steps are no part of it, so that a run speaks for its "
        "mass matrix, forces and energies alone.",
        would_change="A check of its dynamics by themselves, and not of a motion.",
    ),
    colour="#0b6e4f",
)
