"""Brax by itself: a run is the program that :class:`Plan` writes, executed here.

Its model is the MJCF of trebucheck's writer, to which the program adds what Brax needs. Brax's
pipelines have no tendons, no forces on bodies, and two of them no springs of joints; what all have
are motors. So the forces of elements are the motors' controls, computed before each step.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from trebucheck.engines.inspection import Dynamics, Inspection, State
from trebucheck.engines.mujoco.options import MujocoOptions
from trebucheck.engines.point_masses import spread_masses
from trebucheck.engines.presets import DEFAULT
from trebucheck.engines.protocol import Recording
from trebucheck.engines.reading import timed_reading
from trebucheck.models.elements import GROUND
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.problem import Problem
from trebucheck_toolkit.alone import BodySteps
from trebucheck_toolkit.body_program import UprightScene, load_lines, scene_states
from trebucheck_toolkit.constrained import held_still
from trebucheck_toolkit.jax_on_cpu import keep_compiled, without_words_on_warp
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.joint_tree import JointLimits
from trebucheck_toolkit.mujoco_models import program
from trebucheck_toolkit.node_scene import NodeScene, lawful_stops


class Plan:
    """Parts of a problem that Brax is given; all stops are limits, for the whole run.

    Raises:
        UnsupportedProblemError: the mechanism has a part that the adapter builds no element for.
    """

    def __init__(self, problem: Problem, options: Any) -> None:
        self.problem, self.options = problem, options
        self.spread = spread_masses(problem.mechanism, None, "brax")
        self.scene = NodeScene(self.spread.mechanism, "brax")
        self.frames = UprightScene(self.scene)
        stops = {"stops": tuple(lawful_stops(problem))}
        self.mechanism = self.spread.mechanism.model_copy(update=stops)
        self.coordinates = JointCoordinates(self.mechanism)
        self.kinematics = Kinematics(self.mechanism)
        self.places = JointLimits(self.coordinates, "brax").places
        self.names = [GROUND, *(body.name for body, _ in self.coordinates.links)]
        """Bodies in MuJoCo's order."""

    def program(self) -> str:
        """The program of the run."""
        options, mechanism = self.options, self.mechanism.model_copy(update={"force_elements": ()})
        text = program(
            __name__,
            self.problem.model_copy(update={"mechanism": mechanism}),
            MujocoOptions(
                timestep=options.timestep,
                integrator="Euler",
                tolerance=1e-8,
                margin=0.0,
                iterations=options.solver_iterations,
                solref=options.solref or (8 * options.timestep, 1.0),
                solimp=options.solimp,
            ),
            plan=self,
            own=type(options).presets()[DEFAULT](),
            angles=[self.kinematics.angle(name).coefficients.tolist() for name in self.names],
            loads=load_lines(self.frames, self.mechanism),
        )
        if "<tendon>" in text:
            raise UnsupportedProblemError("Brax has no limits of tendons, for clamped joints.")
        return text

    def executed(self) -> dict[str, Any]:
        """Names of the program, after its run."""
        found: dict[str, Any] = {}
        with without_words_on_warp():
            keep_compiled()
            exec(self.program(), found)
        return found

    def run(self) -> Recording:
        """Step Brax from the start to the problem's end or just beyond, and read its links."""
        found, torques = self.executed(), None
        with timed_reading():
            if self.options.capabilities.stop_torques:
                told = found["UNIT"] * np.array(found["limit_forces"], dtype=np.float64)
                torques = {
                    name: np.maximum(0.0, sense * told[:, index])
                    for name, (index, sense) in self.places.items()
                }
            order = [self.names.index(body.name) for body in self.mechanism.bodies]
            states = scene_states(self.frames, self.scene, found["states"][:, order])
            steps = BodySteps(
                self.problem, self.scene, self.spread, found["t"], states, torques=torques
            )
            return steps.recording(found["q"], found["u"])

    def inspect(self, states: Sequence[State]) -> Inspection:
        """Mass matrix and forces of `generalized`; accelerations follow, closed stops at rest."""
        found, to = self.executed(), self.coordinates
        start = to.positions(np.array(self.mechanism.start))

        @found["jax"].jit
        def look(q: Any, qd: Any) -> tuple[Any, Any]:
            state = found["pipeline"].init(found["system"], q, qd)
            return state.mass_mx, found["step"](state, None)[0].qf_smooth

        def seen(state: State) -> Dynamics:
            told = look(to.positions(state.q) - start, to.speeds(state.u))
            of_joints = [found["UNIT"] * np.asarray(each) for each in told]
            mass, forces = to.mass_matrix(of_joints[0]), np.linalg.solve(to.sums.T, of_joints[1])
            gaps = [self.kinematics.gap_jacobian(name, state.q) for name in state.closed]
            rows = np.reshape(gaps, (-1, len(forces)))
            accelerations, pushes = held_still(np.linalg.solve(mass, forces), mass, rows)
            torques = dict(zip(state.closed, pushes.tolist(), strict=True))
            return Dynamics(accelerations, torques, mass, forces)

        return Inspection(found["q"][0], found["u"][0], tuple(map(seen, states)))
