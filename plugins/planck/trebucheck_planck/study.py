"""planck.js's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from typing import Any

from trebucheck.engines.presets import ASSISTED, PRESETS
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
    Tolerance,
    time_step_cause,
)
from trebucheck_toolkit.alone import own_program


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (
        Cause(
            "iterations",
            "sequential impulses end before the joints hold",
            Intervention(
                {"first_iterations": 3000, "velocity_iterations": 1000, "position_iterations": 1000}
            ),
        ),
        Cause(
            "slops",
            "drift of joints and limits that is let be",
            Intervention({"linear_slop": 1e-9, "angular_slop": 1e-9}),
        ),
        Cause(
            "sleep",
            "bodies that hardly move for half a second are stopped",
            Intervention({"allow_sleep": False}),
        ),
        Cause(
            "stops held from one side",
            "the correction of pins turns bodies, and opens limits",
            Intervention({"hold": True}),
        ),
        Cause(
            "limits that stay",
            "a stop that is open for good is met again",
            Intervention({"keep_limits": False}),
            after=("stops held from one side",),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


_SCHEME = "semi-implicit Euler, impulses"
_REASON = "semi-implicit Euler in Cartesian coordinates"
STUDY = EngineStudy(
    causes=_causes,
    step_orders={preset: StepOrder(1.0, _REASON, _SCHEME) for preset in PRESETS},
    option_sets=(DEFAULT_SET, SETTINGS_SET, ASSISTED_SET),
    snippets=own_program("planck.js in Node.js"),
    tolerances=(
        Tolerance(
            ASSISTED, "position_max", 1e-2, 1e-4, 1, "first order: up to 100 m/s times a step"
        ),
        Tolerance(ASSISTED, "release_time", 2e-4, 1e-4, 1, "two steps by scheme and end"),
        Tolerance(
            ASSISTED,
            "stop_torque_max",
            1e-3,
            1e-4,
            1,
            "a step of the tenth of a second in which one ends",
            per="peak",
        ),
    ),
    title="planck.js",
    binding="the npm package `planck`, moved by Node.js",
    maintainers_note=MaintainersNote(
        chosen="`default` is a world that sets nothing, at the step of planck.js's HelloWorld; "
        "`settings` has shorter steps, smaller slops, no sleep, and a first step of many "
        "iterations, as each start begins without impulses: {{ plain.agrees }} problems agree "
        "where nothing is set, {{ alone.agrees }} with that, {{ best.agrees }} with assistance.",
        not_possible="A limit that holds from one side is opened by the correction of the pins, "
        "so that with assistance a stop is held from both sides while it pushes; limits have no "
        "restitution, springs a frequency and no stiffness, so that the adapter gives springs as "
        "forces, and our adapter builds no stops on points.",
        would_change="Shorter steps: what breaks is the error of a step, of order "
        "{{ best.order }}.",
    ),
    colour="#2e8b57",
)
