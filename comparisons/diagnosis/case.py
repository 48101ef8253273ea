"""A trajectory's deviation from the reference as one array, in units of sizes.

Deviations grow towards the launch, and late ones look alike whatever their cause. So all times are
weighted alike: the deviation at a time is divided by its largest value up to then. A suspect's
signature, the effect of one mistake on the reference, is an array of the same kind, fitted to the
deviation by least squares.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...models.arrays import FloatArray, IndexArray
from ...models.errors import TrebucheckError
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.trajectory import PointMotion, Trajectory
from ...reference.equations import Equations
from ...reference.solution import MotionSamples, Solution
from ...reference.solver import solve
from ..runs.metrics import EVENT_GUARD
from ..runs.results import RankedCause
from .rank import Estimate

ENERGIES = ("kinetic energy", "potential energy")
_FAINT = 1e-4  # of the largest: earlier than this, rounding and steps are most of a deviation


def _values(trajectory: Trajectory) -> dict[str, FloatArray]:
    """All that a trajectory tells, by name as a report has it, each of shape (n, n_components)."""
    stops = {
        s.name: s.effort
        for s in trajectory.mechanism.stops
        if s.closed and s.name in trajectory.stop_torques
    }
    return {
        "coordinates": trajectory.q,
        "speeds of coordinates": trajectory.u,
        **{
            f"position of the {name}": marker.position
            for name, marker in trajectory.markers.items()
        },
        **{
            f"velocity of the {name}": marker.velocity
            for name, marker in trajectory.markers.items()
        },
        **{
            f"{effort} of the {name}": trajectory.stop_torques[name][:, None]
            for name, effort in stops.items()
        },
        **{f"force of the {name}": force for name, force in trajectory.joint_reactions.items()},
        "kinetic energy": trajectory.kinetic_energy[:, None],
        "potential energy": trajectory.potential_energy[:, None],
    }


def _sizes(trajectory: Trajectory) -> dict[str, float | FloatArray]:
    """The size of each of them in its own motion."""
    n_angles = len(trajectory.mechanism.angles)
    markers = trajectory.markers.items()
    reach = max((_largest(m.position) for _, m in markers), default=0.0) or 1.0
    speed = (
        max((_largest(m.velocity) for _, m in markers), default=0.0)
        or _largest(trajectory.u)
        or 1.0
    )
    force = max((_largest(f) for f in trajectory.joint_reactions.values()), default=0.0) or 1.0
    energy = _largest(trajectory.kinetic_energy) or 1.0
    is_angle = np.arange(trajectory.q.shape[1]) < n_angles
    rate = _largest(trajectory.u[:, :n_angles]) or 1.0
    return {
        "coordinates": np.where(is_angle, 1.0, reach),
        "speeds of coordinates": np.where(is_angle, rate, speed),
        **{f"position of the {name}": reach for name, _ in markers},
        **{f"velocity of the {name}": speed for name, _ in markers},
        **_stops(trajectory),
        **{f"force of the {name}": force for name in trajectory.joint_reactions},
        "kinetic energy": energy,
        # Of a slow motion it is much the larger: in parts of the kinetic one it would outweigh all
        # else.
        "potential energy": max(energy, _largest(trajectory.potential_energy)),
    }


def _stops(trajectory: Trajectory) -> dict[str, float]:
    """Sizes of the closed stops' torques and forces: the largest of their unit."""
    stops = [
        s for s in trajectory.mechanism.stops if s.closed and s.name in trajectory.stop_torques
    ]
    peak = {s.force_unit: 0.0 for s in stops}
    for stop in stops:
        peak[stop.force_unit] = max(
            peak[stop.force_unit], _largest(trajectory.stop_torques[stop.name])
        )
    return {f"{s.effort} of the {s.name}": peak[s.force_unit] or 1.0 for s in stops}


def _largest(values: FloatArray) -> float:
    return float(np.abs(values).max(initial=0.0))


@dataclass(frozen=True)
class Channels:
    """Quantities of a deviation and their sizes, the same for all compared trajectories."""

    sizes: Mapping[str, float | FloatArray]
    """Size of each quantity in the reference; of an energy that of the larger motion."""
    unusable: Mapping[str, float]
    """Quantities that are not finite, and from which time on [s]."""

    @classmethod
    def of(
        cls, trajectory: Trajectory, reference: Trajectory, told: Container[str] | None = None
    ) -> Channels:
        """Those that both have, at the same times, and of them those that are told."""
        given, right = _values(trajectory), _values(reference)
        given = (
            given if told is None else {name: each for name, each in given.items() if name in told}
        )
        common = [
            name for name in right if name in given and given[name].shape == right[name].shape
        ]
        finite = {name: np.isfinite(given[name]).all(axis=1) for name in common}
        unusable = {
            name: float(trajectory.t[np.argmin(ok)]) for name, ok in finite.items() if not ok.all()
        }
        own, others = _sizes(reference), _sizes(trajectory)
        sizes = {name: own[name] for name in common if name not in unusable}
        # An energy goes with the square of a speed: one that is much too large would outweigh the
        # speeds themselves.
        larger = {name: max(sizes[name], others[name]) for name in ENERGIES if name in sizes}
        sizes |= {name: size for name, size in larger.items() if math.isfinite(size)}
        return cls(sizes, unusable)

    def parts(self, one: Trajectory, other: Trajectory) -> dict[str, FloatArray]:
        """Differences at the same times in units of size, each of shape (n, n_components)."""
        first, second = _values(one), _values(other)
        # A suspect may have lost the stop or the joint: then it carries nothing.
        return {
            name: (first.get(name, 0.0) - second[name]) / size for name, size in self.sizes.items()
        }

    def stacked(self, one: Trajectory, other: Trajectory) -> FloatArray:
        """All parts beside each other, shape (n, n_channels)."""
        return np.concatenate(list(self.parts(one, other).values()), axis=1)


def weights(deviation: FloatArray) -> FloatArray:
    """One over how large the deviation has become by each time, shape (n, 1)."""
    grown = np.maximum.accumulate(np.abs(deviation).max(axis=1))
    return 1.0 / np.maximum(grown, _FAINT * (grown[-1] or 1.0))[:, None]


@dataclass(frozen=True)
class Match:
    """A suspect's signature fitted to a deviation."""

    factor: float
    """Factor of the signature."""
    explained: float
    """1 - |deviation - factor signature| / |deviation|; negative where it makes it worse."""


def match(deviation: FloatArray, signature: FloatArray, fixed: bool = False) -> Match:
    """Fit a signature to a deviation, both flat vectors in units of their size.

    Args:
        deviation, signature: of one shape.
        fixed: the signature counts as it is, its factor is 1.
    """
    size, length = float(np.linalg.norm(deviation)), float(signature @ signature)
    if size == 0.0 or length == 0.0 or not np.isfinite(length):
        return Match(0.0, 0.0)
    factor = 1.0 if fixed else float(signature @ deviation) / length
    left = float(np.linalg.norm(deviation - factor * signature))
    return Match(factor, 1.0 - left / size)


def fit(deviation: FloatArray, signatures: FloatArray) -> tuple[FloatArray, float]:
    """Fit several signatures at once by least squares: factors, and the share they explain.

    Args:
        deviation: shape (m,).
        signatures: shape (n, m).
    """
    size, lengths = float(np.linalg.norm(deviation)), np.linalg.norm(signatures, axis=1)
    if size == 0.0 or not lengths.all() or not np.isfinite(lengths).all():
        return np.zeros(len(signatures)), 0.0
    factors = (
        np.linalg.lstsq((signatures / lengths[:, None]).T, deviation, rcond=1e-10)[0] / lengths
    )
    return factors, 1.0 - float(np.linalg.norm(deviation - factors @ signatures)) / size


def thinned(trajectory: Trajectory, keep: IndexArray) -> Trajectory:
    """The trajectory at some of its samples only."""
    return replace(
        trajectory,
        t=trajectory.t[keep],
        q=trajectory.q[keep],
        u=trajectory.u[keep],
        markers={
            n: PointMotion(m.position[keep], m.velocity[keep])
            for n, m in trajectory.markers.items()
        },
        kinetic_energy=trajectory.kinetic_energy[keep],
        potential_energy=trajectory.potential_energy[keep],
        stop_torques={n: torque[keep] for n, torque in trajectory.stop_torques.items()},
        joint_reactions={n: force[keep] for n, force in trajectory.joint_reactions.items()},
        joint_gaps={n: gap[keep] for n, gap in trajectory.joint_gaps.items()},
    )


_SAMPLES = 300  # of the compared motion: enough to tell suspects apart
_FEWEST = 3
_ROUNDING = 1e-10  # of the forces of gravity
_ROUGH_MARGIN = 10  # a fault's motion may be so many times as sensitive as the reference's
_ROUGH_ENOUGH = 0.01  # error of a share up to which a rough one is of use
_REFERENCE_STEPS = 100  # at least, as a measure of what a motion with a fault may cost
FINE = 1e-11
"""Tolerance of the suspects' motions."""
ROUGH = 1e-6
"""Tolerance at which suspects are tried that are probably not worth more."""

PATIENCE = 20


"""Steps of a motion with a fault, in parts of the reference's, which takes twice as many."""


@dataclass(frozen=True)
class Case:
    """A trajectory's deviation, thinned and weighted, and the signatures of other trajectories."""

    whole: Trajectory
    solution: Solution
    end: float
    broken: frozenset[str] = frozenset()
    """Names of the metrics that violate their tolerances."""
    told: frozenset[str] | None = None
    """Quantities that the trajectory records, where others only stand in; None: all of them."""

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism as the reference moves it."""
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
        """Coordinates or speeds of another shape than the mechanism's, and their shape."""
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
        """The recorded trajectory at some of its times."""
        chosen = self._away[np.unique(np.linspace(0, len(self._away) - 1, _SAMPLES).astype(int))]
        return thinned(self.whole, chosen)

    @property
    def _away(self) -> IndexArray:
        """Compared samples that are not beside an event of either; all if few are left."""
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
    def motion(self) -> MotionSamples:
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
        """Quantities that are compared."""
        return Channels.of(self.trajectory, self.reference, self.told)

    @cached_property
    def weights(self) -> FloatArray:
        """Weight of each time, shape (n, 1)."""
        return weights(self.channels.stacked(self.trajectory, self.reference))

    @cached_property
    def deviation(self) -> FloatArray:
        """The deviation to be explained, flat."""
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
        """Signature of a trajectory at the same times, flat."""
        return (self.weights * self.channels.stacked(wrong, self.reference)).ravel()

    @property
    def step(self) -> float:
        """The engine's [s]."""
        return float(np.median(np.diff(self.whole.t)))

    def carried(self, other: Trajectory) -> FloatArray:
        """Signature of a trajectory at other times, interpolated between its nearest samples."""
        after = np.minimum(np.searchsorted(other.t, self.t), len(other.t) - 1)
        near = thinned(other, np.unique([np.maximum(after - 1, 0), after]))
        difference = self.channels.stacked(near, self.solution.trajectory(near.t))
        columns = [np.interp(self.t, near.t, column) for column in difference.T]
        return (self.weights * np.stack(columns, axis=1)).ravel()

    def problem(self, mechanism: Mechanism) -> Problem:
        """Problem of a mechanism, solved as far as is compared."""
        law = StopLaw(self.solution.problem.stop_law)
        return Problem(mechanism, duration=float(self.t[-1]), stop_law=law)

    def solved(
        self, equations: Equations, patience: int = PATIENCE, tolerance: float = FINE
    ) -> Solution | None:
        """The motion under other equations; None if it cannot be computed.

        Args:
            patience: it is given up after so many times the reference's steps: equations that are
                so stiff are far from any that fit.
            tolerance: relative and absolute, of a step.
        """
        try:
            with np.errstate(all="ignore"):
                most = patience * self._reference_steps
                problem = self.problem(equations.mechanism)
                return solve(problem, tolerance, tolerance, equations, most)
        except (TrebucheckError, np.linalg.LinAlgError, ValueError):
            return None

    @cached_property
    def rough_error(self) -> float | None:
        """Error of a share of the deviation that is computed at `ROUGH`; None if it is of no use.

        The reference itself, solved so, tells it: small deviations are beyond such a tolerance, and
        so are motions that carry errors on.
        """
        size = float(np.linalg.norm(self.deviation))
        rough = self.solved(self.solution.equations, tolerance=ROUGH)
        if rough is None or size == 0.0:
            return None
        signature = self.signature(rough.trajectory(self.t))
        error = _ROUGH_MARGIN * float(np.linalg.norm(signature)) / size
        return error if error <= _ROUGH_ENOUGH else None

    @cached_property
    def _reference_steps(self) -> int:
        return max(
            _REFERENCE_STEPS, sum(len(segment.interpolant.ts) for segment in self.solution.segments)
        )

    def under(self, law: StopLaw, tolerance: float = FINE) -> Solution | None:
        """The motion under the other law of the stops; None if it cannot be computed."""
        problem = Problem(self.mechanism, duration=float(self.t[-1]), stop_law=law)
        try:
            return solve(problem, tolerance, tolerance)
        except (TrebucheckError, np.linalg.LinAlgError, ValueError):
            return None

    def seen(self, wrong: Solution, motion: MotionSamples) -> tuple[FloatArray, FloatArray]:
        """Signatures of a faulty motion, read by an engine with the fault, and by others.

        An engine with a wrong body computes markers and energies by that; an adapter that gets
        coordinates from the engine computes them from the right description.
        """
        told = self.reference.provenance
        own = wrong.reading(self.t, motion, told)
        right = self.solution.reading(self.t, replace(self.motion, q=motion.q, u=motion.u), told)
        mixed = replace(right, stop_torques=own.stop_torques, joint_reactions=own.joint_reactions)
        return self.signature(own), self.signature(mixed)


def estimate(
    cause: RankedCause, share: Callable[[bool], float | None], error: float | None
) -> RankedCause | Estimate:
    """A cause by its rough share where that is of use, else by its accurate one.

    Args:
        cause: without its share.
        share: computes it, roughly if its argument is true; None where no motion can be solved.
        error: of a rough share; None where it is of no use.
    """

    def accurate() -> RankedCause:
        return cause.model_copy(update={"explained": share(False) or 0.0})

    rough = None if error is None else share(True)
    if rough is None or error is None:
        return accurate()
    return Estimate(cause.model_copy(update={"explained": rough}), error, accurate)
