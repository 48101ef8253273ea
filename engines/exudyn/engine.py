"""Exudyn: redundant coordinates, joints and stops as algebraic constraints with multipliers, implicit steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.spec import Positive, Real
from ..inspection import Inspection, State
from ..protocol import BuiltinEngine, Capabilities, Recording

_Tolerance = Annotated[Real, Field(gt=0, le=1e-2)]


class ExudynEngine(BuiltinEngine):
    """Exudyn's implicit solvers on a tree (or loops) of 2D rigid bodies.

    The step is shortened a little, so that a whole number of equal steps fits between the start or a release
    and the end: a short last step would be a source of noise in the multipliers.

    Under the unilateral law an open stop's gap is looked at after every step; where it fell below zero the run steps
    onto the zero, in either preset, and the speeds jump by Newton's law. A touch within one step is not seen.
    """

    name: ClassVar[str] = "exudyn"
    package: ClassVar[str] = "exudyn"
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=True,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation="redundant Cartesian coordinates, joints and stops by Lagrange multipliers, implicit integrator; "
        "impacts located inside a step and solved in the metric of its mass matrix",
    )
    # Exudyn's own defaults: generalized-alpha on the positions' constraints, modified Newton, adaptive step. Its
    # default step is 0.01 s, its tutorials take 1e-3 s. A newcomer switches a connector off after a step.
    stock_options: ClassVar[Mapping[str, object]] = {
        "timestep": 1e-3,
        "integrator": "generalized-alpha-index-3",
        "newton_relative": 1e-8,
        "newton_absolute": 1e-10,
        "modified_newton": True,
        "adaptive_step": True,
        "located_releases": False,
    }

    timestep: Positive = Field(default=1e-4, le=1.0, description="step size [s]")
    integrator: Literal["trapezoidal-index-2", "generalized-alpha-index-3"] = Field(
        default="trapezoidal-index-2", description="rule, and whether it holds the joints' speeds (2) or positions (3)"
    )
    spectral_radius: Real = Field(
        default=0.9, ge=0, lt=1, description="of generalized-alpha at infinite frequency, 0 to below 1"
    )
    # 1e-8, Exudyn's default, leaves 3 N m of noise in the torques of 8e4.
    newton_relative: _Tolerance = Field(
        default=1e-12, description="fall of the residual in a step (increments, if stops are springs), up to 1e-2"
    )
    newton_absolute: _Tolerance = Field(default=1e-9, description="residual that is small enough, up to 1e-2")
    modified_newton: bool = Field(default=False, description="keep the Jacobian over several steps")
    adaptive_step: bool = Field(default=False, description="shorten a step whose iteration fails, instead of an error")
    located_releases: bool = Field(default=True, description="step onto a release, instead of opening at a step's end")
    stop_stiffness: Positive | None = Field(
        default=None,
        description="closed stops are springs [N m/rad, or N/m on a point], in balance at the start; none: constraints",
    )
    # Undamped, a spring rings on after each kink of its torque, and lets go too early or late: the trapezoidal rule
    # damps nothing. At 0.1 ringing halves in each period, and the damper's lag is a tenth of a critical one's.
    stop_damping_ratio: Real = Field(
        default=0.1, ge=0, description="of such a spring with the inertia it holds at the start; 1 is critical"
    )

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Show the built system by its own matrices and outputs."""
        from .inspect import inspect  # loads Exudyn

        return inspect(mechanism, states, self)

    def _run(self, problem: Problem) -> Recording:
        from .run import run  # loads Exudyn

        return run(problem, self)
