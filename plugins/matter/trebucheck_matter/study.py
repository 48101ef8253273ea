"""matter-js's entries for studies: orders and causes."""

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
    Refinement,
    StepOrder,
    multiplied,
    time_step_cause,
)
from trebucheck_toolkit.alone import own_program

FINE = 1e6
"""Pixels of a metre with which a pin's error of inertia, one pixel^2, is far below any other."""


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    stable = 0.1  # part of a gap, of which a body with the least inertia takes back ten times more
    part = float(settings["stiffness"]) * float(settings["timestep"]) * 60
    return (
        *(
            [
                Cause(
                    "stiffness",
                    "a correction is greater than the gap, and pins fly apart",
                    Intervention({"stiffness": float(settings["stiffness"]) * stable / part}),
                )
            ]
            if part > stable
            else []
        ),
        Cause("air friction", "every body loses speed", Intervention({"air_friction": 0.0})),
        Cause(
            "unit of length",
            "a pin turns a body as if each kilogram had an inertia of one pixel^2 more",
            Intervention({"pixels": FINE}),
        ),
        Cause(
            "iterations",
            "the pins' gaps are taken back in part",
            Intervention({"iterations": 10 * int(settings["iterations"])}),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


_SCHEME = "position-based dynamics of bodies"
_REASON = "Verlet's step, and corrections of positions after it"
STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        DEFAULT: StepOrder(None, "air friction and the unit of length stay at every step", _SCHEME),
        **{preset: StepOrder(1.0, _REASON, _SCHEME) for preset in (SETTINGS, ASSISTED)},
    },
    refinements=(
        HALF_THE_STEP,
        Refinement("iterations", "twice as many", multiplied("iterations", 2)),
        Refinement("unit of length", "a tenth of it", multiplied("pixels", 10)),
    ),
    option_sets=(DEFAULT_SET, SETTINGS_SET, ASSISTED_SET),
    snippets=own_program("matter-js in Node.js"),
    title="matter-js",
    binding="the npm package `matter-js`, moved by Node.js",
    maintainers_note=MaintainersNote(
        chosen="`default` sets nothing: each step takes a hundredth of every speed, pins of "
        "slender bodies fly apart, and a hundred pixels make a metre; `settings` has no air "
        "friction, shorter steps, and pixels so small that what a pin adds to an inertia, a "
        "square pixel for each kilogram, is nothing: {{ plain.agrees }} problems agree where "
        "nothing is set, {{ alone.agrees }} with that, {{ best.agrees }} with assistance.",
        not_possible="Its one joint is a distance between two points: it has no slots, sliders or "
        "limits, and tells no forces; our adapter builds no stops by contacts of shapes, a weld "
        "as two pins, and gives springs as forces.",
        would_change="Resistances to moving and turning that are not added in the unit of length; "
        "a warming of two thirds, with which pins lose hardly any energy; until then shorter "
        "steps, as what breaks is the error of a step, of order {{ best.order }}.",
    ),
    colour="#4b5562",
)
