"""Proofs of motions: figures with radii, to as many digits as are asked for.

Precision is found by trial: a motion is enclosed with so many bits and such remainders that the
digits would be left if balls did not grow, and again with more where they have grown too wide.
Every trial is a proof; the last one has the digits.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from decimal import Decimal
from fractions import Fraction
from functools import partial
from typing import Any, NamedTuple

from ...models.errors import InputError, SimulationError
from ...models.problem import LONGEST, Problem
from ...models.shown import Shown
from ..taylor.numbers import PROJECTILE
from .balls import Ball, acb, as_decimals, precision, rounded
from .extrema import Extrema
from .mechanics import (
    SolvedForces,
    half_square,
    joint_reactions,
    kinetic_energy,
    potential_energy,
    range_without_drag,
)
from .motion import Limits, Phase, ProvedEvent, ProvedMotion, State, UndecidedError
from .numbers import Coordinates, as_coordinates

MOST_DIGITS = 200
_SPARE = 12  # digits beside those asked for, in the first trial
_MORE = 2  # digits beside those that a trial lacked
_AGAIN = 8  # digits more after the first trial that leaves something undecided, then twice as many
_ORDER = 1.1  # of the polynomials, to a digit of the remainder
_LEAST_ORDER = 14
_SPARE_BITS = 32
_UNDECIDED_TRIALS = 3  # with more digits each, before it is said
_MOST_ZEROS = 1000  # before or after the point of a time that is said in decimals
_SMALL = 1e-6  # in SI units: digits of less than that are counted from there


class Enclosure(NamedTuple):
    """A proved figure: the exact value is within the radius of the value."""

    value: Decimal
    radius: Decimal

    def __str__(self) -> str:
        return f"{self.value} +/- {self.radius}"

    @classmethod
    def of(cls, ball: Ball) -> Enclosure:
        """Enclosure of a ball in decimals."""
        return cls(*as_decimals(ball))

    def contains(self, value: Decimal | float) -> bool:
        """Tell whether a value lies in it."""
        off = abs(Fraction(value) - Fraction(self.value))
        return off <= Fraction(self.radius)


Time = float | str | Decimal | Fraction
Instant = Time | ProvedEvent
"""A time [s]: a number is taken exactly, a text as the decimal it says; or an event of the motion,
whose own time is a ball."""


class ProvedFigure(NamedTuple):
    """A figure of a proved motion, with its name and unit."""

    name: str
    unit: str
    enclosure: Enclosure


@dataclass(frozen=True, repr=False)
class Proof(Shown):
    """A proved motion, from the start to its end."""

    motion: ProvedMotion
    until: Fraction | None
    """End that was asked for [s]; None: the launch."""
    digits: int
    bits: int
    """Precision of the last trial."""
    trials: int
    processor_time: float
    """Processor time of all trials [s]."""

    @property
    def problem(self) -> Problem:
        """Problem whose motion it is."""
        return self.motion.problem

    @property
    def steps(self) -> int:
        """Steps of the last trial."""
        return sum(len(phase.steps) for phase in self.motion.phases)

    def headline(self) -> str:
        """Mechanism, digits and cost."""
        return (
            f"Proof of {self.problem.mechanism.name!r}: {self.digits} digits in "
            f"{self.processor_time:.1f} s, {self.steps} steps of {self.bits} bits"
        )

    def facts(self) -> Iterator[tuple[str, str]]:
        """Its figures."""
        for figure in self.figures:
            yield figure.name, f"{figure.enclosure} {figure.unit}"

    def release_time(self, stop: str) -> Enclosure | None:
        """Time at which a stop that was closed first opens [s]; None: it does not.

        Raises:
            InputError: there is no such stop.
        """
        names = [each.name for each in self.problem.mechanism.stops]
        if stop not in names:
            raise InputError(f"there is no stop {stop!r} here; there are {names or 'none'}.")
        for event in self.motion.events:
            if event.kind == "release" and event.name == stop:
                return self._enclosed(event.time)
        return None

    @property
    def impacts(self) -> tuple[tuple[str, Enclosure], ...]:
        """Stops that are met, and when [s]."""
        met = (event for event in self.motion.events if event.kind == "impact")
        return tuple((event.name, self._enclosed(event.time)) for event in met)

    def time_of(self, event: ProvedEvent) -> Enclosure:
        """Time of an event of the motion [s]."""
        return self._enclosed(event.time)

    @property
    def launch_time(self) -> Enclosure | None:
        """Time of the launch at 45 degrees [s]; None: it does not come."""
        launch = self.motion.launch
        return None if launch is None else self._enclosed(launch.time)

    @property
    def launch_speed(self) -> Enclosure | None:
        """Speed of the projectile there [m/s]; None: no launch comes."""
        launch = self.motion.launch
        return None if launch is None else self.projectile_speed(launch)

    def state(self, t: Instant) -> State:
        """Coordinates and speeds at a time in balls; see :meth:`q`."""
        return (t.q, t.u) if isinstance(t, ProvedEvent) else self._state(t)[1]

    def q(self, t: Instant) -> dict[str, Enclosure]:
        """Coordinates at a time [s] by name [rad or m].

        Args:
            t: a time, or an event: before its impact, if it is one.

        Raises:
            InputError: the time is outside the proved motion, or within the radius of an event's.
        """
        return self._by_coordinate(self.state(t)[0])

    def u(self, t: Instant) -> dict[str, Enclosure]:
        """Speeds at a time [s] by coordinate [rad/s or m/s]; see :meth:`q`."""
        return self._by_coordinate(self.state(t)[1])

    def a(self, t: Instant) -> dict[str, Enclosure]:
        """Accelerations at a time [s] by coordinate [rad/s^2 or m/s^2]; see :meth:`q`."""
        return self._by_coordinate([a.real for a in self._forces(t)[2].accelerations])

    def stop_torque(self, stop: str, t: Instant) -> Enclosure:
        """Torque (force) of a stop at a time, 0 of an open one [N m or N]; see :meth:`q`."""
        self.release_time(stop)  # refuses another name
        torque = self._forces(t)[2].torques.get(stop)
        return Enclosure(Decimal(0), Decimal(0)) if torque is None else self._enclosed(torque)

    def joint_reaction(self, joint: str, t: Instant) -> tuple[Enclosure, Enclosure]:
        """Force on a joint's child at a time, along x and y of the world [N]; see :meth:`q`.

        Raises:
            InputError: as of :meth:`q`, or there is no such joint.
        """
        with precision(self.bits):
            reactions = joint_reactions(self.motion.kinematics, *self._forces(t))
        if joint not in reactions:
            raise InputError(f"there is no force of a joint {joint!r}; there are {[*reactions]}.")
        return self._parts(reactions[joint])

    def marker(self, name: str, t: Instant) -> tuple[tuple[Enclosure, ...], tuple[Enclosure, ...]]:
        """Position [m] and velocity [m/s] of a marker at a time; see :meth:`q`.

        Raises:
            InputError: as of :meth:`q`, or there is no such marker.
        """
        state = self.state(t)
        with precision(self.bits):
            position, velocity = self.motion.point(name, state)
        return self._parts(position), self._parts(velocity)

    def energy(self, t: Instant) -> tuple[Enclosure, Enclosure]:
        """Kinetic and potential energy at a time [J]; see :meth:`q`."""
        kinetic, potential = self._energies(t)
        return self._enclosed(kinetic), self._enclosed(potential)

    def total_energy(self, t: Instant) -> Enclosure:
        """Their sum [J]; see :meth:`q`."""
        kinetic, potential = self._energies(t)
        with precision(self.bits):
            return self._enclosed(kinetic + potential)

    def vacuum_range(self, t: Instant) -> Enclosure:
        """Where a projectile let go at a time comes back to y = 0 without air [m]; see :meth:`q`.

        Raises:
            InputError: as of :meth:`q`; or there is no projectile or gravity, or gravity is not
                along -y, or it does not come back.
        """
        mechanism = self.problem.mechanism
        state = self.state(t)
        if not mechanism.gravity or mechanism.gravity_direction != (0.0, -1.0):
            raise InputError("a range without air needs gravity along -y.")
        with precision(self.bits):
            distance = range_without_drag(*self.motion.point(PROJECTILE, state), mechanism.gravity)
        if not distance.is_finite():
            raise InputError(f"what is let go at t = {t} does not come back to y = 0.")
        return self._enclosed(distance)

    def projectile_speed(self, t: Instant) -> Enclosure:
        """Speed of the projectile at a time [m/s]; see :meth:`q`."""
        state = self.state(t)
        with precision(self.bits):
            return self._enclosed((2 * half_square(self.motion.projectile_velocity(state))).sqrt())

    def projectile_angle(self, t: Instant) -> Enclosure:
        """Angle of its velocity from +x, counter-clockwise, -pi to pi [rad]; see :meth:`q`."""
        state = self.state(t)
        with precision(self.bits):
            return self._enclosed(acb(self.motion.projectile_velocity(state)).arg())

    def rightmost(self, marker: str) -> ProvedEvent | None:
        """Where x of a marker is largest between start and launch; None: no maximum is proved.

        Raises:
            InputError: there is no such marker, or no launch is proved.
        """
        return self._extremum(lambda extrema: extrema.rightmost(marker))

    def best_release(self, step: float) -> ProvedEvent | None:
        """The release of the longest flight without air; None: no single maximum is proved.

        Args:
            step: distance from the launch within which it is sought, after the last release [s].

        Raises:
            InputError: no launch is proved.
        """
        return self._extremum(lambda extrema: extrema.best_release(step))

    def fastest(self, step: float) -> ProvedEvent | None:
        """Where the projectile is fastest; see :meth:`best_release`."""
        return self._extremum(lambda extrema: extrema.fastest(step))

    def _extremum(self, find: Callable[[Extrema], ProvedEvent | None]) -> ProvedEvent | None:
        if self.motion.launch is None:
            raise InputError("extrema are sought about a launch, and none is proved.")
        with precision(self.bits):
            return find(Extrema(self.motion, self.digits))

    def energy_ratio(self, t: Instant) -> Enclosure:
        """Kinetic energy of the projectile in parts of the total energy at the start.

        Raises:
            InputError: as of :meth:`q`; or no projectile's mass is known, or there is no energy.
        """
        mechanism, state = self.problem.mechanism, self.state(t)
        marker = mechanism.marker(PROJECTILE)
        mass = None if marker is None else mechanism.thrown_mass(marker)
        with precision(self.bits):
            kinetic, potential = self._energies(0)
            start = kinetic + potential
            if mass is None or start.contains(0):
                raise InputError("a ratio of energies needs a projectile's mass and an energy.")
            velocity = self.motion.projectile_velocity(state)
            return self._enclosed(mass * half_square(velocity) / start)

    def _energies(self, t: Instant) -> tuple[Ball, Ball]:
        q, u = map(as_coordinates, self.state(t))
        with precision(self.bits):
            kinetic = kinetic_energy(self.motion.kinematics, q, u)
            return kinetic, potential_energy(self.motion.kinematics, q)

    def _forces(self, t: Instant) -> tuple[Coordinates, Coordinates, SolvedForces]:
        phase, state = self._state(t)
        q, u = map(as_coordinates, state)
        with precision(self.bits):
            return q, u, self.motion.forces(phase, state)

    def _parts(self, vector: Any) -> tuple[Enclosure, Enclosure]:
        return self._enclosed(vector.real), self._enclosed(vector.imag)

    @property
    def figures(self) -> tuple[ProvedFigure, ...]:
        """Events, the launch, and the state at the end."""
        figures: list[ProvedFigure] = []
        for event in self.motion.events:
            name = f"{event.kind} of {event.name}"
            figures.append(ProvedFigure(name, "s", self._enclosed(event.time)))
        speed = self.launch_speed
        if speed is not None:
            figures.append(ProvedFigure("launch speed", "m/s", speed))
        mechanism = self.problem.mechanism
        end = self._end
        for k, name in enumerate(mechanism.coordinates):
            unit = "rad" if k < len(mechanism.angles) else "m"
            for sign, value, of in (("", end[0][k], unit), ("speed of ", end[1][k], f"{unit}/s")):
                figures.append(ProvedFigure(f"{sign}{name} at the end", of, self._enclosed(value)))
        return tuple(figures)

    @property
    def _end(self) -> State:
        launch = self.motion.launch
        if self.until is None and launch is not None:
            return launch.q, launch.u
        return self._state(Fraction(self.problem.duration) if self.until is None else self.until)[1]

    def _state(self, t: Instant) -> tuple[Phase, State]:
        if isinstance(t, ProvedEvent):
            raise InputError(f"forces change at an event, such as the {t.kind} of {t.name!r}.")
        moment, phases = _seconds("t", t), self.motion.phases
        with precision(self.bits):
            ball = rounded(moment)
            for k, phase in enumerate(phases):
                begun = k == 0 or ball > phase.start
                over = k + 1 < len(phases) and not ball < phases[k + 1].start
                if moment < 0 or not begun or over:
                    continue
                try:
                    return phase, phase.at(ball)
                except ValueError:
                    break
        raise InputError(
            f"t = {t!r} s is outside the proved motion, or within the radius of an event's time."
        )

    def _by_coordinate(self, values: list[Ball]) -> dict[str, Enclosure]:
        names = self.problem.mechanism.coordinates
        return dict(zip(names, map(self._enclosed, values), strict=True))

    def _enclosed(self, ball: Ball) -> Enclosure:
        return Enclosure.of(ball)

    @property
    def lacking(self) -> int:
        """Digits that the worst figure lacks."""
        worst = 0
        for figure in self.figures:
            value, spread = (abs(float(x)) for x in figure.enclosure)
            allowed = max(value, _SMALL) * 10.0**-self.digits
            if spread > allowed:
                worst = max(worst, math.ceil(math.log10(spread / allowed)))
        return worst


def prove(
    problem: Problem,
    digits: int = 12,
    until: Time | None = None,
    *,
    limits: Limits | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> Proof:
    """Enclose a motion to a time, or to the launch; every figure with so many digits.

    Args:
        problem: its doubles are taken exactly.
        digits: of every figure, 1 to 200.
        until: end [s]; the launch, at most the problem's duration, if left out.
        limits: of steps and processor time.
        progress: called with the trial's number and the time that it has proved so far [s].

    Raises:
        InputError: digits or the end are not valid.
        UndecidedError: an inequality stays undecided with more and more digits; it is named.
        SimulationError: a limit is reached.
    """
    if not 1 <= digits <= MOST_DIGITS:
        raise InputError(f"digits = {digits} must be between 1 and {MOST_DIGITS}.")
    end = None if until is None else end_of(until)
    limits, began = limits or Limits(), time.process_time()
    kept, undecided = digits + _SPARE, 0
    for trial in range(1, 100):
        spent = time.process_time() - began
        left = replace(limits, seconds=max(limits.seconds - spent, 0.0))
        bits = math.ceil(kept * math.log2(10)) + _SPARE_BITS
        show = None if progress is None else partial(progress, trial)
        with precision(bits):
            motion = _motion(problem, kept, left, math.inf if end is None else 10.0**-digits, show)
            try:
                motion.run(end)
            except _GrownError:
                kept += max(_MORE, _lost(motion, kept, digits, end))
                continue
            except UndecidedError:
                undecided += 1
                if undecided > _UNDECIDED_TRIALS:
                    raise
                kept += max(_AGAIN * 2 ** (undecided - 1), _lost(motion, kept, digits, end))
                continue
        spent = time.process_time() - began
        proof = Proof(motion, end, digits, bits, trial, spent)
        lacking = proof.lacking
        if not lacking:
            return proof
        kept += lacking + _MORE
    raise SimulationError("not proved: the digits are not reached in a hundred trials.")


def _motion(
    problem: Problem,
    kept: float,
    limits: Limits,
    widest: float,
    progress: Callable[[float], None] | None,
) -> ProvedMotion:
    """A motion with so many digits of the remainders, which ends once its set is too wide."""

    def watch(t: float) -> None:
        if progress is not None:
            progress(t)
        if motion.grown is not None and motion.grown[1] > widest:
            raise _GrownError

    order = max(_LEAST_ORDER, math.ceil(_ORDER * kept))
    motion = ProvedMotion(problem, order, kept * math.log2(10), limits, watch)
    return motion


class _GrownError(Exception):
    """The set of states has grown wider than the digits allow."""


def _lost(motion: ProvedMotion, kept: float, digits: int, end: Fraction | None) -> int:
    """Digits that are lacking if sets grow by as many a second until the end as they did so far."""
    if end is None or motion.grown is None:
        return 0
    since, spread = motion.grown
    lost = (kept + math.log10(spread)) * float(end) / since
    return math.ceil(digits + lost + _MORE - kept)


def _seconds(what: str, t: Time) -> Fraction:
    """A time as it was said, exactly; InputError if it is none."""
    try:
        said = Decimal(t) if isinstance(t, str) else t
        if isinstance(said, Decimal) and abs(said.adjusted()) > _MOST_ZEROS:
            raise ValueError  # as a fraction it might fill the memory
        return Fraction(said)
    except (ValueError, ArithmeticError):
        raise InputError(f"{what} = {t!r} is not a time in seconds.") from None


def end_of(until: Time) -> Fraction:
    """End of a motion as it was said [s]; InputError if it is none."""
    end = _seconds("until", until)
    if not 0 < end <= LONGEST:
        raise InputError(f"until = {until!r} must be positive and at most {LONGEST:g} s.")
    return end
