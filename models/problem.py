"""What is to be simulated: a mechanism, for how long, under which law of its stops."""

from __future__ import annotations

from enum import StrEnum

from pydantic import Field

from .mechanism import Mechanism
from .spec import Positive, Spec


class StopLaw(StrEnum):
    """How a stop behaves after the start."""

    RELEASE_ONCE = "release-once"
    """The paper's: a closed stop holds until its torque falls to zero, then it is gone; none ever closes."""

    UNILATERAL = "unilateral"
    """A stop closes again when its gap comes back to zero: an impact."""


class Problem(Spec):
    """One run: a mechanism from its start at t = 0 to t = duration [s].

    Raises:
        InputError: the duration is not positive and finite, or the law is unknown.
    """

    mechanism: Mechanism
    duration: Positive = Field(default=3.0, le=1000.0, description="[s]")
    stop_law: StopLaw = StopLaw.RELEASE_ONCE

    def __init__(self, mechanism: Mechanism, duration: float = 3.0, **fields: object) -> None:
        super().__init__(mechanism=mechanism, duration=duration, **fields)
