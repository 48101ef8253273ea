"""Problems with stops that close again: bouncing, rest after a finite time, impacts."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from pydantic import Field

from ..elements import FreeJoint, PointStop, Stop
from ..mechanism import Body, Marker, Mechanism
from ..problem import StopLaw
from ..spec import Positive, Real
from .benchmark import (
    BenchmarkParameters,
    ContinuousMotion,
    KnownValue,
    at,
    energy_figure,
    slot,
    speed,
)
from .pendulums import pin_links, rods

_ZENO = (
    "B. Brogliato, Nonsmooth Mechanics (3rd ed., 2016), Ch. 1: "
    "infinitely many impacts by a finite time"
)


class BouncingParameters(BenchmarkParameters):
    """A body that falls on a level floor from rest."""

    number = "D01"
    name = "bouncing"
    tags = ("contact", "impact", "closed-form")
    text = "body that bounces on a floor and comes to rest after infinitely many impacts"
    source = _ZENO
    stop_law = StopLaw.UNILATERAL

    mass: Positive = Field(default=2.0, description="[kg]")
    height: Positive = Field(default=1.0, description="of the fall [m]")
    restitution: Real = Field(
        default=0.5, ge=0, le=1, description="speed after an impact over the one before"
    )
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")

    @property
    def speed(self) -> float:
        """At the first impact [m/s]."""
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
        ball = Body(
            name="ball",
            angle="turn",
            mass=self.mass,
            centre=(0, 0),
            inertia=self.mass * (self.height / 10) ** 2,
        )
        floor = PointStop(
            name="floor",
            body="ball",
            point=(0, 0),
            normal=(0, 1),
            offset=0,
            closed=False,
            restitution=self.restitution,
        )
        return Mechanism(
            name=self.name,
            bodies=(ball,),
            joints=(slot("line", "ball", (0, 1), coordinate="height"),),
            stops=(floor,),
            markers=(Marker(name="ball", body="ball", point=(0, 0)),),
            gravity=self.g,
            start=(0.0, self.height),
        )

    def figures(self) -> tuple[KnownValue, ...]:
        fall = self.speed / self.g
        common = _first_impact("floor", fall, (1 + self.restitution) * self.mass * self.speed)
        if self.restitution == 1:
            tenth = 19 * fall
            end, energy = self.duration, self.mass * self.g * self.height
            return (
                *common,
                KnownValue(
                    "tenth impact", tenth, "s", 1e-11 * tenth, lambda motion: motion.impacts[9][0]
                ),
                energy_figure(1e-11 * energy, end),
            )
        rest = KnownValue(
            "rest",
            self.rest_time,
            "s",
            1e-10 * max(1.0, self.rest_time),
            lambda motion: motion.rest_times["floor"][0],
        )
        return (*common, rest)


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
        down = math.pi / 2
        # Clockwise from the vertical is to the left.
        left = Stop(
            name="left",
            body="rod 1",
            sense=-1,
            limit=-(down + self.opening),
            closed=False,
            restitution=self.restitution,
        )
        right = Stop(
            name="right",
            body="rod 1",
            sense=1,
            limit=down - self.opening,
            closed=False,
            restitution=self.restitution,
        )
        return pin_links(
            self.name,
            rods(2, self.length, self.mass),
            self.length,
            self.g,
            (down, down + self.swing),
            stops=(left, right),
        )

    def figures(self) -> tuple[KnownValue, ...]:
        scale = 4 * self.mass * self.g * self.length
        balance = _energy_balance(self, self.duration)
        return (KnownValue("energy less that of the impacts", 0.0, "J", 1e-11 * scale, balance),)


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
        """At the first impact [m/s]."""
        return math.sqrt(2 * self.g * self.height)

    @property
    def impulse(self) -> float:
        """Impulse of the first impact [N s]: the end acts as a mass of m / (1 + 3 cos^2)."""
        return (1 + self.restitution) * self.mass * self.speed / (1 + 3 * math.cos(self.slope) ** 2)

    @property
    def duration(self) -> float:
        return 1.5 * self.speed / self.g

    def mechanism(self) -> Mechanism:
        half = self.length / 2
        rod = Body(
            name="rod",
            angle="a",
            mass=self.mass,
            centre=(0, 0),
            inertia=self.mass * self.length**2 / 12,
        )
        ends = tuple(
            PointStop(
                name=name,
                body="rod",
                point=(x, 0),
                normal=(0, 1),
                offset=0,
                closed=False,
                restitution=self.restitution,
            )
            for name, x in (("right", half), ("left", -half))
        )
        return Mechanism(
            name=self.name,
            bodies=(rod,),
            joints=(FreeJoint(name="flight", child="rod", coordinates=("x", "y")),),
            stops=ends,
            markers=(
                Marker(name="right", body="rod", point=(half, 0)),
                Marker(name="left", body="rod", point=(-half, 0)),
            ),
            gravity=self.g,
            start=(self.slope, 0.0, self.height + half * math.sin(self.slope)),
        )

    def figures(self) -> tuple[KnownValue, ...]:
        fall, momentum = self.speed / self.g, self.impulse
        # The blow on the right end turns the rod counterclockwise.
        spin = (
            -momentum * self.length / 2 * math.cos(self.slope) / (self.mass * self.length**2 / 12)
        )
        return (
            *_first_impact("right", fall, momentum),
            KnownValue(
                "spin after it",
                spin,
                "rad/s",
                1e-11 * abs(spin),
                lambda m: at(speed("a"), m.impacts[0][0])(m),
            ),
        )


def _first_impact(stop: str, time: float, impulse: float) -> tuple[KnownValue, ...]:
    return (
        KnownValue("first impact", time, "s", 1e-12 * time, lambda motion: motion.impacts[0][0]),
        KnownValue(
            "impulse of it",
            impulse,
            "N s",
            1e-11 * impulse,
            lambda motion: motion.impacts[0][1][stop],
        ),
    )


def _energy_balance(
    p: StoppedPendulumParameters, end: float
) -> Callable[[ContinuousMotion], float]:
    """Largest energy error, with the loss of impacts added: half of P (v- + v+) each."""

    def read(motion: ContinuousMotion) -> float:
        times = np.linspace(0.0, end, 400)
        energy = motion.trajectory(times).total_energy
        taken = np.zeros_like(times)
        for t, impulses in motion.impacts:
            speed = abs(float(motion.trajectory(np.array([t])).u[0, 0]))
            loss = sum(impulses.values()) * speed * (1 / p.restitution - 1) / 2
            taken += np.where(times >= t, loss, 0.0)
        return float(np.abs(energy + taken - energy[0]).max())

    return read


CONTACTS = (BouncingParameters, StoppedPendulumParameters, FallingRodParameters)
