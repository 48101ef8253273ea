"""Pinocchio: forward and inverse dynamics of a joint tree, without time steps or stops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import MOVED, Supplied
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.features import Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck_toolkit.event_driver import EventDriver
from trebucheck_toolkit.given_forces import GIVEN

from .study import STUDY


class PinocchioEngine(BuiltinEngine):
    """Pinocchio's forward dynamics in a time-stepping scheme; defaults are the assisted preset.

    Accelerations are those of `aba`, the mass matrix that of `crba`, energies and points
    Pinocchio's, reactions the joint forces of `rnea` at the accelerations found. Stops and joints
    that close loops are held by constraint multipliers on these quantities; springs, dampers and
    motors are joint torques.

    Pinocchio has no time steps, so that there is no preset of Pinocchio alone, and no program. A
    run speaks for its dynamics. With `scheme="semi-implicit Euler", locate_releases=False` it is
    the loop of Pinocchio's examples, `v += a h; q = integrate(q, v h)`, a stop let go at the end of
    the first step after which it would pull.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "pinocchio"
    package: ClassVar[str] = "pin"
    module: ClassVar[str | None] = "pinocchio"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=True,
        stop_laws=frozenset(StopLaw),
        formulation="minimal relative joints (articulated-body algorithm), stops and loops by "
        "multipliers, RK4 of trebucheck (or semi-implicit Euler)",
        features=frozenset(Feature),
        elements=GIVEN,
    )

    scheme: Literal["RK4", "semi-implicit Euler"] = Field(
        default="RK4", description="time-stepping scheme, in joint coordinates"
    )
    locate_releases: bool = Field(
        default=True, description="find a release inside its step, not at its end"
    )

    @property
    def supplied(self) -> Supplied:
        """Pinocchio has neither steps nor stops; what it gives is dynamics."""
        return MOVED

    def _run(self, problem: Problem) -> Recording:
        from .motion import Motion

        motion = Motion(problem.mechanism, self.scheme)
        return EventDriver(problem, motion, self.name, self.timestep, self.locate_releases).run()

    def _script(self, problem: Problem) -> str:
        raise UnsupportedProblemError(
            "Pinocchio computes dynamics and has no time steps: those of each run are "
            "trebucheck's, so that no run is a program of Pinocchio alone."
        )

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """The built model's mass matrix, forces and forward dynamics in each state."""
        self.refuse_absence()
        from .inspect import inspect

        return inspect(mechanism, states)
