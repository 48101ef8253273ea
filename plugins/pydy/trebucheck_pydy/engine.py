"""PyDy: Kane's equations that SymPy generates, integrated by SciPy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording, built_features
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import MOVED, Assistance, Part, Supplied, all_by
from trebucheck.models.elements import CubicTorsionSpring, TranslationJoint
from trebucheck.models.features import COVERED_BY_FEATURES, Basic, Feature, refuse_features
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import Positive, Real
from trebucheck_toolkit.event_driver import EventDriver

from .study import STUDY

_BUILT = COVERED_BY_FEATURES | {CubicTorsionSpring, TranslationJoint}
_ASSISTED: Supplied = {part: text for part, text in MOVED.items() if part is not Part.ELEMENTS}


class PydyEngine(BuiltinEngine):
    """SymPy's `KanesMethod` and PyDy's `System`; the defaults are the assisted preset.

    Assisted (`mode="events"`), DOP853 moves SymPy's mass matrix and forces, loads among them, in
    steps of ours; stops and loops are multipliers on them, and events are located by trebucheck's
    driver. By itself (`mode="system"`) it is `System.integrate` from start to end, loops closed by
    dependent speeds; SymPy's mechanics has no unilateral constraints. In both, energies and points
    are SymPy's, and reactions Kane's auxiliary equations.
    """

    name: ClassVar[str] = "pydy"
    package: ClassVar[str] = "pydy"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation="Kane's equations in the mechanism's coordinates, stops and loops by "
        "multipliers, DOP853 (default: loops by dependent speeds, LSODA)",
        features=built_features(_BUILT),
        elements=_BUILT,
    )
    # `System.integrate()` without arguments, at the times of the README's example.
    default_options: ClassVar[Mapping[str, object] | None] = {
        "mode": "system",
        "timestep": 10.0 / 999,
        "integrator": "odeint",
        "tolerance": 1.49012e-8,
    }
    settings_options: ClassVar[Mapping[str, object] | None] = {"mode": "system"}
    assistance: ClassVar[tuple[Assistance, ...] | None] = all_by("mode", "system", _ASSISTED)
    readings: ClassVar[Supplied] = {
        Part.LOOP_REACTIONS: "by multipliers on the tree's mass matrix and forces"
    }

    timestep: Positive = Field(
        default=4e-3, le=1.0, description="between states, and longest step of DOP853 [s]"
    )
    mode: Literal["events", "system"] = Field(
        default="events",
        description="steps, stops and loops by trebucheck; or `System.integrate` alone",
    )
    integrator: Literal["odeint", "DOP853"] = Field(
        default="DOP853",
        description="of `System`: PyDy's own, or SciPy's DOP853 as its `ode_solver`",
    )
    tolerance: Annotated[Real, Field(ge=1e-14, le=1e-1)] = Field(
        default=1e-13, description="relative and absolute tolerance of the integrator"
    )

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Elements that PyDy has not by itself."""
        if self.mode == "events":
            return frozenset()
        return frozenset({Basic.STOP, Basic.POINT_STOP, Basic.REBOUND, Feature.MOVING_WALL})

    @property
    def supplied(self) -> Supplied:
        """Parts that trebucheck does: all but the equations; by itself readings."""
        return _ASSISTED if self.mode == "events" else self.readings

    def _run(self, problem: Problem) -> Recording:
        from .motion import KaneMotion, run_system

        if self.mode == "system":
            return run_system(problem, self)
        motion = KaneMotion(problem.mechanism, self.tolerance)
        return EventDriver(problem, motion, self.name, self.timestep).run()

    def _script(self, problem: Problem) -> str:
        from .motion import program

        return program(problem.mechanism, self, problem.duration)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The generated mass matrix, forces and accelerations in each state."""
        self.refuse_absence()
        able = self.capabilities
        refuse_features(mechanism, able.features, self.name, classes=able.elements)
        from .motion import KaneMotion

        return KaneMotion(mechanism, self.tolerance).inspect(states)
