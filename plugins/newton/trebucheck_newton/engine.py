"""Newton: articulations by MuJoCo's solver or its own Featherstone, state in single precision."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.protocol import BuiltinEngine, Capabilities, Recording
from trebucheck.engines.study import EngineStudy
from trebucheck.engines.supplied import LIMITED, Part, Supplied
from trebucheck.models.features import Basic, Feature
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import Positive
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.joint_tree import JointLimits, LimitedMotion, TreeMotion
from trebucheck_toolkit.plain_run import OwnStops, plain_run

from .study import STUDY

if TYPE_CHECKING:
    from .tree import NewtonTree


class NewtonEngine(BuiltinEngine):
    """An articulation of Newton's; the defaults are the assisted preset.

    Assisted, it is moved by `SolverMuJoCo` on the processor, by RK4. The default preset is
    `SolverFeatherstone`.

    Raises:
        InputError: an option is unknown or outside its range.
    """

    name: ClassVar[str] = "newton"
    package: ClassVar[str] = "newton"
    tables: ClassVar[EngineStudy] = STUDY
    capabilities: ClassVar[Capabilities] = Capabilities(
        joint_reactions=True,
        joint_gaps=False,
        located_releases=False,
        stop_laws=frozenset({StopLaw.RELEASE_ONCE}),
        formulation="minimal relative joints, state in single precision; MuJoCo's RK4, limits as "
        "soft constraints (default: Featherstone's algorithm by semi-implicit Euler, limits as "
        "springs and dampers)",
        features=frozenset(Feature) - {Feature.MOVING_WALL},
        lacking=frozenset({Basic.LOOP, Basic.POINT_STOP, Basic.REBOUND}),
    )
    default_options: ClassVar[Mapping[str, object] | None] = {"solver": "featherstone"}

    solver: Literal["mujoco", "featherstone"] = Field(
        default="mujoco", description="Newton's solver"
    )
    limit_frequency: Positive = Field(
        default=100.0,
        description="of a joint's limit, critically damped for its body alone [rad/s]",
    )

    @property
    def supplied(self) -> Supplied:
        """Assistance: springs and motors are joint forces; Featherstone has no limit torques."""
        return LIMITED if self.solver == "featherstone" else {Part.ELEMENTS: ""}

    def _run(self, problem: Problem) -> Recording:
        _quieten()
        from .motion import Motion

        tree = self._tree(problem.mechanism)
        if self.solver == "mujoco":
            motion: OwnStops = Motion(problem, tree)
        else:
            solver = "newton's SolverFeatherstone"
            motion = LimitedMotion(problem, tree, self.timestep, solver, tree.rounding, soft=True)
        return plain_run(problem, motion, self.name, self.timestep)

    def _tree(self, mechanism: Mechanism) -> NewtonTree:
        from .tree import NewtonTree

        limits = JointLimits(JointCoordinates(mechanism), "newton")
        closed = [stop.name for stop in mechanism.stops if stop.closed]
        return NewtonTree(mechanism, limits.ranges(closed), self.limit_frequency, self.timestep)

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Mass matrix, forces and accelerations of the articulation, in single precision."""
        self.refuse_absence()
        _quieten()
        found = TreeMotion(self._tree(mechanism)).inspect(states)
        return replace(found, roundoff=float(np.finfo(np.float32).eps / 2))


def _quieten() -> None:
    import warp

    warp.config.log_level = warp.LOG_ERROR  # it would tell of each kernel on the standard output
