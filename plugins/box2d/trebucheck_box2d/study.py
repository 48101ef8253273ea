"""Box2D's entries for studies: tolerances, orders and causes."""

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
    StepOrder,
    Tolerance,
    time_step_cause,
)


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (
        Cause(
            "iterations",
            "sequential impulses end before the joints hold, or before their rounding settles",
            Intervention({"velocity_iterations": 10_000, "position_iterations": 1000}),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


_SCHEME = "semi-implicit Euler, impulses"
_REASON = "semi-implicit Euler in Cartesian coordinates, down to what single precision leaves"
_TORQUE = "a step's change of speed in single precision, 1e3 times by the matrix of pin and limit"
STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        ASSISTED: StepOrder(1.0, _REASON, _SCHEME),
        DEFAULT: StepOrder(1.0, _REASON, _SCHEME),
    },
    option_sets=(DEFAULT_SET, ASSISTED_SET),
    single_precision=lambda _: True,
    tolerances=(
        Tolerance(
            ASSISTED, "position_max", 4e-2, 1e-3, 1, "first order: up to 40 m/s times a step"
        ),
        Tolerance(
            ASSISTED,
            "release_time",
            5e-3,
            1e-3,
            1,
            "two steps by scheme and end, three by rounding",
        ),
        Tolerance(ASSISTED, "stop_torque_max", 2e-2, 1e-3, 1, _TORQUE, per="peak"),
    ),
    title="Box2D",
    binding="the Python wheel `box2d`, in single precision",
    maintainers_note=MaintainersNote(
        chosen="Iterations were raised until rounding is more than what they leave, and "
        "limits lie a little beyond the stops, since rounding decides whether a limit that is "
        "just met holds: {{ plain.agrees }} problems agree where nothing is set, "
        "{{ best.agrees }} with that.",
        not_possible="Limits have no restitution, and a stop on a point would be a shape with "
        "a contact, which our adapter does not build.",
        would_change="A build in double precision ({{ best.order }}), or the present Box2D, "
        "whose solver is another one than that of {{ version }}.",
    ),
    colour="#ff8c00",
)
