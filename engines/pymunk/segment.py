"""A stretch of a run from a fresh start: which stops push there, the steps, the releases, the recording."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

import numpy as np

from ...models.arrays import ComplexArray, FloatArray
from ...models.errors import SimulationError
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from ..protocol import Recording
from .build import Machine, build, start_of
from .forces import forces_of
from .options import PymunkOptions
from .read import Reading, as_vectors, samples_of
from .step import Stepper

_TRIAL_ITERATIONS = 5_000  # which stops push is a fact of the machine, not of the preset
_SLACK = 1e-9  # of the largest torque: rounding of a torque that is zero
_NEAR = 4.0  # a stop is looked at closely when its impulse is less than so many of its changes in a step


def _pushing(mechanism: Mechanism, h: float, engine: PymunkOptions) -> tuple[str, ...]:
    """Stops that hold at the start: all of them if all push, or those that push while the others open."""
    touching = [stop.name for stop in mechanism.stops if stop.closed]
    if not touching:
        return ()
    subsets = (c for size in range(len(touching), -1, -1) for c in itertools.combinations(touching, size))
    for closed in subsets:
        machine = build(mechanism, closed, 0.0, engine.pivot_mass)
        stepper = Stepper(machine, h, hold_lengths=True)
        stepper.start(_TRIAL_ITERATIONS, leapfrog=True)
        if _is_consistent(machine, stepper, h, [name for name in touching if name not in closed]):
            return closed
    return ()


def _is_consistent(machine: Machine, stepper: Stepper, h: float, opened: list[str]) -> bool:
    reading = Reading(machine, samples_of(stepper.states(0), h, leapfrog=True))
    torques = [float(torque[0]) for torque in forces_of(reading, tuple(machine.stops)).torques.values()]
    slack = _SLACK * max(map(abs, torques), default=0.0)
    kinematics, (q, u) = Kinematics(machine.mechanism), start_of(machine.mechanism)
    a = reading.accelerations()[0]
    opening = [float(kinematics.gap_jacobian(name, q) @ a) + float(kinematics.gap_bias(name, q, u)) for name in opened]
    return all(torque >= -slack for torque in torques) and all(rate >= 0 for rate in opening)


class Segment:
    """Steps from a machine's start to a given time, and who is released when."""

    def __init__(self, mechanism: Mechanism, engine: PymunkOptions, start: float, end: float) -> None:
        """Build the machine and find which of its closed stops push.

        Args:
            mechanism: as it stands at the start.
            engine: how to step.
            start, end: times [s].
        """
        self.engine, self.begins, self.ends = engine, start, end
        self.n = max(1, math.ceil((end - start) / engine.timestep * (1 - 1e-12)))
        self.h = h = (end - start) / self.n
        closed = _pushing(mechanism, h, engine)
        self.machine = machine = build(mechanism, closed, engine.error_bias, engine.pivot_mass)
        self.stepper = Stepper(machine, h, engine.hold_lengths)
        held = set(machine.stops)
        self.releases: dict[str, float | None] = {
            stop.name: start if stop.closed and stop.name not in held else None for stop in machine.mechanism.stops
        }
        self.regimes = [(0, tuple(machine.stops))]
        """First sample and closed stops of each stretch between releases."""
        self._impulses: dict[str, float] = {}

    def begin(self) -> None:
        """The first sample, and in a machine that is no leapfrog the first step."""
        stepper = self.stepper
        stepper.start(self.engine.start_iterations, self.engine.leapfrog)
        if not self.engine.leapfrog:
            # Impulses are found anew in the first step here; a leapfrog has found them at the start.
            stepper.run(1, self.engine.start_iterations)
            self._watch(1)

    def advance(self, last: int) -> None:
        """Step to a sample."""
        stepper, iterations = self.stepper, self.engine.iterations
        while self.machine.stops and stepper.steps < last:
            stepper.run(1, iterations)
            self._watch(stepper.steps)
        stepper.run(max(last - stepper.steps, 0), iterations)

    def _watch(self, k: int) -> None:
        """Release the stop whose torque vanishes next, if that is before sample k + 1."""
        if not self._anything_near(k):
            return
        first = max(min(max(self.regimes[-1][0], k - 2), k - 1), 0)
        closed = tuple(self.machine.stops)
        states = self.stepper.states(first)
        reading = Reading(self.machine, samples_of(states, self.h, self.engine.leapfrog))
        torques = forces_of(reading, closed).torques
        find = _foreseen if self.engine.locate_releases else _noticed
        found = {name: find(torque) for name, torque in torques.items()}
        due = {name: step for name, step in found.items() if step is not None and k + step <= self.n}
        if due:
            self._release(min(due, key=lambda name: due[name]), k, min(due.values()))

    def _anything_near(self, k: int) -> bool:
        """Whether an impulse may soon pass through zero; Chipmunk tells only its size, but that is cheap to ask."""
        before = self._impulses
        self._impulses = now = {name: joint.impulse for name, joint in self.machine.stops.items()}
        if k < self.regimes[-1][0] + 3:
            return True
        return any(now[name] < _NEAR * abs(now[name] - before[name]) for name in now)

    def _release(self, name: str, k: int, step: float) -> None:
        self.releases[name] = self.begins + (k + step) * self.h
        self.stepper.release(name)
        self.regimes.append((k + 1, tuple(self.machine.stops)))

    def times(self) -> FloatArray:
        """Of the samples [s], shape (n + 1,)."""
        return np.linspace(self.begins, self.ends, self.n + 1)

    def reading(self, first: int, last: int, near: FloatArray | None = None) -> Reading:
        """Samples from one to another, both included; coordinates of the first one are near those given."""
        states = self.stepper.states(first)
        samples = samples_of(states[: last - first + 2], self.h, self.engine.leapfrog)
        return Reading(self.machine, samples, near)

    def closed_at(self, k: int) -> tuple[str, ...]:
        """Stops that hold at a sample."""
        return next(closed for first, closed in reversed(self.regimes) if first <= k)

    def recording(self, last: int) -> Recording:
        """All of it up to a sample."""
        t, reading = self.times()[: last + 1], self.reading(0, last)
        gaps = reading.gaps()
        _refuse_lost_joints(self.machine.mechanism, gaps, t)
        q, u = reading.coordinates()
        kinetic, potential = reading.energies()
        reactions, torques = self._forces(reading, t)
        return Recording(
            t=t,
            q=q,
            u=u,
            markers=reading.markers(),
            kinetic_energy=kinetic,
            potential_energy=potential,
            stop_torques=torques,
            release_times=self.releases,
            joint_reactions={name: as_vectors(force) for name, force in reactions.items()},
            joint_gaps=gaps,
            steps=len(t) - 1,
        )

    def _forces(self, reading: Reading, t: FloatArray) -> tuple[dict[str, ComplexArray], dict[str, FloatArray]]:
        """Reactions of the joints and torques of the stops; they depend on which stops are closed."""
        reactions = {joint.name: np.zeros(len(t), dtype=np.complex128) for joint in reading.mechanism.joints}
        torques = {stop.name: np.zeros(len(t)) for stop in reading.mechanism.stops}
        ends = [first for first, _ in self.regimes[1:]] + [len(t)]
        for (first, closed), end in zip(self.regimes, ends, strict=True):
            forces = forces_of(reading, closed)
            for name, force in forces.reactions.items():
                reactions[name][first:end] = force[first:end]
            for name, torque in forces.torques.items():
                torques[name][first:end] = np.maximum(torque[first:end], 0.0)
        return reactions, torques


def _refuse_lost_joints(mechanism: Mechanism, gaps: Mapping[str, FloatArray], t: FloatArray) -> None:
    """Impulses that do not converge can throw bodies apart without a number that is not finite."""
    joints = [point for joint in mechanism.joints for point in (joint.parent_point, joint.child_point)]
    reach = sum(math.hypot(*point) for point in (*joints, *(body.centre for body in mechanism.bodies)))
    for name, gap in gaps.items():
        lost = np.flatnonzero(~(gap <= reach))
        if len(lost):
            raise SimulationError(
                f"pymunk lost the joint {name!r}: its points are {gap[lost[0]]:.3g} m apart at t = {t[lost[0]]:.6g} s; "
                f"a shorter timestep or more iterations may hold it."
            )


def _foreseen(torque: FloatArray) -> float | None:
    """Steps from the last sample to the torque's zero, if it lies before the next one: negative if it is past."""
    if len(torque) < 2:
        return None
    s = np.arange(1 - len(torque), 1, dtype=np.float64)
    polynomial = np.polynomial.Polynomial.fit(s, torque, len(torque) - 1, domain=[-1, 1])
    past = torque[-1] <= 0
    if not past and float(polynomial(1.0)) > 0:
        return None
    low, high = (-1.0, 0.0) if past else (0.0, 1.0)
    roots = [float(root.real) for root in polynomial.roots() if abs(root.imag) < 1e-9]
    inside = [root for root in roots if low <= root <= high]
    return min(inside, default=high)


def _noticed(torque: FloatArray) -> float | None:
    """The last sample, if its torque does not push any more."""
    return 0.0 if torque[-1] <= 0 else None
