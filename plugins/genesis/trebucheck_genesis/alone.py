"""A problem as the program that Genesis runs, with its MJCF model, and what is read of it.

The plane is Genesis's x-z plane, and a hinge about `0 1 0` is positive clockwise. The model is the
tree of joints and its loops, as trebucheck's writer has them. A joint reads zero at the start; one
with a spring reads zero at its rest angle, as Genesis's joint springs do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from trebucheck.engines.events import whole_steps
from trebucheck.engines.protocol import Recording
from trebucheck.engines.reading import timed_reading
from trebucheck.engines.study import filled_template
from trebucheck.models import elements
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.mjcf.variants import Numerics, Variant
from trebucheck.models.mjcf.writer import mjcf, mjcf_names
from trebucheck.models.problem import Problem, StopLaw
from trebucheck_toolkit.event_driver import Observation, Samples
from trebucheck_toolkit.given_forces import program, springs_of_joints
from trebucheck_toolkit.joint_coordinates import JointCoordinates, Limit
from trebucheck_toolkit.joint_tree import JointLimits
from trebucheck_toolkit.mujoco_models import tree_of
from trebucheck_toolkit.node_scene import lawful_stops
from trebucheck_toolkit.slot_carriers import with_carriers

if TYPE_CHECKING:
    from .engine import GenesisEngine

_LOOPS = "our adapter closes loops by Genesis's `connect` alone"
_CLOSING: elements.ElementTable[bool] = elements.ElementTable(
    "genesis", elements.JOINTS, {elements.PinJoint: True}, others=_LOOPS
)


class Plan:
    """Parts of a problem that Genesis is given.

    Raises:
        UnsupportedProblemError: a stop is on no joint, or no joint is built that closes a loop.
    """

    def __init__(self, problem: Problem, options: GenesisEngine) -> None:
        self.problem, self.options = problem, options
        self.mechanism = with_carriers(problem.mechanism)
        for joint in self.mechanism.loop_joints:
            _CLOSING[joint]  # refuses by name
        self.to = JointCoordinates(self.mechanism)
        q, u = initial_state(self.mechanism)
        self.start, self.speeds = self.to.positions(q), self.to.speeds(u)
        springs = springs_of_joints(self.to)
        self.springs = dict(springs.values())
        self.zeros = self.start.copy()
        """Joint coordinates where Genesis's read zero."""
        for index, (_, rest, _) in self.springs.items():
            self.zeros[index] = rest
        given = [each for each in self.mechanism.force_elements if each.name not in springs]
        self.given = {"force_elements": tuple(given)}
        """Springs and loads that are given as forces before each step."""
        limits = JointLimits(self.to, "genesis").limits
        self.stops = {stop.name: limits[stop.name] for stop in lawful_stops(problem)}

    def program(self) -> str:
        """The run as a program with nothing but Genesis and NumPy."""
        mechanism, options, problem = self.mechanism, self.options, self.problem
        zeros = tuple(self.to.mechanism_positions(self.zeros).tolist())
        without = {"stops": (), "force_elements": ()}  # the program sets limits and springs
        model = mechanism.model_copy(update=without | {"start": zeros})
        names, given = mjcf_names(model), mechanism.model_copy(update=self.given)
        written = Variant(numerics=Numerics(solimp=options.solimp), sensors=False)
        definitions, forces = program(given)
        origins = {body.name: joint.child_point for body, joint in self.to.links}
        return filled_template(
            __name__,
            "alone.py.j2",
            plan=self,
            options=options,
            own=options.default_options,
            mjcf=mjcf(model, variant=written),
            links={body.name: names[body.name] for body in mechanism.bodies},
            markers=[
                (each.name, each.body, complex(*np.subtract(each.point, origins[each.body])))
                for each in mechanism.markers
            ],
            steps=whole_steps(problem.duration, options.timestep),
            known=len(problem.mechanism.coordinates),
            ranges=Limit.ranges(self.stops.values()),
            drops=problem.stop_law is StopLaw.RELEASE_ONCE and not options.keep_limits,
            definitions=definitions,
            forces=forces,
        )

    def executed(self) -> dict[str, Any]:
        """Names of the program, after it."""
        found = dict[str, Any]()
        exec(self.program(), found)
        return found

    def run(self) -> Recording:
        """Run the program, and read what it has noted."""
        found, samples = self.executed(), Samples(self.problem)
        with timed_reading():
            pushed = self.problem.mechanism.model_copy(update=self.given)
            energies = AppliedForces(Kinematics(pushed)).potential_energy(found["q"])
            noted = (found[name] for name in ("t", "q", "u", "torques", "looks"))
            for t, q, u, torques, look, energy in zip(*noted, energies, strict=True):
                kinetic, potential, points = look
                seen = Observation(points, kinetic, potential + energy)
                samples.add(float(t), (q, u), dict(zip(self.stops, torques, strict=True)), seen)
            return samples.own_recording("genesis")


class Tree:
    """Genesis's dynamics of the tree, without its limits, loops and springs."""

    def __init__(self, mechanism: Mechanism, options: GenesisEngine) -> None:
        plan = Plan(Problem(tree_of(mechanism), duration=options.timestep), options)
        self.coordinates, self.found = JointCoordinates(mechanism), plan.executed()

    def _told(self, name: str, **given: Any) -> FloatArray:
        told = getattr(self.found["entity"], f"get_{name}")(**given)
        return np.asarray(self.found["array"](told))

    def _step(self, j: FloatArray, v: FloatArray) -> None:
        """Take a step; Genesis keeps the mass matrix and accelerations at its start."""
        self.found["set_state"](j, v)
        self.found["scene"].step()

    def mass_matrix(self, j: FloatArray) -> FloatArray:
        """Mass matrix of the joint coordinates."""
        self._step(j, np.zeros_like(j))
        return self._told("mass_mat")

    def bias(self, j: FloatArray, v: FloatArray) -> FloatArray:
        """Bias forces, from the accelerations."""
        self._step(j, v)
        return -self._told("mass_mat") @ self._told("dofs_acc")

    def centres(self, j: FloatArray) -> dict[str, FloatArray]:
        """Centre of mass of each body in the world [m]."""
        self.found["set_state"](j, np.zeros_like(j))
        told = self._told("links_pos", ref=self.found["gs"].link_ref_frame.link_COM)
        return {name: told[k, [0, 2]] for name, k in self.found["LINKS"].items()}

    def total_mass(self) -> float:
        """Mass of all bodies [kg]."""
        return float(self._told("links_mass").sum())
