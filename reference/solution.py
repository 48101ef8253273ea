"""A continuous reference motion, from which states, forces and energies are read at any times."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
from scipy.integrate import OdeSolution

from ..models.applied_forces import AppliedForces
from ..models.arrays import FloatArray, IndexArray, as_vectors
from ..models.errors import InputError
from ..models.functions import PointCoefficients, weighted
from ..models.launch import LAUNCH_ANGLE, Launch, SmoothVelocity, first_launch, rest_opened
from ..models.problem import Problem
from ..models.shown import Shown
from ..models.trajectory import PointMotion, Provenance, Trajectory
from ..version import __version__
from .equations import Equations
from .integrator import numerical, refuse_infinite
from .reactions import joint_reactions, undetermined_forces
from .singular import SingularPassage, Window


@dataclass(frozen=True)
class Segment:
    """The motion between two events, under one active set of stops."""

    equations: Equations
    closed: tuple[str, ...]
    start: float
    end: float
    interpolant: OdeSolution
    windows: tuple[Window, ...] = ()
    """Across singular positions; the interpolant holds their motion, too."""

    def forces(self, t: FloatArray, q: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Accelerations and multipliers of the segment's states (n, n_q) at times t [s].

        Across singular positions, in which the equations of motion are 0/0, they are read from the
        window.
        """
        equations = self.equations
        a, multipliers = np.empty_like(q), np.empty((len(t), equations.n_loops + len(self.closed)))
        regular = np.ones(len(t), dtype=bool)
        for window in self.windows:
            inside = (t >= window.start) & (t <= window.end)
            a[inside] = window.accelerations(t[inside])
            multipliers[inside] = window.multipliers(t[inside])
            regular &= ~inside
        if regular.any():
            a[regular], multipliers[regular] = equations.solve(q[regular], u[regular], self.closed)
        return a, multipliers


@dataclass(frozen=True)
class MotionSamples:
    """States, accelerations and multipliers at given times."""

    q: FloatArray
    u: FloatArray
    a: FloatArray
    loop_multipliers: FloatArray
    stop_torques: Mapping[str, FloatArray]
    t: FloatArray
    """Of each state [s], shape (n,)."""


@dataclass(frozen=True, repr=False)
class Solution(Shown):
    """The reference motion of a problem, continuous in time."""

    problem: Problem
    equations: Equations
    """The mechanism's; those of a segment may have other forces, if some were recorded."""
    segments: tuple[Segment, ...]
    release_times: Mapping[str, float | None]
    impacts: tuple[tuple[float, dict[str, float]], ...]
    """Time [s] and impulses [N m s] of every impact."""
    evaluations: int
    settings: Mapping[str, object]
    wall_time: float
    rest_times: Mapping[str, tuple[float, ...]] = field(
        default_factory=dict[str, tuple[float, ...]]
    )
    """By stop, when it ceased to bounce, or was met without rebound, and stayed closed [s]."""
    _launches: dict[tuple[float, str], Launch | None] = field(
        default_factory=dict[tuple[float, str], "Launch | None"], init=False, compare=False
    )  # found so far: each run is compared with them

    def headline(self) -> str:
        """The mechanism, the end of the motion and the number of segments."""
        name, end = self.problem.mechanism.name, self.segments[-1].end
        n = len(self.segments)
        return f"Solution of {name!r}: continuous from 0 to {end:.6g} s in {n} segments"

    def facts(self) -> Iterator[tuple[str, str]]:
        """Its events."""
        for name, time in self.release_times.items():
            if self.problem.mechanism.stop(name).closed:
                yield f"{name} opens", "not" if time is None else f"{time:.9f} s"
        yield "impacts", str(len(self.impacts))

    def by_other_equations(self, problem: Problem, equations: Equations) -> Self:
        """The same motion, whose forces and accelerations are read by other equations."""
        segments = tuple(replace(segment, equations=equations) for segment in self.segments)
        return replace(self, problem=problem, equations=equations, segments=segments)

    def motion(self, t: FloatArray) -> MotionSamples:
        """Compute everything at times t [s], shape (n,); at an event, the state after it.

        Raises:
            InputError: a time lies outside the solution.
            SimulationError: a force is not finite.
        """
        end = self.segments[-1].end
        if len(t) and (t.min() < 0 or t.max() > end):
            raise InputError(
                f"the reference covers 0 to {end:.6g} s; {t.min():.6g} to {t.max():.6g} s was "
                "asked for."
            )
        n_q = len(self.problem.mechanism.coordinates)
        q, u = (np.empty((len(t), n_q)) for _ in range(2))
        for segment, indices in self._by_segment(t):
            y = np.asarray(segment.interpolant(t[indices])).T
            q[indices], u[indices] = y[:, :n_q], y[:, n_q:]
        return self._samples(t, q, u, exactly=True)

    def _by_segment(self, t: FloatArray) -> Iterator[tuple[Segment, IndexArray]]:
        of = np.searchsorted([segment.end for segment in self.segments[:-1]], t, side="right")
        for k, segment in enumerate(self.segments):
            indices = np.flatnonzero(of == k)
            if len(indices):
                yield segment, indices

    def motion_of(self, t: FloatArray, q: FloatArray, u: FloatArray) -> MotionSamples:
        """Accelerations and multipliers of other states, under the active stops at times t [s].

        Args:
            t: shape (n,).
            q, u: states, shape (n, n_q).
        """
        return self._samples(t, q, u, exactly=False)

    def _samples(
        self, t: FloatArray, q: FloatArray, u: FloatArray, *, exactly: bool
    ) -> MotionSamples:
        """Accelerations and multipliers; `exactly`: of the motion itself, by its windows, too."""
        n_loops = self.equations.n_loops
        a, loops = np.empty_like(q), np.empty((len(t), n_loops))
        torques = {stop.name: np.zeros(len(t)) for stop in self.problem.mechanism.stops}
        with numerical("with the forces of its motion"):
            for segment, i in self._by_segment(t):
                if exactly:
                    a[i], multipliers = segment.forces(t[i], q[i], u[i])
                else:
                    a[i], multipliers = segment.equations.solve(q[i], u[i], segment.closed)
                loops[i] = multipliers[:, :n_loops]
                for name, torque in zip(segment.closed, multipliers[:, n_loops:].T, strict=True):
                    torques[name][i] = torque
        refuse_infinite("accelerations", a)
        refuse_infinite("forces of joints and stops", loops, *torques.values())
        return MotionSamples(q, u, a, loops, torques, t)

    def joint_reactions(self, motion: MotionSamples) -> dict[str, FloatArray]:
        """Force on each joint's child [N], world frame, shape (n, 2), by Newton's law."""
        mechanism, kinematics = self.problem.mechanism, self.equations.kinematics
        gravity = np.array(mechanism.gravity_vector)
        second = kinematics.second_flow(motion.q, motion.u, motion.a)
        applied = {body.name: np.zeros((len(motion.t), 2)) for body in mechanism.bodies}
        for segment, i in self._by_segment(motion.t):
            acting = segment.equations.applied_on_bodies(motion.q[i], motion.u[i])
            for body, force in acting.items():
                applied[body][i] = force
        inertial = AppliedForces(kinematics).inertial_on_bodies(motion.q, motion.a)
        for body, force in inertial.items():
            applied[body] += force
        needed = dict[str, FloatArray]()
        for body in mechanism.bodies:
            centre = kinematics.point(body.name, body.centre)
            acceleration = as_vectors(weighted(second, centre.coefficients))
            needed[body.name] = body.mass * (acceleration - gravity) - applied[body.name]
        return joint_reactions(
            kinematics, motion.q, needed, motion.loop_multipliers, motion.stop_torques
        )

    @property
    def singular_passages(self) -> tuple[SingularPassage, ...]:
        """Singular positions on the way, in order of time; joint forces have poles there."""
        passages: list[SingularPassage] = []
        for segment in self.segments:
            for window in segment.windows:
                passages += window.passages
        return tuple(passages)

    @property
    def undetermined_joints(self) -> tuple[str, ...]:
        """Joints whose forces are not unique; those given have least norm."""
        return self._undetermined[0]

    @property
    def undetermined_stops(self) -> tuple[str, ...]:
        """Stops whose torques are not unique, as :attr:`undetermined_joints`."""
        return self._undetermined[1]

    @cached_property
    def _undetermined(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        joints: dict[str, None] = {}
        stops: dict[str, None] = {}
        n_q = len(self.problem.mechanism.coordinates)
        for segment in self.segments:
            middle = np.asarray(segment.interpolant((segment.start + segment.end) / 2))
            names = undetermined_forces(segment.equations, middle[:n_q], segment.closed)
            joints |= dict.fromkeys(names[0])
            stops |= dict.fromkeys(names[1])
        return tuple(joints), tuple(stops)

    @cached_property
    def launch(self) -> Launch | None:
        """The projectile's launch at 45 degrees, after its stop has opened; None if never."""
        return self.launch_at(LAUNCH_ANGLE)

    def launch_at(self, angle: float, marker: str = "projectile") -> Launch | None:
        """First fall of a marker's velocity to `angle` [rad] after its body's stops have opened.

        Found on the integrator's own steps (:func:`...models.launch.first_launch`), and so the same
        in every solution that is long enough. At an impact that turns the velocity through the
        direction, the velocity is the one between those before and after it.
        """
        if (angle, marker) not in self._launches:
            self._launches[angle, marker] = self._first_launch(angle, marker)
        return self._launches[angle, marker]

    def _first_launch(self, angle: float, marker: str) -> Launch | None:
        mechanism, kinematics = self.problem.mechanism, self.equations.kinematics
        point = mechanism.marker(marker)
        if point is None:
            return None
        after = rest_opened(mechanism, point.body, self.release_times)
        if after is None:
            return None
        row = kinematics.point(point.body, point.point)
        rests = {s.name for s in mechanism.stops if s.body == point.body and s.closed}
        pieces = self._free_pieces(row, after, rests)
        return first_launch(pieces, angle, kinematics.speed_scale(row))

    def _free_pieces(
        self, row: PointCoefficients, after: float, rests: set[str]
    ) -> Iterator[SmoothVelocity | None]:
        """A point's velocity after a time [s], by segment; None where one of these stops acts."""
        strikes: set[float] = set()
        for time, impulses in self.impacts:
            if any(impulses.get(name, 0.0) > 0 for name in rests):
                strikes.add(time)
        for segment in self.segments:
            if segment.end <= after:
                continue
            if rests.intersection(segment.closed) or segment.start in strikes:
                yield None
            if rests.intersection(segment.closed):
                continue

            def at(t: FloatArray, segment: Segment = segment) -> FloatArray:
                q, u = np.split(np.asarray(segment.interpolant(t)).T, 2, axis=1)
                return self.equations.kinematics.velocity(row, q, u)

            knots = np.unique(np.asarray(segment.interpolant.ts, dtype=np.float64))
            start = max(after, segment.start)
            yield SmoothVelocity(np.concatenate([[start], knots[knots > start]]), at)

    def trajectory(self, t: FloatArray, provenance: Provenance | None = None) -> Trajectory:
        """The motion at the given times [s], shape (n,), with all that a trajectory holds."""
        return self.reading(t, self.motion(t), provenance)

    def reading(
        self, t: FloatArray, motion: MotionSamples, provenance: Provenance | None = None
    ) -> Trajectory:
        """Read everything that a trajectory holds, of a motion at the times t [s], shape (n,)."""
        mechanism, kinematics = self.problem.mechanism, self.equations.kinematics
        provenance = provenance or Provenance(
            engine="reference",
            engine_version=__version__,
            preset="assisted",
            settings=dict(self.settings),
            mechanism_hash=mechanism.content_hash,
            duration=self.problem.duration,
            stop_law=self.problem.stop_law.value,
            steps=self.evaluations,
            wall_time=self.wall_time,
        )
        markers: dict[str, PointMotion] = {}
        with numerical("with the figures of its motion"):
            phasors = kinematics.phasors(motion.q)
            flow = kinematics.flow(motion.q, motion.u, kinematics.rates(motion.q))
            for marker in mechanism.markers:
                row = kinematics.point(marker.body, marker.point)
                position = as_vectors(row.offset + weighted(phasors, row.coefficients))
                velocity = as_vectors(weighted(flow, row.coefficients))
                markers[marker.name] = PointMotion(position, velocity)
            kinetic = kinematics.kinetic_energy(motion.q, motion.u)
            potential = self.equations.potential_energy(motion.q)
            reactions = self.joint_reactions(motion)
        refuse_infinite("energies", kinetic, potential)
        refuse_infinite("joint reactions", *reactions.values())
        for point in markers.values():
            refuse_infinite("markers", point.position, point.velocity)
        return Trajectory(
            mechanism=mechanism,
            t=t,
            q=motion.q,
            u=motion.u,
            markers=markers,
            kinetic_energy=kinetic,
            potential_energy=potential,
            stop_torques=motion.stop_torques,
            release_times=self.release_times,
            joint_reactions=reactions,
            provenance=provenance,
            impacts=self.impacts,
        )
