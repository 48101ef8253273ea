"""One run: which stops push at the start, the steps, the releases, the recording."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

import numpy as np

from ..models.arrays import FloatArray
from ..models.errors import SimulationError, UnsupportedProblemError
from ..models.kinematics import Kinematics
from ..models.mechanism import Mechanism
from ..models.problem import Problem
from ._pymunk_build import Machine, build, start_of
from ._pymunk_read import Reading, as_vectors, samples_of
from ._pymunk_step import Stepper
from .protocol import Recording
from .pymunk_ import PymunkEngine

_TRIAL_ITERATIONS = 5_000  # which stops push is a fact of the machine, not of the preset
_SLACK = 1e-9  # of the largest torque: rounding of a torque that is zero
_NEAR = 4.0  # a stop is looked at closely when its impulse is less than so many of its changes in a step


def record(problem: Problem, engine: PymunkEngine) -> Recording:
    """Run a problem.

    Raises:
        UnsupportedProblemError: the mechanism has a part that has no counterpart here, or starts on a moving stop.
    """
    mechanism = problem.mechanism
    _refuse_moving_stops(mechanism)
    n = max(1, math.ceil(problem.duration / engine.timestep * (1 - 1e-12)))
    h = problem.duration / n
    closed = _pushing(mechanism, h, engine)
    run = _Run(build(mechanism, closed, engine.error_bias, engine.pivot_mass), engine, h, n)
    run.go()
    return run.recording(np.linspace(0.0, problem.duration, n + 1))


def _refuse_moving_stops(mechanism: Mechanism) -> None:
    kinematics, u = Kinematics(mechanism), start_of(mechanism)[1]
    for stop in mechanism.stops:
        if stop.closed and abs(float(kinematics.gap_row(stop.name) @ u)) > 1e-12 * (1 + float(np.abs(u).max())):
            raise UnsupportedProblemError(
                f"pymunk cannot start with the stop {stop.name!r} closed and its gap changing: that is an impact."
            )


def _pushing(mechanism: Mechanism, h: float, engine: PymunkEngine) -> tuple[str, ...]:
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
    torques = [float(torque[0]) for torque in reading.torques(tuple(machine.stops)).values()]
    accelerations = np.array([reading.frames[body.name].a[0] for body in machine.mechanism.bodies])
    slack = _SLACK * max(map(abs, torques), default=0.0)
    row = Kinematics(machine.mechanism).gap_row
    opening = [float(row(name)[: len(accelerations)] @ accelerations) for name in opened]
    return all(torque >= -slack for torque in torques) and all(rate >= 0 for rate in opening)


class _Run:
    """The steps of one run, and who is released when."""

    def __init__(self, machine: Machine, engine: PymunkEngine, h: float, n: int) -> None:
        self.machine, self.engine, self.h, self.n = machine, engine, h, n
        self.stepper = Stepper(machine, h, engine.hold_lengths)
        held = set(machine.stops)
        self.releases: dict[str, float | None] = {
            stop.name: 0.0 if stop.closed and stop.name not in held else None for stop in machine.mechanism.stops
        }
        self.regimes = [(0, tuple(machine.stops))]
        """First sample and closed stops of each stretch between releases."""
        self._impulses: dict[str, float] = {}

    def go(self) -> None:
        """Step to the last sample."""
        stepper, iterations = self.stepper, self.engine.iterations
        stepper.start(self.engine.start_iterations, self.engine.leapfrog)
        if not self.engine.leapfrog:
            # Impulses are found anew in the first step here; a leapfrog has found them at the start.
            stepper.run(1, self.engine.start_iterations)
            self._watch(1)
        while self.machine.stops and stepper.steps < self.n:
            stepper.run(1, iterations)
            self._watch(stepper.steps)
        stepper.run(self.n - stepper.steps, iterations)

    def _watch(self, k: int) -> None:
        """Release the stop whose torque vanishes next, if that is before sample k + 1."""
        if not self._anything_near(k):
            return
        first = max(min(max(self.regimes[-1][0], k - 2), k - 1), 0)
        closed = tuple(self.machine.stops)
        states = self.stepper.states(first)
        torques = Reading(self.machine, samples_of(states, self.h, self.engine.leapfrog)).torques(closed)
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
        self.releases[name] = (k + step) * self.h
        self.stepper.release(name)
        self.regimes.append((k + 1, tuple(self.machine.stops)))

    def recording(self, t: FloatArray) -> Recording:
        """All of it at the sample times t [s], shape (n + 1,)."""
        reading = Reading(self.machine, samples_of(self.stepper.states(0), self.h, self.engine.leapfrog))
        gaps = reading.gaps()
        _refuse_lost_joints(self.machine.mechanism, gaps, t)
        q, u = reading.coordinates()
        kinetic, potential = reading.energies()
        return Recording(
            t=t,
            q=q,
            u=u,
            markers=reading.markers(),
            kinetic_energy=kinetic,
            potential_energy=potential,
            stop_torques=self._torques(reading, t),
            release_times=self.releases,
            joint_reactions={name: as_vectors(force) for name, force in reading.reactions().items()},
            joint_gaps=gaps,
            steps=len(t) - 1,
        )

    def _torques(self, reading: Reading, t: FloatArray) -> dict[str, FloatArray]:
        torques = {stop.name: np.zeros(len(t)) for stop in reading.mechanism.stops}
        ends = [first for first, _ in self.regimes[1:]] + [len(t)]
        for (first, closed), end in zip(self.regimes, ends, strict=True):
            for name, torque in reading.torques(closed).items():
                torques[name][first:end] = np.maximum(torque[first:end], 0.0)
        return torques


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
