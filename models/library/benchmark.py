"""Benchmark problems: what they are, their parts, figures read from a motion, closed forms.

Closed forms of a pendulum's motion are Jacobi's elliptic functions. With psi the angle from the
lowest position and omega^2 = (mass times centre's distance times gravity) / (inertia about the
pivot), psi'' = -omega^2 sin psi. E.g. Whittaker, Analytical Dynamics (1937), Ch. IV. What moves
like a pendulum (a trammel, a parallelogram's cranks) has the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import ClassVar, Literal, Protocol

import numpy as np
import scipy  # its parts are loaded when they are first used: a list of problems uses none

from ..arrays import FloatArray
from ..elements import GROUND, PinJoint, PointStop, PrismaticJoint, SlotJoint
from ..errors import SimulationError
from ..mechanism import Body, Marker, Mechanism
from ..problem import Problem, StopLaw
from ..spec import Spec, Vector
from ..trajectory import Trajectory


class ContinuousMotion(Protocol):
    """A motion that is continuous in time, from which figures are read."""

    @property
    def impacts(self) -> Sequence[tuple[float, Mapping[str, float]]]:
        """Time [s] and impulses by stop [N m s or N s] of every impact."""
        ...

    @property
    def rest_times(self) -> Mapping[str, Sequence[float]]:
        """Instants [s] at which each stop ceased to bounce."""
        ...

    def trajectory(self, t: FloatArray, /) -> Trajectory:
        """The motion at times t [s], shape (n,)."""
        ...


@dataclass(frozen=True)
class KnownValue:
    """A number that the problem's motion must have."""

    name: str
    value: float
    unit: str
    tolerance: float
    """Tolerance of the reference, in the unit: the digits that are published or computable."""
    read: Callable[[ContinuousMotion], float]
    basis: Literal["closed form", "quadrature", "published"] = "closed form"
    printed: str = ""
    """Its digits in the source, of a published one."""


@dataclass(frozen=True)
class Condition:
    """Criterion by which the source takes a solution as correct: an error and its limit."""

    text: str
    limit: float
    unit: str
    error: Callable[[ContinuousMotion], float]


class BenchmarkParameters(Spec):
    """Base of the benchmark problems: a subclass has its parameters, mechanism and known values.

    Raises:
        InputError: a value is not finite or outside its range.
    """

    number: ClassVar[str]
    name: ClassVar[str]
    """The mechanism's, too."""
    tags: ClassVar[tuple[str, ...]]
    text: ClassVar[str]
    source: ClassVar[str]
    stop_law: ClassVar[StopLaw] = StopLaw.RELEASE_ONCE

    @property
    def duration(self) -> float:
        """Time for which the motion is followed [s]."""
        raise NotImplementedError(type(self).__name__)

    def mechanism(self) -> Mechanism:
        """The mechanism with these parameters."""
        raise NotImplementedError(type(self).__name__)

    def figures(self) -> tuple[KnownValue, ...]:
        """Numbers that the motion must have."""
        return ()

    def conditions(self) -> tuple[Condition, ...]:
        """Criteria of the source."""
        return ()

    def problem(self) -> Problem:
        """The run that the problem asks for."""
        return Problem(self.mechanism(), duration=self.duration, stop_law=self.stop_law)


@dataclass(frozen=True)
class Benchmark:
    """An entry of the library."""

    number: str
    name: str
    tags: tuple[str, ...]
    text: str
    source: str
    parameters: type[BenchmarkParameters]
    stop_law: StopLaw

    def problem(self, parameters: BenchmarkParameters | None = None) -> Problem:
        """The run that the benchmark asks for.

        Args:
            parameters: of the benchmark's own type; the published ones where left out.
        """
        return (parameters or self.parameters()).problem()


# --- Parts


def rod(name: str, angle: str | None, length: float, mass: float) -> Body:
    """A uniform rod whose frame begins at its end; without an angle its joint must hold it."""
    return Body(
        name=name, angle=angle, mass=mass, centre=(length / 2, 0), inertia=mass * length**2 / 12
    )


def bob(name: str, angle: str, length: float, mass: float) -> Body:
    """A point mass at the end of a massless link, whose frame begins at its other end."""
    return Body(name=name, angle=angle, mass=mass, centre=(length, 0), inertia=0)


def pin(name: str, parent: str, child: str, at: Vector = (0, 0), on: Vector = (0, 0)) -> PinJoint:
    """A pin at a point of the parent and a point of the child."""
    return PinJoint(name=name, parent=parent, child=child, parent_point=at, child_point=on)


def disc(name: str, angle: str, mass: float, inertia: float) -> tuple[Body, PinJoint]:
    """A body that turns about its centre on the ground, and its pin."""
    body = Body(name=name, angle=angle, mass=mass, centre=(0, 0), inertia=inertia)
    return body, pin(f"{name} pin", GROUND, name)


def rail(name: str, parent: str, child: str, coordinate: str) -> PrismaticJoint:
    """A prismatic joint along the parent's x axis."""
    return PrismaticJoint(
        name=name, parent=parent, child=child, parent_point=(0, 0), child_point=(0, 0), axis=(1, 0),
        coordinate=coordinate,
    )  # fmt: skip


def slot(
    name: str,
    child: str,
    axis: Vector,
    on: Vector = (0, 0),
    coordinate: str | None = None,
    parent: str = GROUND,
) -> SlotJoint:
    """A slot along an axis through the parent's origin, in which a point of the child runs."""
    return SlotJoint(
        name=name, parent=parent, child=child, parent_point=(0, 0), child_point=on, axis=axis,
        coordinate=coordinate,
    )  # fmt: skip


def block(mass: float) -> Body:
    """A body that slides without turning."""
    return Body(name="block", mass=mass, centre=(0, 0), inertia=0.01 * mass)


def floor(
    name: str, body: str, point: Vector, *, height: float = 0.0, closed: bool = False, e: float = 0
) -> PointStop:
    """A level floor [m] that stops a point of a body, with a coefficient of restitution e."""
    return PointStop(
        name=name, body=body, point=point, normal=(0, 1), offset=height, closed=closed,
        restitution=e,
    )  # fmt: skip


def marker(name: str, body: str, point: Vector = (0, 0)) -> Marker:
    """A marker on a body."""
    return Marker(name=name, body=body, point=point)


# --- Figures

_GRID = 500  # samples among which sign changes are looked for
_SAMPLES = 400  # at which a motion is compared with a closed form

Quantity = Callable[[Trajectory], FloatArray]
"""Values of a trajectory's n samples, shape (n,)."""


@dataclass(frozen=True)
class Sum:
    """A sum of coordinates [rad or m] with factors, or of their rates [per s]."""

    factors: Mapping[str, float]
    """Factors by coordinate."""
    of_rates: bool = False

    def __call__(self, trajectory: Trajectory) -> FloatArray:
        """Values at the samples, shape (n,)."""
        values = trajectory.u if self.of_rates else trajectory.q
        names, total = trajectory.mechanism.coordinates, np.zeros(len(values))
        for name, factor in self.factors.items():
            total = total + factor * values[:, names.index(name)]
        return total


def coordinate(name: str) -> Sum:
    """A coordinate [rad or m]."""
    return Sum({name: 1.0})


def speed(name: str) -> Sum:
    """A coordinate's rate [rad/s or m/s]."""
    return Sum({name: 1.0}, of_rates=True)


def marker_position(name: str, axis: int) -> Quantity:
    """A component of a marker's position [m]: along x for axis 0, along y for axis 1."""
    return lambda trajectory: trajectory.marker(name).position[:, axis]


@dataclass(frozen=True)
class At:
    """A quantity at an instant."""

    quantity: Quantity
    t: float
    """[s]"""

    def __call__(self, motion: ContinuousMotion) -> float:
        """Value in a motion."""
        return float(self.quantity(motion.trajectory(np.array([self.t])))[0])


@dataclass(frozen=True)
class Passage:
    """Time at which a quantity passes a level for the n-th time."""

    quantity: Quantity
    level: float
    until: float
    """Until which it is looked for [s]."""
    count: int = 1

    def __call__(self, motion: ContinuousMotion) -> float:
        """Time in a motion [s].

        Raises:
            SimulationError: it does not pass so often.
        """
        times = np.linspace(0.0, self.until, _GRID)
        values = self.quantity(motion.trajectory(times)) - self.level
        changes = np.flatnonzero((values[:-1] * values[1:] < 0) | (values[1:] == 0))
        if len(changes) < self.count:
            raise SimulationError(
                f"a level of {self.level:.6g} is passed {len(changes)} times by "
                f"t = {self.until:.6g} s, not {self.count}."
            )
        i = int(changes[self.count - 1])

        def distance(t: float) -> float:
            return At(self.quantity, t)(motion) - self.level

        between = times[i], times[i + 1]
        return float(scipy.optimize.brentq(distance, *between, xtol=1e-15, rtol=1e-15))


@dataclass(frozen=True)
class Period:
    """Period of an oscillation about a level, from the first and third passage."""

    quantity: Quantity
    level: float
    until: float
    """Until which the passages are looked for [s]."""

    @property
    def passages(self) -> tuple[Passage, Passage]:
        """The first and the third."""
        first, third = (Passage(self.quantity, self.level, self.until, n) for n in (1, 3))
        return first, third

    def __call__(self, motion: ContinuousMotion) -> float:
        """Period in a motion [s]; SimulationError as of :class:`Passage`."""
        first, third = self.passages
        return third(motion) - first(motion)


@dataclass(frozen=True)
class ImpactTime:
    """Time of an impact, counted from zero."""

    index: int

    def __call__(self, motion: ContinuousMotion) -> float:
        """Time in a motion [s]."""
        return motion.impacts[self.index][0]


def path_figure(
    name: str,
    unit: str,
    tolerance: float,
    quantity: Quantity,
    exact: Callable[[FloatArray], FloatArray],
    until: float,
) -> KnownValue:
    """The largest difference of a quantity from a closed form over [0, until] s as a figure.

    Args:
        exact: of times [s], shape (n,), the quantity, shape (n,).
    """

    def read(motion: ContinuousMotion) -> float:
        times = np.linspace(0.0, until, _SAMPLES)
        return float(np.abs(quantity(motion.trajectory(times)) - exact(times)).max())

    return KnownValue(name, 0.0, unit, tolerance, read)


def energy_figure(tolerance: float, until: float) -> KnownValue:
    """The largest change of the energy of a conservative motion over [0, until] s as a figure."""

    def read(motion: ContinuousMotion) -> float:
        energy = motion.trajectory(np.linspace(0.0, until, _SAMPLES)).total_energy
        return float(np.abs(energy - energy[0]).max())

    return KnownValue("largest change of the energy", 0.0, "J", tolerance, read)


def suite_condition(
    name: str, length: float, angle: Callable[[FloatArray], FloatArray], until: float, samples: int
) -> Condition:
    """Criterion of the MBS benchmark suite for high precision: a marker's position error.

    It is the root mean square over the samples and components, each divided by its exact value, or
    by 1 mm where that is larger.

    Args:
        name: of a marker that moves on a circle about the origin.
        length: radius of the circle [m].
        angle: of times [s], shape (n,), its exact angle, shape (n,) [rad].
        until: end of the comparison [s].
    """

    def read(motion: ContinuousMotion) -> float:
        times = np.linspace(0.0, until, samples + 1)[1:]
        exact = length * np.stack([np.cos(angle(times)), -np.sin(angle(times))], axis=1)
        position = motion.trajectory(times).marker(name).position
        errors = (position - exact) / np.maximum(abs(exact), 1e-3)
        return float(np.sqrt(np.mean(errors**2)))

    text = f"relative error of {name}'s position, RMS, threshold 1e-3 m ('high precision')"
    return Condition(text, 1e-3, "", read)


# --- Closed forms

LOWEST = math.pi / 2  # [rad] angle of a link that hangs straight down


def swing_period(omega: float, amplitude: float) -> float:
    """Period of a swing [s].

    Args:
        omega: of small swings [rad/s].
        amplitude: from the lowest position, below pi [rad].
    """
    return 4.0 * float(scipy.special.ellipkm1(math.cos(amplitude / 2) ** 2)) / omega


def swing(omega: float, amplitude: float, t: FloatArray) -> FloatArray:
    """Angle from the lowest position at times t [s], let go at `amplitude` [rad], shape (n,)."""
    modulus = math.sin(amplitude / 2)
    _, cn, dn, _ = scipy.special.ellipj(omega * t, modulus**2)
    return np.asarray(2.0 * np.arcsin(np.clip(modulus * cn / dn, -1.0, 1.0)), dtype=np.float64)


def turn_period(omega: float, top_speed: float) -> float:
    """Time of a turn of a pendulum that goes over the top [s].

    Args:
        omega: of small swings [rad/s].
        top_speed: in the highest position [rad/s].
    """
    bottom = math.sqrt(top_speed**2 + 4.0 * omega**2)
    return 4.0 * float(scipy.special.ellipkm1((top_speed / bottom) ** 2)) / bottom


def turn(omega: float, top_speed: float, t: FloatArray) -> FloatArray:
    """Angle since the highest position at times t [s] of a turning pendulum, shape (n,)."""
    bottom = math.sqrt(top_speed**2 + 4.0 * omega**2)
    half = turn_period(omega, top_speed) / 2.0
    # From the lowest position it is 2 am(bottom t / 2); the quarter period of am is half a turn.
    squared_modulus = (2.0 * omega / bottom) ** 2
    _, _, _, amplitude = scipy.special.ellipj(bottom * (t - half) / 2.0, squared_modulus)
    return np.asarray(2.0 * amplitude + math.pi, dtype=np.float64)


@dataclass(frozen=True)
class Swing:
    """The motion of what is let go from rest and moves like a pendulum."""

    angle: str
    """Name of the coordinate."""
    omega: float
    """Frequency of small swings [rad/s]."""
    amplitude: float
    """From the lowest position [rad]."""
    lowest: float = LOWEST
    """The coordinate in the lowest position [rad]."""

    @property
    def period(self) -> float:
        """[s]."""
        return swing_period(self.omega, self.amplitude)

    def at(self, t: FloatArray) -> FloatArray:
        """The coordinate at times t [s], shape (n,) [rad]."""
        return self.lowest + swing(self.omega, self.amplitude, t)

    def figures(
        self, end: float, time_tolerance: float, angle_tolerance: float
    ) -> tuple[KnownValue, ...]:
        """Its period and its path up to `end` [s], with their tolerances [s, rad]."""
        quantity, name = coordinate(self.angle), "largest error of the angle"
        read = Period(quantity, self.lowest, end)
        return (
            KnownValue("period", self.period, "s", time_tolerance, read),
            path_figure(name, "rad", angle_tolerance, quantity, self.at, end),
        )


def time_between(
    start: float,
    end: float,
    start_speed: float,
    inertia: Callable[[float], float],
    potential: Callable[[float], float],
) -> float:
    """Time of a motion that does not turn back [s].

    Args:
        start, end: of the coordinate [rad or m].
        start_speed: of the coordinate, not zero.
        inertia: reduced to the coordinate [kg m^2 or kg].
        potential: energy [J].
    """
    energy = inertia(start) * start_speed**2 / 2 + potential(start)
    # Over a whole turn the integrand is periodic and smooth: pieces of a quarter turn are
    # integrated to rounding.
    pieces = max(1, math.ceil(abs(end - start) / (math.pi / 4)))
    knots = [start + (end - start) * k / pieces for k in range(pieces + 1)]
    return abs(_integral(lambda a: math.sqrt(inertia(a) / (2 * (energy - potential(a)))), knots))


def slow_swing_period(
    middle: float, amplitude: float, most: float, inertia: Callable[[float], float]
) -> float:
    """Period of a swing in the potential -most cos(a - middle) [s].

    With a = middle + amplitude cos(c) and the difference of the cosines as a product, what vanishes
    at the turning points cancels: the integrand over c is smooth.

    Args:
        middle: lowest position [rad].
        amplitude: of the swing, below pi [rad].
        most: amplitude of the potential energy [J].
        inertia: reduced to the coordinate [kg m^2].
    """

    def slowness(c: float) -> float:
        # (1 - cos(c)) / 2 and (1 + cos(c)) / 2 of the amplitude are left to the two turning points.
        left = np.sinc(amplitude / math.pi * np.array([math.sin(c / 2) ** 2, math.cos(c / 2) ** 2]))
        return math.sqrt(inertia(middle + amplitude * math.cos(c)) / (most * float(left.prod())))

    return 2 * _integral(slowness, [math.pi * k / 16 for k in range(17)])


def _integral(function: Callable[[float], float], knots: list[float]) -> float:
    integral = partial(scipy.integrate.quad, function, epsabs=0.0, epsrel=1e-13)
    return math.fsum(integral(a, b)[0] for a, b in pairwise(knots))
