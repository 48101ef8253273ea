"""A mechanism as Box2D moves it, and what it shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from trebucheck.engines.point_masses import spread_masses
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.problem import Problem, StopLaw
from trebucheck_toolkit.event_driver import Observation
from trebucheck_toolkit.node_scene import lawful_stops
from trebucheck_toolkit.plain_run import StepAhead
from trebucheck_toolkit.schemes import State

from .build import Built, Plan
from .loads import forces, torques
from .options import Box2DOptions
from .read import Reader


class Motion(StepAhead):
    """The world of a mechanism, stepped."""

    def __init__(self, problem: Problem, options: Box2DOptions) -> None:
        self.mechanism, self.timestep, self.options = problem.mechanism, options.timestep, options
        self.once = problem.stop_law is StopLaw.RELEASE_ONCE and not options.keep_limits
        self.spread = spread_masses(problem.mechanism, options.least_inertia, "box2d")
        plan = Plan(
            self.spread.mechanism,
            lawful_stops(problem),
            set_back=options.set_back,
            allow_sleep=options.allow_sleep,
        )
        self.built = Built(plan)
        self.applied = AppliedForces(Kinematics(problem.mechanism))
        self.limits = plan.limits
        self.reader = Reader(self.built)
        self.step()

    def _show_and_step(self) -> tuple[State, Mapping[str, float], Observation]:
        state, seen = self.reader.state(), self.reader.look()
        before = self._velocities()
        self._apply()
        self.built.world.Step(
            self.timestep, self.options.velocity_iterations, self.options.position_iterations
        )
        rate = 1.0 / self.timestep
        reactions = {
            name: self.spread.reaction(
                name,
                np.array(self.built.joints[name].GetReactionForce(rate)),
                (velocity - before[name]) * rate,
            )
            for name, velocity in self._velocities().items()
        }
        contacts = {
            name: max(
                0.0, limit.sense * float(self.built.pins[limit.index].GetReactionTorque(rate))
            )
            for name, limit in self.limits.items()
        }
        if self.once:
            self.limits = {
                name: limit for name, limit in self.limits.items() if contacts[name] > 0.0
            }
            self._set_limits()
        spring = float(self.applied.potential_energy(state[0]))
        potential = seen.potential_energy - self.spread.extra_potential_energy + spring
        return state, contacts, replace(seen, potential_energy=potential, reactions=reactions)

    def _velocities(self) -> dict[str, FloatArray]:
        """Velocities of the joints' points, by joint names [m/s]."""
        joints = [joint for joint in self.mechanism.joints if joint.name in self.built.joints]
        return {
            joint.name: self.reader.point(joint.child, joint.child_point)[1] for joint in joints
        }

    # --- Limits and forces
    # -------------------------------------------------------------------------------------------

    def _set_limits(self) -> None:
        """Set the ranges of the joints; a limit that is gone leaves none."""
        ranges = Plan.ranges(self.limits.values())
        for index, joint in enumerate(self.built.pins):
            limited = index in ranges
            if limited:
                joint.SetLimits(*ranges[index])
            if joint.limitEnabled != limited:
                joint.limitEnabled = limited

    def _apply(self) -> None:
        """Springs, dampers and motors of the step."""
        bodies, reader = self.built.bodies, self.reader
        for element in self.mechanism.force_elements:
            for name, at, force in forces(element, reader.point):
                bodies[name].ApplyForce(force.tolist(), at.tolist(), True)
            for name, torque in torques(
                element, lambda name: (-reader.angle(name), -reader.turning(name))
            ):
                bodies[name].ApplyTorque(-torque, True)
