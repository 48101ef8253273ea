"""The softness of MuJoCo's limits, contacts and equalities that goes with a time step; needs no MuJoCo."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..study import ConstraintKinds


def scaled_solref(timestep: float, integrator: str, exact_points: bool = False) -> tuple[float, float]:
    """What `solref = None` stands for: -stiffness and -damping [1/s^2, 1/s] at a time step [s].

    Scaled so, errors fall with the square of the step. Twice the damping is critical and has the least rebound; a
    one-stage integrator throws the joint about with it, and settles in one step with half of that. Feedback that is
    kept through a step of RK4 has a constraint at rest after two with one and a half: the matrix
    ((1 - K/2, 1 - B/2), (-K, 1 - B)) from one step to the next, with K = k h^2 = 1 and B = b h, is then nilpotent.

    Args:
        timestep: of MuJoCo [s].
        integrator: MuJoCo's.
        exact_points: of contacts and equalities whose feedback is kept through all stages of a step
            (`moving_points`).
    """
    damping = 1.0 if integrator != "RK4" else 1.5 if exact_points else 2.0
    return -1.0 / timestep**2, -damping / timestep


def effective_solref(settings: Mapping[str, Any], constraints: ConstraintKinds) -> tuple[float, float]:
    """The `solref` of an engine's settings as one pair of numbers, whether it is given or follows from the step.

    One pair has to serve angles and points: where a mechanism has both, it is that of the angles.
    """
    if settings["solref"] is not None:
        first, second = settings["solref"]
        return first, second
    exact_points = settings["moving_points"] and not constraints.angles
    return scaled_solref(float(settings["timestep"]), settings["integrator"], exact_points)
