"""Pendulums and chains."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.polynomial import laguerre
from pydantic import Field

from ..arrays import FloatArray
from ..elements import GROUND, Stop
from ..mechanism import Body, Mechanism
from ..spec import Positive, Real
from .benchmark import (
    LOWEST,
    BenchmarkParameters,
    Condition,
    KnownValue,
    Period,
    Swing,
    bob,
    coordinate,
    energy_figure,
    marker,
    pin,
    rod,
    suite_condition,
)


class PendulumParameters(BenchmarkParameters):
    """A point mass on a massless link."""

    number = "A01"
    name = "pendulum"
    tags = ("tree", "closed-form", "IFToMM")
    text = "simple pendulum let go level"
    source = (
        "M. Gonzalez et al., MBS benchmark library (Univ. of A Coruna, 2005), problem A01, "
        "in the IFToMM library"
    )

    length: Positive = Field(default=1.0, description="link [m]")
    mass: Positive = Field(default=1.0, description="bob [kg]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    amplitude: Real = Field(
        default=math.pi / 2, gt=0, lt=math.pi, description="start, from the lowest position [rad]"
    )

    @property
    def swing(self) -> Swing:
        """Its motion."""
        return Swing("phi", math.sqrt(self.g / self.length), self.amplitude)

    @property
    def duration(self) -> float:
        """10 s at 1 m, as the source has it, and at least one and a half periods."""
        return max(10.0 * math.sqrt(self.length * 9.81 / self.g), 1.5 * self.swing.period)

    def mechanism(self) -> Mechanism:
        return Mechanism(
            name=self.name,
            bodies=(bob("link", "phi", self.length, self.mass),),
            joints=(pin("pivot", GROUND, "link"),),
            markers=(marker("P1", "link", (self.length, 0)),),
            gravity=self.g,
            start=(LOWEST + self.amplitude,),
        )

    def figures(self) -> tuple[KnownValue, ...]:
        # Near the highest position errors grow, as the period does: by 1 / cos(amplitude / 2).
        growth = 1.0 / math.cos(self.amplitude / 2)
        time_tolerance = max(1e-12, 1e-12 * self.swing.period * growth)
        return self.swing.figures(self.duration, time_tolerance, 1e-11 * growth)

    def conditions(self) -> tuple[Condition, ...]:
        return (suite_condition("P1", self.length, self.swing.at, self.duration, 20),)


class HighPendulumParameters(PendulumParameters):
    """The same, let go one degree below the highest position."""

    number = "B01"
    name = "high-pendulum"
    tags = ("tree", "closed-form", "sensitive")
    text = "simple pendulum let go one degree below its highest position"
    source = (
        "period by an elliptic integral: "
        "E. T. Whittaker, Analytical Dynamics (4th ed., 1937), Ch. IV"
    )

    amplitude: Real = Field(
        default=math.radians(179),
        gt=0,
        lt=math.pi,
        description="start, from the lowest position [rad]",
    )

    def conditions(self) -> tuple[Condition, ...]:
        return ()


class ChainParameters(BenchmarkParameters):
    """Equal uniform rods, each pinned to the one before, let go from rest on a straight line."""

    number = "B03"
    name = "chain"
    tags = ("tree", "chaotic", "scalable")
    text = "chain of N uniform rods let go level"
    source = "energy is conserved"

    N: int = Field(default=5, ge=1, le=200, description="number of rods")
    length: Positive = Field(default=0.2, description="of each rod [m]")
    mass: Positive = Field(default=1.0, description="of each rod [kg]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    start: Real = Field(default=0.0, description="start angle of all rods, from +x clockwise [rad]")

    @property
    def duration(self) -> float:
        """Time of some three swings of the chain as one rod [s]."""
        return round(9.0 * math.sqrt(self.N * self.length / self.g), 2)

    def mechanism(self) -> Mechanism:
        links = rods(self.N, self.length, self.mass)
        return pin_links(self.name, links, self.length, self.g, (self.start,) * self.N)

    def figures(self) -> tuple[KnownValue, ...]:
        scale = self.N**2 * self.mass * self.g * self.length
        return (energy_figure(1e-11 * scale, self.duration),)


class DoublePendulumParameters(ChainParameters):
    """The same with two rods of 1 m, slightly above the horizontal."""

    number = "B02"
    name = "double-pendulum"
    tags = ("tree", "chaotic")
    text = "two uniform rods, chaotic"
    source = "energy is conserved; T. Shinbrot et al., Am. J. Phys. 60 (1992) 491, on its chaos"

    N: int = Field(default=2, ge=2, le=2, description="number of rods")
    length: Positive = Field(default=1.0, description="of each rod [m]")
    start: Real = Field(
        default=-0.5, description="start angle of both rods, from +x clockwise [rad]"
    )


class PlanarChainParameters(ChainParameters):
    """The planar chain on which Erez, Tassa and Todorov measured consistency and energy drift.

    They compare engines with themselves at a short step, over step and speed; here the truth is
    known. The number of links, their lengths and masses and the start are ours: the numbers of
    their model were not at hand.
    """

    number = "B05"
    name = "planar-chain"
    tags = ("tree", "chaotic", "scalable")
    text = "planar chain of N uniform links, let go folded, for energy and consistency by step"
    source = (
        "T. Erez, Y. Tassa, E. Todorov, Simulation tools for model-based robotics (ICRA 2015), "
        "their kind of test; numbers of links, lengths, masses and start are trebucheck's own; "
        "energy is conserved"
    )

    length: Positive = Field(default=0.5, description="of each rod [m]")
    fold: Real = Field(
        default=0.5,
        gt=-math.pi,
        lt=math.pi,
        description="start angle of every other rod, from the first one's clockwise [rad]",
    )

    @property
    def duration(self) -> float:
        """Time before it cannot be predicted any more, with the default parameters [s]."""
        return round(7.0 * math.sqrt(self.N * self.length / self.g), 2)

    def mechanism(self) -> Mechanism:
        links = rods(self.N, self.length, self.mass)
        start = (self.start + (i % 2) * self.fold for i in range(self.N))
        return pin_links(self.name, links, self.length, self.g, tuple(start))


class HangingChainParameters(BenchmarkParameters):
    """Equal point masses on equal massless links, let go in their slowest small oscillation."""

    number = "B04"
    name = "hanging-chain"
    tags = ("tree", "closed-form", "scalable")
    text = "N point masses on a hanging chain in their slowest small oscillation"
    source = (
        "frequencies by the roots of a Laguerre polynomial: "
        "D. Bernoulli, Comm. Acad. Petrop. 6 (1733) 108"
    )

    N: int = Field(default=5, ge=1, le=50, description="number of links")
    length: Positive = Field(default=0.2, description="of each link [m]")
    mass: Positive = Field(default=1.0, description="of each point [kg]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    amplitude: Real = Field(default=1e-4, gt=0, le=0.1, description="of the lowest link [rad]")

    @property
    def shape(self) -> tuple[float, FloatArray]:
        """Squared frequency times length over gravity, and the links' relative angles from the top.

        The deflection of the mass n links above the end is the Laguerre polynomial L_n(x), and the
        pivot's, L_N(x), is zero (D. Bernoulli, Comm. Acad. Petrop. 6 (1733) 108).
        """
        root = float(laguerre.lagroots([0.0] * self.N + [1.0])[0])
        polynomials = np.eye(self.N + 1)
        deflections = np.array(
            [laguerre.lagval(root, c[: n + 1]) for n, c in enumerate(polynomials)]
        )
        angles = -np.diff(deflections)[::-1]
        return root, angles / angles[-1]

    @property
    def period(self) -> float:
        """Period of the slowest small oscillation [s]."""
        return 2 * math.pi / math.sqrt(self.shape[0] * self.g / self.length)

    @property
    def duration(self) -> float:
        return 1.5 * self.period

    def mechanism(self) -> Mechanism:
        links = tuple(
            bob(f"link {i}", f"a{i}", self.length, self.mass) for i in range(1, self.N + 1)
        )
        start = LOWEST + self.amplitude * self.shape[1]
        return pin_links(self.name, links, self.length, self.g, tuple(start.tolist()))

    def figures(self) -> tuple[KnownValue, ...]:
        name, exact = "period of the slowest small oscillation", self.period
        # The period of a small oscillation differs from the linear one by the amplitude's square.
        tolerance = exact * self.amplitude**2
        read = Period(coordinate("a1"), LOWEST, 1.5 * exact)
        return (KnownValue(name, exact, "s", tolerance, read),)


def pin_links(
    name: str,
    links: tuple[Body, ...],
    length: float,
    gravity: float,
    start: tuple[float, ...],
    stops: tuple[Stop, ...] = (),
) -> Mechanism:
    """Links in a row, each pinned to the end of the one before, the first to the ground.

    Args:
        length: of each link [m].
    """
    joints = [pin("pin 1", GROUND, links[0].name)]
    for i, (parent, child) in enumerate(pairwise(links), start=2):
        joints.append(pin(f"pin {i}", parent.name, child.name, (length, 0)))
    return Mechanism(
        name=name,
        bodies=links,
        joints=tuple(joints),
        stops=stops,
        markers=(marker("tip", links[-1].name, (length, 0)),),
        gravity=gravity,
        start=start,
    )


def rods(count: int, length: float, mass: float) -> tuple[Body, ...]:
    """Equal uniform rods."""
    return tuple(rod(f"rod {i + 1}", f"a{i + 1}", length, mass) for i in range(count))


PENDULUMS = (
    PendulumParameters,
    HighPendulumParameters,
    DoublePendulumParameters,
    ChainParameters,
    HangingChainParameters,
    PlanarChainParameters,
)
