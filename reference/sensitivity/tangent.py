"""Derivatives of a motion's state and events along directions, through releases and impacts.

Forward variational equations (Hairer, Norsett and Wanner, Solving ODEs I, Sec. I.14) are integrated
with the motion, from one event to the next. Nothing is differenced: see :mod:`.variational`. At an
event at t(p) the state's derivative at a fixed time jumps (Aizerman and Gantmakher 1958): with the
derivative on the event's side,

    s_event = s- + f- dt,    s+ = dR s_event + dR/dp - f+ dt,

where f is the state's rate and R the impact law. At a release neither the state nor its rate jumps,
and nor does s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import InputError, UnsupportedProblemError
from ...models.kinematics import initial_state
from ..integrator import Integrator, one_thread
from ..reactions import undetermined_forces
from ..solution import Segment, Solution
from .dual import Dual, value_of
from .kinks import Kink, kinks_along, kinks_at_start, kinks_of_kicks
from .variational import VariationalEquations, movable

TOLERANCE = 1e-13
"""Local error bound: identities are then exact to some 1e-10, at half the solver's cost."""

_SAME = 1e-6  # relative: speeds after an impact, and times of stops met at one instant, that agree


@dataclass(frozen=True)
class StateTangent:
    """A state of a motion at a fixed time and its derivatives along m directions."""

    t: float
    q: FloatArray
    u: FloatArray
    """Shape (n_q,)."""
    dq: FloatArray
    du: FloatArray
    """Shape (m, n_q)."""
    closed: tuple[str, ...]
    """Stops that are active there."""
    d_release_times: dict[str, FloatArray]
    """Of every stop, shape (m,); NaN where it did not open between the start and t."""
    d_impact_times: tuple[tuple[float, FloatArray], ...] = ()
    """Time [s] of every impact between the start and t, and its derivatives, shape (m,).

    They are known to the rounding of the gap and of its derivative over the gap speed: of the last
    impacts before a stop ceases to bounce, to some 1e-7 of themselves, while the state's keep their
    digits.
    """
    kinks: tuple[Kink, ...] = ()
    """Stops for which the derivatives along some directions hold to one side only."""


@dataclass(frozen=True)
class PointTangent:
    """A marker at a fixed time and its derivatives along m directions."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    """[m], [m/s], [m/s^2], shape (2,)."""
    d_position: FloatArray
    d_velocity: FloatArray
    """Shape (m, 2)."""


def state_tangent(
    solution: Solution, equations: VariationalEquations, t: float, tol: float = TOLERANCE
) -> StateTangent:
    """Derivatives of the state at a fixed time t [s], and of the events before it.

    Args:
        solution: the motion.
        equations: of the same mechanism, with the directions.
        t: within the solution [s]; at an event, the state before it.
        tol: local error bound of the integrator, relative and absolute.

    Raises:
        InputError: t lies outside the solution, or a direction moves the start off a closed stop or
        a loop.
        UnsupportedProblemError: the motion passes a singular position before t, or comes to an
            event after which it does not depend smoothly on the directions.
        SimulationError: the integrator's step size collapsed.
    """
    if not 0 <= t <= solution.segments[-1].end:
        raise InputError(
            f"t = {t:g} s lies outside the solution, which covers 0 to "
            f"{solution.segments[-1].end:.6g} s."
        )
    _refuse_singular(solution, t)
    with one_thread():
        return _Along(solution, equations, tol).until(t)


def _refuse_singular(solution: Solution, t: float) -> None:
    for passage in solution.singular_passages:
        if passage.time <= t:
            raise UnsupportedProblemError(
                f"the motion passes a singular position at t = {passage.time:.6g} s; its "
                "derivative is known before it only."
            )


class _Along:
    """The state with its derivatives, from segment to segment."""

    def __init__(self, solution: Solution, equations: VariationalEquations, tol: float) -> None:
        self.solution, self.equations, self.tol = solution, equations, tol
        self.n_q, m = len(solution.problem.mechanism.coordinates), len(equations.directions)
        self.releases = {stop.name: np.full(m, np.nan) for stop in solution.problem.mechanism.stops}
        self.impacts: list[tuple[float, FloatArray]] = []
        self.kinks: list[Kink] = []
        # Stops whose gaps the loops fix have no part in the motion, and their forces are not
        # unique.
        self.movable = movable(equations, [stop.name for stop in solution.problem.mechanism.stops])

    def until(self, t: float) -> StateTangent:
        """Through all events before t [s]."""
        segments = [
            segment for segment in self.solution.segments if segment.start < t or segment.start == 0
        ]
        q, u = self._start(segments[0])
        for segment in segments:
            first = q, u
            q, u = self._integrated(segment, q, u, min(segment.end, t))
            self.kinks += kinks_along(self.equations, segment, (first, (q, u)))
            if segment.end <= t:
                self._note_releases(segment, q, u)
            if segment is not segments[-1]:
                following = self.solution.segments[self.solution.segments.index(segment) + 1]
                q, u = self._after(segment, following, q, u)
        closed = segments[-1].closed
        self.equations.refuse_misfits(
            q, self._active(segments[-1]), f"the motion at t = {t:.6g} s", _SAME
        )
        tangents = q.tangents.T, u.tangents.T
        events = self.releases, tuple(self.impacts), tuple(self.kinks)
        return StateTangent(t, q.value, u.value, *tangents, closed, *events)

    def _start(self, first: Segment) -> tuple[Dual, Dual]:
        """At t = 0, behind an impact if the start drives into a closed stop."""
        q, u = initial_state(self.solution.problem.mechanism)
        q_after, u_after = self._state(first)
        struck = self._impulses(0.0)
        taking_part = tuple(
            dict.fromkeys((*self._active(first), *(name for name, p in struck.items() if p > 0)))
        )
        start = self.equations.start(
            q, u, taking_part, self._rebounds(q, u, u_after, taking_part, first.closed)
        )
        q_start, u_start = Dual(q_after, start[0].tangents), Dual(u_after, start[1].tangents)
        self.kinks += kinks_at_start(self.equations, q_start, u_start, taking_part)
        unspent = Dual(u_after, self.equations.along_each("start_speeds", self.n_q))
        self.kinks += kinks_of_kicks(self.equations, q_start, unspent, self._active(first))
        return q_start, u_start

    def _active(self, segment: Segment) -> tuple[str, ...]:
        """Stops that act on the motion."""
        return tuple(name for name in segment.closed if name in self.movable)

    def _state(self, segment: Segment) -> tuple[FloatArray, FloatArray]:
        """The reference's, as a segment starts."""
        q, u = np.asarray(segment.interpolant(segment.start), dtype=np.float64).reshape(2, -1)
        return q, u

    def _impulses(self, t: float) -> dict[str, float]:
        """Impulses of the impact at t [s], by stop that acts on the motion; none without one.

        Raises:
            UnsupportedProblemError: there are several.
        """
        found = [impulses for time, impulses in self.solution.impacts if time == t]
        if len(found) > 1:
            raise _not_smooth(t, "several impacts follow each other there at once")
        return {name: p for name, p in found[0].items() if name in self.movable} if found else {}

    def _integrated(self, segment: Segment, q: Dual, u: Dual, end: float) -> tuple[Dual, Dual]:
        n_q, m, active = self.n_q, q.tangents.shape[-1], self._active(segment)

        def unpacked(y: FloatArray) -> tuple[Dual, Dual]:
            tangents = y[2 * n_q :].reshape(2, n_q, m)
            return Dual(y[:n_q], tangents[0]), Dual(y[n_q : 2 * n_q], tangents[1])

        def packed(q: Dual, u: Dual) -> FloatArray:
            return np.concatenate([q.value, u.value, q.tangents.ravel(), u.tangents.ravel()])

        def rates(_: float, y: FloatArray) -> FloatArray:
            q, u = unpacked(y)
            return packed(u, self.equations.accelerations(q, u, active)[0])

        if end <= segment.start:
            return q, u
        stepper = Integrator(rates, segment.start, packed(q, u), end, (self.tol, self.tol))
        while stepper.status == "running":
            stepper.step()
        return unpacked(np.asarray(stepper.y, dtype=np.float64))

    def _note_releases(self, segment: Segment, q: Dual, u: Dual) -> None:
        """Implicit function theorem on torque(t, p) = 0: dt = -(d torque) / (torque's rate)."""
        for k, name in enumerate(segment.closed, start=self.equations.n_loops):
            if self.solution.release_times[name] == segment.end and name not in self._impulses(
                segment.end
            ):
                if name in undetermined_forces(self.equations, q.value, segment.closed)[1]:
                    raise _not_smooth(segment.end, f"{name} opens, and its force is not unique")
                torques = self.equations.accelerations(q, u, segment.closed)[1].tangents[k]
                self.releases[name] = (
                    -torques / self.equations.rates(q.value, u.value, segment.closed)[1][k]
                )

    def _after(self, before: Segment, after: Segment, q: Dual, u: Dual) -> tuple[Dual, Dual]:
        """The state behind the event between two segments, as it is at a fixed time."""
        q_after, u_after = self._state(after)
        if struck := self._impulses(before.end):
            q, u = self._struck(before, after, struck, q, u)
        return Dual(q_after, q.tangents), Dual(u_after, u.tangents)

    def _struck(
        self, before: Segment, after: Segment, impulses: dict[str, float], q: Dual, u: Dual
    ) -> tuple[Dual, Dual]:
        u_after, t = self._state(after)[1], before.end
        shift = self._impact_time(before, tuple(impulses), q, u)
        self.impacts.append((t, shift))
        self.releases |= {
            name: shift for name in before.closed if self.solution.release_times[name] == t
        }
        taking_part = tuple(
            name
            for name, p in impulses.items()
            if p > 0 or (name in self._active(before) and name in after.closed)
        )
        rebounds = self._rebounds(q.value, u.value, u_after, taking_part, after.closed)
        q = Dual(q.value, q.tangents + np.outer(u.value, shift))
        u = Dual(u.value, u.tangents + np.outer(self._rate(before, q.value, u.value), shift))
        u = self.equations.impact(q, u, taking_part, rebounds)[0]
        if np.abs(u.value - u_after).max() > _SAME * np.abs(u_after).max():
            raise _not_smooth(t, "its stops act on each other in an order")
        q = Dual(q.value, q.tangents - np.outer(u.value, shift))
        return q, Dual(u.value, u.tangents - np.outer(self._rate(after, q.value, u.value), shift))

    def _rate(self, segment: Segment, q: FloatArray, u: FloatArray) -> FloatArray:
        return self.equations.solve(q, u, segment.closed)[0]

    def _gap_speeds(self, names: Sequence[str], q: FloatArray, u: FloatArray) -> FloatArray:
        return self.equations.constraint_jacobian(q, names)[self.equations.n_loops :] @ u

    def _impact_time(
        self, before: Segment, touching: tuple[str, ...], q: Dual, u: Dual
    ) -> FloatArray:
        """Derivatives of the time at which a gap falls through zero, shape (m,)."""
        open_stops = tuple(name for name in touching if name not in before.closed)
        speeds = self._gap_speeds(open_stops, q.value, u.value)
        gaps = self.equations.residual_tangents(q, open_stops)[self.equations.n_loops :]
        shifts = -gaps[speeds < 0] / speeds[speeds < 0, None]
        if not len(shifts):
            raise _not_smooth(before.end, f"it grazes {' and '.join(touching)}")
        if np.abs(shifts - shifts[0]).max() > _SAME * np.abs(shifts).max():
            raise _not_smooth(
                before.end,
                f"it meets {' and '.join(open_stops)} at one instant, one or the other first",
            )
        return shifts[0]

    def _rebounds(
        self,
        q: FloatArray,
        u: FloatArray,
        u_after: FloatArray,
        names: Sequence[str],
        closed: Sequence[str],
    ) -> dict[str, object]:
        """Restitution of the stops that rebound; one met too slowly does not."""
        speeds, after = (self._gap_speeds(names, q, values) for values in (u, u_after))
        restitution = self.equations.data.restitution
        return {
            name: restitution[name]
            for name, v, w in zip(names, speeds, after, strict=True)
            if name not in closed and w >= -0.5 * float(value_of(restitution[name])) * v
        }


def _not_smooth(t: float, why: str) -> UnsupportedProblemError:
    return UnsupportedProblemError(
        f"the motion does not depend smoothly on its numbers after t = {t:.6g} s: {why}; "
        "derivatives are known before it only."
    )


def marker_tangent(
    equations: VariationalEquations, state: StateTangent, marker: str = "projectile"
) -> PointTangent:
    """A marker at a state, and its derivatives along the directions at that fixed time."""
    q: Any = Dual(state.q, state.dq.T)
    u: Any = Dual(state.u, state.du.T)
    kinematics, row = equations.kinematics, equations.data.markers[marker]
    position, velocity = (
        cast("Dual", v) for v in (kinematics.position(row, q), kinematics.velocity(row, q, u))
    )
    still = kinematics.point(
        *next((m.body, m.point) for m in equations.mechanism.markers if m.name == marker)
    )
    a = equations.solve(state.q, state.u, state.closed)[0]
    return PointTangent(
        position=position.value,
        velocity=velocity.value,
        acceleration=kinematics.acceleration(still, state.q, state.u, a),
        d_position=position.tangents.T,
        d_velocity=velocity.tangents.T,
    )
