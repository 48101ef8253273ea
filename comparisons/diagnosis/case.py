"""A trajectory's deviation from the reference as one array, in units of sizes.

Deviations grow towards the launch, and late ones look alike whatever their cause. So all times are
weighted alike: the deviation at a time is divided by its largest value up to then. A suspect's
signature, the effect of one mistake on the reference, is an array of the same kind, fitted to the
deviation by least squares.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from ...models.arrays import FloatArray, IndexArray
from ...models.errors import TrebucheckError
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.trajectory import PointMotion, Trajectory
from ...reference.equations import Equations
from ...reference.integrator import MOST_STEPS
from ...reference.solution import MotionSamples, Solution
from ...reference.solver import solve
from ..runs.metrics import EVENT_GUARD
from ..runs.quantities import Kind, Quantity
from ..runs.results import RankedCause
from .rank import Estimate

ENERGIES = (Kind.KINETIC_ENERGY.value, Kind.POTENTIAL_ENERGY.value)
_FAINT = 1e-4  # of the largest: earlier than this, rounding and steps are most of a deviation
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


def _values(trajectory: Trajectory) -> dict[Quantity, FloatArray]:
    """Values that a trajectory tells, each of shape (n, n_components)."""
    values = {Quantity(Kind.COORDINATES): trajectory.q, Quantity(Kind.SPEEDS): trajectory.u}
    for name, marker in trajectory.markers.items():
        values[Quantity(Kind.POSITION, name)] = marker.position
    for name, marker in trajectory.markers.items():
        values[Quantity(Kind.VELOCITY, name)] = marker.velocity
    for stop in trajectory.mechanism.stops:
        if stop.closed and stop.name in trajectory.stop_torques:
            effort = trajectory.stop_torques[stop.name]
            values[Quantity(Kind(stop.effort), stop.name)] = effort[:, None]
    for name, force in trajectory.joint_reactions.items():
        values[Quantity(Kind.FORCE, name)] = force
    values[Quantity(Kind.KINETIC_ENERGY)] = trajectory.kinetic_energy[:, None]
    values[Quantity(Kind.POTENTIAL_ENERGY)] = trajectory.potential_energy[:, None]
    return values


def _sizes(trajectory: Trajectory) -> dict[Quantity, float | FloatArray]:
    """Size of each of them in its own motion."""
    values, n_angles = _values(trajectory), len(trajectory.mechanism.angles)

    def largest(kind: Kind, subjects: Container[str | None]) -> float:
        chosen = [v for (k, subject), v in values.items() if k == kind and subject in subjects]
        return max(map(_largest, chosen), default=0.0)

    reach = largest(Kind.POSITION, trajectory.markers) or 1.0
    speed = largest(Kind.VELOCITY, trajectory.markers) or _largest(trajectory.u) or 1.0
    rate = _largest(trajectory.u[:, :n_angles]) or 1.0
    energy = _largest(trajectory.kinetic_energy) or 1.0
    is_angle = np.arange(trajectory.q.shape[1]) < n_angles
    by_kind: dict[Kind, float | FloatArray] = {
        Kind.COORDINATES: np.where(is_angle, 1.0, reach),
        Kind.SPEEDS: np.where(is_angle, rate, speed),
        Kind.POSITION: reach,
        Kind.VELOCITY: speed,
        Kind.FORCE: largest(Kind.FORCE, trajectory.joint_reactions) or 1.0,
        Kind.KINETIC_ENERGY: energy,
        # The potential energy of a slow motion is much the larger one: in parts of the kinetic
        # energy it would outweigh all else.
        Kind.POTENTIAL_ENERGY: max(energy, _largest(trajectory.potential_energy)),
    }
    sizes: dict[Quantity, float | FloatArray] = {}
    for kind, subject in values:
        if kind in (Kind.TORQUE, Kind.FORCE) and subject in trajectory.stop_torques:
            # A stop's: the largest of any stop that pushes with the same kind.
            sizes[Quantity(kind, subject)] = largest(kind, trajectory.stop_torques) or 1.0
        else:
            sizes[Quantity(kind, subject)] = by_kind[kind]
    return sizes


def _largest(values: FloatArray) -> float:
    return float(np.abs(values).max(initial=0.0))


@dataclass(frozen=True)
class Channels:
    """Quantities of a deviation and their sizes, the same for all compared trajectories."""

    sizes: Mapping[Quantity, float | FloatArray]
    """Size of each quantity in the reference; of an energy that of the larger motion."""
    widths: Mapping[Quantity, int]
    """Number of components of each quantity."""
    unusable: Mapping[Quantity, float]
    """Quantities that are not finite, and from which time on [s]."""

    @classmethod
    def of(
        cls, trajectory: Trajectory, reference: Trajectory, told: Container[str] | None = None
    ) -> Channels:
        """Select the quantities that both have and that are told, at the same times."""
        recorded, right = _values(trajectory), _sizes(reference)
        sizes: dict[Quantity, float | FloatArray] = {}
        widths: dict[Quantity, int] = {}
        unusable: dict[Quantity, float] = {}
        for quantity, values in _values(reference).items():
            if quantity not in recorded or not (told is None or quantity.text in told):
                continue
            if recorded[quantity].shape != values.shape:
                continue
            finite = np.isfinite(recorded[quantity]).all(axis=1)
            if finite.all():
                sizes[quantity], widths[quantity] = right[quantity], values.shape[1]
            else:
                unusable[quantity] = float(trajectory.t[np.argmin(finite)])
        # An energy goes with the square of a speed: one that is much too large would outweigh the
        # speeds themselves.
        others = _sizes(trajectory)
        for energy in (Quantity(Kind.KINETIC_ENERGY), Quantity(Kind.POTENTIAL_ENERGY)):
            if energy in sizes and np.isfinite(others[energy]):
                sizes[energy] = np.maximum(sizes[energy], others[energy])
        return cls(sizes, widths, unusable)

    @cached_property
    def _columns(self) -> dict[Quantity, slice]:
        """Columns of each quantity."""
        ends = np.cumsum([0, *self.widths.values()]).tolist()
        return dict(zip(self.widths, map(slice, ends, ends[1:]), strict=False))

    @cached_property
    def _scale(self) -> FloatArray:
        """Size of each column."""
        sizes = [np.broadcast_to(size, self.widths[name]) for name, size in self.sizes.items()]
        return np.concatenate(sizes)

    def stacked(self, trajectory: Trajectory) -> FloatArray:
        """Quantities beside each other, shape (n, n_channels)."""
        stacked = np.zeros((len(trajectory.t), len(self._scale)))
        values = _values(trajectory)
        for quantity, columns in self._columns.items():
            # A suspect may have lost the stop or the joint: then it carries nothing.
            if quantity in values:
                stacked[:, columns] = values[quantity]
        return stacked

    def differences(self, one: FloatArray, other: FloatArray) -> FloatArray:
        """Differences of two stacked motions at the same times, in units of size."""
        return (one - other) / self._scale

    def parts(self, stacked: FloatArray) -> dict[Quantity, FloatArray]:
        """Columns of each quantity."""
        return {quantity: stacked[:, columns] for quantity, columns in self._columns.items()}


def share_of(deviation: FloatArray, signature: FloatArray) -> float:
    """Share of a deviation that a signature explains; negative where it makes it worse.

    1 - |deviation - signature| / |deviation|, both flat vectors in units of their size.
    """
    size, length = float(np.linalg.norm(deviation)), float(signature @ signature)
    if size == 0.0 or length == 0.0 or not np.isfinite(length):
        return 0.0
    return 1.0 - float(np.linalg.norm(deviation - signature)) / size


def factor_of(deviation: FloatArray, signature: FloatArray) -> float:
    """The factor with which a signature fits a deviation best."""
    length = float(signature @ signature)
    if length == 0.0 or not np.isfinite(length):
        return 0.0
    return float(signature @ deviation) / length


def fit(deviation: FloatArray, signatures: FloatArray) -> tuple[FloatArray, float]:
    """Fit several signatures at once by least squares: factors, and the share they explain.

    Args:
        deviation: shape (m,).
        signatures: shape (n, m).
    """
    size, lengths = float(np.linalg.norm(deviation)), np.linalg.norm(signatures, axis=1)
    if size == 0.0 or not lengths.all() or not np.isfinite(lengths).all():
        return np.zeros(len(signatures)), 0.0
    unit = (signatures / lengths[:, None]).T
    factors = np.linalg.lstsq(unit, deviation, rcond=1e-10)[0] / lengths
    return factors, 1.0 - float(np.linalg.norm(deviation - factors @ signatures)) / size


def thinned(trajectory: Trajectory, keep: IndexArray) -> Trajectory:
    """The trajectory at some of its samples only."""

    def kept(values: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        return {name: array[keep] for name, array in values.items()}

    return replace(
        trajectory,
        t=trajectory.t[keep],
        q=trajectory.q[keep],
        u=trajectory.u[keep],
        markers={
            name: PointMotion(marker.position[keep], marker.velocity[keep])
            for name, marker in trajectory.markers.items()
        },
        kinetic_energy=trajectory.kinetic_energy[keep],
        potential_energy=trajectory.potential_energy[keep],
        stop_torques=kept(trajectory.stop_torques),
        joint_reactions=kept(trajectory.joint_reactions),
        joint_gaps=kept(trajectory.joint_gaps),
    )


def _solution(
    problem: Problem, equations: Equations | None, tolerance: float, most_steps: int = MOST_STEPS
) -> Solution | None:
    """A motion; None if it cannot be computed."""
    try:
        with np.errstate(all="ignore"):
            return solve(problem, tolerance, tolerance, equations, most_steps)
    except (TrebucheckError, np.linalg.LinAlgError, ValueError):
        return None


_kept_solution: Callable[..., Solution | None] = lru_cache(maxsize=128)(_solution)
"""The same, kept for the next run on the mechanism; equations count as the same object only."""


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
    def can_be_read(self) -> bool:
        """Tell whether there are samples enough."""
        return self._compared > _FEWEST and not self.misshapen

    @property
    def _compared(self) -> int:
        """Tell how many samples of the trajectory are compared."""
        return int(np.searchsorted(self.whole.t, self.end, side="right"))

    @property
    def misshapen(self) -> dict[str, str]:
        """Coordinates or speeds of another shape than the mechanism's, and their shape."""
        right = (len(self.whole.t), len(self.mechanism.coordinates))
        shapes = {Kind.COORDINATES.value: self.whole.q.shape, Kind.SPEEDS.value: self.whole.u.shape}
        return {
            name: f"{shape} instead of {right}" for name, shape in shapes.items() if shape != right
        }

    @cached_property
    def trajectory(self) -> Trajectory:
        """The recorded trajectory at some of its times."""
        return thinned(self.whole, self._chosen)

    @cached_property
    def _chosen(self) -> IndexArray:
        """Samples that are looked at."""
        # Without the start: an engine that records its states late starts there.
        compared = np.arange(1, self._compared)
        t, guard = self.whole.t[compared], EVENT_GUARD * self.step
        beside = np.zeros(len(t), dtype=bool)
        for motion in (self.solution, self.whole):
            releases = [time for time in motion.release_times.values() if time is not None]
            for time in (*(impact for impact, _ in motion.impacts), *releases):
                beside |= np.abs(t - time) <= guard
        if (~beside).sum() > _FEWEST:
            compared = compared[~beside]
        chosen = np.unique(np.linspace(0, len(compared) - 1, _SAMPLES).astype(int))
        return compared[chosen]

    @cached_property
    def compared_reference(self) -> Trajectory:
        """The reference's trajectory at all compared times."""
        return self.solution.trajectory(self.whole.t[: self._compared])

    @property
    def t(self) -> FloatArray:
        """Times at which it is compared [s]."""
        return self.trajectory.t

    @property
    def step(self) -> float:
        """The engine's [s]."""
        return float(np.median(np.diff(self.whole.t)))

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
        """Tell whether the reference's motion has impacts in the compared time."""
        return any(time <= self.t[-1] for time, _ in self.solution.impacts)

    @property
    def has_velocity_forces(self) -> bool:
        """Tell whether it has more centrifugal force than rounding: a single pendulum has none."""
        equations, q = self.solution.equations, self.motion.q
        bias = np.abs(equations.bias(q, self.motion.u)).max()
        return bool(bias > _ROUNDING * np.abs(equations.gravity_forces(q)).max())

    @cached_property
    def channels(self) -> Channels:
        """Quantities that are compared."""
        return Channels.of(self.trajectory, self.reference, self.told)

    @cached_property
    def _right(self) -> FloatArray:
        """The reference's values, shape (n, n_channels)."""
        return self.channels.stacked(self.reference)

    @cached_property
    def differences(self) -> FloatArray:
        """Differences from the reference in units of size, not weighted, (n, n_channels)."""
        return self.channels.differences(self.channels.stacked(self.trajectory), self._right)

    @cached_property
    def weights(self) -> FloatArray:
        """One over how large the deviation has become by each time, shape (n, 1)."""
        grown = np.maximum.accumulate(np.abs(self.differences).max(axis=1))
        return 1.0 / np.maximum(grown, _FAINT * (grown[-1] or 1.0))[:, None]

    @cached_property
    def deviation(self) -> FloatArray:
        """The deviation to be explained, flat."""
        return (self.weights * self.differences).ravel()

    @cached_property
    def shares(self) -> dict[Quantity, float]:
        """Size of the deviation of each quantity, in parts of the whole."""
        size = float(np.linalg.norm(self.deviation)) or 1.0
        parts = self.channels.parts(self.differences)
        return {
            name: float(np.linalg.norm(self.weights * part)) / size for name, part in parts.items()
        }

    @cached_property
    def first_errors(self) -> dict[Quantity, float]:
        """Largest deviation of each quantity at t = 0, in units of its size."""
        first = thinned(self.whole, np.zeros(1, dtype=int))
        right = self.channels.stacked(self.solution.trajectory(first.t))
        errors = self.channels.differences(self.channels.stacked(first), right)
        return {name: _largest(part) for name, part in self.channels.parts(errors).items()}

    def signature(self, wrong: Trajectory) -> FloatArray:
        """Signature of a trajectory at the same times, flat."""
        differences = self.channels.differences(self.channels.stacked(wrong), self._right)
        return (self.weights * differences).ravel()

    def at_its_times(self, other: Trajectory) -> FloatArray:
        """Signature of another trajectory at the times of the whole one, flat."""
        return self.signature(thinned(other, self._chosen))

    def carried(self, other: Trajectory) -> FloatArray:
        """Signature of a trajectory at other times, interpolated between its nearest samples."""
        after = np.minimum(np.searchsorted(other.t, self.t), len(other.t) - 1)
        near = thinned(other, np.unique([np.maximum(after - 1, 0), after]))
        right = self.channels.stacked(self.solution.trajectory(near.t))
        differences = self.channels.differences(self.channels.stacked(near), right)
        columns = [np.interp(self.t, near.t, column) for column in differences.T]
        return (self.weights * np.stack(columns, axis=1)).ravel()

    def problem(self, mechanism: Mechanism) -> Problem:
        """Problem of a mechanism, solved as far as is compared."""
        law = StopLaw(self.solution.problem.stop_law)
        return Problem(mechanism, duration=float(self.t[-1]), stop_law=law)

    def solved(
        self,
        fault: Equations | StopLaw,
        patience: int = PATIENCE,
        tolerance: float = FINE,
    ) -> Solution | None:
        """The motion under other equations, or another law of the stops; None if it has none.

        Args:
            fault: what is wrong.
            patience: it is given up after so many times the reference's steps: equations that are
                so stiff are far from any that fit. Another law of the stops is not given up.
            tolerance: relative and absolute, of a step. Motions at `ROUGH` are kept: other runs on
                the mechanism ask for the same ones.
        """
        if isinstance(fault, StopLaw):
            problem = self.problem(self.mechanism).model_copy(update={"stop_law": fault})
            equations, most = None, MOST_STEPS
        else:
            problem, equations = self.problem(fault.mechanism), fault
            most = patience * self._reference_steps
        if tolerance != ROUGH:
            return _solution(problem, equations, tolerance, most)
        # To the end that all runs on the mechanism have in common.
        problem = problem.model_copy(update={"duration": self.end})
        return _kept_solution(problem, equations, tolerance, most)

    @cached_property
    def _reference_steps(self) -> int:
        steps = sum(len(segment.interpolant.ts) for segment in self.solution.segments)
        return max(_REFERENCE_STEPS, steps)

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

    def seen(self, wrong: Solution, motion: MotionSamples) -> tuple[FloatArray, FloatArray]:
        """Signatures of a faulty motion, read by an engine with the fault, and by others.

        An engine with a wrong body computes markers and energies by that; an adapter that gets
        coordinates from the engine computes them from the right description.
        """
        provenance = self.reference.provenance
        own = wrong.reading(self.t, motion, provenance)
        states = replace(self.motion, q=motion.q, u=motion.u)
        right = self.solution.reading(self.t, states, provenance)
        mixed = replace(right, stop_torques=own.stop_torques, joint_reactions=own.joint_reactions)
        return self.signature(own), self.signature(mixed)

    def estimated(
        self, cause: RankedCause, share: Callable[[float], float | None], fine: float = FINE
    ) -> RankedCause | Estimate:
        """A cause by its rough share where that is of use, else by its accurate one.

        Args:
            cause: without its share.
            share: computes it from a motion of some tolerance; None where there is none.
            fine: tolerance of the accurate share.
        """

        def accurate() -> RankedCause:
            return cause.model_copy(update={"explained": share(fine) or 0.0})

        rough = None if self.rough_error is None else share(ROUGH)
        if rough is None or self.rough_error is None:
            return accurate()
        return Estimate(cause.model_copy(update={"explained": rough}), self.rough_error, accurate)
