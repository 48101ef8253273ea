"""The sling with which a machine throws fastest at 45 degrees, all else kept.

Where a machine has the paper's third constraint, a stop that would act before the launch counts as no throw.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import EngineNotInstalledError
from ...models.kinematics import Kinematics
from ...models.machines.registry import model, parameters_type
from ...models.machines.trebuchet import ARM_STOP
from ...models.mechanism import Mechanism
from ...reference.solver import solve_to_launch

SLINGS = (2.0, 14.0)
"""Lengths looked at [m]: up to the paper's whole arm."""

_FIRST, _CLOSER = 25, 7  # lengths at first, and in each closer look
_LOOKS = 4  # each a third as wide as the one before: 0.5 m become 6 mm, where the speed is flat to 1e-6
_DURATION = 4.0  # [s] in which machines of this size launch


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


def fastest_sling(name: str) -> tuple[float, Mechanism, Launched] | None:
    """Length [m], machine and throw of a named machine with its fastest sling; None: no sling, or none launches."""
    if "r" not in parameters_type(name).model_fields:
        return None
    lengths = np.linspace(*SLINGS, _FIRST)
    found = _looked_at(name, lengths)
    for _ in range(_LOOKS):
        step, middle = lengths[1] - lengths[0], found[0]
        lengths = np.linspace(max(SLINGS[0], middle - step), min(SLINGS[1], middle + step), _CLOSER)
        found = max(found, _looked_at(name, lengths), key=lambda each: each[2].speed)
    return found if found[2].speed > 0 else None


def _looked_at(name: str, lengths: FloatArray) -> tuple[float, Mechanism, Launched]:
    machines = [model(name, parameters_type(name)(r=float(r))) for r in lengths]
    throws = zip(lengths.tolist(), machines, launches(machines, _DURATION), strict=True)
    return max(throws, key=lambda each: each[2].speed)


def launches(machines: Sequence[Mechanism], duration: float, alone: bool = True) -> Iterable[Launched]:
    """Throws of machines of one kind at 45 degrees.

    Args:
        machines: alike but for their numbers.
        duration: the launch is looked for up to here [s]; where machines are solved alone, at all times.
        alone: whether each may be solved for itself, a tenth of a second each, where heyoka is not installed.

    Raises:
        EngineNotInstalledError: heyoka is not installed, and they may not be solved alone.
    """
    from ...reference.taylor.solve import launch_batch  # a second to import

    try:
        batch = launch_batch(machines, duration=duration)
    except EngineNotInstalledError:
        if not alone:
            raise
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
