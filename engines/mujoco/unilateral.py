"""Stepping under the unilateral law: stops that are open are out of the model, and each impact is resolved as one.

MuJoCo's own limits and contacts would be met as stiff, damped springs, which give back what the
step makes of them. A stop that is open is therefore removed, the instant at which its gap is zero
is found inside the step, the impulses of all contacts that touch there change the speeds, and those
at rest afterwards are put back, preloaded.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ...models.arrays import FloatArray
from ...models.kinematics import Kinematics
from ...models.problem import Problem
from ..events import AT_REST, Contacts, may_be_met, onto_zero_gap, resting
from ..impact import Inertia, resolve_impact
from .matrices import mass_matrix
from .options import MujocoOptions
from .read import absolute_from_relative
from .step import ROUNDING, Stepper


class UnilateralStepper(Stepper):
    """Steps the model through a problem whose stops may be met.

    Raises:
        SimulationError: as :class:`Stepper`, or impacts follow each other without end.
        UnsupportedProblemError: as :class:`Stepper`.
    """

    def __init__(self, problem: Problem, options: MujocoOptions) -> None:
        super().__init__(problem, options)
        self.kinematics = Kinematics(problem.mechanism)
        self.sums = absolute_from_relative(problem.mechanism, self.model)
        self._parted = set[str]()
        """Open stops that an impact opened. Others may have the small speed that their softness left them."""

    def _start(self) -> None:
        """Begin with an impact where the start's speeds drive into a closed stop, and without stops that part."""
        with self.correction.applied():
            self.correction.forward(self.data)
        closed, state = tuple(self.active), self._state()
        speeds = {name: float(self._gap_motion(name, state)[1]) for name in closed}
        if any(speed < -AT_REST for speed in speeds.values()):
            self.active = []
            self._resolve_impact(closed, 0.0)
        elif len(resting(speeds)) < len(closed):
            self._hold(closed, speeds, 0.0)
        else:
            super()._start()

    # --- Where an impact is
    # -----------------------------------------------------------------------------------------

    def _steps_before_an_event(self, states: FloatArray, sensed: FloatArray) -> int:
        met = np.zeros(len(sensed), dtype=bool)
        for name in self._open():
            met |= self._may_be_met(name, states, self.options.timestep)
        first = int(np.argmax(met)) if met.any() else len(sensed)
        return min(first, super()._steps_before_an_event(states, sensed))

    def _step_to_event(self, start: float, end: float) -> float:
        before, step = self._state(), end - start
        self._step(before, step)
        ends = np.stack([before, self._state()])
        near = [name for name in self._open() if self._may_be_met(name, ends, step).any()]
        parts = {
            name: part
            for name in near
            if (part := self._onto_zero_gap(name, ends, step)) is not None
        }
        met = min(parts, key=lambda name: parts[name], default=None)
        if near:
            self._step_part(before, step if met is None else parts[met])
        if met is None:
            return self._after_release(before, start, end)
        if parts[met] > 0.0 and self._inactive():  # a release comes first
            return self._after_release(before, start, start + parts[met])
        return self._after_impact(met, start, start + parts[met], end)

    def _open(self) -> list[str]:
        return [name for name in self.constraints if name not in self.active]

    def _gap_motion(self, name: str, states: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gap of a stop [rad, m] and its speed in MuJoCo's states, each of shape (...,)."""
        q, u = self._coordinates(states)
        return self.kinematics.gap(name, q), np.sum(
            self.kinematics.gap_jacobian(name, q) * u, axis=-1
        )

    def _coordinates(self, states: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The mechanism's q and u in MuJoCo's states, each of shape (..., n_q)."""
        n = self.model.nv
        q = np.array(self.problem.mechanism.start) + states[..., 1 : 1 + n] @ self.sums.T
        return q, states[..., 1 + n : 1 + 2 * n] @ self.sums.T

    def _least_speed(self, name: str, state: FloatArray) -> float:
        """Speed of its gap from which a stop is met [rad/s, m/s], near a state of MuJoCo's."""
        return (
            0.0
            if name in self._parted
            else self.events.rebounds.least_speed(name, *self._coordinates(state))
        )

    def _may_be_met(self, name: str, states: FloatArray, step: float) -> NDArray[np.bool_]:
        """Whether a stop may be met between states that are a step [s] apart; shapes (n + 1, n_state) -> (n,).

        It is met if it closes in penetration at one of the two, or at the lowest point of the cubic
        between them.
        """
        (gap, speed), least = self._gap_motion(name, states), self._least_speed(name, states[0])
        return may_be_met(gap, speed, least, step)

    def _onto_zero_gap(self, name: str, ends: FloatArray, step: float) -> float | None:
        """The part of a step [s] after which a stop is met; None if it only comes near, or too slowly to be met.

        Args:
            name: of the stop.
            ends: MuJoCo's states before and after the step.
            step: length of the step [s].
        """

        def motion(part: float) -> tuple[float, float]:
            self._step_part(ends[0], part)
            now, closing = self._gap_motion(name, self._state())
            return float(now), float(closing)

        (gap, _), (first, last) = self._gap_motion(name, ends)
        return onto_zero_gap(
            motion, float(gap), (float(first), float(last)), step, self._least_speed(name, ends[0])
        )

    def _step_part(self, before: FloatArray, part: float) -> None:
        """As :meth:`_step`, of any length [s], zero included."""
        if part > 0.0:
            self._step(before, part)
        else:
            self._restore(before)
            self.correction.forward(self.data)

    # --- What an impact does
    # -----------------------------------------------------------------------------------------

    def _after_impact(self, met: str, start: float, reached: float, end: float) -> float:
        """Resolve the impact in the present state, at a time within a step [s]; return the time reached."""
        reached = end if end - reached < ROUNDING * end else reached
        if reached - start <= ROUNDING * end:
            self.samples.drop_last()  # of an instant with an impact the state after it is recorded
            reached = start
        q, _ = self._coordinates(self._state())
        touching = self.events.touching(
            reached, met, self.active, lambda name: float(self.kinematics.gap(name, q))
        )
        self._resolve_impact(touching, reached)
        self._record(reached)
        return reached

    def _resolve_impact(self, touching: Contacts, t: float) -> None:
        """Change the speeds by the impact of all contacts that touch at a time [s]."""
        q, _ = self._coordinates(self._state())
        gaps = {name: self.kinematics.gap_jacobian(name, q) @ self.sums for name in touching}
        inertia = Inertia(mass_matrix(self.model, self.data), self._loops(q))
        # Loops and contacts are springs: a drift of 1e-11 m that was in balance with its rate
        # before the impact is a force of 1e-3 N after it, which takes some steps to settle.
        drift = np.append(
            self.kinematics.loop_residual(q), [self.kinematics.gap(name, q) for name in touching]
        )
        self.data.qpos[:] += inertia.move_onto(
            np.reshape(list(gaps.values()), (-1, self.model.nv)), drift
        )
        active = np.reshape([gaps[name] for name in self.active], (-1, self.model.nv))
        speeds = inertia.without_drift(self.data.qvel, active)
        closing = {name: float(row @ speeds) for name, row in gaps.items()}
        restitution = self.events.restitution(closing, q, self.sums @ speeds)
        impact = resolve_impact(inertia, speeds, gaps, restitution, "mujoco")
        self.events.note_impact(t, impact.impulses)
        self.data.qvel[:] = impact.speeds
        self._hold(touching, impact.left, t)

    def _hold(self, touching: Contacts, speeds: Mapping[str, float], t: float) -> None:
        """Of the contacts that touch, hold those whose gaps are at rest and that push; the others open at a time [s].

        Args:
            touching: stops with zero gap.
            speeds: of their gaps [rad/s, m/s].
            t: time [s].
        """
        rest = resting(speeds)
        parting = [name for name in touching if name not in rest]
        self.events.release(parting, t)
        for name in parting:
            self.constraints[name].remove(self.model)
        for name in rest:
            self.constraints[name].restore(self.model)
            self.constraints[name].activate(self.model, self.data, self.correction)
        self.active = list(rest)
        self._parted = self._parted - set(rest) | set(parting)
        self._release_those_that_pull(t)

    def _loops(self, q: FloatArray) -> FloatArray:
        """Jacobian of the joints that close loops, shape (n_loops, n_v)."""
        return self.kinematics.loop_jacobian(q) @ self.sums
