"""A mechanism as a scene, and the tree of joints that its equations are of."""

from __future__ import annotations

import inspect
import pprint
from typing import Any

import numpy as np
from trebucheck.engines.events import ContactEvents, Contacts, whole_steps
from trebucheck.engines.protocol import Recording
from trebucheck.models import elements
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.event_driver import Observation, Samples
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.joint_tree import TreeMotion
from trebucheck_toolkit.schemes import State

from . import kane
from .kane import Equations, dop853

LOADS: elements.ElementTable[str] = elements.ElementTable(
    "pydy",
    elements.FORCE_ELEMENTS,
    {
        elements.SpringDamper: "spring",
        elements.ConstantForce: "force",
        elements.RotationalSpringDamper: "torque",
        elements.CubicTorsionSpring: "torque",
        elements.ConstantTorque: "torque",
    },
    others="our adapter gives SymPy no such load; SymPy takes any expression",
)
"""The method of `Equations` that adds a load."""


def scene(to: JointCoordinates) -> dict[str, Any]:
    """The mechanism as plain data, in joint coordinates."""
    bodies, (q, u), k = list[Any](), initial_state(to.mechanism), 0
    for body, joint in to.links:
        slides = list(enumerate(joint.free_directions, k))
        k += len(slides)
        turn = (None, joint.turned_by) if body.angle is None else (k, 0.0)
        k += body.angle is not None
        place = joint.parent, joint.parent_point, joint.child_point, slides, turn
        bodies.append((body.name, body.mass, body.inertia, body.centre, *place))
    loops: list[Any] = []
    for joint in to.mechanism.loop_joints:
        ends = (joint.child, joint.child_point), (joint.parent, joint.parent_point)
        frame = joint.parent if joint.free_directions else GROUND
        loops.append((*ends, frame, joint.held_directions, joint.turned_by))
    return {
        "bodies": bodies,
        "loops": loops,
        "loads": [
            (LOADS[each], each.model_dump(exclude={"name", "kind"}))
            for each in to.mechanism.force_elements
        ],
        "gravity": tuple(to.mechanism.gravity_vector),
        "start": to.positions(q).tolist(),
        "start_speeds": to.speeds(u).tolist(),
    }


class KaneTree:
    """Kane's equations of the tree with its loads, and what SymPy tells of a state."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism, self.coordinates = mechanism, JointCoordinates(mechanism)
        self.equations = equations = Equations(scene(self.coordinates))
        tree, world, origin = equations.tree, equations.world, equations.origins[GROUND]
        self._matrix = equations.function(tree.mass_matrix)
        self._forces = equations.function(tree.forcing)
        read = [equations.point(each.body, each.point) for each in mechanism.markers]
        motions = [vector for p in read for vector in (p.pos_from(origin), p.vel(world))]
        centres = [body.masscenter.pos_from(origin) for body in equations.bodies]
        self._points, self._centres = (
            equations.function([each.dot(axis) for each in vectors for axis in (world.x, world.y)])
            for vectors in (motions, centres)
        )
        kinetic_energy = sum(body.kinetic_energy(world) for body in equations.bodies)
        self._energies = equations.function([kinetic_energy, equations.potential_energy])
        rates = [speed.diff() for speed in equations.u]
        self._opposites = equations.function(tree.auxiliary_eqs, rates)

    def mass_matrix(self, j: FloatArray) -> FloatArray:
        """KanesMethod's `mass_matrix`."""
        return self._matrix(j, np.zeros_like(j)).reshape(len(j), len(j))

    def bias(self, j: FloatArray, v: FloatArray) -> FloatArray:
        """KanesMethod's `forcing`, with the opposite sign; it has the loads."""
        return -self._forces(j, v)

    def observe(self, j: FloatArray, v: FloatArray, a: FloatArray) -> Observation:
        """Points and energies; reactions by the auxiliary equations, without what holds loops."""
        points, (kinetic, potential) = self._points(j, v).reshape(-1, 2, 2), self._energies(j, v)
        names = [each.name for each in self.mechanism.markers]
        joints = [joint.name for _, joint in self.coordinates.links]
        return Observation(
            {name: (at, velocity) for name, (at, velocity) in zip(names, points, strict=True)},
            kinetic,
            potential,
            dict(zip(joints, -self._opposites(j, v, a).reshape(-1, 2), strict=True)),
        )

    def centres(self, j: FloatArray) -> dict[str, FloatArray]:
        """Centre of mass of each body in the world [m]."""
        names = [body.name for body, _ in self.coordinates.links]
        return dict(zip(names, self._centres(j, np.zeros_like(j)).reshape(-1, 2), strict=True))

    def total_mass(self) -> float:
        """Mass of SymPy's bodies [kg]."""
        equations = self.equations
        return float(sum(body.mass.subs(equations.constants) for body in equations.bodies))


class KaneMotion(TreeMotion):
    """The tree in steps of DOP853; stops and loops held by multipliers."""

    def __init__(self, mechanism: Mechanism, tolerance: float) -> None:
        super().__init__(KaneTree(mechanism))
        # Springs and loads are in SymPy's equations.
        bare = mechanism.model_copy(update={"force_elements": ()})
        self.applied = AppliedForces(Kinematics(bare))
        # In a singular position of a loop no step is short enough: it has to be stepped over.
        atol = np.inf if mechanism.loop_joints else tolerance
        self.accuracy = {"rtol": tolerance, "atol": atol}

    def advance(self, state: State, step: float, held: Contacts) -> State:
        """The state a step [s] later, contacts and loops held."""

        def rates(x: FloatArray, _: float) -> FloatArray:
            q, u = np.split(x, 2)
            return np.concatenate([u, self.solve(q, u, held).accelerations])

        q, u = np.split(dop853(rates, np.concatenate(state), (0.0, step), **self.accuracy)[-1], 2)
        return self.projected(q, u, held)


def run_system(problem: Problem, timestep: float, integrator: str, tolerance: float) -> Recording:
    """Move a problem by PyDy's System to its end, and read it by the equations."""
    motion = KaneMotion(problem.mechanism, tolerance)
    to, samples = motion.tree.coordinates, Samples(problem)
    steps = whole_steps(problem.duration, timestep)
    times = np.minimum(timestep * np.arange(steps + 1.0), problem.duration)
    j, v = motion.tree.equations.integrate(times, integrator, tolerance)
    for t, q, u in zip(times, (j - to.offsets) @ to.sums.T, v @ to.sums.T, strict=True):
        solved = motion.solve(q, u, ())
        samples.add(float(t), (q, u), {}, motion.observe(q, u, solved))
    samples.steps = steps
    return samples.recording(ContactEvents(problem.mechanism, "pydy"))


def script(problem: Problem, timestep: float, integrator: str, tolerance: float) -> str:
    """The run of :func:`run_system` as a program with PyDy, SymPy, SciPy and NumPy alone."""
    to, steps = JointCoordinates(problem.mechanism), whole_steps(problem.duration, timestep)
    return (
        f"{inspect.getsource(kane)}\n\n"
        f"SCENE = {pprint.pformat(scene(to), width=96, sort_dicts=False)}\n"
        f"t = np.minimum({timestep!r} * np.arange({steps} + 1.0), {problem.duration!r})\n"
        f"j, v = Equations(SCENE).integrate(t, {integrator!r}, {tolerance!r})\n"
        f"sums = np.array({to.sums.tolist()})  # of turns from the parent to turns in the world\n"
        f"q, u = (j - np.array({to.offsets.tolist()})) @ sums.T, v @ sums.T\n"
    )
