"""A pin in a straight slot, of another body or of the ground."""

from __future__ import annotations

from typing import Literal

from .base import GROUND, Basic, Feature, SlidingJoint


class SlotJoint(SlidingJoint):
    """A point of a body slides along a straight slot in another body or in the ground."""

    kind: Literal["pin-in-slot"] = "pin-in-slot"

    @property
    def features(self) -> tuple[Feature | Basic, ...]:
        return (Basic.SLOT,) if self.parent == GROUND else (Feature.MOVING_SLOT,)
