"""Linear oscillators: springs, dampers and a motor, on slides and angles."""

from __future__ import annotations

import cmath
import math
from dataclasses import replace
from functools import partial

import numpy as np
from pydantic import Field

from ..arrays import FloatArray
from ..elements import GROUND, ConstantTorque, RotationalSpringDamper, SpringDamper
from ..mechanism import Marker, Mechanism
from ..spec import NonNegative, Positive, Real
from .benchmark import (
    Benchmark,
    BenchmarkParameters,
    KnownValue,
    Quantity,
    at,
    coordinate,
    path_figure,
    period,
    speed,
)
from .parts import block, disc, rail

_LINEAR = "linear equation of motion: Lord Rayleigh, The Theory of Sound (1877), Ch. III"
_SPAN = 10.0  # periods, or time constants, of a linear motion


class OscillatorParameters(BenchmarkParameters):
    """A block on a spring and damper, deflected along a level line and let go."""

    mass: Positive = Field(default=2.0, description="[kg]")
    stiffness: Positive = Field(default=50.0, description="[N/m]")
    damping: NonNegative = Field(default=0.0, description="[N s/m]")
    start: Real = Field(
        default=0.3, gt=-1, lt=1, description="deflection; the spring is 1 m long at rest [m]"
    )

    @property
    def rates(self) -> FloatArray:
        """Matrix of the linear system of deflection and speed."""
        return _linear(self.mass, self.stiffness, self.damping)

    @property
    def duration(self) -> float:
        """Time for which the motion is followed [s]."""
        return _SPAN * 2 * math.pi / math.sqrt(-self.rates[1, 0])


class DampedOscillatorParameters(OscillatorParameters):
    """The same with a damper."""

    damping: NonNegative = Field(default=3.0, description="[N s/m]")


class TorsionParameters(BenchmarkParameters):
    """A disc on a rotational spring and damper, turned away from its rest and let go."""

    mass: Positive = Field(default=1.0, description="[kg]")
    inertia: Positive = Field(default=0.05, description="[kg m^2]")
    stiffness: Positive = Field(default=1.5, description="[N m/rad]")
    damping: NonNegative = Field(default=0.02, description="[N m s/rad]")
    rest: Real = Field(default=0.4, description="angle at rest [rad]")
    start: Real = Field(default=3.0, description="angle at the start, from the rest [rad]")

    @property
    def rates(self) -> FloatArray:
        """Matrix of the linear system of the angle from the rest and its speed."""
        return _linear(self.inertia, self.stiffness, self.damping)

    @property
    def duration(self) -> float:
        """Time for which the motion is followed [s]."""
        return _SPAN * 2 * math.pi / math.sqrt(-self.rates[1, 0])


class MotorParameters(BenchmarkParameters):
    """A rotor and its casing, both free, with a motor and a damper between them, from rest."""

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
        """Time for which the motion is followed [s]."""
        return _SPAN * self.constant


def _linear(inertia: float, stiffness: float, damping: float) -> FloatArray:
    return np.array([[0.0, 1.0], [-stiffness / inertia, -damping / inertia]])


def _decay(rates: FloatArray, start: float, t: FloatArray) -> FloatArray:
    """Deflection at times t [s] of a linear system let go at `start`, shape (n,)."""
    decay = -rates[1, 1] / 2
    root = cmath.sqrt(
        decay**2 + rates[1, 0]
    )  # imaginary below critical damping, at which it is zero
    up, down = np.exp((root - decay) * t), np.exp((-root - decay) * t)
    small = np.where(abs(root * t) < 1, root * t, 0.0)
    near_zero = np.exp(-decay * t) * t * np.sinc(1j * small / np.pi)
    ratio = np.where(
        abs(root * t) < 1, near_zero, (up - down) / (2 * root or 1.0)
    )  # e^(-decay t) sinh(root t) / root
    return np.asarray(((up + down) / 2 + decay * ratio).real * start, dtype=np.float64)


def _oscillator(name: str, p: OscillatorParameters) -> Mechanism:
    spring = SpringDamper(
        name="spring",
        body="block",
        point=(0, 0),
        relative_point=(-1, 0),
        stiffness=p.stiffness,
        damping=p.damping,
        rest_length=1,
    )
    return Mechanism(
        name=name,
        bodies=(block(p.mass),),
        joints=(rail("rail", GROUND, "block", "x"),),
        force_elements=(spring,),
        markers=(Marker(name="block", body="block", point=(0, 0)),),
        gravity=9.81,
        start=(p.start,),
    )


def _linear_figures(
    p: OscillatorParameters | TorsionParameters, quantity: Quantity, rest: float
) -> tuple[KnownValue, ...]:
    end = p.duration
    unit = "m" if isinstance(p, OscillatorParameters) else "rad"

    def deflection(t: FloatArray) -> FloatArray:
        return rest + _decay(p.rates, p.start, t)

    tolerance = 1e-11 * max(1.0, abs(p.start))
    name = "largest error of the deflection"
    error = path_figure(name, unit, tolerance, quantity, deflection, end)
    if p.damping > 0:
        final = rest + float(_decay(p.rates, p.start, np.array([end / 4]))[0])
        return (
            error,
            KnownValue(
                "deflection after a quarter of the time", final, unit, 1e-11, at(quantity, end / 4)
            ),
        )
    return (
        error,
        KnownValue("period", end / _SPAN, "s", 1e-11 * end / _SPAN, period(quantity, rest, end)),
    )


def _torsion(p: TorsionParameters) -> Mechanism:
    body, pin = disc("disc", "a", p.mass, p.inertia)
    spring = RotationalSpringDamper(
        name="spring", body="disc", stiffness=p.stiffness, damping=p.damping, rest_angle=p.rest
    )
    return Mechanism(
        name="torsion-pendulum",
        bodies=(body,),
        joints=(pin,),
        force_elements=(spring,),
        markers=(Marker(name="rim", body="disc", point=(math.sqrt(2 * p.inertia / p.mass), 0)),),
        gravity=9.81,
        start=(p.rest + p.start,),
    )


def _motor(p: MotorParameters) -> Mechanism:
    (rotor, rotor_pin), (casing, casing_pin) = (
        disc("rotor", "a", 1.0, p.rotor),
        disc("casing", "b", 5.0, p.casing),
    )
    motor = ConstantTorque(name="motor", body="rotor", relative_to="casing", torque=p.torque)
    damper = RotationalSpringDamper(
        name="damper", body="rotor", relative_to="casing", damping=p.damping
    )
    return Mechanism(
        name="motor",
        bodies=(rotor, casing),
        joints=(rotor_pin, casing_pin),
        force_elements=(motor, damper),
        markers=(Marker(name="rim", body="rotor", point=(0.1, 0)),),
        gravity=9.81,
        start=(0.0, 0.0),
    )


def _motor_figures(p: MotorParameters) -> tuple[KnownValue, ...]:
    end, final = _SPAN * p.constant, p.torque / p.damping
    share = p.casing / (p.casing + p.rotor)  # of the relative motion that is the rotor's

    def angle(t: FloatArray) -> FloatArray:
        return share * final * (t + p.constant * np.expm1(-t / p.constant))

    last = share * final * -math.expm1(-_SPAN)
    name, tolerance = "largest error of the rotor's angle", 1e-11 * max(1.0, abs(final) * end)
    return (
        path_figure(name, "rad", tolerance, coordinate("a"), angle, end),
        KnownValue(
            "rotor's speed at the end",
            last,
            "rad/s",
            1e-11 * max(1.0, abs(last)),
            at(speed("a"), end),
        ),
    )


OSCILLATOR = Benchmark(
    number="E01",
    name="oscillator",
    tags=("tree", "spring", "prismatic", "closed-form"),
    text="block on a spring on a level rail",
    source=_LINEAR,
    parameters=OscillatorParameters,
    build=partial(_oscillator, "oscillator"),
    figures=lambda p: _linear_figures(p, coordinate("x"), 0.0),
)
DAMPED_OSCILLATOR = replace(
    OSCILLATOR,
    number="E02",
    name="damped-oscillator",
    tags=("tree", "spring", "damper", "prismatic", "closed-form"),
    text="block on a spring and a damper on a level rail",
    parameters=DampedOscillatorParameters,
    build=partial(_oscillator, "damped-oscillator"),
)
TORSION_PENDULUM = Benchmark(
    number="E03",
    name="torsion-pendulum",
    tags=("tree", "spring", "damper", "closed-form"),
    text="disc on a rotational spring and damper",
    source=_LINEAR,
    parameters=TorsionParameters,
    build=_torsion,
    figures=lambda p: _linear_figures(p, coordinate("a"), p.rest),
)
MOTOR = Benchmark(
    number="E04",
    name="motor",
    tags=("tree", "motor", "damper", "closed-form"),
    text="motor and damper between a rotor and its casing",
    source="linear equation of motion, solved by an exponential",
    parameters=MotorParameters,
    build=_motor,
    figures=_motor_figures,
)
OSCILLATORS = (OSCILLATOR, DAMPED_OSCILLATOR, TORSION_PENDULUM, MOTOR)
