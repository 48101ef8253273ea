"""Engines on machines away from Table I, and how far their figures may lie from ours.

Bars (:mod:`..tolerances`) are stated for the projectile's position p. A deviation that lasts at the end of a throw
turns with the projectile's velocity, at the rate w of its direction, so that the velocity is allowed p w and the
acceleration p w^2; every figure's allowance follows from those by its own derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...comparisons.runs.tolerances import is_table_one, tolerance_for
from ...comparisons.runs.worker import Worker, simulate_warm
from ...engines.protocol import Engine
from ...engines.registry import engine
from ...models.errors import TrebucheckError
from ...models.machines.trebuchet import PROJECTILE
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ...models.trajectory import Trajectory
from ...reference.throw.release import Projectile
from ..results import EngineValue

TAIL = 0.02  # [s] an engine runs on past what is read, so that there are samples on both sides


@dataclass(frozen=True)
class Allowed:
    """What an engine's bar allows of the projectile; None where no bar is stated."""

    position: float | None
    """[m]"""
    speed: float | None = None
    """[m/s], a bar of its own"""


def allowed(runner: Engine, mechanism: Mechanism) -> Allowed:
    """The tuned preset's bars at its step on a machine, as a comparison would judge them."""

    def value(metric: str, subject: str | None = None) -> float | None:
        table_one = is_table_one(mechanism)
        of = (runner.name, "tuned", metric, subject, mechanism)
        found = tolerance_for(*of, runner.timestep, table_one=table_one)
        return None if found is None else found.value

    return Allowed(value("position_max", PROJECTILE), value("launch_speed"))


def turning(projectile: Projectile, time: float) -> float:
    """Rate at which the velocity's direction turns [rad/s]."""
    _, (vx, vy), (ax, ay) = (part[0] for part in projectile.states(np.array([time])))
    return float(abs(vx * ay - vy * ax) / (vx * vx + vy * vy))


def speed_allowance(bars: Allowed, projectile: Projectile, time: float) -> float | None:
    """Of the speed at the launch [m/s]: p w, and what the speed changes while the projectile goes p."""
    if bars.speed is not None or bars.position is None:
        return bars.speed
    _, velocity, acceleration = (part[0] for part in projectile.states(np.array([time])))
    speed = float(np.linalg.norm(velocity))
    along = abs(float(velocity @ acceleration)) / speed
    return bars.position * (turning(projectile, time) + along / speed)


def simulated(name: str, mechanism: Mechanism, end: float, worker: Worker | None) -> Trajectory | str:
    """An engine's tuned run up to `end` [s], or why there is none.

    Args:
        worker: the process it runs in; None: here.
    """
    try:
        runner = engine(name)
        problem = Problem(mechanism, duration=end)
        return simulate_warm(runner, problem) if worker is None else worker.simulate(runner, problem)
    except TrebucheckError as error:
        return str(error)
    except Exception as error:  # a plug-in may raise anything; the study must survive it
        return f"{type(error).__name__}: {error}"


def launches(
    engines: Sequence[str], projectile: Projectile, launch: float, worker: Worker | None
) -> tuple[tuple[EngineValue, ...], tuple[EngineValue, ...]]:
    """Launch speeds [m/s] and least theta - theta(0) [rad] of engines on the reference's machine."""
    mechanism = projectile.solution.problem.mechanism
    runs = {name: simulated(name, mechanism, launch + TAIL, worker) for name in engines}
    speeds = [_speed(name, run, projectile, launch) for name, run in runs.items()]
    return tuple(speeds), tuple(_back(name, run, mechanism, launch) for name, run in runs.items())


def _speed(name: str, run: Trajectory | str, projectile: Projectile, launch: float) -> EngineValue:
    if isinstance(run, str):
        return EngineValue(engine=name, value=None, note=run)
    thrown = run.launch()
    if thrown is None:
        return EngineValue(engine=name, value=None, note="its projectile's velocity never comes down to 45 degrees")
    bars = allowed(engine(name), run.mechanism)
    return EngineValue(engine=name, value=thrown.speed, tolerance=speed_allowance(bars, projectile, launch))


def _back(name: str, run: Trajectory | str, mechanism: Mechanism, launch: float) -> EngineValue:
    if isinstance(run, str):
        return EngineValue(engine=name, value=None, note=run)
    position = allowed(engine(name), mechanism).position
    # An arm off by an angle moves the sling's pin by that times l1, and the projectile with it.
    lever = max(math.hypot(*joint.parent_point) for joint in mechanism.joints)
    return EngineValue(
        engine=name, value=furthest_back(run, launch), tolerance=None if position is None else position / lever
    )


def furthest_back(trajectory: Trajectory, until: float) -> float:
    """Least theta - theta(0) up to a time [rad]; 0 where the first coordinate never falls."""
    return float((trajectory.q[trajectory.t <= until, 0] - trajectory.q[0, 0]).min())
