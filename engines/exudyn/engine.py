"""Exudyn: redundant coordinates, algebraic constraints with multipliers, implicit steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from ...models.elements import (
    Coupler,
    CubicTorsionSpring,
    RecordedForce,
    RecordedTorque,
    RotorInertia,
    SlideSpringDamper,
    TranslationJoint,
)
from ...models.features import COVERED_BY_FEATURES
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ..inspection import Inspection, State
from ..protocol import BuiltinEngine, Capabilities, Recording, built_features
from ..study import EngineStudy
from ..supplied import Assistance, Part, Supplied, has_instants, has_loops, has_stops
from ..units import scaled_units
from .options import ExudynOptions
from .study import STUDY

BUILT: frozenset[type] = COVERED_BY_FEATURES | {
    Coupler,
    CubicTorsionSpring,
    RecordedForce,
    RecordedTorque,
    RotorInertia,
    SlideSpringDamper,
    TranslationJoint,
}
"""Classes that the tables of :mod:`.build` have a handler for; these need the library."""
_ALONE: Mapping[str, object] = {
    "own_limits": True,
    "locate_releases": False,
    "start_accelerations": False,
    "restarts": False,
    "fit_steps": False,
    "scaled_units": False,
}
"""Options with which trebucheck takes no part in a run."""


class ExudynEngine(ExudynOptions, BuiltinEngine):
    """Exudyn's implicit solvers on a tree (or loops) of 2D rigid bodies; the defaults are assisted.

    By itself (:mod:`.alone`) Exudyn runs from start to end in one call. Stops are its own
    unilateral elements (:mod:`.limits`), springs and dampers that stay in the system whatever the
    law: they keep to release-once only while no stop is met again. Their stiffness, which Exudyn
    has no default of, is such that they vibrate with a period of `limit_period` steps, and
    rebounds are those of Exudyn's impact model. Where it adapts its steps Exudyn looks for the
    beginning and the end of a contact by itself. A stop is read as released at the end of the first
    step after which its element has no force.

    With assistance (:mod:`.motion`) stops are constraints that are switched on and off, releases
    and impacts are stepped onto, and the speeds jump by Newton's law. A touch within one step is
    not seen. The step is shortened a little, so that a whole number of equal steps fits between the
    start or a release and the end: a short last step would be a source of noise in the multipliers.
    Where a recorded effort changes a run begins anew; by itself Exudyn has it as a function of the
    time.
    A run with loops begins anew beside positions in which their constraints depend on each other
    (:mod:`.solver`); steps that fail there are replaced by a longer one over the position.
    """

    name: ClassVar[str] = "exudyn"
    package: ClassVar[str] = "exudyn"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=True,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation="redundant Cartesian coordinates, joints and stops by Lagrange multipliers, "
        "implicit integrator; impacts located inside a step and solved in the metric of its mass "
        "matrix",
        features=built_features(BUILT),
        elements=BUILT,
    )
    # Those of `SimulationSettings()`; its step is an end of 1 s over 100 steps.
    default_options: ClassVar[Mapping[str, object] | None] = {
        **_ALONE,
        "timestep": 1e-2,
        "integrator": "generalized-alpha-index-3",
        "newton_relative": 1e-8,
        "newton_absolute": 1e-10,
        "modified_newton": True,
        "adaptive_step": True,
        "ignore_singular": False,
    }
    # The trapezoidal rule does not pass singular positions of loops. Generalised alpha does, but
    # the noise of its multipliers grows as 1/h^2, and it does not converge at stiff contacts. An
    # adaptive step goes onto the beginning and the end of contacts, however short it has to be.
    settings_options: ClassVar[Mapping[str, object] | None] = {
        **_ALONE,
        "loop_integrator": "generalized-alpha-index-3",
        "newton_relative": 1e-8,
        "newton_absolute": 1e-10,
        "adaptive_step": True,
        "minimum_step": 1e-12,
    }
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
        Assistance(
            Part.EVENTS,
            "switches stops, which are constraints, on and off",
            "own_limits",
            off=True,
            depending={"locate_releases": False},
            acts_on=has_stops,
        ),
        Assistance(
            Part.IMPACTS,
            "resolves impacts with the mass matrix",
            "own_limits",
            off=True,
            depending={"locate_releases": False},
            acts_on=has_stops,
        ),
        Assistance(
            Part.STOPS,
            "puts springs in balance in the place of stops",
            "stop_stiffness",
            off=None,
            acts_on=has_stops,
        ),
        Assistance(
            Part.EVENTS,
            "steps onto releases",
            "locate_releases",
            off=False,
            acts_on=has_stops,
        ),
        Assistance(
            Part.START,
            "computes accelerations at each start from Exudyn's equations",
            "start_accelerations",
            off=False,
        ),
        Assistance(
            Part.RESTARTS,
            "begins anew beside singular positions of loops, and goes over them",
            "restarts",
            off=False,
            acts_on=has_loops,
        ),
        Assistance(
            Part.RESTARTS,
            "begins anew where a recorded effort changes",
            "own_limits",
            off=True,
            depending={"locate_releases": False},
            acts_on=has_instants,
        ),
        Assistance(
            Part.SUBSTEPS,
            "shortens the steps, so that a whole number of them fits",
            "fit_steps",
            off=False,
        ),
        scaled_units(),
    )
    readings: ClassVar[Supplied] = {
        Part.TORQUES: "of stops on angles that rebound, where they are Exudyn's own"
    }

    def _run(self, problem: Problem) -> Recording:
        # Imported here so that the class, its options and its documentation need no Exudyn.
        if not self.assisted_by:
            from .alone import run_alone

            return run_alone(problem, self)
        from .motion import run

        return self.units(problem.mechanism).run(run, problem, self)

    def _script(self, problem: Problem) -> str:
        from .alone import script

        return script(problem, self)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Show the built system by its own matrices and outputs."""
        self.refuse_absence()
        from .inspect import inspect

        return self.units(mechanism).inspect(inspect, mechanism, states, self)
