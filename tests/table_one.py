"""The two machines of the paper's Table I, and how far an engine's motion of them is from the reference."""

from __future__ import annotations

import functools

import numpy as np
from trebucheck.models.machines.trebuchet import PROJECTILE, fixed, rolling
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck.models.trajectory import Trajectory
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

MACHINES: dict[str, Mechanism] = {"fixed": fixed(), "rolling": rolling()}


@functools.cache
def reference(name: str) -> Solution:
    """Reference motion of Table I, up to the launch."""
    launch = solve(Problem(MACHINES[name], 2.8)).launch
    assert launch is not None
    return solve(Problem(MACHINES[name], launch.time))


def error(trajectory: Trajectory, exact: Solution, marker: str = PROJECTILE) -> float:
    """Largest distance of a marker from the reference [m]."""
    there = exact.trajectory(trajectory.t).marker(marker).position
    return float(np.linalg.norm(trajectory.marker(marker).position - there, axis=1).max())
