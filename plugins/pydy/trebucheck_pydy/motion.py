"""A mechanism as a scene, and the tree of joints that its equations are of."""

from __future__ import annotations

import inspect
import pprint
from collections.abc import Callable
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


def _torque(each: Any, constant: float, stiffness: float, cubic: float, damping: float) -> Any:
    rest = getattr(each, "rest_angle", 0.0)
    return ("torque", each.body, each.relative_to, constant, stiffness, cubic, damping, rest)


LOADS: elements.ElementTable[Callable[[Any], Any]] = elements.ElementTable(
    "pydy",
    elements.FORCE_ELEMENTS,
    {
        elements.SpringDamper: lambda e: (
            *("spring", *e.ends),
            *(e.stiffness, e.damping, e.rest_length),
        ),
        elements.RotationalSpringDamper: lambda e: _torque(e, 0.0, e.stiffness, 0.0, e.damping),
        elements.CubicTorsionSpring: lambda e: _torque(e, 0.0, e.stiffness, e.cubic_stiffness, 0.0),
        elements.ConstantTorque: lambda e: _torque(e, e.torque, 0.0, 0.0, 0.0),
        elements.ConstantForce: lambda e: ("force", e.body, e.point, e.force),
    },
    others="our adapter gives SymPy no such load; SymPy takes any expression",
)


def _pairs(directions: Any) -> list[tuple[float, float]]:
    return [(complex(each).real, complex(each).imag) for each in directions]


def scene(to: JointCoordinates) -> dict[str, Any]:
    """The mechanism as plain data, in joint coordinates."""
    mechanism, bodies, k = to.mechanism, list[Any](), 0
    q, u = initial_state(mechanism)
    for body, joint in to.links:
        slides = list(enumerate(_pairs(joint.free_directions), k))
        k += len(slides)
        turn = None if body.angle is None else k
        k += body.angle is not None
        ends = (joint.parent_point, joint.child_point)
        bodies.append(
            (body.name, body.mass, body.inertia, body.centre)
            + (joint.parent, ends, slides, turn, joint.turned_by or 0.0)
        )
    loops = [
        ((joint.child, joint.child_point), (joint.parent, joint.parent_point))
        + (joint.parent if joint.free_directions else GROUND, _pairs(joint.held_directions))
        + (joint.turned_by,)
        for joint in mechanism.loop_joints
    ]
    return {
        "bodies": bodies,
        "loops": loops,
        "loads": [LOADS[each](each) for each in mechanism.force_elements],
        "gravity": tuple(mechanism.gravity_vector),
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
        places = [(each.body, each.point) for each in mechanism.markers]
        points = [equations.point(*place) for place in places]
        centres = [body.masscenter for body in equations.bodies]
        read = [each for p in points for each in (p.pos_from(origin), p.vel(world))]
        read += [each.pos_from(origin) for each in centres]
        values = [vector.dot(axis) for vector in read for axis in (world.x, world.y)]
        energy = sum(body.kinetic_energy(world) for body in equations.bodies)
        self._readings = equations.function(
            [*values, *(-each for each in tree.auxiliary_eqs), energy, equations.potential_energy],
            [speed.diff() for speed in equations.u],
        )

    def mass_matrix(self, j: FloatArray) -> FloatArray:
        """KanesMethod's `mass_matrix`."""
        return self._matrix(j, np.zeros_like(j)).reshape(len(j), len(j))

    def bias(self, j: FloatArray, v: FloatArray) -> FloatArray:
        """KanesMethod's `forcing`, with the opposite sign; it has the loads."""
        return -self._forces(j, v)

    def observe(self, j: FloatArray, v: FloatArray, a: FloatArray) -> Observation:
        """Points and energies; reactions by the auxiliary equations, without what holds loops."""
        values = self._readings(j, v, a)
        pairs, n, links = (
            values[:-2].reshape(-1, 2),
            len(self.mechanism.markers),
            self.coordinates.links,
        )
        return Observation(
            {
                each.name: (pairs[2 * k], pairs[2 * k + 1])
                for k, each in enumerate(self.mechanism.markers)
            },
            float(values[-2]),
            float(values[-1]),
            {joint.name: pairs[2 * n + len(links) + k] for k, (_, joint) in enumerate(links)},
        )

    def centres(self, j: FloatArray) -> dict[str, FloatArray]:
        """Centre of mass of each body in the world [m]."""
        none = np.zeros_like(j)
        pairs = self._readings(j, none, none)[:-2].reshape(-1, 2)[2 * len(self.mechanism.markers) :]
        return {body.name: pairs[k] for k, (body, _) in enumerate(self.coordinates.links)}

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
        self.accuracy = {"rtol": tolerance, "atol": np.inf if mechanism.loop_joints else tolerance}

    def advance(self, state: State, step: float, held: Contacts) -> State:
        """The state a step [s] later, contacts and loops held."""

        def rates(x: FloatArray, _: float) -> FloatArray:
            q, u = np.split(x, 2)
            return np.concatenate([u, self.solve(q, u, held).accelerations])

        q, u = np.split(dop853(rates, np.concatenate(state), (0.0, step), **self.accuracy)[-1], 2)
        return self.projected(q, u, held)


def run_system(problem: Problem, timestep: float, integrator: str, tolerance: float) -> Recording:
    """Move a problem by PyDy's System to its end or just beyond, and read it by the equations."""
    motion = KaneMotion(problem.mechanism, tolerance)
    to, samples = motion.tree.coordinates, Samples(problem)
    times = timestep * np.arange(whole_steps(problem.duration, timestep) + 1.0)
    j, v = motion.tree.equations.integrate(times, integrator, tolerance)
    for t, q, u in zip(times, (j - to.offsets) @ to.sums.T, v @ to.sums.T, strict=True):
        solved = motion.solve(q, u, ())
        samples.add(float(t), (q, u), {}, motion.observe(q, u, solved))
    samples.steps = len(times) - 1
    return samples.recording(ContactEvents(problem.mechanism, "pydy"))


def script(problem: Problem, timestep: float, integrator: str, tolerance: float) -> str:
    """The run of :func:`run_system` as a program with PyDy, SymPy, SciPy and NumPy alone."""
    to, steps = JointCoordinates(problem.mechanism), whole_steps(problem.duration, timestep)
    return (
        f"{inspect.getsource(kane)}\n\n"
        f"SCENE = {pprint.pformat(scene(to), width=96, sort_dicts=False)}\n"
        f"t = {timestep!r} * np.arange({steps} + 1.0)\n"
        f"j, v = Equations(SCENE).integrate(t, {integrator!r}, {tolerance!r})\n"
        f"sums = np.array({to.sums.tolist()})  # of turns from the parent to turns in the world\n"
        f"q, u = (j - np.array({to.offsets.tolist()})) @ sums.T, v @ sums.T\n"
    )
