"""PhysX's entries for studies: orders, causes, precision."""

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
    "angular damping": ("every body loses angular speed", {"angular_damping": 0.0}),
    "speed limit": ("bodies turn no faster", {"max_angular_velocity": 1e6}),
    "sleep": ("bodies that hardly move are stopped", {"sleep_threshold": 0.0}),
    "iterations": (
        "speeds and forces keep what takes gaps of joints back",
        {"position_iterations": 30, "velocity_iterations": 100},
    ),
    "stops held from one side": (
        "a limit pauses where rounding opens it, and is met again a turn on",
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
    snippets=own_program("PhysX in Node.js"),
    single_precision=lambda _: True,
    # Positions are added to once a step: iterations change speeds alone.
    additions=lambda _: 1,
    title="PhysX",
    binding="the npm package `physx-js-webidl`, moved by Node.js, in single precision",
    maintainers_note=MaintainersNote(
        chosen="`default` is a scene that sets nothing but what holds it in the plane, at the step "
        "of PhysX's SnippetHelloWorld: every body loses a twentieth of its angular speed in a "
        "second, and forces are those of one iteration after those that take gaps of joints back; "
        "`settings` has no damping, no sleep, no speed limit in reach, shorter steps and a hundred "
        "such iterations: {{ plain.agrees }} problems agree where nothing is set, "
        "{{ alone.agrees }} with that, {{ best.agrees }} with assistance.",
        not_possible="The package has no build in double precision; a joint knows its angle within "
        "half a turn; our adapter builds no stops on points and no restitution, and gives springs "
        "as forces. Articulations in reduced coordinates, PhysX's other bodies, are not built.",
        would_change="Forces told without the part that takes gaps back, whatever the number of "
        "iterations of speeds: one of them leaves limits' torques wrong by their own size.",
    ),
    colour="#4b7b0a",
)
