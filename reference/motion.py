"""The reference motion of a mechanism for users: every quantity at any time, and the events."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..models.arrays import FloatArray
from ..models.errors import InputError
from ..models.launch import Launch
from ..models.library.registry import Model, model_of
from ..models.mechanism import Mechanism
from ..models.problem import Problem, StopLaw
from ..models.shown import Shown
from ..models.trajectory import PointMotion, Trajectory
from . import solver
from .solution import MotionSamples, Solution


def solve(
    mechanism: Model,
    duration: float | None = None,
    *,
    stop_law: StopLaw | str | None = None,
    tolerance: float = solver.TOLERANCE,
) -> ReferenceMotion:
    """Solve a mechanism by the reference: a motion that can be read at any time.

        >>> from trebucheck.reference.motion import solve
        >>> motion = solve("fixed", 1.6)
        >>> motion.q([0.0, 0.8, 1.6]).shape
        (3, 3)
        >>> [event.stop for event in motion.events]
        ['hanger rest', 'sling rest']

    Args:
        mechanism: a mechanism, a problem, a name of the library, or the path of a JSON file.
        duration: end of the motion [s]; left out, that of the problem, or of the library's problem
            of that name, or 3 s.
        stop_law: "release-once" or "unilateral"; left out, that of the problem, or release-once.
        tolerance: local error bound of the integrator, relative and absolute [rad, m, rad/s, m/s].

    Raises:
        InputError: nothing has that name, the file cannot be read, or a value is not valid.
        UnsupportedProblemError: the mechanism has an element that the reference does not know.
        SimulationError: the integrator gave up.
    """
    problem = problem_of(mechanism, duration, stop_law)
    return ReferenceMotion(solver.solve(problem, rtol=tolerance, atol=tolerance))


def problem_of(
    mechanism: Model, duration: float | None = None, stop_law: StopLaw | str | None = None
) -> Problem:
    """The problem that a mechanism, problem, name or path stands for; see :func:`solve`.

    Raises:
        InputError: nothing has that name, the file cannot be read, or a value is not valid.
    """
    given = model_of(mechanism)
    problem = given if isinstance(given, Problem) else Problem(given)
    if duration is None and stop_law is None:
        return problem
    end = problem.duration if duration is None else duration
    law = problem.stop_law if stop_law is None else stop_law
    return Problem(problem.mechanism, end, stop_law=law)


@dataclass(frozen=True)
class StopOpening:
    """A stop that was closed at the start opens for the first time."""

    time: float
    """[s]."""
    stop: str


@dataclass(frozen=True)
class StopImpact:
    """The mechanism meets one or several stops, and its speeds jump."""

    time: float
    """[s]."""
    impulses: Mapping[str, float]
    """Of each stop that took part [N m s], of one on a point [N s]."""


@dataclass(frozen=True, repr=False)
class ReferenceMotion(Shown):
    """The reference solution of a problem, continuous in time.

    Every function takes a time [s], or times of shape (n,); what it returns has the shape of the
    times before that of the quantity. At an event it is the state after it. Times outside the
    motion, and names that no marker has, raise InputError.
    """

    solution: Solution

    @property
    def problem(self) -> Problem:
        """The problem that was solved."""
        return self.solution.problem

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism that moves."""
        return self.problem.mechanism

    @property
    def duration(self) -> float:
        """End of the motion [s]."""
        return self.solution.segments[-1].end

    def q(self, t: ArrayLike) -> FloatArray:
        """Coordinates, in the order of `mechanism.coordinates` [rad or m], shape (..., n_q)."""
        return self._shaped(t, self._read(t).q)

    def u(self, t: ArrayLike) -> FloatArray:
        """Speeds, the time derivatives of q [rad/s or m/s], shape (..., n_q)."""
        return self._shaped(t, self._read(t).u)

    def a(self, t: ArrayLike) -> FloatArray:
        """Accelerations [rad/s^2 or m/s^2], shape (..., n_q)."""
        return self._shaped(t, self._read(t).a)

    def marker(self, name: str, t: ArrayLike) -> FloatArray:
        """Position of a marker in the world [m], shape (..., 2)."""
        return self._shaped(t, self._marker(name, t).position)

    def marker_velocity(self, name: str, t: ArrayLike) -> FloatArray:
        """Velocity of a marker in the world [m/s], shape (..., 2)."""
        return self._shaped(t, self._marker(name, t).velocity)

    def kinetic_energy(self, t: ArrayLike) -> FloatArray:
        """Kinetic energy [J], shape (...,)."""
        motion, kinematics = self._read(t), self.solution.equations.kinematics
        return self._shaped(t, kinematics.kinetic_energy(motion.q, motion.u))

    def potential_energy(self, t: ArrayLike) -> FloatArray:
        """Energy of gravity, zero at the world's origin, and of springs [J], shape (...,)."""
        return self._shaped(t, self.solution.equations.potential_energy(self._read(t).q))

    def stop_torques(self, t: ArrayLike) -> dict[str, FloatArray]:
        """Torque of every stop [N m], of one on a point its force [N], each of shape (...,)."""
        torques = self._read(t).stop_torques
        return {name: self._shaped(t, torque) for name, torque in torques.items()}

    def joint_reactions(self, t: ArrayLike) -> dict[str, FloatArray]:
        """Force of every joint on its child, in the world [N], each of shape (..., 2).

        Where constraints are redundant they are not unique; those of least norm are given
        (`solution.undetermined_joints`).
        """
        reactions = self.solution.joint_reactions(self._read(t))
        return {name: self._shaped(t, force) for name, force in reactions.items()}

    def trajectory(self, t: ArrayLike) -> Trajectory:
        """Quantities at times [s], shape (n,), as engines return them."""
        return self.solution.trajectory(self._times(t))

    @cached_property
    def events(self) -> tuple[StopOpening | StopImpact | Launch, ...]:
        """Openings of stops, impacts and the launch, in the order of time."""
        events: list[StopOpening | StopImpact | Launch] = []
        for name, time in self.solution.release_times.items():
            if time is not None:
                events.append(StopOpening(time, name))
        for time, impulses in self.solution.impacts:
            events.append(StopImpact(time, dict(impulses)))
        if self.launch is not None:
            events.append(self.launch)
        return tuple(sorted(events, key=lambda event: event.time))

    @property
    def launch(self) -> Launch | None:
        """The projectile let go at 45 degrees, after its own stops have opened; None if never."""
        return self.solution.launch

    def headline(self) -> str:
        """The mechanism, how long it moves, and the number of events."""
        return (
            f"Reference motion of {self.mechanism.name!r}: continuous from 0 to "
            f"{self.duration:.6g} s, {len(self.events)} events"
        )

    def facts(self) -> Iterator[tuple[str, str]]:
        """The coordinates and the events."""
        yield "coordinates", ", ".join(self.mechanism.coordinates)
        for event in self.events:
            if isinstance(event, StopOpening):
                yield f"{event.stop} opens", f"{event.time:.9f} s"
            elif isinstance(event, StopImpact):
                yield f"impact on {' and '.join(event.impulses)}", f"{event.time:.9f} s"
            else:
                yield "launch", f"{event.time:.9f} s at {event.speed:.6g} m/s"

    def _times(self, t: ArrayLike) -> FloatArray:
        times = np.atleast_1d(np.asarray(t, dtype=np.float64))
        if times.ndim > 1 or not np.isfinite(times).all():
            raise InputError("t must be a finite time [s], or times of shape (n,).")
        return times

    def _read(self, t: ArrayLike) -> MotionSamples:
        return self.solution.motion(self._times(t))

    def _marker(self, name: str, t: ArrayLike) -> PointMotion:
        marker = self.mechanism.marker(name)
        if marker is None:
            known = ", ".join(marker.name for marker in self.mechanism.markers) or "none"
            raise InputError(f"{self.mechanism.name!r} has no marker {name!r}; there are: {known}.")
        motion, kinematics = self._read(t), self.solution.equations.kinematics
        position, velocity, _ = kinematics.point_motion(marker, motion.q, motion.u, motion.a)
        return PointMotion(position, velocity)

    @staticmethod
    def _shaped(t: ArrayLike, values: FloatArray) -> FloatArray:
        """Drop the axis of times where a single one was asked for."""
        return values if np.ndim(t) else values[0]
