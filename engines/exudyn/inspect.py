"""Inspection of the built Exudyn system in single states, by its own matrices and outputs.

A state q is set by placing Exudyn's bodies, z(q); J = dz/dq carries its matrices back, M = J^T M_z
J and f = J^T (f_z - M_z dJ/dt u). Accelerations and torques are solutions of Exudyn's own
constrained equations, where J does not enter: were its joints other ones than the mechanism's, they
would differ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...models.arrays import FloatArray
from ...models.elements import AnyJoint
from ...models.errors import InputError, SimulationError
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism, Slide
from ..inspection import Dynamics, Inspection, State
from .build import build, silence
from .matrices import Matrices, Solved, matrices
from .options import ExudynOptions
from .read import BodyCoordinates, Reader, SensorKey, Spring, System, Values, exu, on_joint
from .solver import Solver


def inspect(mechanism: Mechanism, states: Sequence[State], options: ExudynOptions) -> Inspection:
    """Build the system as a run would, and inspect it.

    Raises:
        InputError: a state closes a stop that is open at the start.
        UnsupportedProblemError: the mechanism cannot be built.
        SimulationError: Exudyn failed.
    """
    with silence():
        system = build(mechanism, _springs(mechanism, options))
        try:
            return _Inspector(system, options).inspection(states)
        except SimulationError:
            raise
        except RuntimeError as error:  # Exudyn's own errors
            raise SimulationError(f"exudyn failed: {error}") from error


def _springs(mechanism: Mechanism, options: ExudynOptions) -> dict[str, Spring] | None:
    """Springs that stand for the closed stops, if the options make them springs.

    Each state sets their torques to those of the stops at rest, where dampers have no effect. The
    stiffness has none either, but a stiff spring would amplify the last digits of the two angles.
    """
    if options.stop_stiffness is None:
        return None
    return {stop.name: Spring(stiffness=1.0) for stop in mechanism.stops if stop.closed}


class _Inspector:
    def __init__(self, system: System, options: ExudynOptions) -> None:
        self.system = system
        self.solver = Solver(system, options)
        self.kinematics = Kinematics(system.mechanism)
        self.bodies = BodyCoordinates(self.kinematics)

    def inspection(self, states: Sequence[State]) -> Inspection:
        """All quantities, in each state."""
        with matrices(self.system) as state_matrices:
            start = self._reader()
            reference = self._places(start) - self.solver.state(start.table, 0).coordinates
            return Inspection(
                start=start.coordinates()[0],
                start_speeds=start.speeds()[0],
                total_mass=float(state_matrices.mass()[0::3, 0::3].sum()),
                dynamics=tuple(
                    self._dynamics(state_matrices, reference, state) for state in states
                ),
            )

    def _dynamics(self, state_matrices: Matrices, reference: FloatArray, state: State) -> Dynamics:
        self._refuse_other_stops(state)
        jacobian = self.bodies.jacobian(state.q)
        displacements = self.bodies.placed(state.q) - reference
        solved = state_matrices.solve(displacements, jacobian @ state.u, state.closed)
        # Now of this state, without the stops' springs.
        mass, forces = state_matrices.mass(), state_matrices.forces()
        self._set_solution(state_matrices, solved, state.closed)
        reader = self._reader()
        return Dynamics(
            accelerations=self._accelerations(),
            stop_torques={name: float(reader.torque(name, None)[0]) for name in state.closed},
            mass_matrix=jacobian.T @ mass @ jacobian,
            forces=jacobian.T @ (forces - mass @ self._curvature(state)),
            centres=dict(zip(self._names, self._places(reader).reshape(-1, 3)[:, :2], strict=True)),
            stop_gaps={name: self.system.gap(name) for name in state.closed},
        )

    def _refuse_other_stops(self, state: State) -> None:
        for name in state.closed:
            if name not in self.system.stops:
                known = ", ".join(sorted(self.system.stops)) or "none"
                raise InputError(
                    f"closed = {name!r} is no stop that is closed at the start; those are: {known}."
                )

    def _set_solution(
        self, state_matrices: Matrices, solved: Solved, closed: tuple[str, ...]
    ) -> None:
        """Set the solution in Exudyn's system data; its outputs follow from these."""
        data, current = self.system.main.systemData, exu.ConfigurationType.Current
        data.SetODE2Coordinates_tt(solved.accelerations, current)
        self.system.set_active(closed)
        state_matrices.set_multipliers(closed, solved.stops)

    @property
    def _names(self) -> tuple[str, ...]:
        return tuple(body.name for body in self.system.mechanism.bodies)

    def _reader(self) -> Reader:
        """Reader of the current state, as a run reads its table."""
        return Reader(self.system, self.solver.columns, self.solver.row(0.0)[None])

    def _places(self, reader: Reader) -> FloatArray:
        """Exudyn's coordinates, reference included: x, y, rotation by body, shape (3 n_bodies,)."""
        return self.solver.of_bodies(reader.table[0], "CoordinatesTotal")

    def _accelerations(self) -> FloatArray:
        """Accelerations of q by Exudyn's outputs of nodes and of points in slots, shape (n_q,)."""
        mechanism, variable = self.system.mechanism, exu.OutputVariableType.Coordinates_tt
        rotations: dict[str, float] = {}
        for name in self._names:
            output = self.system.main.GetNodeOutput(self.system.nodes[name], variable)
            rotations[name] = float(output[2])
        angles = [-rotations[body.name] for body in mechanism.bodies if body.angle is not None]
        return np.array([*angles, *(self._along(slide, rotations) for slide in mechanism.slides)])

    def _along(self, slide: Slide, rotations: Mapping[str, float]) -> float:
        values, joint = self._with_accelerations(slide.joint), slide.joint
        place = on_joint(joint).acceleration(values, rotations.get(joint.parent, 0.0))
        return float((place[0] * slide.direction.conjugate()).real)

    def _with_accelerations(self, joint: AnyJoint) -> Values:
        """Sensors now, and accelerations of a joint's points, which a run does not record."""
        relative = on_joint(joint)

        def values(sensor: SensorKey) -> FloatArray:
            kind, _, quantity = sensor
            if quantity != "Acceleration":
                return self.system.now(sensor)
            point = relative.point if kind == relative.kind else relative.anchor
            body, local = self.system.bodies[point.body], self.system.local(point.body, point.point)
            variable = exu.OutputVariableType.Acceleration
            return np.atleast_2d(self.system.main.GetObjectOutputBody(body, variable, local))

        return values

    def _curvature(self, state: State) -> FloatArray:
        """dJ/dt u, shape (3 n_bodies,)."""
        still = np.zeros(len(state.q))
        centres = [
            self.kinematics.acceleration(row, state.q, state.u, still) for row in self.bodies.rows
        ]
        return np.concatenate([[*centre, 0.0] for centre in centres])
