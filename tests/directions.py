"""Mechanisms moved along directions of their numbers, and derivatives along them, for
differences."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from trebucheck.models.kinematics import initial_state
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.reference.equations import Equations, consistent_coordinates, kkt_matrix
from trebucheck.reference.sensitivity.tangent import StateTangent, state_tangent
from trebucheck.reference.sensitivity.variational import (
    VariationalEquations,
    consistent_direction,
    moved,
    numbers,
)
from trebucheck.reference.solver import solve

Direction = dict[str, float]


def stepped(
    mechanism: Mechanism, direction: Direction, step: float, active: tuple[str, ...]
) -> Mechanism:
    """A mechanism moved along a direction, with unit vectors of length 1, on its loops and closed
    stops.
    """
    other = moved(mechanism, direction, step)
    unit = {
        "joints": tuple(_of_length_one(joint, "axis") for joint in other.joints),
        "stops": tuple(_of_length_one(stop, "normal") for stop in other.stops),
    }
    other = _of_length_one(other.model_copy(update=unit), "gravity_direction")
    equations, (q, u) = Equations(other), initial_state(other)
    closest = consistent_coordinates(
        equations, q, [stop.name for stop in other.stops if stop.closed]
    )
    assert closest is not None
    mass, jacobian = equations.mass_matrix(closest), equations.constraint_jacobian(closest, active)
    if (basis := equations.basis(closest, active)) is not None:
        jacobian = basis.rows @ jacobian
    kkt, right = kkt_matrix(mass, jacobian), np.concatenate([mass @ u, np.zeros(len(jacobian))])
    speeds = np.linalg.solve(kkt, right)[: len(q)]
    return other.model_copy(
        update={"start": tuple(closest.tolist()), "start_speeds": tuple(speeds.tolist())}
    )


def random_direction(mechanism: Mechanism, least: float) -> Direction:
    """All numbers at once, each by some part of itself, or of `least` if that is more.

    Unit vectors turn.
    """
    random, known = np.random.default_rng(0), numbers(mechanism)
    direction: Direction = {}
    for name, value in known.items():
        part = float(random.uniform(-1, 1))
        base, _, component = name.rpartition(".")
        if not base.endswith(("axis", "normal", "gravity_direction")):
            direction[name] = (
                part * max(least, abs(value))
                if value or not name.endswith(("inertia", "restitution"))
                else 0
            )
        elif component == "0":
            direction |= {name: -part * known[f"{base}.1"], f"{base}.1": part * value}
    return consistent_direction(mechanism, direction)


def derivatives(
    mechanism: Mechanism, directions: list[Direction], t: float, law: StopLaw
) -> StateTangent:
    solution = solve(Problem(mechanism, duration=t, stop_law=law))
    return state_tangent(solution, VariationalEquations(mechanism, directions), t)


def _of_length_one(part: Any, field: str) -> Any:
    if not hasattr(part, field):
        return part
    x, y = getattr(part, field)
    return part.model_copy(update={field: (x / math.hypot(x, y), y / math.hypot(x, y))})
