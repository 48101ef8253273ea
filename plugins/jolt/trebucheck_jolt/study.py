"""Jolt Physics' entries for studies: orders, causes, precision."""

from __future__ import annotations

from trebucheck.engines.presets import PRESETS
from trebucheck.engines.study import (
    ASSISTED_SET,
    DEFAULT_SET,
    SETTINGS_SET,
    EngineStudy,
    MaintainersNote,
    StepOrder,
)
from trebucheck_toolkit.alone import caused_by, own_program

_CAUSES = {
    "damping": ("every body loses speed", {"damping": 0.0}),
    "speed limits": (
        "faster bodies are slowed down",
        {"max_linear_velocity": 1e6, "max_angular_velocity": 1e6},
    ),
    "sleep": ("bodies that hardly move are stopped", {"allow_sleep": False}),
    "iterations": (
        "impulses end before the joints hold",
        {"first_velocity_steps": 10_000, "velocity_steps": 100},
    ),
    "gaps": ("joints that drift apart are taken back bit by bit", {"baumgarte": 1.0}),
    "stops held from one side": (
        "a limit pauses where rounding opens it, and is met again half a turn on",
        {"hold": True},
    ),
}
_SCHEME = "semi-implicit Euler, impulses"
_REASON = (
    "semi-implicit Euler in Cartesian coordinates; at short steps the floor of single precision"
)
STUDY = EngineStudy(
    causes=caused_by(_CAUSES),
    step_orders={preset: StepOrder(1.0, _REASON, _SCHEME) for preset in PRESETS},
    option_sets=(DEFAULT_SET, SETTINGS_SET, ASSISTED_SET),
    snippets=own_program("Jolt Physics in Node.js"),
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
