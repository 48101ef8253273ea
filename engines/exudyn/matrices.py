"""Exudyn's mass matrix, forces and constraint Jacobian; accelerations and impacts by them.

In Exudyn's redundant coordinates z (x, y, rotation by body), with f the forces and G the Jacobian
of joints and stops,

    M z'' + G^T lam = f,        G z'' = -gamma,        gamma = dG/dt z'

M, f and G are what Exudyn assembles. It has no gamma of its own but from one-sided difference
quotients; here it is computed from eight of its Jacobians along the motion, to rounding.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from .. import impact as impact_law
from ..events import Contacts
from .read import System, exu
from .solver import DEPENDENT, BodyState

# Central difference of order 8: weights of f(k h) - f(-k h), k = 1..4, over h. A Jacobian is a sum
# of sines and cosines of rotations; at _TURN [rad] a step the truncation is _TURN^8 / 630 = 1e-15,
# the rounding 1e-16 / _TURN.
_WEIGHTS = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
_TURN = 0.03


@contextmanager
def matrices(system: System) -> Generator[Matrices]:
    """Exudyn's solver, opened on a system at its start.

    Raises:
        SimulationError: Exudyn cannot open its solver on the system.
    """
    settings, solver = exu.SimulationSettings(), exu.MainSolverImplicitSecondOrder()
    settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = False
    settings.solution.file.write = False
    if not solver.InitializeSolver(system.main, settings):
        raise SimulationError("exudyn cannot open its solver on the built system.")
    try:
        yield Matrices(system, solver)
    finally:
        solver.FinalizeSolver(system.main, settings)


@dataclass(frozen=True)
class Matrices:
    """Exudyn's quantities at the state it is set to."""

    system: System
    solver: Any

    def set(self, coordinates: FloatArray, rates: FloatArray) -> None:
        """Set the displacements from the reference and their rates, each of shape (3 n_bodies,)."""
        data = self.system.main.systemData
        data.SetODE2Coordinates(coordinates, exu.ConfigurationType.Current)
        data.SetODE2Coordinates_t(rates, exu.ConfigurationType.Current)

    def mass(self) -> FloatArray:
        """M, shape (3 n_bodies, 3 n_bodies)."""
        self.solver.ComputeMassMatrix(self.system.main)
        n = self.solver.GetODE2size()
        return np.array(self.solver.GetSystemMassMatrix())[:n, :n]

    def forces(self) -> FloatArray:
        """Forces of all but constraints (stops that are springs included), shape (3 n_bodies,)."""
        self.solver.ComputeODE2RHS(self.system.main)
        return np.array(self.solver.GetSystemResidual())[: self.solver.GetODE2size()]

    def jacobian(self, active: Contacts) -> FloatArray:
        """G, joints first, then the active stops, shape (n_joints + n_active, 3 n_bodies)."""
        self.system.set_active(())
        rows, diagonal = self._constraints()
        # A row that does not act reads lam = 0, with a one on its diagonal.
        joints = rows[diagonal == 0]
        return np.concatenate([joints, *(self.stop_row(name)[None] for name in active)])

    def stop_row(self, name: str) -> FloatArray:
        """Row of a stop in G, shape (3 n_bodies,); of a spring, minus a unit torque's force."""
        self.system.set_active((name,))
        if not self.system.springs:
            return self._constraints()[0][self._stop_rows(name)[0]]
        self.system.preload(name, 0.0)
        unloaded = self.forces()
        # As large as the other forces, so that their rounding does not matter.
        size = float(np.abs(unloaded).max()) or 1.0
        self.system.preload(name, size)
        return -self.system.constraints[name].sense * (self.forces() - unloaded) / size

    def solve(
        self, coordinates: FloatArray, rates: FloatArray, active: Contacts
    ) -> tuple[FloatArray, FloatArray]:
        """Accelerations at a state [m/s^2, rad/s^2], and multipliers of the active stops [N m, N].

        The accelerations z'' are of shape (3 n_bodies,); the multipliers have Exudyn's sign.
        """
        fastest = float(np.abs(rates[2::3]).max())
        # Without turning G is linear in the motion at most.
        step = _TURN / fastest if fastest > 0 else 1.0

        def along(steps: int) -> FloatArray:
            self.set(coordinates + steps * step * rates, rates)
            return self.jacobian(active) @ rates

        pairs = [weight * (along(k) - along(-k)) for k, weight in enumerate(_WEIGHTS, start=1)]
        gamma = np.sum(pairs, axis=0) / step
        self.set(coordinates, rates)
        jacobian = self.jacobian(active)
        self.system.set_active(())
        accelerations, multipliers = solve_constrained(self.mass(), jacobian, self.forces(), -gamma)
        return accelerations, multipliers[len(multipliers) - len(active) :]

    def set_multipliers(self, active: Contacts, stops: FloatArray) -> None:
        """Make Exudyn's outputs those of active stops with these multipliers."""
        if self.system.springs:
            for name, multiplier in zip(active, stops.tolist(), strict=True):
                self.system.preload(name, self.system.constraints[name].sense * multiplier)
            return
        multipliers = np.zeros(self.solver.GetAEsize())
        multipliers[[self._stop_rows(name)[0] for name in active]] = stops
        self.system.main.systemData.SetAECoordinates(multipliers, exu.ConfigurationType.Current)

    def _constraints(self) -> tuple[FloatArray, FloatArray]:
        """G of all of Exudyn's algebraic equations, and their own diagonal."""
        n, size = self.solver.GetODE2size(), len(np.asarray(self.solver.GetSystemJacobian()))
        self.solver.SetSystemJacobian(np.zeros((size, size)))  # Exudyn adds to what is there
        self.solver.ComputeJacobianAE(self.system.main, 1.0, 0.0, 0.0, False)
        jacobian = np.array(self.solver.GetSystemJacobian())[n:]
        return jacobian[:, :n], np.diag(jacobian[:, n:])

    def _stop_rows(self, name: str) -> list[int]:
        """Equations of a stop's connector: the gap's first (a point contact has a second, zero)."""
        return list(self.system.main.systemData.GetObjectLTGAE(self.system.stops[name]))


def solve_constrained(
    mass: FloatArray, jacobian: FloatArray, forces: FloatArray, right: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Solution z'', lam of M z'' + G^T lam = f, G z'' = right.

    Where constraints are redundant, lam is that of least norm.

    Raises:
        SimulationError: a body has no inertia of its own or by its joints.
    """
    rank = int(np.linalg.matrix_rank(jacobian, rtol=DEPENDENT)) if len(jacobian) else 0
    if rank < len(jacobian):
        independent = np.linalg.svd(jacobian)[0][:, :rank]
        accelerations, reduced = solve_constrained(
            mass, independent.T @ jacobian, forces, independent.T @ right
        )
        return accelerations, independent @ reduced
    n, scale = len(mass), float(np.abs(mass).max())
    kkt = np.zeros((n + len(jacobian), n + len(jacobian)))
    kkt[:n, :n] = mass
    kkt[n:, :n] = scale * jacobian  # of the masses' size, so that pivoting compares like with like
    kkt[:n, n:] = kkt[n:, :n].T
    wanted = np.concatenate([forces, scale * right])
    try:
        solution = np.linalg.solve(kkt, wanted)
        # Once refined, the backward error is small by component (Skeel, Math. Comp. 35 (1980) 817):
        # nearly parallel constraints otherwise multiply rounding by the square of their condition.
        solution = solution + np.linalg.solve(kkt, wanted - kkt @ solution)
    except np.linalg.LinAlgError:
        raise SimulationError(
            "exudyn's bodies have no inertia in some direction they can move in."
        ) from None
    return solution[:n], scale * solution[n:]


def resolve_impact(
    system: System, state: BodyState, restitution: Mapping[str, float]
) -> tuple[BodyState, dict[str, float]]:
    """The state after the impact of all contacts that touch, and the impulse of each [N m s, N s].

    Newton's law with complementarity (:mod:`..impact`): z'+ = z'- + sum_i p_i r_i, with r_i
    what a unit impulse on gap i does to the bodies in their joints. The contacts that touch, active
    ones included, are those with a restitution e.

    Raises:
        SimulationError: no impulses keep all gaps open.
    """
    with matrices(system) as state_matrices:
        state_matrices.set(state.coordinates, state.rates)
        mass, joints = state_matrices.mass(), state_matrices.jacobian(())
        senses = {name: -system.constraints[name].sense for name in restitution}
        rows = np.array([sign * state_matrices.stop_row(name) for name, sign in senses.items()])
        still = np.zeros(len(joints))
        responses = np.array([solve_constrained(mass, joints, row, still)[0] for row in rows])
    coefficients = np.array(list(restitution.values()))
    impulses = impact_law.impulses(rows @ responses.T, rows @ state.rates, coefficients)
    if impulses is None:
        raise SimulationError(
            f"exudyn finds no impact of the stops {', '.join(restitution)} in which all of them "
            "push."
        )
    after = replace(state, rates=state.rates + impulses @ responses)
    return after, dict(zip(restitution, impulses.tolist(), strict=True))
