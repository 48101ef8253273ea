"""Inspection of the built Exudyn system in single states, by its own matrices and outputs.

A state q is set by placing Exudyn's bodies, z(q); J = dz/dq carries its matrices back, M = J^T M_z
J and f = J^T (f_z - M_z dJ/dt u). Accelerations and torques are solutions of Exudyn's own
constrained equations, where J does not enter: were its joints other ones than the mechanism's, they
would differ. Stops are constraints there, also of a run that has Exudyn's own unilateral elements
for them, whose gaps are shown.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...models.arrays import FloatArray
from ...models.elements import AnyJoint
from ...models.errors import InputError, SimulationError
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from ...models.problem import StopLaw
from ..inspection import Dynamics, Inspection, State
from .build import build, silence
from .limits import build_with_limits
from .matrices import Matrices, matrices
from .options import ExudynOptions
from .read import BodyCoordinates, SensorKey, Spring, System, Values, exu, on_joint
from .solver import Solver


def inspect(mechanism: Mechanism, states: Sequence[State], options: ExudynOptions) -> Inspection:
    """Build the system as a run would, and inspect it.

    Raises:
        InputError: a state closes a stop that is open at the start.
        UnsupportedProblemError: the mechanism cannot be built.
        SimulationError: Exudyn failed.
    """
    springs: dict[str, Spring] | None = None
    if options.stop_stiffness is not None:
        # Each state sets the springs' torques to those of the stops at rest, where dampers have no
        # effect. The stiffness has none either, but a stiff spring would amplify the last digits
        # of the two angles.
        closed = (stop.name for stop in mechanism.stops if stop.closed)
        springs = {name: Spring(stiffness=1.0) for name in closed}
    with silence():
        system = build(mechanism, springs)
        try:
            return _Inspector(system, options).inspection(states)
        except SimulationError:
            raise
        except RuntimeError as error:  # Exudyn's own errors
            raise SimulationError(f"exudyn failed: {error}") from error


class _Inspector:
    def __init__(self, system: System, options: ExudynOptions) -> None:
        self.system, self.mechanism = system, system.mechanism
        self.solver = Solver(system, options)
        self.bodies = BodyCoordinates(Kinematics(system.mechanism))
        self.limits: System | None = None
        if options.own_limits:
            period = options.limit_period * options.timestep
            self.limits = build_with_limits(system.mechanism, StopLaw.UNILATERAL, period)

    def inspection(self, states: Sequence[State]) -> Inspection:
        """Quantities, in each state."""
        with matrices(self.system) as state_matrices:
            row = self.solver.row(0.0)
            start, start_speeds = self.solver.coordinates(row)
            reference = self._places(row) - self.solver.state(row).coordinates
            mass = state_matrices.mass()
            dynamics = [self._dynamics(state_matrices, reference, state) for state in states]
        return Inspection(
            start=start,
            start_speeds=start_speeds,
            total_mass=float(mass[0::3, 0::3].sum()),
            dynamics=tuple(dynamics),
        )

    def _places(self, row: FloatArray) -> FloatArray:
        """Exudyn's coordinates, reference included: x, y, rotation by body, shape (3 n_bodies,)."""
        return self.solver.of_bodies(row, "CoordinatesTotal")

    def _dynamics(self, state_matrices: Matrices, reference: FloatArray, state: State) -> Dynamics:
        for name in state.closed:
            if name not in self.system.stops:
                known = ", ".join(sorted(self.system.stops)) or "none"
                raise InputError(
                    f"closed = {name!r} is no stop that is closed at the start; those are: {known}."
                )
        jacobian = self.bodies.jacobian(state.q)
        displacements = self.bodies.placed(state.q) - reference
        accelerations, multipliers = state_matrices.solve(
            displacements, jacobian @ state.u, state.closed
        )
        # Now of this state, without the stops' springs.
        mass, forces = state_matrices.mass(), state_matrices.forces()

        # Exudyn's outputs follow from the solution in its system data.
        data, current = self.system.main.systemData, exu.ConfigurationType.Current
        data.SetODE2Coordinates_tt(accelerations, current)
        self.system.set_active(state.closed)
        state_matrices.set_multipliers(state.closed, multipliers)
        row = self.solver.row(0.0)
        centres = self._places(row).reshape(-1, 3)[:, :2]
        return Dynamics(
            accelerations=self._accelerations(),
            stop_torques={name: self.solver.torque(row, name) for name in state.closed},
            mass_matrix=jacobian.T @ mass @ jacobian,
            forces=jacobian.T @ (forces - mass @ self._curvature(state)),
            centres={b.name: at for b, at in zip(self.mechanism.bodies, centres, strict=True)},
            stop_gaps={name: self._gap(name, displacements) for name in state.closed},
        )

    def _gap(self, name: str, displacements: FloatArray) -> float:
        """Gap of a stop by the element that a run has for it."""
        if self.limits is None:
            return self.system.constraints[name].connector_gap(self.system)
        data, current = self.limits.main.systemData, exu.ConfigurationType.Current
        data.SetODE2Coordinates(displacements, current)
        return self.limits.limits[name].connector_gap(self.limits)

    def _accelerations(self) -> FloatArray:
        """Accelerations of q by Exudyn's outputs of nodes and of points in slots, shape (n_q,)."""
        variable, rotations = exu.OutputVariableType.Coordinates_tt, dict[str, float]()
        for body in self.mechanism.bodies:
            output = self.system.main.GetNodeOutput(self.system.nodes[body.name], variable)
            rotations[body.name] = float(output[2])
        turning = (body.name for body in self.mechanism.bodies if body.angle is not None)
        accelerations = [-rotations[name] for name in turning]
        for slide in self.mechanism.slides:
            joint, values = slide.joint, self._with_accelerations(slide.joint)
            along = on_joint(joint).acceleration(values, rotations.get(joint.parent, 0.0))
            accelerations.append(float((along[0] * slide.direction.conjugate()).real))
        return np.array(accelerations)

    def _with_accelerations(self, joint: AnyJoint) -> Values:
        """Sensors now, and accelerations of a joint's points, which a run does not record."""
        points = dict(on_joint(joint).ends)

        def values(sensor: SensorKey) -> FloatArray:
            kind, _, quantity = sensor
            if quantity != "Acceleration":
                return self.system.now(sensor)
            point, variable = points[kind], exu.OutputVariableType.Acceleration
            body, local = self.system.bodies[point.body], self.system.local(point.body, point.point)
            return np.atleast_2d(self.system.main.GetObjectOutputBody(body, variable, local))

        return values

    def _curvature(self, state: State) -> FloatArray:
        """dJ/dt u, shape (3 n_bodies,)."""
        still, kinematics = np.zeros(len(state.q)), self.bodies.kinematics
        centres = [
            kinematics.acceleration(row, state.q, state.u, still) for row in self.bodies.rows
        ]
        return np.concatenate([[*centre, 0.0] for centre in centres])
