"""The third constraint where it really acts: the arm's stop under the law by which a stop can close."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....engines.registry import engine
from ....models.errors import TrebucheckError
from ....models.mechanism import Mechanism
from ....models.problem import Problem, StopLaw
from ....models.trajectory import Trajectory
from ....models.trebuchet import ARM_STOP
from ....reference.solver import solve
from ...isolation import Worker
from .headline import Figures

PREFIX = "unilateral"
_SAMPLES = 3000


def stopped_arm(mechanism: Mechanism, until: float) -> Figures:
    """Launch and first blow on the arm's stop by the reference, stops being unilateral.

    Args:
        mechanism: the machine.
        until: end of the motion [s].
    """
    solution = solve(Problem(mechanism, duration=until, stop_law=StopLaw.UNILATERAL))
    return _figures(solution.trajectory(np.linspace(0.0, until, _SAMPLES)))


def stopped_arms(
    mechanism: Mechanism, until: float, engines: Sequence[str], worker: Worker
) -> dict[str, Figures | str]:
    """The same by engines, each by name; a sentence says why one has none."""
    found: dict[str, Figures | str] = {}
    for name in engines:
        try:
            problem = Problem(mechanism, duration=until, stop_law=StopLaw.UNILATERAL)
            found[name] = _figures(worker.simulate(engine(name), problem))
        except TrebucheckError as error:
            found[name] = str(error)
        except Exception as error:  # a plug-in may raise anything; the study must survive it
            found[name] = f"{type(error).__name__}: {error}"
    return found


def _figures(trajectory: Trajectory) -> Figures:
    found: Figures = {}
    launch = trajectory.launch()
    if launch is not None:
        found[f"{PREFIX} launch_time"] = launch.time
        found[f"{PREFIX} launch_speed"] = launch.speed
    blow = _first_blow(trajectory)
    if blow is not None:
        found[f"{PREFIX} arm stop acts"] = blow
    return found


def _first_blow(trajectory: Trajectory) -> float | None:
    """An impact where the engine resolves it as one, else the first sample at which the stop pushes [s]."""
    blows = [time for time, impulses in trajectory.impacts if ARM_STOP in impulses]
    if blows:
        return blows[0]
    torque = trajectory.stop_torques.get(ARM_STOP)
    pushing = np.flatnonzero(torque > 0) if torque is not None else []
    return float(trajectory.t[pushing[0]]) if len(pushing) else None
