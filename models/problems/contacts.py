"""Problems with stops that close again: bouncing, rest after a finite time, impacts between bodies."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from pydantic import Field

from ..mechanism import Mechanism
from ..problem import StopLaw
from ..spec import Positive, Real, Spec
from ..stops import Stop
from .benchmark import Benchmark, Figure, Motion
from .pendulums import pin_links, rods


class StoppedPendulumParameters(Spec):
    """Two equal uniform rods, the upper between two stops on either side of the vertical, let go from rest.

    Raises:
        InputError: a length, mass or gravity is not positive and finite, or an angle or the restitution out of range.
    """

    length: Positive = Field(default=1.0, description="of each rod [m]")
    mass: Positive = Field(default=1.0, description="of each rod [kg]")
    g: Positive = Field(default=9.81, description="gravity [m/s^2]")
    opening: Real = Field(default=0.5, gt=0, lt=1.5, description="of each stop from the vertical [rad]")
    swing: Real = Field(default=1.2, gt=0, lt=3, description="start angle of the lower rod from the vertical [rad]")
    restitution: Real = Field(default=0.7, gt=0, le=1, description="of both stops")


def _stopped_pendulum(p: StoppedPendulumParameters) -> Mechanism:
    down = math.pi / 2
    # Clockwise from the vertical is to the left.
    left = Stop(name="left", body="rod 1", sense=-1, limit=-(down + p.opening), closed=False, restitution=p.restitution)
    right = Stop(name="right", body="rod 1", sense=1, limit=down - p.opening, closed=False, restitution=p.restitution)
    return pin_links(
        "stopped-pendulum",
        rods(2, p.length, p.mass),
        p.length,
        p.g,
        (down, down + p.swing),
        stops=(left, right),
    )


def _energy_balance(p: StoppedPendulumParameters, end: float) -> Callable[[Motion], float]:
    """Largest difference of the energy from its start less what impacts took: half of P (v- + v+) each."""

    def read(motion: Motion) -> float:
        times = np.linspace(0.0, end, 400)
        energy = motion.trajectory(times).total_energy
        taken = np.zeros_like(times)
        for t, impulses in motion.impacts:
            speed = abs(float(motion.trajectory(np.array([t])).u[0, 0]))
            loss = sum(impulses.values()) * speed * (1 / p.restitution - 1) / 2
            taken += np.where(times >= t, loss, 0.0)
        return float(np.abs(energy + taken - energy[0]).max())

    return read


def _stopped_figures(p: StoppedPendulumParameters) -> tuple[Figure, ...]:
    scale = 4 * p.mass * p.g * p.length
    balance = _energy_balance(p, _stopped_duration(p))
    return (Figure("energy less that of the impacts", 0.0, "J", 1e-11 * scale, balance),)


def _stopped_duration(p: StoppedPendulumParameters) -> float:
    return round(9.0 * math.sqrt(p.length / p.g), 2)


STOPPED_PENDULUM = Benchmark(
    number="D02",
    name="stopped-pendulum",
    tags=("tree", "contact", "impact"),
    text="double pendulum whose upper rod swings between two stops",
    source="energy lost in an impact: W. Thomson, P. G. Tait, Natural Philosophy (1879), Sec. 308",
    parameters=StoppedPendulumParameters,
    build=_stopped_pendulum,
    duration=_stopped_duration,
    figures=_stopped_figures,
    stop_law=StopLaw.UNILATERAL,
)
CONTACTS = (STOPPED_PENDULUM,)
