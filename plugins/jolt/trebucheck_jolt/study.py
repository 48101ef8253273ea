"""Jolt Physics' entries for studies: orders, causes, precision."""

from __future__ import annotations

from typing import Any

from trebucheck.engines.presets import PRESETS
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
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (
        Cause("damping", "every body loses speed", Intervention({"damping": 0.0})),
        Cause(
            "speed limits",
            "faster bodies are slowed down",
            Intervention({"max_linear_velocity": 1e6, "max_angular_velocity": 1e6}),
        ),
        Cause("sleep", "bodies that hardly move are stopped", Intervention({"allow_sleep": False})),
        Cause(
            "iterations",
            "impulses end before the joints hold",
            Intervention({"first_velocity_steps": 10_000, "velocity_steps": 100}),
        ),
        Cause(
            "gaps",
            "joints that drift apart are taken back bit by bit",
            Intervention({"baumgarte": 1.0}),
        ),
        Cause(
            "stops held from one side",
            "a limit pauses where rounding opens it, and is met again half a turn on",
            Intervention({"hold": True}),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


def _snippets(engine: Any, mechanism: Mechanism, duration: float) -> dict[str, str]:
    if engine.assisted_by:
        return {}
    return {"Jolt Physics in Node.js": engine.script(Problem(mechanism, duration=duration))}


_SCHEME = "semi-implicit Euler, impulses"
_REASON = (
    "semi-implicit Euler in Cartesian coordinates; at short steps the floor of single precision"
)
STUDY = EngineStudy(
    causes=_causes,
    step_orders={preset: StepOrder(1.0, _REASON, _SCHEME) for preset in PRESETS},
    option_sets=(DEFAULT_SET, SETTINGS_SET, ASSISTED_SET),
    snippets=_snippets,
    single_precision=lambda _: True,
    # Positions are added to once by speeds, and once by each iteration that takes gaps back.
    additions=lambda settings: settings["collision_steps"] * (1 + settings["position_steps"]),
    title="Jolt Physics",
    binding="the npm package `jolt-physics` (WebAssembly), moved by Node.js, in single precision",
    maintainers_note=MaintainersNote(
        chosen="`default` is a world that sets nothing but what holds it in the plane, at the step "
        "of Jolt's HelloWorld: every body loses a twentieth of its speeds in a second; `settings` "
        "has no damping, no sleep, no speed limits in reach, shorter steps, more iterations and "
        "gaps taken back whole: {{ plain.agrees }} problems agree where nothing is set, "
        "{{ alone.agrees }} with that, {{ best.agrees }} with assistance.",
        not_possible="The package has no build in double precision; a hinge knows its angle within "
        "half a turn, and a limit on one side is a limit half a turn on as well; our adapter "
        "builds no stops on points and no restitution, and gives springs as forces.",
        would_change="A build in double precision, in which a body turns by a millionth of a "
        "radian in a step, too: at short steps rounding is what is left.",
    ),
    colour="#8b1a62",
)
