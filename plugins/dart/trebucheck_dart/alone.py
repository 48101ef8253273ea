"""DART by itself: a skeleton in a world, its step from start to end, and what is read of it.

Stops are limits of DART's joints, which it enforces where it is asked to, and stay in the skeleton
whatever the law. Pins that close loops are its ball-joint constraints, slots that do slides of
carriers that are pinned to the child, torsion springs between bodies that a joint connects its
joint springs; the forces of other springs, and of loads, are given to the body nodes before each
step. What is DART's default is not set. :func:`script` gives the same run as a program.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import dartpy
import numpy as np
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
from trebucheck_toolkit.given_forces import GivenForces, program, springs_of_joints
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.joint_tree import JointLimits
from trebucheck_toolkit.loop_pins import LoopPins, left_over
from trebucheck_toolkit.schemes import State
from trebucheck_toolkit.slot_carriers import slot_forces, with_carriers

from .build import Skeleton, add_link, frame, inertia_of, links
from .tree import DartTree

if TYPE_CHECKING:
    from .engine import DartEngine

DARTS_STEP = 1e-3
"""Step of a new world of DART's [s], which is not set."""


class Alone(Skeleton):
    """A mechanism in a world of DART's, at its present state."""

    def __init__(self, mechanism: Mechanism, options: DartEngine) -> None:
        """Build it at its start."""
        self.mechanism = mechanism = with_carriers(mechanism)
        self.to = JointCoordinates(mechanism)
        super().__init__(self.to)
        if options.timestep != DARTS_STEP:
            self.world.setTimeStep(options.timestep)
        self.springs = springs_of_joints(self.to)
        for index, (stiffness, rest, damping) in self.springs.values():
            self.moving[index].setRestPosition(0, rest)
            self.moving[index].setSpringStiffness(0, stiffness)
            self.moving[index].setDampingCoefficient(0, damping)
        others = [each for each in mechanism.force_elements if each.name not in self.springs]
        self.pushed = mechanism.model_copy(update={"force_elements": tuple(others)})
        self.forces = GivenForces(self.pushed)
        limits = JointLimits(self.to, "dart")
        self.limits, self.ranges = limits.limits, limits.ranges(limits.limits)
        for index, (low, high) in self.ranges.items():
            self.moving[index].setPositionLowerLimit(0, low)
            self.moving[index].setPositionUpperLimit(0, high)
            self.moving[index].setLimitEnforcement(True)
        q, u = initial_state(mechanism)
        self.place(self.to.positions(q), self.to.speeds(u))
        self.world.addSkeleton(self.skeleton)
        self.pins = [_CLOSING[joint](joint) for joint in mechanism.loop_joints]
        for joint in self.pins:
            self._close(joint)

    def _close(self, joint: elements.PinJoint) -> None:
        bodies = [self.bodies[name] for name in closing(joint)]
        place = bodies[0].getWorldTransform().multiply(np.array([*pin_point(joint), 0.0]))
        self.world.getConstraintSolver().addConstraint(
            dartpy.constraint.BallJointConstraint(*bodies, place)
        )

    def state(self) -> State:
        """The joint coordinates and speeds."""
        return np.array(self.skeleton.getPositions()), np.array(self.skeleton.getVelocities())

    def step(self) -> None:
        """Take one step, under the forces of springs and loads at its start."""
        if self.pushed.force_elements:
            j, v = self.state()
            q, u = self.to.mechanism_positions(j), self.to.mechanism_speeds(v)
            self.forces.give(self, q, u)
        self.world.step()

    # --- Bodies, as forces are given to them

    def centre(self, name: str) -> tuple[complex, complex]:
        """Place [m] and velocity [m/s] of a body's centre of mass."""
        node = self.bodies[name]
        return complex(*node.getCOM()[:2]), complex(*node.getCOMLinearVelocity()[:2])

    def push(self, name: str, place: complex, force: complex) -> None:
        """Give a body a force [N] at a place [m] for the next step."""
        self.bodies[name].addExtForce(
            np.array([force.real, force.imag, 0.0]),
            np.array([place.real, place.imag, 0.0]),
            False,
            False,
        )

    def twist(self, name: str, torque: float) -> None:
        """Give a body a clockwise torque [N m] for the next step."""
        self.bodies[name].addExtTorque(np.array([0.0, 0.0, -torque]), False)


def closing(joint: elements.PinJoint) -> list[str]:
    """Bodies that a pin connects, without the ground."""
    return [name for name in (joint.child, joint.parent) if name != GROUND]


def pin_point(joint: elements.PinJoint) -> tuple[float, float]:
    """Point of the first body of :func:`closing`."""
    return joint.parent_point if joint.child == GROUND else joint.child_point


def _this(joint: elements.PinJoint) -> elements.PinJoint:
    return joint


_LOOPS = "our adapter closes loops by pins and slots; DART has further joint constraints"
_CLOSING: elements.ElementTable[Callable[[Any], elements.PinJoint]] = elements.ElementTable(
    "dart by itself", elements.JOINTS, {elements.PinJoint: _this}, others=_LOOPS
)


# --- A run


def run_alone(problem: Problem, options: DartEngine) -> Recording:
    """Step DART from the start to a problem's end or just beyond, and read it.

    Forces at an instant are those of the step that begins there. DART tells the impulses of limits,
    and the forces of the tree's joints, which balance what its ball-joint constraints exert; the
    forces of these follow from Newton's law of the bodies, by DART's changes of speed.

    Raises:
        UnsupportedProblemError: a loop is closed by neither a pin nor a slot, or the force of such
            a pin does not follow; or a stop is on no joint.
    """
    mechanism = problem.mechanism
    alone = Alone(mechanism, options)
    reader = _Reader(alone, options)
    steps = whole_steps(problem.duration, options.timestep)
    times: FloatArray = options.timestep * np.arange(steps + 1, dtype=np.float64)
    states: list[State] = []
    for _ in times:
        states.append(alone.state())
        reader.see()
    j, v = (np.array(values) for values in zip(*states, strict=True))
    q, u = alone.to.mechanism_positions(j), alone.to.mechanism_speeds(v)
    known = len(mechanism.coordinates)  # without those of carriers
    rates = (np.concatenate([v[1:], alone.state()[1][None]]) - v) / options.timestep
    seen = reader.observations(j, v, rates)
    reactions = slot_forces(mechanism, reader.reactions(q, u))
    energies = reader.applied.potential_energy(q)
    samples = Samples(problem)
    for k, time in enumerate(times):
        observation = replace(
            seen[k],
            potential_energy=seen[k].potential_energy + float(energies[k]),
            reactions={name: force[k] for name, force in reactions.items()},
        )
        samples.add(float(time), (q[k, :known], u[k, :known]), reader.torques[k], observation)
    return samples.own_recording("dart")


class _Reader:
    """Reads a run: forces while it goes on, the rest from its states, in another world."""

    def __init__(self, alone: Alone, options: DartEngine) -> None:
        self.alone, self.timestep = alone, options.timestep
        self.applied = AppliedForces(Kinematics(alone.mechanism))
        self.tree = DartTree(alone.mechanism)
        self.pins = LoopPins(alone.mechanism, "dart")
        self.joints = [each for each in alone.mechanism.tree_joints if each.held_directions]
        self.forces: list[dict[str, FloatArray]] = []
        self.torques: list[dict[str, float]] = []
        """Of each stop in each step [N m]: the impulse of its limit over the step."""
        self.accelerations: dict[str, list[FloatArray]] = {name: [] for name in self.pins.bodies}

    def see(self) -> None:
        """Take a step from the present state, and note DART's forces in it."""
        nodes = {joint.name: self.alone.bodies[joint.child] for joint in self.joints}
        turned = {
            name: np.array(node.getWorldTransform().matrix())[:2, :2]
            for name, node in nodes.items()
        }
        self.alone.step()
        self.forces.append(
            {name: turned[name] @ node.getBodyForce()[3:5] for name, node in nodes.items()}
        )
        self.torques.append(
            {
                name: max(0.0, limit.sense * self._impulse(limit.index) / self.timestep)
                for name, limit in self.alone.limits.items()
            }
        )

    def _impulse(self, index: int) -> float:
        """Impulse [N m s] of a joint's limits in the last step, along its coordinate."""
        return float(self.alone.moving[index].getConstraintImpulse(0))

    def observations(self, j: FloatArray, v: FloatArray, rates: FloatArray) -> list[Observation]:
        """Points and energies in each state, from which the joint speeds change at these rates.

        Accelerations of the bodies that pins of loops are on are noted.
        """
        seen: list[Observation] = []
        for state in zip(j, v, rates, strict=True):
            seen.append(self.tree.observe(*state))
            for name, found in self.accelerations.items():
                found.append(np.array(self.tree.bodies[name].getCOMLinearAcceleration()[:2]))
        return seen

    def reactions(self, q: FloatArray, u: FloatArray) -> dict[str, FloatArray]:
        """Force of each joint on its child in the step from each state [N], shape (n, 2)."""
        mechanism = self.alone.mechanism
        told = {
            joint.name: np.array([forces[joint.name] for forces in self.forces])
            for joint in self.joints
        }
        accelerations = {name: np.array(found) for name, found in self.accelerations.items()}
        applied = self.applied.on_bodies(q, u) if accelerations else {}
        return told | self.pins.forces(left_over(mechanism, accelerations, told, applied))


# --- The run as a program


def script(problem: Problem, options: DartEngine) -> str:
    """The run of :func:`run_alone` as a program of its own."""
    alone = Alone(problem.mechanism, options)
    mechanism = alone.mechanism
    q, u = initial_state(mechanism)
    definitions, forces = program(alone.pushed)
    return filled_template(
        __name__,
        "alone.py.j2",
        gravity=[*mechanism.gravity_vector, 0.0],
        timestep=options.timestep,
        darts_step=DARTS_STEP,
        steps=whole_steps(problem.duration, options.timestep),
        definitions=[inspect.getsource(each) for each in (frame, inertia_of, add_link)],
        links=[tuple(link) for link in links(alone.to)],
        springs=list(alone.springs.values()),
        ranges={
            index: [
                text if math.isfinite(value) else f"float('{text}')"
                for value in ends
                for text in [repr(value)]
            ]
            for index, ends in alone.ranges.items()
        },
        start=alone.to.positions(q).tolist(),
        start_speeds=alone.to.speeds(u).tolist(),
        pins=[(closing(joint), [*pin_point(joint), 0.0]) for joint in alone.pins],
        offsets=alone.to.offsets.tolist(),
        sums=alone.to.sums[: len(problem.mechanism.coordinates)].tolist(),
        force_definitions=definitions if forces else [],
        forces=forces,
    )
