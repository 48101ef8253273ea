"""PyBullet's entries for studies: tolerances, orders and causes."""

from __future__ import annotations

from typing import Any

from trebucheck.engines.presets import ASSISTED, DEFAULT, SETTINGS
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
    OptionSet,
    StepOrder,
    time_step_cause,
)
from trebucheck_toolkit.scheme_tables import (
    EULER_STEPS,
    RK4_LOCATED,
    euler_tolerances,
    located_tolerances,
)

_UNDAMPED = {"linear_damping": 0.0, "angular_damping": 0.0, "max_joint_velocity": 1e30}
_CONVERGED = {"solver_iterations": 500, "solver_threshold": 0.0}


def _causes(settings: Any, _: ConstraintKinds) -> tuple[Cause, ...]:
    step = time_step_cause({"timestep": float(settings["timestep"]) / REFINEMENT})
    if settings["mode"] == "dynamics":  # the others are of Bullet's own steps
        return (step,)
    return (
        Cause(
            "damping",
            "links are damped, and joints cut off above a speed, where nothing is set",
            Intervention(_UNDAMPED),
        ),
        Cause(
            "solver",
            "its iteration ends before limits and loops hold",
            Intervention(_CONVERGED),
        ),
        Cause(
            "own step",
            "semi-implicit Euler with limits solved by iteration, releases at a step's end",
            Intervention({"mode": "dynamics"}),
        ),
        step,
    )


STUDY = EngineStudy(
    causes=_causes,
    step_orders={
        DEFAULT: StepOrder(
            None,
            "the damping of links does not fall with the step",
            "semi-implicit Euler, joint coordinates",
        ),
        SETTINGS: EULER_STEPS,
        ASSISTED: RK4_LOCATED,
    },
    option_sets=(
        DEFAULT_SET,
        OptionSet("undamped", "default, without damping of the links", DEFAULT, _UNDAMPED),
        SETTINGS_SET,
        ASSISTED_SET,
    ),
    tolerances=(*located_tolerances(), *euler_tolerances(SETTINGS)),
    title="PyBullet",
    binding="the Python wheel `pybullet`",
    maintainers_note=MaintainersNote(
        chosen="The damping of the links is taken away, which Bullet has where nothing is set, and "
        "its cut of joint speeds; the threshold and the iterations of the solver decide whether a "
        "stop holds; its steps are semi-implicit Euler, of order {{ alone.order }}.",
        not_possible="Bullet has no springs between links, so that their forces are given before "
        "each step; forces of joint sensors are right at rest and wrong in motion, and count the "
        "torque of a limit twice; our adapter closes loops by pins alone, and builds no stops on "
        "points and no restitution from Bullet's own elements.",
        would_change="A solver of limits that ends at its residual, and joint sensors that "
        "count what the bodies' motion needs.",
    ),
    colour="#a0522d",
)
