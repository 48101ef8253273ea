"""Havok's entries for studies: tolerances, orders and causes."""

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
    "stabilization": ("bodies slower than 0.1 m/s are braked", {"stabilization": False}),
    "speed limits": ("bodies go no faster", {"speed_limit": 1e6, "turning_limit": 1e6}),
    "sleep": ("bodies that hardly move are stopped", {"allow_sleep": False}),
    "ideal step": ("short steps have fewer substeps, and softer joints", {"ideal_step": 0.0}),
    "axes out of the plane": (
        "joints that lock them, too, are of another kind",
        {"locks_plane": False},
    ),
}
_SCHEME = "semi-implicit Euler, impulses"
_REASON = (
    "semi-implicit Euler in substeps of Cartesian coordinates, down to what masses of eight bits "
    "leave"
)
STUDY = EngineStudy(
    causes=caused_by(_CAUSES),
    step_orders={preset: StepOrder(1.0, _REASON, _SCHEME) for preset in PRESETS},
    option_sets=(DEFAULT_SET, SETTINGS_SET, ASSISTED_SET),
    snippets=own_program("Havok in Node.js"),
    single_precision=lambda _: True,
    additions=lambda _: 4,
    title="Havok",
    binding="the npm package `@babylonjs/havok`, moved by Node.js, in single precision",
    maintainers_note=MaintainersNote(
        chosen="`default` is a world that sets nothing, at the step of Babylon.js: bodies lose a "
        "tenth of their angular speed in a second and slow ones are braked; `settings` has no "
        "damping and no brake, four substeps in shorter steps, and pins that leave the axes out of "
        "the plane free: {{ plain.agrees }} problems agree where nothing is set, "
        "{{ alone.agrees }} with that, {{ best.agrees }} with assistance.",
        not_possible="Havok keeps the inverses of masses and inertias in eight bits, so that they "
        "are rounded to one part in some hundreds, which nothing sets; our adapter "
        "builds no stops on points and no restitution, and gives springs as impulses.",
        would_change="Inverse masses in single precision: what is left of the free swing at short "
        "steps is their rounding.",
    ),
    colour="#d2691e",
)
