"""A linear relation of coordinates: gears, racks, MuJoCo's equalities of joints and tendons."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from ..functions import AngleFunction
from ..spec import Name, Real, Spec
from .base import Basic, Feature

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..arrays import FloatArray


class CouplerTerm(Spec):
    """Share of a coordinate in another one, which follows it."""

    coordinate: Name = Field(description="name of the coordinate that is followed")
    ratio: Real = Field(
        description="in the unit of the coordinate that follows by that of this one"
    )


class Coupler(Spec):
    """Constraint by which a coordinate is a weighted sum of others, plus a constant.

    With the coordinates q (absolute angles, positive clockwise, and slides) it holds
    q_i = offset + sum_k ratio_k q_k. Its multiplier L is the effort on q_i, and -ratio_k L that on
    q_k (the coupler of Adams and Drake): gears on fixed axles, a rack, two hinges that turn alike.
    Without terms it holds the coordinate itself.

    Raises:
        InputError: a coordinate stands in it twice.
    """

    kind: Literal["coupler"] = "coupler"
    name: Name
    coordinate: Name = Field(description="name of the coordinate that follows")
    terms: tuple[CouplerTerm, ...] = Field(
        default=(), description="what it follows, each with its ratio"
    )
    offset: Real = Field(default=0.0, description="in the unit of `coordinate` [rad or m]")

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of its coordinates, the one that follows first."""
        return (self.coordinate, *(term.coordinate for term in self.terms))

    @property
    def weights(self) -> dict[str, float]:
        """Derivatives of its function by its coordinates."""
        return {self.coordinate: 1.0} | {term.coordinate: -term.ratio for term in self.terms}

    @property
    def features(self) -> tuple[Feature | Basic, ...]:
        """Features that a solver needs for it."""
        return (Feature.COUPLER,)

    @model_validator(mode="after")
    def _names_each_once(self) -> Self:
        for name in self.coordinates:
            if self.coordinates.count(name) > 1:
                raise ValueError(
                    f"coupler {self.name!r} names the coordinate {name!r} twice; once is needed"
                )
        return self

    def closure(self, coordinates: Sequence[str], is_angle: FloatArray) -> AngleFunction:
        """The function of the coordinates that it holds at zero [rad or m].

        Args:
            coordinates: names of all coordinates of the mechanism, in their order.
            is_angle: 1.0 of an angle, 0.0 of a slide, shape (n_q,).
        """
        row = np.array([self.weights.get(name, 0.0) for name in coordinates])
        row.flags.writeable = False  # shared by all callers
        follows = coordinates.index(self.coordinate)
        return AngleFunction(-self.offset, row, is_length=not is_angle[follows])
