"""Tables of Exudyn for studies: causes, sweeps, tolerances."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from pydantic import JsonValue

from ...models.mechanism import Mechanism
from ...models.problem import Problem
from .. import study
from ..presets import ASSISTED, DEFAULT, SETTINGS
from ..study import (
    Cause,
    Intervention,
    MaintainersNote,
    OptionSet,
    Refinement,
    SweptParameter,
    Tolerance,
)

PYTHON = "Exudyn in Python"
_INDEX_3: study.Options = {
    "integrator": "generalized-alpha-index-3",
    "newton_relative": 1e-8,
    "newton_absolute": 1e-10,
    "modified_newton": True,
    "adaptive_step": True,
    "locate_releases": False,
}
_REFINEMENT = 4
"""Refinement of the step for the base, whose remaining error (1/16) is accounted for."""


def _causes(settings: Any, _: study.ConstraintKinds) -> tuple[Cause, ...]:
    # Constraints on positions (index 3) have noise in their multipliers that grows as 1/h^2, and
    # ring after each restart: a shorter step and a located release would bring in errors that the
    # run itself does not have.
    first, then = ("integrator",), ("integrator", "event location", "alternating torques")
    finer = {"timestep": float(settings["timestep"]) / _REFINEMENT}
    tighter: dict[str, JsonValue] = {
        "newton_relative": min(1e-12, settings["newton_relative"]),
        "newton_absolute": min(1e-9, settings["newton_absolute"]),
        "modified_newton": False,
    }
    # The trapezoidal rule needs restarts to pass singular positions of loops.
    trapezoidal: dict[str, JsonValue] = {
        "integrator": "trapezoidal-index-2", "loop_integrator": None, "restarts": True,
    }  # fmt: skip
    causes = (
        Cause("integrator",
              "generalized-alpha's damping, and joints held in their positions (index 3)",
              Intervention(trapezoidal)),
        Cause("Newton iteration",
              "where the iteration of a step stops, with a Jacobian kept over several steps",
              Intervention(tighter)),
        Cause("adaptive step", "a step whose iteration fails is shortened",
              Intervention({"adaptive_step": False})),
        Cause("event location",
              "a stop is switched off at the end of the step in which its torque has vanished",
              Intervention({"locate_releases": True}), after=first),
        Cause("alternating torques",
              "the trapezoidal rule never damps an error of the multipliers that changes sign "
              "with every step", Intervention(filtered_torques=True), after=first),
        # The trapezoidal rule is of second order; with a release at a step's end the run as a whole
        # is not.
        study.time_step_cause(finer, leaves=math.pow(_REFINEMENT, -2), after=then),
    )  # fmt: skip
    if settings["own_limits"]:
        # Their stiffness follows from the step, they need adaptive steps, and a tighter Newton
        # iteration does not end at their forces' rounding: other causes are taken out after them.
        text = "stops are springs and dampers, which give way and start without a force"
        limits = Cause("soft stops", text, Intervention({"own_limits": False}))
        causes = limits, *(replace(c, after=(*c.after, limits.name)) for c in causes)
    return study.with_readout(*causes)


_NEED = "second order: trapezoidal rule, index 2"


def _snippets(engine: Any, mechanism: Mechanism, duration: float) -> dict[str, str]:
    if not engine.assisted_by:
        return {PYTHON: engine.script(Problem(mechanism, duration=duration))}
    values = {
        "options": engine,
        "rule": engine.rule(mechanism),
        "end": duration,
        "points": bool(mechanism.point_stops),
    }
    return {PYTHON: study.filled_template(__name__, "exudyn.py.j2", **values)}


def _stiffer(settings: study.Options, _: study.ConstraintKinds) -> dict[str, Any] | None:
    return {"limit_period": settings["limit_period"] / 2} if settings["own_limits"] else None


STUDY = study.EngineStudy(
    causes=_causes,
    swept_parameters=(
        SweptParameter(
            name="newton_relative", title="Newton's relative tolerance", unit="1",
            values=study.geometric(1e-2, 1e-14, 7),
            options=lambda tolerance: {"newton_relative": tolerance}, base={"timestep": 1e-3},
            without={"newton_relative": 1e-15},
            why="Newton's method converges in leaps: the error falls in leaps, too, as one more "
                "iteration is made",
        ),
        SweptParameter(
            name="spectral_radius", title="dissipation (1 - rho) / (1 + rho) of generalised alpha",
            unit="1", values=study.geometric(1, 1e-2, 7),
            options=lambda d: {"spectral_radius": (1.0 - d) / (1.0 + d)}, expected=2.0,
            base={**_INDEX_3, "timestep": 1e-3}, without={"spectral_radius": 1 - 1e-6},
            why="being of second order, the rule has no term linear in the dissipation; "
                "beta = (1 + it)^2 / 4 has a square",
        ),
        SweptParameter(
            name="stop_stiffness", title="stiffness k of penalty stops", unit="N m/rad",
            values=study.geometric(1e8, 1e12, 9),
            options=lambda k: {"stop_stiffness": k}, expected=-1.0, base={"timestep": 1e-3},
            without={"stop_stiffness": None}, why="a spring gives way by torque / k",
        ),
    ),
    step_orders={
        DEFAULT: study.StepOrder(
            2.0, "generalised alpha is of second order in positions, and the softness of the stops "
            "falls with the step's square; an impact that rebounds lasts some steps: first order",
            "generalised alpha, index 3",
        ),
        SETTINGS: study.StepOrder(
            2.0, "the trapezoidal rule is of second order, and the softness of the stops falls "
            "with the step's square; an impact that rebounds lasts some steps: first order",
            "trapezoidal rule, index 2",
        ),
        ASSISTED: study.StepOrder(2.0, "trapezoidal rule, index 2", "trapezoidal rule, index 2"),
    },
    refinements=(
        study.HALF_THE_STEP,
        Refinement("Newton's tolerance", "a hundredth of Newton's relative tolerance",
                   study.multiplied("newton_relative", 0.01)),
        Refinement("Newton's tolerance", "a hundredth of Newton's absolute tolerance",
                   study.multiplied("newton_absolute", 0.01)),
        Refinement("softness of the stops", "twice the stops' stiffness",
                   study.multiplied("stop_stiffness", 2.0)),
        Refinement("softness of the stops", "half the period of the stops' springs", _stiffer),
    ),
    option_sets=(
        study.DEFAULT_SET,
        OptionSet("index 2", "default, with the trapezoidal rule of index 2", DEFAULT,
                  {"integrator": "trapezoidal-index-2"}),
        study.SETTINGS_SET,
        OptionSet("stops switched",
                  "the trapezoidal rule, and stops are constraints that are switched off after a "
                  "step", ASSISTED, {"locate_releases": False}),
        study.ASSISTED_SET,
    ),
    tolerances=(
        Tolerance(ASSISTED, "position_max", 1e-5, 1e-4, 2, _NEED),
        Tolerance(ASSISTED, "stop_torque_max", 2e-3, 1e-4, 2, _NEED),
        Tolerance(ASSISTED, "release_time", 1e-7, 1e-4, 2, _NEED),
        Tolerance(ASSISTED, "energy_balance", 0.2, 1e-4, 2,
                  f"1e-6 of the energy at the start; {_NEED}"),
    ),
    snippets=_snippets,
    title="Exudyn",
    binding="the Python wheel `exudyn`",
    maintainers_note=MaintainersNote(
        chosen="Its default is `SimulationSettings()`: generalised alpha, which holds the joints' "
        "positions, with steps that it adapts. The trapezoidal rule, which holds their speeds, has "
        "the smaller errors where constraints keep their rank, and the order {{ best.order }}; "
        "alone it is set with a full Newton iteration and a least step that is short enough to "
        "find contacts, but for loops without stops, whose singular positions it does not pass and "
        "generalised alpha does.",
        not_possible="Stops are its unilateral elements (limits of coordinate springs, contacts "
        "with an impact model), whose stiffness has no default: ours gives them a period of ten "
        "steps, so that a rebound lasts five, and is of first order. With assistance stops are "
        "constraints that are switched, and a run begins anew beside singular positions.",
        would_change="A unilateral constraint, or an event that switches a constraint inside a "
        "step, as its contacts are found already; an output of the force of "
        "`ObjectContactCoordinate`, which is read off its law here.",
    ),
    colour="#009E73",
)  # fmt: skip
