"""Newton by itself: one of its solvers from start to end, and what is read of it.

A stop is a limit of a joint, a spring on an angle the stiffness and damping of a joint, a constant
torque a joint force; all stay for the whole run. `SolverXPBD` moves bodies, not joints: there a
body's slides and turn are one joint, angles are read off the bodies, within a turn about zero, and
point masses get an inertia by mass moved along their pins, which changes no motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import newton
import numpy as np
from trebucheck.engines.events import whole_steps
from trebucheck.engines.point_masses import NoPointMasses
from trebucheck.engines.protocol import Recording
from trebucheck.engines.reading import read_each_step, timed_reading
from trebucheck.engines.study import filled_template
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import (
    FORCE_ELEMENTS,
    ConstantForce,
    ConstantTorque,
    CubicTorsionSpring,
    ElementTable,
    RecordedForce,
    RecordedTorque,
    RotationalSpringDamper,
    RotorInertia,
    SlideInertia,
    SlideSpringDamper,
    SpringDamper,
)
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.event_driver import Observation, Samples
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.joint_tree import JointLimits

from .build import JointSpring, turn_of
from .motion import MUJOCO
from .tree import NewtonTree

if TYPE_CHECKING:
    from .engine import NewtonEngine

_LEAST_INERTIA = 0.1
"""Of a point mass about its centre of mass, as a part of m d^2, d the distance of its pin."""
_BUILT: ElementTable[str] = ElementTable(
    "newton by itself",
    FORCE_ELEMENTS,
    {RotationalSpringDamper: "a joint's stiffness and damping", ConstantTorque: "a joint force"},
    {
        SpringDamper: "our adapter builds springs on joints alone",
        ConstantForce: "our adapter builds forces on joints alone",
        CubicTorsionSpring: "our adapter builds linear springs alone",
        RotorInertia: "our adapter adds no inertia between two bodies",
        SlideInertia: "our adapter adds no inertia along slides",
        SlideSpringDamper: "our adapter builds no springs along slides",
        RecordedForce: "our adapter follows no record of efforts",
        RecordedTorque: "our adapter follows no record of efforts",
    },
)


def solver_of(options: NewtonEngine) -> tuple[str, dict[str, object]]:
    """Name and arguments of the solver's class, without those that are its defaults."""
    if options.solver == "mujoco":
        return "SolverMuJoCo", dict(MUJOCO)
    damping = {"angular_damping": options.angular_damping}
    if options.solver == "featherstone":
        return "SolverFeatherstone", damping
    given: dict[str, object] = {**damping, "iterations": options.iterations}
    own = {"angular_damping": 0.0, "iterations": 2}
    return "SolverXPBD", {name: value for name, value in given.items() if value != own[name]}


class Alone:
    """The articulation with a solver, at the start.

    Raises:
        UnsupportedProblemError: a stop, spring or torque is on no joint.
    """

    def __init__(self, mechanism: Mechanism, options: NewtonEngine) -> None:
        self.mechanism, self.options = mechanism, options
        self.moves_bodies = options.solver == "xpbd"
        self.massive = NoPointMasses(mechanism, _LEAST_INERTIA) if self.moves_bodies else None
        for name in self.massive.added if self.massive else ():
            raise UnsupportedProblemError(
                f"our adapter gives a point mass the inertia that SolverXPBD needs by mass moved "
                f"along its pin; {name!r} has no pin that it could be moved along."
            )
        self.to = JointCoordinates(mechanism)
        q, u = initial_state(mechanism)
        self.start, self.start_speeds = self.to.positions(q), self.to.speeds(u)
        self.offsets = self.to.positions(np.zeros(len(q)))
        """Of Newton's joints from sums of the mechanism's coordinates [rad, m]."""
        if self.moves_bodies:
            turns = 2 * np.pi * np.rint(self.start[self.turns] / (2 * np.pi))
            self.start[self.turns] -= turns
            self.offsets[self.turns] -= turns
        self.limits = JointLimits(self.to, "newton")
        self.closed = [stop.name for stop in mechanism.stops if stop.closed]
        self.springs: dict[int, JointSpring] = {}
        self.torques = np.zeros(len(self.to.freedoms))
        """Constant torques on the joints' coordinates [N m]."""
        for element in mechanism.force_elements:
            _BUILT[element]
            self._add(element)
        self.tree = NewtonTree(
            mechanism if self.massive is None else self.massive.mechanism,
            self._ranges(),
            options.limit_frequency,
            options.timestep,
            self.springs,
            whole_joints=self.moves_bodies,
        )
        name, given = solver_of(options)
        solver = getattr(newton.solvers, name)(self.tree.model, **given)
        has_limits = options.solver == "mujoco" and self.closed
        self.tree.solve_by(solver, *(["qfrc_constraint"] if has_limits else []))
        self.tree.place(self.start, self.start_speeds)

    def _ranges(self) -> dict[int, tuple[float, float]]:
        """Ranges of Newton's joints."""
        ranges = self.limits.ranges(self.closed)
        if not self.moves_bodies:
            return ranges
        moved = self.offsets - self.to.positions(np.zeros(len(self.offsets)))
        return {k: (low + moved[k], high + moved[k]) for k, (low, high) in ranges.items()}

    def _add(self, element: Any) -> None:
        for index, freedom in enumerate(self.to.freedoms):
            turns = freedom.joint.child, freedom.joint.parent
            if freedom.direction is not None or set(turns) != set(element.bodies):
                continue
            sense = 1.0 if element.body == turns[0] else -1.0
            if isinstance(element, ConstantTorque):
                self.torques[index] += sense * element.torque
                return
            if index not in self.springs:
                rest = sense * element.rest_angle
                self.springs[index] = JointSpring(element.stiffness, rest, element.damping)
                return
        raise UnsupportedProblemError(
            f"our adapter builds springs and torques as those of Newton's joints, one spring on "
            f"each, and {element.name!r} is on none of its own."
        )

    def state(self) -> tuple[FloatArray, FloatArray]:
        """Coordinates and speeds of the joints; angles of bodies within a turn."""
        if self.moves_bodies:
            now = self.tree.now
            newton.eval_ik(self.tree.model, now, now.joint_q, now.joint_qd)
        return self.tree.state()

    @property
    def turns(self) -> list[int]:
        """Coordinates that are angles."""
        return [k for k, freedom in enumerate(self.to.freedoms) if freedom.direction is None]

    # --- Readings of the step that begins in a state

    def limit_torques(self, state: tuple[FloatArray, FloatArray]) -> dict[str, float]:
        """Torque of each limit [N m], after the step that begins in a state of the joints.

        `SolverMuJoCo` tells the forces of its constraints. `SolverFeatherstone` does not: its
        limits are springs with dampers. `SolverXPBD` tells the wrench of a joint.
        """
        if self.options.solver == "mujoco":
            told = np.ravel(self.tree.told.qfrc_constraint.numpy()) if self.closed else None
            of = {} if told is None else {n: float(told[self._place(n)]) for n in self.closed}
        elif self.options.solver == "featherstone":
            of = {name: self._spring_torque(name, *state) for name in self.closed}
        else:
            of = {name: self._joint_torque(name) for name in self.closed}
        return {n: max(0.0, self.limits.places[n][1] * torque) for n, torque in of.items()}

    def _place(self, name: str) -> int:
        return self.limits.places[name][0]

    def _spring_torque(self, name: str, j: FloatArray, v: FloatArray) -> float:
        k, model = self._place(name), self.tree.model
        low, high = (float(each.numpy()[k]) for each in _ends_of(model))
        beyond = min(0.0, j[k] - low) + max(0.0, j[k] - high)
        stiffness, damping = (float(each.numpy()[k]) for each in _laws_of(model))
        return -stiffness * beyond - damping * float(v[k]) if beyond else 0.0

    def _joint_torque(self, name: str) -> float:
        """Moment of a joint's wrench about its axis."""
        joint = self.to.freedoms[self._place(name)].joint
        force = self.tree.wrenches()[self.tree.built.bodies[joint.child]]
        pose = self.tree.now.body_q.numpy().astype(float)[self.tree.built.bodies[joint.child]]
        arm = turn_of(pose[3:]) @ np.subtract(
            joint.child_point, self.tree.mechanism.body(joint.child).centre
        )
        return -float(force[5] - (arm[0] * force[1] - arm[1] * force[0]))


def _ends_of(model: Any) -> tuple[Any, Any]:
    return model.joint_limit_lower, model.joint_limit_upper


def _laws_of(model: Any) -> tuple[Any, Any]:
    return model.joint_limit_ke, model.joint_limit_kd


def run_alone(problem: Problem, options: NewtonEngine) -> Recording:
    """Step Newton from the start to a problem's end or just beyond, and read it.

    Forces at an instant are those of the step that begins there.

    Raises:
        UnsupportedProblemError: a stop, spring or torque is on no joint.
    """
    alone = Alone(problem.mechanism, options)
    steps, tree = whole_steps(problem.duration, options.timestep), alone.tree
    states = [tree.state()]
    seen, torques, forces = list[Observation](), list[dict[str, float]](), list[_Forces]()

    @read_each_step
    def look() -> None:
        seen.append(tree.look())

    def step() -> None:
        look()
        forces.append(tree.step(alone.torques))
        torques.append(alone.limit_torques(states[-1]))

    for _ in range(steps):
        step()
        states.append(alone.state())
    with timed_reading():
        step()  # for the forces in the last state
        j, v = (np.array(values) for values in zip(*states, strict=True))
        if alone.moves_bodies:
            j[:, alone.turns] = np.unwrap(j[:, alone.turns], axis=0)
        q, u = (j - alone.offsets) @ alone.to.sums.T, v @ alone.to.sums.T
        return _recording(problem, alone, (q, u), seen, torques, forces)


_Forces = Mapping[str, FloatArray]


def _recording(
    problem: Problem,
    alone: Alone,
    states: tuple[FloatArray, FloatArray],
    seen: list[Observation],
    torques: list[dict[str, float]],
    forces: list[_Forces],
) -> Recording:
    """The readings of a run as the engines' common record."""
    springs = AppliedForces(Kinematics(problem.mechanism))
    samples = Samples(problem)
    times: FloatArray = alone.options.timestep * np.arange(len(seen), dtype=np.float64)
    extra = 0.0 if alone.massive is None else alone.massive.extra_potential_energy
    if alone.massive is not None:
        forces = _unspread(alone.massive, states, alone.options.timestep, forces)
    for k, time in enumerate(times.tolist()):
        q, u = states[0][k], states[1][k]
        potential = seen[k].potential_energy - extra + float(springs.potential_energy(q))
        shown = replace(seen[k], potential_energy=potential, reactions=forces[k])
        samples.add(time, (q, u), torques[k], shown)
    return samples.own_recording("newton")


def _unspread(
    massive: NoPointMasses,
    states: tuple[FloatArray, FloatArray],
    timestep: float,
    forces: list[_Forces],
) -> list[_Forces]:
    """Forces of joints [N] in the mechanism, whose masses were moved along pins.

    Accelerations of the pins are those of the samples' velocities, in each step.
    """
    kinematics, unspread = Kinematics(massive.original), [dict(each) for each in forces]
    for joint in massive.original.tree_joints:
        point = kinematics.point(joint.child, joint.child_point)
        rates = np.diff(kinematics.velocity(point, *states), axis=0) / timestep
        for k, of_joints in enumerate(unspread):
            rate = rates[min(k, len(rates) - 1)]
            of_joints[joint.name] = massive.reaction(joint.name, of_joints[joint.name], rate)
    return list(unspread)


def script(problem: Problem, options: NewtonEngine) -> str:
    """The run of :func:`run_alone` as a program of its own."""
    mechanism = problem.mechanism
    alone = Alone(mechanism, options)
    solver, given = solver_of(options)
    return filled_template(
        __name__,
        "alone.py.j2",
        timestep=options.timestep,
        steps=whole_steps(problem.duration, options.timestep),
        gravity=(*mechanism.gravity_vector, 0.0),
        calls=[call.text for call in alone.tree.built.calls],
        joints=alone.tree.built.joints,
        solver=solver,
        options=given,
        start=alone.start.tolist(),
        start_speeds=alone.start_speeds.tolist(),
        torques=alone.torques.tolist() if alone.torques.any() else [],
        moves_bodies=alone.moves_bodies,
        turns=alone.turns,
        offsets=alone.offsets.tolist(),
        sums=alone.to.sums.tolist(),
    )
