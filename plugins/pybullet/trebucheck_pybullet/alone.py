"""Bullet by itself: a URDF tree, its step from start to end, and what is read of it.

The URDF has the stops as limits of its joints, which stay in it whatever the law; pins that close
loops are Bullet's point-to-point constraints, slots that do slides of carriers that are pinned to
the child. Bullet has no springs and no constant loads: their forces are given to the links before
each step, as its documentation has it. What is Bullet's default is not set. :func:`script` gives
the same run as a program.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pybullet
from trebucheck.engines.events import whole_steps
from trebucheck.engines.protocol import Recording
from trebucheck.engines.study import filled_template
from trebucheck.models import elements
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.event_driver import Observation, Samples
from trebucheck_toolkit.given_forces import GivenForces, program
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.joint_tree import JointLimits, torques_of_limits
from trebucheck_toolkit.schemes import State
from trebucheck_toolkit.slot_carriers import slot_forces, with_carriers

from .build import loaded, urdf
from .tree import BulletTree, turn

if TYPE_CHECKING:
    from .engine import PyBulletEngine

BULLETS: Mapping[str, float] = {
    "timestep": 1 / 240,
    "solver_iterations": 50,
    "solver_threshold": 1e-7,
    "linear_damping": 0.04,
    "angular_damping": 0.04,
    "max_joint_velocity": 100.0,
}
"""Bullet's own values of its options, which are not set."""
_OF_THE_ENGINE = {
    "timestep": "fixedTimeStep",
    "solver_iterations": "numSolverIterations",
    "solver_threshold": "solverResidualThreshold",
}
OF_LINKS = {
    "linear_damping": "linearDamping",
    "angular_damping": "angularDamping",
    "max_joint_velocity": "maxJointVelocity",
}


@dataclass(frozen=True)
class Closure:
    """A pin that closes a loop."""

    joint: elements.PinJoint
    parent: tuple[float, float]
    """Its point from the centre of mass of the parent [m]."""
    child: tuple[float, float]


class Alone:
    """A mechanism in a client of Bullet's, at its present state."""

    def __init__(self, mechanism: Mechanism, options: PyBulletEngine, limited: bool = True) -> None:
        """Build it at its start, with or without its limits."""
        self.mechanism = mechanism = with_carriers(mechanism)
        self.to = JointCoordinates(mechanism)
        self.forces = GivenForces(mechanism)
        self.urdf = _urdf(self.to, limited)
        self.closures = [_CLOSING[joint](self, joint) for joint in mechanism.loop_joints]
        names = {body.name for body in mechanism.bodies}
        self.links = loaded(self.urdf, mechanism.gravity_vector, names)
        self.client: Any = self.links.client
        if of_engine := changed(options, _OF_THE_ENGINE):
            self.client.setPhysicsEngineParameter(**of_engine)
        if of_links := changed(options, OF_LINKS):
            for link in range(-1, self.client.getNumJoints(self.links.body)):
                self.client.changeDynamics(self.links.body, link, **of_links)
        q, u = initial_state(mechanism)
        self.place(self.to.positions(q), self.to.speeds(u))
        self.constraints = [self._close(closure) for closure in self.closures]

    def pin(self, joint: elements.PinJoint) -> Closure:
        """Prepare the constraint of a pin."""
        arms = (
            self.forces.arm(body, point)
            for body, point in (
                (joint.parent, joint.parent_point),
                (joint.child, joint.child_point),
            )
        )
        parent, child = ((arm.real, arm.imag) for arm in arms)
        return Closure(joint, parent, child)

    def link(self, name: str) -> int:
        """Bullet's link of a body."""
        return -1 if name == GROUND else self.links.carriers[name]

    def _close(self, closure: Closure) -> int:
        body, joint = self.links.body, closure.joint
        return int(
            self.client.createConstraint(
                body,
                self.link(joint.parent),
                body,
                self.link(joint.child),
                pybullet.JOINT_POINT2POINT,
                (0, 0, 0),
                (*closure.parent, 0),
                (*closure.child, 0),
            )
        )

    # --- Steps

    def place(self, j: FloatArray, v: FloatArray) -> None:
        """Set the state."""
        for link, at, speed in zip(self.links.moving, j.tolist(), v.tolist(), strict=True):
            self.client.resetJointState(self.links.body, link, at, speed)

    def state(self) -> State:
        """The joint coordinates and speeds."""
        states = self.client.getJointStates(self.links.body, self.links.moving)
        return np.array([each[0] for each in states]), np.array([each[1] for each in states])

    def step(self) -> None:
        """Take one step, under the forces of springs and loads at its start."""
        if self.mechanism.force_elements:
            j, v = self.state()
            q, u = self.to.mechanism_positions(j), self.to.mechanism_speeds(v)
            self.forces.give(self, q, u)
        self.client.stepSimulation()

    # --- Bodies, as forces are given to them

    def centre(self, name: str) -> tuple[complex, complex]:
        """Place [m] and velocity [m/s] of a body's centre of mass."""
        link = self.client.getLinkState(
            self.links.body, self.link(name), computeLinkVelocity=1, computeForwardKinematics=1
        )
        return complex(*link[0][:2]), complex(*link[6][:2])

    def push(self, name: str, place: complex, force: complex) -> None:
        """Give a body a force [N] at a place [m] for the next step."""
        self.client.applyExternalForce(
            self.links.body,
            self.link(name),
            (force.real, force.imag, 0.0),
            (place.real, place.imag, 0.0),
            pybullet.WORLD_FRAME,
        )

    def twist(self, name: str, torque: float) -> None:
        """Give a body a clockwise torque [N m] for the next step."""
        self.client.applyExternalTorque(
            self.links.body, self.link(name), (0.0, 0.0, -torque), pybullet.WORLD_FRAME
        )


def _urdf(to: JointCoordinates, limited: bool) -> str:
    ranges: dict[str, tuple[float, float]] = {}
    if limited and to.mechanism.stops:
        limits = JointLimits(to, "pybullet")
        for index, ends in limits.ranges(limits.limits).items():
            ranges[to.freedoms[index].joint.child] = ends
    return urdf(to.mechanism, to.links, ranges=ranges)


_LOOPS = "our adapter closes loops by pins and slots; Bullet has further constraints between links"
_CLOSING: elements.ElementTable[Callable[[Alone, Any], Closure]] = elements.ElementTable(
    "pybullet by itself", elements.JOINTS, {elements.PinJoint: Alone.pin}, others=_LOOPS
)


def changed(options: PyBulletEngine, names: Mapping[str, str]) -> dict[str, float]:
    """Arguments of Bullet's functions for those options that are not its defaults."""
    given = {option: getattr(options, option) for option in names}
    return {names[name]: value for name, value in given.items() if value != BULLETS[name]}


# --- A run


def run_alone(problem: Problem, options: PyBulletEngine) -> Recording:
    """Step Bullet from the start to a problem's end or just beyond, and read it.

    Forces at an instant are those of the step that begins there.

    Raises:
        UnsupportedProblemError: a loop is closed by neither a pin nor a slot, or a stop is on no
            joint.
    """
    mechanism = problem.mechanism
    alone = Alone(mechanism, options)
    reader = _Reader(alone, options)
    steps = whole_steps(problem.duration, options.timestep)
    times: FloatArray = options.timestep * np.arange(steps + 1, dtype=np.float64)
    states: list[State] = []
    for _ in times:
        states.append(alone.state())
        reader.see(states[-1], alone.step)
    j, v = (np.array(values) for values in zip(*states, strict=True))
    q, u = alone.to.mechanism_positions(j), alone.to.mechanism_speeds(v)
    known = len(mechanism.coordinates)  # without those of carriers
    efforts = reader.efforts(q, alone.state()[1])
    samples = Samples(problem)
    for k, time in enumerate(times):
        contacts = {name: float(effort[k]) for name, effort in efforts.items()}
        seen = reader.observation(k, q[k])
        seen = replace(seen, reactions=slot_forces(mechanism, seen.reactions))
        samples.add(float(time), (q[k, :known], u[k, :known]), contacts, seen)
    return samples.own_recording("pybullet")


class _Reader:
    """Reads a run: joint forces while it goes on, the rest from its states, in other clients."""

    def __init__(self, alone: Alone, options: PyBulletEngine) -> None:
        self.alone, self.timestep, self.to = alone, options.timestep, alone.to
        self.kinematics = Kinematics(alone.mechanism)
        self.applied = AppliedForces(self.kinematics)
        self.tree = BulletTree(alone.mechanism)
        self.free = Alone(alone.mechanism, options, limited=False)
        self.joints = [each for each in alone.mechanism.tree_joints if each.held_directions]
        for joint in self.joints:
            link = alone.link(joint.child)
            alone.client.enableJointForceTorqueSensor(alone.links.body, link, True)
        self.states: list[State] = []
        self.forces: list[dict[str, FloatArray]] = []

    def see(self, state: State, step: Callable[[], None]) -> None:
        """Note a state and the joint forces of the step from it: Bullet's joint sensors."""
        alone = self.alone
        body, client = alone.links.body, alone.client
        turned = {
            joint.name: turn(client.getLinkState(body, alone.link(joint.child))[1])
            for joint in self.joints
        }
        step()
        self.states.append(state)
        sensed = {
            joint.name: client.getJointState(body, alone.link(joint.child))[2][:2]
            for joint in self.joints
        }
        forces = {name: turned[name] @ force for name, force in sensed.items()}
        for closure, number in zip(alone.closures, alone.constraints, strict=True):
            forces[closure.joint.name] = np.array(client.getConstraintState(number)[:2])
        self.forces.append(forces)

    def efforts(self, q: FloatArray, last: FloatArray) -> dict[str, FloatArray]:
        """Torque of each limit in the step from each state [N m], from the speeds that it changes.

        Args:
            q: the mechanism's coordinates, shape (n, n_q).
            last: joint speeds after the last step.
        """
        names = [stop.name for stop in self.alone.mechanism.stops]
        if not names:
            return {}
        speeds = [*(v for _, v in self.states[1:]), last]
        rows = [self._pushing(*given) for given in zip(self.states, q, speeds, strict=True)]
        return dict(zip(names, np.array(rows).T, strict=True))

    def _pushing(self, state: State, q: FloatArray, after: FloatArray) -> list[float]:
        """Torques of the limits that change the speeds that a step without limits would give."""
        j, v = state
        self.free.place(j, v)
        self.free.step()
        whole, by_limits = (
            self.to.mechanism_speeds(after - before) / self.timestep
            for before in (v, self.free.state()[1])
        )
        mass = self.to.mass_matrix(self.tree.mass_matrix(j))
        return torques_of_limits(self.kinematics, mass, q, whole, by_limits)

    def observation(self, k: int, q: FloatArray) -> Observation:
        """Points and energies in a state, and the joint forces of the step from it."""
        j, v = self.states[k]
        seen = self.tree.observe(j, v, np.zeros_like(v))
        energy = seen.potential_energy + float(self.applied.potential_energy(q))
        return replace(seen, potential_energy=energy, reactions=self.forces[k])


# --- The run as a program


def script(problem: Problem, options: PyBulletEngine) -> str:
    """The run of :func:`run_alone` as a program of its own."""
    alone = Alone(problem.mechanism, options)
    mechanism = alone.mechanism
    q, u = initial_state(mechanism)
    definitions, forces = program(mechanism)
    return filled_template(
        __name__,
        "alone.py.j2",
        urdf=alone.urdf,
        gravity=(*mechanism.gravity_vector, 0.0),
        of_engine=changed(options, _OF_THE_ENGINE),
        of_links=changed(options, OF_LINKS),
        start=alone.to.positions(q).tolist(),
        start_speeds=alone.to.speeds(u).tolist(),
        closures=alone.closures,
        timestep=options.timestep,
        steps=whole_steps(problem.duration, options.timestep),
        offsets=alone.to.offsets.tolist(),
        sums=alone.to.sums[: len(problem.mechanism.coordinates)].tolist(),
        definitions=definitions if forces else [],
        forces=forces,
    )
