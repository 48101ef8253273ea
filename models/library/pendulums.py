"""Pendulums and chains."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.polynomial import laguerre
from pydantic import Field

from ..arrays import FloatArray
from ..elements import GROUND, Stop
from ..mechanism import Body, Marker, Mechanism
from ..spec import Positive, Real
from .benchmark import (
    Benchmark,
    BenchmarkParameters,
    Condition,
    KnownValue,
    coordinate,
    energy_figure,
    period,
    suite_condition,
)
from .closed_forms import LOWEST, Swing
from .parts import pin, rod

_SUITE = (
    "M. Gonzalez et al., MBS benchmark library (Univ. of A Coruna, 2005), problem A01, "
    "in the IFToMM library"
)


class PendulumParameters(BenchmarkParameters):
    """A point mass on a massless link."""

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


class HighPendulumParameters(PendulumParameters):
    """The same, let go one degree below the highest position."""

    amplitude: Real = Field(
        default=math.radians(179),
        gt=0,
        lt=math.pi,
        description="start, from the lowest position [rad]",
    )


class ChainParameters(BenchmarkParameters):
    """Equal uniform rods, each pinned to the one before, let go from rest on a straight line."""

    N: int = Field(default=5, ge=1, le=200, description="number of rods")
    length: Positive = Field(default=0.2, description="of each rod [m]")
    mass: Positive = Field(default=1.0, description="of each rod [kg]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    start: Real = Field(default=0.0, description="start angle of all rods, from +x clockwise [rad]")

    @property
    def duration(self) -> float:
        """Some three swings of the chain as one rod."""
        return round(9.0 * math.sqrt(self.N * self.length / self.g), 2)


class DoublePendulumParameters(ChainParameters):
    """The same with two rods of 1 m, slightly above the horizontal."""

    N: int = Field(default=2, ge=2, le=2, description="number of rods")
    length: Positive = Field(default=1.0, description="of each rod [m]")
    start: Real = Field(
        default=-0.5, description="start angle of both rods, from +x clockwise [rad]"
    )


class HangingChainParameters(BenchmarkParameters):
    """Equal point masses on equal massless links, let go in their slowest small oscillation."""

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
        deflections = np.array(
            [laguerre.lagval(root, [0.0] * n + [1.0]) for n in range(self.N + 1)]
        )
        angles = -np.diff(deflections)[::-1]
        return root, angles / angles[-1]

    @property
    def duration(self) -> float:
        """Time for which the motion is followed [s]."""
        return 1.5 * _hanging_period(self)


def _pendulum(name: str, p: PendulumParameters) -> Mechanism:
    return Mechanism(
        name=name,
        bodies=(Body(name="link", angle="phi", mass=p.mass, centre=(p.length, 0), inertia=0),),
        joints=(pin("pivot", GROUND, "link"),),
        markers=(Marker(name="P1", body="link", point=(p.length, 0)),),
        gravity=p.g,
        start=(LOWEST + p.amplitude,),
    )


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
    parents = ((GROUND, (0.0, 0.0)), *((link.name, (length, 0.0)) for link in links[:-1]))
    joints = tuple(
        pin(f"pin {i + 1}", parent, link.name, at)
        for i, ((parent, at), link) in enumerate(zip(parents, links, strict=True))
    )
    tip = Marker(name="tip", body=links[-1].name, point=(length, 0))
    return Mechanism(
        name=name,
        bodies=links,
        joints=joints,
        stops=stops,
        markers=(tip,),
        gravity=gravity,
        start=start,
    )


def rods(count: int, length: float, mass: float) -> tuple[Body, ...]:
    """Equal uniform rods."""
    return tuple(rod(f"rod {i + 1}", f"a{i + 1}", length, mass) for i in range(count))


def _chain(name: str, p: ChainParameters) -> Mechanism:
    return pin_links(name, rods(p.N, p.length, p.mass), p.length, p.g, (p.start,) * p.N)


def _hanging_chain(p: HangingChainParameters) -> Mechanism:
    links = tuple(
        Body(name=f"link {i + 1}", angle=f"a{i + 1}", mass=p.mass, centre=(p.length, 0), inertia=0)
        for i in range(p.N)
    )
    start = LOWEST + p.amplitude * p.shape[1]
    return pin_links("hanging-chain", links, p.length, p.g, tuple(start.tolist()))


def _swing_figures(p: PendulumParameters) -> tuple[KnownValue, ...]:
    # Near the highest position errors grow, as the period does with the amplitude: by 1 / cos of
    # its half.
    growth = 1.0 / math.cos(p.amplitude / 2)
    return p.swing.figures(p.duration, max(1e-12, 1e-12 * p.swing.period * growth), 1e-11 * growth)


def _swing_conditions(p: PendulumParameters) -> tuple[Condition, ...]:
    return (suite_condition("P1", p.length, p.swing.at, p.duration, 20),)


def _chain_figures(p: ChainParameters) -> tuple[KnownValue, ...]:
    scale = p.N**2 * p.mass * p.g * p.length
    return (energy_figure(1e-11 * scale, p.duration),)


def _hanging_period(p: HangingChainParameters) -> float:
    return 2 * math.pi / math.sqrt(p.shape[0] * p.g / p.length)


def _hanging_figures(p: HangingChainParameters) -> tuple[KnownValue, ...]:
    exact = _hanging_period(p)
    # The oscillation is small: its period differs from the linear one by the amplitude's square.
    read = period(coordinate("a1"), LOWEST, 1.5 * exact)
    return (
        KnownValue(
            "period of the slowest small oscillation", exact, "s", exact * p.amplitude**2, read
        ),
    )


HIGH_PENDULUM = Benchmark(
    number="B01",
    name="high-pendulum",
    tags=("tree", "closed-form", "sensitive"),
    text="simple pendulum let go one degree below its highest position",
    source="period by an elliptic integral: "
    "E. T. Whittaker, Analytical Dynamics (4th ed., 1937), Ch. IV",
    parameters=HighPendulumParameters,
    build=partial(_pendulum, "high-pendulum"),
    figures=_swing_figures,
)
PENDULUM = replace(
    HIGH_PENDULUM,
    number="A01",
    name="pendulum",
    tags=("tree", "closed-form", "IFToMM"),
    text="simple pendulum let go level",
    source=_SUITE,
    parameters=PendulumParameters,
    build=partial(_pendulum, "pendulum"),
    conditions=_swing_conditions,
)
DOUBLE_PENDULUM = Benchmark(
    number="B02",
    name="double-pendulum",
    tags=("tree", "chaotic"),
    text="two uniform rods, chaotic",
    source="energy is conserved; T. Shinbrot et al., Am. J. Phys. 60 (1992) 491, on its chaos",
    parameters=DoublePendulumParameters,
    build=partial(_chain, "double-pendulum"),
    figures=_chain_figures,
)
CHAIN = replace(
    DOUBLE_PENDULUM,
    number="B03",
    name="chain",
    tags=("tree", "chaotic", "scalable"),
    text="chain of N uniform rods let go level",
    source="energy is conserved",
    parameters=ChainParameters,
    build=partial(_chain, "chain"),
)
HANGING_CHAIN = Benchmark(
    number="B04",
    name="hanging-chain",
    tags=("tree", "closed-form", "scalable"),
    text="N point masses on a hanging chain in their slowest small oscillation",
    source="frequencies by the roots of a Laguerre polynomial: "
    "D. Bernoulli, Comm. Acad. Petrop. 6 (1733) 108",
    parameters=HangingChainParameters,
    build=_hanging_chain,
    figures=_hanging_figures,
)
PENDULUMS = (PENDULUM, HIGH_PENDULUM, DOUBLE_PENDULUM, CHAIN, HANGING_CHAIN)
