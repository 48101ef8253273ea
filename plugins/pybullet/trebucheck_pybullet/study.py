"""PyBullet's entries for studies: tolerances, orders and causes."""

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
    time_step_cause,
)
from trebucheck_toolkit.scheme_tables import (
    EULER_STEPS,
    EULER_TOLERANCES,
    RK4_LOCATED,
    located_tolerances,
)


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    return (
        Cause(
            "solver",
            "its iteration ends before the joint limits hold",
            Intervention({"solver_iterations": 500, "solver_threshold": 0.0}),
        ),
        Cause(
            "own step",
            "semi-implicit Euler with limits solved by iteration, releases at a step's end",
            Intervention({"mode": "dynamics"}),
        ),
        time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT}),
    )


STUDY = EngineStudy(
    causes=_causes,
    step_orders={ASSISTED: RK4_LOCATED, DEFAULT: EULER_STEPS},
    option_sets=(DEFAULT_SET, ASSISTED_SET),
    tolerances=(*located_tolerances(), *EULER_TOLERANCES),
    title="PyBullet",
    binding="the Python wheel `pybullet`",
    maintainers_note=MaintainersNote(
        chosen="Its own steps are semi-implicit Euler, of order {{ plain.order }}; the "
        "threshold and the iterations of the limits' solver decide whether a stop holds.",
        not_possible="Forces of joint sensors are right at rest and wrong in motion, and "
        "count the torque of a limit twice; our adapter builds no loops and no restitution "
        "from Bullet's own elements.",
        would_change="A solver of limits that ends at its residual, and joint sensors that "
        "count what the bodies' motion needs.",
    ),
    colour="#a0522d",
)
