"""The numerical options of the reference adapter; the defaults are the tuned preset."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ...models.spec import Real
from ...reference.solver import TOLERANCE
from ..options import EngineOptions

_Tolerance = Annotated[Real, Field(ge=2.5e-14, le=1e-2)]


class ReferenceOptions(EngineOptions):
    """Numerical options.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    integrator: Literal["dop853", "taylor", "auto"] = Field(
        default="dop853", description="SciPy's DOP853, heyoka's Taylor series, or Taylor where heyoka is installed"
    )
    rtol: _Tolerance = Field(
        default=TOLERANCE, description="relative local error of DOP853; Taylor series go to the last digit"
    )
    atol: _Tolerance = Field(default=TOLERANCE, description="absolute local error [rad, m, rad/s, m/s]")
