"""The sling that suits a machine best: greatest efficiency at 45 degrees.

Where a machine has the paper's third constraint, a stop that would act before the launch counts as no throw.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from ...models.arrays import FloatArray
from ...models.errors import EngineNotInstalledError
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from ...models.registry import model, parameters_type
from ...models.trebuchet import ARM_STOP
from ...reference.solver import solve_to_launch

SLINGS = (2.0, 14.0)
"""Lengths looked at [m]: up to the paper's whole arm."""

_EACH = 0.25  # [m] between the lengths of the first look
_DURATION = 4.0  # [s] in which machines of this size launch
_SHORT = 1e-4  # [m] to which the best is found: the efficiency is flat there


@dataclass(frozen=True)
class Launched:
    """What a throw at 45 degrees comes to; speed 0 where there is none, or the arm had passed its stop."""

    speed: float
    """[m/s]"""
    time: float
    """[s]"""
    arm: float
    """[rad]"""


_NONE = Launched(0.0, math.nan, math.nan)


def best_sling(name: str) -> tuple[float, Launched] | None:
    """Length [m] and throw of a named machine; None where it has no sling, or none launches."""
    if "r" not in parameters_type(name).model_fields:
        return None
    lengths = np.arange(SLINGS[0], SLINGS[1] + _EACH / 2, _EACH)
    looked_at = _launches([_with_sling(name, float(r)) for r in lengths])
    k = int(np.argmax([throw.speed for throw in looked_at]))
    if looked_at[k].speed == 0.0:
        return None
    near = (max(lengths[k] - _EACH, SLINGS[0]), min(lengths[k] + _EACH, SLINGS[1]))
    speed: Callable[[float], float] = lambda r: -_launch(_with_sling(name, r)).speed  # noqa: E731
    found = minimize_scalar(speed, bounds=near, method="bounded", options={"xatol": _SHORT})
    candidates = [(float(found.x), _launch(_with_sling(name, float(found.x)))), (float(lengths[k]), looked_at[k])]
    return max(candidates, key=lambda each: each[1].speed)


def _with_sling(name: str, r: float) -> Mechanism:
    return model(name, parameters_type(name)(r=r))


def _launches(machines: Sequence[Mechanism]) -> list[Launched]:
    from ...reference.taylor import launch_batch  # a second to import

    try:
        batch = launch_batch(machines, duration=_DURATION)
    except EngineNotInstalledError:
        return [_launch(machine) for machine in machines]
    rows = zip(machines, batch.launched, batch.speed, batch.time, batch.q, strict=True)
    return [_checked(machine, q, float(v), float(t)) if ok else _NONE for machine, ok, v, t, q in rows]


def _launch(machine: Mechanism) -> Launched:
    solution = solve_to_launch(machine)
    if solution.launch is None:
        return _NONE
    q = solution.motion(np.array([solution.launch.time])).q[0]
    return _checked(machine, q, solution.launch.speed, solution.launch.time)


def _checked(machine: Mechanism, q: FloatArray, speed: float, time: float) -> Launched:
    has_stop = any(stop.name == ARM_STOP for stop in machine.stops)
    if has_stop and float(Kinematics(machine).gap(ARM_STOP, q)) <= 0:
        return _NONE
    return Launched(speed, time, float(q[0]))
