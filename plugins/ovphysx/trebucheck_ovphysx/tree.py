"""The built scene for the model check.

Of articulations on the ground the dynamics that PhysX computes, in joint coordinates; of rigid
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
from trebucheck_toolkit.read_back import HeldBody, held_inspection, held_mechanism

from .alone import Plan

ROUNDOFF = 2.0**-24


def inspect(mechanism: Mechanism, states: Sequence[State], options: Any) -> Inspection:
    """Inspect the built scene in each state.

    Raises:
        UnsupportedProblemError: free bodies carry others, or there are articulations beside them:
            PhysX has six coordinates more of those, which our adapter does not read.
    """
    plan = Plan(Problem(mechanism, duration=options.timestep), options)
    if all(tree["grounded"] for tree in plan.trees.values()):
        return TreeMotion(Tree(mechanism, plan)).inspect(states, ROUNDOFF)
    if len(plan.rigid) < len(plan.trees):
        raise UnsupportedProblemError("our adapter reads no dynamics of free bodies with joints.")
    found, bodies = plan.executed(), dict[str, HeldBody]()
    for link in plan.links:
        mass, inertia, pose = (
            found["Tensor"](link["tree"], f"LINK_{kind}").read().ravel()
            for kind in ("MASS", "INERTIA", "COM_POSE")
        )
        centre = np.add(mechanism.body(link["body"]).centre, pose[:2])
        bodies[link["body"]] = float(mass[0]), float(inertia[8]), centre
    held = held_mechanism(mechanism, bodies, {}, np.array(mechanism.gravity_vector))
    return held_inspection(held, found["q"][0], found["u"][0], states, roundoff=ROUNDOFF)


class Tree:
    """The built articulations, all on the ground."""

    def __init__(self, mechanism: Mechanism, plan: Plan) -> None:
        self.plan, self.coordinates = plan, JointCoordinates(mechanism)
        self.found = plan.executed()
        self.start = self.coordinates.positions(np.array(mechanism.start))
        places = {each["body"]: (each["tree"], f"{each['name']}_joint") for each in plan.links}
        self.names = [places[each.joint.child] for each in self.coordinates.freedoms]
        """Articulation and joint of each joint coordinate."""
        self.signs = np.array(
            [1.0 if each.direction is not None else -1.0 for each in self.coordinates.freedoms]
        )

    def _place(self, j: FloatArray, v: FloatArray) -> None:
        for kind, values in (("POSITION", j - self.start), ("VELOCITY", v)):
            given = dict(zip(self.names, self.signs * values, strict=True))
            for tree in self.plan.trees:
                tensor = self.found["Tensor"](tree, f"DOF_{kind}")
                tensor.write([given[tree, dof] for dof in tensor.binding.dof_names])

    def _told(self, kind: str) -> tuple[dict[tuple[str, str], int], list[FloatArray]]:
        """Rows of the joints in a quantity of all articulations, and its parts."""
        rows, parts = dict[tuple[str, str], int](), list[FloatArray]()
        for tree in self.plan.trees:
            tensor = self.found["Tensor"](tree, kind)
            for dof in tensor.binding.dof_names:
                rows[tree, dof] = len(rows)
            parts.append(tensor.read())
        return rows, parts

    def mass_matrix(self, j: FloatArray) -> FloatArray:
        """Mass matrix of the joint coordinates."""
        self._place(j, np.zeros_like(j))
        rows, parts = self._told("MASS_MATRIX")
        whole, first = np.zeros((len(rows), len(rows))), 0
        for part in parts:
            last = first + len(part)
            whole[first:last, first:last], first = part, last
        order = [rows[name] for name in self.names]
        return whole[np.ix_(order, order)] * np.outer(self.signs, self.signs)

    def bias(self, j: FloatArray, v: FloatArray) -> FloatArray:
        """Joint forces that would keep the accelerations zero, gravity included."""
        self._place(j, v)
        rows, gravity = self._told("GRAVITY_FORCE")
        turning = self._told("CORIOLIS_AND_CENTRIFUGAL_FORCE")[1]
        told = np.concatenate(gravity) + np.concatenate(turning)
        return self.signs * told[[rows[name] for name in self.names]]

    def centres(self, j: FloatArray) -> dict[str, FloatArray]:
        """Centre of mass of each body in the world [m], but of those whose mass was moved."""
        self._place(j, np.zeros_like(j))
        links, rows = self.found["LINKS"], self.found["rows"]
        poses = {tree: each.read() for tree, each in self.found["poses"].items()}
        return {
            body.name: poses[links[body.name][0]][rows[body.name]][:2]
            for body in self.coordinates.mechanism.bodies
            if body.mass == self.plan.spread.mechanism.body(body.name).mass
        }

    def total_mass(self) -> float:
        """Mass of all bodies [kg], without the bases and what pins on the ground have brought."""
        told = [self.found["Tensor"](tree, "BODY_MASS").read() for tree in self.plan.trees]
        moved = self.plan.spread.mechanism.bodies, self.coordinates.mechanism.bodies
        built, described = (sum(body.mass for body in bodies) for bodies in moved)
        return float(sum(each.sum() - 1.0 for each in told)) - (built - described)
