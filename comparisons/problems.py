"""A problem's figures as the reference has them, and its source's conditions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from ..models.library.benchmark import (
    Benchmark,
    BenchmarkParameters,
    Condition,
    ContinuousMotion,
    KnownValue,
)
from ..reference.solver import solve

__path__: list[str] = []  # names of earlier releases below this module: see renamed.py


@dataclass(frozen=True)
class CheckedFigure:
    """A figure beside what a motion has."""

    figure: KnownValue
    measured: float

    @property
    def error(self) -> float:
        """Error in the figure's unit."""
        return abs(self.measured - self.figure.value)

    @property
    def holds(self) -> bool:
        """Tell whether it is within the figure's tolerance."""
        return self.error <= self.figure.tolerance


@dataclass(frozen=True)
class CheckedCondition:
    """A condition of the source beside a motion's error."""

    condition: Condition
    error: float

    @property
    def holds(self) -> bool:
        """Tell whether the source takes the motion as correct."""
        return self.error <= self.condition.limit


@dataclass(frozen=True)
class ProblemCheck:
    """A benchmark's motion held against what is known of it.

    Args:
        parameters: of the benchmark's own type.
        motion: of its problem.
    """

    benchmark: Benchmark
    parameters: BenchmarkParameters
    motion: ContinuousMotion

    @cached_property
    def figures(self) -> tuple[CheckedFigure, ...]:
        """Figures of the parameters, beside the motion's."""
        return tuple(
            CheckedFigure(each, each.read(self.motion)) for each in self.parameters.figures()
        )

    @cached_property
    def conditions(self) -> tuple[CheckedCondition, ...]:
        """Conditions of the source, beside the motion's errors."""
        conditions = self.parameters.conditions()
        return tuple(CheckedCondition(each, each.error(self.motion)) for each in conditions)

    @property
    def holds(self) -> bool:
        """Tell whether all figures and conditions do."""
        return all(each.holds for each in (*self.figures, *self.conditions))


def check(benchmark: Benchmark, parameters: BenchmarkParameters | None = None) -> ProblemCheck:
    """Solve a benchmark by the reference and hold it against its figures.

    Args:
        parameters: of the benchmark's own type; the published ones where left out.

    Raises:
        SimulationError: the reference cannot solve it, or its motion lacks what a figure is read
            from.
    """
    given = parameters or benchmark.parameters()
    return ProblemCheck(benchmark, given, solve(benchmark.problem(given)))
