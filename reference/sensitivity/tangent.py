"""Derivatives of a motion's state and events along directions, through releases and impacts.

Forward variational equations (Hairer, Norsett and Wanner, Solving ODEs I, Sec. I.14) are integrated
with the motion, from one event to the next. Nothing is differenced: see :mod:`.variational`. At an
event at t(p) the state's derivative at a fixed time jumps (Aizerman and Gantmakher 1958): with the
derivative on the event's side,

    s_event = s- + f- dt,    s+ = dR s_event + dR/dp - f+ dt,

where f is the state's rate and R the impact law. At a release neither the state nor its rate jumps,
and nor does s.

A stop that touches without a force makes a *kink*: derivatives hold to one side only. It divides
the changes of a mechanism's numbers into two kinds:

- It touches at the start, and opens there, because it would have to pull. A change that opens the
  gap leaves the motion smooth; one towards the stop strikes it. Derivatives are those of the motion
  without the stop.
- It is active without force for some time (a body at rest beside a wall, with nothing that presses
  it). A change that presses it on leaves it active; one the other way opens it. Derivatives are
  those of the motion with the stop active.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import InputError, UnsupportedProblemError
from ...models.kinematics import initial_state
from ..contact import gap_jacobian
from ..integrator import Integrator, one_thread
from ..reactions import undetermined_forces
from ..solution import Segment, Solution
from .variational import Dual, VariationalEquations, movable, value_of

TOLERANCE = 1e-13
"""Local error bound: identities are then exact to some 1e-10, at half the solver's cost."""

_SAME = 1e-6  # relative: speeds after an impact, and times of stops met at one instant, that agree
_TOUCHES = 1e-9  # [m], [rad] and their rates: of gaps and gap speeds at the start that are zero
# Of the largest derivative: gaps, gap speeds and forces that change by less do not change.
_MOVES = 1e-9
_NO_FORCE = 1e-12  # of what the stop would carry if it took all forces on the mechanism


@dataclass(frozen=True)
class Kink:
    """A stop at which derivatives hold to one side."""

    stop: str
    t: float  # [s]
    sides: FloatArray
    """Sides on which derivatives hold: 1 along a direction, -1 against it, 0 both; (m,)."""
    otherwise: str  # what steps to the other side do, such as "strikes floor, which ..."


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
    closed: tuple[str, ...]  # stops that are active there
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
    end = solution.segments[-1].end
    if not 0 <= t <= end:
        raise InputError(f"t = {t:g} s lies outside the solution, which covers 0 to {end:.6g} s.")
    for passage in solution.singular_passages:
        if passage.time <= t:
            raise UnsupportedProblemError(
                f"the motion passes a singular position at t = {passage.time:.6g} s; its "
                "derivative is known before it only."
            )
    with one_thread():
        return _Along(solution, equations, tol).until(t)


class _Along:
    """The state with its derivatives, from segment to segment."""

    def __init__(self, solution: Solution, equations: VariationalEquations, tol: float) -> None:
        self.solution, self.equations, self.tol = solution, equations, tol
        stops = [stop.name for stop in solution.problem.mechanism.stops]
        m = len(equations.directions)
        self.releases = {name: np.full(m, np.nan) for name in stops}
        self.impacts: list[tuple[float, FloatArray]] = []
        self.kinks: list[Kink] = []
        # Stops whose gaps the loops fix have no part in the motion, and their forces are not
        # unique.
        self.movable = movable(equations, stops)

    def until(self, t: float) -> StateTangent:
        """Through all events before t [s]."""
        all_segments = self.solution.segments
        segments = [s for s in all_segments if s.start < t or s.start == 0]
        q, u = self._start(segments[0])
        for i, segment in enumerate(segments):
            first = q, u
            q, u = self._integrated(segment, q, u, min(segment.end, t))
            self._note_idle(segment, (first, (q, u)))
            if segment.end <= t:
                self._note_releases(segment, q, u)
            if i + 1 < len(segments):
                q, u = self._after(segment, all_segments[i + 1], q, u)
        last = segments[-1]
        self.equations.refuse_misfits(q, self._active(last), f"the motion at t = {t:.6g} s", _SAME)
        state = q.value, u.value, q.tangents.T, u.tangents.T
        events = self.releases, tuple(self.impacts), tuple(self.kinks)
        return StateTangent(t, *state, last.closed, *events)

    def _start(self, first: Segment) -> tuple[Dual, Dual]:
        """Start at t = 0, behind an impact if the start drives into a closed stop."""
        equations = self.equations
        q, u = initial_state(self.solution.problem.mechanism)
        q_after, u_after = _state(first, first.start)
        struck = [name for name, impulse in self._impulses(0.0).items() if impulse > 0]
        active = self._active(first)
        taking_part = tuple(dict.fromkeys((*active, *struck)))
        rebounds = self._rebounds(q, u, u_after, taking_part, first.closed)
        q_dual, u_dual = equations.start(q, u, taking_part, rebounds)
        q_start, u_start = Dual(q_after, q_dual.tangents), Dual(u_after, u_dual.tangents)
        for stop in equations.mechanism.stops:
            gap = float(equations.kinematics.gap(stop.name, q_after))
            if stop.name in taking_part or abs(gap) > _TOUCHES:
                continue
            # It touches without a force, and is left there.
            gap, speed, speed_now = equations.gap_tangents(q_start, u_start, stop.name)
            sides = _signs(gap, q_start.tangents)
            if abs(speed_now) <= _TOUCHES:
                sides = np.where(sides == 0, _signs(speed, u_start.tangents), sides)
            text = f"strikes {stop.name}, which touches at the start without a force"
            self._note_kink(Kink(stop.name, 0.0, sides, text))
        # The derivatives before the active stops take any of them.
        unspent = Dual(u_after, equations.along_each("start_speeds", len(q)))
        for name in active:
            if equations.mechanism.stop(name).restitution == 1:
                speed = equations.gap_tangents(q_start, unspent, name)[1]
                sides = np.where(_signs(speed, unspent.tangents) == 0, 0.0, np.nan)
                text = f"bounces on {name} for ever, because its restitution is 1"
                self._note_kink(Kink(name, 0.0, sides, text))
        return q_start, u_start

    def _note_kink(self, kink: Kink) -> None:
        if kink.sides.any():
            self.kinks.append(kink)

    def _note_idle(self, segment: Segment, ends: Sequence[tuple[Dual, Dual]]) -> None:
        """Kinks of the stops that are active without force over a whole segment."""
        equations, closed = self.equations, segment.closed
        idle = [name for name in movable(equations, closed) if _is_idle(equations, segment, name)]
        if not idle:
            return
        forces = [equations.accelerations(q, u, closed)[1] for q, u in ends]
        for name in idle:
            k = equations.n_loops + closed.index(name)
            first, last = (_signs(force.tangents[k], force.tangents) for force in forces)
            sides = np.where(first * last < 0, np.nan, np.where(first == 0, last, first))
            text = f"opens {name}, which carries no force from t = {segment.start:.6g} s on"
            self._note_kink(Kink(name, segment.start, sides, text))

    def _active(self, segment: Segment) -> tuple[str, ...]:
        """Stops that act on the motion."""
        return tuple(name for name in segment.closed if name in self.movable)

    def _impulses(self, t: float) -> dict[str, float]:
        """Impulses of the impact at t [s], by stop that acts on the motion; none without one."""
        impacts = [impulses for time, impulses in self.solution.impacts if time == t]
        if len(impacts) > 1:
            raise _not_smooth(t, "several impacts follow each other there at once")
        return {n: p for impulses in impacts for n, p in impulses.items() if n in self.movable}

    def _integrated(self, segment: Segment, q: Dual, u: Dual, end: float) -> tuple[Dual, Dual]:
        n_q, m = q.tangents.shape
        active = self._active(segment)

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
        equations, closed, t = self.equations, segment.closed, segment.end
        for k, name in enumerate(closed, start=equations.n_loops):
            if self.solution.release_times[name] != t or name in self._impulses(t):
                continue
            if name in undetermined_forces(equations, q.value, closed)[1]:
                raise _not_smooth(t, f"{name} opens, and its force is not unique")
            torques = equations.accelerations(q, u, closed)[1].tangents[k]
            self.releases[name] = -torques / equations.rates(q.value, u.value, closed)[1][k]

    def _after(self, before: Segment, after: Segment, q: Dual, u: Dual) -> tuple[Dual, Dual]:
        """The state behind the event between two segments, as it is at a fixed time."""
        q_after, u_after = _state(after, after.start)
        impulses, t = self._impulses(before.end), before.end
        if impulses:
            shift = self._impact_time(before, tuple(impulses), q, u)
            self.impacts.append((t, shift))
            opened = [name for name in before.closed if self.solution.release_times[name] == t]
            self.releases |= dict.fromkeys(opened, shift)
            stay = [name for name in self._active(before) if name in after.closed]
            taking_part = tuple(name for name, p in impulses.items() if p > 0 or name in stay)
            rebounds = self._rebounds(q.value, u.value, u_after, taking_part, after.closed)
            rate = self.equations.solve(q.value, u.value, before.closed)[0]
            q = Dual(q.value, q.tangents + np.outer(u.value, shift))
            u = Dual(u.value, u.tangents + np.outer(rate, shift))
            u = self.equations.impact(q, u, taking_part, rebounds)[0]
            if np.abs(u.value - u_after).max() > _SAME * np.abs(u_after).max():
                raise _not_smooth(t, "its stops act on each other in an order")
            rate = self.equations.solve(q.value, u.value, after.closed)[0]
            q = Dual(q.value, q.tangents - np.outer(u.value, shift))
            u = Dual(u.value, u.tangents - np.outer(rate, shift))
        return Dual(q_after, q.tangents), Dual(u_after, u.tangents)

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
            why = f"it meets {' and '.join(open_stops)} at one instant, one or the other first"
            raise _not_smooth(before.end, why)
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
        rebounds: dict[str, object] = {}
        for name, v, w in zip(names, speeds, after, strict=True):
            restitution = self.equations.data.restitution[name]
            if name not in closed and w >= -0.5 * float(value_of(restitution)) * v:
                rebounds[name] = restitution
        return rebounds


def _state(segment: Segment, t: float) -> tuple[FloatArray, FloatArray]:
    """The reference's own q and u."""
    q, u = np.asarray(segment.interpolant(t), dtype=np.float64).reshape(2, -1)
    return q, u


def _not_smooth(t: float, why: str) -> UnsupportedProblemError:
    return UnsupportedProblemError(
        f"the motion does not depend smoothly on its numbers after t = {t:.6g} s: {why}; "
        "derivatives are known before it only."
    )


def _is_idle(equations: VariationalEquations, segment: Segment, name: str) -> bool:
    """Tell whether an active stop carries nothing, of what it would if it took all forces."""
    k, angles = equations.n_loops + segment.closed.index(name), equations.kinematics.is_angle > 0
    for t in np.linspace(segment.start, segment.end, 3):
        q, u = _state(segment, t)
        row = gap_jacobian(equations, q, (name,))[0]
        mass = equations.mass_matrix(q)
        forces = equations.forces(q, u)
        mobility = float(row @ np.linalg.solve(mass, row))
        turning = float(u @ mass @ u) * np.abs(u[angles]).max(initial=0.0) ** 2
        size = np.sqrt((float(forces @ np.linalg.solve(mass, forces)) + turning) / mobility)
        if abs(float(equations.solve(q, u, segment.closed)[1][k])) > _NO_FORCE * size:
            return False
    return True


def _signs(values: FloatArray, state: FloatArray) -> FloatArray:
    """Signs of derivatives, 0 of those that are rounding of the state's, shape (m,)."""
    size = np.maximum(1.0, np.abs(state).max(axis=0))
    return np.where(np.abs(values) > _MOVES * size, np.sign(values), 0.0)


def sides(kinks: Sequence[Kink], m: int) -> FloatArray:
    """Sides on which derivatives hold: 1, -1, 0 for both, NaN for neither; shape (m,)."""
    rows = np.array([kink.sides for kink in kinks]).reshape(-1, m)
    both = (rows > 0).any(axis=0) & (rows < 0).any(axis=0)
    return np.where(both, np.nan, np.sign(rows.sum(axis=0)))  # NaN stays


def one_sided(kinks: Sequence[Kink], names: Sequence[str]) -> list[str]:
    """Sentences on the directions along which derivatives hold to one side, or to none.

    Args:
        kinks: of a motion.
        names: of the directions, shape (m,).
    """

    def listed(directions: Iterable[int]) -> str:
        *most, last = [names[j] for j in directions]
        return " and ".join(filter(None, [", ".join(most), last]))

    held = sides(kinks, len(names))
    # Directions on which the same happens to the other side, by what that is.
    alike: dict[str, list[int]] = {}
    for j in np.flatnonzero(held).tolist():
        events = dict.fromkeys(kink.otherwise for kink in kinks if kink.sides[j])
        alike.setdefault(" and ".join(events), []).append(j)
    sentences: list[str] = []
    for event, directions in alike.items():
        ways: list[str] = []
        if up := [j for j in directions if held[j] > 0]:
            ways.append(f"an increase of {listed(up)}")
        if down := [j for j in directions if held[j] < 0]:
            ways.append(f"a decrease of {listed(down)}")
        if ways:
            sentences.append(
                f"derivatives hold one way only for {' and '.join(ways)}: the other way {event}"
            )
        if neither := [j for j in directions if np.isnan(held[j])]:
            sentences.append(f"there is no derivative by {listed(neither)}: either way {event}")
    return sentences


def marker_tangent(
    equations: VariationalEquations, state: StateTangent, marker: str = "projectile"
) -> PointTangent:
    """A marker at a state, and its derivatives along the directions at that fixed time."""
    q: Any = Dual(state.q, state.dq.T)
    u: Any = Dual(state.u, state.du.T)
    kinematics, row = equations.kinematics, equations.data.markers[marker]
    position = cast("Dual", kinematics.position(row, q))
    velocity = cast("Dual", kinematics.velocity(row, q, u))
    described = next(m for m in equations.mechanism.markers if m.name == marker)
    still = kinematics.point(described.body, described.point)
    a = equations.solve(state.q, state.u, state.closed)[0]
    return PointTangent(
        position=position.value,
        velocity=velocity.value,
        acceleration=kinematics.acceleration(still, state.q, state.u, a),
        d_position=position.tangents.T,
        d_velocity=velocity.tangents.T,
    )
