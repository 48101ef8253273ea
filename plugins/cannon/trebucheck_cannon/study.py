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
            Intervention({"iterations": 1000, "tolerance": 0.0}),
        ),
        Cause("softness", "joints give way like springs", Intervention({"stiffness": 1e14})),
        Cause(
            "single precision",
            "vectors are rounded to seven digits",
            Intervention({"single_precision": False}),
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
    single_precision=lambda settings: bool(settings["single_precision"]),
    title="cannon-es",
    binding="the npm package `cannon-es`, moved by Node.js",
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
    colour="#006d77",
)
