"""Brax: joints, limits and motors in JAX, by one of three pipelines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance, Part, Supplied
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import NonNegative, Positive, Real

from .study import STUDY

_Impedance = Annotated[Real, Field(ge=1e-4, le=0.9999)]
_Count = Annotated[int, Field(ge=1, le=10_000)]
_SCALED = "gives masses in units of the machine's size"
_CAPABILITIES = Capabilities(
    joint_reactions=False,
    joint_gaps=True,
    located_releases=False,
    stop_laws=frozenset(StopLaw),
    formulation="minimal relative joints, semi-implicit Euler, soft limits (other pipelines: "
    "bodies, joints by corrected positions or springs); no forces of joints are told",
    features=frozenset(Feature) - {Feature.MOVING_WALL},
    lacking=frozenset({Basic.LOOP, Basic.POINT_STOP, Basic.REBOUND}),
)


class _ByPipeline:
    """Capabilities: of the class those of `generalized`, which alone tells forces of limits."""

    def __get__(self, engine: BraxEngine | None, _: type) -> Any:
        tells = engine is None or engine.pipeline == "generalized"
        return replace(_CAPABILITIES, stop_torques=tells)


class BraxEngine(BuiltinEngine):
    """A pipeline of Brax; the defaults are the assisted preset.

    By itself it steps the MJCF of a mechanism, with the limits of its joints. The default preset
    sets nothing, in JAX's single precision, by the pipeline to which Brax's environments default;
    assisted, masses are in a unit of the machine's size, as the solver of Brax's limits ends at a
    residual and a step of fixed size.
    """

    name: ClassVar[str] = "brax"
    package: ClassVar[str] = "brax"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Any] = _ByPipeline()
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
            Part.UNITS, _SCALED, "mass_unit", off="kg", acts_on=lambda made: bool(made.stops)
        ),
    )
    readings: ClassVar[Supplied] = {Part.ELEMENTS: "as controls of motors before each step"}

    timestep: Positive = Field(default=5e-5, le=1.0, description="step size [s]")
    pipeline: Literal["generalized", "positional", "spring"] = Field(
        default="generalized", description="Brax's pipeline; options of others do nothing"
    )
    precision: Literal["double", "single"] = Field(
        default="double", description="of JAX's numbers (`jax_enable_x64`)"
    )
    matrix_inv_iterations: int = Field(
        default=0, ge=0, le=1000, description="generalized: of the mass matrix; 0: it is solved"
    )
    solver_iterations: _Count = Field(default=100, description="generalized: of limits, at most")
    solver_maxls: _Count = Field(default=40, description="generalized: of their line search")
    solref: tuple[Real, Real] | None = Field(
        default=None,
        description="generalized: time constant [s] and damping ratio of limits if positive, "
        "-stiffness [1/s^2] and -damping [1/s] if negative; None: 8 time steps, 1",
    )
    solimp: tuple[_Impedance, _Impedance, NonNegative, Real, Real] = Field(
        default=(0.99, 0.99, 0.001, 0.5, 2.0), description="generalized: impedance of limits"
    )
    joint_scale_pos: Positive = Field(default=0.5, description="positional: gap corrected a step")
    joint_scale_ang: Positive = Field(default=0.2, description="positional: angle of limits, too")
    constraint_stiffness: Positive = Field(default=2e3, description="spring: of joints [N/m]")
    constraint_limit_stiffness: Positive = Field(default=1e3, description="spring: [N m/rad]")
    constraint_vel_damping: NonNegative = Field(default=0.0, description="spring: [N s/m]")
    mass_unit: Literal["machine", "kg"] = Field(
        default="machine", description="generalized: kg, or the greatest inertia that a limit feels"
    )

    def _plan(self, problem: Problem) -> Any:
        from .alone import Plan  # here, so that the class and its options need no MuJoCo

        return Plan(problem, self)

    def _run(self, problem: Problem) -> Recording:
        return self._plan(problem).run()

    def _script(self, problem: Problem) -> str:
        return self._plan(problem).program()

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Mass matrix, forces and accelerations in each state, in double precision."""
        self.refuse_absence()
        if self.pipeline != "generalized":
            raise UnsupportedProblemError("our adapter reads no dynamics of this pipeline of Brax.")
        double = self.model_copy(update={"precision": "double"})
        return double._plan(Problem(mechanism, duration=self.timestep)).inspect(states)
