"""The built scene for the model check.

Of an articulation on the ground the dynamics that PhysX computes, in joint coordinates; of rigid
bodies, of which it tells none, masses and inertias.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from trebucheck.engines.inspection import Inspection, State
from trebucheck.models.arrays import FloatArray
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.joint_tree import TreeMotion
from trebucheck_toolkit.read_back import held_inspection, held_mechanism

from .alone import MACHINE, Plan

ROUNDOFF = 2.0**-24


def inspect(mechanism: Mechanism, states: Sequence[State], options: Any) -> Inspection:
    """Inspect the built scene in each state, in a process in which nothing has run.

    Raises:
        UnsupportedProblemError: free bodies carry others, or there are articulations beside them:
            PhysX has six coordinates more of those, which our adapter does not read.
    """
    plan, found = Plan(Problem(mechanism, duration=options.timestep), options), dict[str, Any]()
    if plan.trees.keys() - {MACHINE, *plan.rigid} or (plan.rigid and MACHINE in plan.trees):
        raise UnsupportedProblemError("our adapter reads no dynamics of free bodies with joints.")
    exec(plan.program(), found)
    if MACHINE in plan.trees:
        return TreeMotion(Tree(mechanism, plan, found)).inspect(states, ROUNDOFF)
    kinds = ("RIGID_BODY_MASS", "RIGID_BODY_INERTIA", "RIGID_BODY_COM_POSE")
    told = [found["Tensor"](kind).read() for kind in kinds]
    bodies = {
        name: (float(mass), float(inertia[8]), np.add(mechanism.body(name).centre, pose[:2]))
        for name, row in found["ROWS"].items()
        for mass, inertia, pose in [[each[row] for each in told]]
    }
    held = held_mechanism(mechanism, bodies, {}, np.array(mechanism.gravity_vector))
    return held_inspection(held, found["q"][0], found["u"][0], states, roundoff=ROUNDOFF)


class Tree:
    """The built articulation on the ground, by the names of its program."""

    def __init__(self, mechanism: Mechanism, plan: Plan, found: dict[str, Any]) -> None:
        self.plan, self.found, self.coordinates = plan, found, JointCoordinates(mechanism)
        self.start = self.coordinates.positions(np.array(mechanism.start))
        joints, freedoms = self._tensor("DOF_POSITION").binding.dof_names, self.coordinates.freedoms
        links = (found["LINKS"][each.joint.child][1] for each in freedoms)
        self.order = [joints.index(f"{link}_joint") for link in links]
        self.signs = np.array([-1.0 if each.direction is None else 1.0 for each in freedoms])

    def _tensor(self, kind: str) -> Any:
        return self.found["Tensor"](f"ARTICULATION_{kind}", MACHINE)

    def _place(self, j: FloatArray, v: FloatArray) -> None:
        for kind, values in (("POSITION", j - self.start), ("VELOCITY", v)):
            tensor = self._tensor(f"DOF_{kind}")
            tensor.array[0, self.order] = self.signs * values
            tensor.write()

    def mass_matrix(self, j: FloatArray) -> FloatArray:
        """Mass matrix of the joint coordinates."""
        self._place(j, np.zeros_like(j))
        matrix = self._tensor("MASS_MATRIX").read()[0]
        return matrix[np.ix_(self.order, self.order)] * np.outer(self.signs, self.signs)

    def bias(self, j: FloatArray, v: FloatArray) -> FloatArray:
        """Joint forces that would keep the accelerations zero, gravity included."""
        self._place(j, v)
        kinds = "GRAVITY_FORCE", "CORIOLIS_AND_CENTRIFUGAL_FORCE"
        told = sum(self._tensor(kind).read()[0] for kind in kinds)
        return self.signs * told[self.order]

    def centres(self, j: FloatArray) -> dict[str, FloatArray]:
        """Centre of mass of each body in the world [m], but of those whose mass was moved."""
        self._place(j, np.zeros_like(j))
        poses, built = self.found["poses"].read(), self.plan.spread.mechanism
        return {
            body.name: poses[self.found["ROWS"][body.name]][:2]
            for body in self.coordinates.mechanism.bodies
            if body.mass == built.body(body.name).mass
        }

    def total_mass(self) -> float:
        """Mass of all bodies [kg], without what pins on the ground have brought."""
        moved = self.plan.spread.mechanism.bodies, self.coordinates.mechanism.bodies
        built, described = (sum(body.mass for body in bodies) for bodies in moved)
        return float(self.found["Tensor"]("RIGID_BODY_MASS").read().sum()) - (built - described)
