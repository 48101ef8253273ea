"""Tables of pymunk for studies: causes, sweeps, tolerances."""

from __future__ import annotations

from collections.abc import Mapping
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
from .options import ERROR_BIAS, HALF_IN_A_MILLISECOND, ITERATIONS, ONLY_WITH

PYTHON = "pymunk in Python"
_BIAS_STEP = 4e-3  # [s] shorter steps need a bias below 1e-300 for short lags, which is zero
_NEED = "second order: leapfrog read at its own times"
_CORRECTED: Mapping[str, JsonValue] = {
    "error_bias": 0.0,
    "groove_error_bias": HALF_IN_A_MILLISECOND,
    "limit_error_bias": ERROR_BIAS,
}
"""Of joints as they are documented: errors undone as soon as they can be without ill effects."""


def _causes(settings: Any, _: study.ConstraintKinds) -> tuple[Cause, ...]:
    # Twice the passes square what they leave. Mass on a fixed pivot moves nothing: it only helps
    # them converge.
    passes: dict[str, JsonValue] = {
        "iterations": max(400, 2 * settings["iterations"]),
        "start_iterations": max(5_000, 2 * settings["start_iterations"]),
    }
    causes: tuple[Cause, ...] = ()
    after: tuple[str, ...] = ()
    rods: dict[str, JsonValue] = {}
    if settings["joints"] == "documented":
        rods = {**ONLY_WITH["documented"], "joints": "rods"}
        elements = Cause(
            "documented elements",
            "limits have no force before an error, grooves let go of what turns, dampers are of "
            "first order; taken out by trebucheck's own joints and forces",
            Intervention(rods),
        )
        # The others change options of trebucheck's joints, or what limits do without an error.
        causes, after = (elements,), (elements.name,)
    else:
        passes["pivot_mass"] = max(1e4, settings["pivot_mass"])
    causes += (
        Cause("solver passes",
              "impulses that have not converged in a step's passes, above all in the first step",
              Intervention(passes)),
        Cause("error bias", "joints are let drift: only a share of their error is undone in a step",
              Intervention({**rods, "error_bias": 0.0}), after=after),
        Cause("start and labels",
              "velocities belong half a step later than positions; started and read as if not",
              Intervention({**rods, "leapfrog": True}), after=after),
        Cause("rod lengths",
              "a rod's ends move on arcs: it gets longer in a step than its rate of change says",
              Intervention({**rods, "hold_lengths": True}), after=after),
        Cause("event location", "a stop is let go a step after its torque has vanished",
              Intervention({**rods, "locate_releases": True}), after=after),
        study.time_step_cause({"timestep": float(settings["timestep"]) / study.REFINEMENT}),
    )  # fmt: skip
    return study.with_readout(*causes)


def _bias(lag: float) -> study.Options:
    """The bias at which an error stands for a mean time `lag` beyond the step it arises in.

    Chipmunk undoes the share c = 1 - bias^h of an error in each step, so (1 - c)^k of it are left k
    steps later, which sums up to h (1 - c) / c.
    """
    return {"error_bias": (lag / (lag + _BIAS_STEP)) ** (1.0 / _BIAS_STEP)}


def _heavier_pivots(settings: study.Options, _: study.ConstraintKinds) -> dict[str, Any] | None:
    rods = settings["joints"] == "rods"
    return {"pivot_mass": 10.0 * settings["pivot_mass"]} if rods else None


def _snippets(engine: Any, mechanism: Mechanism, duration: float) -> dict[str, str]:
    if engine.assisted_by:
        return {PYTHON: study.filled_template(__name__, "pymunk.py.j2", options=engine)}
    return {PYTHON: engine.script(Problem(mechanism, duration=duration))}


STUDY = study.EngineStudy(
    causes=_causes,
    swept_parameters=(
        SweptParameter(
            name="iterations", title="iterations of the impulse solver", unit="1",
            values=(1, 3, 10, 30, 100, 300, 1000), options=lambda n: {"iterations": round(n)},
            base={"timestep": 1e-3}, without={"iterations": 2000},
            why="Gauss-Seidel converges geometrically, not by a power, and starts warm",
        ),
        SweptParameter(
            name="error_bias", unit="s",
            title="lag of the joints' correction h bias^h / (1 - bias^h)",
            values=study.geometric(0.3, 3e-4, 13), options=_bias, expected=1.0,
            base={"timestep": _BIAS_STEP}, without={"error_bias": 0.0},
            why="joints drift at a steady rate, and a share 1 - bias^h of it is undone in a step: "
                "the rest lags",
        ),
        SweptParameter(
            name="pivot_mass", title="mass of a body pinned to the ground", unit="of its own",
            values=study.geometric(1, 1e8, 9), options=lambda mass: {"pivot_mass": mass},
            base={"timestep": 1e-3}, without={"pivot_mass": 1e9},
            why="the mass only conditions the solver: its effect should vanish as it grows",
        ),
    ),
    step_orders={
        DEFAULT: study.StepOrder(
            None,
            "of first order with pins alone (positions and speeds are half a step apart, and "
            "joints drift); a groove's error does not fall with the step",
            "semi-implicit Euler, impulses",
        ),
        SETTINGS: study.StepOrder(
            None,
            "of first order with pins alone (positions and speeds are half a step apart); the part "
            "of a groove's error that a step undoes falls with the step",
            "semi-implicit Euler, impulses",
        ),
        ASSISTED: study.StepOrder(2.0, "leapfrog read at its own times", "leapfrog, impulses"),
    },
    refinements=(
        study.HALF_THE_STEP,
        Refinement("solver's iterations", "four times the iterations",
                   study.multiplied("iterations", 4)),
        Refinement("first step's iterations", "four times the first step's iterations",
                   study.multiplied("start_iterations", 4)),
        Refinement("mass of the pinned body", "ten times the pivot mass", _heavier_pivots),
    ),
    option_sets=(
        study.DEFAULT_SET,
        OptionSet("errors undone", "default, with errors of joints undone as soon as can be",
                  DEFAULT, _CORRECTED),
        study.SETTINGS_SET,
        OptionSet("leapfrog",
                  "default's passes on trebucheck's own joints, started and read as a leapfrog",
                  ASSISTED,
                  {"iterations": ITERATIONS, "start_iterations": ITERATIONS, "hold_lengths": False,
                   "locate_releases": False, "pivot_mass": 1.0}),
        OptionSet("converged leapfrog",
                  "the same, with 50 iterations, a heavy pivot and releases foreseen", ASSISTED,
                  {"iterations": 50, "hold_lengths": False}),
        OptionSet("held lengths", "the same, with rods held to their lengths", ASSISTED,
                  {"iterations": 50}),
        study.ASSISTED_SET,
    ),
    tolerances=(
        Tolerance(ASSISTED, "position_max", 2e-3, 1e-3, 2, _NEED, model="fixed"),
        Tolerance(ASSISTED, "position_max", 3e-3, 1e-3, 2, _NEED),
        Tolerance(ASSISTED, "position_max", 2.5e-5, 1e-4, 2, _NEED),
        Tolerance(ASSISTED, "stop_torque_max", 1e-4, 1e-3, 2, _NEED, per="peak"),
        Tolerance(ASSISTED, "release_time", 1e-5, 1e-3, 2, _NEED),
    ),
    snippets=_snippets,
    title="pymunk",
    binding="the Python wheel `pymunk`, with its own build of Chipmunk",
    maintainers_note=MaintainersNote(
        chosen="Iterations and the correction of errors: all of a pin's in a step, half of a "
        "groove's (all of it makes two grooves on one body unstable; with one in loops it is all "
        "of the groove's and half of the pins', as all of both throw it at singular positions), "
        "pymunk's own share of a limit's (all of it leaves every second step without force); by "
        "itself the order is {{ plain.order }}, with assistance, which reads it as a leapfrog, "
        "{{ best.order }}.",
        not_possible="A RotaryLimitJoint has no restitution, and no force in a step that begins "
        "without an error, as every start does; a GrooveJoint computes the impulse that would hold "
        "its point in both directions and takes the component across its line, so that a point "
        "beside the centre of mass of a body that turns leaves the line at a share of its speed "
        "along it, whatever the iterations and the step.",
        would_change="An impulse across a groove that stops the speed across it, as a PinJoint's "
        "stops that along it; a limit that acts where its gap is closed and closing; speeds "
        "that are told at the times of the positions.",
    ),
    colour="#D55E00",
)  # fmt: skip
