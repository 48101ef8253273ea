"""A problem to simulate: a mechanism, a duration and the law of its stops."""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import StrEnum
from typing import Self

from pydantic import Field, model_validator

from .mechanism import Mechanism
from .shown import Shown
from .spec import Positive, Spec

_CLOSED = 1e-9  # [m] how well loops of joints must close
LONGEST = 1000.0  # [s] a motion that is asked for

SETTLED = 5e-7
"""Least speed of a rebound, in parts of a speed scale, for the reference and for adapters.

With 0 < e < 1 rebounds follow each other ever faster without an end. A stop that is met more slowly
does not rebound (e = 0 there); what is left out is 1e-13 times as high as the first fall. The scale
is sqrt(2 T A): how fast the gap could move with the largest kinetic energy T that the mechanism has
had at an impact, A being the inverse inertia that the stop meets. It has the unit of the gap's
speed, so no unit, length, mass or gravity matters.
"""


def speed_scale(energy: float, inverse_inertia: float) -> float:
    """Speed of a gap [rad/s, m/s] that would take all of an energy [J]."""
    return math.sqrt(2.0 * energy * max(inverse_inertia, 0.0))


class StopLaw(StrEnum):
    """Behaviour of a stop after the start."""

    RELEASE_ONCE = "release-once"
    """The paper's: a closed stop holds until its torque falls to zero; none ever closes."""

    UNILATERAL = "unilateral"
    """A stop closes again when its gap comes back to zero: an impact."""


class Problem(Shown, Spec):
    """One run: a mechanism from its start at t = 0 to t = duration [s].

    Raises:
        InputError: the duration is not positive and finite, the law is unknown, or a loop of joints
            is open at the start.
    """

    mechanism: Mechanism
    duration: Positive = Field(default=3.0, le=LONGEST, description="[s]")
    stop_law: StopLaw = StopLaw.RELEASE_ONCE

    def headline(self) -> str:
        """Its mechanism, duration and law."""
        name, law = self.mechanism.name, self.stop_law.value
        return f"Problem: {name!r} for {self.duration:g} s, stops {law}"

    def facts(self) -> Iterable[tuple[str, str]]:
        """Features of its mechanism."""
        return self.mechanism.facts()

    @model_validator(mode="after")
    def _loops_close(self) -> Self:
        for name, residual in self.mechanism.loop_closure_residual.items():
            if residual > _CLOSED:
                raise ValueError(
                    f"start does not fit the joint {name!r}, which closes a loop: "
                    f"its points stand apart by {residual:.3g} m"
                )
        for name, residual in self.mechanism.loop_angle_residual.items():
            if residual > _CLOSED:
                raise ValueError(
                    f"start does not fit the joint {name!r}, which closes a loop: "
                    f"its bodies are turned by {residual:.3g} rad too much or too little"
                )
        for name, residual in self.mechanism.coupler_residual.items():
            if abs(residual) > _CLOSED:
                raise ValueError(
                    f"start does not fit the coupler {name!r}: its coordinate is off by "
                    f"{residual:.3g}"
                )
        return self

    def __init__(self, mechanism: Mechanism, duration: float = 3.0, **fields: object) -> None:
        super().__init__(mechanism=mechanism, duration=duration, **fields)


def mechanism_of(model: Mechanism | Problem) -> Mechanism:
    """The mechanism of a problem, or the one given."""
    return model.mechanism if isinstance(model, Problem) else model
