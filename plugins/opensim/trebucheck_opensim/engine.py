"""OpenSim: Simbody's trees of mobilizers and error-controlled integrators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance, Part, has_stops
from trebucheck.models.errors import InputError
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import Positive, Real
from trebucheck_toolkit.event_driver import EventDriver

from .study import STUDY


def _has_loops(mechanism: Mechanism) -> bool:
    return bool(mechanism.loop_joints)


def _has_forces(mechanism: Mechanism) -> bool:
    return bool(mechanism.force_elements)


class OpenSimEngine(BuiltinEngine):
    """OpenSim's models of rigid bodies, which Simbody moves; the defaults are the assisted preset.

    By itself (:mod:`.alone`) it is a model of OpenSim's own elements, with `CoordinateLimitForce`
    for stops, which stays in it whatever the law, and its Manager from start to end. The default
    preset sets nothing: one call integrates to the end, and the states are those of the
    integrator's own steps. The settings ask for a finer accuracy and for a state at every step.

    Assisted, stops lock the coordinates that they are on, and Simbody's integrator moves the rest;
    which stops hold is found by multipliers on Simbody's mass matrix and accelerations, events are
    located by trebucheck's driver. Where something else is held, or springs act, OpenSim's
    accelerations are integrated by RK4 instead.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "opensim"
    package: ClassVar[str] = "opensim"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation="mobilizers (Simbody), stops as locked coordinates, error-controlled "
        "Runge-Kutta-Merson; with loops or springs multipliers and RK4 (by itself: coordinate "
        "limit forces, constraints and springs of its own)",
        features=frozenset(Feature),
    )
    default_options: ClassVar[Mapping[str, object] | None] = {
        "limits": "springs",
        "samples": "own steps",
        "accuracy": 1e-3,
        "limit_stiffness": 1.0,
        "limit_damping": 1e-3,
        "limit_transition": 0.1,
    }
    settings_options: ClassVar[Mapping[str, object] | None] = {
        "limits": "springs",
        # The step bounds the error. A finer accuracy takes the steps down to where they halt, in
        # singular positions of loops, which these pass over.
        "accuracy": 1e-5,
        "limit_stiffness": 1e7,
        "limit_damping": 1e5,
        "limit_transition": 1e-3,
    }
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
        Assistance(
            Part.STEPS,
            "begins the integrator anew at each step; integrates OpenSim's accelerations by RK4 "
            "with loops, springs or stops on points",
            "limits",
            off="springs",
        ),
        Assistance(
            Part.STOPS,
            "locks coordinates while stops hold, with torques by multipliers",
            "limits",
            off="springs",
            acts_on=has_stops,
        ),
        Assistance(
            Part.LOOPS, "closes loops by multipliers", "limits", off="springs", acts_on=_has_loops
        ),
        Assistance(
            Part.ELEMENTS,
            "computes the forces of springs, dampers and motors",
            "limits",
            off="springs",
            acts_on=_has_forces,
        ),
        Assistance(
            Part.EVENTS,
            "locates releases and impacts inside a step",
            "limits",
            off="springs",
            acts_on=has_stops,
        ),
        Assistance(
            Part.IMPACTS,
            "resolves impacts with Simbody's mass matrix",
            "limits",
            off="springs",
            acts_on=has_stops,
        ),
    )

    integrator: Literal[
        "RungeKuttaMerson", "RungeKuttaFeldberg", "RungeKutta3", "SemiExplicitEuler2"
    ] = Field(default="RungeKuttaMerson", description="Simbody's integrator")
    accuracy: Annotated[Real, Field(ge=1e-14, le=1e-1)] = Field(
        default=1e-11, description="relative local error that the integrator is asked for"
    )
    limits: Literal["locks", "springs"] = Field(
        default="locks",
        description="what a stop is: a locked coordinate while it holds, or a coordinate limit "
        "force",
    )
    limit_stiffness: Positive = Field(
        default=1e6, description="of a coordinate limit force [N m/degree]"
    )
    limit_damping: Positive = Field(
        default=1e3, description="of a coordinate limit force [N m s/degree]"
    )
    limit_transition: Positive = Field(
        default=0.01, description="angle to a limit force's full stiffness [degrees]"
    )

    samples: Literal["steps", "own steps"] = Field(
        default="steps",
        description="states that a Manager is asked for: one at each `timestep`, which ends a step "
        "of its integrator, or those after the integrator's own steps",
    )

    @model_validator(mode="after")
    def _refuse_idle_options(self) -> Self:
        """Refuse the integrator's own steps where events are located in trebucheck's."""
        if self.limits == "locks" and self.samples == "own steps":
            raise InputError(
                "samples = 'own steps' leaves no events to be located: limits = 'springs' takes it."
            )
        return self

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Stops that the adapter builds no limit force of OpenSim's for."""
        if self.limits == "locks":
            return frozenset()
        return frozenset({Basic.POINT_STOP, Basic.REBOUND})

    def _run(self, problem: Problem) -> Recording:
        # Imported here so that the class, its options and its documentation need no OpenSim.
        if self.limits == "springs":
            from .alone import run_alone

            return run_alone(problem, self)
        from .motion import Motion

        motion = Motion(problem.mechanism, self.integrator, self.accuracy, self.timestep)
        return EventDriver(problem, motion, self.name, self.timestep).run()

    def _script(self, problem: Problem) -> str:
        from .alone import script

        return script(problem, self)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The built model's mass matrix, forces and forward dynamics in each state."""
        self.refuse_absence()
        from .inspect import inspect

        return inspect(mechanism, states)
