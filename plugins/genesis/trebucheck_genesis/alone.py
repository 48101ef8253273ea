"""Genesis's run, which is the program of :class:`.build.Model`, and what is read of it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from trebucheck.engines.events import ContactEvents, note_own_releases
from trebucheck.engines.inspection import Inspection
from trebucheck.engines.protocol import Recording
from trebucheck.engines.reading import timed_reading
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck.models.trajectory import PointMotion
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.joint_tree import TreeMotion

from .build import Model

if TYPE_CHECKING:
    from .engine import GenesisEngine


def run(problem: Problem, options: GenesisEngine) -> Recording:
    """Run the program, and read what it has noted.

    Raises:
        UnsupportedProblemError: the adapter does not build a part of the mechanism.
    """
    model, found = Model(problem), dict[str, Any]()
    exec(model.program(options), found)
    with timed_reading():
        mechanism, t, q = problem.mechanism, found["t"], found["q"]
        seen, torques = np.array(found["looks"])[: len(t)], np.array(found["torques"]).T
        of_stops = dict(zip(model.stops, torques, strict=True))
        of_stops |= {  # the others are none under a release-once law
            stop.name: np.zeros(len(t)) for stop in mechanism.stops if stop.name not in of_stops
        }
        events = ContactEvents(mechanism, "genesis")
        note_own_releases(events, t, of_stops)
        of_given = AppliedForces(Kinematics(model.pushed)).potential_energy(q)
        return Recording(
            t=t,
            q=q,
            u=found["u"],
            markers={
                marker.name: PointMotion(*(_vectors(seen[:, k + n]) for n in range(2)))
                for k, marker in zip(range(2, seen.shape[1], 2), mechanism.markers, strict=True)
            },
            kinetic_energy=seen[:, 0].real,
            potential_energy=seen[:, 1].real + of_given,
            stop_torques=of_stops,
            release_times=events.releases,
            steps=len(t) - 1,
        )


def _vectors(points: FloatArray) -> FloatArray:
    return np.stack([points.real, points.imag], axis=-1)


class Tree:
    """Genesis's dynamics of the tree, without its limits, loops and springs."""

    def __init__(self, mechanism: Mechanism, options: GenesisEngine) -> None:
        self.coordinates, self.found = JointCoordinates(mechanism), dict[str, Any]()
        parts = {"stops": (), "force_elements": (), "joints": mechanism.tree_joints}
        problem = Problem(mechanism.model_copy(update=parts), duration=options.timestep)
        exec(Model(problem).program(options), self.found)

    def _step_from(self, j: FloatArray, v: FloatArray) -> None:
        """Take a step; Genesis keeps the mass matrix and accelerations at its start."""
        entity, dofs = self.found["entity"], self.found["DOFS"]
        entity.set_qpos(j - self.found["ZEROS"], qs_idx_local=dofs)
        entity.set_dofs_velocity(v, dofs)
        self.found["scene"].step()

    def _told(self, name: str, **given: Any) -> FloatArray:
        told = getattr(self.found["entity"], f"get_{name}")(**given)
        return np.asarray(self.found["array"](told))

    def mass_matrix(self, j: FloatArray) -> FloatArray:
        """Mass matrix of the joint coordinates."""
        self._step_from(j, np.zeros_like(j))
        return self._told("mass_mat")[np.ix_(self.found["DOFS"], self.found["DOFS"])]

    def bias(self, j: FloatArray, v: FloatArray) -> FloatArray:
        """Bias forces, from the accelerations."""
        mass = self.mass_matrix(j)
        self._step_from(j, v)
        return -mass @ self._told("dofs_acc")[self.found["DOFS"]]

    def centres(self, j: FloatArray) -> dict[str, FloatArray]:
        """Centre of mass of each body in the world [m]."""
        self.found["entity"].set_qpos(j - self.found["ZEROS"], qs_idx_local=self.found["DOFS"])
        told = self._told("links_pos", ref=self.found["gs"].link_ref_frame.link_COM)
        return dict(zip(self.found["names"], told[:, [0, 2]], strict=True))

    def total_mass(self) -> float:
        """Mass of all bodies [kg]."""
        return float(self._told("links_mass").sum())

    def inspection(self, states: Any, precision: str) -> Inspection:
        """Dynamics in each state; stops and loops are held by multipliers."""
        numbers = np.finfo(np.float32 if precision == "32" else np.float64)
        return replace(TreeMotion(self).inspect(states), roundoff=float(numbers.eps / 2))
