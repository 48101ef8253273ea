"""p2-es's entries for studies: tolerances, orders and causes."""

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
    "iterations": (
        "the solver ends before the joints hold",
        {"iterations": 1000, "tolerance": 0.0},
    ),
    "softness": ("joints give way like springs", {"stiffness": 1e14}),
    "single precision": ("vectors are rounded to seven digits", {"single_precision": False}),
}
_SCHEME = "semi-implicit Euler, regularized impulses"
_REASON = "semi-implicit Euler in Cartesian coordinates"
STUDY = EngineStudy(
    causes=caused_by(_CAUSES),
    step_orders={preset: StepOrder(1.0, _REASON, _SCHEME) for preset in PRESETS},
    option_sets=(DEFAULT_SET, SETTINGS_SET, ASSISTED_SET),
    snippets=own_program("p2-es in Node.js"),
    single_precision=lambda settings: bool(settings["single_precision"]),
    title="p2-es",
    binding="the npm package `p2-es`, moved by Node.js",
    maintainers_note=MaintainersNote(
        chosen="`default` is a world that sets nothing, at the step of the example of its README: "
        "every body loses a tenth of its speed in a second, and vectors have single precision; "
        "`settings` has no damping, double precision, shorter steps and stiffer constraints: "
        "{{ plain.agrees }} problems agree where nothing is set, {{ alone.agrees }} with that, "
        "{{ best.agrees }} with assistance.",
        not_possible="A limit acts in a step that begins beyond it, and has no restitution; our "
        "adapter builds no stops on points, and gives springs as forces.",
        would_change="Shorter steps: what breaks is the error of a step, of order "
        "{{ best.order }}.",
    ),
    colour="#4b0082",
)
