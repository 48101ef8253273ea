"""Brax: joints, limits and actuators in JAX, by one of three pipelines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance, Part
from trebucheck.models.elements import SlideSpringDamper
from trebucheck.models.features import COVERED_BY_FEATURES, Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import NonNegative, Positive, Real

from .study import STUDY

_Impedance = Annotated[Real, Field(ge=1e-4, le=0.9999)]
_CAPABILITIES = Capabilities(
    joint_reactions=False,
    joint_gaps=True,
    located_releases=False,
    stop_laws=frozenset(StopLaw),
    formulation="minimal relative joints, semi-implicit Euler, soft limits (pipelines positional "
    "and spring: bodies, joints by corrected positions or by springs); no forces of joints are told",
    features=frozenset(
        {Feature.FREE_JOINT, Feature.MOVING_SLOT, Feature.PRISMATIC, Feature.WELD}
        | {Feature.ROTATIONAL_SPRING, Feature.TORQUE, Feature.SLIDE_SPRING}
        | {Feature.GRAVITY_DIRECTION}
    ),
    lacking=frozenset({Basic.LOOP, Basic.POINT_STOP, Basic.REBOUND}),
    elements=COVERED_BY_FEATURES | {SlideSpringDamper},
)


class _ByPipeline:
    """Capabilities: of the class all, of options those of their pipeline."""

    def __get__(self, engine: BraxEngine | None, _: type) -> Capabilities:
        if engine is None or engine.pipeline == "generalized":
            return _CAPABILITIES
        return replace(_CAPABILITIES, stop_torques=False)


class BraxEngine(BuiltinEngine):
    """A pipeline of Brax; the defaults are the assisted preset.

    By itself it steps the MJCF of a mechanism, limits, torques and springs of joints included. The
    default preset sets nothing, in JAX's single precision, by the pipeline that Brax's environments
    default to; assisted, the masses are in a unit of the machine's size, as the solver of Brax's
    limits ends at a residual and a step of fixed size.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "brax"
    package: ClassVar[str] = "brax"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = _ByPipeline()  # type: ignore[assignment]
    default_options: ClassVar[Mapping[str, object] | None] = {
        "precision": "single",
        "timestep": 2e-3,
        "matrix_inv_iterations": 10,
        "solver_maxls": 20,
        "solref": (0.02, 1.0),
        "solimp": (0.9, 0.95, 0.001, 0.5, 2.0),
        "mass_unit": "kg",
    }
    settings_options: ClassVar[Mapping[str, object] | None] = {"mass_unit": "kg"}
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
        Assistance(
            Part.UNITS,
            "gives masses in units of the greatest inertia that a limit feels",
            "mass_unit",
            off="kg",
        ),
    )

    timestep: Positive = Field(default=5e-5, le=1.0, description="step size [s]")
    pipeline: Literal["generalized", "positional", "spring"] = Field(
        default="generalized", description="Brax's pipeline"
    )
    precision: Literal["double", "single"] = Field(
        default="double", description="of JAX's numbers (`jax_enable_x64`)"
    )
    matrix_inv_iterations: int = Field(
        default=0,
        ge=0,
        le=1000,
        description="of the approximate inverse of the mass matrix; 0: it is solved (generalized)",
    )
    solver_iterations: int = Field(
        default=100, ge=1, le=10_000, description="of the forces of limits, at most (generalized)"
    )
    solver_maxls: int = Field(
        default=40, ge=1, le=1000, description="of a line search of theirs, at most (generalized)"
    )
    solref: tuple[Real, Real] | None = Field(
        default=None,
        description="reference of limits: time constant [s] and damping ratio if positive, "
        "-stiffness [1/s^2] and -damping [1/s] if negative; None: 8 time steps, 1 (generalized)",
    )
    solimp: tuple[_Impedance, _Impedance, NonNegative, Real, Real] = Field(
        default=(0.99, 0.99, 0.001, 0.5, 2.0),
        description="impedance of limits: d0, d_width, width, midpoint, power (generalized)",
    )
    joint_scale_pos: Positive = Field(
        default=0.5, le=2.0, description="part of a joint's gap that a step corrects (positional)"
    )
    joint_scale_ang: Positive = Field(
        default=0.2, le=2.0, description="the same of the angle of a limit (positional)"
    )
    constraint_stiffness: Positive = Field(
        default=2000.0, description="of joints [N/m] and about their held axes [N m/rad] (spring)"
    )
    constraint_limit_stiffness: Positive = Field(
        default=1000.0, description="of limits [N m/rad] (spring)"
    )
    constraint_vel_damping: NonNegative = Field(
        default=0.0, description="of joints [N s/m] (spring)"
    )
    mass_unit: Literal["machine", "kg"] = Field(
        default="machine",
        description="of what Brax is given; machine: the greatest inertia that a limit feels",
    )

    def _run(self, problem: Problem) -> Recording:
        # Imported here so that the class, its options and its documentation need no Brax.
        from .alone import run_alone

        return run_alone(problem, self)

    def _script(self, problem: Problem) -> str:
        from .alone import script

        return script(problem, self)
