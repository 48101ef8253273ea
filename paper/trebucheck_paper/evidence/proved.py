"""Enclosures of a throw's quantities, from a proof of its motion, and verdicts that they prove.

A quantity at an event, at an instant or at a maximum (the longest range, the largest speed, the
counterweight's turning point) is read from the proof.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from trebucheck.api.mechanics import (
    ARM_STOP,
    BEYOND_LAUNCH,
    COUNTERWEIGHT,
    HANGER_REST,
    PROJECTILE,
    SLING_REST,
    Ball,
    ClosedInterval,
    Enclosure,
    Extrema,
    Mechanism,
    Problem,
    Proof,
    Standing,
    StopLaw,
    TrebucheckError,
    acb,
    arb,
    as_coordinates,
    half_square,
    kinetic_energy,
    potential_energy,
    precision,
    prove,
    range_without_drag,
)

from . import quantities as of
from .claims import Proved
from .quantities import Formula, ThrowQuantity

_DIGITS = 12
_BEYOND = 0.05  # [s] behind the last instant that is read
_FACTOR = 2.0**-50  # relative: rounding of factors and shifts of formulas, which are doubles

Balls = Mapping[tuple[str, ThrowQuantity], Ball]
"""Enclosures by machine and quantity."""
_Read = Iterator[tuple[ThrowQuantity, Ball]]


class Enclosures:
    """Enclosures of the quantities of throws, by machine.

    Args:
        machines: by name.
        launches: their launch times, about which the best release is looked for [s].
        blows: times by which an acting arm stop is met [s].
    """

    def __init__(
        self,
        machines: Mapping[str, Mechanism],
        launches: Mapping[str, float],
        blows: Mapping[str, float],
    ) -> None:
        self.balls: dict[tuple[str, ThrowQuantity], Ball] = {}
        self.failures: dict[str, str] = {}
        for name, mechanism in machines.items():
            for law, end in (
                (StopLaw.RELEASE_ONCE, launches[name] + BEYOND_LAUNCH + _BEYOND),
                (StopLaw.UNILATERAL, blows[name] + _BEYOND),
            ):
                problem = Problem(mechanism, duration=end, stop_law=law)
                try:
                    proof = prove(problem, _DIGITS)
                except TrebucheckError as error:
                    self.failures[name] = str(error).rstrip(".")
                    continue
                with precision(proof.bits):
                    reader = _Reader(proof)
                    found = reader.read() if law is StopLaw.RELEASE_ONCE else reader.read_acting()
                    for quantity, ball in found:
                        self.balls[name, quantity.under(law)] = ball
            blow = self.balls.get((name, of.FIRST_BLOW))
            if blow is not None:
                # Up to the blow the arm's stop is open, and both laws have one motion.
                self.balls[name, of.ARM_DELAY] = blow - self.balls[name, of.LAUNCH_TIME]

    def proof_of(self, formula: Formula, interval: ClosedInterval | None) -> Proved:
        """Hold a claim on a formula, true for the values of an interval, against its enclosure.

        The formula's own factors are doubles: its enclosure is widened by their rounding.
        """
        with precision(200):
            try:
                ball: Any = formula.value(self.balls)  # pyright: ignore[reportArgumentType]
            except KeyError as error:
                machine, quantity = error.args[0]
                why = self.failures.get(machine, f"{quantity} of {machine!r} is not enclosed")
                return Proved(why=why)
            widened = ball + arb(0, (ball.abs_upper() * _FACTOR).upper())
            known = Enclosure.of(arb(widened))
        if interval is None:
            return proved(known, None, "the claim's rule is no interval of values")
        return proved(known, interval)


def proved(known: Enclosure, interval: ClosedInterval | None, why: str = "") -> Proved:
    """Hold a claim that is true for the values of an interval against an enclosure."""
    value, radius = str(known.value), str(known.radius)
    if interval is None:
        return Proved(value=value, radius=radius, why=why)
    standing = interval.standing(known)
    if standing is Standing.OPEN:
        why = "the enclosure lies across the end of what holds"
        return Proved(value=value, radius=radius, why=why)
    if standing is Standing.INSIDE:
        return Proved(holds=True, value=value, radius=radius)
    off = float(interval.distance(known))
    return Proved(holds=False, value=value, radius=radius, off=off)


class _Reader:
    """Reads quantities from a proof, in the context's precision."""

    def __init__(self, proof: Proof) -> None:
        self.proof, self.motion = proof, proof.motion
        self.mechanism, self.kinematics = proof.problem.mechanism, proof.motion.kinematics
        launch = proof.motion.launch
        assert launch is not None, "a machine that does not launch is refused before"
        self.launch = launch
        self.at_start = self.motion.phases[0].at(arb(0))
        self.at_launch = launch.q, launch.u
        self.extrema = Extrema(proof.motion, proof.digits)

    def read(self) -> _Read:
        """Read all that there are; what is not decided is left out."""
        for name in (HANGER_REST, SLING_REST):
            for event in self.motion.events:
                if event.kind == "release" and event.name == name:
                    yield of.release_time(name), event.time
                    break
            torque = self.motion.forces(self.motion.phases[0], self.at_start).torques.get(name)
            yield of.start_torque(name), arb(0) if torque is None else torque
        yield of.TOTAL_ENERGY, self._energy
        yield of.ENERGY_RATIO, self._ratio(self.at_launch)
        yield from self._thrown()
        yield from self._of_the_launch()
        for part in (self._of_the_counterweight, self._of_the_best_release, self._of_the_fastest):
            yield from part()

    def _of_the_launch(self) -> _Read:
        counterweight = self.motion.point(COUNTERWEIGHT, self.at_launch)[1]
        mass = next(
            self.mechanism.body(each.body).mass
            for each in self.mechanism.markers
            if each.name == COUNTERWEIGHT
        )
        yield of.COUNTERWEIGHT_ENERGY, mass * half_square(counterweight)
        q = as_coordinates(self.at_launch[0])
        yield of.POTENTIAL_ENERGY, potential_energy(self.kinematics, q)
        if self.mechanism.slides:
            yield of.PIVOT_SPEED, self.at_launch[1][-1]

    def read_acting(self) -> _Read:
        """Read what the paper says of a motion whose arm stop acts."""
        yield from self._thrown()
        for event in self.motion.events:
            if event.kind == "impact" and event.name == ARM_STOP:
                yield of.FIRST_BLOW, event.time
                break

    def _thrown(self) -> _Read:
        yield of.LAUNCH_TIME, self.launch.time
        yield of.LAUNCH_SPEED, self._speed(self.at_launch)
        yield of.RANGE, self._range(self.at_launch)

    def _of_the_counterweight(self) -> _Read:
        """Its rightmost point before the launch."""
        turn = self.extrema.rightmost(COUNTERWEIGHT)
        if turn is None:
            return
        x = self.motion.point(COUNTERWEIGHT, (turn.q, turn.u))[0].real
        first, last = (
            self.motion.point(COUNTERWEIGHT, state)[0] for state in (self.at_start, self.at_launch)
        )
        yield of.RIGHTMOST, x
        yield of.SLANT, (x - first.real) / (first.imag - last.imag)

    def _of_the_best_release(self) -> _Read:
        """The longest flight without air."""
        best = self.extrema.best_release(BEYOND_LAUNCH)
        if best is None:
            return
        state = best.q, best.u
        velocity = self.motion.point(PROJECTILE, state)[1]
        longest = self._range(state)
        yield of.BEST_TIME, best.time
        yield of.BEST_ANGLE, acb(velocity).arg()
        yield of.BEST_SPEED, self._speed(state)
        yield of.BEST_RANGE, longest
        yield of.RANGE_GAIN, longest - self._range(self.at_launch)
        phi = best.q[self.mechanism.coordinates.index("phi")]
        yield of.BEST_PHI, phi
        # Absolute angles are positive clockwise: the sling points along (cos phi, -sin phi).
        turned = acb(velocity) * (acb(0, 1) * phi).exp()
        yield of.TO_SLING, abs(turned.arg())

    def _of_the_fastest(self) -> _Read:
        fastest = self.extrema.fastest(BEYOND_LAUNCH)
        if fastest is None:
            return
        state = fastest.q, fastest.u
        yield of.FASTEST_TIME, fastest.time
        yield of.LARGEST_RATIO, self._ratio(state)
        yield of.FASTEST_ANGLE, acb(self.motion.point(PROJECTILE, state)[1]).arg()

    def _speed(self, state: Any) -> Ball:
        return (2 * half_square(self.motion.projectile_velocity(state))).sqrt()

    def _range(self, state: Any) -> Ball:
        """Range without drag of what is let go [m]; the flight is a parabola."""
        return range_without_drag(*self.motion.point(PROJECTILE, state), self.mechanism.gravity)

    @property
    def _energy(self) -> Ball:
        """Total energy at the start [J]."""
        q, u = map(as_coordinates, self.at_start)
        return kinetic_energy(self.kinematics, q, u) + potential_energy(self.kinematics, q)

    def _ratio(self, state: Any) -> Ball:
        """The paper's R."""
        marker = self.mechanism.marker(PROJECTILE)
        assert marker is not None
        mass = self.mechanism.thrown_mass(marker)
        assert mass is not None
        return mass * half_square(self.motion.projectile_velocity(state)) / self._energy
