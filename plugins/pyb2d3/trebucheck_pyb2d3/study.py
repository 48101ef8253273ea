"""Box2D 3's entries for studies: tolerances, orders and causes."""

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
    Tolerance,
    time_step_cause,
)
from trebucheck_toolkit.alone import own_program


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    timestep, sub_steps = float(settings["timestep"]), int(settings["sub_steps"])
    # Box2D makes no joint stiffer than a quarter of the sub-steps a second.
    stiffest = Intervention({"world_step": max(timestep, sub_steps / 240)})
    solved = Intervention({"sub_steps": min(10_000, 8 * sub_steps)})
    awake, taken_out = Intervention({"allow_sleep": False}), Intervention({"keep_limits": False})
    return (
        Cause("joints of 60 Hz", "joints and limits give way like springs of 60 Hz", stiffest),
        Cause("sub-steps", "joints are solved once in each sub-step", solved),
        Cause("sleep", "bodies that hardly move for half a second are stopped", awake),
        Cause("limits that stay", "a stop that is open for good is met again", taken_out),
        time_step_cause({"timestep": timestep / REFINEMENT}),
    )


_SCHEME = "semi-implicit Euler, impulses"
_SOFT = StepOrder(1.0, "semi-implicit Euler, down to what joints of 60 Hz leave", _SCHEME)
_STIFF = StepOrder(1.0, "semi-implicit Euler, down to what single precision leaves", _SCHEME)
_FIRST = "first order: 40 m/s times a sub-step of it"
STUDY = EngineStudy(
    causes=_causes,
    step_orders={DEFAULT: _SOFT, SETTINGS: _SOFT, ASSISTED: _STIFF},
    option_sets=(DEFAULT_SET, SETTINGS_SET, ASSISTED_SET),
    snippets=own_program("Box2D 3 in Python"),
    single_precision=lambda _: True,
    tolerances=(
        Tolerance(ASSISTED, "position_max", 1e-2, 1e-3, 1, _FIRST),
        Tolerance(ASSISTED, "release_time", 2e-3, 1e-3, 1, "two steps by the scheme and its end"),
    ),
    title="Box2D 3",
    binding="the Python wheel `pyb2d3` of Box2D 3.1.1, in single precision",
    maintainers_note=MaintainersNote(
        chosen="`step` has no defaults, so step and sub-steps of `default` are those of Box2D's "
        "Hello; `settings` has shorter steps and no sleep: {{ plain.agrees }} problems agree where "
        "nothing is set, {{ alone.agrees }} with that, {{ best.agrees }} with assistance.",
        not_possible="pyb2d3 does not reach the stiffness of joints, a frequency, which leaves "
        "gaps that no step closes; limits have no restitution; springs have a frequency and no "
        "stiffness, so that the adapter gives springs as forces before each step; a stop on a "
        "point would be a shape with a contact, which our adapter does not build.",
        would_change="`b2Joint_SetConstraintTuning` in the binding, which Box2D has, and a build "
        "in double precision.",
    ),
    colour="#e7298a",
)
