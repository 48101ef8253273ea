"""Launches along the beam under two laws of a stop.

Release-once, the house's: a rest whose torque would be negative at the start cannot push and is gone at t = 0.
Bilateral, the paper's: a rest that touches at the start is held, pulling too, until its torque comes to zero.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq

from ...models.arrays import FloatArray
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ...reference.perturbed import solve_scheduled
from ...reference.solution import Solution
from ...reference.solver import characteristic_time, solve
from ...reference.taylor.solve import launch_batch
from .rigid_swing import Whole

SPANS = 2.5
"""How long a launch is looked for, in the machine's characteristic times: Table I launches after 1.5 of them."""
_WATCHED = 600  # times at which torques are watched: some 7 ms apart on Table I
_DOP853 = 1e-12  # local error where heyoka is not installed: its batch's own default


def release_once(mechanisms: Sequence[Mechanism]) -> tuple[FloatArray, FloatArray]:
    """Times [s] and speeds [m/s] of the launches under the release-once law, NaN where there is none; each (n,)."""
    duration = SPANS * max(characteristic_time(mechanism) for mechanism in mechanisms)
    if importlib.util.find_spec("heyoka") is not None:
        found = launch_batch(mechanisms, duration)
        return found.time, found.speed
    launches = [solve(Problem(mechanism, duration=duration), _DOP853, _DOP853).launch for mechanism in mechanisms]
    times = np.array([np.nan if launch is None else launch.time for launch in launches])
    return times, np.array([np.nan if launch is None else launch.speed for launch in launches])


def pulls_at_start(whole: Whole) -> bool:
    """Whether a rest that touches at the start would have to pull there: only then do the two laws differ."""
    return any(whole.start_torque(stop.name) < 0 for stop in whole.mechanism.stops if stop.closed)


def bilateral(whole: Whole) -> Solution:
    """The motion with each rest held until its own torque comes to zero, from either side, then gone.

    Raises:
        SimulationError: the integrator gave up.
    """
    mechanism = whole.mechanism
    problem = Problem(mechanism, duration=SPANS * characteristic_time(mechanism))
    releases: dict[str, float | None] = {stop.name: None for stop in mechanism.stops if stop.closed}
    zeros = ((time, name) for name in releases for time in whole.zeros(name) if time < problem.duration)
    now, first = min(zeros, default=(0.0, None))
    if first is not None:
        releases[first] = now
    solution = solve_scheduled(problem, releases)
    while found := first_zero(solution, [name for name, time in releases.items() if time is None], now):
        now, name = found
        releases[name] = now
        solution = solve_scheduled(problem, releases)
    return solution


def first_zero(solution: Solution, held: Sequence[str], after: float) -> tuple[float, str] | None:
    """When the torque of a held stop first comes to zero later than `after` [s], and which it is."""
    times = np.linspace(after, solution.problem.duration, _WATCHED)[1:]
    torques = solution.motion(times).stop_torques
    found: list[tuple[float, str]] = []
    for name in held:
        changes = np.flatnonzero(np.diff(np.sign(torques[name])) != 0)
        if len(changes):
            before, behind = times[changes[0] : changes[0] + 2]
            found.append((_zero(solution, name, float(before), float(behind)), name))
    return min(found, default=None)


def _zero(solution: Solution, name: str, before: float, behind: float) -> float:
    def torque(t: float) -> float:
        return float(solution.motion(np.array([t])).stop_torques[name][0])

    return float(brentq(torque, before, behind, xtol=1e-14, rtol=1e-14))
