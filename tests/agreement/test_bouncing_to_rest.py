"""Bouncing to rest: rebounds shorter than a step are no disagreement, longer ones that only one has
are.
"""

from __future__ import annotations

import functools

import pytest
import trebucheck as tb
from trebucheck.comparisons.runs.metrics import measure
from trebucheck.models.library.registry import benchmark
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve


def bouncing(restitution: float, height: float) -> Mechanism:
    entry = benchmark("bouncing")
    return entry.parameters(restitution=restitution, height=height).mechanism()


def duration(restitution: float, height: float) -> float:
    return 1.25 * (2 * height / 9.81) ** 0.5 * (1 + restitution) / (1 - restitution)


@functools.cache
def exact(restitution: float, height: float) -> Solution:
    end = duration(restitution, height)
    return solve(Problem(bouncing(restitution, height), end, stop_law=StopLaw.UNILATERAL))


def impact_error(
    engine: str, restitution: float, followed: float, height: float, part: float
) -> float | None:
    """Of the engine with one restitution against the reference with another [s]; None.

    Impacts are missing.
    """
    end = duration(followed, height)
    own = Problem(bouncing(restitution, height), end, stop_law=StopLaw.UNILATERAL)
    trajectory = tb.engine(engine, timestep=part * (2 * height / 9.81) ** 0.5).simulate(own)
    metrics = measure(trajectory, exact(followed, height), end)
    return next(metric.value for metric in metrics if metric.name == "impact_time")


@pytest.mark.parametrize("engine", ["mujoco", "exudyn", "pymunk"])
@pytest.mark.parametrize("restitution", [0.1, 0.5])
@pytest.mark.parametrize("height", [1.0, 1e-4])
def test_engines_come_to_rest_with_the_reference(
    engine: str, restitution: float, height: float
) -> None:
    """Whatever the size: an absolute least speed let an engine rebound where the reference had
    ceased to.
    """
    pytest.importorskip(engine)
    error = impact_error(engine, restitution, restitution, height, 4e-3)
    assert error is not None and abs(error) < 2 * 4e-3 * (2 * height / 9.81) ** 0.5


@pytest.mark.parametrize("engine", ["mujoco", "exudyn", "pymunk"])
def test_an_engine_that_goes_on_bouncing_or_does_not_bounce_disagrees(engine: str) -> None:
    pytest.importorskip(engine)
    assert impact_error(engine, 0.1, 0.0, 1.0, 4e-3) is None  # it bounces, the reference rests
    assert impact_error(engine, 0.0, 0.1, 1.0, 4e-3) is None
