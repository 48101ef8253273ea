"""OpenSim by itself: elements of its own, its Manager from start to end, and what is read of it.

A stop is a CoordinateLimitForce, which stays in the model for the whole run; a pin that closes a
loop is a PointConstraint, a slot a PointOnLineConstraint. Springs are PointToPointSprings, with
damping ExpressionBasedPointToPointForces, on angles SpringGeneralizedForces of a joint's
coordinate; constant forces and torques are PrescribedForces.
"""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import opensim as osim
from trebucheck.engines.events import whole_steps
from trebucheck.engines.protocol import Recording
from trebucheck.engines.reading import timed_reading
from trebucheck.engines.study import filled_template
from trebucheck.models import elements
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.event_driver import Observation, Samples
from trebucheck_toolkit.joint_coordinates import Limit

from .build import Built, in_space
from .read import Reader

if TYPE_CHECKING:
    from .engine import OpenSimEngine

_FAR = 1e6  # [degrees] a limit that is never reached
_DEGREE = 180.0 / math.pi
MANAGERS_ACCURACY = 1e-3
"""What a Manager asks of its integrator where nothing is set."""


class Alone:
    """The model of OpenSim's own elements, at the start.

    Raises:
        UnsupportedProblemError: an element has no counterpart here.
    """

    def __init__(self, mechanism: Mechanism, options: OpenSimEngine) -> None:
        self.mechanism, self.options = mechanism, options
        self.limits: dict[str, Limit] = {}
        self.limit_forces: dict[str, Any] = {}
        self.loops: dict[str, Any] = {}
        """Constraints by the joints that close loops."""
        self.built = Built(mechanism, self._add, actuated=False)
        self.place(*initial_state(mechanism))

    @property
    def to(self) -> Any:
        """The joint coordinates."""
        return self.built.coordinates

    def place(self, q: FloatArray, u: FloatArray) -> None:
        """Set the state of the model."""
        self.built.place(q, u, self.built.state)

    # --- Elements

    def _add(self, built: Built) -> None:
        self.built = built
        for stop in self.mechanism.stops:
            self._add_limit(stop)
        for joint in self.mechanism.loop_joints:
            self._add_loop(joint)
        for element in self.mechanism.force_elements:
            _FORCES[element](self, element)

    def _add_limit(self, stop: elements.AnyStop) -> None:
        limit = self.to.limit(stop)
        if limit is None:
            raise UnsupportedProblemError(
                f"our adapter builds stops as OpenSim's CoordinateLimitForces, which are on joints "
                f"alone, and {stop.name!r} is on none; OpenSim has contacts of its own."
            )
        end, k = limit.value * _DEGREE, self.options.limit_stiffness
        upper, lower = (_FAR, end) if limit.sense > 0 else (end, -_FAR)
        of_all = self.options.limit_damping, self.options.limit_transition
        force = osim.CoordinateLimitForce(
            f"freedom_{limit.index}", upper, k, lower, k, *of_all, False
        )
        self.limits[stop.name], self.limit_forces[stop.name] = limit, force
        self._add_force(force)

    def _add_loop(self, joint: elements.AnyJoint) -> None:
        parent, child = (self.built.bodies[name] for name in (joint.parent, joint.child))
        points = in_space(joint.parent_point), in_space(joint.child_point)
        if joint.holds_angle:
            raise UnsupportedProblemError(
                f"our adapter closes loops by OpenSim's PointConstraints and "
                f"PointOnLineConstraints, and {joint.name!r} holds an angle; OpenSim has "
                f"WeldConstraints."
            )
        if joint.free_directions:
            (axis,) = joint.free_directions
            along = in_space((axis.real, axis.imag))
            made = osim.PointOnLineConstraint(parent, along, points[0], child, points[1])
        else:
            made = osim.PointConstraint(parent, points[0], child, points[1])
        made.setName(f"loop_{len(self.loops)}")
        self.loops[joint.name] = made
        self.built.model.addConstraint(made)

    def _add_force(self, force: Any) -> None:
        force.setName(f"force_{self.built.model.getForceSet().getSize()}")
        self.built.model.addForce(force)

    def add_spring(self, spring: elements.SpringDamper) -> None:
        """Add a spring between two points, or with damping the same as an expression."""
        (b, p), (a, r) = spring.ends
        bodies, points = (self.built.bodies[a], self.built.bodies[b]), (in_space(r), in_space(p))
        law = spring.stiffness, spring.rest_length
        if spring.damping:
            names = (body.getAbsolutePathString() for body in bodies)
            ends = [each for end in zip(names, points, strict=True) for each in end]
            text = f"{law[0]!r}*(d-{law[1]!r})+{spring.damping!r}*ddot"
            self._add_force(osim.ExpressionBasedPointToPointForce(*ends, text))
        else:
            self._add_force(
                osim.PointToPointSpring(bodies[0], points[0], bodies[1], points[1], *law)
            )

    def add_rotational_spring(self, spring: elements.RotationalSpringDamper) -> None:
        """Add a spring on the coordinate of a joint."""
        for index, freedom in enumerate(self.to.freedoms):
            turns = freedom.joint.child, freedom.joint.parent
            if freedom.direction is None and set(turns) == {spring.body, spring.relative_to}:
                force = osim.SpringGeneralizedForce(f"freedom_{index}")
                force.setStiffness(spring.stiffness)
                sense = 1.0 if spring.body == turns[0] else -1.0
                force.setRestLength(sense * spring.rest_angle)
                force.setViscosity(spring.damping)
                self._add_force(force)
                return
        raise UnsupportedProblemError(
            f"our adapter builds springs on angles as OpenSim's SpringGeneralizedForces, which are "
            f"on joints alone, and {spring.name!r} is on none; OpenSim has bushings."
        )

    def add_constant_force(self, force: elements.ConstantForce) -> None:
        """Add a force on a point of a body."""
        if force.body != GROUND:
            made = osim.PrescribedForce(f"on_{force.body}", self.built.bodies[force.body])
            made.setForceIsInGlobalFrame(True)
            made.setPointIsInGlobalFrame(False)
            made.setForceFunctions(*_constants(*force.force, 0.0))
            made.setPointFunctions(*_constants(*force.point, 0.0))
            self._add_force(made)

    def add_constant_torque(self, torque: elements.ConstantTorque) -> None:
        """Add torques on two bodies, clockwise on the first one."""
        for body, size in zip(torque.bodies, (torque.torque, -torque.torque), strict=True):
            if body != GROUND:
                made = osim.PrescribedForce(f"on_{body}", self.built.bodies[body])
                made.setForceIsInGlobalFrame(True)
                made.setTorqueFunctions(*_constants(0.0, 0.0, -size))
                self._add_force(made)


def _constants(*values: float) -> tuple[Any, ...]:
    return tuple(osim.Constant(float(value)) for value in values)


_FORCES: elements.ElementTable[Callable[[Alone, Any], None]] = elements.ElementTable(
    "opensim by itself",
    elements.FORCE_ELEMENTS,
    {
        elements.SpringDamper: Alone.add_spring,
        elements.RotationalSpringDamper: Alone.add_rotational_spring,
        elements.ConstantForce: Alone.add_constant_force,
        elements.ConstantTorque: Alone.add_constant_torque,
    },
    others="our adapter builds no such force",
)


# --- A run


def run_alone(problem: Problem, options: OpenSimEngine) -> Recording:
    """Integrate from the start to a problem's end, or just beyond, and read the states.

    Raises:
        UnsupportedProblemError: an element has no counterpart here.
    """
    alone = Alone(problem.mechanism, options)
    times, j, v = _moved(alone, problem)
    q, u = alone.to.mechanism_positions(j), alone.to.mechanism_speeds(v)
    return _recording(alone, problem, times, q, u)


def _moved(alone: Alone, problem: Problem) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, coordinates of OpenSim's joints and their rates."""
    options, built = alone.options, alone.built
    manager = osim.Manager(built.model)
    manager.setIntegratorMethod(getattr(osim.Manager, f"IntegratorMethod_{options.integrator}"))
    manager.setIntegratorAccuracy(options.accuracy)
    built.state.setTime(0.0)
    manager.initialize(built.state)
    if options.samples == "own steps":
        manager.integrate(problem.duration)
        table = manager.getStatesTable()
        paths = [coordinate.getAbsolutePathString() for coordinate in built.moving]
        j, v = (
            np.array([table.getDependentColumn(f"{path}/{kind}").to_numpy() for path in paths]).T
            for kind in ("value", "speed")
        )
        return np.array(table.getIndependentColumn()), j, v
    manager.setWriteToStorage(False)
    steps = whole_steps(problem.duration, options.timestep)
    states = [
        tuple(each.tolist() for each in _joint_state(alone, *initial_state(problem.mechanism)))
    ]
    for k in range(1, steps + 1):
        state = manager.integrate(k * options.timestep)
        values = [coordinate.getValue(state) for coordinate in built.moving]
        states.append((values, [coordinate.getSpeedValue(state) for coordinate in built.moving]))
    j, v = (np.array(values) for values in zip(*states, strict=True))
    return options.timestep * np.arange(steps + 1, dtype=np.float64), j, v


def _joint_state(alone: Alone, q: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    return alone.to.positions(q), alone.to.speeds(u)


@timed_reading()
def _recording(
    alone: Alone, problem: Problem, times: FloatArray, q: FloatArray, u: FloatArray
) -> Recording:
    """Read the model in the states of a run."""
    built, reader = alone.built, Reader(alone.built)
    springs = AppliedForces(Kinematics(problem.mechanism))
    samples = Samples(problem)
    torques = {stop.name: np.zeros(len(times)) for stop in problem.mechanism.stops}
    for k, time in enumerate(times.tolist()):
        alone.place(q[k], u[k])
        seen = reader.observe(built.state)
        for name, force in alone.limit_forces.items():
            torque = alone.limits[name].sense * force.calcLimitForce(built.state)
            torques[name][k] = max(0.0, torque)
        of_loops = {name: _force_of(loop, built.state) for name, loop in alone.loops.items()}
        potential = _weight(built, seen, reader) + float(springs.potential_energy(q[k]))
        observed = Observation(
            seen.points, seen.kinetic_energy, potential, {**seen.reactions, **of_loops}
        )
        contacts = {name: float(torque[k]) for name, torque in torques.items()}
        samples.add(time, (q[k], u[k]), contacts, observed)
    return samples.own_recording("opensim")


def _weight(built: Built, seen: Observation, reader: Reader) -> float:
    """Potential energy of gravity [J]: OpenSim counts only some of its springs."""
    mechanism = built.mechanism
    gravity = np.array(mechanism.gravity_vector)
    centres = ((body.mass, reader.centre(built.state, body.name)) for body in mechanism.bodies)
    return -sum(mass * float(gravity @ centre) for mass, centre in centres)


def _force_of(loop: Any, state: Any) -> FloatArray:
    """Force of a joint's constraint on the child, world frame [N].

    Records have force and moment of each body, the parent's first, with the signs of Simbody's
    multipliers: those of the forces that they balance.
    """
    values = loop.getRecordValues(state)
    return -np.array([values.get(6), values.get(7)])


# --- The same run as a program


def script(problem: Problem, options: OpenSimEngine) -> str:
    """The run of :func:`run_alone` as a program of its own."""
    alone = Alone(problem.mechanism, options)
    start, start_speeds = _joint_state(alone, *initial_state(problem.mechanism))
    return filled_template(
        __name__,
        "alone.py.j2",
        osim=_document(alone.built.model),
        names=[coordinate.getName() for coordinate in alone.built.moving],
        start=start.tolist(),
        start_speeds=start_speeds.tolist(),
        integrator=options.integrator,
        accuracy=options.accuracy,
        own_steps=options.samples == "own steps",
        duration=problem.duration,
        timestep=options.timestep,
        steps=whole_steps(problem.duration, options.timestep),
        offsets=alone.to.positions(np.zeros(len(start))).tolist(),
        sums=alone.to.sums.tolist(),
    )


def _document(model: Any) -> str:
    """The model as OpenSim writes it into a file, without its comments."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mechanism.osim"
        model.printToXML(str(path))
        return re.sub(r"\s*<!--.*?-->", "", path.read_text(), flags=re.DOTALL)
