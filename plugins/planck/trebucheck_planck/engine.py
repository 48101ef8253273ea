"""planck.js: Cartesian bodies, joints and limits by sequential impulses, double precision."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.point_masses import spread_masses, spreads_masses
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance, Part, Supplied
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck_toolkit.kept_limits import LIMITS_TAKEN_OUT
from trebucheck_toolkit.node_samples import NodeSamples, sample_times
from trebucheck_toolkit.node_scene import Json, NodeScene

from .alone import run_alone, script
from .bridge import PLANCK
from .inspect import inspect
from .motion import recording
from .options import OWN_SLOPS, PlanckOptions
from .study import STUDY

_ALONE: Mapping[str, object] = {
    "hold": False,
    "keep_limits": True,
    "least_inertia": None,
    "fit_steps": False,
}
"""Options with which trebucheck takes no part in a run."""


def _has_stops(mechanism: Mechanism) -> bool:
    return bool(mechanism.stops)


class PlanckEngine(PlanckOptions, BuiltinEngine):
    """planck.js's world in Node.js.

    By itself (:mod:`.alone`) the limit of every stop stays in its joint, and bodies are those of
    the mechanism; point masses, which planck.js would never turn, have an inertia by mass moved
    along their pins. With assistance a stop that pushes is held from both sides, limits go with
    their stops, and every body has some inertia. With every preset springs, dampers and motors are
    forces and torques that are given to the bodies before each step, as planck.js's own springs are
    soft joints, which have a frequency and no stiffness.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "planck"
    package: ClassVar[str] = "trebucheck-planck"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=True,
        located_releases=False,
        stop_laws=frozenset(StopLaw),
        formulation="Cartesian coordinates, joints and limits by sequential impulses, "
        "semi-implicit Euler",
        features=frozenset(Feature) - {Feature.MOVING_WALL},
        lacking=frozenset({Basic.POINT_STOP, Basic.REBOUND}),
    )
    default_options: ClassVar[Mapping[str, object] | None] = {
        **_ALONE,
        # `step` has no step size of its own: that of planck.js's HelloWorld.ts.
        "timestep": 1 / 60,
        "first_iterations": 8,
        "velocity_iterations": 8,
        "position_iterations": 3,
        "linear_slop": OWN_SLOPS["linearSlop"],
        "angular_slop": OWN_SLOPS["angularSlop"],
        "allow_sleep": True,
    }
    settings_options: ClassVar[Mapping[str, object] | None] = _ALONE
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
        Assistance(
            Part.EVENTS,
            "holds a stop from both sides while it pushes, and lets it go where it would pull",
            "hold",
            off=False,
            acts_on=_has_stops,
        ),
        LIMITS_TAKEN_OUT,
        Assistance(
            Part.MODEL,
            "moves mass along pins to bodies of little inertia",
            "least_inertia",
            off=None,
            acts_on=spreads_masses,
        ),
        Assistance(
            Part.SUBSTEPS,
            "shortens the steps, so that a whole number of them fits",
            "fit_steps",
            off=False,
        ),
    )
    readings: ClassVar[Supplied] = {Part.ELEMENTS: "as forces given before each step"}

    @classmethod
    def is_installed(cls) -> bool:
        """Tell whether Node.js is on the path and planck.js beside this package."""
        return PLANCK.is_installed()

    @classmethod
    def version(cls) -> str:
        """Version of planck.js's npm package; 'not installed' if there is none."""
        return PLANCK.version()

    @classmethod
    def absence(cls) -> str:
        """Missing program or package and how to install it, in one sentence."""
        return PLANCK.absence()

    def _run(self, problem: Problem) -> Recording:
        if not self.assisted_by:
            return run_alone(problem, self)
        spread = spread_masses(problem.mechanism, self.least_inertia, self.name)
        scene = NodeScene(spread.mechanism, self.name)
        t = sample_times(problem.duration, self.timestep, fit=self.fit_steps)
        step = problem.duration / (len(t) - 1) if self.fit_steps else self.timestep
        described = scene.description(problem, step, len(t) - 1)
        described["once"] = described["once"] and not self.keep_limits
        moved = PLANCK.move(described | self._settings())
        return recording(NodeSamples(scene, t, moved), spread, problem)

    def _script(self, problem: Problem) -> str:
        return script(problem, self)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Masses, inertias, anchors and gravity of the built world, and what follows from them."""
        self.refuse_absence()
        return inspect(mechanism, states, self._settings())

    def _settings(self) -> Json:
        return {
            "firstIterations": self.first_iterations,
            "velocityIterations": self.velocity_iterations,
            "positionIterations": self.position_iterations,
            "linearSlop": self.linear_slop,
            "angularSlop": self.angular_slop,
            "allowSleep": self.allow_sleep,
            "hold": self.hold,
        }
