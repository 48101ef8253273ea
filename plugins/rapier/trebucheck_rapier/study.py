"""Rapier's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from typing import Any

from trebucheck.engines.presets import ASSISTED, DEFAULT
from trebucheck.engines.study import (
    ASSISTED_SET,
    DEFAULT_SET,
    HALF_THE_STEP,
    REFINEMENT,
    Cause,
    ConstraintKinds,
    EngineStudy,
    MaintainersNote,
    Refinement,
    StepOrder,
    multiplied,
    time_step_cause,
)


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),)


_SCHEME = "semi-implicit Euler, impulses"
_REASON = (
    "semi-implicit Euler in substeps of Cartesian coordinates; at short steps the floor of single "
    "precision"
)
STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        ASSISTED: StepOrder(1.0, _REASON, _SCHEME),
        DEFAULT: StepOrder(1.0, _REASON, _SCHEME),
    },
    refinements=(
        HALF_THE_STEP,
        Refinement("mass in slots", "a tenth of it", multiplied("carriage", 0.1)),
    ),
    option_sets=(DEFAULT_SET, ASSISTED_SET),
    single_precision=lambda _: True,
    title="Rapier",
    binding="the npm package `@dimforge/rapier2d-compat`, moved by Node.js, in single precision",
    maintainers_note=MaintainersNote(
        chosen="Impulse joints with more substeps and passes; its multibody joints lose "
        "energy at any step. {{ plain.agrees }} problems agree where less is set, "
        "{{ best.agrees }} with that.",
        not_possible="Its interface of JavaScript tells no forces of joints and limits, and "
        "no accelerations: reactions are not judged, and releases are looked back for from "
        "how gaps open. Our adapter builds no stops on points and no restitution.",
        would_change="A build in double precision, and forces of joints in the interface: at "
        "short steps rounding is what is left ({{ best.order }}).",
    ),
    colour="#b8860b",
)
