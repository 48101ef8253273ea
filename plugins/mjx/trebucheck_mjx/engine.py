"""MJX: MuJoCo rewritten in JAX."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.mujoco.options import MujocoOptions
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance, Part
from trebucheck.models.errors import InputError
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import NonNegative, Real
from trebucheck_toolkit.event_driver import EventDriver

from .study import STUDY

_Impedance = Annotated[Real, Field(ge=1e-4, le=0.9999)]
_OWN = (
    "precision",
    "integrator",
    "solver",
    "tolerance",
    "iterations",
    "solref",
    "solimp",
    "margin",
)
"""Options of MJX, which do nothing with multipliers."""


def _has_stops(mechanism: Mechanism) -> bool:
    return bool(mechanism.stops)


def _has_loops(mechanism: Mechanism) -> bool:
    return bool(mechanism.loop_joints)


def _has_forces(mechanism: Mechanism) -> bool:
    return bool(mechanism.force_elements)


class MjxEngine(BuiltinEngine):
    """MJX on the MJCF of trebucheck; the defaults are the assisted preset.

    By itself (:mod:`.alone`) MJX steps the model that MuJoCo by itself has: soft limits and
    contacts for stops, which stay in it whatever the law, equalities and contacts for loops,
    tendons for springs. The default preset is MuJoCo's empty model in JAX's single precision; the
    settings are those of MuJoCo in double precision.

    Assisted, in double precision, MJX moves the tree of joints by its RK4 while nothing is held.
    Stops, loops and springs are multipliers and generalized forces from its mass matrix and
    accelerations, integrated by RK4 as well; events are located by trebucheck's driver.

    Raises:
        InputError: an option is unknown or outside its range, or one of MJX's is changed where
            multipliers hold what it is about.
    """

    name: ClassVar[str] = "mjx"
    package: ClassVar[str] = "mujoco-mjx"
    module: ClassVar[str | None] = "mujoco.mjx"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation="minimal relative joints, RK4, double precision; stops, loops and springs by "
        "multipliers (by itself: soft limits, contacts, equalities and tendons)",
        features=frozenset(Feature),
    )
    default_options: ClassVar[Mapping[str, object] | None] = {
        "limits": "soft",
        "precision": "single",
        "timestep": 2e-3,
        "integrator": "Euler",
        "tolerance": 1e-8,
        "solref": (0.02, 1.0),
        "solimp": (0.9, 0.95, 0.001, 0.5, 2.0),
        "margin": 0.0,
    }
    settings_options: ClassVar[Mapping[str, object] | None] = {"limits": "soft"}
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
        Assistance(
            Part.STEPS,
            "begins each step from the mechanism's coordinates; integrates MJX's accelerations by "
            "RK4 where something is held or a spring acts",
            "limits",
            off="soft",
        ),
        Assistance(
            Part.STOPS, "holds stops by multipliers", "limits", off="soft", acts_on=_has_stops
        ),
        Assistance(
            Part.LOOPS, "closes loops by multipliers", "limits", off="soft", acts_on=_has_loops
        ),
        Assistance(
            Part.ELEMENTS,
            "computes the forces of springs, dampers and motors",
            "limits",
            off="soft",
            acts_on=_has_forces,
        ),
        Assistance(
            Part.EVENTS,
            "locates releases and impacts inside a step",
            "limits",
            off="soft",
            acts_on=_has_stops,
        ),
        Assistance(
            Part.IMPACTS,
            "resolves impacts with MJX's mass matrix",
            "limits",
            off="soft",
            acts_on=_has_stops,
        ),
    )

    limits: Literal["multipliers", "soft"] = Field(
        default="multipliers",
        description="what holds stops and loops: multipliers, or MJX's soft limits, contacts and "
        "equalities",
    )
    precision: Literal["double", "single"] = Field(
        default="double", description="of MJX's numbers (`jax_enable_x64`)"
    )
    integrator: Literal["RK4", "Euler", "implicitfast"] = Field(
        default="RK4", description="MJX's integrator; all but RK4 are of first order"
    )
    solver: Literal["Newton", "CG"] = Field(default="Newton", description="MJX's constraint solver")
    tolerance: NonNegative = Field(default=1e-30, description="gain at which the solver stops")
    iterations: int = Field(default=100, ge=1, le=10_000, description="of the solver, at most")
    solref: tuple[Real, Real] | None = Field(
        default=None,
        description="reference of limits, contacts and equalities: time constant [s] and damping "
        "ratio if positive, -stiffness [1/s^2] and -damping [1/s] if negative; None: scaled with "
        "the time step",
    )
    solimp: tuple[_Impedance, _Impedance, NonNegative, Real, Real] = Field(
        default=(0.9999, 0.9999, 0.001, 0.5, 2.0),
        description="impedance of limits, contacts and equalities: d0, d_width, width, midpoint, "
        "power",
    )
    margin: NonNegative = Field(
        default=1e-12,
        le=1e-2,
        description="nearer than this to its limit, a joint feels it [rad]; of a point times the "
        "machine's size [m]",
    )

    @model_validator(mode="after")
    def _refuse_idle_options(self) -> Self:
        """Refuse options of MJX that do nothing beside multipliers."""
        if self.limits == "multipliers":
            for name in _OWN:
                value, default = getattr(self, name), type(self).model_fields[name].default
                if value != default:
                    raise InputError(
                        f"{name} = {value!r} does nothing with limits = 'multipliers', which asks "
                        f"for {default!r}; limits = 'soft' takes it."
                    )
        return self

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Restitution, where limits are soft: they give back what their springs do."""
        return frozenset() if self.limits == "multipliers" else frozenset({Basic.REBOUND})

    @property
    def of_mujoco(self) -> MujocoOptions:
        """Options of MuJoCo for the model that MJX steps."""
        own = {name: getattr(self, name) for name in ("timestep", *_OWN) if name != "precision"}
        return MujocoOptions(**own)

    def _run(self, problem: Problem) -> Recording:
        # Imported here so that the class, its options and its documentation need no MJX.
        if self.limits == "soft":
            from .alone import run_alone

            return run_alone(problem, self.of_mujoco, double=self.precision == "double")
        from .motion import Motion

        return EventDriver(
            problem, Motion(problem.mechanism, self.timestep), self.name, self.timestep
        ).run()

    def _script(self, problem: Problem) -> str:
        from .alone import script

        return script(problem, self.of_mujoco, double=self.precision == "double")

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The built model's mass matrix, forces and forward dynamics in each state."""
        self.refuse_absence()
        from .inspect import inspect

        return inspect(mechanism, states)
