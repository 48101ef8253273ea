"""Drake by itself: a plant, a simulator from start to end, and what is read of it.

The plant has time steps; it is continuous, with Drake's integrator, where that is asked for and
nothing has to be held or given: such a plant has no limits and no constraints. Stops are limits of
Drake's joints, pins that close loops its ball constraints, slots that do slides of carriers that
are pinned to the child; springs with a length between points, and torsion springs between bodies
that a joint without limits connects, are its force elements. The forces of others, and of loads,
are given before each step. All of it stays in the plant whatever the law. What is Drake's default
is not set. :func:`script` gives the same run as a program.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from trebucheck.engines.events import whole_steps
from trebucheck.engines.protocol import Recording
from trebucheck.engines.study import filled_template
from trebucheck.models import elements
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.event_driver import Observation, Samples
from trebucheck_toolkit.given_forces import GivenForces, program, springs_of_joints
from trebucheck_toolkit.joint_coordinates import JointCoordinates, Limit
from trebucheck_toolkit.joint_tree import JointLimits
from trebucheck_toolkit.loop_pins import LoopPins, left_over
from trebucheck_toolkit.schemes import State
from trebucheck_toolkit.slot_carriers import slot_forces, with_carriers

from .build import Built, add_link, has_length, in_space, link_of
from .read import Reader, in_plane

if TYPE_CHECKING:
    from .engine import DrakeEngine

_ROUNDING = 1e-10  # of the largest reaction: what is left of a torque about an axis without a limit


class Alone(Built):
    """A mechanism's discrete plant, with a simulator at its start."""

    def __init__(self, mechanism: Mechanism, options: DrakeEngine) -> None:
        self.options, mechanism = options, with_carriers(mechanism)
        self.continuous = options.continuous_plant and is_free(mechanism)
        super().__init__(mechanism, 0.0 if self.continuous else options.timestep)
        to, plant = self.coordinates, self.plant
        self.limits = JointLimits(to, "drake").limits
        self.ranges = Limit.ranges(self.limits.values())
        for index, (low, high) in self.ranges.items():
            self.moving[index].set_position_limits([low], [high])
        self.pins = [_CLOSING[joint](joint) for joint in mechanism.loop_joints]
        for joint in self.pins:
            plant.AddBallConstraint(
                *self.end(joint.parent, joint.parent_point),
                *self.end(joint.child, joint.child_point),
            )
        self.add_springs(but=self.ranges)
        self.forces, self.given = GivenForces(self.pushed), list[Any]()

    def start(self) -> None:
        """End the building, and begin at the mechanism's start."""
        self.finalize()
        self.simulator: Any = Simulator(self.plant)
        if self.continuous:
            ApplySimulatorConfig(SimulatorConfig(**integration(self.options)), self.simulator)
        self.context: Any = self.simulator.get_mutable_context()
        (q, u), to = initial_state(self.mechanism), self.coordinates
        self.plant.SetPositions(self.context, self.in_order(to.positions(q), self.positions))
        self.plant.SetVelocities(self.context, self.in_order(to.speeds(u), self.speeds))
        self.give_forces()

    def state(self) -> State:
        """The joint coordinates and speeds."""
        values, n = self.plant.GetPositionsAndVelocities(self.context), self.plant.num_positions()
        return values[:n][self.positions], values[n:][self.speeds]

    def give_forces(self) -> None:
        """Give the bodies the forces of springs and loads in the present state."""
        if not self.pushed.force_elements:
            return
        j, v = self.state()
        to, self.given = self.coordinates, []
        self.forces.give(self, to.mechanism_positions(j), to.mechanism_speeds(v))
        port = self.plant.get_applied_spatial_force_input_port()
        port.FixValue(self.context, Value[list[ExternallyAppliedSpatialForce]](self.given))

    def step(self, end: float) -> None:
        """Go on to the end of a step [s]."""
        self.simulator.AdvanceTo(end)
        self.give_forces()

    # --- Bodies, as forces are given to them

    def centre(self, name: str) -> tuple[complex, complex]:
        """Place [m] and velocity [m/s] of a body's centre of mass."""
        body, context = self.bodies[name], self.context
        place = body.CalcCenterOfMassInBodyFrame(context)
        place = body.EvalPoseInWorld(context) @ place
        velocity = body.CalcCenterOfMassTranslationalVelocityInWorld(context)
        return complex(*place[:2]), complex(*velocity[:2])

    def push(self, name: str, place: complex, force: complex) -> None:
        """Give a body a force [N] at a place [m] for the next step."""
        origin = complex(*self.bodies[name].EvalPoseInWorld(self.context).translation()[:2])
        turning = ((place - origin).conjugate() * force).imag
        self._give(name, (0.0, 0.0, turning), (force.real, force.imag, 0.0))

    def twist(self, name: str, torque: float) -> None:
        """Give a body a clockwise torque [N m] for the next step."""
        self._give(name, (0.0, 0.0, -torque), (0.0, 0.0, 0.0))

    def _give(self, name: str, torque: tuple[float, ...], force: tuple[float, ...]) -> None:
        given = ExternallyAppliedSpatialForce()
        given.body_index = self.bodies[name].index()
        given.F_Bq_W = SpatialForce(np.array(torque), np.array(force))
        self.given.append(given)


def is_free(mechanism: Mechanism) -> bool:
    """Tell whether a continuous plant has all of it: no stops, no loops, springs of Drake's."""
    if mechanism.stops or mechanism.loop_joints:
        return False
    own = springs_of_joints(JointCoordinates(mechanism))
    return all(has_length(each) or each.name in own for each in mechanism.force_elements)


def integration(options: DrakeEngine) -> dict[str, Any]:
    """Fields of Drake's `SimulatorConfig` for a continuous plant."""
    return {
        "integration_scheme": options.integrator,
        "max_step_size": options.timestep,
        "accuracy": options.accuracy,
        "use_error_control": True,
    }


def _this(joint: elements.PinJoint) -> elements.PinJoint:
    return joint


_LOOPS = "our adapter closes loops by pins and slots; Drake has further constraints"
_CLOSING: elements.ElementTable[Callable[[Any], elements.PinJoint]] = elements.ElementTable(
    "drake by itself", elements.JOINTS, {elements.PinJoint: _this}, others=_LOOPS
)


# --- A run


def run_alone(problem: Problem, options: DrakeEngine) -> Recording:
    """Step Drake from the start to a problem's end or just beyond, and read it.

    Forces at an instant are those of the step that begins there. Drake tells those of the tree's
    joints, and counts what its ball constraints exert; the forces of these follow from Newton's law
    of the bodies, by Drake's accelerations and reactions.

    Raises:
        UnsupportedProblemError: a loop is closed by neither a pin nor a slot, or the force of such
            a pin does not follow; or a stop is on no joint.
    """
    mechanism = problem.mechanism
    alone = Alone(mechanism, options)
    if not alone.continuous:  # outputs are to be those of the present state, not of the last step
        alone.plant.SetUseSampledOutputPorts(False)
    alone.start()
    reader = _Reader(alone)
    steps = whole_steps(problem.duration, options.timestep)
    times: FloatArray = options.timestep * np.arange(steps + 1, dtype=np.float64)
    states = [alone.state()]
    seen = [reader.observe()]
    for time in times[1:]:
        alone.step(float(time))
        states.append(alone.state())
        seen.append(reader.observe())
    j, v = (np.array(values) for values in zip(*states, strict=True))
    to = alone.coordinates
    q, u = to.mechanism_positions(j), to.mechanism_speeds(v)
    known = len(mechanism.coordinates)  # without those of carriers
    pins = reader.forces_of_pins(q, u, [observation for _, observation in seen])
    given = reader.applied.potential_energy(q)
    samples = Samples(problem)
    for k, time in enumerate(times):
        contacts, observation = seen[k]
        observation = replace(
            observation,
            potential_energy=observation.potential_energy + float(given[k]),
            reactions=slot_forces(
                mechanism,
                {**observation.reactions, **{name: force[k] for name, force in pins.items()}},
            ),
        )
        samples.add(float(time), (q[k, :known], u[k, :known]), contacts, observation)
    return samples.own_recording("drake")


class _Reader:
    """Reads a plant in its present state."""

    def __init__(self, alone: Alone) -> None:
        self.alone, self.reader = alone, Reader(alone)
        self.applied = AppliedForces(Kinematics(alone.pushed))
        """Of the springs and loads whose energy Drake does not count, as it does its own."""
        self.pins = LoopPins(alone.mechanism, "drake")
        self.accelerations: dict[str, list[FloatArray]] = {name: [] for name in self.pins.bodies}
        self._centres = {body.name: np.array(body.centre) for body in alone.mechanism.bodies}

    def observe(self) -> tuple[dict[str, float], Observation]:
        """Torque of each limit [N m], and points, energies and reactions.

        The torque is the reaction's about the joint's axis, with z opposed to it.
        """
        alone, context = self.alone, self.alone.context
        forces = alone.plant.get_reaction_forces_output_port().Eval(context)
        torques: dict[str, float] = {}
        if alone.limits:
            greatest = max(float(np.abs(each.get_coeffs()).max()) for each in forces)
            for name, limit in alone.limits.items():
                turning = forces[int(alone.moving[limit.index].index())].rotational()[2]
                torque = -limit.sense * float(turning)
                torques[name] = torque if torque > _ROUNDING * greatest else 0.0
        if self.accelerations:
            rates = alone.plant.get_body_spatial_accelerations_output_port().Eval(context)
            for name, found in self.accelerations.items():
                found.append(self._of_centre(name, rates[int(alone.bodies[name].index())]))
        return torques, self.reader.observe(context, forces)

    def _of_centre(self, name: str, rate: Any) -> FloatArray:
        """Acceleration of a body's centre of mass [m/s^2], from that of its frame."""
        body, context = self.alone.bodies[name], self.alone.context
        arm = in_plane(body.EvalPoseInWorld(context).rotation()) @ self._centres[name]
        spin = body.EvalSpatialVelocityInWorld(context).rotational()
        return rate.Shift(in_space(arm), spin).translational()[:2]

    def forces_of_pins(
        self, q: FloatArray, u: FloatArray, seen: Sequence[Observation]
    ) -> dict[str, FloatArray]:
        """Force of each pin that closes a loop on its child in each state [N], shape (n, 2)."""
        if not self.accelerations:
            return {}
        mechanism = self.alone.mechanism
        resultants = left_over(
            mechanism,
            {name: np.array(found) for name, found in self.accelerations.items()},
            {name: np.array([each.reactions[name] for each in seen]) for name in seen[0].reactions},
            AppliedForces(Kinematics(mechanism)).on_bodies(q, u),
        )
        return self.pins.forces(resultants)


# --- The run as a program


def script(problem: Problem, options: DrakeEngine) -> str:
    """The run of :func:`run_alone` as a program of its own."""
    alone = Alone(problem.mechanism, options)
    mechanism = alone.mechanism
    alone.finalize()
    (q, u), to = initial_state(mechanism), alone.coordinates
    definitions, forces = program(alone.pushed)
    return filled_template(
        __name__,
        "alone.py.j2",
        gravity=[*mechanism.gravity_vector, 0.0],
        timestep=options.timestep,
        continuous=alone.continuous,
        integration=integration(options),
        steps=whole_steps(problem.duration, options.timestep),
        definitions=[inspect.getsource(add_link)],
        links=[tuple(link_of(*each)) for each in to.links],
        ranges={k: [_written(value) for value in ends] for k, ends in alone.ranges.items()},
        pins=alone.pins,
        joint_springs=list(alone.joint_springs.values()),
        springs=alone.springs,
        positions=alone.positions.tolist(),
        speeds=alone.speeds.tolist(),
        start=alone.in_order(to.positions(q), alone.positions).tolist(),
        start_speeds=alone.in_order(to.speeds(u), alone.speeds).tolist(),
        offsets=to.offsets.tolist(),
        sums=to.sums[: len(problem.mechanism.coordinates)].tolist(),
        force_definitions=definitions if forces else [],
        forces=forces,
    )


def _written(value: float) -> str:
    return repr(value) if np.isfinite(value) else f"float('{value}')"
