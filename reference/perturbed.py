"""The reference perturbed by one fault, whose effect is compared with a deviation.

The effect of a wrong release time, a stop that never opens, added friction or missing forces on a
motion is computed by the same equations and integrator, changed in that one thing.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..models.arrays import ComplexArray, FloatArray
from ..models.errors import InputError
from ..models.kinematics import Kinematics, initial_state
from ..models.mechanism import Mechanism
from ..models.problem import Problem
from ..models.spec import as_complex
from .compiled import Added
from .equations import Equations
from .solution import Segment, Solution
from .solver import integrate_segment

TOLERANCE = 1e-12
"""Local error bound: scheduled motions are compared with far larger deviations."""


class _With(Equations):
    """The equations with forces beside those of the mechanism: the compiled ones have them, too."""

    def __init__(self, mechanism: Mechanism, **beside: Any) -> None:
        super().__init__(mechanism)
        self._beside = replace(Added.none(len(mechanism.coordinates)), **beside)

    def _added(self) -> Added:
        return self._beside

    def _bias(
        self, q: FloatArray, u: FloatArray, rates: ComplexArray, quadratic: ComplexArray
    ) -> FloatArray:
        return (
            super()._bias(q, u, rates, quadratic) if self._beside.centrifugal else np.zeros_like(u)
        )

    def _forces(
        self, q: FloatArray, u: FloatArray, rates: ComplexArray, quadratic: ComplexArray
    ) -> FloatArray:
        added = self._beside
        linear = added.constant - (q - added.relaxed) @ added.stiffness.T - u @ added.damping.T
        momenta = (quadratic.real + self._inertias) @ u[..., None]
        return super()._forces(q, u, rates, quadratic) + linear - added.rate * momenta[..., 0]

    def potential_energy(self, q: FloatArray) -> FloatArray:
        """Energy with that of the added springs [J]."""
        stretched = q - self._beside.relaxed
        return super().potential_energy(q) + 0.5 * np.sum(
            stretched @ self._beside.stiffness * stretched, axis=-1
        )


class WithoutCentrifugal(_With):
    """The equations with their centrifugal (and so all velocity-dependent) forces left out."""

    def __init__(self, mechanism: Mechanism) -> None:
        super().__init__(mechanism, centrifugal=False)


class WithJoint(_With):
    """The equations with an element on one joint, between its two bodies.

    Args:
        mechanism: without the element.
        joint: its name.
        damping: viscous friction [N m s/rad].
        armature: a rotor's inertia [kg m^2].
        stiffness: of a linear spring, relaxed at the start [N m/rad].
        torque: constant, on the child [N m].
    """

    def __init__(
        self,
        mechanism: Mechanism,
        joint: str,
        damping: float = 0.0,
        armature: float = 0.0,
        stiffness: float = 0.0,
        torque: float = 0.0,
    ) -> None:
        perturbed_joint = next(j for j in mechanism.joints if j.name == joint)
        row = (
            Kinematics(mechanism).angle(perturbed_joint.child, perturbed_joint.parent).coefficients
        )
        both = np.outer(row, row)
        start = np.array(mechanism.start, dtype=np.float64)
        springs = {"constant": torque * row, "stiffness": stiffness * both, "relaxed": start}
        super().__init__(mechanism, **springs, damping=damping * both)
        self._inertias = self._inertias + armature * both


class WithRubbing(_With):
    """The equations with viscous friction against rates of change, each a row on u.

    Args:
        mechanism: without it.
        rows: shape (n, n_q).
        damping: [N m s/rad, or N s/m of a row of slides].
    """

    def __init__(self, mechanism: Mechanism, rows: FloatArray, damping: float) -> None:
        super().__init__(mechanism, damping=damping * rows.T @ rows)


class WithDamping(_With):
    """The equations with every body damped at the same rate [1/s]: forces -rate M u."""

    def __init__(self, mechanism: Mechanism, rate: float) -> None:
        super().__init__(mechanism, rate=rate)


class WithTiltedGravity(_With):
    """The equations with gravity turned anticlockwise by an angle [rad]."""

    def __init__(self, mechanism: Mechanism, angle: float) -> None:
        direction = as_complex(mechanism.gravity_direction) * np.exp(1j * angle)
        turned = (float(direction.real), float(direction.imag))
        super().__init__(mechanism.model_copy(update={"gravity_direction": turned}))


def solve_scheduled(
    problem: Problem,
    releases: Mapping[str, float | None],
    equations: Equations | None = None,
    tolerance: float = TOLERANCE,
) -> Solution:
    """Integrate with each closed stop active until its given time.

    Args:
        problem: its law of the stops does not matter here: they open at the given times, and none
        closes.
        releases: by stop, when it opens [s]; None: never. Stops not named open as at t = 0.
        equations: with a fault; the mechanism's own if left out.
        tolerance: relative and absolute, of a step.

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
    times = sorted(
        {t for t in schedule.values() if t is not None and 0 < t < problem.duration}
        | {problem.duration}
    )
    segments: list[Segment] = []
    now = 0.0
    for end in times:
        closed = tuple(name for name, t in schedule.items() if t is None or t > now)
        segment, _, stepper = integrate_segment(own, closed, now, y, end, (tolerance, tolerance))
        segments.append(segment)
        now, y = end, stepper.y
    return Solution(
        problem=problem,
        equations=own,
        segments=tuple(segments),
        release_times={name: schedule.get(name) for name in names},
        impacts=(),
        evaluations=0,
        settings={"rtol": tolerance, "atol": tolerance},
        wall_time=time.perf_counter() - started,
    )
