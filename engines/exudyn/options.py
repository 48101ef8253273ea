"""The numerical options of the exudyn adapter; the defaults are the assisted preset."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field

from ...models.mechanism import Mechanism
from ...models.spec import Positive, Real
from ..units import SI, ScaledOptions, Units

_Tolerance = Annotated[Real, Field(gt=0, le=1e-2)]
Integrator = Literal["trapezoidal-index-2", "generalized-alpha-index-3"]


class ExudynOptions(ScaledOptions):
    """Numerical options; their ranges are checked as in every :class:`EngineOptions`."""

    timestep: Positive = Field(default=1e-4, le=1.0, description="step size [s]")
    integrator: Integrator = Field(
        default="trapezoidal-index-2",
        description="rule, and whether it holds the joints' speeds (2) or positions (3)",
    )
    loop_integrator: Integrator | None = Field(
        default=None,
        description="rule for mechanisms with loops and without stops, if it is another one",
    )
    spectral_radius: Real = Field(
        default=0.9,
        ge=0,
        lt=1,
        description="of generalized-alpha at infinite frequency, 0 to below 1",
    )
    # 1e-8, Exudyn's default, leaves 3 N m of noise in the torques of 8e4.
    newton_relative: _Tolerance = Field(
        default=1e-12,
        description="fall of the residual in a step (increments, if stops are springs), up to 1e-2",
    )
    newton_absolute: _Tolerance = Field(
        default=1e-9, description="residual that is small enough, up to 1e-2"
    )
    modified_newton: bool = Field(default=False, description="keep the Jacobian over several steps")
    adaptive_step: bool = Field(
        default=False, description="shorten a step whose iteration fails, instead of an error"
    )
    minimum_step: Positive = Field(
        default=1e-8, description="step that an adaptive step is not shortened below [s]"
    )
    ignore_singular: bool = Field(
        default=True,
        description="where constraints may depend on each other, leave out multipliers that they "
        "do not determine",
    )
    own_limits: bool = Field(
        default=False,
        description="stops are Exudyn's own unilateral springs from start to end, instead of "
        "constraints that are switched; their forces are rounded above the tightest tolerances of "
        "Newton's iteration",
    )
    limit_period: Positive = Field(
        default=10.0,
        description="period of such a spring with the inertia that its stop feels at the start "
        "[time steps]",
    )
    locate_releases: bool = Field(
        default=True, description="step onto a release, instead of opening at a step's end"
    )
    start_accelerations: bool = Field(
        default=True,
        description="give Exudyn the accelerations at each start, by finer difference quotients "
        "of its equations than its own",
    )
    restarts: bool = Field(
        default=True,
        description="begin anew beside singular positions of loops, and go over them where a step "
        "fails",
    )
    fit_steps: bool = Field(
        default=True,
        description="shorten the steps a little, so that a whole number of them fits",
    )
    stop_stiffness: Positive | None = Field(
        default=None,
        description="closed stops are springs [N m/rad, or N/m on a point], in balance at the "
        "start; none: constraints",
    )
    # Undamped, a spring rings on after each kink of its torque, and lets go too early or late: the
    # trapezoidal rule damps nothing. At 0.1 ringing halves in each period, and the damper's lag is
    # a tenth of a critical one's.
    stop_damping_ratio: Real = Field(
        default=0.1,
        ge=0,
        description="of such a spring with the inertia it holds at the start; 1 is critical",
    )

    def rule(self, mechanism: Mechanism) -> Integrator:
        """The integrator for a mechanism."""
        only_loops = mechanism.bound_by and not mechanism.stops
        return (self.loop_integrator if only_loops else None) or self.integrator

    def units(self, mechanism: Mechanism) -> Units:
        """SI where a stiffness is given, which is in SI units."""
        return super().units(mechanism) if self.stop_stiffness is None else SI

    def in_time_unit(self, unit: float) -> Self:
        """The same options for a system whose unit of time is so many seconds."""
        times = {"timestep": self.timestep / unit, "minimum_step": self.minimum_step / unit}
        return self.model_copy(update=times)
