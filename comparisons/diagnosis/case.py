"""One deviation to be explained: a trajectory beside the reference, and the signatures of other motions beside both."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...models.arrays import FloatArray, IndexArray
from ...models.errors import TrebucheckError
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.trajectory import Trajectory
from ...reference.equations import Equations
from ...reference.solution import Motion, Solution
from ...reference.solver import solve
from ..runs.comparison import EVENT_GUARD
from .signatures import Channels, thinned, weights

_SAMPLES = 300  # of the compared motion: enough to tell suspects apart
_FEWEST = 3
_ROUNDING = 1e-10  # of the forces of gravity
_TOLERANCE = 1e-11  # of the suspects' motions
_REFERENCE_STEPS = 100  # at least, as a measure of what a motion with a fault may cost

PATIENCE = 20
"""Steps of a motion with a fault, in parts of the reference's (whose tolerance is finer: it takes twice as many)."""


@dataclass(frozen=True)
class Case:
    """A trajectory's deviation, thinned and weighted, and the signatures of other trajectories."""

    whole: Trajectory
    solution: Solution
    end: float
    broken: frozenset[str] = frozenset()
    """Names of the metrics that violate their tolerances."""
    told: frozenset[str] | None = None
    """Quantities that the trajectory tells, where others in it stand in for what nobody has told; None: all of them."""

    @property
    def mechanism(self) -> Mechanism:
        """As the reference moves it."""
        return self.solution.problem.mechanism

    @property
    def compared(self) -> int:
        """How many samples of the trajectory are compared."""
        return int(np.searchsorted(self.whole.t, self.end, side="right"))

    @property
    def can_be_read(self) -> bool:
        """Whether there are samples enough."""
        return self.compared > _FEWEST and not self.misshapen

    @property
    def misshapen(self) -> dict[str, str]:
        """Coordinates or speeds that are not of the mechanism's shape, and what they are instead."""
        right = (len(self.whole.t), len(self.mechanism.coordinates))
        given = {"coordinates": self.whole.q.shape, "speeds of coordinates": self.whole.u.shape}
        return {
            name: f"{shape} instead of {right}" for name, shape in given.items() if shape != right
        }

    @property
    def missing_markers(self) -> tuple[str, ...]:
        """Markers of the mechanism that the trajectory does not have."""
        return tuple(
            marker.name
            for marker in self.mechanism.markers
            if marker.name not in self.whole.markers
        )

    @cached_property
    def trajectory(self) -> Trajectory:
        """As given, at some of its times."""
        chosen = self._away[np.unique(np.linspace(0, len(self._away) - 1, _SAMPLES).astype(int))]
        return thinned(self.whole, chosen)

    @property
    def _away(self) -> IndexArray:
        """Compared samples that are not beside an event of either, where speeds or forces jump; all if few are left."""
        every = np.arange(
            1, self.compared
        )  # without the start: an engine that records its states late starts there
        motions = self.solution, self.whole
        impacts = [time for motion in motions for time, _ in motion.impacts]
        releases = [
            time for motion in motions for time in motion.release_times.values() if time is not None
        ]
        t, guard = self.whole.t[every], EVENT_GUARD * self.step
        beside = np.zeros(len(t), dtype=bool)
        for time in (*impacts, *releases):
            beside |= np.abs(t - time) <= guard
        return every[~beside] if (~beside).sum() > _FEWEST else every

    @property
    def t(self) -> FloatArray:
        """Times at which it is compared [s]."""
        return self.trajectory.t

    @cached_property
    def motion(self) -> Motion:
        """The reference's, at these times."""
        return self.solution.motion(self.t)

    @cached_property
    def reference(self) -> Trajectory:
        """The reference's trajectory at these times."""
        return self.solution.reading(self.t, self.motion)

    @property
    def has_impacts(self) -> bool:
        """Whether the reference's motion has impacts in the compared time."""
        return any(time <= self.t[-1] for time, _ in self.solution.impacts)

    @property
    def has_velocity_forces(self) -> bool:
        """Whether centrifugal forces are more than rounding in it: a single pendulum has none."""
        equations, q = self.solution.equations, self.motion.q
        bias = np.abs(equations.bias(q, self.motion.u)).max()
        return bool(bias > _ROUNDING * np.abs(equations.gravity_forces(q)).max())

    @cached_property
    def channels(self) -> Channels:
        """What is compared."""
        return Channels.of(self.trajectory, self.reference, self.told)

    @cached_property
    def weights(self) -> FloatArray:
        """Of each time, shape (n, 1)."""
        return weights(self.channels.stacked(self.trajectory, self.reference))

    @cached_property
    def deviation(self) -> FloatArray:
        """To be explained, flat."""
        return self.signature(self.trajectory)

    @cached_property
    def shares(self) -> dict[str, float]:
        """Size of the deviation of each quantity, in parts of the whole."""
        parts = self.channels.parts(self.trajectory, self.reference)
        size = float(np.linalg.norm(self.deviation)) or 1.0
        return {
            name: float(np.linalg.norm(self.weights * part)) / size for name, part in parts.items()
        }

    @cached_property
    def first_errors(self) -> dict[str, float]:
        """Largest deviation of each quantity at t = 0, in units of its size."""
        first = thinned(self.whole, np.zeros(1, dtype=int))
        parts = self.channels.parts(first, self.solution.trajectory(first.t))
        return {name: float(np.abs(part).max(initial=0.0)) for name, part in parts.items()}

    def signature(self, wrong: Trajectory) -> FloatArray:
        """Of a trajectory at the same times, flat."""
        return (self.weights * self.channels.stacked(wrong, self.reference)).ravel()

    @property
    def step(self) -> float:
        """The engine's [s]."""
        return float(np.median(np.diff(self.whole.t)))

    def carried(self, other: Trajectory) -> FloatArray:
        """Signature of a trajectory at other times, interpolated between those of its samples that are next to ours."""
        after = np.minimum(np.searchsorted(other.t, self.t), len(other.t) - 1)
        near = thinned(other, np.unique([np.maximum(after - 1, 0), after]))
        difference = self.channels.stacked(near, self.solution.trajectory(near.t))
        columns = [np.interp(self.t, near.t, column) for column in difference.T]
        return (self.weights * np.stack(columns, axis=1)).ravel()

    def problem(self, mechanism: Mechanism) -> Problem:
        """To be solved as far as is compared."""
        law = StopLaw(self.solution.problem.stop_law)
        return Problem(mechanism, duration=float(self.t[-1]), stop_law=law)

    def solved(self, equations: Equations, patience: int = PATIENCE) -> Solution | None:
        """The motion under other equations; None if it cannot be computed.

        Args:
            patience: it is given up after so many times the reference's steps: equations that are
                so stiff are far from any that fit.
        """
        try:
            with np.errstate(all="ignore"):
                most = patience * self._reference_steps
                return solve(
                    self.problem(equations.mechanism), _TOLERANCE, _TOLERANCE, equations, most
                )
        except (TrebucheckError, np.linalg.LinAlgError, ValueError):
            return None

    @cached_property
    def _reference_steps(self) -> int:
        return max(
            _REFERENCE_STEPS, sum(len(segment.interpolant.ts) for segment in self.solution.segments)
        )

    def under(self, law: StopLaw) -> Solution | None:
        """The motion under the other law of the stops; None if it cannot be computed."""
        problem = Problem(self.mechanism, duration=float(self.t[-1]), stop_law=law)
        try:
            return solve(problem, _TOLERANCE, _TOLERANCE)
        except (TrebucheckError, np.linalg.LinAlgError, ValueError):
            return None

    def seen(self, wrong: Solution, motion: Motion) -> tuple[FloatArray, FloatArray]:
        """Signatures of a faulty motion, as an engine reads it that believes in the fault, and as others do.

        An engine with a wrong body computes markers and energies by that; an adapter that gets
        coordinates from the engine computes them from the right description.
        """
        told = self.reference.provenance
        own = wrong.reading(self.t, motion, told)
        right = self.solution.reading(self.t, replace(self.motion, q=motion.q, u=motion.u), told)
        mixed = replace(right, stop_torques=own.stop_torques, joint_reactions=own.joint_reactions)
        return self.signature(own), self.signature(mixed)
