"""A mechanism as Newton's articulation: dynamics, readings and steps of `SolverFeatherstone`."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import newton
import numpy as np
import warp as wp
from trebucheck.models.arrays import FloatArray
from trebucheck.models.mechanism import Mechanism
from trebucheck_toolkit.event_driver import Observation
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.schemes import State

from .build import Built, JointSpring, turn_of


class NewtonTree:
    """The articulation at a present state, which is of single precision."""

    rounding = 1e-4
    """Noise of a limit's torque, relative to its largest term: speed rounding in 1 ms or less."""

    def __init__(
        self,
        mechanism: Mechanism,
        limits: dict[int, tuple[float, float]],
        frequency: float | None,
        timestep: float = 1e-3,
        springs: Mapping[int, JointSpring] = MappingProxyType({}),
        *,
        whole_joints: bool = False,
    ) -> None:
        """Build it, with the ranges of its coordinates and further arguments as :class:`Built`."""
        self.mechanism, self.timestep = mechanism, timestep
        self.built = Built(mechanism, limits, frequency, springs, whole_joints=whole_joints)
        self.model: Any = self.built.model
        self.now, self.next, self.control = (
            self.model.state(),
            self.model.state(),
            self.model.control(),
        )
        self.mass = self.model.body_mass.numpy().astype(float)
        self.inertia = self.model.body_inertia.numpy()[:, 2, 2].astype(float)
        self.solver: Any = None
        self.told: Any = None

    @property
    def coordinates(self) -> JointCoordinates:
        """Its joint coordinates."""
        return self.built.coordinates

    # --- Dynamics
    # ---------------------------------------------------------------------------------------------

    def mass_matrix(self, j: FloatArray) -> FloatArray:
        """Mass matrix by `eval_mass_matrix`."""
        self.place(j, np.zeros_like(j))
        return newton.eval_mass_matrix(self.model, self.now).numpy()[0].astype(float)

    def bias(self, j: FloatArray, v: FloatArray) -> FloatArray:
        """Bias forces by `eval_inverse_dynamics_passive`."""
        self.place(j, v)
        motion, gravity = (wp.zeros(len(j), dtype=wp.float32, device="cpu") for _ in range(2))
        newton.eval_inverse_dynamics_passive(
            self.model, self.now, coriolis_force=motion, gravity_force=gravity
        )
        return motion.numpy().astype(float) + gravity.numpy().astype(float)

    def total_mass(self) -> float:
        """Mass of all bodies [kg], without the carriers of slides."""
        return float(sum(self.mass[self.built.bodies[body.name]] for body in self.mechanism.bodies))

    def centres(self, j: FloatArray) -> dict[str, FloatArray]:
        """Centre of mass of each body in the world [m]."""
        self.place(j, np.zeros_like(j))
        poses, local = (
            self.now.body_q.numpy().astype(float),
            self.model.body_com.numpy().astype(float),
        )
        places = {body.name: self.built.bodies[body.name] for body in self.mechanism.bodies}
        return {
            name: poses[k][:2] + turn_of(poses[k][3:]) @ local[k][:2] for name, k in places.items()
        }

    # --- Steps
    # ---------------------------------------------------------------------------------------------

    def place(self, j: FloatArray, v: FloatArray) -> None:
        """Set the state."""
        self.now.joint_q.assign(j.astype(np.float32))
        self.now.joint_qd.assign(v.astype(np.float32))
        newton.eval_fk(self.model, self.now.joint_q, self.now.joint_qd, self.now)

    def limit(self, index: int, low: float, high: float) -> None:
        """Set the range of a joint coordinate."""
        for ends, value in (
            (self.model.joint_limit_lower, low),
            (self.model.joint_limit_upper, high),
        ):
            numbers = ends.numpy()
            numbers[index] = np.clip(value, -1e6, 1e6)
            ends.assign(numbers)

    def state(self) -> State:
        """The present state."""
        j, v = (array.numpy().astype(float) for array in (self.now.joint_q, self.now.joint_qd))
        return j, v

    def solve_by(self, solver: Any, *told: str) -> None:
        """Take a solver, and observe what it tells beyond the state."""
        self.solver, self.told = solver, solver.observables({"body_parent_f", *told})

    def step(self, forces: FloatArray) -> Mapping[str, FloatArray]:
        """Take one step; reactions are Newton's joint wrenches, force first, in world axes."""
        if self.solver is None:
            self.solve_by(newton.solvers.SolverFeatherstone(self.model, angular_damping=0.0))
        self.control.joint_f.assign(forces.astype(np.float32))
        self.now.clear_forces()
        self.solver.step(
            self.now, self.next, self.control, None, self.timestep, observables=self.told
        )
        self.now, self.next = self.next, self.now
        told = self.wrenches()
        return {
            joint.name: told[self.built.bodies[joint.child]][:2]
            for joint in self.mechanism.tree_joints
        }

    def wrenches(self) -> FloatArray:
        """Force and moment about its centre of mass on each body by its joint, in the last step."""
        return self.told.body_parent_f.numpy().astype(float)

    # --- What it shows
    # ---------------------------------------------------------------------------------------------

    def observe(self, j: FloatArray, v: FloatArray, a: FloatArray) -> Observation:
        """Readings of Newton's bodies in a state; only steps report reactions."""
        self.place(j, v)
        return self.look()

    def look(self) -> Observation:
        """The same in the present state."""
        poses, speeds = (
            array.numpy().astype(float) for array in (self.now.body_q, self.now.body_qd)
        )
        gravity, kinetic, potential = np.array(self.mechanism.gravity_vector), 0.0, 0.0
        for body in self.mechanism.bodies:
            k = self.built.bodies[body.name]
            centre = poses[k][:2] + turn_of(poses[k][3:]) @ body.centre
            kinetic += 0.5 * (
                self.mass[k] * float(speeds[k][:2] @ speeds[k][:2])
                + self.inertia[k] * speeds[k][5] ** 2
            )
            potential -= self.mass[k] * float(gravity @ centre)
        points: dict[str, tuple[FloatArray, FloatArray]] = {}
        for marker in self.mechanism.markers:
            k = self.built.bodies[marker.body]
            turn, centre = turn_of(poses[k][3:]), np.array(self.mechanism.body(marker.body).centre)
            x, y = turn @ (np.array(marker.point) - centre)
            speed = speeds[k][:2] + speeds[k][5] * np.array([-y, x])
            points[marker.name] = poses[k][:2] + turn @ np.array(marker.point), speed
        return Observation(points, kinetic, potential)
