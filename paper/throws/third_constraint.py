"""The third constraint where it really acts: the arm's stop under the law by which a stop can close."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...comparisons.runs.worker import Worker
from ...engines.protocol import Engine
from ...models.errors import TrebucheckError
from ...models.machines.trebuchet import ARM_STOP
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.trajectory import Trajectory
from ...reference.certification.certify import MinimalMotion
from ...reference.certification.quantities import Motion, vacuum_range
from ...reference.solver import solve
from .headline import Figures
from .sampled import SampledMotion

PREFIX = "unilateral"
_SAMPLES = 3000


@dataclass(frozen=True)
class Stopped:
    """What an engine finds where the arm's stop acts."""

    figures: Figures
    noticed: float = 0.0
    """How much later than it happens a blow may be noticed [s]: 0 where the engine resolves it as an impact, one
    sample where it only shows that the stop pushes."""
    note: str | None = None
    """Why there is nothing."""


def stopped_arm(mechanism: Mechanism, until: float) -> Figures:
    """Launch and first blow on the arm's stop by the reference, stops being unilateral.

    Args:
        mechanism: the machine.
        until: end of the motion [s].
    """
    solution = solve(Problem(mechanism, duration=until, stop_law=StopLaw.UNILATERAL))
    return _found(MinimalMotion(solution), solution.trajectory(np.linspace(0.0, until, _SAMPLES))).figures


def stopped_by(runner: Engine, mechanism: Mechanism, until: float, worker: Worker) -> Stopped:
    """The same by an engine; one that cannot follow that law says so."""
    try:
        trajectory = worker.simulate(runner, Problem(mechanism, duration=until, stop_law=StopLaw.UNILATERAL))
        return _found(SampledMotion(trajectory), trajectory)
    except TrebucheckError as error:
        return Stopped({}, note=str(error))
    except Exception as error:  # a plug-in may raise anything; the study must survive it
        return Stopped({}, note=f"{type(error).__name__}: {error}")


def _found(motion: Motion, trajectory: Trajectory) -> Stopped:
    figures: Figures = {}
    launch = motion.launch
    if launch is not None:
        figures[f"{PREFIX} launch_time"] = launch.time
        figures[f"{PREFIX} launch_speed"] = launch.speed
        figures[f"{PREFIX} range, launch"] = vacuum_range(motion, trajectory.mechanism.gravity, launch.time)
    blow, noticed = _first_blow(trajectory)
    if blow is not None:
        figures[f"{PREFIX} arm stop acts"] = blow
    return Stopped(figures, noticed)


def _first_blow(trajectory: Trajectory) -> tuple[float | None, float]:
    """When [s], and how late that may be: an impact, else the first sample at which the stop pushes."""
    blows = [time for time, impulses in trajectory.impacts if ARM_STOP in impulses]
    if blows:
        return blows[0], 0.0
    torque = trajectory.stop_torques.get(ARM_STOP)
    pushing = np.flatnonzero(torque > 0) if torque is not None else []
    if not len(pushing):
        return None, 0.0
    i = int(pushing[0])
    return float(trajectory.t[i]), float(trajectory.t[i] - trajectory.t[max(i - 1, 0)])
