"""Box2D 2.3: Cartesian bodies, joints and limits by sequential impulses, single precision."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.point_masses import spreads_masses
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance, Part, Supplied, has_stops
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck_toolkit.kept_limits import LIMITS_TAKEN_OUT
from trebucheck_toolkit.plain_run import plain_run

from .options import Box2DOptions
from .study import STUDY

_ALONE: Mapping[str, object] = {"set_back": 0.0, "keep_limits": True, "least_inertia": None}
"""Options with which trebucheck takes no part in a run."""


class Box2DEngine(Box2DOptions, BuiltinEngine):
    """Box2D's world of bodies, joints and limits.

    By itself (:mod:`.alone`) the limit of every stop stays in its joint, and bodies are those of
    the mechanism; point masses, which Box2D would never turn, have an inertia by mass moved along
    their pins. With assistance (:mod:`.motion`) limits lie a little beyond their stops and go with
    them, and every body has some inertia. With every preset springs, dampers and motors are forces
    and torques that are given to the bodies before each step, as Box2D's own springs are soft
    joints, which have a frequency and no stiffness.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "box2d"
    package: ClassVar[str] = "box2d"
    module: ClassVar[str | None] = "Box2D"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=True,
        located_releases=False,
        stop_laws=frozenset(StopLaw),
        formulation="Cartesian coordinates in single precision, joints and limits by sequential "
        "impulses, semi-implicit Euler",
        features=frozenset(Feature) - {Feature.MOVING_WALL},
        lacking=frozenset({Basic.POINT_STOP, Basic.REBOUND}),
    )
    default_options: ClassVar[Mapping[str, object] | None] = {
        **_ALONE,
        # `Step` has no defaults: step and iterations of Box2D's first example, examples/hello.py.
        "timestep": 1 / 60,
        "velocity_iterations": 6,
        "position_iterations": 2,
        "allow_sleep": True,
    }
    settings_options: ClassVar[Mapping[str, object] | None] = {
        **_ALONE,
        "timestep": 2.5e-4,
        # The correction of positions moves limits off their stops and on again, and more iterations
        # pile up forces that redundant loops leave undetermined.
        "velocity_iterations": 30,
        "position_iterations": 0,
    }
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
        Assistance(
            Part.MODEL,
            "sets limits a little beyond their stops",
            "set_back",
            off=0.0,
            acts_on=has_stops,
        ),
        LIMITS_TAKEN_OUT,
        Assistance(
            Part.MODEL,
            "moves mass along pins to bodies of little inertia",
            "least_inertia",
            off=None,
            acts_on=spreads_masses,
        ),
    )
    readings: ClassVar[Supplied] = {Part.ELEMENTS: "as forces given before each step"}

    def _run(self, problem: Problem) -> Recording:
        if not self.assisted_by:
            from .alone import run_alone

            return run_alone(problem, self)
        from .motion import Motion

        return plain_run(problem, Motion(problem, self), self.name, self.timestep)

    def _script(self, problem: Problem) -> str:
        from .alone import script

        return script(problem, self)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Masses, inertias, anchors and gravity of the built world, and what follows from them."""
        self.refuse_absence()
        from .inspect import inspect

        return inspect(mechanism, states)
