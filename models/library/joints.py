"""Welds, sliders and slots in moving bodies."""

from __future__ import annotations

import cmath
import math

import numpy as np
from pydantic import Field

from ..arrays import FloatArray
from ..elements import GROUND, ConstantForce, FreeJoint, SlotJoint, SpringDamper, WeldJoint
from ..mechanism import Body, Marker, Mechanism
from ..spec import Positive, Real, Vector
from .benchmark import (
    Benchmark,
    BenchmarkParameters,
    KnownValue,
    at,
    coordinate,
    energy_figure,
    marker,
    passage,
    path_figure,
    speed,
)
from .closed_forms import Swing, time_between
from .parts import block, disc, pin, rail, rod


class WeldedRodsParameters(BenchmarkParameters):
    """A pendulum of two equal rods that are welded together at an angle, let go from rest."""

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
    def centre(self) -> complex:
        """Centre of mass in the first rod's frame, x + i y [m]."""
        return self.length * (1.5 + 0.5 * cmath.exp(-1j * self.bend)) / 2

    @property
    def lowest(self) -> float:
        """Angle of the first rod in the lowest position [rad]."""
        return math.pi / 2 + cmath.phase(self.centre)

    @property
    def swing(self) -> Swing:
        """Its motion."""
        outer = self.length * abs(1 + 0.5 * cmath.exp(-1j * self.bend))
        inertia = self.mass * (self.length**2 / 3 + self.length**2 / 12 + outer**2)
        omega = math.sqrt(2 * self.mass * self.g * abs(self.centre) / inertia)
        return Swing("a", omega, self.amplitude, self.lowest)

    @property
    def duration(self) -> float:
        """Time for which the motion is followed [s]."""
        return 2.5 * self.swing.period


class InclineParameters(BenchmarkParameters):
    """A block on a smooth level rail under gravity in a slanting direction, with a start speed."""

    mass: Positive = Field(default=4.0, description="[kg]")
    slope: Real = Field(
        default=0.3, ge=-1.5, le=1.5, description="of gravity, from the rail's normal [rad]"
    )
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    speed: Real = Field(default=-2.0, description="at the start [m/s]")

    @property
    def duration(self) -> float:
        """Time for which the motion is followed [s]."""
        return 3.0


class BeadParameters(BenchmarkParameters):
    """A bead that slides without friction on a rotating arm, without gravity."""

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
        return time_between(
            self.start, self.end, self.speed, lambda r: self.mass, self.effective_potential
        )

    def effective_potential(self, r: float) -> float:
        """Energy of the turning at a distance [m] of the bead [J]."""
        return self.momentum**2 / (2 * (self.inertia + self.mass * r**2))

    @property
    def duration(self) -> float:
        """Time for which the motion is followed [s]."""
        return 1.2 * self.passage


class QuickReturnParameters(BenchmarkParameters):
    """A crank whose pin runs in the slot of an arm that is pivoted below it."""

    crank: Positive = Field(default=0.2, description="from its pivot to its pin [m]")
    distance: Positive = Field(
        default=0.5, description="of the arm's pivot below the crank's, more than the crank [m]"
    )
    arm: Positive = Field(default=0.9, description="length of the arm [m]")
    m_crank: Positive = Field(default=1.0, description="of the crank, a uniform rod [kg]")
    m_arm: Positive = Field(default=2.0, description="of the arm, a uniform rod [kg]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    speed: Positive = Field(default=12.0, description="of the crank at the start, level [rad/s]")

    @property
    def turn_time(self) -> float:
        """Time of the crank's first turn [s]; it does not turn back."""
        return time_between(0.0, 2 * math.pi, self.speed, self.inertia, self.potential)

    def arm_angle(self, a: float) -> tuple[float, float]:
        """The arm's angle [rad] at the crank's, and its derivative."""
        pin = self.crank * cmath.exp(-1j * a)
        reach = pin + 1j * self.distance
        return -cmath.phase(reach), (pin / reach).real

    def inertia(self, a: float) -> float:
        """Reduced to the crank's angle [kg m^2]."""
        return (
            self.m_crank * self.crank**2 / 3
            + self.m_arm * self.arm**2 / 3 * self.arm_angle(a)[1] ** 2
        )

    def potential(self, a: float) -> float:
        """Energy of crank and arm [J]."""
        arm = self.m_arm * self.arm * math.sin(self.arm_angle(a)[0])
        return -self.g / 2 * (self.m_crank * self.crank * math.sin(a) + arm)

    @property
    def duration(self) -> float:
        """Time for which the motion is followed [s]."""
        return 1.5 * self.turn_time


def _welded_rods(p: WeldedRodsParameters) -> Mechanism:
    weld = WeldJoint(
        name="weld",
        parent="upper",
        child="lower",
        parent_point=(p.length, 0),
        child_point=(0, 0),
        angle=p.bend,
    )
    return Mechanism(
        name="welded-rods",
        bodies=(rod("upper", "a", p.length, p.mass), rod("lower", None, p.length, p.mass)),
        joints=(pin("pivot", GROUND, "upper"), weld),
        markers=(Marker(name="tip", body="lower", point=(p.length, 0)),),
        gravity=p.g,
        start=(p.lowest + p.amplitude,),
    )


def _welded_figures(p: WeldedRodsParameters) -> tuple[KnownValue, ...]:
    return p.swing.figures(p.duration, 1e-11 * p.swing.period, 1e-10)


def _incline(p: InclineParameters) -> Mechanism:
    return Mechanism(
        name="incline",
        bodies=(block(p.mass),),
        joints=(rail("rail", GROUND, "block", "x"),),
        markers=(Marker(name="block", body="block", point=(0, 0)),),
        gravity=p.g,
        gravity_direction=(math.sin(p.slope), -math.cos(p.slope)),
        start=(0.0,),
        start_speeds=(p.speed,),
    )


def _incline_figures(p: InclineParameters) -> tuple[KnownValue, ...]:
    end, along = p.duration, p.g * math.sin(p.slope)
    final = p.speed * end + along * end**2 / 2
    reach = abs(p.speed) * end + abs(along) * end**2
    x, tolerance = coordinate("x"), 1e-12 * reach

    def path(t: FloatArray) -> FloatArray:
        return p.speed * t + along * t**2 / 2

    return (
        KnownValue("position at the end", final, "m", tolerance, at(x, end)),
        path_figure("largest error of the position", "m", tolerance, x, path, end),
    )


def _bead(p: BeadParameters) -> Mechanism:
    arm, pivot = disc("arm", "a", 1.0, p.inertia)
    return Mechanism(
        name="bead",
        bodies=(arm, Body(name="bead", mass=p.mass, centre=(0, 0), inertia=0)),
        joints=(pivot, rail("rod", "arm", "bead", "r")),
        markers=(Marker(name="bead", body="bead", point=(0, 0)),),
        gravity=0,
        start=(0.0, p.start),
        start_speeds=(p.turning, p.speed),
    )


def _bead_figures(p: BeadParameters) -> tuple[KnownValue, ...]:
    end, r, exact = p.duration, coordinate("r"), p.passage
    turning = p.momentum / (p.inertia + p.mass * p.end**2)
    return (
        KnownValue(
            "passage of the end", exact, "s", 1e-11 * exact, passage(r, p.end, end), "quadrature"
        ),
        KnownValue(
            "arm's speed then",
            turning,
            "rad/s",
            1e-11 * max(1.0, abs(turning)),
            at(speed("a"), exact),
        ),
    )


def _quick_return(p: QuickReturnParameters) -> Mechanism:
    angle, slope = p.arm_angle(0.0)
    slot = SlotJoint(
        name="slot",
        parent="arm",
        child="crank",
        parent_point=(0, 0),
        child_point=(p.crank, 0),
        axis=(1, 0),
    )
    return Mechanism(
        name="quick-return",
        bodies=(rod("crank", "a", p.crank, p.m_crank), rod("arm", "b", p.arm, p.m_arm)),
        joints=(
            pin("crank pivot", GROUND, "crank"),
            pin("arm pivot", GROUND, "arm", (0, -p.distance)),
            slot,
        ),
        markers=(Marker(name="tip", body="arm", point=(p.arm, 0)),),
        gravity=p.g,
        start=(0.0, angle),
        start_speeds=(p.speed, slope * p.speed),
    )


def _quick_return_figures(p: QuickReturnParameters) -> tuple[KnownValue, ...]:
    end, a = p.duration, coordinate("a")
    half = time_between(0.0, math.pi, p.speed, p.inertia, p.potential)
    turn, scale = p.turn_time, p.inertia(0.0) * p.speed**2
    return (
        KnownValue("time of a turn", turn, "s", 1e-11, passage(a, 2 * math.pi, end), "quadrature"),
        KnownValue(
            "time of the first half", half, "s", 1e-11, passage(a, math.pi, end), "quadrature"
        ),
        energy_figure(1e-11 * max(1.0, scale), end),
    )


WELDED_RODS = Benchmark(
    number="E05",
    name="welded-rods",
    tags=("tree", "weld", "closed-form"),
    text="pendulum of two rods that are welded together at an angle",
    source="moves as a pendulum: E. T. Whittaker, Analytical Dynamics (4th ed., 1937), Ch. IV",
    parameters=WeldedRodsParameters,
    build=_welded_rods,
    figures=_welded_figures,
)


INCLINE = Benchmark(
    number="E06",
    name="incline",
    tags=("tree", "prismatic", "gravity", "closed-form"),
    text="block on a rail under gravity in a slanting direction",
    source="G. Galilei, Discorsi (1638): constant acceleration",
    parameters=InclineParameters,
    build=_incline,
    figures=_incline_figures,
)


BEAD = Benchmark(
    number="E09",
    name="bead",
    tags=("tree", "prismatic", "quadrature"),
    text="bead that slides outwards on a rotating arm",
    source="angular momentum and energy are conserved; "
    "E. T. Whittaker, Analytical Dynamics (4th ed., 1937), Ch. III",
    parameters=BeadParameters,
    build=_bead,
    figures=_bead_figures,
)


QUICK_RETURN = Benchmark(
    number="C05",
    name="quick-return",
    tags=("loop", "slot", "quadrature"),
    text="crank whose pin runs in the slot of a swinging arm",
    source="time of a turn by quadrature: "
    "E. T. Whittaker, Analytical Dynamics (4th ed., 1937), Ch. III",
    parameters=QuickReturnParameters,
    build=_quick_return,
    figures=_quick_return_figures,
)


_SPAN = 10.0  # periods of an oscillation


class ThrownPlateParameters(BenchmarkParameters):
    """A free body thrown with spin under gravity and a constant force at its centre of mass."""

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
        """Time for which the motion is followed [s]."""
        return 2.0


class SpringPendulumParameters(BenchmarkParameters):
    """A point mass in the plane on a spring without rest length, pushed from its equilibrium."""

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
        """Time for which the motion is followed [s]."""
        return _SPAN * 2 * math.pi / self.omega


_CENTRE: Vector = (0.3, -0.1)


def _thrown_plate(p: ThrownPlateParameters) -> Mechanism:
    # The coordinates are those of a corner: at the start the centre of mass stands at (0.3, -0.1)
    # from it.
    free = FreeJoint(name="flight", child="plate", coordinates=("x", "y"))
    wind = ConstantForce(name="wind", body="plate", point=_CENTRE, force=(p.force_x, p.force_y))
    corner = complex(p.speed_x, p.speed_y) + 1j * p.spin * complex(*_CENTRE)
    return Mechanism(
        name="thrown-plate",
        bodies=(Body(name="plate", angle="a", mass=p.mass, centre=_CENTRE, inertia=p.inertia),),
        joints=(free,),
        force_elements=(wind,),
        markers=(
            Marker(name="centre", body="plate", point=_CENTRE),
            Marker(name="corner", body="plate", point=(0, 0)),
        ),
        gravity=p.g,
        start=(0.0, 0.0, 0.0),
        start_speeds=(p.spin, corner.real, corner.imag),
    )


def _thrown_figures(p: ThrownPlateParameters) -> tuple[KnownValue, ...]:
    pull = p.force_x / p.mass, p.force_y / p.mass - p.g

    def path(axis: int, start: float, rate: float, name: str) -> KnownValue:
        def exact(t: FloatArray) -> FloatArray:
            return start + rate * t + pull[axis] * t**2 / 2

        tolerance = 1e-11 * max(1.0, abs(rate))
        name = f"largest error of the centre's {name}"
        return path_figure(name, "m", tolerance, marker("centre", axis), exact, p.duration)

    turned = p.spin * p.duration
    return (
        path(0, _CENTRE[0], p.speed_x, "x"),
        path(1, _CENTRE[1], p.speed_y, "y"),
        KnownValue(
            "angle at the end",
            turned,
            "rad",
            1e-11 * max(1.0, abs(turned)),
            at(coordinate("a"), p.duration),
        ),
    )


def _spring_pendulum(p: SpringPendulumParameters) -> Mechanism:
    spring = SpringDamper(
        name="spring", body="bob", point=(0, 0), relative_point=(0, 0), stiffness=p.stiffness
    )
    return Mechanism(
        name="spring-pendulum",
        bodies=(Body(name="bob", angle="a", mass=p.mass, centre=(0, 0), inertia=0.001 * p.mass),),
        joints=(FreeJoint(name="plane", child="bob", coordinates=("x", "y")),),
        force_elements=(spring,),
        markers=(Marker(name="bob", body="bob", point=(0, 0)),),
        gravity=p.g,
        start=(0.0, p.aside, -p.mass * p.g / p.stiffness),
        start_speeds=(0.0, 0.0, p.speed_y),
    )


def _spring_pendulum_figures(p: SpringPendulumParameters) -> tuple[KnownValue, ...]:
    end, rest, w = p.duration, -p.mass * p.g / p.stiffness, p.omega
    size = max(1.0, abs(p.aside), abs(p.speed_y) / w)
    tolerance = 1e-11 * size

    def x(t: FloatArray) -> FloatArray:
        return p.aside * np.cos(w * t)

    def y(t: FloatArray) -> FloatArray:
        return rest + p.speed_y / w * np.sin(w * t)

    return (
        path_figure("largest error of x", "m", tolerance, coordinate("x"), x, end),
        path_figure("largest error of y", "m", tolerance, coordinate("y"), y, end),
    )


THROWN_PLATE = Benchmark(
    number="E07",
    name="thrown-plate",
    tags=("free", "force", "closed-form"),
    text="free body thrown with spin under a constant force",
    source="G. Galilei, Discorsi (1638): the centre of mass moves on a parabola",
    parameters=ThrownPlateParameters,
    build=_thrown_plate,
    figures=_thrown_figures,
)


SPRING_PENDULUM = Benchmark(
    number="E08",
    name="spring-pendulum",
    tags=("free", "spring", "closed-form"),
    text="mass in the plane on a spring without length of its own, on an ellipse",
    source="I. Newton, Principia (1687), Book I, Prop. X: a force in proportion to the distance",
    parameters=SpringPendulumParameters,
    build=_spring_pendulum,
    figures=_spring_pendulum_figures,
)


JOINT_PROBLEMS = (QUICK_RETURN, WELDED_RODS, INCLINE, BEAD, THROWN_PLATE, SPRING_PENDULUM)
