"""A torque between two bodies, or a force along a slide, that was recorded over time."""

from __future__ import annotations

from bisect import bisect_right
from itertools import pairwise
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from ..arrays import FloatArray
from ..errors import UnsupportedProblemError
from ..functions import AngleFunction
from ..spec import Name, Real
from .base import Feature, Geometry, LinearElement


class RecordedEffort(LinearElement):
    """An actuator's torque or force, held from each instant of a record to the next.

    With a slide coordinate it is a force along that slide of the body's joint, as of a
    :class:`.slide_spring_damper.SlideSpringDamper`; without one a torque, clockwise positive. The
    first value acts from the start, the last one to the end (a zero-order hold, as of a controller
    that sets a value in each of its periods).
    """

    feature: ClassVar[Feature] = Feature.RECORDED_EFFORT

    kind: Literal["recorded-effort"] = "recorded-effort"
    coordinate: Name | None = Field(
        default=None, description="name of a slide of the body's joint; none: a torque"
    )
    times: tuple[Real, ...] = Field(
        min_length=1, description="ascending from 0, from which each value acts [s]"
    )
    efforts: tuple[Real, ...] = Field(
        min_length=1, description="on the body, the opposite on the other one [N m or N]"
    )

    @model_validator(mode="after")
    def _is_a_record(self) -> Self:
        if len(self.times) != len(self.efforts):
            raise ValueError(
                f"{self.name!r} has {len(self.times)} times for {len(self.efforts)} efforts"
            )
        if self.times[0] != 0.0:
            raise ValueError(f"times of {self.name!r} begin at {self.times[0]!r} s, not at 0")
        for before, after in pairwise(self.times):
            if not before < after:
                raise ValueError(
                    f"times of {self.name!r} must ascend; {after!r} s follows {before!r} s"
                )
        return self

    @classmethod
    def numbers(cls) -> tuple[str, ...]:
        """The efforts; the times are a controller's, and exact."""
        return ("efforts",)

    @property
    def instants(self) -> tuple[float, ...]:
        return self.times[1:]

    def at(self, t: float) -> Self:
        k = bisect_right(self.times, t) - 1
        return self.model_copy(update={"times": (0.0,), "efforts": (self.efforts[k],)})

    @property
    def slide(self) -> str | None:
        return self.coordinate

    @property
    def works(self) -> bool:
        return any(self.efforts)

    def effort(self, along: AngleFunction, q: FloatArray, u: FloatArray) -> FloatArray:
        """The value [N m or N], shape (...,).

        Raises:
            UnsupportedProblemError: there are several, and no time: who computes this does not
                follow the record.
        """
        return self._value + np.zeros(q.shape[:-1])

    def power(
        self, geometry: Geometry, direction: AngleFunction, q: FloatArray, u: FloatArray
    ) -> FloatArray:
        """Effort times rate [W]."""
        return self._value * (u @ direction.coefficients)

    @property
    def _value(self) -> float:
        match self.efforts:
            case (value,):
                return value
            case _:
                raise UnsupportedProblemError(
                    f"{self.name!r} ({self.kind}) changes at {len(self.instants)} instants; what "
                    "is computed here knows no time."
                )
