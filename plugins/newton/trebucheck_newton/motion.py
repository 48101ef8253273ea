"""A mechanism as Newton's `SolverMuJoCo` moves it, on the processor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import newton
import numpy as np
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.problem import Problem
from trebucheck_toolkit.event_driver import Observation
from trebucheck_toolkit.joint_tree import JointLimits, without_others
from trebucheck_toolkit.plain_run import StepAhead
from trebucheck_toolkit.schemes import State

from .tree import NewtonTree

MUJOCO: Mapping[str, Any] = {
    "use_mujoco_cpu": True,
    "integrator": "rk4",
    "disable_contacts": True,
    "iterations": 100,
    "tolerance": 0.0,
}
"""Arguments of `SolverMuJoCo`."""


class Motion(StepAhead):
    """The solver, whose limits stay where they are when they have opened."""

    def __init__(self, problem: Problem, tree: NewtonTree) -> None:
        self.tree, self.to = tree, tree.coordinates
        self.places = JointLimits(self.to, "newton").places
        self.applied = AppliedForces(Kinematics(problem.mechanism))
        self.closed = [stop.name for stop in problem.mechanism.stops if stop.closed]
        solver = newton.solvers.SolverMuJoCo(tree.model, **MUJOCO)
        tree.solve_by(solver, *(["qfrc_constraint"] if self.closed else []))
        q, u = initial_state(problem.mechanism)
        tree.place(self.to.positions(q), self.to.speeds(u))
        self.step()

    def _show_and_step(self) -> tuple[State, Mapping[str, float], Observation]:
        j, v = self.tree.state()
        q, u = self.to.mechanism_positions(j), self.to.mechanism_speeds(v)
        seen = self.tree.look()
        seen = replace(
            seen, reactions=self.tree.step(self.to.forces(self.applied.generalized(q, u)))
        )
        return (
            (q, u),
            self._torques(),
            without_others(seen, self.applied, (q, u), self.applied.on_bodies(q, u)),
        )

    def _torques(self) -> dict[str, float]:
        if not self.closed:
            return {}
        torques = np.ravel(self.tree.told.qfrc_constraint.numpy())
        places = self.places
        return {
            name: max(0.0, places[name][1] * float(torques[places[name][0]]))
            for name in self.closed
        }
