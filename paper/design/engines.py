"""What engines say of a design, and how far their figures may lie from ours."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ...comparisons.runs.worker import Worker
from ...engines.registry import engine
from ...models.mechanism import Mechanism
from ...models.trajectory import Trajectory
from ...reference.certification.quantities import BEYOND_LAUNCH, Plan, read_quantities
from ...reference.throw.flight import fly, range_rate
from ..results import EngineValue
from ..sampled import SampledMotion
from ..sweep.engines import TAIL, allowed, simulated, turning
from .first_forward_swing import FirstSweep, kinetic_rate

FIGURES = ("largest_ratio_time", "best_release_time", "best_release_angle", "best_release_speed", "best_range")
_STEP = 1e-4  # [s] for derivatives in time of what changes over hundredths of a second


def confirmed(engines: Sequence[str], found: FirstSweep, worker: Worker | None) -> dict[str, tuple[EngineValue, ...]]:
    """Every engine's values of :data:`FIGURES`, in SI units and radians, with their tolerances.

    Args:
        engines: names; one that fails or is absent has a note instead of a value.
        found: the design's first sweep by the reference.
        worker: the process engines run in; None: this one.
    """
    mechanism = found.solution.problem.mechanism
    end = max(found.launch + BEYOND_LAUNCH, found.fastest, found.best.time) + TAIL
    values: dict[str, list[EngineValue]] = {name: [] for name in FIGURES}
    for name in engines:
        run = simulated(name, mechanism, end, worker)
        figures_of = {} if isinstance(run, str) else _read(run)
        bars = tolerances(found, allowed(engine(name), mechanism).position) if figures_of else {}
        note = run if isinstance(run, str) else None
        for figure in FIGURES:
            missing = "its motion has no such instant" if note is None and figure not in figures_of else note
            value = EngineValue(engine=name, value=figures_of.get(figure), tolerance=bars.get(figure), note=missing)
            values[figure].append(value)
    return {figure: tuple(each) for figure, each in values.items()}


def _read(run: Trajectory) -> dict[str, float]:
    motion, mechanism = SampledMotion(run), run.mechanism
    return {
        key.name: value
        for key, value in read_quantities(motion, _plan(mechanism, motion)).items()
        if key.name in FIGURES
    }


def _plan(mechanism: Mechanism, motion: SampledMotion) -> Plan:
    return Plan(mechanism, (), {}, (), motion.launch is not None)


def tolerances(found: FirstSweep, position: float | None) -> dict[str, float]:
    """What an allowance of the projectile's position [m] is for each figure, to first order.

    The velocity is allowed w times as much and the acceleration w^2 times, w being the rate at which the velocity
    turns (see :mod:`.sweep_engines`). Where a figure's instant is a zero of a rate, the instant may move by what the
    rate may, over the rate's own slope.

    Args:
        position: None gives no tolerances.
    """
    if position is None:
        return {}
    projectile, best = found.projectile, found.best
    flight = fly(best, found.surroundings)
    vx, vy = flight.impact_velocity
    lands = math.hypot(1.0, vx / vy)  # a displacement at the landing to one along the ground
    rate = turning(projectile, best.time)
    velocity, acceleration = rate * position, rate**2 * position
    late = lands * (velocity + flight.time * acceleration) / _slope(lambda t: _range_rate(found, t), best.time)
    _, v, a = (part[0] for part in projectile.states(np.array([found.fastest])))
    turn = turning(projectile, found.fastest)
    force = float(np.linalg.norm(v)) * turn**2 * position + float(np.linalg.norm(a)) * turn * position
    along = abs(kinetic_rate(projectile, best.time)) / best.speed
    return {
        "largest_ratio_time": force / _slope(lambda t: kinetic_rate(projectile, t), found.fastest),
        "best_release_time": late,
        "best_release_angle": velocity / best.speed + rate * late,
        "best_release_speed": velocity + along * late,
        "best_range": lands * (position + flight.time * velocity),
    }


def _range_rate(found: FirstSweep, t: float) -> float:
    return range_rate(found.projectile.release_at(t), found.surroundings)


def _slope(rate: Callable[[float], float], time: float) -> float:
    return abs(rate(time + _STEP) - rate(time - _STEP)) / (2 * _STEP)
