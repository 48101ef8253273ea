"""A mechanism as a scene, and its equations moved and read; states are in its coordinates."""

from __future__ import annotations

import inspect
import pprint
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from trebucheck.engines.events import ContactEvents, Contacts, whole_steps
from trebucheck.engines.inspection import Dynamics, Inspection, State
from trebucheck.engines.protocol import Recording
from trebucheck.models import elements
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.constrained import ConstrainedDynamics, Solved, subtree_sums
from trebucheck_toolkit.event_driver import Observation, Samples

from . import kane
from .kane import Equations, dop853


def _torque(each: Any, constant: float, stiffness: float, cubic: float, damping: float) -> Any:
    law = (constant, stiffness, cubic, damping, getattr(each, "rest_angle", 0.0))
    return ("torque", each.name, each.body, each.relative_to, *law)


def _slide(each: elements.SlideSpringDamper, mechanism: Mechanism) -> Any:
    joint, (slide, direction) = mechanism.joint_of(each.body), _slides(mechanism)[each.coordinate]
    ends = (joint.child, joint.child_point), (joint.parent, joint.parent_point)
    law = (each.force, each.stiffness, 0.0, each.damping, each.rest_position)
    return ("slide", each.name, *ends, slide, direction, *law)


LOADS: elements.ElementTable[Callable[[Any, Mechanism], Any]] = elements.ElementTable(
    "pydy",
    elements.FORCE_ELEMENTS,
    {
        elements.SpringDamper: lambda e, _: (
            *("spring", e.name, *e.ends),
            *(e.stiffness, e.damping, e.rest_length),
        ),
        elements.RotationalSpringDamper: lambda e, _: _torque(e, 0.0, e.stiffness, 0.0, e.damping),
        elements.CubicTorsionSpring: lambda e, _: _torque(
            e, 0.0, e.stiffness, e.cubic_stiffness, 0.0
        ),
        elements.ConstantTorque: lambda e, _: _torque(e, e.torque, 0.0, 0.0, 0.0),
        elements.ConstantForce: lambda e, _: ("force", e.name, e.body, e.point, e.force),
        elements.SlideSpringDamper: _slide,
    },
    others="our adapter builds no rotor inertias and no recorded controls; SymPy takes any load",
)


def _slides(mechanism: Mechanism) -> dict[str, tuple[int, tuple[float, float]]]:
    """Index and direction of each slide coordinate."""
    indices = {name: k for k, name in enumerate(mechanism.coordinates)}
    return {
        name: (indices[name], _pair(direction))
        for joint in mechanism.tree_joints
        for name, direction in zip(joint.slides, joint.free_directions, strict=True)
    }


def _pair(direction: complex) -> tuple[float, float]:
    return (complex(direction).real, complex(direction).imag)


def scene(mechanism: Mechanism) -> dict[str, Any]:
    """The mechanism as plain data."""
    (q, u), slides = initial_state(mechanism), _slides(mechanism)
    bodies: list[dict[str, Any]] = []
    for joint in mechanism.tree.joints:
        body = mechanism.body(joint.child)
        along = [slides[name] for name in joint.slides]
        ends = (joint.parent, joint.parent_point, joint.child_point)
        bodies.append(
            {key: getattr(body, key) for key in ("name", "mass", "inertia", "centre")}
            | {"turn": mechanism.attitudes[body.name]}
            | {"joint": (*ends, along)}
        )
    return {
        "bodies": bodies,
        "loops": [
            (
                *(joint.name, (joint.child, joint.child_point)),
                *((joint.parent, joint.parent_point), list(map(_pair, joint.held_directions))),
                *(not joint.free_directions, joint.turned_by),
            )
            for joint in mechanism.loop_joints
        ],
        "loads": [LOADS[each](each, mechanism) for each in mechanism.force_elements],
        "gravity": tuple(mechanism.gravity_vector),
        "start": q.tolist(),
        "start_speeds": u.tolist(),
    }


class Model:
    """Kane's equations of the mechanism's tree with its loads, and what SymPy tells of a state."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism, self.equations = mechanism, Equations(scene(mechanism))
        equations, tree = self.equations, self.equations.tree
        self._dynamics = equations.function([*tree.mass_matrix, *tree.forcing])
        world, origin = equations.world, equations.origins[GROUND]
        places = [(each.body, each.point) for each in mechanism.markers]
        places += [(each.name, each.centre) for each in mechanism.bodies]
        points = [equations.point(*place, f"read_{k}") for k, place in enumerate(places)]
        read = [each for p in points for each in (p.pos_from(origin), p.vel(world))]
        values = [vector.dot(axis) for vector in read for axis in (world.x, world.y)]
        values += [-force for force in tree.auxiliary_eqs]
        energy = sum(body.kinetic_energy(world) for body in equations.bodies)
        self._readings = equations.function(
            [energy, equations.potential_energy, *values], [speed.diff() for speed in equations.u]
        )

    def dynamics(self, q: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mass matrix, and forces less those of Coriolis and centrifugal terms."""
        values, n = self._dynamics(q, u), len(q)
        return values[: n * n].reshape(n, n), values[n * n :]

    def accelerations(self, q: FloatArray, u: FloatArray, applied: FloatArray) -> FloatArray:
        """Accelerations by the generated equations."""
        matrix, forces = self.dynamics(q, u)
        return np.linalg.solve(matrix, forces + applied)

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """Generated mass matrix."""
        return self.dynamics(q, np.zeros_like(q))[0]

    def observe(self, q: FloatArray, u: FloatArray, a: FloatArray) -> Observation:
        """Readings; a joint's reaction by its auxiliary equations, with forces of loads alone."""
        values, mechanism = self._readings(q, u, a), self.mechanism
        n = len(mechanism.markers) + len(mechanism.bodies)
        points = values[2 : 2 + 4 * n].reshape(n, 2, 2)
        names = [each.name for each in (*mechanism.markers, *mechanism.bodies)]
        forces = values[2 + 4 * n :].reshape(-1, 2)
        joints = [joint.name for joint in mechanism.tree.joints]
        return Observation(
            {name: (points[k, 0], points[k, 1]) for k, name in enumerate(names)},
            *values[:2],
            dict(zip(joints, forces, strict=True)),
        )


class Motion(ConstrainedDynamics):
    """The equations in steps of SciPy's, stops and loops held by multipliers."""

    def __init__(self, mechanism: Mechanism, tolerance: float) -> None:
        self.model = Model(mechanism)
        super().__init__(mechanism, self.model)
        # Springs and loads are in the equations.
        bare = mechanism.model_copy(update={"force_elements": ()})
        self.applied = AppliedForces(Kinematics(bare))
        # In a singular position of a loop no step is short enough: it has to be stepped over.
        atol = np.inf if mechanism.loop_joints else tolerance
        self.accuracy = {"rtol": tolerance, "atol": atol}

    def advance(
        self, state: tuple[FloatArray, FloatArray], step: float, held: Contacts
    ) -> tuple[FloatArray, FloatArray]:
        """The state a step [s] later, contacts and loops held."""
        n = len(state[0])

        def rates(x: FloatArray, _: float) -> FloatArray:
            return np.concatenate([x[n:], self.solve(x[:n], x[n:], held).accelerations])

        after = dop853(rates, np.concatenate(state), (0.0, step), **self.accuracy)[-1]
        return self.projected(after[:n], after[n:], held)

    def observe(self, q: FloatArray, u: FloatArray, solved: Solved) -> Observation:
        """Points, energies and forces; those of what is held are taken from the reactions."""
        seen = self.model.observe(q, u, solved.accelerations)
        others = subtree_sums(self.mechanism, self.forces_on_bodies(q, u, solved))
        return replace(
            seen,
            points={each.name: seen.points[each.name] for each in self.mechanism.markers},
            reactions={
                joint.name: seen.reactions[joint.name] - others[joint.name]
                for joint in self.mechanism.tree_joints
                if joint.held_directions
            }
            | dict(solved.loops),
        )

    def inspect(self, states: Sequence[State]) -> Inspection:
        """The equations in each state, and the start and masses of the scene that they are of."""
        equations = self.model.equations
        return Inspection(
            start=np.array(equations.scene["start"]),
            start_speeds=np.array(equations.scene["start_speeds"]),
            dynamics=tuple(self._state(state) for state in states),
            total_mass=float(sum(body.mass.subs(equations.constants) for body in equations.bodies)),
        )

    def _state(self, state: State) -> Dynamics:
        solved = self.solve(state.q, state.u, state.closed)
        matrix, forces = self.model.dynamics(state.q, state.u)
        points = self.model.observe(state.q, state.u, solved.accelerations).points
        return Dynamics(
            accelerations=solved.accelerations,
            stop_torques=solved.contacts,
            mass_matrix=matrix,
            forces=forces,
            centres={each.name: points[each.name][0] for each in self.mechanism.bodies},
            stop_gaps={name: float(self.kinematics.gap(name, state.q)) for name in state.closed},
        )


def run_system(problem: Problem, timestep: float, integrator: str, tolerance: float) -> Recording:
    """Move a problem by PyDy's System to its end or just beyond, and read it by the equations."""
    motion = Motion(problem.mechanism, tolerance)
    times = timestep * np.arange(whole_steps(problem.duration, timestep) + 1.0)
    samples = Samples(problem)
    for t, q, u in zip(
        times, *motion.model.equations.integrate(times, integrator, tolerance), strict=True
    ):
        solved = motion.solve(q, u, ())
        samples.add(float(t), (q, u), solved.contacts, motion.observe(q, u, solved))
    samples.steps = len(times) - 1
    return samples.recording(ContactEvents(problem.mechanism, "pydy"))


def script(problem: Problem, timestep: float, integrator: str, tolerance: float) -> str:
    """The run of :func:`run_system` as a program with PyDy, SymPy and SciPy alone."""
    steps = whole_steps(problem.duration, timestep)
    return (
        f"{inspect.getsource(kane)}\n\n"
        f"SCENE = {pprint.pformat(scene(problem.mechanism), width=96, sort_dicts=False)}\n"
        f"t = {timestep!r} * np.arange({steps} + 1.0)\n"
        f"q, u = Equations(SCENE).integrate(t, {integrator!r}, {tolerance!r})\n"
    )
