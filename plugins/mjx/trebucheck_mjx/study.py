"""MJX's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from typing import Any

from trebucheck.engines.presets import ASSISTED, DEFAULT
from trebucheck.engines.study import (
    ASSISTED_SET,
    DEFAULT_SET,
    REFINEMENT,
    Cause,
    ConstraintKinds,
    EngineStudy,
    Intervention,
    MaintainersNote,
    StepOrder,
    time_step_cause,
)
from trebucheck_toolkit.scheme_tables import RK4_LOCATED, located_tolerances


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (
        Cause(
            "soft limits",
            "stops are springs with dampers of MuJoCo's default stiffness, which give way",
            Intervention({"limits": "multipliers"}),
        ),
        Cause("precision", "numbers of 24 bits", Intervention({"precision": "double"})),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        ASSISTED: RK4_LOCATED,
        DEFAULT: StepOrder(
            None, "RK4 in single precision: its floor, and soft limits", RK4_LOCATED.scheme
        ),
    },
    option_sets=(DEFAULT_SET, ASSISTED_SET),
    tolerances=located_tolerances(),
    title="MJX",
    binding="the Python wheel `mujoco-mjx`",
    maintainers_note=MaintainersNote(
        chosen="Double precision and RK4: of single precision the free swing keeps "
        "{{ plain.error('free-swing', 'position') }}, and "
        "{{ best.error('free-swing', 'position') }} with that.",
        not_possible="Our adapter builds no loops, no stops on points and no force elements "
        "from MJX's own, though MJX has equalities, contacts and tendons; energies and "
        "torques of limits, which MJX does not tell, are computed from its mass matrix and "
        "its constraint forces.",
        would_change="An adapter that writes loops as equalities and stops on points as "
        "contacts, as that of MuJoCo does.",
    ),
    single_precision=lambda settings: settings["precision"] == "single",
    colour="#6a3d9a",
)
