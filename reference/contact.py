r"""Contacts of the stops: the active set, impacts, and what follows from every event.

At one state both are the linear complementarity problem of unilateral constraints. With A = G
M^{-1} G^T, the Delassus matrix (symmetric, positive semidefinite), and b = G (what the gaps do
without the stops),

    0 <= x  complementary to  A x + b >= 0

has x as torques when b are gap accelerations, and as impulses when b_i = (1 + e_i) times gap speed
i: Newton's law of restitution with complementarity (Moreau, *Unilateral contact and dry friction in
finite freedom dynamics*, 1988; Glocker and Pfeiffer, *Multiple impacts with friction in rigid
multibody systems*, Nonlinear Dynamics 7, 1995). So a gap whose stop pushes leaves with -e times its
speed before, one whose stop does not push leaves at least so fast.

It is the optimality condition of the smallest change of motion that the stops allow: min |y|^2 over
R^T y + b >= 0, with A = R^T R and y = R x. That is a least-distance problem, solved as a
non-negative least-squares problem (Lawson and Hanson, *Solving Least Squares Problems*, ch. 23), so
all stops are decided at once and no order is ever chosen.

- **Unique** is the motion after it: y is. Impulses (torques) of stops that are redundant are not;
  those returned belong to independent stops, the others being zero.
- **Redundant stops with different e** do not agree on the speed: the one that asks for more pushes,
the other parts.
- **No solution** exists where stops stand against each other, as two that hold one body from both
  sides, and no speed gives each of them its rebound. Then none of them rebounds (e = 0 for all
  stops of that impact, which always has a solution): the limit of a gap that shrinks to nothing
  between two stops with e < 1.

Between events an integrator moves the machine under a fixed set of closed stops, and locates the
events itself. What follows from an event is decided here, once for all integrators
(:class:`ActiveSet`).

- **Release.** The torque of a closed stop falls through zero: it opens.
- **Impact** (unilateral law only). The gap of an open stop falls through zero: speeds jump in the
  metric of the mass matrix with the stop's restitution e. Stops that touch at the same instant take
  part, active ones included.
- **No endless bouncing.** For 0 < e < 1 rebounds follow each other ever faster and come to rest at
  a finite time. A stop that is met slowly does not bounce (e = 0 there), and the rest of the series
  is summed (:class:`Bouncing`). With e = 1 nothing settles, nor should it.
- **No endless rattling.** Two stops may throw the machine to and fro between them, ever faster,
  towards an instant that is never reached. Impacts within `TOGETHER` of each other are one: their
  stops are solved at once, after which none of them closes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded when they are first used: a batch of launches uses none

from ..models.arrays import BoolArray, FloatArray
from ..models.errors import InputError, SimulationError
from ..models.kinematics import Kinematics, initial_state
from ..models.problem import SETTLED, Problem, StopLaw, speed_scale
from .equations import Equations

TOGETHER = 1e-9  # [s]
_TOUCHING = 1e-11  # [rad] an open stop with a gap below this takes part in an impact
_AT_REST = 1e-9  # [rad/s] gap speeds below this are rounding of an impact's solution
_IMMOBILE = 1e-14  # of the largest inverse inertia: that of a gap which cannot move
# Of the largest gap speed (acceleration): two demands that differ by less do not contradict.
_SAME_DEMAND = (1e-12, 1e-9)
# Of the speed scale, times 1 - e: the time of rest is taken from the first rebound that is slower.
_SUMMED = 1e-4
_CONTRADICTION = 1e-7  # inverse of the largest y, in units of the offset, that is an answer
_FITS = 1e-9  # [m], [m/s] how well loops of joints must close at the start


def solve_lcp(matrix: FloatArray, offset: FloatArray) -> FloatArray | None:
    """X >= 0 with matrix x + offset >= 0 and x . (matrix x + offset) = 0; None if there is none.

    Args:
        matrix: symmetric, positive semidefinite, shape (m, m).
        offset: of any direction, also outside of the range of the matrix, shape (m,).
    """
    x, diagonal = np.zeros_like(offset), np.diag(matrix)
    mobile = np.flatnonzero(diagonal > _IMMOBILE * diagonal.max())
    scale = 1.0 / np.sqrt(diagonal[mobile])
    b = scale * offset[mobile]
    size = float(np.abs(b).max(initial=0.0))
    if size == 0.0:
        return x
    # A = root^T root, with a root of full row rank.
    values, vectors = np.linalg.eigh(scale[:, None] * matrix[np.ix_(mobile, mobile)] * scale)
    kept = values > values[-1] * len(values) * np.finfo(np.float64).eps * 16
    root = (np.sqrt(values[kept]) * vectors[:, kept]).T
    for rounding in _SAME_DEMAND:
        # The y of least norm with root^T y + b >= 0; constraints that are active there are
        # independent of each other.
        distance = np.vstack([root, -(b / size + rounding)])
        pushes, residual = scipy.optimize.nnls(distance, np.append(np.zeros(len(root)), 1.0))
        if residual > _CONTRADICTION:
            break
    else:
        return None  # the stops' demands contradict each other
    active = pushes > 0
    y = np.linalg.lstsq(root[:, active].T, -b[active])[0]
    x[mobile[active]] = scale[active] * np.linalg.lstsq(root[:, active], y)[0]
    return np.maximum(x, 0.0)


def active_contacts(
    equations: Equations, q: FloatArray, u: FloatArray, touching: Sequence[str]
) -> tuple[str, ...]:
    """Select the touching stops that push (torque >= 0); the others are about to open.

    A stop whose torque would be negative cannot push and is left out, all stops decided at once.

    Args:
        q, u: one state, shape (n_q,).
        touching: stops whose gap and gap speed are zero.

    Raises:
        SimulationError: stops against each other, whose gaps cannot all stay open.
    """
    if not touching:
        return ()
    torques = equations.solve(q, u, touching)[1][equations.n_loops :]
    if np.all(torques >= 0):
        return tuple(touching)
    matrix, free = _delassus(equations, q, u, touching)
    torques = solve_lcp(matrix, free)
    if torques is None:
        raise SimulationError(
            f"no forces of the stops {', '.join(touching)} keep all of their gaps open: they jam."
        )
    return tuple(name for name, torque in zip(touching, torques, strict=True) if torque > 0)


def resolve_impact(
    equations: Equations,
    q: FloatArray,
    u: FloatArray,
    touching: Sequence[str],
    restitution: FloatArray,
) -> tuple[FloatArray, dict[str, float]]:
    """Speeds after an impact of the touching stops, and their impulses, all decided at once.

    u+ = u- + M^{-1} G^T P with P >= 0 complementary to G u+ + e G u- >= 0; see the module.

    Args:
        q, u: state before, shape (n_q,).
        touching: stops that touch, active ones included.
        restitution: e of each of them, shape (n_touching,).

    Returns:
        u+, shape (n_q,), and the impulse of each stop [N m s].

    Raises:
        SimulationError: no speeds keep all gaps open.
    """
    rows = gap_jacobian(equations, q, touching)
    matrix, _ = _delassus(equations, q, u, touching)
    approach = rows @ u
    # Where none rebounds, the rounding of two that stand against each other at rest may still
    # contradict itself.
    demands = (
        (1.0 + restitution) * approach,
        approach,
        np.where(np.abs(approach) <= _AT_REST, 0.0, approach),
    )
    for demand in demands:
        impulses = solve_lcp(matrix, demand)
        if impulses is not None:
            break
    else:
        raise SimulationError(
            f"the impact of the stops {', '.join(touching)} has no solution: they jam."
        )
    after = u + equations.response(q, rows.T @ impulses)
    return after, dict(zip(touching, impulses.tolist(), strict=True))


def gap_jacobian(equations: Equations, q: FloatArray, names: Sequence[str]) -> FloatArray:
    """Jacobian of the stops' gaps at one state, shape (n_names, n_q)."""
    return equations.constraint_jacobian(q, names)[equations.n_loops :]


def _delassus(
    equations: Equations, q: FloatArray, u: FloatArray, touching: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """G M^{-1} G^T and the gap accelerations without the stops, both with the loop joints."""
    rows = gap_jacobian(equations, q, touching)
    free = equations.solve(q, u, ())[0]
    response = np.array([equations.response(q, row) for row in rows])
    return rows @ response.T, rows @ free + equations.constraint_bias(q, u, touching)[
        equations.n_loops :
    ]


def starts_at_rest(kinematics: Kinematics, closed: Sequence[str]) -> BoolArray:
    """Tell whether loops close and closed stops rest at the start; of stacked mechanisms (n,).

    Then the start is what :meth:`ActiveSet.begin` begins with.
    """
    q, u = initial_state(kinematics.mechanism)
    rows = [kinematics.gap_jacobian(name, q) for name in closed]
    speeds = [np.abs(np.sum(row * u, axis=-1)) <= _AT_REST for row in rows]
    speeds.append(
        np.all(np.abs(kinematics.loop_jacobian(q) @ u[..., None]) <= _FITS, axis=(-2, -1))
    )
    speeds.append(np.all(np.abs(kinematics.loop_residual(q)) <= _FITS, axis=-1))
    return np.all(speeds, axis=0)


@dataclass(frozen=True)
class EventFunction:
    """A closed stop's torque (release) or an open stop's gap (impact) falls through zero."""

    stop: str
    closes: bool


@dataclass(frozen=True)
class PostEventState:
    """A state just after an event, or at the start, and the active stops from there on."""

    t: float
    q: FloatArray
    u: FloatArray
    closed: tuple[str, ...]


class ActiveSet:
    """The active set of one problem's stops, and its release times and impacts."""

    def __init__(self, problem: Problem, equations: Equations) -> None:
        self.problem = problem
        self.equations = equations
        self.releases: dict[str, float | None]
        self.releases = dict.fromkeys(stop.name for stop in problem.mechanism.stops)
        self.impacts: list[tuple[float, dict[str, float]]] = []
        """Time [s] and impulse of each stop that took part [N m s]."""
        self._last_impact: dict[str, float] = {}
        self._bouncing = Bouncing(equations)

    @property
    def rest_times(self) -> dict[str, tuple[float, ...]]:
        """Times by stop at which it ceased to bounce, or was met without rebound [s]."""
        return {name: tuple(times) for name, times in self._bouncing.rest_times.items()}

    def begin(self) -> PostEventState:
        """The start, behind an impact if the start speeds drive into a closed stop.

        Raises:
            InputError: a loop of joints does not close at the start, in position or speed.
        """
        mechanism = self.problem.mechanism
        q, u = initial_state(mechanism)
        residual = self.equations.loop_residual(q)
        speeds = self.equations.constraint_jacobian(q, ()) @ u
        if np.any(np.abs(residual) > _FITS) or np.any(np.abs(speeds) > _FITS):
            worst = (
                f"{np.abs(residual).max():.3g} m or rad and {np.abs(speeds).max():.3g} m/s or rad/s"
            )
            names = ", ".join(mechanism.bound_by)
            raise InputError(
                f"start does not fit the joints that close a loop, or the couplers ({names}): they "
                f"are off by up to {worst}."
            )
        touching = tuple(stop.name for stop in mechanism.stops if stop.closed)
        if any(speed < -_AT_REST for speed in self._gap_speeds(touching, q, u).values()):
            u = self._resolve_impact(0.0, q, u, touching)
        return self._with_active_contacts(0.0, q, u, touching)

    def event_functions(self, initial: PostEventState) -> tuple[EventFunction, ...]:
        """Events to be located after a state."""
        functions = [EventFunction(name, closes=False) for name in initial.closed]
        if self.problem.stop_law is StopLaw.UNILATERAL:
            for name in self.releases:
                if name not in initial.closed:
                    functions.append(EventFunction(name, closes=True))
        return tuple(functions)

    def after(
        self,
        t: float,
        q: FloatArray,
        u: FloatArray,
        closed: Sequence[str],
        events: Sequence[EventFunction],
    ) -> PostEventState:
        """The state after events at one instant.

        Args:
            t: when [s].
            q, u: the state before, shape (n_q,).
            closed: stops that were active until now.
            events: those located there; other stops that touch at the same instant are found here.
        """
        released = {event.stop for event in events if not event.closes}
        for name in released:
            self._note_release(name, t)
        still_closed = tuple(name for name in closed if name not in released)
        closing = {event.stop for event in events if event.closes}
        if released:
            self._bouncing.interrupt()
        if not closing:
            return self._with_active_contacts(t, q, u, still_closed)
        for name in self.releases:
            if name not in closed:
                # Open stops take part that touch, or that the machine has just left.
                gap = abs(float(self.equations.kinematics.gap(name, q)))
                if gap <= _TOUCHING or t - self._last_impact.get(name, -np.inf) <= TOGETHER:
                    closing.add(name)
        touching = tuple(name for name in self.releases if name in still_closed or name in closing)
        met = {n: v for n, v in self._gap_speeds(touching, q, u).items() if n not in still_closed}
        state = self._with_active_contacts(t, q, self._resolve_impact(t, q, u, touching), touching)
        self._bouncing.note_impact(t, state.q, state.u, state.closed, met)
        return state

    def with_other_forces(self, equations: Equations, state: PostEventState) -> PostEventState:
        """The state at an instant from which other forces act, by the equations with them."""
        self.equations = self._bouncing.equations = equations
        self._bouncing.interrupt()
        return self._with_active_contacts(state.t, state.q, state.u, state.closed)

    def _with_active_contacts(
        self, t: float, q: FloatArray, u: FloatArray, touching: Sequence[str]
    ) -> PostEventState:
        """The state with the active contacts of the touching stops; the others have opened."""
        speeds = self._gap_speeds(touching, q, u)
        resting = tuple(name for name in touching if abs(speeds[name]) <= _AT_REST)
        closed = active_contacts(self.equations, q, u, resting)
        for name in touching:
            if name not in closed:
                self._note_release(name, t)
        return PostEventState(t, q, u, closed)

    def _resolve_impact(
        self, t: float, q: FloatArray, u: FloatArray, touching: tuple[str, ...]
    ) -> FloatArray:
        speeds = self._gap_speeds(touching, q, u)
        restitution = self._bouncing.restitution(q, u, speeds)
        after, impulses = resolve_impact(self.equations, q, u, touching, restitution)
        # A stop that was left at rest without a force is met again at the speed of rounding: that
        # speed is taken away, and is no impact.
        if any(speed < -_AT_REST for speed in speeds.values()):
            self.impacts.append((t, impulses))
        self._last_impact |= {name: t for name, impulse in impulses.items() if impulse > 0}
        return after

    def _gap_speeds(self, names: Sequence[str], q: FloatArray, u: FloatArray) -> dict[str, float]:
        return dict(zip(names, (gap_jacobian(self.equations, q, names) @ u).tolist(), strict=True))

    def _note_release(self, name: str, t: float) -> None:
        """Note an opening; only the first one counts: the throw depends on it."""
        if self.releases[name] is None and self.problem.mechanism.stop(name).closed:
            self.releases[name] = t


class Bouncing:
    """Restitution of the stops of one motion, and when each came to rest.

    For 0 < e < 1 infinitely many rebounds end by a finite time, of which the last are summed in
    closed form. Once they are short, what pulls the gap g back is linear in time and in the gap's
    speed, g'' = -(a + j t + c g'), with t along the resting motion. With rebound speed v after an
    impact at t, the series of the remaining flights sums, to first order in j and c, to

        rest = t + tau (1 - tau (j / (3 a) + c / 6)),        tau = 2 v / (a (1 - e)).

    The sum errs by the cube of tau over the motion's own time, and an impact is located to the
    rounding of its gap over its speed: the time of rest is taken where both are small (`_SUMMED`),
    while impacts are followed further (`SETTLED`), so that states err by a rebound some 1e-13 times
    as high as the first fall. Both limits are parts of one speed scale.
    """

    def __init__(self, equations: Equations) -> None:
        self.equations = equations
        self._restitution = {stop.name: stop.restitution for stop in equations.mechanism.stops}
        self.rest_times: dict[str, list[float]] = {name: [] for name in self._restitution}
        """By stop, the instants at which it ceased to bounce, or was met without rebound [s]."""
        self._energy = 0.0
        self._summed: dict[str, float] = {}

    def restitution(self, q: FloatArray, u: FloatArray, speeds: Mapping[str, float]) -> FloatArray:
        """Restitution of each touching stop, 0 where it is met too slowly to rebound.

        Args:
            q, u: state before the impact, shape (n_q,).
            speeds: gap speeds by stop [its speed_unit].
        """
        self._energy = max(self._energy, float(self.equations.kinematics.kinetic_energy(q, u)))
        restitution = np.zeros(len(speeds))
        for i, (name, speed) in enumerate(speeds.items()):
            if speed < -SETTLED * self._scale(name, q):
                restitution[i] = self._restitution[name]
        return restitution

    def note_impact(
        self,
        t: float,
        q: FloatArray,
        u: FloatArray,
        closed: Sequence[str],
        speeds: Mapping[str, float],
    ) -> None:
        """Note which of the stops that were met rest now, and when those that bounce will.

        Args:
            t: when [s].
            q, u: the state after, shape (n_q,).
            closed: stops that are active after it.
            speeds: gap speeds before it, of stops that were not active.
        """
        self._summed = {name: rest for name, rest in self._summed.items() if set(speeds) == {name}}
        for name, speed in speeds.items():
            e = self._restitution[name]
            slow = 0.0 < e < 1.0 and e * abs(speed) < _SUMMED * (1.0 - e) * self._scale(name, q)
            if slow and name not in self._summed:
                self._summed[name] = t + self._remaining(name, q, u, closed, e, abs(speed))
            elif not slow:
                self._summed.pop(name, None)
            if name in closed:
                self.rest_times[name].append(self._summed.pop(name, t))

    def interrupt(self) -> None:
        """Forget what was summed: another stop has opened."""
        self._summed.clear()

    def _scale(self, name: str, q: FloatArray) -> float:
        row = self._row(name, q)
        return speed_scale(self._energy, float(row @ self.equations.response(q, row)))

    def _row(self, name: str, q: FloatArray) -> FloatArray:
        return self.equations.kinematics.gap_jacobian(name, q)

    def _remaining(
        self, name: str, q: FloatArray, u: FloatArray, closed: Sequence[str], e: float, speed: float
    ) -> float:
        """Time of the remaining rebounds of a stop [s]; 0 if nothing pulls back."""
        others = tuple(other for other in closed if other != name)
        row = self._row(name, q)
        response = self.equations.response(q, row)
        # Speeds that an impulse of the stop causes, for a gap speed of 1.
        along = response / (row @ response)
        resting = u - along * (row @ u)
        pull = self._pull(name, q, resting, others)
        if pull <= 0.0:
            return 0.0
        tau = 2.0 * e * speed / (pull * (1.0 - e))
        acceleration = self.equations.solve(q, resting, (*others, name))[0]
        later = self._pull(name, q + tau * resting, resting + tau * acceleration, others)
        up, down = (
            self._pull(name, q, resting + sign * speed * along, others) for sign in (1.0, -1.0)
        )
        return tau * (1.0 - (later - pull) / (3.0 * pull) - tau * (up - down) / (12.0 * speed))

    def _pull(self, name: str, q: FloatArray, u: FloatArray, others: Sequence[str]) -> float:
        """The gap's acceleration towards zero without the stop, the others being active."""
        free = self.equations.solve(q, u, others)[0]
        return -float(self._row(name, q) @ free + self.equations.kinematics.gap_bias(name, q, u))
