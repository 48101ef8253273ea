"""Engines on the paper's machines: samples as a motion, and tolerances of their quantities.

Tolerances are stated for release times, torques, the energy and the projectile's position. What an
error of the position means for another quantity is estimated on the machine itself: each parameter
is changed a little, and the largest ratio of the quantity's change to the largest displacement of
the projectile up to the launch is taken. An error of the position is then allowed to do to the
quantity what a slightly different machine with that error would.

Machines away from Table I are not differentiated so. An error of the projectile's position p that
lasts at the end of a throw turns with the projectile's velocity, at the rate w of its direction, so
that the velocity is allowed p w and the acceleration p w^2; the allowance of every quantity follows
from those by its own derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from trebucheck.api.engines import ASSISTED, Engine, engine
from trebucheck.api.mechanics import (
    PROJECTILE,
    FloatArray,
    Launch,
    Mechanism,
    PointState,
    Problem,
    Projectile,
    Trajectory,
    TrebuchetParameters,
    model,
    solve,
)
from trebucheck.api.studies import StatedTolerance, Worker, failure, is_table_one, tolerance_for

from .claims import EngineValue
from .quantities import BEND, LAUNCH_TIME, Readings, ThrowQuantity, read

_DEGREE = 5  # error ~ step^6: far below that of any engine, at the steps they are run with
# Of the median step: samples closer than this (a release inside a step) unsettle a spline.
_CROWDED = 0.5


class SampledMotion:
    """A trajectory read at any time (a `Motion` of the reference's `quantities`).

    Positions, velocities and coordinates are quintic splines through the samples; an acceleration
    is the derivative of the velocity's spline. Torques and energies, which have kinks, are read
    linearly.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        self.trajectory = trajectory
        t = trajectory.t
        self._kept = np.concatenate([[True], np.diff(t) > _CROWDED * float(np.median(np.diff(t)))])
        self._launch = trajectory.launch()
        self._splines: dict[tuple[str, str], BSpline] = {}

    @property
    def release_times(self) -> Mapping[str, float | None]:
        """Times when the stops opened [s]."""
        return self.trajectory.release_times

    @property
    def launch(self) -> Launch | None:
        """The launch at 45 degrees."""
        return self._launch

    def state(self, t: float) -> tuple[FloatArray, FloatArray]:
        """Q and u."""
        q, u = self._spline("", "q", self.trajectory.q), self._spline("", "u", self.trajectory.u)
        return np.asarray(q(t)), np.asarray(u(t))

    def marker(self, name: str, t: float) -> PointState:
        """Position, velocity and acceleration of a marker, each (2,)."""
        motion = self.trajectory.marker(name)
        position = self._spline(name, "position", motion.position)
        velocity = self._spline(name, "velocity", motion.velocity)
        return np.asarray(position(t)), np.asarray(velocity(t)), np.asarray(velocity(t, 1))

    def stop_torques(self, t: float) -> Mapping[str, float]:
        """Torque of every stop [N m]; NaN for one the engine does not show."""
        recorded = self.trajectory.stop_torques
        return {
            stop.name: float(np.interp(t, self.trajectory.t, recorded[stop.name]))
            if stop.name in recorded
            else np.nan
            for stop in self.trajectory.mechanism.stops
        }

    def energy(self, t: float) -> float:
        """Total energy [J]."""
        return float(np.interp(t, self.trajectory.t, self.trajectory.total_energy))

    def _spline(self, name: str, what: str, values: FloatArray) -> BSpline:
        if (name, what) not in self._splines:
            kept = self._kept
            self._splines[name, what] = make_interp_spline(
                self.trajectory.t[kept], values[kept], k=_DEGREE
            )
        return self._splines[name, what]


_Result = TypeVar("_Result")
TAIL = 0.02  # [s] an engine runs on past what is read, so that there are samples on both sides
# Of a parameter's scale: far above the solver's rounding, far below what bends a response.
_CHANGE = 1e-6
# Of the solver for these: a change of 1e-6 is then known to one part in a million.
_TOLERANCE = 1e-12
_TICK = 1e-3  # [s] between samples of the changed machines' motions

Amplification = dict[ThrowQuantity, float]
"""Largest change of a quantity per metre of the projectile's displacement."""


def amplification(
    mechanism: Mechanism, parameters: TrebuchetParameters, until: float
) -> Amplification:
    """Tell how strongly the quantities of a named machine change with its projectile's position.

    Args:
        mechanism: the named machine of the parameters.
        parameters: those it was built from.
        until: end of the motions [s], past all that is read.
    """
    base, path = _moved(mechanism, until)
    ratios: Amplification = {}
    for name, value in parameters:
        changed = parameters.model_dump() | {name: value + _CHANGE * (abs(value) or 1.0)}
        values, other = _moved(model(mechanism.name, TrebuchetParameters(**changed)), until)
        ticks = int(base[LAUNCH_TIME] / _TICK)
        displaced = float(np.linalg.norm(other[:ticks] - path[:ticks], axis=1).max())
        for quantity in base.keys() & values.keys():
            ratio = abs(values[quantity] - base[quantity]) / displaced
            if math.isfinite(ratio):
                ratios[quantity] = max(ratios.get(quantity, 0.0), ratio)
    return ratios


def _moved(mechanism: Mechanism, until: float) -> tuple[Readings, FloatArray]:
    """Quantities and the projectile's path, sampled."""
    solution = solve(Problem(mechanism, duration=until), _TOLERANCE, _TOLERANCE)
    trajectory = solution.trajectory(np.arange(0.0, until, _TICK))
    return read(SampledMotion(trajectory), trajectory), trajectory.marker(PROJECTILE).position


def allowances(
    engine: Engine, mechanism: Mechanism, ours: Readings, amplified: Amplification
) -> Readings:
    """Tolerances of each quantity of an assisted preset; those without a basis are left out."""
    position = _applied(engine, "position_max", mechanism, PROJECTILE)
    tolerances: Readings = {}
    if position is not None:
        tolerances = {
            each: position.value * ratio
            for each, ratio in amplified.items()
            if each.follows_position
        }
        tolerances[BEND] = position.value / _shortest(mechanism)
    for quantity in ours:
        direct = _direct(engine, mechanism, quantity, ours)
        if direct is not None:
            tolerances[quantity] = direct
    return tolerances


def _shortest(mechanism: Mechanism) -> float:
    """Shortest lever [m] on which a body's angle moves its centre."""
    levers = [
        math.dist(j.child_point, mechanism.body(j.child).centre) for j in mechanism.tree_joints
    ]
    return min(lever for lever in levers if lever > 0)


def _direct(
    engine: Engine, mechanism: Mechanism, quantity: ThrowQuantity, ours: Readings
) -> float | None:
    """Take it from a tolerance of just this quantity."""
    tolerance = None if quantity.metric is None else _applied(engine, quantity.metric, mechanism)
    if tolerance is None:
        return None
    # 'per peak' is met at the start here: a closed stop's torque is largest there, or larger later.
    return tolerance.value * (abs(ours[quantity]) if tolerance.stated.per else 1.0)


def _applied(
    engine: Engine, metric: str, mechanism: Mechanism, subject: str | None = None
) -> StatedTolerance | None:
    """The tolerance of the assisted preset at the engine's own step."""
    table_one = is_table_one(mechanism)
    return tolerance_for(
        engine.name, ASSISTED, metric, subject, mechanism, engine.timestep, table_one=table_one
    )


@dataclass(frozen=True)
class Allowed:
    """Tolerances of the projectile under an engine; None where none is stated."""

    position: float | None
    """[m]"""
    speed: float | None = None
    """[m/s], a tolerance of its own"""


def allowed(runner: Engine, mechanism: Mechanism) -> Allowed:
    """Tolerances of the assisted preset at its step on a mechanism, as a comparison judges them."""
    position, speed = (
        _applied(runner, "position_max", mechanism, PROJECTILE),
        _applied(runner, "launch_speed", mechanism),
    )
    return Allowed(position and position.value, speed and speed.value)


def turning(projectile: Projectile, time: float) -> float:
    """Rate at which the velocity's direction turns [rad/s]."""
    _, (vx, vy), (ax, ay) = (part[0] for part in projectile.states(np.array([time])))
    return float(abs(vx * ay - vy * ax) / (vx * vx + vy * vy))


def speed_allowance(tolerances: Allowed, projectile: Projectile, time: float) -> float | None:
    """Tolerance of the launch speed [m/s]: p w, and the change of speed along p."""
    if tolerances.speed is not None or tolerances.position is None:
        return tolerances.speed
    _, velocity, acceleration = (part[0] for part in projectile.states(np.array([time])))
    speed = float(np.linalg.norm(velocity))
    along = abs(float(velocity @ acceleration)) / speed
    return tolerances.position * (turning(projectile, time) + along / speed)


def attempted(run: Callable[[], _Result]) -> _Result | str:
    """Result of a run, or why there is none: plug-ins may raise anything; the study goes on."""
    try:
        return run()
    except Exception as error:
        return failure(error)[1]


def simulated(
    name: str, mechanism: Mechanism, end: float, worker: Worker | None
) -> Trajectory | str:
    """An engine's run up to `end` [s], or why there is none; here if there is no worker."""
    at = worker or Worker(isolate=False)
    return attempted(lambda: at.simulate(engine(name), Problem(mechanism, duration=end)))


def launches(
    engines: Sequence[str], projectile: Projectile, launch: float, worker: Worker | None
) -> tuple[tuple[EngineValue, ...], tuple[EngineValue, ...]]:
    """Launch speeds [m/s] and least theta - theta(0) [rad] of engines on our machine."""
    mechanism = projectile.solution.problem.mechanism
    runs = {name: simulated(name, mechanism, launch + TAIL, worker) for name in engines}
    speeds = [_speed(name, run, projectile, launch) for name, run in runs.items()]
    return tuple(speeds), tuple(_back(name, run, mechanism, launch) for name, run in runs.items())


def _speed(name: str, run: Trajectory | str, projectile: Projectile, launch: float) -> EngineValue:
    if isinstance(run, str):
        return EngineValue(engine=name, value=None, note=run)
    thrown = run.launch()
    if thrown is None:
        return EngineValue(
            engine=name, value=None, note="its projectile's velocity never comes down to 45 degrees"
        )
    tolerances = allowed(engine(name), run.mechanism)
    return EngineValue(
        engine=name, value=thrown.speed, tolerance=speed_allowance(tolerances, projectile, launch)
    )


def _back(name: str, run: Trajectory | str, mechanism: Mechanism, launch: float) -> EngineValue:
    if isinstance(run, str):
        return EngineValue(engine=name, value=None, note=run)
    position = allowed(engine(name), mechanism).position
    # An arm off by an angle moves the sling's pin by that times l1, and the projectile with it.
    lever = max(math.hypot(*joint.parent_point) for joint in mechanism.joints)
    return EngineValue(
        engine=name,
        value=furthest_back(run, launch),
        tolerance=None if position is None else position / lever,
    )


def furthest_back(trajectory: Trajectory, until: float) -> float:
    """Least theta - theta(0) up to a time [rad]; 0 where the first coordinate never falls."""
    return float((trajectory.q[trajectory.t <= until, 0] - trajectory.q[0, 0]).min())
