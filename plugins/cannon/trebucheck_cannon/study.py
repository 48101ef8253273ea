"""cannon-es's entries for studies: tolerances, orders and causes."""

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
        {"iterations": 2000, "tolerance": 1e-12},
    ),
    "softness": (
        "joints give way like springs, which are set for steps of 1/60 s",
        {"stiffness": 1e14, "equation_step": 0.0},
    ),
    "stops that stay": (
        "the cone of a stop that has opened is met again at its other edge",
        {"let_go": True},
    ),
}
_SCHEME = "semi-implicit Euler, regularized impulses"
_REASON = "semi-implicit Euler in Cartesian coordinates"
STUDY = EngineStudy(
    causes=caused_by(_CAUSES),
    step_orders={preset: StepOrder(1.0, _REASON, _SCHEME) for preset in PRESETS},
    option_sets=(DEFAULT_SET, SETTINGS_SET, ASSISTED_SET),
    snippets=own_program("cannon-es in Node.js"),
    title="cannon-es",
    binding="the npm package `cannon-es`, moved by Node.js",
    maintainers_note=MaintainersNote(
        chosen="`default` is a world that sets nothing but what holds it in the plane, at the step "
        "of `fixedStep`: every body loses a hundredth of its speeds in a second, and ten "
        "iterations leave joints open; `settings` has no damping, iterations to their end, shorter "
        "steps, and constraints that are stiff and set for the step: {{ plain.agrees }} problems "
        "agree where nothing is set, {{ alone.agrees }} with that, {{ best.agrees }} with "
        "assistance.",
        not_possible="cannon-es has neither a slider nor limits of a hinge: slots and slides are "
        "refused, and a stop is a cone in the plane, which has a second edge; our adapter builds "
        "no stops on points and no restitution, and gives springs as forces.",
        would_change="A solver that begins with the impulses of the step before, a slider, and "
        "limits of a hinge; shorter steps, as what breaks else is the error of a step, of order "
        "{{ best.order }}.",
    ),
    colour="#006d77",
)
