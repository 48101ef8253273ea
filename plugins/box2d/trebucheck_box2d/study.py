"""Box2D's entries for studies: tolerances, orders and causes."""

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
    # As many in a second of motion at every step, so that a run ends.
    many = min(10_000, round(1e7 * float(settings["timestep"])))
    return (
        Cause(
            "iterations",
            "sequential impulses end before the joints hold, or before their rounding settles",
            Intervention({"velocity_iterations": many, "position_iterations": many // 10}),
        ),
        Cause(
            "sleep",
            "bodies that hardly move for half a second are stopped",
            Intervention({"allow_sleep": False}),
        ),
        Cause(
            "limits at the stops",
            "a limit is active only where its angle is not short of it by rounding",
            Intervention({"set_back": 1e-3}),
        ),
        Cause(
            "limits that stay",
            "a stop that is open for good is met again",
            Intervention({"keep_limits": False}),
            after=("limits at the stops",),
        ),
        Cause(
            "little inertia",
            "a body of little inertia takes large changes of speed from rounded impulses",
            Intervention({"least_inertia": 1e-3}),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


_SCHEME = "semi-implicit Euler, impulses"
_REASON = "semi-implicit Euler in Cartesian coordinates, down to what single precision leaves"
_TORQUE = "a step's change of speed in single precision, 1e3 times by the matrix of pin and limit"
STUDY = EngineStudy(
    causes=_causes,
    step_orders={preset: StepOrder(1.0, _REASON, _SCHEME) for preset in PRESETS},
    option_sets=(DEFAULT_SET, SETTINGS_SET, ASSISTED_SET),
    snippets=own_program("Box2D in Python"),
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
        chosen="`Step` has no defaults, so step and iterations of `default` are those of Box2D's "
        "first example; `settings` has shorter steps, down to where single precision rounds as "
        "much as they leave out, more iterations and no sleep: {{ plain.agrees }} problems agree "
        "where nothing is set, {{ alone.agrees }} with that, {{ best.agrees }} with assistance.",
        not_possible="Limits have no restitution; springs are soft joints, which have a frequency "
        "and no stiffness, so that the adapter gives springs as forces before each step; a stop "
        "on a point would be a shape with a contact, which our adapter does not build.",
        would_change="A build in double precision, or the present Box2D, whose solver is another "
        "one than that of {{ version }}.",
    ),
    colour="#ff8c00",
)
