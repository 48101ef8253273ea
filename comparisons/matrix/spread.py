"""What differs by scheme and what by implementation: ratios of errors of two engines on one problem at equal steps."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from statistics import median

from ...engines.supplied import Own, own
from .results import Matrix, MatrixProblem, MatrixRun

FLOOR = 1e-12
"""Of the scale: smaller errors are rounding over thousands of steps, and count as this."""
_METRIC = "position_max"


@dataclass(frozen=True)
class Ratio:
    """Of two errors, the larger by the smaller."""

    value: float
    runs: str
    """Which two, and on which problem."""


@dataclass(frozen=True)
class Ratios:
    """Of pairs of runs on one problem."""

    found: tuple[Ratio, ...]

    def __str__(self) -> str:
        if not self.found:
            return "no pair"
        largest = max(self.found, key=lambda each: each.value)
        count, middle = len(self.found), median(each.value for each in self.found)
        rest = "one pair" if count == 1 else f"{count} pairs, median {middle:.2g}"
        return f"{largest.value:.2g} at most ({largest.runs}; {rest})"


@dataclass(frozen=True)
class Spread:
    """Of one scheme, on problems with stops or loops or on those without."""

    scheme: str
    constrained: bool
    engines: tuple[str, ...]
    moved: tuple[str, ...]
    """Those of them whose steps are trebucheck's: one implementation."""
    within: Ratios
    """Of two engines of the scheme."""
    between: Ratios
    """Of one of them and one of another scheme."""


def spreads(matrix: Matrix) -> Iterator[Spread]:
    """Of every scheme that two engines have, where there are pairs."""
    for scheme, labels in matrix.schemes().items():
        engines = sorted({run.engine for label in labels for run in matrix.of(label)})
        if not scheme or len(engines) < 2:
            continue
        runs = (run for label in labels for run in matrix.of(label))
        moved = tuple(
            sorted({run.engine for run in runs if own(run.supplied or {}) is Own.DYNAMICS})
        )
        for constrained in (False, True):
            problems = [
                each for each in matrix.problems if (each.stops or each.loops) == constrained
            ]
            found = _spread(matrix, problems, scheme)
            if found[0].found:
                yield Spread(scheme, constrained, tuple(engines), moved, *found)


def _spread(
    matrix: Matrix, problems: Iterable[MatrixProblem], scheme: str
) -> tuple[Ratios, Ratios]:
    within: list[Ratio] = []
    between: list[Ratio] = []
    for problem in problems:
        for a, b in _pairs(
            [run for run in matrix.runs if run.problem == problem.name and run.scheme]
        ):
            if a.scheme == b.scheme == scheme:
                within.append(_ratio(a, b))
            elif scheme in (a.scheme, b.scheme):
                between.append(_ratio(a, b))
    return Ratios(tuple(within)), Ratios(tuple(between))


def _pairs(runs: Sequence[MatrixRun]) -> Iterator[tuple[MatrixRun, MatrixRun]]:
    """Two runs of different engines with equal steps, both with an error."""
    moved = [run for run in runs if _error(run) is not None]
    for a, b in combinations(moved, 2):
        if a.engine != b.engine and math.isclose(
            a.timestep or 0.0, b.timestep or math.inf, rel_tol=1e-9
        ):
            yield a, b


def _ratio(a: MatrixRun, b: MatrixRun) -> Ratio:
    low, high = sorted(max(_error(run) or 0.0, FLOOR) for run in (a, b))
    return Ratio(high / low, f"{a.label} and {b.label} on {a.problem}")


def _error(run: MatrixRun) -> float | None:
    error = run.error(_METRIC)
    return None if error is None or not error.observed else error.part


def sentence(spread: Spread) -> str:
    """The comparison of the two."""
    where = "with stops or loops" if spread.constrained else "without stops and loops"
    one = (
        f"; the steps of {' and '.join(spread.moved)} are trebucheck's"
        if len(spread.moved) > 1
        else ""
    )
    return (
        f"position errors of two of its engines ({', '.join(spread.engines)}) on one problem {where}, at equal steps, "
        f"have a ratio of {spread.within}; those of one of them and one of another scheme {spread.between}{one}."
    )
