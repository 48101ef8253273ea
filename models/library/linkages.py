"""Linkages of one degree of freedom: loops of pins and slots, some redundant or singular."""

from __future__ import annotations

import cmath
import math
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from ..arrays import FloatArray
from ..elements import GROUND, ConstantTorque, SpringDamper
from ..mechanism import Body, Mechanism
from ..spec import NonNegative, Positive, Real
from .benchmark import (
    LOWEST,
    At,
    BenchmarkParameters,
    Condition,
    KnownValue,
    Passage,
    Period,
    Sum,
    Swing,
    coordinate,
    energy_figure,
    marker,
    path_figure,
    pin,
    rod,
    slot,
    slow_swing_period,
    suite_condition,
    time_between,
    turn,
    turn_period,
)

UPRIGHT = -math.pi / 2  # [rad] angle of a link that points up


# Of the energy: nearer to its upright position the crank would stay there for long.
_UPRIGHT_SHARE = 0.01


_SUITE = "M. Gonzalez et al., MBS benchmark library (Univ. of A Coruna, 2005)"


class FourBarParameters(BenchmarkParameters):
    """N windows of equal uniform links: N + 1 upright cranks and N level couplers."""

    number = "A02"
    name = "n-four-bar"
    tags = ("loop", "singular", "closed-form", "scalable", "IFToMM")
    text = "N four-bar linkages in a row that pass their singular positions"
    source = (
        f"{_SUITE}, problem A02, in the IFToMM library; "
        "E. Bayo, A. Avello, Nonlinear Dyn. 5 (1994) 209"
    )

    N: int = Field(default=1, ge=1, le=100, description="number of windows")
    length: Positive = Field(default=1.0, description="of each link [m]")
    mass: Positive = Field(default=1.0, description="of each link [kg]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    speed: Positive = Field(
        default=1.0, description="of B0, the first crank's upper end, towards +x at the start [m/s]"
    )

    @property
    def omega(self) -> float:
        """Frequency of small swings [rad/s]: all cranks turn as one, the couplers do not turn."""
        moment, inertia = (self.N + 1) / 2 + self.N, (self.N + 1) / 3 + self.N
        return math.sqrt(moment * self.g / (inertia * self.length))

    def angle(self, t: FloatArray) -> FloatArray:
        """Angle of every crank at times t [s], shape (n,) [rad]."""
        return UPRIGHT + turn(self.omega, self.turning, t)

    @property
    def turning(self) -> float:
        """Speed of the cranks at the start [rad/s]."""
        return self.speed / self.length

    @property
    def duration(self) -> float:
        """10 s at 1 m and 1 m/s; at least one and a half turns."""
        ten = 10.0 * math.sqrt(self.length * 9.81 / self.g)
        return max(ten, 1.5 * turn_period(self.omega, self.turning))

    def mechanism(self) -> Mechanism:
        n, end = self.N, (self.length, 0.0)
        cranks = [rod(f"crank {i}", f"a{i}", self.length, self.mass) for i in range(n + 1)]
        couplers = [rod(f"coupler {i}", f"b{i}", self.length, self.mass) for i in range(1, n + 1)]
        joints = [
            pin(f"pivot {i}", GROUND, f"crank {i}", (i * self.length, 0)) for i in range(n + 1)
        ]
        for i in range(1, n + 1):
            joints.append(pin(f"left {i}", f"crank {i - 1}", f"coupler {i}", end))
        for i in range(1, n + 1):
            joints.append(pin(f"right {i}", f"crank {i}", f"coupler {i}", end, end))
        return Mechanism(
            name=self.name,
            bodies=(*cranks, *couplers),
            joints=tuple(joints),
            markers=(marker("B0", "crank 0", end),),
            gravity=self.g,
            start=(UPRIGHT,) * (n + 1) + (0.0,) * n,
            start_speeds=(self.turning,) * (n + 1) + (0.0,) * n,
        )

    def figures(self) -> tuple[KnownValue, ...]:
        end, angle = self.duration, coordinate("a0")
        time = turn_period(self.omega, self.turning)
        name = "largest error of the first crank's angle"
        read = Passage(angle, UPRIGHT + 2 * math.pi, end)
        return (
            KnownValue("time of a turn", time, "s", 1e-9, read),
            path_figure(name, "rad", 1e-9, angle, self.angle, end),
        )

    def conditions(self) -> tuple[Condition, ...]:
        end = self.duration
        return (suite_condition("B0", self.length, self.angle, end, round(20 * end)),)


class SwingingParameters(BenchmarkParameters):
    """Base of the linkages that are let go from rest and move like a pendulum."""

    @property
    def swing(self) -> Swing:
        """Motion in closed form."""
        raise NotImplementedError(type(self).__name__)

    @property
    def duration(self) -> float:
        return 2.5 * self.swing.period

    def figures(self) -> tuple[KnownValue, ...]:
        swing, end = self.swing, self.duration
        last = float(swing.at(np.array([end]))[0])
        return (
            *swing.figures(end, 1e-11 * swing.period, 1e-10),
            KnownValue("angle at the end", last, "rad", 1e-10, At(coordinate(swing.angle), end)),
        )


class ThreeCranksParameters(SwingingParameters):
    """A beam on three equal parallel cranks, of which one is redundant, let go from rest."""

    number = "C01"
    name = "three-cranks"
    tags = ("loop", "redundant", "closed-form")
    text = "beam on three parallel cranks, one of them redundant"
    source = (
        "moves as a pendulum; "
        "on redundant constraints M. Wojtyra, Multibody Syst. Dyn. 14 (2005) 23"
    )

    length: Positive = Field(default=1.0, description="of each crank, a uniform rod [m]")
    spacing: Positive = Field(default=0.8, description="between neighbouring cranks [m]")
    crank: Positive = Field(default=1.0, description="mass of each crank [kg]")
    beam: Positive = Field(default=3.0, description="mass of the beam [kg]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    amplitude: Real = Field(
        default=1.0, gt=0, le=1.4, description="start, from the lowest position [rad]"
    )

    @property
    def swing(self) -> Swing:
        moment, inertia = 1.5 * self.crank + self.beam, (self.crank + self.beam) * self.length
        return Swing("a1", math.sqrt(moment * self.g / inertia), self.amplitude)

    def mechanism(self) -> Mechanism:
        end, centre = (self.length, 0.0), (self.spacing, 0.0)
        inertia = self.beam * (2 * self.spacing) ** 2 / 12
        beam = Body(name="beam", angle="b", mass=self.beam, centre=centre, inertia=inertia)
        cranks = [rod(f"crank {i}", f"a{i}", self.length, self.crank) for i in (1, 2, 3)]
        places = {1: (0.0, 0.0), 2: centre, 3: (2 * self.spacing, 0.0)}
        pivots = [pin(f"pivot {i}", GROUND, f"crank {i}", at) for i, at in places.items()]
        pins = [pin(f"pin {i}", f"crank {i}", "beam", end, at) for i, at in places.items()]
        return Mechanism(
            name=self.name,
            bodies=(*cranks, beam),
            joints=(*pivots, *pins),
            markers=(marker("beam", "beam", centre),),
            gravity=self.g,
            start=(LOWEST + self.amplitude,) * 3 + (0.0,),
        )


class SliderCrankParameters(BenchmarkParameters):
    """A uniform crank and rod, and a slider on a level line through the crank's pivot.

    With too little speed to turn over the crank swings, up to 270 degrees to and fro.
    """

    number = "C02"
    name = "slider-crank"
    tags = ("loop", "slot", "quadrature")
    text = "slider-crank that turns over and over"
    source = (
        "time of a turn by quadrature: "
        "E. T. Whittaker, Analytical Dynamics (4th ed., 1937), Ch. III"
    )

    crank: Positive = Field(default=1.0, description="length of the crank [m]")
    rod: Positive = Field(default=2.0, description="length of the rod, more than the crank's [m]")
    m_crank: Positive = Field(default=1.0, description="[kg]")
    m_rod: Positive = Field(default=2.0, description="[kg]")
    m_slider: Positive = Field(default=1.0, description="[kg]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    speed: Positive = Field(
        default=8.0, description="of the crank at the start, stretched out [rad/s]"
    )

    def rod_angle(self, a: float) -> tuple[float, float]:
        """The rod's angle [rad] at the crank's, and its derivative."""
        if self.rod == self.crank:  # the slider passes the pivot, on the mirrored branch
            return -a, -1.0
        b = -math.asin(self.crank * math.sin(a) / self.rod)
        return b, -self.crank * math.cos(a) / (self.rod * math.cos(b))

    def inertia(self, a: float) -> float:
        """Reduced to the crank's angle [kg m^2]."""
        b, slope = self.rod_angle(a)
        r, half = self.crank, self.rod / 2
        middle = complex(
            -r * math.sin(a) - half * math.sin(b) * slope,
            -r * math.cos(a) - half * math.cos(b) * slope,
        )
        slider = -r * math.sin(a) - self.rod * math.sin(b) * slope
        turning = self.m_crank * r**2 / 3 + self.m_rod * self.rod**2 / 12 * slope**2
        return turning + self.m_rod * abs(middle) ** 2 + self.m_slider * slider**2

    def potential(self, a: float) -> float:
        """Energy of crank and rod, whose centres are half as high as their common pin [J]."""
        return -(self.m_crank + self.m_rod) * self.g * self.crank / 2 * math.sin(a)

    @property
    def share(self) -> float:
        """Share of the energy that the crank needs to turn over: below 1 it swings."""
        return self.inertia(0.0) * self.speed**2 / 2 / self.potential(UPRIGHT)

    @property
    def cycle(self) -> float:
        """Time of a turn, or period of a crank that does not turn over [s]."""
        if self.share > 1:
            return time_between(0.0, 2 * math.pi, self.speed, self.inertia, self.potential)
        amplitude = math.pi / 2 + math.asin(self.share)
        return slow_swing_period(LOWEST, amplitude, self.potential(UPRIGHT), self.inertia)

    @model_validator(mode="after")
    def _moves_for_good(self) -> Self:
        if self.rod < self.crank:
            raise ValueError(
                f"rod = {self.rod:g} m is shorter than crank = {self.crank:g} m: "
                "the slider would stick"
            )
        if abs(self.share - 1.0) < _UPRIGHT_SHARE:
            raise ValueError(
                f"speed = {self.speed:g} rad/s brings the crank to rest upright, or nearly: "
                "it must differ by more than 0.5 % from "
                f"{self.speed / math.sqrt(self.share):.6g} rad/s"
            )
        return self

    @property
    def duration(self) -> float:
        return 1.5 * self.cycle

    def mechanism(self) -> Mechanism:
        # The slider, a point mass at the rod's end, is part of the rod.
        mass = self.m_rod + self.m_slider
        centre = (self.m_rod / 2 + self.m_slider) * self.rod / mass
        inertia = (
            self.m_rod * (self.rod**2 / 12 + (centre - self.rod / 2) ** 2)
            + self.m_slider * (self.rod - centre) ** 2
        )
        loaded = Body(name="rod", angle="b", mass=mass, centre=(centre, 0), inertia=inertia)
        end = (self.rod, 0.0)
        return Mechanism(
            name=self.name,
            bodies=(rod("crank", "a", self.crank, self.m_crank), loaded),
            joints=(
                pin("pivot", GROUND, "crank"),
                pin("crank pin", "crank", "rod", (self.crank, 0)),
                slot("slot", "rod", (1, 0), on=end),
            ),
            markers=(marker("slider", "rod", end),),
            gravity=self.g,
            start=(0.0, 0.0),
            start_speeds=(self.speed, -self.speed * self.crank / self.rod),
        )

    def figures(self) -> tuple[KnownValue, ...]:
        time, end, angle = self.cycle, self.duration, coordinate("a")
        if self.share > 1:
            name, read = "time of a turn", Passage(angle, 2 * math.pi, end)
        else:
            name, read = "period", Period(angle, LOWEST, end)
        scale = self.inertia(0.0) * self.speed**2
        return (
            KnownValue(name, time, "s", 1e-10 * time, read, "quadrature"),
            energy_figure(1e-10 * scale, end),
        )


class SingularSliderCrankParameters(SliderCrankParameters):
    """The same with a rod as long as the crank."""

    number = "C03"
    name = "singular-slider-crank"
    tags = ("loop", "slot", "singular", "quadrature")
    text = "slider-crank with equal links, whose slider passes the crank's pivot"
    source = (
        "E. Bayo, A. Avello, Nonlinear Dyn. 5 (1994) 209, on such positions; "
        "time of a turn by quadrature"
    )

    rod: Positive = Field(default=1.0, description="length of the rod: the crank's [m]")


class QuickReturnParameters(BenchmarkParameters):
    """A crank whose pin runs in the slot of an arm that is pivoted below it."""

    number = "C05"
    name = "quick-return"
    tags = ("loop", "slot", "quadrature")
    text = "crank whose pin runs in the slot of a swinging arm"
    source = (
        "time of a turn by quadrature: "
        "E. T. Whittaker, Analytical Dynamics (4th ed., 1937), Ch. III"
    )

    crank: Positive = Field(default=0.2, description="from its pivot to its pin [m]")
    distance: Positive = Field(
        default=0.5, description="of the arm's pivot below the crank's, more than the crank [m]"
    )
    arm: Positive = Field(default=0.9, description="length of the arm [m]")
    m_crank: Positive = Field(default=1.0, description="of the crank, a uniform rod [kg]")
    m_arm: Positive = Field(default=2.0, description="of the arm, a uniform rod [kg]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    speed: Positive = Field(default=12.0, description="of the crank at the start, level [rad/s]")

    def time_to(self, a: float) -> float:
        """Time to the crank's angle a [s]; it does not turn back."""
        return time_between(0.0, a, self.speed, self.inertia, self.potential)

    def arm_angle(self, a: float) -> tuple[float, float]:
        """The arm's angle [rad] at the crank's, and its derivative."""
        pin = self.crank * cmath.exp(-1j * a)
        reach = pin + 1j * self.distance
        return -cmath.phase(reach), (pin / reach).real

    def inertia(self, a: float) -> float:
        """Reduced to the crank's angle [kg m^2]."""
        arm = self.m_arm * self.arm**2 / 3 * self.arm_angle(a)[1] ** 2
        return self.m_crank * self.crank**2 / 3 + arm

    def potential(self, a: float) -> float:
        """Energy of crank and arm [J]."""
        arm = self.m_arm * self.arm * math.sin(self.arm_angle(a)[0])
        return -self.g / 2 * (self.m_crank * self.crank * math.sin(a) + arm)

    @property
    def duration(self) -> float:
        return 1.5 * self.time_to(2 * math.pi)

    def mechanism(self) -> Mechanism:
        angle, slope = self.arm_angle(0.0)
        return Mechanism(
            name=self.name,
            bodies=(
                rod("crank", "a", self.crank, self.m_crank),
                rod("arm", "b", self.arm, self.m_arm),
            ),
            joints=(
                pin("crank pivot", GROUND, "crank"),
                pin("arm pivot", GROUND, "arm", (0, -self.distance)),
                slot("slot", "crank", (1, 0), on=(self.crank, 0), parent="arm"),
            ),
            markers=(marker("tip", "arm", (self.arm, 0)),),
            gravity=self.g,
            start=(0.0, angle),
            start_speeds=(self.speed, slope * self.speed),
        )

    def figures(self) -> tuple[KnownValue, ...]:
        end, angle = self.duration, coordinate("a")
        figures: list[KnownValue] = []
        for name, a in {"time of a turn": 2 * math.pi, "time of the first half": math.pi}.items():
            read = Passage(angle, a, end)
            figures.append(KnownValue(name, self.time_to(a), "s", 1e-11, read, "quadrature"))
        scale = self.inertia(0.0) * self.speed**2
        return (*figures, energy_figure(1e-11 * max(1.0, scale), end))


class TrammelParameters(SwingingParameters):
    """A uniform rod whose ends run in a level and in an upright slot, let go from rest."""

    number = "C04"
    name = "trammel"
    tags = ("loop", "slot", "closed-form")
    text = "elliptic trammel: a rod whose ends run in two crossing slots"
    source = "moves as a pendulum: E. T. Whittaker, Analytical Dynamics (4th ed., 1937), Ch. IV"

    length: Positive = Field(default=2.0, description="of the rod [m]")
    mass: Positive = Field(default=3.0, description="of the rod [kg]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    amplitude: Real = Field(
        default=2.5, gt=0, lt=math.pi, description="start, from the lowest position [rad]"
    )

    @property
    def swing(self) -> Swing:
        """Its motion: the centre moves on a circle of half the length as fast as the rod turns."""
        return Swing("a", math.sqrt(1.5 * self.g / self.length), self.amplitude)

    def mechanism(self) -> Mechanism:
        start = LOWEST + self.amplitude
        return Mechanism(
            name=self.name,
            bodies=(rod("rod", "a", self.length, self.mass),),
            joints=(
                slot("level", "rod", (1, 0), coordinate="x"),
                slot("upright", "rod", (0, 1), on=(self.length, 0)),
            ),
            markers=(marker("pen", "rod", (self.length / 4, 0)),),
            gravity=self.g,
            start=(start, -self.length * math.cos(start)),
        )


_BARYCENTRE = 0.02 - 0.01421  # [m]
_K = {
    1: (0.04325, 2.194e-6, (0.00092, 0)),
    2: (0.00365, 4.410e-7, (-0.0115, 0)),
    3: (0.02373, 5.255e-6, (0.01043, -0.01874)),
    5: (0.07050, 1.169e-5, (0.02308, 0.00916)),
    4: (0.00706, 5.667e-7, (0, -_BARYCENTRE)),
    7: (0.05498, 1.912e-5, (-0.00449, -0.01228)),
    6: (0.00706, 5.667e-7, (_BARYCENTRE, 0)),
}
"""Mass [kg], inertia [kg m^2] and centre [m] of the bodies of the squeezing mechanism."""
_E = (-0.028, 0.0)  # [m] where K3, K4 and K6 meet, on K2
_END = 0.03  # [s]
_ANGLES = {
    "beta": ("k1", None, -0.0617138900142764496358948458001, "15.81077119629904"),
    "Theta": ("k2", "k1", 0.0, "-15.75637105984298"),
    "gamma": ("k3", None, 0.455279819163070380255912382449, "0.04082224013073101"),
    "Phi": ("k4", "k5", 0.222668390165885884674473185609, "-0.5347301163226948"),
    "delta": ("k5", None, 0.487364979543842550225598953530, "0.5244099658805304"),
    "Omega": ("k6", "k7", -0.222668390165885884674473185609, "0.5347301163226948"),
    "epsilon": ("k7", None, 1.23054744454982119249735015568, "1.048080741042263"),
}
"""Published angles: our coordinate, the one it counts from, values at the start and end [rad].

Those at the end are as printed.
"""


class SqueezerParameters(BenchmarkParameters):
    """Motor and spring of Andrews' mechanism; its geometry and masses are the published ones.

    Published angles count counterclockwise, and some from another body: beta of the crank K1; Theta
    of K2 from K1; gamma of K3, the triangle with the spring; delta of K5 and Phi of K4 from K5;
    epsilon of K7 and Omega of K6 from K7.

    The published end state is late by some 1e-12 s: minimal and redundant coordinates agree with
    each other at any tolerance below 1e-11, and with it in the angles to a few parts in 1e10, in
    their rates (not taken here) to some 5e-8.
    """

    number = "A03"
    name = "squeezer"
    tags = ("loop", "spring", "motor", "published", "IFToMM")
    text = "Andrews' squeezing mechanism: seven bodies, driven by a motor against a spring"
    source = (
        "W. Schiehlen, Multibody Systems Handbook (1990); "
        "E. Hairer, G. Wanner, Solving ODEs II (1996), Sec. VII.7; "
        "end state: F. Mazzia, C. Magherini, Test Set for IVP Solvers 2.4 (2008); "
        "problem A03 in the IFToMM library"
    )

    torque: Real = Field(
        default=0.033, description="of the motor on the crank, counterclockwise [N m]"
    )
    stiffness: NonNegative = Field(default=4530.0, description="of the spring [N/m]")
    rest_length: Positive = Field(default=0.07785, description="of the spring [m]")

    @property
    def duration(self) -> float:
        return _END

    def mechanism(self) -> Mechanism:
        start = {name: -angle for name, _, angle, _ in _ANGLES.values()}
        for name, other, _, _ in _ANGLES.values():
            if other:
                start[name] += start[other]
        a, b, d = (-0.06934, -0.00227), (-0.03635, 0.03273), (0.02, -0.018)
        bodies = tuple(
            Body(name=f"K{i}", angle=f"k{i}", mass=mass, centre=centre, inertia=inertia)
            for i, (mass, inertia, centre) in _K.items()
        )
        spring = SpringDamper(
            name="spring", body="K3", point=d, relative_point=(0.014, 0.072),
            stiffness=self.stiffness, rest_length=self.rest_length,
        )  # fmt: skip
        return Mechanism(
            name=self.name,
            bodies=bodies,
            joints=(
                pin("O", GROUND, "K1", (0, 0)),
                pin("F", "K1", "K2", (0.007, 0)),
                pin("B", GROUND, "K3", b),
                pin("A5", GROUND, "K5", a),
                pin("G", "K5", "K4", (0.04, 0)),
                pin("A7", GROUND, "K7", a),
                pin("H", "K7", "K6", (0, -0.04)),
                pin("E3", "K2", "K3", _E, (0, -0.035)),
                pin("E4", "K2", "K4", _E, (0, -0.02)),
                pin("E6", "K2", "K6", _E, (0.02, 0)),
            ),
            force_elements=(spring, ConstantTorque(name="motor", body="K1", torque=-self.torque)),
            markers=(marker("E", "K2", _E), marker("D", "K3", d)),
            gravity=0,
            start=tuple(start[f"k{i}"] for i in _K),
        )

    def figures(self) -> tuple[KnownValue, ...]:
        """The published end state; of other parameters nothing is published."""
        if self != SqueezerParameters():
            return ()
        figures: list[KnownValue] = []
        for angle, (_, _, _, printed) in _ANGLES.items():
            name, value, read = (
                f"{angle} at 0.03 s",
                float(printed),
                At(published_angle(angle), _END),
            )
            tolerance = 1e-9 * abs(value)
            known = KnownValue(name, value, "rad", tolerance, read, "published", printed)
            figures.append(known)
        return tuple(figures)


def published_angle(name: str) -> Sum:
    """A published angle of the squeezing mechanism [rad] from our absolute clockwise angles."""
    body, other, _, _ = _ANGLES[name]
    return Sum({body: -1.0} if other is None else {other: 1.0, body: -1.0})


LINKAGES = (
    FourBarParameters,
    ThreeCranksParameters,
    SliderCrankParameters,
    SingularSliderCrankParameters,
    QuickReturnParameters,
    TrammelParameters,
    SqueezerParameters,
)
