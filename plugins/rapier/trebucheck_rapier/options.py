"""Numerical options of the Rapier adapter; defaults are the assisted preset."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np
from pydantic import Field
from trebucheck.engines.point_masses import LeastInertia
from trebucheck.engines.protocol import EngineOptions

OWN: Mapping[str, float | int] = {
    "timestep": float(np.float32(1 / 60)),  # a number of single precision
    "substeps": 4,
    "passes": 1,
}
"""Those of a world that sets nothing."""


class RapierOptions(EngineOptions):
    """Numerical options; their ranges are checked as in every :class:`EngineOptions`."""

    substeps: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=8,
        description="of a step, each with its own impulses (Rapier's numSolverIterations)",
    )
    passes: Annotated[int, Field(ge=1, le=10_000)] = Field(
        default=4, description="over all joints in a substep (Rapier's numInternalPgsIterations)"
    )
    allow_sleep: bool = Field(
        default=False, description="let bodies that hardly move for some time stand still"
    )
    least_inertia: LeastInertia = 1e-3
    carriage: Annotated[float | None, Field(gt=0.0, le=1.0)] = Field(
        default=1e-3,
        description="mass of the body that runs in a slot, as a part of that of the body it "
        "carries: Rapier has no joint that both slides and turns; None: no slots",
    )
    move_limits: bool = Field(
        default=True,
        description="put the nearest stop of a pin where Rapier's angle of it is zero, and its "
        "limit on within a quarter turn: Rapier knows an angle within half a turn",
    )
    opening: Annotated[float | None, Field(gt=0.0, le=0.1)] = Field(
        default=1e-4,
        description="gap at which a stop that releases for good is taken out [rad]; its release is "
        "looked back for. None: every stop stays for the whole run",
    )
    fit_steps: bool = Field(
        default=True,
        description="shorten the steps, so that a whole number of them makes the duration",
    )
