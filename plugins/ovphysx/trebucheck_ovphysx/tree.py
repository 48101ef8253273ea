"""Dynamics that PhysX computes for the articulations, in joint coordinates, for the model check."""

from __future__ import annotations

from typing import Any

import numpy as np
from trebucheck.models.arrays import FloatArray
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.joint_coordinates import JointCoordinates

from .alone import Plan


class Tree:
    """The built articulations.

    Raises:
        UnsupportedProblemError: a body is free: PhysX tells no dynamics of rigid bodies, and those
            of an articulation that is not on the ground with six coordinates more.
    """

    def __init__(self, mechanism: Mechanism, options: Any) -> None:
        self.plan = plan = Plan(Problem(mechanism, duration=options.timestep), options)
        if not all(tree["grounded"] for tree in plan.trees.values()):
            raise UnsupportedProblemError("our adapter reads no dynamics of bodies that are free.")
        self.coordinates, self.found = JointCoordinates(mechanism), plan.executed()
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
