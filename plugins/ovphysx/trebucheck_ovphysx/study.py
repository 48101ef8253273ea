"""PhysX's entries by ovphysx for studies: orders, causes, precision."""

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
    "angular damping": ("every link loses angular speed", {"angular_damping": 0.0}),
    "temporal solver": ("limits push in some of its sub-steps only", {"solver": "PGS"}),
    "speed limit": ("bodies turn no faster", {"max_angular_velocity": 1e7}),
    "sleep": ("links that hardly move are stopped", {"sleep_threshold": 0.0}),
    "limits that stay": ("a stop that is open for good is met again", {"keep_limits": False}),
}
_SCHEME = "semi-implicit Euler in joint coordinates"
_REASON = "semi-implicit Euler in joint coordinates; at short steps the floor of single precision"
STUDY = EngineStudy(
    causes=caused_by(_CAUSES),
    step_orders={preset: StepOrder(1.0, _REASON, _SCHEME) for preset in PRESETS},
    option_sets=(DEFAULT_SET, SETTINGS_SET, ASSISTED_SET),
    snippets=own_program("ovphysx in Python"),
    single_precision=lambda _: True,
    # The temporal solver adds to positions in each of its sub-steps.
    additions=lambda given: given["position_iterations"] if given["solver"] == "TGS" else 1,
    title="PhysX articulations",
    binding="the Python wheel `ovphysx` on the processor, in single precision",
    maintainers_note=MaintainersNote(
        chosen="`default` is a scene that sets nothing but the processor: every link loses a "
        "twentieth of its angular speed in a second, and the temporal solver lets limits go by "
        "turns; `settings` has the other solver, no damping, no sleep and shorter steps: "
        "{{ plain.agrees }} problems agree where nothing is set, {{ alone.agrees }} with that, "
        "{{ best.agrees }} with assistance.",
        not_possible="Articulations are trees of joints: one that slides and turns is none, and "
        "joints that close loops would be held as those of bodies, and tell no forces; our adapter "
        "builds neither, no stops on points and no restitution.",
        would_change="Forces of joints told about the place where they act, and a build in double "
        "precision.",
    ),
    colour="#1b7837",
)
