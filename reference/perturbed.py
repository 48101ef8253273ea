"""The reference perturbed by one fault, whose effect is compared with a deviation.

The effect of a wrong release time, a stop that never opens, added friction or missing forces on a motion is computed
by the same equations and integrator, changed in that one thing.
"""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np

from ..models.arrays import ComplexArray, FloatArray
from ..models.errors import InputError
from ..models.kinematics import initial_state
from ..models.mechanism import Mechanism
from ..models.problem import Problem
from .equations import Equations
from .solution import Segment, Solution
from .solver import integrate_segment

TOLERANCE = 1e-12
"""Relative and absolute local error: a scheduled motion is compared with deviations that are far larger."""


class WithoutCentrifugal(Equations):
    """The equations with their centrifugal (and so all velocity-dependent) forces left out."""

    def _bias(self, quadratic: object, u: FloatArray) -> FloatArray:
        return np.zeros_like(u)


class WithJoint(Equations):
    """The equations with viscous damping [N m s/rad] and a rotor's inertia (armature) [kg m^2] on one joint."""

    def __init__(self, mechanism: Mechanism, joint: str, damping: float = 0.0, armature: float = 0.0) -> None:
        super().__init__(mechanism)
        perturbed_joint = next(j for j in mechanism.joints if j.name == joint)
        row = np.zeros(len(mechanism.coordinates))
        bodies = [body.name for body in mechanism.bodies]
        row[bodies.index(perturbed_joint.child)] = 1.0
        if perturbed_joint.parent in bodies:
            row[bodies.index(perturbed_joint.parent)] = -1.0
        self._damping = damping * np.outer(row, row)
        self._inertias = self._inertias + armature * np.outer(row, row)

    def _bias(self, quadratic: ComplexArray, u: FloatArray) -> FloatArray:
        return super()._bias(quadratic, u) + u @ self._damping


def solve_scheduled(
    problem: Problem, releases: Mapping[str, float | None], equations: Equations | None = None
) -> Solution:
    """Integrate with each closed stop active until its given time.

    Args:
        problem: its law of the stops does not matter here: they open at the given times, and none closes.
        releases: by stop, when it opens [s]; None: never. Stops not named open as at t = 0.
        equations: with a fault; the mechanism's own if left out.

    Raises:
        InputError: a name is not that of a stop.
        SimulationError: the integrator gave up.
    """
    names = [stop.name for stop in problem.mechanism.stops]
    for name in releases:
        if name not in names:
            raise InputError(f"releases names the stop {name!r}; there are: {', '.join(names)}.")
    own = equations or Equations(problem.mechanism)
    schedule = {s.name: releases.get(s.name, 0.0) for s in problem.mechanism.stops if s.closed}
    started = time.perf_counter()
    y = np.concatenate(initial_state(problem.mechanism))
    times = sorted({t for t in schedule.values() if t is not None and 0 < t < problem.duration} | {problem.duration})
    segments: list[Segment] = []
    now = 0.0
    for end in times:
        closed = tuple(name for name, t in schedule.items() if t is None or t > now)
        segment, _, stepper = integrate_segment(own, closed, now, y, end, (TOLERANCE, TOLERANCE))
        segments.append(segment)
        now, y = end, stepper.y
    return Solution(
        problem=problem,
        equations=own,
        segments=tuple(segments),
        release_times={name: schedule.get(name) for name in names},
        impacts=(),
        evaluations=0,
        settings={"rtol": TOLERANCE, "atol": TOLERANCE},
        wall_time=time.perf_counter() - started,
    )
