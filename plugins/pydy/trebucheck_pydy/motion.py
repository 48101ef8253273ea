"""PyDy's program of a mechanism, and the tree of joints that its equations are of."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from trebucheck.engines.events import ContactEvents, Contacts, whole_steps
from trebucheck.engines.protocol import Recording
from trebucheck.engines.study import filled_template
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.event_driver import Observation, Samples
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.joint_tree import TreeMotion
from trebucheck_toolkit.schemes import State


def program(mechanism: Mechanism, options: Any = None, duration: float = 0.0) -> str:
    """A mechanism's equations as a program; with options and a duration [s], a run by System."""
    to, (q, u) = JointCoordinates(mechanism), initial_state(mechanism)
    return filled_template(
        __name__,
        "alone.py.j2",
        text=repr,
        to=to,
        mechanism=mechanism,
        start=to.positions(q).tolist(),
        start_speeds=to.speeds(u).tolist(),
        options=options,
        steps=whole_steps(duration, options.timestep) if options else 0,
        duration=duration,
    )


class KaneTree:
    """Kane's equations of the tree with its loads, and what SymPy tells of a state."""

    def __init__(self, mechanism: Mechanism, text: str) -> None:
        """Execute a program, whose names are in `made`."""
        self.mechanism, self.coordinates = mechanism, JointCoordinates(mechanism)
        found: dict[str, Any] = {}
        exec(text, found)
        self.made = made = SimpleNamespace(**found)
        tree = found.get("tree") or made.kanes_method(u_ind=made.v)  # a run with loops has none
        self._matrix, self._forces = made.function(tree.mass_matrix), made.function(tree.forcing)
        self._opposites = made.function(tree.auxiliary_eqs, [speed.diff() for speed in made.v])
        points = [made.point(each.body, each.point) for each in mechanism.markers]
        points += [body.masscenter for body in made.bodies]
        vectors = [each for p in points for each in (p.pos_from(made.origin), p.vel(made.world))]
        parts = [each.dot(axis) for each in vectors for axis in (made.world.x, made.world.y)]
        kinetic_energy = sum(body.kinetic_energy(made.world) for body in made.bodies)
        self._seen = made.function([*parts, kinetic_energy, sum(made.energies)])

    def mass_matrix(self, j: FloatArray) -> FloatArray:
        """KanesMethod's `mass_matrix`."""
        return self._matrix(j, np.zeros_like(j)).reshape(len(j), len(j))

    def bias(self, j: FloatArray, v: FloatArray) -> FloatArray:
        """KanesMethod's `forcing`, with the opposite sign; it has the loads."""
        return -self._forces(j, v)

    def observe(self, j: FloatArray, v: FloatArray, a: FloatArray) -> Observation:
        """Points and energies; reactions by the auxiliary equations, without what holds loops."""
        *parts, kinetic, potential = self._seen(j, v)
        names = [each.name for each in self.mechanism.markers]
        points = np.reshape(parts, (-1, 2, 2))[: len(names)]
        joints = [joint.name for _, joint in self.coordinates.links]
        reactions = -self._opposites(j, v, a).reshape(-1, 2)
        return Observation(
            {name: (at, velocity) for name, (at, velocity) in zip(names, points, strict=True)},
            kinetic,
            potential,
            dict(zip(joints, reactions, strict=True)),
        )

    def centres(self, j: FloatArray) -> dict[str, FloatArray]:
        """Centre of mass of each body in the world [m]."""
        names = [body.name for body, _ in self.coordinates.links]
        points = self._seen(j, np.zeros_like(j))[:-2].reshape(-1, 2, 2)
        return dict(zip(names, points[-len(names) :, 0], strict=True))

    def total_mass(self) -> float:
        """Mass of SymPy's bodies [kg]."""
        return float(sum(body.mass.subs(self.made.constants) for body in self.made.bodies))


class KaneMotion(TreeMotion):
    """The tree in steps of DOP853; stops and loops held by multipliers."""

    def __init__(self, mechanism: Mechanism, tolerance: float, text: str = "") -> None:
        """Execute a program of the mechanism: the text, or else that of its equations alone."""
        tree = KaneTree(mechanism, text or program(mechanism))
        super().__init__(tree)
        bare = mechanism.model_copy(update={"force_elements": ()})  # SymPy has the loads
        self.applied, self.made = AppliedForces(Kinematics(bare)), tree.made
        # In a singular position of a loop no step is short enough: it has to be stepped over.
        atol = np.inf if mechanism.loop_joints else tolerance
        self.accuracy = {"rtol": tolerance, "atol": atol}

    def advance(self, state: State, step: float, held: Contacts) -> State:
        """The state a step [s] later, contacts and loops held."""

        def rates(x: FloatArray, _: float) -> FloatArray:
            q, u = np.split(x, 2)
            return np.concatenate([u, self.solve(q, u, held).accelerations])

        _, after = self.made.dop853(rates, np.concatenate(state), (0.0, step), **self.accuracy)
        return self.projected(*np.split(after, 2), held)


def run_system(problem: Problem, options: Any) -> Recording:
    """Execute the program of a run, and read its states by its equations."""
    text, samples = program(problem.mechanism, options, problem.duration), Samples(problem)
    motion = KaneMotion(problem.mechanism, options.tolerance, text)
    made = motion.made
    for t, q, u in zip(made.t.tolist(), made.q, made.u, strict=True):
        samples.add(t, (q, u), {}, motion.observe(q, u, motion.solve(q, u, ())))
    samples.steps = len(made.t) - 1
    return samples.recording(ContactEvents(problem.mechanism, "pydy"))
