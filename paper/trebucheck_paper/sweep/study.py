"""The fixed machine with its fulcrum anywhere on a beam of fixed length: Sec. V and Fig. 5."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from pydantic import Field
from scipy.optimize import brentq
from scipy.stats import linregress
from trebucheck.api.mechanics import (
    HANGER_REST,
    Equations,
    FloatArray,
    InputError,
    Projectile,
    Real,
    Spec,
    TrebuchetParameters,
    Vector,
    fixed,
    solve_to_launch,
)
from trebucheck.api.studies import Worker

from ..evidence.claims import BEST_L1, TABLE_L1, ZERO_L1, EngineValue, Quantity
from ..evidence.engine_runs import furthest_back, launches
from .laws import PAPER_GRID, Artefact, Curve, artefact, bilateral, pulls_at_start, release_once
from .rigid_swing import (
    RigidSwing,
    Swing,
    gravity_and_inertia,
    hanger_torque_on_beam,
    on_beam,
    zeros_within,
)

ENGINES = ("mujoco", "pymunk", "exudyn")
WITH_ENGINES = (8.6, 9.0, 9.5, 9.89, 10.3, 12.6, 12.72, 12.73, 12.9)
"""Positions l1 [m] that engines simulate: backward falls, the plot's zeros, the regime change."""
DENNY = (3.0, 5.0)
"""Lever ratios the paper quotes as the best for a similar system."""
HAIR = 1e-6
"""Either side of the regime change [m]: to this it is located."""
_INTERVALS = 180  # of the curve: 25 mm each over the paper's range
# Of the interpolation around the peak [m]; its coefficients fall below rounding there.
_HALF_WIDTH, _DEGREE = (0.25, 14)
_SAFETY = 4.0  # on the difference of two integrators, as where certificates are estimated


class Peak(Spec):
    """Place where the launch is fastest."""

    l1: Quantity
    speed: Quantity
    lever_ratio: Real = Field(description="l1 / l2")
    interior: bool = Field(description="whether it lies inside the swept range")


class Position(Spec):
    """One place of the fulcrum."""

    l1: Real = Field(description="[m]")
    lever_ratio: Real = Field(description="l1 / l2")
    arm_torque: Real = Field(
        description="of gravity about the fulcrum at the start, positive clockwise [N m]"
    )
    arm_acceleration: Real = Field(description="of theta at the start [rad/s^2]")
    counterweight_acceleration: Vector = Field(description="at the start, x and y [m/s^2]")
    rest_torques: dict[str, Real] = Field(
        description="at the start, both held; negative: would have to pull [N m]"
    )
    release_times: dict[str, Real | None] = Field(
        description="of the rests, under release-once [s]"
    )
    furthest_back: Real = Field(
        description="least of theta - theta(0) up to the launch [rad]; 0: never backward"
    )
    launch_time: Real | None = Field(description="[s]")
    speed: Quantity | None = Field(description="at the launch, under release-once [m/s]")
    bilateral_speed: Real | None = Field(description="at the launch, under the bilateral law [m/s]")
    engines: tuple[EngineValue, ...] = Field(
        default=(), description="launch speed of each engine's assisted preset [m/s]"
    )
    engines_furthest_back: tuple[EngineValue, ...] = Field(
        default=(), description="as `furthest_back` [rad]"
    )


class Backward(Spec):
    """Place on the beam where the machine starts to fall backward: zero torque of gravity."""

    l1: Real | None = Field(
        description="below it the arm turns backward [m]; None: nowhere on the beam"
    )
    counterweight_past_pivot: Real | None = Field(
        description="below it the counterweight starts behind it [m]"
    )
    least_torque: Real = Field(
        description="of gravity about the fulcrum at the start, over the swept range [N m]"
    )
    furthest_back: Real = Field(
        description="least theta - theta(0) before the launch, over all positions [rad]"
    )


class Neighbourhood(Spec):
    """Point of the curve and its neighbours on the paper's grid."""

    l1: Real = Field(description="[m]")
    step: Real = Field(description="of the grid [m]")
    speed: Real = Field(description="[m/s]")
    from_neighbours: Real = Field(description="interpolated from the neighbours alone [m/s]")
    second_difference: Real = Field(
        description="over one step, divided by its square [m/s per m^2]"
    )
    second_derivative: Real = Field(
        description="of the curve around it, the point itself left out [m/s per m^2]"
    )


class Regime(Spec):
    """Place where the hanger's rest would begin to have to pull at the start."""

    l1: Quantity | None = Field(
        description="zero of the hanger's torque at the start, in closed form [m]; None: none"
    )
    root: Real | None = Field(
        default=None, description="the same by root finding on the equations of motion [m]"
    )
    needed: Real | None = Field(
        default=None, description="acceleration across the hanger that the arm imposes [m/s^2]"
    )
    available: Real | None = Field(
        default=None, description="gravity's component across the hanger [m/s^2]"
    )
    below: Position | None = Field(default=None, description="a hair below it")
    above: Position | None = Field(default=None, description="a hair above it")
    swing: Swing | None = Field(
        default=None,
        description="just above it, taken in the paper's order: both held until the hanger's "
        "torque is zero",
    )


class Trend(Spec):
    """A straight line through the curve."""

    start: Real = Field(description="l1 [m]")
    end: Real = Field(description="l1 [m]")
    slope: Real = Field(description="[m/s per m]")
    determination: Real = Field(description="R^2 of the line")
    largest_residual: Real = Field(description="[m/s]")
    falling: bool = Field(description="whether the speed falls everywhere")
    steepest: Real = Field(description="[m/s per m]")
    flattest: Real = Field(description="[m/s per m]")


class Sweep(Spec):
    """Results of all studies."""

    beam: Real = Field(description="l1 + l2 [m]")
    start: Real = Field(description="of l1 [m]")
    end: Real = Field(description="of l1 [m]")
    curve: Curve
    peak: Peak
    positions: tuple[Position, ...] = Field(description="in order of l1; engines at some of them")
    backward: Backward
    suspect: Neighbourhood = Field(description="at the isolated zero of the paper's plot")
    regime: Regime
    trend: Trend = Field(description="from the paper's peak to the regime change")
    artefact: Artefact
    seconds: Real = Field(description="wall time [s]")

    def position(self, l1: float) -> Position | None:
        """The looked-at place nearest to within a nanometre, if it is one of them."""
        return next((p for p in self.positions if abs(p.l1 - l1) < 1e-9), None)


@dataclass(frozen=True)
class Beam:
    """The fixed machine with its fulcrum anywhere on a beam."""

    parameters: TrebuchetParameters
    length: float
    start: float
    end: float

    def rigid(self, l1: float) -> RigidSwing:
        """The machine at a place, its rests held."""
        return RigidSwing(on_beam(self.parameters, self.length, l1))

    def speeds(self, l1: FloatArray) -> FloatArray:
        """Launch speeds under release-once [m/s], NaN where there is no launch; shape like l1."""
        return release_once([fixed(on_beam(self.parameters, self.length, float(x))) for x in l1])[1]

    def bilateral_speed(self, rigid: RigidSwing, free: float) -> float:
        """Speed under the bilateral law [m/s], with `free` under release-once; NaN: no launch."""
        if not pulls_at_start(rigid):
            return (
                free  # the laws differ in nothing but a rest that would have to pull at the start
            )
        launch = bilateral(rigid).launch
        return np.nan if launch is None else launch.speed

    def curve(self) -> Curve:
        """Fig. 5 under both laws.

        Raises:
            InputError: the machine launches nowhere.
        """
        l1 = np.linspace(self.start, self.end, _INTERVALS + 1)
        rigids = [self.rigid(float(x)) for x in l1]
        times, speeds = release_once([rigid.mechanism for rigid in rigids])
        if not np.isfinite(speeds).any():
            raise InputError(
                f"the machine launches nowhere for l1 from {self.start!r} to {self.end!r} m."
            )
        held = [
            self.bilateral_speed(rigid, float(speed))
            for rigid, speed in zip(rigids, speeds, strict=True)
        ]
        return Curve(
            l1=tuple(l1.tolist()),
            release_once=_or_none(speeds),
            bilateral=_or_none(np.array(held)),
            times=_or_none(times),
        )

    def peak(self, curve: Curve) -> Peak:
        """Peak by the derivative of a Chebyshev interpolant, checked by another integrator."""
        l1, speeds = (
            np.array(curve.l1),
            np.array([np.nan if v is None else v for v in curve.release_once]),
        )
        highest = float(l1[np.nanargmax(speeds)])
        domain = (max(self.start, highest - _HALF_WIDTH), min(self.end, highest + _HALF_WIDTH))
        fine, rough = (
            Chebyshev.interpolate(self.speeds, degree, domain) for degree in (_DEGREE, _DEGREE - 4)
        )
        maxima = [_stationary(fit, domain) for fit in (fine, rough)]
        at = highest if maxima[0] is None else maxima[0]
        solution = solve_to_launch(self.rigid(at).mechanism)
        exact = np.nan if solution.launch is None else solution.launch.speed
        error = _SAFETY * (abs(exact - float(fine(at))) + abs(float(fine(at) - rough(at))))
        # The error e of the speed gives an error x of the peak's position: e = v'' x^2 / 2.
        bend = abs(float(fine.deriv(2)(at)))
        shift = (
            abs(at - maxima[1])
            if maxima[0] is not None and maxima[1] is not None
            else np.sqrt(2 * error / bend)
        )
        return Peak(
            l1=Quantity(value=at, uncertainty=float(_SAFETY * shift + np.spacing(at)), unit="m"),
            speed=Quantity(value=float(exact), uncertainty=error, unit="m/s"),
            lever_ratio=at / (self.length - at),
            interior=maxima[0] is not None,
        )

    def position(
        self, l1: float, engines: Sequence[str] = (), worker: Worker | None = None
    ) -> Position:
        """Compute what is said of one place."""
        rigid = self.rigid(l1)
        solution = solve_to_launch(rigid.mechanism)
        launch = solution.launch
        other = float(self.speeds(np.array([l1]))[0])
        end = solution.segments[-1].end if launch is None else launch.time
        trajectory = solution.trajectory(np.linspace(0.0, end, 500))
        speeds, back = launches(engines, Projectile(solution), end, worker) if launch else ((), ())
        speed = (
            None
            if launch is None
            else Quantity(
                value=launch.speed, uncertainty=_SAFETY * abs(other - launch.speed), unit="m/s"
            )
        )
        held = self.bilateral_speed(rigid, np.nan if launch is None else launch.speed)
        return Position(
            l1=l1,
            lever_ratio=l1 / (self.length - l1),
            arm_torque=rigid.torque,
            arm_acceleration=rigid.acceleration,
            counterweight_acceleration=rigid.point_acceleration("hanger"),
            rest_torques={
                s.name: rigid.start_torque(s.name) for s in rigid.mechanism.stops if s.closed
            },
            release_times={
                s.name: solution.release_times[s.name] for s in rigid.mechanism.stops if s.closed
            },
            furthest_back=furthest_back(trajectory, end),
            launch_time=None if launch is None else launch.time,
            speed=speed,
            bilateral_speed=held if np.isfinite(held) else None,
            engines=speeds,
            engines_furthest_back=back,
        )

    def backward(self, positions: Sequence[Position]) -> Backward:
        """Find where the machine would fall backward, and whether it does at the places seen."""
        torque, _ = gravity_and_inertia(self.parameters, self.length)
        pivot = self.length - self.parameters.h * np.cos(self.parameters.alpha0) / np.cos(
            self.parameters.theta0
        )
        turning = zeros_within(torque, 0.0, self.length)
        return Backward(
            l1=turning[0] if turning else None,
            counterweight_past_pivot=float(pivot) if 0 < pivot < self.length else None,
            least_torque=min(
                float(torque(self.start)), float(torque(self.end))
            ),  # it is linear in l1
            furthest_back=min(position.furthest_back for position in positions),
        )

    def neighbourhood(self, l1: float, step: float) -> Neighbourhood:
        """The speed there, and the polynomial through four neighbours on either side."""
        steps = np.arange(-4.0, 5.0)
        speeds = self.speeds(np.asarray(l1 + step * steps, dtype=np.float64))
        around = Polynomial.fit(steps[steps != 0], speeds[steps != 0], 7).convert()
        return Neighbourhood(
            l1=l1,
            step=step,
            speed=float(speeds[4]),
            from_neighbours=float(around(0.0)),
            second_difference=float(speeds[3] - 2 * speeds[4] + speeds[5]) / step**2,
            second_derivative=float(around.deriv(2)(0.0)) / step**2,
        )

    def start_torque(self, l1: float) -> float:
        """Initial torque of the hanger's rest, both held, by the equations of motion [N m]."""
        mechanism = self.rigid(l1).mechanism
        q = np.array(mechanism.start)
        closed = [stop.name for stop in mechanism.stops if stop.closed]
        return float(
            Equations(mechanism).solve(q, np.zeros_like(q), closed)[1][closed.index(HANGER_REST)]
        )

    @property
    def change(self) -> float | None:
        """Place where the hanger's torque at the start changes sign [m]."""
        zeros = zeros_within(
            hanger_torque_on_beam(self.parameters, self.length), self.start, self.end
        )
        return zeros[-1] if zeros else None

    def regime(self) -> Regime:
        """The change in closed form, by root finding, and what it does to the launch."""
        l1 = self.change
        if l1 is None:
            return Regime(l1=None)
        p, rigid = self.parameters, self.rigid(l1)
        near = max(self.start, l1 - 0.1), min(self.end, l1 + 0.1)
        root = float(brentq(self.start_torque, *near, xtol=1e-14, rtol=1e-15))
        beside = [self.position(x) for x in (l1 - HAIR, l1 + HAIR)]
        above = self.rigid(l1 + HAIR)
        return Regime(
            l1=Quantity(value=l1, uncertainty=_SAFETY * abs(root - l1) + np.spacing(l1), unit="m"),
            root=root,
            needed=rigid.acceleration
            * (p.h - (self.length - l1) * float(np.cos(p.theta0 - p.alpha0))),
            available=p.g * float(np.cos(p.alpha0)),
            below=beside[0],
            above=beside[1],
            swing=Swing(
                l1=l1 + HAIR,
                largest_angle=p.theta0 + 2 * above.sense * above.amplitude,
                period=above.period,
                largest_torque=above.largest_torque(HANGER_REST),
                zeros=above.zeros(HANGER_REST),
            ),
        )

    def trend(self, curve: Curve, start: float, end: float) -> Trend:
        """A straight line through the curve between two places [m]."""
        points = [
            (x, v) for x, v in zip(curve.l1, curve.release_once, strict=True) if v is not None
        ]
        between = [point for point in points if start <= point[0] <= end]
        l1, speeds = np.array(
            between if len(between) > 2 else points
        ).T  # a sweep that ends before: all of it
        fit = linregress(l1, speeds)
        slopes = np.diff(speeds) / np.diff(l1)
        return Trend(
            start=float(l1[0]),
            end=float(l1[-1]),
            slope=float(fit.slope),
            determination=float(fit.rvalue**2),
            largest_residual=float(np.abs(speeds - fit.intercept - fit.slope * l1).max()),
            falling=bool(np.all(slopes < 0)),
            steepest=float(slopes[np.argmax(np.abs(slopes))]),
            flattest=float(slopes[np.argmin(np.abs(slopes))]),
        )


def _stationary(fit: Chebyshev, domain: tuple[float, float]) -> float | None:
    """Find where an interpolant has its maximum inside its domain."""
    roots = fit.deriv().roots()
    inside = [
        float(r.real) for r in roots if abs(r.imag) < 1e-12 and domain[0] < r.real < domain[1]
    ]
    return max(inside, key=lambda x: float(fit(x)), default=None)


def _or_none(values: FloatArray) -> tuple[float | None, ...]:
    return tuple(float(v) if np.isfinite(v) else None for v in values)


def fulcrum_sweep(
    parameters: TrebuchetParameters | None = None,
    beam: float = 14.0,
    start: float = 8.5,
    end: float = 13.0,
    engines: Sequence[str] = ENGINES,
    worker: Worker | None = None,
    with_engines: Sequence[float] = WITH_ENGINES,
) -> Sweep:
    """Launch speed of the fixed machine against l1 on its beam, with peak, regimes and artefacts.

    Args:
        parameters: all but l1 and l2; Table I where left out.
        beam: l1 + l2 [m].
        start, end: of l1 [m].
        engines: names; one that fails or is absent becomes a note.
        worker: the process engines run in; None: this one.
        with_engines: l1 of the positions that engines simulate [m]; those outside the sweep are
            left out.

    Raises:
        InputError: the range is empty or not on the beam, or the machine launches nowhere in it.
        SimulationError: an integrator of the reference gave up.
    """
    if not 0 < start < end < beam:
        raise InputError(
            f"start = {start!r} m and end = {end!r} m must satisfy 0 < start < end < beam = "
            f"{beam!r} m."
        )
    began = time.perf_counter()
    line = Beam(parameters or TrebuchetParameters(), beam, start, end)
    curve = line.curve()
    peak = line.peak(curve)
    regime = line.regime()
    with_runs = {x for x in with_engines if start <= x <= end}
    others = {
        BEST_L1.value,
        TABLE_L1.value,
        ZERO_L1.value,
        *(beam * ratio / (1 + ratio) for ratio in DENNY),
    }
    all_l1 = sorted(with_runs | {x for x in others if start <= x <= end} | {peak.l1.value})
    positions = tuple(line.position(x, engines if x in with_runs else (), worker) for x in all_l1)
    return Sweep(
        beam=beam,
        start=start,
        end=end,
        curve=curve,
        peak=peak,
        positions=positions,
        backward=line.backward(positions),
        suspect=line.neighbourhood(ZERO_L1.value, PAPER_GRID),
        regime=regime,
        trend=line.trend(curve, BEST_L1.value, end if regime.l1 is None else regime.l1.value),
        artefact=artefact(line.rigid, start, end, None if regime.l1 is None else regime.l1.value),
        seconds=time.perf_counter() - began,
    )
