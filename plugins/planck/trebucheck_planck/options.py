"""Numerical options of the planck.js adapter; defaults are the assisted preset."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated

from pydantic import Field
from trebucheck.engines.point_masses import LeastInertia
from trebucheck.engines.protocol import EngineOptions
from trebucheck.models.spec import Positive
from trebucheck_toolkit.kept_limits import KeepLimits

OWN_SLOPS: Mapping[str, float] = {"linearSlop": 5e-3, "angularSlop": 2.0 / 180.0 * math.pi}
"""planck.js's own settings."""


class PlanckOptions(EngineOptions):
    """Numerical options; their ranges are checked as in every :class:`EngineOptions`."""

    timestep: Positive = Field(default=1e-4, le=1.0, description="step size [s]")
    velocity_iterations: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        default=30, description="of the impulses of the joints, each step"
    )
    first_iterations: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        default=3000,
        description="those of the first step, which begins without impulses of one before",
    )
    position_iterations: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        default=30,
        description="of the correction of the joints' drift, each step; it ends within the slops",
    )
    linear_slop: Positive = Field(
        default=1e-9, le=1.0, description="drift of joints that is let be [m]"
    )
    angular_slop: Positive = Field(
        default=1e-9, le=0.1, description="drift of angles and limits that is let be [rad]"
    )
    allow_sleep: bool = Field(
        default=False, description="let bodies that hardly move for half a second stand still"
    )
    hold: bool = Field(
        default=True,
        description="whether a stop that pushes is held from both sides until it would pull: the "
        "correction of pins turns bodies, and opens a limit that holds from one side",
    )
    keep_limits: KeepLimits = False
    least_inertia: LeastInertia = 1e-3
    fit_steps: bool = Field(
        default=True,
        description="shorten the steps, so that a whole number of them makes the duration",
    )
