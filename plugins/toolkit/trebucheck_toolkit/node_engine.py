"""An engine of npm whose run is one program for Node.js, whatever the preset.

Its package has `package.json` in a folder `node`, the template `templates/alone.mjs.j2`, and a
subclass of :class:`NodeEngine`; `trebucheck plugin new --node` writes the three. See
:mod:`.node_program` for the functions of a template. What :class:`NodeEngine` gives it besides:

- `options`: the engine with its options, as fields;
- `problem`; `scene`, `names`: bodies as :class:`.NodeScene` has them, and their names;
- `joints`: of each its `kind`: "pin"; "slide", which holds the angle of `b` to that of `a` and its
  point to a line of `a`; "slot", which holds the point alone; or "weld". The names of its bodies,
  `a` and `b`, one of which may be "ground"; `pointA` and `pointB` of each [m]; the line's direction
  `axis` where it has one; and `limits`, the least and greatest angle of `b` less that of `a` [rad],
  each a number or None, or None of joints without limits;
- `limited`: indices of the joints with limits;
- `stops`: those that the law has, each with its `joint`, its `angle` from the start [rad], its
  `side`, 1 where that is the least angle and -1 where it is the greatest, and whether it is
  `closed`;
- `gravity`: of the scene [m/s^2];
- `moves_mass`: whether point masses have some inertia by mass moved along their pins;
- what :meth:`NodeEngine._values` of the subclass returns.

Where the capabilities have `joint_reactions`, its `step()` returns x and y of the force of each
joint on `b` [N], and after them, where they have `stop_torques`, the torque on `b` of the limits of
each joint in `limited` [N m]. Its `built()` returns what the world holds, for the model check: the
numbers of bodies, joints and gravity that :func:`.node_inspect.inspected` takes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from pydantic import Field
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.point_masses import (
    LeastInertia,
    NoPointMasses,
    spread_masses,
    spreads_masses,
)
from trebucheck.engines.protocol import BuiltinEngine, Recording
from trebucheck.engines.supplied import Assistance, Part, Supplied
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem

from .alone import BodySteps
from .gap_releases import OPENING
from .node_inspect import inspected
from .node_package import NodePackage
from .node_program import node_program
from .node_samples import NodeSamples, sample_times
from .node_scene import MIRROR, Json, NodeScene, joint_limits, lawful_stops

ALONE: Mapping[str, object] = {"least_inertia": None, "fit_steps": False}
"""Options with which trebucheck takes no part in a run."""


class NodeEngine(BuiltinEngine):
    """An engine of npm, with what trebucheck can do for any of them."""

    least_inertia: LeastInertia = 1e-3
    fit_steps: bool = Field(
        default=True,
        description="shorten the steps, so that a whole number of them makes the duration",
    )

    npm: ClassVar[NodePackage]
    within_half_a_turn: ClassVar[bool] = False
    """Whether the engine knows the angle of a limit within half a turn only."""
    slop: ClassVar[float] = OPENING
    """Angle by which limits may give way without being open [rad]."""
    assistance: ClassVar[tuple[Assistance, ...] | None] = (
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
        """Tell whether Node.js is on the path and the package of npm beside the plug-in."""
        return cls.npm.is_installed()

    @classmethod
    def version(cls) -> str:
        """Version of the package of npm; 'not installed' if there is none."""
        return cls.npm.version()

    @classmethod
    def absence(cls) -> str:
        """Missing program or package and how to install it, in one sentence."""
        return cls.npm.absence()

    @property
    def roundoff(self) -> float:
        """Unit roundoff of the numbers that the world holds, for the model check."""
        return 2.0**-24 if self.tables.single_precision(self.settings) else 2.0**-53

    @property
    def release_gap(self) -> float | None:
        """Gap from which releases are looked back for [rad]; None: torques tell them, if any do."""
        return None

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        """Inspect the built world in each state, without masses moved along pins for the motion."""
        self.refuse_absence()
        # Neither duration nor steps play a part in what is read back, nor do stops.
        problem = Problem.model_construct(
            mechanism=mechanism.model_copy(update={"stops": ()}), duration=0.0
        )
        spread, scene = NoPointMasses(mechanism, 1e-3, points_only=True), self._scene(mechanism)
        arrays = self.npm.arrays(self._program(problem, spread, scene, binary=True, tells=True))
        samples = NodeSamples(scene, arrays["t"], arrays["states"])
        return inspected(samples, arrays["built"], states, self.roundoff)

    def _scene(self, mechanism: Mechanism) -> NodeScene:
        """Scene of a mechanism whose bodies have inertia; engines may have their own."""
        return NodeScene(mechanism, self.name)

    def _values(self, scene: NodeScene) -> Mapping[str, Any]:
        """Further values of the template."""
        del scene
        return {}

    def _run(self, problem: Problem) -> Recording:
        spread, scene = self._spread_scene(problem)
        arrays = self.npm.arrays(self._program(problem, spread, scene, binary=True))
        able, steps = self.capabilities, len(arrays["t"]) - 1
        told = arrays["told"].reshape(steps, -1)
        forces, torques = np.split(told, [2 * len(scene.joints) * able.joint_reactions], axis=1)
        taken = BodySteps(
            problem,
            scene,
            spread,
            arrays["t"],
            arrays["states"],
            forces=forces.reshape(steps, -1, 2) if able.joint_reactions else None,
            torques=self._torques(problem, scene, torques) if able.stop_torques else None,
            slop=self.slop,
            opening=self.release_gap,
        )
        return taken.recording(arrays["q"], arrays["u"])

    def _script(self, problem: Problem) -> str:
        return self._program(problem, *self._spread_scene(problem))

    def _spread_scene(self, problem: Problem) -> tuple[NoPointMasses, NodeScene]:
        spread = spread_masses(problem.mechanism, self.least_inertia, self.name)
        return spread, self._scene(spread.mechanism)

    def _torques(
        self, problem: Problem, scene: NodeScene, told: FloatArray
    ) -> Mapping[str, FloatArray]:
        """Torque of each stop, of what was told of the limited joints, (steps, joints) [N m]."""
        limits, torques = self._limits(problem, scene), dict[str, FloatArray]()
        for stop in lawful_stops(problem):
            made = scene.stop(stop)
            low, high = limits[made["joint"]]
            nearest = made["angle"] == (low if made["side"] > 0 else high)
            torque = told[:, [*limits].index(made["joint"])]
            torques[stop.name] = nearest * np.maximum(0.0, made["side"] * torque)
        return torques

    def _limits(
        self, problem: Problem, scene: NodeScene
    ) -> dict[int, tuple[float | None, float | None]]:
        return joint_limits(problem, scene, within_half_a_turn=self.within_half_a_turn)

    def _program(
        self,
        problem: Problem,
        spread: NoPointMasses,
        scene: NodeScene,
        *,
        binary: bool = False,
        tells: bool = False,
    ) -> str:
        step = self.timestep
        if self.fit_steps and problem.duration:
            step = problem.duration / (len(sample_times(problem.duration, step, fit=True)) - 1)
        limits = self._limits(problem, scene)
        names = {-1: GROUND, **dict(enumerate(scene.names))}
        joints: list[Json] = [
            {
                "axis": None,
                **joint,
                "a": names[joint["a"]],
                "b": names[joint["b"]],
                "limits": limits.get(index),
            }
            for index, joint in enumerate(scene.joints)
        ]
        return node_program(
            type(self).__module__,
            scene,
            problem,
            step,
            binary=binary,
            tells=tells,
            options=self,
            gravity=np.array(scene.mechanism.gravity_vector) * MIRROR + 0.0,
            moves_mass=bool(spread.moved),
            joints=joints,
            limited=[*limits],
            stops=[scene.stop(stop) for stop in lawful_stops(problem)],
            **self._values(scene),
        )
