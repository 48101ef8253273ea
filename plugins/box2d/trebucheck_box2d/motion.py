"""A mechanism as Box2D moves it, and what it shows; the world is a step ahead of what is shown.

Forces and torques at an instant are those of the step that begins there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from trebucheck.engines.event_driver import Observation
from trebucheck.engines.schemes import State
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.joints import GROUND, AnyJoint, FreeJoint
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.problem import Problem, StopLaw

from .build import Built, turned
from .loads import forces, torques

_WIDE = 1e6


class Options(Protocol):
    """The engine's options; see there."""

    timestep: float
    velocity_iterations: int
    position_iterations: int
    set_back: float
    least_inertia: float
    least_limited_inertia: float


class Motion:
    """The world of a mechanism, stepped."""

    def __init__(self, problem: Problem, options: Options) -> None:
        self.mechanism, self.timestep, self.options = problem.mechanism, options.timestep, options
        self.once = problem.stop_law is StopLaw.RELEASE_ONCE
        self.stops = {stop.name: stop for stop in problem.mechanism.stops if stop.closed or not self.once}
        self.built = Built(problem.mechanism, options.least_inertia, options.least_limited_inertia, self.stops)
        self.applied = AppliedForces(Kinematics(problem.mechanism))
        self.limits = {name: self.built.limited(stop) for name, stop in self.stops.items()}
        self._set_limits()
        self.step()

    def state(self) -> State:
        """The mechanism's coordinates and speeds."""
        return self._state

    def contacts(self) -> Mapping[str, float]:
        """Torque of each limit [N m], in the step that begins."""
        return self._contacts

    def observe(self) -> Observation:
        """What Box2D shows."""
        return self._seen

    def step(self) -> None:
        """Show the present state, and take the step that begins there."""
        self._state = self._read()
        seen = self._look()
        self._apply()
        self.built.world.Step(self.timestep, self.options.velocity_iterations, self.options.position_iterations)
        rate = 1.0 / self.timestep
        reactions = {name: np.array(joint.GetReactionForce(rate)) for name, joint in self.built.joints.items()}
        self._seen = Observation(seen.points, seen.kinetic_energy, seen.potential_energy, reactions, seen.gaps)
        torques = {name: sense * float(joint.GetReactionTorque(rate)) for name, (joint, sense) in self.limits.items()}
        self._contacts = {name: max(torque, 0.0) for name, torque in torques.items()}
        if self.once:
            self.limits = {name: limit for name, limit in self.limits.items() if self._contacts[name] > 0.0}
            self._set_limits()

    # --- Limits and forces -------------------------------------------------------------------------------------------

    def _set_limits(self) -> None:
        """Set the ranges of the joints; a limit that is gone leaves none."""
        ranges = {id(self.built.joints[joint.name]): [self.built.joints[joint.name], -_WIDE, _WIDE]
                  for joint in self.mechanism.joints if joint.kind == "pin"}  # fmt: skip
        for name, (joint, sense) in self.limits.items():
            limit = self.stops[name].position + self.options.set_back
            found = next(each for each in ranges.values() if each[0] == joint)
            found[1:] = [max(found[1], limit), found[2]] if sense > 0 else [found[1], min(found[2], -limit)]
        for joint, low, high in ranges.values():
            limited = low > -_WIDE or high < _WIDE
            if limited:
                joint.SetLimits(low, high)
            if joint.limitEnabled != limited:
                joint.limitEnabled = limited

    def _apply(self) -> None:
        """Springs, dampers and motors of the step."""
        bodies = self.built.bodies
        for element in self.mechanism.force_elements:
            for name, at, force in forces(element, self._point):
                bodies[name].ApplyForce(force.tolist(), at.tolist(), True)
            for name, torque in torques(element, lambda name: (-self._angle(name), -self._turning(name))):
                bodies[name].ApplyTorque(-torque, True)

    # --- What it shows -----------------------------------------------------------------------------------------------

    def _read(self) -> State:
        """Angles clockwise, slides along their axes from Box2D's points and their speeds."""
        q, u = dict[str, float](), dict[str, float]()
        for body in self.mechanism.bodies:
            if body.angle is not None:
                q[body.angle] = -self.built.bodies[body.name].angle
                u[body.angle] = -self.built.bodies[body.name].angularVelocity
        for joint in self.mechanism.tree_joints:
            child, parent = self._point(joint.child, joint.child_point), self._point(joint.parent, joint.parent_point)
            apart, speed = child[0] - parent[0], child[1] - parent[1]
            turning = self._turning(joint.parent)
            for name, direction in zip(joint.slides, joint.free_directions, strict=True):
                axis = turned(self._angle(joint.parent)) @ np.array([direction.real, direction.imag])
                q[name] = float(axis @ apart)
                u[name] = float(axis @ speed + turning * (np.array([-axis[1], axis[0]]) @ apart))
        names = self.mechanism.coordinates
        return np.array([q[name] for name in names]), np.array([u[name] for name in names])

    def _look(self) -> Observation:
        kinetic = potential = 0.0
        gravity = np.array(self.mechanism.gravity_vector)
        for body in self.mechanism.bodies:
            made = self.built.bodies[body.name]
            speed = np.array(made.linearVelocity)
            kinetic += 0.5 * (made.mass * float(speed @ speed) + made.inertia * made.angularVelocity**2)
            potential -= made.mass * float(gravity @ np.array(made.worldCenter))
        return Observation(
            points={each.name: self._point(each.body, each.point) for each in self.mechanism.markers},
            kinetic_energy=kinetic,
            potential_energy=potential + float(self.applied.potential_energy(self._state[0])),
            gaps={joint.name: self._gap(joint) for joint in self.mechanism.joints if not isinstance(joint, FreeJoint)},
        )

    def _gap(self, joint: AnyJoint) -> float:
        apart = self._point(joint.child, joint.child_point)[0] - self._point(joint.parent, joint.parent_point)[0]
        held = [
            turned(self._angle(joint.parent)) @ np.array([complex(d).real, complex(d).imag])
            for d in joint.held_directions
        ]
        return float(np.linalg.norm([direction @ apart for direction in held]))

    def _angle(self, name: str) -> float:
        return float(self.built.bodies[name].angle)

    def _turning(self, name: str) -> float:
        return float(self.built.bodies[name].angularVelocity)

    def _point(self, name: str, point: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        """Position and velocity of a body's point, from Box2D's of its centre."""
        made = self.built.bodies[name]
        arm = turned(made.angle) @ np.array(self.built.anchor(name, point))
        if name == GROUND:
            return arm, np.zeros(2)
        return np.array(made.worldCenter) + arm, np.array(made.linearVelocity) + made.angularVelocity * np.array(
            [-arm[1], arm[0]]
        )
