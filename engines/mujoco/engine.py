"""MuJoCo: a tree of relative joints; stops are soft limits and contacts, loops equalities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from ...models.elements import Coupler
from ...models.features import Basic, Feature
from ...models.mechanism import Mechanism
from ...models.mjcf.elements import FORCE_WRITERS
from ...models.mjcf.tree import SLIDES
from ...models.mjcf.writer import STOP_SENSORS
from ...models.problem import Problem, StopLaw
from ..inspection import Inspection, State
from ..protocol import BuiltinEngine, Capabilities, Recording, built_features
from ..study import EngineStudy
from ..supplied import Assistance, Part, has_stops
from ..units import scaled_units
from .options import MujocoOptions
from .study import STUDY

BUILT: frozenset[type] = frozenset(
    (*SLIDES.handlers, *STOP_SENSORS.handlers, *FORCE_WRITERS.handlers, Coupler)
)
"""Classes of elements that the writer of MJCF writes."""
_ALONE: Mapping[str, object] = {
    "locate_releases": False,
    "keep_limits": True,
    "preload": False,
    "moving_points": False,
    "free_substeps": 1,
    "scaled_units": False,
}
"""Options with which trebucheck takes no part in a run."""


def _has_points(mechanism: Mechanism) -> bool:
    return bool(mechanism.point_stops or mechanism.bound_by)


def _has_constraints(mechanism: Mechanism) -> bool:
    return has_stops(mechanism) or _has_points(mechanism)


class MujocoEngine(MujocoOptions, BuiltinEngine):
    """MuJoCo on the MJCF of :mod:`...models.mjcf.writer`; the defaults are the assisted preset.

    Stops are joint limits, which MuJoCo treats as soft. Stops on points are frictionless contacts
    of a sphere with a plane (a box on a body that moves), slots that close a loop are two of them,
    pins that do are `connect` equalities, angles that loops hold are equalities of tendons over
    hinges, and so are couplers. Springs and dampers are tendons, constant forces and torques
    actuators without control.

    By itself (:mod:`.alone`) MuJoCo steps this model from start to end. Its limits stay in the
    model whatever the law: it keeps to release-once only while no stop is met again, and an impact
    is that of a stiff, damped spring, spread over some steps; a stop with a restitution is refused.
    A stop is read as released at the end of the first step after which its limit has no torque.

    With assistance (:mod:`.motion`) a limit that releases, or is open, is taken out of the model;
    the releases are located inside their steps, impacts resolved at once, with the stop's
    restitution, through MuJoCo's mass matrix. A stop gives way by about 1e-10 rad at a step of
    1e-3 s, and by four times that at twice the step. MuJoCo leaves (dJ/dt) qvel out of contacts,
    and a stiff reference acceleration, scaled with the step, follows the errors of RK4's inner
    stages: both are corrected in `mjcb_control` (:mod:`.reference_acceleration`); points then give
    way by some 1e-9 m at 1e-3 s.

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
        "(convex optimisation)",
        features=built_features(BUILT),
        elements=BUILT,
    )
    default_options: ClassVar[Mapping[str, object] | None] = {
        **_ALONE,
        "timestep": 2e-3,
        "integrator": "Euler",
        "tolerance": 1e-8,
        "solref": (0.02, 1.0),
        "solimp": (0.9, 0.95, 0.001, 0.5, 2.0),
        "margin": 0.0,
    }
    settings_options: ClassVar[Mapping[str, object] | None] = _ALONE
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
        Assistance(
            Part.EVENTS,
            "locates releases inside a step",
            "locate_releases",
            off=False,
            acts_on=has_stops,
        ),
        Assistance(
            Part.IMPACTS,
            "takes open limits out of the model, and resolves impacts with the mass matrix",
            "keep_limits",
            off=True,
            acts_on=has_stops,
        ),
        Assistance(
            Part.START,
            "presses soft limits in, so that they start with their forces",
            "preload",
            off=False,
            acts_on=_has_constraints,
        ),
        Assistance(
            Part.CORRECTIONS,
            "changes the reference accelerations of contacts and equalities (`aref`)",
            "moving_points",
            off=False,
            acts_on=_has_points,
        ),
        Assistance(
            Part.SUBSTEPS,
            "takes several steps in the place of one while no stop holds",
            "free_substeps",
            off=1,
        ),
        scaled_units(),
    )

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Restitution, where limits stay in the model: they give back what their springs do."""
        return frozenset() if not self.keep_limits else frozenset({Basic.REBOUND})

    def _run(self, problem: Problem) -> Recording:
        # Imported here so that the class, its options and its documentation need no MuJoCo.
        if not self.assisted_by:
            from .alone import run_alone

            return run_alone(problem, self)
        from .motion import run

        return self.units(problem.mechanism).run(run, problem, self)

    def _script(self, problem: Problem) -> str:
        from .alone import script

        return script(problem, self)

    def view(self, mechanism: Mechanism) -> None:
        """Open MuJoCo's own viewer, and return when it is closed."""
        self.refuse_absence()
        from .build import view

        view(mechanism, self.timestep)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The built model in each state, its closed limits at rest."""
        self.refuse_absence()
        from .inspect import inspect

        return self.units(mechanism).inspect(inspect, mechanism, states, self)
