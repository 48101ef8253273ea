"""A benchmark problem: a mechanism from parameters, a duration, a stop law, a source, and what is known of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from ..arrays import FloatArray
from ..mechanism import Mechanism
from ..problem import Problem, StopLaw
from ..spec import Spec
from ..trajectory import Trajectory


class Motion(Protocol):
    """A motion that is continuous in time, from which figures are read."""

    @property
    def impacts(self) -> Sequence[tuple[float, Mapping[str, float]]]:
        """Time [s] and impulses by stop [N m s or N s] of every impact."""
        ...

    @property
    def rest_times(self) -> Mapping[str, Sequence[float]]:
        """Instants [s] at which each stop ceased to bounce."""
        ...

    def trajectory(self, t: FloatArray, /) -> Trajectory:
        """The motion at times t [s], shape (n,)."""
        ...


@dataclass(frozen=True)
class Figure:
    """A number that the problem's motion must have."""

    name: str
    value: float
    unit: str
    tolerance: float
    """What the reference is held to, in the unit: the digits that are published, or those that can be computed."""
    read: Callable[[Motion], float]
    basis: Literal["closed form", "quadrature", "published"] = "closed form"


@dataclass(frozen=True)
class Condition:
    """When the source takes a solution as correct: an error, and the largest that is allowed."""

    text: str
    limit: float
    unit: str
    error: Callable[[Motion], float]


@dataclass(frozen=True)
class Benchmark:
    """An entry of the library."""

    number: str
    name: str
    tags: tuple[str, ...]
    text: str
    source: str
    parameters: type[Spec]
    build: Callable[[Any], Mechanism]
    """The mechanism, of parameters of that type; it has the benchmark's name."""
    duration: Callable[[Any], float]
    """Of parameters, how long the motion is followed [s]."""
    figures: Callable[[Any], tuple[Figure, ...]] = lambda parameters: ()
    conditions: Callable[[Any], tuple[Condition, ...]] = lambda parameters: ()
    stop_law: StopLaw = StopLaw.RELEASE_ONCE

    def problem(self, parameters: Spec | None = None) -> Problem:
        """The run that the benchmark asks for.

        Args:
            parameters: of the benchmark's own type; the published ones where left out.
        """
        given = parameters or self.parameters()
        return Problem(self.build(given), duration=self.duration(given), stop_law=self.stop_law)
