"""MuJoCo: a tree of relative joints; stops are soft limits and contacts, loops equalities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from ...models.features import Basic, Feature
from ...models.mechanism import Mechanism
from ...models.mjcf.elements import FORCE_WRITERS
from ...models.mjcf.tree import SLIDES
from ...models.mjcf.writer import STOP_SENSORS
from ...models.problem import Problem, StopLaw
from ..inspection import Inspection, State
from ..protocol import BuiltinEngine, Capabilities, Recording, built_features
from ..study import EngineStudy
from ..supplied import Part, Supplied
from ..units import units_of
from .options import MujocoOptions
from .study import STUDY

BUILT: frozenset[type] = frozenset(
    (*SLIDES.handlers, *STOP_SENSORS.handlers, *FORCE_WRITERS.handlers)
)
"""Classes of elements that the writer of MJCF has a handler for."""


class MujocoEngine(MujocoOptions, BuiltinEngine):
    """MuJoCo on the MJCF of :mod:`...models.mjcf.writer`; the defaults are the tuned preset.

    Stops are joint limits, which MuJoCo treats as soft: a stop gives way by about 1e-10 rad at a
    step of 1e-3 s, and by four times that at twice the step, for the tuned limits are scaled with
    it. Under the release-once law a limit is taken out of the model when it releases, and those
    open at the start are out from the beginning. Under the unilateral law one that is open is out
    as well; an impact is located inside its step, resolved at once with the stop's restitution
    through MuJoCo's mass matrix, and a stop that rests afterwards is put back.

    Stops on points are frictionless contacts of a sphere with a plane (a box on a body that moves),
    slots that close a loop are two of them, pins that do are `connect` equalities, angles that
    loops hold are equalities of tendons over hinges. Springs and dampers are tendons, constant
    forces and torques actuators without control. MuJoCo leaves (dJ/dt) qvel out of contacts, and a
    stiff reference acceleration, scaled with the step, follows the errors of RK4's inner stages.
    The tuned preset corrects both in `mjcb_control` (:mod:`.reference_acceleration`); points then
    give way by some 1e-9 m at 1e-3 s.

    The stock preset leaves every limit in the model for the whole run, as a newcomer would,
    whatever the law: it keeps to release-once only while no stop is met again, and an impact is
    that of a stiff, damped spring, spread over some steps. It gives back some of the speed where e
    = 0; a stop with another restitution is refused. It calls a stop released at the end of the
    first step after which its limit carries no torque.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "mujoco"
    package: ClassVar[str] = "mujoco"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation="minimal relative joints, stops and loops as soft limits, contacts and "
        "equalities "
        "(convex optimisation), RK4; "
        "releases and impacts located inside a step (stock: releases at its end, limits never "
        "removed, impacts soft)",
        features=built_features(BUILT),
        elements=BUILT,
    )
    # The documentation sends those who want energy conserved to RK4; the rest are its defaults.
    stock_options: ClassVar[Mapping[str, object]] = {
        "free_substeps": 1,
        "tolerance": 1e-8,
        "solref": (0.02, 1.0),
        "solimp": (0.9, 0.95, 0.001, 0.5, 2.0),
        "locate_releases": False,
        "preload": False,
        "moving_points": False,
        "keep_limits": True,
    }

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Restitution, where limits stay in the model: they give back what their springs do."""
        return frozenset() if not self.keep_limits else frozenset({Basic.REBOUND})

    @property
    def supplied(self) -> Supplied:
        """Located releases, and impacts of limits that are out of the model while open."""
        events = {Part.EVENTS: ""} if self.locate_releases or not self.keep_limits else {}
        return events if self.keep_limits else events | {Part.IMPACTS: ""}

    def _run(self, problem: Problem) -> Recording:
        # Imported here so that the class, its options and its documentation need no MuJoCo.
        from .motion import run

        return units_of(problem.mechanism).run(run, problem, self)

    def view(self, mechanism: Mechanism) -> None:
        """Open MuJoCo's own viewer, and return when it is closed."""
        self.refuse_absence()
        from .build import view

        view(mechanism, self.timestep)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The built model in each state, its closed limits at rest."""
        self.refuse_absence()
        from .inspect import inspect

        return units_of(mechanism).inspect(inspect, mechanism, states, self)
