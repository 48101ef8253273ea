"""The reference motion by an adaptive Taylor integrator: an integrator and an event finder of their own.

heyoka (Biscani and Izzo, MNRAS 504 (2021) 2614) expands the motion into its Taylor series at every step and finds
releases, closings and the launch as roots of polynomials. What happens *at* an event is decided by
:mod:`..active_set`, as for the DOP853 solver. heyoka is optional; it is imported, and a structure of machine
compiled, when first needed.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...models.launch import Launch
from ...models.problem import Problem
from ..solution import Solution
from .batch import BatchLaunches, launch_batch
from .integrate import Integration, Precision
from .machine import Real

__all__ = [
    "BatchLaunches",
    "Precision",
    "TaylorQuantities",
    "launch_batch",
    "solve_taylor",
    "taylor_launch",
    "taylor_quantities",
]


def solve_taylor(problem: Problem, tolerance: float | None = None, precision: Precision = "double") -> Solution:
    """Integrate a problem with heyoka's adaptive Taylor integrator.

    Args:
        problem: any that :func:`..solver.solve` takes.
        tolerance: relative (or, for small states, absolute) local error; the precision's epsilon if left out, at
            which rounding is all that is left.
        precision: "extended" computes, and locates events, in 80-bit floats; the solution is read in doubles.

    Returns:
        A continuous solution; its `evaluations` are Taylor steps.

    Raises:
        EngineNotInstalledError: heyoka is not here.
        InputError: the tolerance or the precision is not usable.
        SimulationError: the motion left the finite numbers, or there are more than ten thousand events.
    """
    started = time.perf_counter()
    run = Integration(problem, tolerance, precision)
    run.integrate(record=True)
    return Solution(
        problem=problem,
        equations=run.equations,
        segments=tuple(run.segments),
        release_times=run.active_set.releases,
        impacts=tuple(run.active_set.impacts),
        evaluations=run.steps,
        settings={"taylor_tolerance": run.tolerance, "taylor_order": float(run.order)},
        wall_time=time.perf_counter() - started,
    )


@dataclass(frozen=True)
class TaylorQuantities:
    """A throw's figures in the precision they were computed in (`numpy.longdouble` for "extended")."""

    precision: Precision
    release_times: Mapping[str, np.floating[Any] | None]
    """When each stop opened before the launch [s]."""
    start_torques: Mapping[str, np.floating[Any]]
    """Torque of each stop at the start [N m]."""
    launch_time: np.floating[Any] | None
    """[s]; None, as all below, if there is no launch within the duration."""
    launch_speed: np.floating[Any] | None
    """[m/s]"""
    launch_velocity: Real | None
    """[m/s], shape (2,)"""
    launch_q: Real | None
    """Shape (n_q,) [rad or m]."""
    launch_u: Real | None
    """Shape (n_q,) [rad/s or m/s]."""


def taylor_quantities(
    problem: Problem, precision: Precision = "extended", tolerance: float | None = None
) -> TaylorQuantities:
    """From the start to the launch, both releases and the launch located on the Taylor polynomials.

    Args:
        problem: its duration bounds the search for the launch; where there is none, the motion runs to its end.
        precision: of everything, parameters' products included ("extended": 80-bit floats).
        tolerance: local error; the precision's epsilon if left out.

    Raises:
        EngineNotInstalledError, InputError, SimulationError: as :func:`solve_taylor`.
    """
    run = Integration(problem, tolerance, precision)
    run.integrate(to_launch=True)
    found = run.launched
    velocity = None if found is None else run.projectile_velocity(found.q, found.u)
    return TaylorQuantities(
        precision=precision,
        release_times=run.release_times,
        start_torques=run.start_torques(),
        launch_time=None if found is None else found.time,
        launch_speed=None if velocity is None else np.hypot(*velocity),
        launch_velocity=velocity,
        launch_q=None if found is None else found.q,
        launch_u=None if found is None else found.u,
    )


def taylor_launch(problem: Problem, tolerance: float | None = None) -> Launch | None:
    """The launch alone, as fast as it goes; None if there is none within the problem's duration.

    Raises:
        EngineNotInstalledError, InputError, SimulationError: as :func:`solve_taylor`.
    """
    run = Integration(problem, tolerance, "double")
    run.integrate(to_launch=True)
    if run.launched is None:
        return None
    vx, vy = (float(v) for v in run.projectile_velocity(run.launched.q, run.launched.u))
    return Launch(float(run.launched.time), float(np.hypot(vx, vy)), (vx, vy))
