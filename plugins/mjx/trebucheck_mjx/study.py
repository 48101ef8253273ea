"""MJX's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from typing import Any

from pydantic import JsonValue
from trebucheck.engines.mujoco.options import scaled_solref
from trebucheck.engines.presets import ASSISTED, DEFAULT, SETTINGS
from trebucheck.engines.study import (
    ASSISTED_SET,
    DEFAULT_SET,
    HALF_THE_STEP,
    REFINEMENT,
    SETTINGS_SET,
    Cause,
    ConstraintKinds,
    EngineStudy,
    Intervention,
    MaintainersNote,
    OptionSet,
    StepOrder,
    time_step_cause,
    with_readout,
)
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.scheme_tables import RK4_LOCATED, located_tolerances

PYTHON = "MJX in Python"
_HARDEST: dict[str, JsonValue] = {"solimp": [0.9999, 0.9999, 0.001, 0.5, 2.0], "margin": 1e-12}
_MULTIPLIERS: dict[str, JsonValue] = {
    **_HARDEST,
    "limits": "multipliers",
    "precision": "double",
    "integrator": "RK4",
    "solver": "Newton",
    "tolerance": 1e-30,
    "iterations": 100,
    "solref": None,
}


def _causes(settings: Any, constraints: ConstraintKinds) -> tuple[Cause, ...]:
    finer: dict[str, JsonValue] = {"timestep": float(settings["timestep"]) / REFINEMENT}
    if settings["limits"] == "multipliers":
        return with_readout(time_step_cause(finer))
    stiffest = [*scaled_solref(float(settings["timestep"]), settings["integrator"])]
    if settings["solref"] is None:  # it would follow the step
        finer["solref"] = stiffest
    constrained = (
        Cause(
            "soft constraints",
            "stops and loops are springs with dampers: they give way, begin without force, and a "
            "step goes over a release",
            Intervention(_MULTIPLIERS),
        ),
        Cause(
            "constraint softness",
            "limits, contacts and equalities are softer than the step can bear",
            Intervention({**_HARDEST, "solref": stiffest}),
        ),
    )
    return with_readout(
        *(constrained if constraints.angles or constraints.points else ()),
        Cause("precision", "numbers of 24 bits", Intervention({"precision": "double"})),
        Cause(
            "integrator",
            "the rule of a step, of first order but for RK4",
            Intervention({"integrator": "RK4"}),
        ),
        time_step_cause(finer),
    )


def _snippets(engine: Any, mechanism: Mechanism, duration: float) -> dict[str, str]:
    if engine.assisted_by:
        return {}
    return {PYTHON: engine.script(Problem(mechanism, duration=duration))}


STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        DEFAULT: StepOrder(
            None,
            "Euler's rule is of first order, and the limits' softness is fixed: it does not fall "
            "with the step",
            "semi-implicit Euler, joint coordinates",
        ),
        SETTINGS: StepOrder(
            None,
            "the limits' softness falls with the step's square, but a step goes over the kink at "
            "a release, wherever that is in it",
            RK4_LOCATED.scheme,
        ),
        ASSISTED: RK4_LOCATED,
    },
    refinements=(HALF_THE_STEP,),
    option_sets=(
        DEFAULT_SET,
        OptionSet("RK4", "default, with the integrator RK4", DEFAULT, {"integrator": "RK4"}),
        OptionSet(
            "single precision",
            "settings, in JAX's own precision",
            SETTINGS,
            {"precision": "single"},
        ),
        SETTINGS_SET,
        ASSISTED_SET,
    ),
    tolerances=located_tolerances(),
    snippets=_snippets,
    title="MJX",
    binding="the Python wheel `mujoco-mjx`",
    maintainers_note=MaintainersNote(
        chosen="Its own defaults are those of an empty MuJoCo model in JAX's single precision; "
        "double precision, RK4, a stiffer `solref` and shorter steps are what its options add: the "
        "free swing keeps {{ plain.error('free-swing', 'position') }} by itself, "
        "{{ alone.error('free-swing', 'position') }} with its options.",
        not_possible="A limit stays in the model when its stop has let go, has no restitution, and "
        "begins without its force; the adapter does these in its place where a row says so. "
        "Energies and torques of limits, which MJX does not tell, are computed from its mass "
        "matrix and its constraint forces.",
        would_change="A reference acceleration that counts the motion of points, and limits that "
        "start with their force, would make most of the assistance needless; sensors of energies "
        "and limits would make the reading MJX's own.",
    ),
    single_precision=lambda settings: settings["precision"] == "single",
    colour="#6a3d9a",
)
