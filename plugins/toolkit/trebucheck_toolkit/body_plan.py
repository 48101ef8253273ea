"""An engine of bodies in Python whose run is one program, whatever the preset.

The counterpart of :class:`.NodeEngine` for engines that Python calls: a package has a subclass of
:class:`BodyEngine`, one of :class:`BodyPlan`, and the template `templates/alone.py.j2`. See
:mod:`.body_program` for the functions of a program.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from trebucheck.engines.point_masses import spread_masses
from trebucheck.engines.protocol import BuiltinEngine, Recording
from trebucheck.engines.supplied import Assistance, Part, Supplied
from trebucheck.models.problem import Problem, StopLaw

from .alone import BodySteps
from .body_program import UprightScene, apart, body_program, run_program, scene_states
from .gap_releases import OPENING
from .kept_limits import LIMITS_TAKEN_OUT, KeepLimits
from .node_scene import MIRROR, NodeScene, joint_limits, lawful_stops


class BodyPlan:
    """A problem's program, by the template `alone.py.j2` of the subclass's package.

    Its `step()` returns x and y of the force of each of the scene's joints on its child [N], and
    after them the torque on the child of the limits of each joint in `ranges` [N m].

    Args:
        problem: what is moved.
        options: those of the engine, `timestep` and `keep_limits` among them.
        as_described: whether point masses are left without inertia, as they are only read back.

    Raises:
        UnsupportedProblemError: the mechanism has a part that the program builds no element for.
    """

    engine: ClassVar[str]
    widest: ClassVar[float]
    """Angle of a limit that stands for none [rad]."""
    within_half_a_turn: ClassVar[bool] = False
    """Whether the engine knows the angle of a limit within half a turn only."""
    slop: ClassVar[float] = OPENING
    """Angle by which limits may give way without being open [rad]."""
    at_end: ClassVar[bool] = False
    """Whether a step's forces are those at its end."""
    survives_forks: ClassVar[bool] = True
    """Whether forks of a process that has run the engine can; else a run has its own process."""

    def __init__(self, problem: Problem, options: Any, *, as_described: bool = False) -> None:
        self.problem, self.options = problem, options
        self.spread = spread_masses(problem.mechanism, None, self.engine)
        built = problem.mechanism if as_described else self.spread.mechanism
        self.scene = NodeScene(built, self.engine)
        self.frames, self.joints = UprightScene(self.scene), self.scene.joints
        self.stops = {stop.name: self.scene.stop(stop) for stop in lawful_stops(problem)}
        limits = joint_limits(problem, self.scene, within_half_a_turn=self.within_half_a_turn)
        self.ranges = {
            joint: (-self.widest if high is None else -high, self.widest if low is None else -low)
            for joint, (low, high) in limits.items()
        }
        """Least and greatest angle of each joint with stops, by its index, anticlockwise [rad]."""
        self.drops = problem.stop_law is StopLaw.RELEASE_ONCE and not options.keep_limits
        """Whether a limit is taken out where it has let go for good."""

    def values(self) -> dict[str, Any]:
        """Further values of the template, which has the plan as `plan`."""
        return {}

    def program(self) -> str:
        """The program of the run."""
        module, step = type(self).__module__, self.options.timestep
        return body_program(module, self.frames, self.problem, step, plan=self, **self.values())

    def run(self) -> Recording:
        """Step the engine from the start to the problem's end or just beyond, and read its bodies.

        Raises:
            SimulationError: the run's own process ended by itself.
        """
        program = self.program()
        found = run_program(program) if self.survives_forks else apart(run_program, program)
        forces, limits = np.split(found["told"], [2 * len(self.joints)], axis=1)
        torques = dict(zip(self.ranges, limits.T, strict=True))
        return BodySteps(
            self.problem,
            self.scene,
            self.spread,
            found["t"],
            scene_states(self.frames, self.scene, found["states"]),
            forces=forces.reshape(len(forces), len(self.joints), 2) * MIRROR,
            torques={
                name: np.maximum(0.0, -stop["side"] * torques[stop["joint"]])
                for name, stop in self.stops.items()
            },
            slop=self.slop,
            at_end=self.at_end,
        ).recording(found["q"], found["u"])


class BodyEngine(BuiltinEngine):
    """An engine of bodies; the subclass says how its program is planned."""

    settings_options: ClassVar[Mapping[str, object] | None] = {"keep_limits": True}
    assistance: ClassVar[tuple[Assistance, ...] | None] = (LIMITS_TAKEN_OUT,)
    readings: ClassVar[Supplied] = {Part.ELEMENTS: "as forces given before each step"}

    keep_limits: KeepLimits = False

    def plan(self, problem: Problem) -> BodyPlan:
        """Plan a run; the module of the plan need not be imported before.

        Raises:
            UnsupportedProblemError: the mechanism has a part that the program does not build.
        """
        raise NotImplementedError

    def _run(self, problem: Problem) -> Recording:
        return self.plan(problem).run()

    def _script(self, problem: Problem) -> str:
        return self.plan(problem).program()
