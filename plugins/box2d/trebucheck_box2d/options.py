"""Numerical options of the Box2D adapter; defaults are the assisted preset. Needs no Box2D."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field
from trebucheck.engines.point_masses import LeastInertia
from trebucheck.engines.protocol import EngineOptions
from trebucheck.models.spec import NonNegative
from trebucheck_toolkit.kept_limits import KeepLimits


class Box2DOptions(EngineOptions):
    """Numerical options; their ranges are checked as in every :class:`EngineOptions`."""

    velocity_iterations: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        default=100, description="of the impulses of the joints, each step"
    )
    position_iterations: Annotated[int, Field(ge=0, le=1_000_000)] = Field(
        default=100, description="of the correction of the joints' drift, each step"
    )
    allow_sleep: bool = Field(
        default=False, description="let bodies that hardly move for half a second stand still"
    )
    set_back: NonNegative = Field(
        default=1e-3,
        le=0.03,
        description="by how much limits lie beyond the stops [rad]: Box2D tolerates up to 2 "
        "degrees, and a limit is active only where the angle is not short of it by rounding",
    )
    keep_limits: KeepLimits = False
    least_inertia: LeastInertia = 1e-3
