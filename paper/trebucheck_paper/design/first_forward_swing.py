"""The first forward swing of a throw: instants of largest kinetic energy and best release."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

import numpy as np
from numpy.polynomial import Chebyshev
from pydantic import Field
from trebucheck.api.mechanics import (
    ARM_STOP,
    COUNTERWEIGHT,
    PROJECTILE,
    SLING_REST,
    FloatArray,
    Mechanism,
    Problem,
    Projectile,
    Real,
    Release,
    Solution,
    Spec,
    Surroundings,
    TrebucheckError,
    TrebuchetParameters,
    characteristic_time,
    fall_time,
    fly,
    launch_interval,
    lead,
    solve,
    solve_taylor,
)

from ..evidence.claims import EngineValue, Quantity
from .efficiency import available_energy


class Reading(StrEnum):
    """Instant that the projectile's largest kinetic energy is to coincide with."""

    RANGE_OPTIMAL = "range-optimal release"
    """The machine's own best angle."""
    FORTY_FIVE = "velocity at 45 degrees"
    """The simpler reading."""


class Throwing(Spec):
    """One rolling machine's first forward swing, by the reference."""

    parameters: TrebuchetParameters
    lever_ratio: Real = Field(description="l1 / l2")
    fastest_time: Real = Field(description="of the projectile's largest kinetic energy [s]")
    best_time: Real = Field(description="of the range-optimal release [s]")
    launch_time: Real = Field(description="of the velocity at 45 degrees [s]")
    largest_speed: Real = Field(description="[m/s]")
    speed: Real = Field(description="at the range-optimal release [m/s]")
    angle: Real = Field(description="there, above the horizontal [rad]")
    range: Real = Field(description="from the fulcrum's x at the start to y = 0 [m]")
    ratio: Real = Field(description="the paper's R there: kinetic over total energy")
    available_energy: Real = Field(
        description="from the start down to its lowest position of all [J]"
    )
    efficiency: Real = Field(description="kinetic energy there over the available energy")
    arm_angle: Real = Field(
        description="theta at the range-optimal release [rad]; the third constraint is at 3 pi / 2"
    )
    sling_release: Real = Field(description="when the sling's rest opens [s]")
    rest_torques: dict[str, Real] = Field(description="largest torque of each rest [N m]")
    lowest: dict[str, Real] = Field(
        description="least y of projectile and counterweight up to the release [m]"
    )

    @property
    def gap(self) -> float:
        """Largest kinetic energy after the range-optimal release [s]."""
        return self.fastest_time - self.best_time


class Bounds(Spec):
    """Bounds of the chosen parameters."""

    r: tuple[Real, Real] = Field(default=(2.0, 12.0), description="sling [m]")
    h: tuple[Real, Real] = Field(default=(2.0, 14.0), description="hanger [m]")
    l1: tuple[Real, Real] = Field(default=(7.0, 13.0), description="arm on the sling's side [m]")


class Optimality(Spec):
    """First and second order conditions of the design, checked on what is reported."""

    residual: Real = Field(
        description="|projected gradient of the Lagrangian| over |gradient of the objective|"
    )
    multiplier: Real | None = Field(
        description="of the coincidence; [m of range per s] where range is the objective"
    )
    neighbours: tuple[Real, ...] = Field(
        description="objective at neighbours that also coincide, minus the design's own: all "
        "negative at a maximum"
    )
    active: tuple[str, ...] = Field(
        description="bounds it stands on, such as 'h at 14'; empty: it lies inside"
    )
    starts: int = Field(description="starts of the search")
    reached: int = Field(
        description="of those, how many came to this design, within 0.1 % of each length"
    )


class CoincidingDesign(Spec):
    """A rolling machine whose largest kinetic energy comes at its best release."""

    name: str
    objective: Literal["range", "nearness"] = Field(
        description="largest range, or least relative change of r, h and l1 from the paper's "
        "machine"
    )
    reading: Reading
    throwing: Throwing
    difference: Quantity = Field(
        description="largest kinetic energy after the release it is to coincide with [s]"
    )
    change: Real = Field(description="root sum square of the relative changes of r, h and l1")
    optimality: Optimality
    warnings: tuple[str, ...] = Field(
        description="what a builder should know: slack slings, lifting wheels, stops met"
    )
    engines: dict[str, tuple[EngineValue, ...]] = Field(
        default_factory=dict,
        description="by figure: largest_ratio_time, best_release_time, best_release_angle, "
        "best_release_speed, best_range",
    )


class Design(Spec):
    """The paper's open question, answered."""

    bounds: Bounds
    constraints: tuple[str, ...] = Field(description="what was asked of a design besides, in words")
    paper_rolling: Throwing
    paper_fixed: Throwing
    designs: tuple[CoincidingDesign, ...] = Field(
        description="those that were found; empty: no start led to one"
    )
    unconstrained: Throwing | None = Field(
        description="largest range within the bounds, whatever the times"
    )
    seconds: Real = Field(description="wall time [s]")

    def named(self, name: str) -> CoincidingDesign | None:
        """The design of that name."""
        return next((design for design in self.designs if design.name == name), None)


# Longest simulated motions, in characteristic times; Table I's rolling machine has swept after 1.5.
_SPANS = (1.9, 3.0)
_SCAN = 1000  # samples from the sling's release on: a spacing of some 2 ms on Table I
# Of interpolants over two such intervals, in which a throw changes by a tenth: to rounding.
_DEGREE = 10
_REAL = 1e-9  # [s] imaginary part of a root that is rounding
_LOOKS = 200  # at the arm's angle, which changes by 0.03 rad in between
_COARSE = 1e-11  # local error where heyoka is not installed
_SAMPLES = 800  # of a motion, for its largest torques and lowest places

Solver = Callable[[Problem], Solution]


def quick(problem: Problem) -> Solution:
    """The fastest of the integrators whose errors of an instant are below a nanosecond."""
    if importlib.util.find_spec("heyoka") is not None:
        return solve_taylor(problem)
    return solve(problem, _COARSE, _COARSE)


@dataclass(frozen=True)
class FirstForwardSwing:
    """A machine's first forward throw."""

    projectile: Projectile
    surroundings: Surroundings
    fastest: float
    """When the projectile's kinetic energy is largest [s]."""
    best: Release
    """The release that flies farthest."""
    range: float
    """[m]"""
    launch: float
    """When the velocity comes down to 45 degrees [s]."""

    @property
    def solution(self) -> Solution:
        """The machine's motion."""
        return self.projectile.solution

    def delay(self, reading: Reading) -> float:
        """Largest kinetic energy after the release it is to coincide with [s]."""
        return self.fastest - (self.best.time if reading is Reading.RANGE_OPTIMAL else self.launch)


def first_forward_swing_of(
    mechanism: Mechanism, solver: Solver = quick
) -> FirstForwardSwing | None:
    """The first forward swing of a machine; None where it is no throw.

    It is one where the sling's rest opens, the velocity comes down to 45 degrees within three
    characteristic times, the speed has its largest value inside the sweep and not at an end of it,
    a release flies forward to the fulcrum's height, and the arm does not come to its stop before
    any of these instants.
    """
    try:
        scanned = _scanned(mechanism, solver)
        if scanned is None:
            return None
        around = Surroundings(gravity=mechanism.gravity)
        fastest = scanned.largest(
            lambda _, v, __: np.sum(v**2, axis=1), lambda _, v, a: np.sum(v * a, axis=1)
        )
        best = scanned.largest(
            lambda x, v, _: _ranges(x, v, around), lambda x, v, a: _range_rates(x, v, a, around)
        )
        launch = scanned.launch
        if fastest is None or best is None or launch is None:
            return None
        release = scanned.projectile.release_at(best)
        reached = fly(release, around).range
    except TrebucheckError:
        return None
    swing = FirstForwardSwing(scanned.projectile, around, fastest, release, reached, launch)
    return (
        swing if reached > 0 and release.velocity[0] > 0 and _before_the_arm_stop(swing) else None
    )


States = tuple[FloatArray, FloatArray, FloatArray]
Along = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""A quantity of the projectile's position, velocity and acceleration, each (n, 2)."""


@dataclass(frozen=True)
class _Scanned:
    """A sweep looked at in many instants at once."""

    projectile: Projectile
    times: FloatArray
    states: States

    @property
    def launch(self) -> float | None:
        """Time when the velocity comes down to 45 degrees [s]."""
        i = launch_interval(self.states[1])
        return None if i is None else self._zero(lambda _, v, __: lead(v), i, i + 1)

    def largest(self, value: Along, rate: Along) -> float | None:
        """Time when a quantity is largest [s], at the zero of its rate; None at an end."""
        i = int(np.nanargmax(value(*self.states)))
        return None if i in (0, len(self.times) - 1) else self._zero(rate, i - 1, i + 1)

    def _zero(self, rate: Along, before: int, after: int) -> float | None:
        """Zero of a smooth quantity between two instants [s], by its Chebyshev interpolant."""
        domain = (float(self.times[before]), float(self.times[after]))
        fit = Chebyshev.interpolate(lambda t: rate(*self.projectile.states(t)), _DEGREE, domain)
        if not np.all(np.isfinite(fit.coef)):
            return None  # beside this instant nothing lands
        roots = fit.roots()
        real = roots.real[np.abs(roots.imag) < _REAL]
        return next((float(root) for root in real if domain[0] <= root <= domain[1]), None)


def _scanned(mechanism: Mechanism, solver: Solver) -> _Scanned | None:
    """Interval from the opening of the sling's rest to the velocity's first pointing straight down.

    A short sling may whirl the projectile over without its ever pointing down: then to the end of
    the shortest motion in which it is launched.
    """
    scale, launched = characteristic_time(mechanism), None
    for spans in _SPANS:
        projectile = Projectile(solver(Problem(mechanism, duration=spans * scale)))
        if projectile.solution.release_times[SLING_REST] is None:
            continue
        times = np.linspace(projectile.opened, projectile.end, _SCAN)
        states = projectile.states(times)
        down = launch_interval(states[1], -math.pi / 2)
        if down is not None:
            swept = slice(0, down + 1)
            return _Scanned(
                projectile, times[swept], (states[0][swept], states[1][swept], states[2][swept])
            )
        if launched is None and launch_interval(states[1]) is not None:
            launched = _Scanned(projectile, times, states)
    return launched


def _ranges(position: FloatArray, velocity: FloatArray, around: Surroundings) -> FloatArray:
    """Ranges of releases, NaN where nothing lands [m], shape (n,)."""
    ranges = (
        position[:, 0]
        + velocity[:, 0] * fall_time(position[:, 1], velocity[:, 1], around)
        - around.origin
    )
    return np.where(np.isfinite(ranges), ranges, -np.inf)


def _range_rates(
    position: FloatArray, velocity: FloatArray, acceleration: FloatArray, around: Surroundings
) -> FloatArray:
    """Change of the range per second of later release [m/s], shape (n,), as flight.range_rate."""
    time = fall_time(position[:, 1], velocity[:, 1], around)
    moved = velocity + acceleration * time[:, None]
    return moved[:, 0] - velocity[:, 0] / (velocity[:, 1] - around.gravity * time) * moved[:, 1]


def kinetic_rate(projectile: Projectile, t: float) -> float:
    """Rate of the kinetic energy per mass, v . a [m^2/s^3]."""
    _, velocity, acceleration = projectile.states(np.array([t]))
    return float(velocity[0] @ acceleration[0])


def _before_the_arm_stop(swing: FirstForwardSwing) -> bool:
    kinematics = swing.solution.equations.kinematics
    times = np.linspace(0.0, max(swing.fastest, swing.best.time, swing.launch), _LOOKS)
    return bool(np.all(kinematics.gap(ARM_STOP, swing.solution.motion(times).q) > 0))


def read_throw(parameters: TrebuchetParameters, swing: FirstForwardSwing) -> Throwing:
    """The values of a first forward swing."""
    solution, p = swing.solution, parameters
    until = max(swing.best.time, swing.fastest)
    path = solution.trajectory(np.linspace(0.0, until, _SAMPLES))
    mechanism = solution.problem.mechanism
    kinetic = 0.5 * p.m_b * swing.best.speed**2
    available = available_energy(mechanism)
    opened = solution.release_times[SLING_REST]
    assert opened is not None  # without it there is no first forward swing
    return Throwing(
        parameters=p,
        lever_ratio=p.l1 / p.l2,
        fastest_time=swing.fastest,
        best_time=swing.best.time,
        launch_time=swing.launch,
        largest_speed=swing.projectile.release_at(swing.fastest).speed,
        speed=swing.best.speed,
        angle=swing.best.angle,
        range=swing.range,
        ratio=kinetic / float(path.total_energy[0]),
        available_energy=available,
        efficiency=kinetic / available,
        arm_angle=float(solution.motion(np.array([swing.best.time])).q[0, 0]),
        sling_release=opened,
        rest_torques={
            s.name: float(path.stop_torque(s.name).max()) for s in mechanism.stops if s.closed
        },
        lowest={
            name: float(path.marker(name).position[:, 1].min())
            for name in (PROJECTILE, COUNTERWEIGHT)
        },
    )
