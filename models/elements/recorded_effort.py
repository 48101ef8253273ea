"""A torque between two bodies, and a force along a slide, that were recorded over time."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from ..arrays import FloatArray
from ..controls import fault_of_times
from ..errors import UnsupportedProblemError
from ..functions import AngleFunction
from ..spec import Name, Real
from .base import Feature, Geometry, LinearElement

ROUNDED = 1e-6
"""Share of a step: what begins so much too early, by rounding, begins at an instant."""
_ON_BODY = "on the body, the opposite on the other one"


class RecordedEffort(LinearElement):
    """Base of actuators whose effort is held from each time of a record to the next.

    The first value acts from the start, the last one to the end: a zero-order hold, as of a
    controller that sets a value in each of its periods.
    """

    values: ClassVar[Literal["torques", "forces"]]
    """Name of the field of the efforts."""
    times: tuple[Real, ...] = Field(
        min_length=1, description="ascending from 0, from which each value acts [s]"
    )

    @classmethod
    def numbers(cls) -> tuple[str, ...]:
        """The efforts; the times are a controller's, and exact."""
        return (cls.values,)

    @property
    def efforts(self) -> tuple[float, ...]:
        """Torques [N m] or forces [N], one for each of the times."""
        return getattr(self, self.values)

    @model_validator(mode="after")
    def _is_a_record(self) -> Self:
        if len(self.times) != len(self.efforts):
            raise ValueError(
                f"{self.name!r} has {len(self.times)} times for {len(self.efforts)} {self.values}"
            )
        if (fault := fault_of_times(self.times)) is not None:
            raise ValueError(f"{self.name!r}: {fault}")
        return self

    @property
    def instants(self) -> tuple[float, ...]:
        return self.times[1:]

    def at(self, t: float) -> Self:
        value = self.efforts[bisect_right(self.times, t) - 1]
        held: dict[str, Any] = {"times": (0.0,), self.values: (value,)}
        return self.model_copy(update=held)

    def during(self, t: FloatArray, step: float) -> FloatArray:
        """Efforts of an engine in its steps [s]: what acts where each begins, at times (n,) [s].

        Times of steps are rounded: where one begins a millionth of it too early, it is not.
        """
        stages = np.searchsorted(self.instants, t + ROUNDED * step, side="right")
        return np.array(self.efforts)[stages]

    @property
    def works(self) -> bool:
        return any(self.efforts)

    @property
    def linear_law(self) -> tuple[float, float] | None:
        return None if self.instants else (0.0, 0.0)

    def effort(self, along: AngleFunction, q: FloatArray, u: FloatArray) -> FloatArray:
        """The value [N m or N], shape (...,)."""
        return self.value + np.zeros(q.shape[:-1])

    def power(
        self, geometry: Geometry, direction: AngleFunction, q: FloatArray, u: FloatArray
    ) -> FloatArray:
        """Effort times rate [W]."""
        return self.value * (u @ direction.coefficients)

    @property
    def value(self) -> float:
        """The value of a record that has one [N m or N].

        Raises:
            UnsupportedProblemError: there are several, and no time: who asks for it does not
                follow the record.
        """
        match self.efforts:
            case (value,):
                return value
            case _:
                raise UnsupportedProblemError(
                    f"{self.name!r} changes at {len(self.instants)} instants; what is computed "
                    "here knows no time."
                )


def efforts_during(records: Iterable[RecordedEffort], t: FloatArray, step: float) -> FloatArray:
    """Efforts of records in steps [s] from times (n,) [s], shape (n, n_records) [N m or N]."""
    return np.reshape([record.during(t, step) for record in records], (-1, len(t))).T


class RecordedTorque(RecordedEffort):
    """A recorded torque between two bodies, clockwise positive."""

    feature: ClassVar[Feature] = Feature.RECORDED_TORQUE
    values: ClassVar[Literal["torques", "forces"]] = "torques"

    kind: Literal["recorded-torque"] = "recorded-torque"
    torques: tuple[Real, ...] = Field(min_length=1, description=f"{_ON_BODY} [N m]")


class RecordedForce(RecordedEffort):
    """A recorded force along the slide of a joint of the tree."""

    feature: ClassVar[Feature] = Feature.RECORDED_FORCE
    values: ClassVar[Literal["torques", "forces"]] = "forces"

    kind: Literal["recorded-force"] = "recorded-force"
    coordinate: Name = Field(description="name of the slide coordinate of the body's joint")
    forces: tuple[Real, ...] = Field(min_length=1, description=f"{_ON_BODY}, along the slide [N]")

    @property
    def slide(self) -> str:
        return self.coordinate
