"""cannon-es's entries for studies: tolerances, orders and causes."""

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
            "iterations",
            "the solver ends before the joints hold",
            Intervention({"iterations": 2000, "tolerance": 1e-12}),
        ),
        Cause(
            "softness",
            "joints give way like springs, which are set for steps of 1/60 s",
            Intervention({"stiffness": 1e14, "equation_step": 0.0}),
        ),
        Cause(
            "stops that stay",
            "the cone of a stop that has opened is met again at its other edge",
            Intervention({"let_go": True}),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


def _snippets(engine: Any, mechanism: Mechanism, duration: float) -> dict[str, str]:
    if engine.assisted_by:
        return {}
    return {"cannon-es in Node.js": engine.script(Problem(mechanism, duration=duration))}


_SCHEME = "semi-implicit Euler, regularized impulses"
_REASON = "semi-implicit Euler in Cartesian coordinates"
STUDY = EngineStudy(
    causes=_causes,
    step_orders={preset: StepOrder(1.0, _REASON, _SCHEME) for preset in PRESETS},
    option_sets=(DEFAULT_SET, SETTINGS_SET, ASSISTED_SET),
    snippets=_snippets,
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
