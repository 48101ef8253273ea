"""A mechanism as one of Newton's solvers moves it; the solver is a step ahead of what is shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import newton
import numpy as np
from trebucheck.engines.event_driver import Observation
from trebucheck.engines.joint_coordinates import JointCoordinates
from trebucheck.engines.joint_tree import JointLimits, refuse_loops, without_others
from trebucheck.engines.schemes import State
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.problem import Problem

from .build import Built, turn_of


class Motion:
    """A solver in its present state."""

    def __init__(self, problem: Problem, solver: str, timestep: float, frequency: float) -> None:
        mechanism = self.mechanism = problem.mechanism
        refuse_loops(mechanism, "newton's articulation")
        self.timestep, self.to = timestep, JointCoordinates(mechanism)
        self.limits = JointLimits(self.to, "newton")
        if solver == "featherstone" and mechanism.stops:
            raise UnsupportedProblemError("newton's SolverFeatherstone does not tell the torques of its joint limits.")
        names = [stop.name for stop in mechanism.stops if stop.closed]
        self.built = Built(mechanism, self.limits.ranges(names), frequency)
        self.applied = AppliedForces(Kinematics(mechanism))
        model: Any = self.built.model
        self.now, self.next, self.control = model.state(), model.state(), model.control()
        self.mass = model.body_mass.numpy().astype(float)
        self.inertia = model.body_inertia.numpy()[:, 2, 2].astype(float)
        if solver == "mujoco":
            self.solver: Any = newton.solvers.SolverMuJoCo(
                model, use_mujoco_cpu=True, integrator="rk4", disable_contacts=True, iterations=100, tolerance=0.0
            )
        else:
            self.solver = newton.solvers.SolverFeatherstone(model, angular_damping=0.0)
        kinds = {"body_parent_f"} | ({"qfrc_constraint"} if names else set())
        self.told: Any = self.solver.observables(kinds)
        q, u = initial_state(mechanism)
        self.now.joint_q.assign(self.to.positions(q).astype(np.float32))
        self.now.joint_qd.assign(self.to.speeds(u).astype(np.float32))
        newton.eval_fk(model, self.now.joint_q, self.now.joint_qd, self.now)
        self.waiting = set(names)
        self.step()

    def state(self) -> State:
        """The mechanism's coordinates and speeds."""
        return self._state

    def contacts(self) -> Mapping[str, float]:
        """Torque of each limit [N m]."""
        return self._contacts

    def observe(self) -> Observation:
        """What Newton shows."""
        return self._seen

    def step(self) -> None:
        """Show the present state, and take the step that begins there."""
        j, v = (array.numpy().astype(float) for array in (self.now.joint_q, self.now.joint_qd))
        q, u = self._state = self.to.mechanism_positions(j), self.to.mechanism_speeds(v)
        seen = self._look()
        self.control.joint_f.assign(self.to.forces(self.applied.generalized(q, u)).astype(np.float32))
        self.now.clear_forces()
        self.solver.step(self.now, self.next, self.control, None, self.timestep, observables=self.told)
        self.now, self.next = self.next, self.now
        seen = replace(seen, reactions=self._reactions())
        self._seen = without_others(seen, self.applied, (q, u), self.applied.on_bodies(q, u))
        self._contacts = self._torques()

    def _torques(self) -> dict[str, float]:
        if not self.waiting:
            return {}
        torques = np.ravel(self.told.qfrc_constraint.numpy())
        places = self.limits.places
        return {name: max(0.0, places[name][1] * float(torques[places[name][0]])) for name in self.waiting}

    def _reactions(self) -> dict[str, FloatArray]:
        """Newton's wrenches of the joints, force first, in the world's axes."""
        told = self.told.body_parent_f.numpy()
        return {
            joint.name: told[self.built.bodies[joint.child]][:2].astype(float) for joint in self.mechanism.tree_joints
        }

    def _look(self) -> Observation:
        poses, speeds = (array.numpy().astype(float) for array in (self.now.body_q, self.now.body_qd))
        gravity, kinetic, potential = np.array(self.mechanism.gravity_vector), 0.0, 0.0
        for body in self.mechanism.bodies:
            k = self.built.bodies[body.name]
            centre = poses[k][:2] + turn_of(poses[k][3:]) @ body.centre
            kinetic += 0.5 * (self.mass[k] * float(speeds[k][:2] @ speeds[k][:2]) + self.inertia[k] * speeds[k][5] ** 2)
            potential -= self.mass[k] * float(gravity @ centre)
        points: dict[str, tuple[FloatArray, FloatArray]] = {}
        for marker in self.mechanism.markers:
            k = self.built.bodies[marker.body]
            turn, centre = turn_of(poses[k][3:]), np.array(self.mechanism.body(marker.body).centre)
            x, y = turn @ (np.array(marker.point) - centre)
            speed = speeds[k][:2] + speeds[k][5] * np.array([-y, x])
            points[marker.name] = poses[k][:2] + turn @ np.array(marker.point), speed
        return Observation(points, kinetic, potential)
