"""Free bodies."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from ..elements import ConstantForce, FreeJoint, SpringDamper
from ..mechanism import Body, Marker, Mechanism
from ..spec import Positive, Real, Spec, Vector
from .benchmark import Benchmark, Figure
from .readings import at, coordinate, largest_error, marker

_SPAN = 10.0  # periods of an oscillation


class ThrownPlateParameters(Spec):
    """A free body thrown with spin under gravity and a constant force at its centre of mass.

    Raises:
        InputError: a mass, inertia or gravity is not positive and finite, or another value is not
            finite.
    """

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


class SpringPendulumParameters(Spec):
    """A point mass in the plane on a spring whose length without load is zero, pushed from its rest.

    Raises:
        InputError: a mass, stiffness or gravity is not positive and finite.
    """

    mass: Positive = Field(default=1.0, description="[kg]")
    stiffness: Positive = Field(default=20.0, description="[N/m]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    aside: Real = Field(default=0.2, description="start, aside of the rest [m]")
    speed_y: Real = Field(default=0.8, description="at the start, upwards [m/s]")

    @property
    def omega(self) -> float:
        """Of the oscillation, the same in all directions [rad/s]."""
        return math.sqrt(self.stiffness / self.mass)


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


def _thrown_figures(p: ThrownPlateParameters) -> tuple[Figure, ...]:
    pull = p.force_x / p.mass, p.force_y / p.mass - p.g

    def path(axis: int, start: float, rate: float, name: str) -> Figure:
        read = largest_error(
            marker("centre", axis),
            lambda t: start + rate * t + pull[axis] * t**2 / 2,
            _THROWN_DURATION,
        )
        return Figure(
            f"largest error of the centre's {name}", 0.0, "m", 1e-11 * max(1.0, abs(rate)), read
        )

    turned = p.spin * _THROWN_DURATION
    return (
        path(0, _CENTRE[0], p.speed_x, "x"),
        path(1, _CENTRE[1], p.speed_y, "y"),
        Figure(
            "angle at the end",
            turned,
            "rad",
            1e-11 * max(1.0, abs(turned)),
            at(coordinate("a"), _THROWN_DURATION),
        ),
    )


_THROWN_DURATION = 2.0  # [s]


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


def _spring_pendulum_figures(p: SpringPendulumParameters) -> tuple[Figure, ...]:
    end, rest, w = _spring_pendulum_duration(p), -p.mass * p.g / p.stiffness, p.omega
    size = max(1.0, abs(p.aside), abs(p.speed_y) / w)
    x = largest_error(coordinate("x"), lambda t: p.aside * np.cos(w * t), end)
    y = largest_error(coordinate("y"), lambda t: rest + p.speed_y / w * np.sin(w * t), end)
    return (
        Figure("largest error of x", 0.0, "m", 1e-11 * size, x),
        Figure("largest error of y", 0.0, "m", 1e-11 * size, y),
    )


def _spring_pendulum_duration(p: SpringPendulumParameters) -> float:
    return _SPAN * 2 * math.pi / p.omega


THROWN_PLATE = Benchmark(
    number="E07",
    name="thrown-plate",
    tags=("free", "force", "closed-form"),
    text="free body thrown with spin under a constant force",
    source="G. Galilei, Discorsi (1638): the centre of mass moves on a parabola",
    parameters=ThrownPlateParameters,
    build=_thrown_plate,
    duration=lambda p: _THROWN_DURATION,
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
    duration=_spring_pendulum_duration,
    figures=_spring_pendulum_figures,
)
FREE_BODIES = (THROWN_PLATE, SPRING_PENDULUM)
