"""A pin: two points of two bodies coincide."""

from __future__ import annotations

from typing import Literal

from .base import BaseJoint


class PinJoint(BaseJoint):
    """Two points of two bodies coincide."""

    kind: Literal["pin"] = "pin"
