"""Problems of one joint or force element: springs, a motor, welds, slides and free bodies."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from ..arrays import FloatArray
from ..elements import (
    GROUND,
    ConstantForce,
    ConstantTorque,
    FreeJoint,
    RotationalSpringDamper,
    SpringDamper,
    WeldJoint,
)
from ..mechanism import Body, Mechanism
from ..spec import NonNegative, Positive, Real, Vector
from .benchmark import (
    At,
    BenchmarkParameters,
    KnownValue,
    Passage,
    Period,
    Swing,
    block,
    coordinate,
    disc,
    marker,
    marker_position,
    path_figure,
    pin,
    rail,
    rod,
    speed,
    time_between,
)

_LINEAR = "linear equation of motion: Lord Rayleigh, The Theory of Sound (1877), Ch. III"
_SPAN = 10.0  # periods, or time constants, of a linear motion
_CENTRE: Vector = (0.3, -0.1)  # [m] of the thrown plate, from its corner


@dataclass(frozen=True)
class LinearOscillation:
    """Motion of what is deflected on a linear spring and damper and let go."""

    coordinate: str
    unit: str
    rest: float
    """The coordinate without deflection [m or rad]."""
    start: float
    """Deflection [m or rad]."""
    inertia: float
    """[kg or kg m^2]"""
    stiffness: float
    damping: float

    @property
    def duration(self) -> float:
        """Ten periods without the damper [s]."""
        return _SPAN * 2 * math.pi / math.sqrt(self.stiffness / self.inertia)

    def at(self, t: FloatArray) -> FloatArray:
        """The coordinate at times t [s], shape (n,)."""
        decay = self.damping / self.inertia / 2
        # Imaginary below critical damping, at which it is zero.
        root = cmath.sqrt(decay**2 - self.stiffness / self.inertia)
        up, down = np.exp((root - decay) * t), np.exp((-root - decay) * t)
        small = np.where(abs(root * t) < 1, root * t, 0.0)
        near_zero = np.exp(-decay * t) * t * np.sinc(1j * small / np.pi)
        # e^(-decay t) sinh(root t) / root
        ratio = np.where(abs(root * t) < 1, near_zero, (up - down) / (2 * root or 1.0))
        deflection = ((up + down) / 2 + decay * ratio).real * self.start
        return np.asarray(self.rest + deflection, dtype=np.float64)


class LinearParameters(BenchmarkParameters):
    """Base of the problems of a linear spring and damper."""

    @property
    def motion(self) -> LinearOscillation:
        """Motion in closed form."""
        raise NotImplementedError(type(self).__name__)

    @property
    def duration(self) -> float:
        return self.motion.duration

    def figures(self) -> tuple[KnownValue, ...]:
        """Path, and the period or, with a damper, the deflection after a quarter of the time."""
        motion, end = self.motion, self.duration
        quantity, unit = coordinate(motion.coordinate), motion.unit
        tolerance, name = 1e-11 * max(1.0, abs(motion.start)), "largest error of the deflection"
        error = path_figure(name, unit, tolerance, quantity, motion.at, end)
        if motion.damping > 0:
            name, read = "deflection after a quarter of the time", At(quantity, end / 4)
            final = float(motion.at(np.array([end / 4]))[0])
            return error, KnownValue(name, final, unit, 1e-11, read)
        cycle, read = end / _SPAN, Period(quantity, motion.rest, end)
        return error, KnownValue("period", cycle, "s", 1e-11 * cycle, read)


class OscillatorParameters(LinearParameters):
    """A block on a spring and damper, deflected along a level line and let go."""

    number = "E01"
    name = "oscillator"
    tags = ("tree", "spring", "prismatic", "closed-form")
    text = "block on a spring on a level rail"
    source = _LINEAR

    mass: Positive = Field(default=2.0, description="[kg]")
    stiffness: Positive = Field(default=50.0, description="[N/m]")
    damping: NonNegative = Field(default=0.0, description="[N s/m]")
    start: Real = Field(
        default=0.3, gt=-1, lt=1, description="deflection; the spring is 1 m long at rest [m]"
    )

    @property
    def motion(self) -> LinearOscillation:
        return LinearOscillation("x", "m", 0.0, self.start, self.mass, self.stiffness, self.damping)

    def mechanism(self) -> Mechanism:
        spring = SpringDamper(
            name="spring", body="block", point=(0, 0), relative_point=(-1, 0),
            stiffness=self.stiffness, damping=self.damping, rest_length=1,
        )  # fmt: skip
        return Mechanism(
            name=self.name,
            bodies=(block(self.mass),),
            joints=(rail("rail", GROUND, "block", "x"),),
            force_elements=(spring,),
            markers=(marker("block", "block"),),
            gravity=9.81,
            start=(self.start,),
        )


class DampedOscillatorParameters(OscillatorParameters):
    """The same with a damper."""

    number = "E02"
    name = "damped-oscillator"
    tags = ("tree", "spring", "damper", "prismatic", "closed-form")
    text = "block on a spring and a damper on a level rail"

    damping: NonNegative = Field(default=3.0, description="[N s/m]")


class TorsionParameters(LinearParameters):
    """A disc on a rotational spring and damper, turned away from its rest and let go."""

    number = "E03"
    name = "torsion-pendulum"
    tags = ("tree", "spring", "damper", "closed-form")
    text = "disc on a rotational spring and damper"
    source = _LINEAR

    mass: Positive = Field(default=1.0, description="[kg]")
    inertia: Positive = Field(default=0.05, description="[kg m^2]")
    stiffness: Positive = Field(default=1.5, description="[N m/rad]")
    damping: NonNegative = Field(default=0.02, description="[N m s/rad]")
    rest: Real = Field(default=0.4, description="angle at rest [rad]")
    start: Real = Field(default=3.0, description="angle at the start, from the rest [rad]")

    @property
    def motion(self) -> LinearOscillation:
        p = self
        return LinearOscillation("a", "rad", p.rest, p.start, p.inertia, p.stiffness, p.damping)

    def mechanism(self) -> Mechanism:
        body, pivot = disc("disc", "a", self.mass, self.inertia)
        spring = RotationalSpringDamper(
            name="spring", body="disc", stiffness=self.stiffness, damping=self.damping,
            rest_angle=self.rest,
        )  # fmt: skip
        return Mechanism(
            name=self.name,
            bodies=(body,),
            joints=(pivot,),
            force_elements=(spring,),
            markers=(marker("rim", "disc", (math.sqrt(2 * self.inertia / self.mass), 0)),),
            gravity=9.81,
            start=(self.rest + self.start,),
        )


class MotorParameters(BenchmarkParameters):
    """A rotor and its casing, both free, with a motor and a damper between them, from rest."""

    number = "E04"
    name = "motor"
    tags = ("tree", "motor", "damper", "closed-form")
    text = "motor and damper between a rotor and its casing"
    source = "linear equation of motion, solved by an exponential"

    rotor: Positive = Field(default=0.02, description="inertia of the rotor [kg m^2]")
    casing: Positive = Field(default=0.3, description="inertia of the casing [kg m^2]")
    torque: Real = Field(default=0.8, description="of the motor, on the rotor [N m]")
    damping: Positive = Field(default=0.05, description="between the two [N m s/rad]")

    @property
    def constant(self) -> float:
        """Time constant of the relative speed [s]."""
        return 1.0 / (self.damping * (1.0 / self.rotor + 1.0 / self.casing))

    @property
    def duration(self) -> float:
        return _SPAN * self.constant

    def mechanism(self) -> Mechanism:
        rotor, rotor_pin = disc("rotor", "a", 1.0, self.rotor)
        casing, casing_pin = disc("casing", "b", 5.0, self.casing)
        motor = ConstantTorque(name="motor", body="rotor", relative_to="casing", torque=self.torque)
        damper = RotationalSpringDamper(
            name="damper", body="rotor", relative_to="casing", damping=self.damping
        )
        return Mechanism(
            name=self.name,
            bodies=(rotor, casing),
            joints=(rotor_pin, casing_pin),
            force_elements=(motor, damper),
            markers=(marker("rim", "rotor", (0.1, 0)),),
            gravity=9.81,
            start=(0.0, 0.0),
        )

    def figures(self) -> tuple[KnownValue, ...]:
        end, final = self.duration, self.torque / self.damping
        # The rotor's part of the relative motion.
        share = self.casing / (self.casing + self.rotor)

        def angle(t: FloatArray) -> FloatArray:
            return share * final * (t + self.constant * np.expm1(-t / self.constant))

        last = share * final * -math.expm1(-_SPAN)
        name, tolerance = "largest error of the rotor's angle", 1e-11 * max(1.0, abs(final) * end)
        error = path_figure(name, "rad", tolerance, coordinate("a"), angle, end)
        name, tolerance = "rotor's speed at the end", 1e-11 * max(1.0, abs(last))
        return error, KnownValue(name, last, "rad/s", tolerance, At(speed("a"), end))


class WeldedRodsParameters(BenchmarkParameters):
    """A pendulum of two equal rods that are welded together at an angle, let go from rest."""

    number = "E05"
    name = "welded-rods"
    tags = ("tree", "weld", "closed-form")
    text = "pendulum of two rods that are welded together at an angle"
    source = "moves as a pendulum: E. T. Whittaker, Analytical Dynamics (4th ed., 1937), Ch. IV"

    length: Positive = Field(default=0.8, description="of each rod [m]")
    mass: Positive = Field(default=1.5, description="of each rod [kg]")
    bend: Real = Field(
        default=1.2, gt=-3, lt=3, description="angle of the second rod from the first [rad]"
    )
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    amplitude: Real = Field(
        default=2.0, gt=0, lt=math.pi, description="start, from the lowest position [rad]"
    )

    @property
    def swing(self) -> Swing:
        """Its motion."""
        # In the first rod's frame, x + i y [m].
        centre = self.length * (1.5 + 0.5 * cmath.exp(-1j * self.bend)) / 2
        outer = self.length * abs(1 + 0.5 * cmath.exp(-1j * self.bend))
        inertia = self.mass * (self.length**2 / 3 + self.length**2 / 12 + outer**2)
        omega = math.sqrt(2 * self.mass * self.g * abs(centre) / inertia)
        return Swing("a", omega, self.amplitude, lowest=math.pi / 2 + cmath.phase(centre))

    @property
    def duration(self) -> float:
        return 2.5 * self.swing.period

    def mechanism(self) -> Mechanism:
        end = (self.length, 0.0)
        weld = WeldJoint(
            name="weld", parent="upper", child="lower", parent_point=end, child_point=(0, 0),
            angle=self.bend,
        )  # fmt: skip
        return Mechanism(
            name=self.name,
            bodies=(
                rod("upper", "a", self.length, self.mass),
                rod("lower", None, self.length, self.mass),
            ),
            joints=(pin("pivot", GROUND, "upper"), weld),
            markers=(marker("tip", "lower", end),),
            gravity=self.g,
            start=(self.swing.lowest + self.amplitude,),
        )

    def figures(self) -> tuple[KnownValue, ...]:
        return self.swing.figures(self.duration, 1e-11 * self.swing.period, 1e-10)


class InclineParameters(BenchmarkParameters):
    """A block on a smooth level rail under gravity in a slanting direction, with a start speed."""

    number = "E06"
    name = "incline"
    tags = ("tree", "prismatic", "gravity", "closed-form")
    text = "block on a rail under gravity in a slanting direction"
    source = "G. Galilei, Discorsi (1638): constant acceleration"

    mass: Positive = Field(default=4.0, description="[kg]")
    slope: Real = Field(
        default=0.3, ge=-1.5, le=1.5, description="of gravity, from the rail's normal [rad]"
    )
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    speed: Real = Field(default=-2.0, description="at the start [m/s]")

    @property
    def duration(self) -> float:
        return 3.0

    def mechanism(self) -> Mechanism:
        return Mechanism(
            name=self.name,
            bodies=(block(self.mass),),
            joints=(rail("rail", GROUND, "block", "x"),),
            markers=(marker("block", "block"),),
            gravity=self.g,
            gravity_direction=(math.sin(self.slope), -math.cos(self.slope)),
            start=(0.0,),
            start_speeds=(self.speed,),
        )

    def figures(self) -> tuple[KnownValue, ...]:
        x, end, along = coordinate("x"), self.duration, self.g * math.sin(self.slope)
        final = self.speed * end + along * end**2 / 2
        tolerance = 1e-12 * (abs(self.speed) * end + abs(along) * end**2)

        def path(t: FloatArray) -> FloatArray:
            return self.speed * t + along * t**2 / 2

        return (
            KnownValue("position at the end", final, "m", tolerance, At(x, end)),
            path_figure("largest error of the position", "m", tolerance, x, path, end),
        )


class BeadParameters(BenchmarkParameters):
    """A bead that slides without friction on a rotating arm, without gravity."""

    number = "E09"
    name = "bead"
    tags = ("tree", "prismatic", "quadrature")
    text = "bead that slides outwards on a rotating arm"
    source = (
        "angular momentum and energy are conserved; "
        "E. T. Whittaker, Analytical Dynamics (4th ed., 1937), Ch. III"
    )

    mass: Positive = Field(default=0.5, description="of the bead [kg]")
    inertia: Positive = Field(default=0.1, description="of the arm about its pivot [kg m^2]")
    start: Positive = Field(default=0.2, description="distance of the bead from the pivot [m]")
    speed: Positive = Field(default=0.1, description="of the bead along the arm at the start [m/s]")
    turning: Real = Field(default=5.0, description="of the arm at the start [rad/s]")
    end: Positive = Field(default=3.0, description="distance whose time of passage is known [m]")

    @property
    def momentum(self) -> float:
        """Angular momentum [kg m^2/s]."""
        return (self.inertia + self.mass * self.start**2) * self.turning

    @property
    def passage(self) -> float:
        """Time at which the bead passes the end [s]."""

        def turning_energy(r: float) -> float:
            return self.momentum**2 / (2 * (self.inertia + self.mass * r**2))

        return time_between(self.start, self.end, self.speed, lambda r: self.mass, turning_energy)

    @property
    def duration(self) -> float:
        return 1.2 * self.passage

    def mechanism(self) -> Mechanism:
        arm, pivot = disc("arm", "a", 1.0, self.inertia)
        return Mechanism(
            name=self.name,
            bodies=(arm, Body(name="bead", mass=self.mass, centre=(0, 0), inertia=0)),
            joints=(pivot, rail("rod", "arm", "bead", "r")),
            markers=(marker("bead", "bead"),),
            gravity=0,
            start=(0.0, self.start),
            start_speeds=(self.turning, self.speed),
        )

    def figures(self) -> tuple[KnownValue, ...]:
        time, read = self.passage, Passage(coordinate("r"), self.end, self.duration)
        turning = self.momentum / (self.inertia + self.mass * self.end**2)
        tolerance = 1e-11 * max(1.0, abs(turning))
        return (
            KnownValue("passage of the end", time, "s", 1e-11 * time, read, "quadrature"),
            KnownValue("arm's speed then", turning, "rad/s", tolerance, At(speed("a"), time)),
        )


class ThrownPlateParameters(BenchmarkParameters):
    """A free body thrown with spin under gravity and a constant force at its centre of mass."""

    number = "E07"
    name = "thrown-plate"
    tags = ("free", "force", "closed-form")
    text = "free body thrown with spin under a constant force"
    source = "G. Galilei, Discorsi (1638): the centre of mass moves on a parabola"

    mass: Positive = Field(default=3.0, description="[kg]")
    inertia: Positive = Field(default=0.2, description="[kg m^2]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    force_x: Real = Field(default=-4.0, description="constant force along x [N]")
    force_y: Real = Field(default=2.0, description="constant force along y [N]")
    speed_x: Real = Field(
        default=6.0, description="of the centre of mass at the start, along x [m/s]"
    )
    speed_y: Real = Field(
        default=9.0, description="of the centre of mass at the start, along y [m/s]"
    )
    spin: Real = Field(default=7.0, description="clockwise [rad/s]")

    @property
    def duration(self) -> float:
        return 2.0

    def mechanism(self) -> Mechanism:
        # The coordinates are those of a corner, from which the centre of mass stands at _CENTRE.
        force = (self.force_x, self.force_y)
        corner = complex(self.speed_x, self.speed_y) + 1j * self.spin * complex(*_CENTRE)
        return Mechanism(
            name=self.name,
            bodies=(
                Body(name="plate", angle="a", mass=self.mass, centre=_CENTRE, inertia=self.inertia),
            ),
            joints=(FreeJoint(name="flight", child="plate", coordinates=("x", "y")),),
            force_elements=(ConstantForce(name="wind", body="plate", point=_CENTRE, force=force),),
            markers=(marker("centre", "plate", _CENTRE), marker("corner", "plate")),
            gravity=self.g,
            start=(0.0, 0.0, 0.0),
            start_speeds=(self.spin, corner.real, corner.imag),
        )

    def figures(self) -> tuple[KnownValue, ...]:
        pull = self.force_x / self.mass, self.force_y / self.mass - self.g

        def path(axis: int, rate: float) -> KnownValue:
            def exact(t: FloatArray) -> FloatArray:
                return _CENTRE[axis] + rate * t + pull[axis] * t**2 / 2

            name, tolerance = (
                f"largest error of the centre's {'xy'[axis]}",
                1e-11 * max(1.0, abs(rate)),
            )
            quantity = marker_position("centre", axis)
            return path_figure(name, "m", tolerance, quantity, exact, self.duration)

        turned, read = self.spin * self.duration, At(coordinate("a"), self.duration)
        tolerance = 1e-11 * max(1.0, abs(turned))
        angle = KnownValue("angle at the end", turned, "rad", tolerance, read)
        return path(0, self.speed_x), path(1, self.speed_y), angle


class SpringPendulumParameters(BenchmarkParameters):
    """A point mass in the plane on a spring without rest length, pushed from its equilibrium."""

    number = "E08"
    name = "spring-pendulum"
    tags = ("free", "spring", "closed-form")
    text = "mass in the plane on a spring without length of its own, on an ellipse"
    source = "I. Newton, Principia (1687), Book I, Prop. X: a force in proportion to the distance"

    mass: Positive = Field(default=1.0, description="[kg]")
    stiffness: Positive = Field(default=20.0, description="[N/m]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    aside: Real = Field(default=0.2, description="start, aside of the rest [m]")
    speed_y: Real = Field(default=0.8, description="at the start, upwards [m/s]")

    @property
    def omega(self) -> float:
        """Frequency of the oscillation, the same in all directions [rad/s]."""
        return math.sqrt(self.stiffness / self.mass)

    @property
    def duration(self) -> float:
        return _SPAN * 2 * math.pi / self.omega

    @property
    def rest(self) -> float:
        """Height at rest [m]."""
        return -self.mass * self.g / self.stiffness

    def mechanism(self) -> Mechanism:
        spring = SpringDamper(
            name="spring", body="bob", point=(0, 0), relative_point=(0, 0), stiffness=self.stiffness
        )
        inertia = 0.001 * self.mass
        return Mechanism(
            name=self.name,
            bodies=(Body(name="bob", angle="a", mass=self.mass, centre=(0, 0), inertia=inertia),),
            joints=(FreeJoint(name="plane", child="bob", coordinates=("x", "y")),),
            force_elements=(spring,),
            markers=(marker("bob", "bob"),),
            gravity=self.g,
            start=(0.0, self.aside, self.rest),
            start_speeds=(0.0, 0.0, self.speed_y),
        )

    def figures(self) -> tuple[KnownValue, ...]:
        end, w = self.duration, self.omega
        tolerance = 1e-11 * max(1.0, abs(self.aside), abs(self.speed_y) / w)

        def x(t: FloatArray) -> FloatArray:
            return self.aside * np.cos(w * t)

        def y(t: FloatArray) -> FloatArray:
            return self.rest + self.speed_y / w * np.sin(w * t)

        return (
            path_figure("largest error of x", "m", tolerance, coordinate("x"), x, end),
            path_figure("largest error of y", "m", tolerance, coordinate("y"), y, end),
        )


SINGLE_ELEMENTS = (
    OscillatorParameters,
    DampedOscillatorParameters,
    TorsionParameters,
    MotorParameters,
    WeldedRodsParameters,
    InclineParameters,
    ThrownPlateParameters,
    SpringPendulumParameters,
    BeadParameters,
)
