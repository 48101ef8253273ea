"""A segment of a run between two impacts: its active stops at the start, steps, releases and recording."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from ...models.arrays import ComplexArray, FloatArray, as_vectors
from ...models.errors import SimulationError
from ...models.kinematics import Kinematics, initial_state
from ...models.mechanism import Mechanism
from ..contact_events import Contacts, active_contacts
from ..protocol import Recording
from .build import build
from .leapfrog import STARTED, Stepper
from .options import PymunkOptions
from .passes import MOST_PASSES, TRACKED, Convergence, convergence, growth
from .reactions import forces_of, mass_matrix
from .read import Reading

_TRIAL_ITERATIONS = 5_000  # which stops push depends on the mechanism, not on the preset
_CHECKED = 64  # steps between two looks at how many passes loops need
_LOOSE = 1e-4  # of the reach: error of a loop that is not closed
_ROUNDING = 1e-9  # of the largest torque: error of a torque that is zero
_NEAR = 4.0  # a stop's torque is computed when its impulse is less than so many of its changes in a step


def _pushing(mechanism: Mechanism, h: float, options: PymunkOptions) -> Contacts:
    """Stops that are active at the start: those that push while the others open."""
    touching = tuple(stop.name for stop in mechanism.stops if stop.closed)
    return active_contacts(
        touching, lambda active: _violated(mechanism, active, touching, h, options.pivot_mass)
    )


def _violated(
    mechanism: Mechanism, active: Contacts, touching: Contacts, h: float, pivot_mass: float
) -> str | None:
    """A touching stop that would have to pull, or that would close, by the forces of a first step."""
    assembly = build(mechanism, active, 0.0, pivot_mass)
    stepper = Stepper(assembly, h, hold_lengths=True)
    stepper.start(_TRIAL_ITERATIONS, leapfrog=True, settle=bool(mechanism.loop_joints))
    reading = Reading(assembly, stepper.samples(0))
    torques = {
        name: float(torque[0])
        for name, torque in forces_of(reading, tuple(assembly.stops)).torques.items()
    }
    least = -_ROUNDING * max(map(abs, torques.values()), default=0.0)
    kinematics, (q, u), a = (
        Kinematics(mechanism),
        initial_state(mechanism),
        reading.accelerations()[0],
    )
    rounding = least * _compliance(kinematics, q, touching)

    def is_wrong(name: str) -> bool:
        if name in active:
            return torques[name] < least
        return (
            float(kinematics.gap_jacobian(name, q) @ a) + float(kinematics.gap_bias(name, q, u))
            < rounding
        )

    return next((name for name in touching if is_wrong(name)), None)


def _compliance(kinematics: Kinematics, q: FloatArray, touching: Contacts) -> float:
    """The largest acceleration of a gap by the unit torque or force of its own stop, in the tree."""
    rows = np.array([kinematics.gap_jacobian(name, q) for name in touching])
    moved = np.linalg.pinv(mass_matrix(kinematics, q[None])[0]) @ rows.T
    return float(np.max(np.sum(rows.T * moved, axis=0), initial=0.0))


class Segment:
    """Steps of an assembly from a start to a given time, and the releases in them."""

    def __init__(
        self, mechanism: Mechanism, options: PymunkOptions, start: float, end: float
    ) -> None:
        """Build the assembly and find which of its closed stops push.

        Args:
            mechanism: in its state at the start.
            options: how to step.
            start, end: times [s].
        """
        self.options, self.begins, self.ends = options, start, end
        self.n = max(1, math.ceil((end - start) / options.timestep * (1 - 1e-12)))
        self.h = h = (end - start) / self.n
        active = _pushing(mechanism, h, options)
        self.assembly = assembly = build(mechanism, active, options.error_bias, options.pivot_mass)
        self.stepper = Stepper(assembly, h, options.hold_lengths)
        self.releases: dict[str, float | None] = {
            stop.name: start if stop.closed and stop.name not in active else None
            for stop in mechanism.stops
        }
        self.regimes = [(0, tuple(assembly.stops))]
        """First sample and active stops of each interval between releases."""
        self._impulses: dict[str, float] = {}
        self._grown = 1.0
        """Factor by which the slowest mode's error has grown since passes were last enough to let it decay."""

    def begin(self) -> None:
        """The first sample, and without the leapfrog the first step."""
        stepper = self.stepper
        closed = self._checks_passes
        passes = self._passes(
            self._convergence(*initial_state(self.assembly.mechanism)) if closed else None
        )
        # Stops that meet the joints as well as those of a machine do start with the passes that the
        # option says.
        settle = closed and (
            bool(self.assembly.mechanism.loop_joints) or passes > self.options.iterations
        )
        stepper.start(max(self.options.start_iterations, passes), self.options.leapfrog, settle)
        if not self.options.leapfrog:
            # The first step has no impulses to start from; a leapfrog has found them at the start.
            stepper.run(1, self.options.start_iterations)
            self._release_before_next(1)

    def advance(self, last: int) -> None:
        """Step to a sample.

        Raises:
            SimulationError: loops are so nearly rigid or singular that their impulses do not
                converge.
        """
        while self._checks_passes and self.stepper.steps < last:
            first = self.stepper.steps
            (q, *_), (u, *_) = self.reading(first, first).coordinates()
            found = self._convergence(q, u)
            passes = self._passes(found)
            rate = 0.0 if found is None else growth(found.left_after(passes))
            # Singular positions are passed in a few steps, during which impulses need not converge.
            end = min(last, first + (_CHECKED if rate < 1.0 else 1))
            self._advance(end, passes)
            if passes >= MOST_PASSES:
                self._refuse_open_loops(end)
            if found is not None:
                self._note_growth(found, passes, rate, end)
        self._advance(last, self.options.iterations)

    @property
    def _checks_passes(self) -> bool:
        """Whether a step is to have as many passes as its loops need: where joints are to keep their lengths.

        An active stop closes a loop as a joint does.
        """
        closed = bool(self.assembly.mechanism.loop_joints or self.assembly.stops)
        return self.options.hold_lengths and closed

    def _passes(self, found: Convergence | None) -> int:
        """Passes of a step: as many as it needs, up to `MOST_PASSES`, and no less than the option says."""
        needed = 1 if found is None else min(found.passes_to(TRACKED), MOST_PASSES)
        return max(needed, self.options.iterations)

    def _convergence(self, q: FloatArray, u: FloatArray) -> Convergence | None:
        """Of the assembly in a state, shapes (n_q,); None where the run has lost it."""
        if not np.isfinite([q, u]).all():
            return None
        # Not validated: stops keep the word on whether they are closed at the start, which decides
        # on the bodies.
        there = self.assembly.mechanism.model_copy(
            update={"start": tuple(q.tolist()), "start_speeds": tuple(u.tolist())}
        )
        return convergence(build(there, tuple(self.assembly.stops), 0.0, self.options.pivot_mass))

    def _refuse_open_loops(self, k: int) -> None:
        mechanism = self.assembly.mechanism
        gaps = self.reading(k, k).gaps()
        for joint in mechanism.loop_joints:
            if not gaps[joint.name][0] <= _LOOSE * _reach(mechanism):
                raise SimulationError(
                    f"pymunk's impulses on the loop that {joint.name!r} closes do not converge in {MOST_PASSES} passes "
                    f"at t = {self.times()[k]:.6g} s: it is rigid or nearly singular there; its points are "
                    f"{gaps[joint.name][0]:.2g} m apart."
                )

    def _note_growth(self, found: Convergence, passes: int, rate: float, k: int) -> None:
        """Refuse a mode that so many passes hardly see, once its error has grown beyond what is let be of impulses."""
        self._grown = self._grown * rate if rate >= 1.0 else 1.0
        if self._grown * STARTED > TRACKED:
            raise SimulationError(
                f"pymunk's impulses do not converge at t = {self.times()[k]:.6g} s: constraints on "
                f"{' and '.join(map(repr, found.slowest(passes)))} are nearly parallel there, so that {passes} passes "
                f"leave {found.left_after(passes):.2g} of an error, which grows where that is above 0.5."
            )

    def _advance(self, last: int, iterations: int) -> None:
        stepper = self.stepper
        while self.assembly.stops and stepper.steps < last:
            stepper.run(1, iterations)
            self._release_before_next(stepper.steps)
        stepper.run(max(last - stepper.steps, 0), iterations)

    def _release_before_next(self, k: int) -> None:
        """Release the stop whose torque vanishes next, if that is before sample k + 1."""
        if not self._is_any_near_zero(k):
            return
        first = max(min(max(self.regimes[-1][0], k - 2), k - 1), 0)
        active = tuple(self.assembly.stops)
        reading = Reading(self.assembly, self.stepper.samples(first))
        torques = forces_of(reading, active).torques
        find = _foreseen if self.options.locate_releases else _noticed
        steps_to_zero = {name: find(torque) for name, torque in torques.items()}
        due = {
            name: step
            for name, step in steps_to_zero.items()
            if step is not None and k + step <= self.n
        }
        if due:
            self._release(min(due, key=lambda name: due[name]), k, min(due.values()))

    def _is_any_near_zero(self, k: int) -> bool:
        """Whether an impulse may soon pass through zero; Chipmunk gives only its size, but at no cost."""
        before = self._impulses
        self._impulses = now = {name: joint.impulse for name, joint in self.assembly.stops.items()}
        if k < self.regimes[-1][0] + 3:
            return True
        return any(now[name] < _NEAR * abs(now[name] - before[name]) for name in now)

    def _release(self, name: str, k: int, step: float) -> None:
        self.releases[name] = self.begins + (k + step) * self.h
        self.stepper.release(name)
        self.regimes.append((k + 1, tuple(self.assembly.stops)))

    def times(self) -> FloatArray:
        """Of the samples [s], shape (n + 1,)."""
        return np.linspace(self.begins, self.ends, self.n + 1)

    def reading(self, first: int, last: int, near: FloatArray | None = None) -> Reading:
        """Samples from one to another, both included; coordinates of the first one are near those given."""
        return Reading(self.assembly, self.stepper.samples(first, last), near)

    def active_at(self, k: int) -> Contacts:
        """Stops that are active at a sample."""
        return next(active for first, active in reversed(self.regimes) if first <= k)

    def recording(self, last: int) -> Recording:
        """The segment up to a sample."""
        t, reading = self.times()[: last + 1], self.reading(0, last)
        gaps = reading.gaps()
        _refuse_lost_joints(self.assembly.mechanism, gaps, t)
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

    def _forces(
        self, reading: Reading, t: FloatArray
    ) -> tuple[dict[str, ComplexArray], dict[str, FloatArray]]:
        """Reactions of the joints and torques of the stops; they depend on which stops are active."""
        joints = [joint.name for joint in reading.mechanism.joints if joint.held_directions]
        reactions = {name: np.zeros(len(t), dtype=np.complex128) for name in joints}
        torques = {stop.name: np.zeros(len(t)) for stop in reading.mechanism.stops}
        ends = [first for first, _ in self.regimes[1:]] + [len(t)]
        for (first, active), end in zip(self.regimes, ends, strict=True):
            forces = forces_of(reading, active)
            for name in joints:
                reactions[name][first:end] = forces.reactions[name][first:end]
            for name, torque in forces.torques.items():
                torques[name][first:end] = np.maximum(torque[first:end], 0.0)
        return reactions, torques


def _refuse_lost_joints(
    mechanism: Mechanism, gaps: Mapping[str, FloatArray], t: FloatArray
) -> None:
    """Impulses that do not converge can separate the bodies although all numbers stay finite."""
    reach = _reach(mechanism)
    for name, gap in gaps.items():
        lost = np.flatnonzero(~(gap <= reach))
        if len(lost):
            raise SimulationError(
                f"pymunk lost the joint {name!r}: its points are {gap[lost[0]]:.3g} m apart at t = {t[lost[0]]:.6g} s; "
                f"a shorter timestep or more iterations may help."
            )


def _reach(mechanism: Mechanism) -> float:
    """Sum of all lengths [m]."""
    joints = [
        point for joint in mechanism.joints for point in (joint.parent_point, joint.child_point)
    ]
    reach = sum(
        math.hypot(*point) for point in (*joints, *(body.centre for body in mechanism.bodies))
    )
    # A rotor on its axle has no length but its radius of gyration.
    return reach + sum(math.sqrt(body.inertia / body.mass) for body in mechanism.bodies)


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
