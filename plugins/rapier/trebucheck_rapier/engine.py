"""Rapier 2D: Cartesian bodies, joints and limits by impulses in substeps, single precision."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from trebucheck.engines.point_masses import spread_masses, spreads_masses
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import Assistance, Part, Supplied
from trebucheck.models.elements import SlotJoint
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck_toolkit.gap_releases import OPENING, releases
from trebucheck_toolkit.node_samples import NodeSamples, sample_times
from trebucheck_toolkit.node_scene import joint_limits

from .alone import run_alone, script
from .bridge import RAPIER
from .build import Built
from .options import OWN, RapierOptions
from .study import STUDY

_ALONE: Mapping[str, object] = {
    "least_inertia": None,
    "carriage": None,
    "move_limits": False,
    "opening": None,
    "fit_steps": False,
}
"""Options with which trebucheck takes no part in a run."""


def _has_stops(mechanism: Mechanism) -> bool:
    return bool(mechanism.stops)


def _has_slots(mechanism: Mechanism) -> bool:
    return any(isinstance(joint, SlotJoint) for joint in mechanism.joints)


class RapierEngine(RapierOptions, BuiltinEngine):
    """Rapier's world with impulse joints in Node.js.

    Its multibody joints are no choice: they have a damping of their own, which its interface cannot
    take out.

    By itself (:mod:`.alone`) limits are set once, and bodies are those of the mechanism; point
    masses, which Rapier would never turn, have an inertia by mass moved along their pins. With
    assistance limits are moved to where Rapier knows their angles and go with their stops, slots
    have carriages, and every body has some inertia. With every preset springs, dampers and motors
    are forces and torques that are given to the bodies before each step.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "rapier"
    package: ClassVar[str] = "trebucheck-rapier"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=False,
        joint_gaps=True,
        stop_torques=False,
        located_releases=False,
        stop_laws=frozenset(StopLaw),
        formulation="Cartesian coordinates in single precision, joints and limits by impulses in "
        "substeps, semi-implicit Euler",
        lacking=frozenset({Basic.POINT_STOP, Basic.REBOUND}),
        features=frozenset(Feature) - {Feature.MOVING_WALL},
    )
    default_options: ClassVar[Mapping[str, object] | None] = {
        **_ALONE,
        **OWN,
        "allow_sleep": True,
    }
    settings_options: ClassVar[Mapping[str, object] | None] = {**_ALONE, "timestep": 2.5e-4}
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
        Assistance(
            Part.MODEL,
            "moves mass along pins to bodies of little inertia",
            "least_inertia",
            off=None,
            acts_on=spreads_masses,
        ),
        Assistance(
            Part.MODEL,
            "runs a small body in each slot, which the other one is pinned to",
            "carriage",
            off=None,
            acts_on=_has_slots,
        ),
        Assistance(
            Part.MODEL,
            "turns the frames of a joint to its nearest stop, and has its limit on near to it",
            "move_limits",
            off=False,
            acts_on=_has_stops,
        ),
        Assistance(
            Part.EVENTS,
            "takes the limits of stops that are open for good out of the model",
            "opening",
            off=None,
            acts_on=_has_stops,
        ),
        Assistance(
            Part.SUBSTEPS,
            "shortens the steps, so that a whole number of them fits",
            "fit_steps",
            off=False,
        ),
    )
    readings: ClassVar[Supplied] = {Part.ELEMENTS: "as forces given before each step"}

    @property
    def lacking(self) -> frozenset[Basic | Feature]:
        """Slots, where they have no carriages."""
        slots = frozenset[Basic | Feature]({Basic.SLOT, Feature.MOVING_SLOT})
        return slots if self.carriage is None else frozenset()

    @classmethod
    def is_installed(cls) -> bool:
        """Tell whether Node.js is on the path and Rapier beside this package."""
        return RAPIER.is_installed()

    @classmethod
    def version(cls) -> str:
        """Version of Rapier's npm package; 'not installed' if there is none."""
        return RAPIER.version()

    @classmethod
    def absence(cls) -> str:
        """Missing program or package and how to install it, in one sentence."""
        return RAPIER.absence()

    def _run(self, problem: Problem) -> Recording:
        if not self.assisted_by:
            return run_alone(problem, self)
        spread = spread_masses(problem.mechanism, self.least_inertia, self.name)
        built = Built(spread.mechanism, self.carriage)
        t = sample_times(problem.duration, self.timestep, fit=self.fit_steps)
        step = problem.duration / (len(t) - 1) if self.fit_steps else self.timestep
        if not self.move_limits:  # those that cannot be set once are refused
            joint_limits(problem, built, within_half_a_turn=True)
        scene = built.description(problem, step, len(t) - 1) | {
            "substeps": self.substeps,
            "passes": self.passes,
            "canSleep": self.allow_sleep,
            "moveLimits": self.move_limits,
            "opening": self.opening or 0.0,
        }
        scene["once"] = scene["once"] and self.opening is not None
        samples = NodeSamples(built, t, RAPIER.move(scene))
        found = samples.recording()
        potential = found.potential_energy - spread.extra_potential_energy
        times = releases(samples, self.opening or OPENING)
        return replace(found, potential_energy=potential, release_times=times)

    def _script(self, problem: Problem) -> str:
        return script(problem, self)
