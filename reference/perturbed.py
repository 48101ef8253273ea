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


class PerturbedEquations(Equations):
    """Equations of motion with forces beside those of the mechanism, also where compiled.

    Args:
        mechanism: without the fault.
        armature: inertia beside the bodies', shape (n_q, n_q) [kg m^2].
        changes: fields of :class:`.compiled.Added`; none where left out.
    """

    def __init__(
        self, mechanism: Mechanism, armature: FloatArray | None = None, **changes: Any
    ) -> None:
        super().__init__(mechanism)
        self._changes = replace(Added.none(len(mechanism.coordinates)), **changes)
        if armature is not None:
            self._inertias = self._inertias + armature

    def _added(self) -> Added | None:
        own = self._linear_forces()
        return None if own is None else own.plus(self._changes)

    def _bias(
        self, q: FloatArray, u: FloatArray, rates: ComplexArray, quadratic: ComplexArray
    ) -> FloatArray:
        if not self._changes.centrifugal:
            return np.zeros_like(u)
        return super()._bias(q, u, rates, quadratic)

    def _forces(
        self, q: FloatArray, u: FloatArray, rates: ComplexArray, quadratic: ComplexArray
    ) -> FloatArray:
        added = self._changes
        linear = added.constant - (q - added.relaxed) @ added.stiffness.T - u @ added.damping.T
        momenta = (quadratic.real + self._inertias) @ u[..., None]
        return super()._forces(q, u, rates, quadratic) + linear - added.rate * momenta[..., 0]

    def potential_energy(self, q: FloatArray) -> FloatArray:
        """Energy with that of the added springs [J]."""
        stretched = q - self._changes.relaxed
        springs = 0.5 * np.sum(stretched @ self._changes.stiffness * stretched, axis=-1)
        return super().potential_energy(q) + springs


def without_centrifugal(mechanism: Mechanism) -> Equations:
    """Equations without the centrifugal (and so all velocity-dependent) forces."""
    return PerturbedEquations(mechanism, centrifugal=False)


def with_joint_element(
    mechanism: Mechanism,
    joint: str,
    damping: float = 0.0,
    armature: float = 0.0,
    stiffness: float = 0.0,
    torque: float = 0.0,
) -> Equations:
    """Equations with an element on one joint, between its two bodies.

    Args:
        mechanism: without the element.
        joint: its name.
        damping: viscous friction [N m s/rad].
        armature: a rotor's inertia [kg m^2].
        stiffness: of a linear spring, relaxed at the start [N m/rad].
        torque: constant, on the child [N m].
    """
    link = next(j for j in mechanism.joints if j.name == joint)
    row = Kinematics(mechanism).angle(link.child, link.parent).coefficients
    both = np.outer(row, row)
    return PerturbedEquations(
        mechanism,
        armature=armature * both,
        constant=torque * row,
        stiffness=stiffness * both,
        relaxed=np.array(mechanism.start, dtype=np.float64),
        damping=damping * both,
    )


def with_friction(mechanism: Mechanism, rows: FloatArray, damping: float) -> Equations:
    """Equations with viscous friction on the rates `rows @ u`.

    Args:
        mechanism: without it.
        rows: shape (n, n_q).
        damping: [N m s/rad, or N s/m of a row of slides].
    """
    return PerturbedEquations(mechanism, damping=damping * rows.T @ rows)


def with_damping(mechanism: Mechanism, rate: float) -> Equations:
    """Equations with every body damped at the same rate [1/s]: forces -rate M u."""
    return PerturbedEquations(mechanism, rate=rate)


def with_tilted_gravity(mechanism: Mechanism, angle: float) -> Equations:
    """Equations with gravity turned anticlockwise by an angle [rad]."""
    direction = as_complex(mechanism.gravity_direction) * np.exp(1j * angle)
    turned = (float(direction.real), float(direction.imag))
    return PerturbedEquations(mechanism.model_copy(update={"gravity_direction": turned}))


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
    equations = equations or Equations(problem.mechanism)
    schedule = {s.name: releases.get(s.name, 0.0) for s in problem.mechanism.stops if s.closed}
    started = time.perf_counter()
    y = np.concatenate(initial_state(problem.mechanism))
    openings = {t for t in schedule.values() if t is not None and 0 < t < problem.duration}
    segments: list[Segment] = []
    now, bounds = 0.0, (tolerance, tolerance)
    for end in (*sorted(openings), problem.duration):
        closed = tuple(name for name, t in schedule.items() if t is None or t > now)
        segment, _, _ = integrate_segment(equations, closed, now, y, end, bounds)
        segments.append(segment)
        now, y = end, np.asarray(segment.interpolant(end))
    return Solution(
        problem=problem,
        equations=equations,
        segments=tuple(segments),
        release_times={name: schedule.get(name) for name in names},
        impacts=(),
        evaluations=0,
        settings={"rtol": tolerance, "atol": tolerance},
        wall_time=time.perf_counter() - started,
    )
