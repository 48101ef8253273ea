"""Problems with stops that close again: bouncing, rest after a finite time, impacts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pydantic import Field

from ..elements import FreeJoint, Stop
from ..mechanism import Body, Mechanism
from ..problem import StopLaw
from ..spec import Positive, Real
from .benchmark import (
    At,
    BenchmarkParameters,
    ContinuousMotion,
    ImpactTime,
    KnownValue,
    energy_figure,
    floor,
    marker,
    slot,
    speed,
)
from .pendulums import pin_links, rods


class BouncingParameters(BenchmarkParameters):
    """A body that falls on a level floor from rest."""

    number = "D01"
    name = "bouncing"
    tags = ("contact", "impact", "closed-form")
    text = "body that bounces on a floor and comes to rest after infinitely many impacts"
    source = (
        "B. Brogliato, Nonsmooth Mechanics (3rd ed., 2016), Ch. 1: "
        "infinitely many impacts by a finite time"
    )
    stop_law = StopLaw.UNILATERAL

    mass: Positive = Field(default=2.0, description="[kg]")
    height: Positive = Field(default=1.0, description="of the fall [m]")
    restitution: Real = Field(
        default=0.5, ge=0, le=1, description="speed after an impact over the one before"
    )
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")

    @property
    def speed(self) -> float:
        """Speed at the first impact [m/s]."""
        return math.sqrt(2 * self.g * self.height)

    @property
    def rest_time(self) -> float:
        """Time at which it has ceased to bounce [s]; infinite without loss."""
        e = self.restitution
        return self.speed / self.g * (1 + e) / (1 - e) if e < 1 else math.inf

    @property
    def duration(self) -> float:
        """Past the rest; ten rebounds without loss."""
        return 1.25 * self.rest_time if self.restitution < 1 else 20.5 * self.speed / self.g

    def mechanism(self) -> Mechanism:
        inertia = self.mass * (self.height / 10) ** 2
        return Mechanism(
            name=self.name,
            bodies=(
                Body(name="ball", angle="turn", mass=self.mass, centre=(0, 0), inertia=inertia),
            ),
            joints=(slot("line", "ball", (0, 1), coordinate="height"),),
            stops=(floor("floor", "ball", (0, 0), e=self.restitution),),
            markers=(marker("ball", "ball"),),
            gravity=self.g,
            start=(0.0, self.height),
        )

    def figures(self) -> tuple[KnownValue, ...]:
        fall = self.speed / self.g
        first = _first_impact("floor", fall, (1 + self.restitution) * self.mass * self.speed)
        if self.restitution == 1:
            time, energy = 19 * fall, self.mass * self.g * self.height
            tenth = KnownValue("tenth impact", time, "s", 1e-11 * time, ImpactTime(9))
            return (*first, tenth, energy_figure(1e-11 * energy, self.duration))
        time = self.rest_time
        tolerance = 1e-10 * max(1.0, time)
        return (
            *first,
            KnownValue("rest", time, "s", tolerance, lambda motion: motion.rest_times["floor"][0]),
        )


class StoppedPendulumParameters(BenchmarkParameters):
    """Two equal uniform rods, the upper between two stops beside the vertical, let go from rest."""

    number = "D02"
    name = "stopped-pendulum"
    tags = ("tree", "contact", "impact")
    text = "double pendulum whose upper rod swings between two stops"
    source = "energy lost in an impact: W. Thomson, P. G. Tait, Natural Philosophy (1879), Sec. 308"
    stop_law = StopLaw.UNILATERAL

    length: Positive = Field(default=1.0, description="of each rod [m]")
    mass: Positive = Field(default=1.0, description="of each rod [kg]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    opening: Real = Field(
        default=0.5, gt=0, lt=1.5, description="of each stop from the vertical [rad]"
    )
    swing: Real = Field(
        default=1.2, gt=0, lt=3, description="start angle of the lower rod from the vertical [rad]"
    )
    restitution: Real = Field(default=0.7, gt=0, le=1, description="of both stops")

    @property
    def duration(self) -> float:
        return round(9.0 * math.sqrt(self.length / self.g), 2)

    def mechanism(self) -> Mechanism:
        down, e = math.pi / 2, self.restitution
        # Clockwise from the vertical is to the left.
        common: dict[str, Any] = {"body": "rod 1", "closed": False, "restitution": e}
        stops = (
            Stop(name="left", sense=-1, limit=-(down + self.opening), **common),
            Stop(name="right", sense=1, limit=down - self.opening, **common),
        )
        links, start = rods(2, self.length, self.mass), (down, down + self.swing)
        return pin_links(self.name, links, self.length, self.g, start, stops)

    def figures(self) -> tuple[KnownValue, ...]:
        scale = 4 * self.mass * self.g * self.length

        def energy_error(motion: ContinuousMotion) -> float:
            times = np.linspace(0.0, self.duration, 400)
            energy = motion.trajectory(times).total_energy
            taken = np.zeros_like(times)
            # An impact takes half of P (v- + v+), the impulse times the mean of both speeds.
            for t, impulses in motion.impacts:
                speed = abs(float(motion.trajectory(np.array([t])).u[0, 0]))
                loss = sum(impulses.values()) * speed * (1 / self.restitution - 1) / 2
                taken += np.where(times >= t, loss, 0.0)
            return float(np.abs(energy + taken - energy[0]).max())

        name = "energy less that of the impacts"
        return (KnownValue(name, 0.0, "J", 1e-11 * scale, energy_error),)


class FallingRodParameters(BenchmarkParameters):
    """A uniform rod that falls, slanting and without spin, on a smooth level floor."""

    number = "D03"
    name = "falling-rod"
    tags = ("free", "contact", "impact", "closed-form")
    text = "slanting rod that falls on a floor with one end"
    source = "W. Goldsmith, Impact (1960), Ch. II: Newton's law of impact for a rigid rod"
    stop_law = StopLaw.UNILATERAL

    length: Positive = Field(default=1.0, description="of the rod [m]")
    mass: Positive = Field(default=2.0, description="[kg]")
    height: Positive = Field(default=0.5, description="of the lower end above the floor [m]")
    slope: Real = Field(
        default=0.6, gt=0, lt=1.5, description="of the rod, downwards to the right [rad]"
    )
    restitution: Real = Field(default=0.5, ge=0, le=1, description="of both ends")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")

    @property
    def speed(self) -> float:
        """Speed at the first impact [m/s]."""
        return math.sqrt(2 * self.g * self.height)

    @property
    def duration(self) -> float:
        return 1.5 * self.speed / self.g

    @property
    def inertia(self) -> float:
        """About the centre of mass [kg m^2]."""
        return self.mass * self.length**2 / 12

    def mechanism(self) -> Mechanism:
        half = self.length / 2
        ends = {"right": (half, 0.0), "left": (-half, 0.0)}
        rod = Body(name="rod", angle="a", mass=self.mass, centre=(0, 0), inertia=self.inertia)
        return Mechanism(
            name=self.name,
            bodies=(rod,),
            joints=(FreeJoint(name="flight", child="rod", coordinates=("x", "y")),),
            stops=tuple(
                floor(end, "rod", point, e=self.restitution) for end, point in ends.items()
            ),
            markers=tuple(marker(end, "rod", point) for end, point in ends.items()),
            gravity=self.g,
            start=(self.slope, 0.0, self.height + half * math.sin(self.slope)),
        )

    def figures(self) -> tuple[KnownValue, ...]:
        # At an impact the end acts as a mass of m / (1 + 3 cos^2).
        cosine = math.cos(self.slope)
        impulse = (1 + self.restitution) * self.mass * self.speed / (1 + 3 * cosine**2)
        # The blow on the right end turns the rod counterclockwise.
        spin = -impulse * self.length / 2 * cosine / self.inertia

        def spin_after(motion: ContinuousMotion) -> float:
            return At(speed("a"), motion.impacts[0][0])(motion)

        return (
            *_first_impact("right", self.speed / self.g, impulse),
            KnownValue("spin after it", spin, "rad/s", 1e-11 * abs(spin), spin_after),
        )


def _first_impact(stop: str, time: float, impulse: float) -> tuple[KnownValue, KnownValue]:
    return (
        KnownValue("first impact", time, "s", 1e-12 * time, ImpactTime(0)),
        KnownValue(
            "impulse of it", impulse, "N s", 1e-11 * impulse, lambda m: m.impacts[0][1][stop]
        ),
    )


CONTACTS = (BouncingParameters, StoppedPendulumParameters, FallingRodParameters)
