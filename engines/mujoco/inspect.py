"""The built MuJoCo model in single states: its own mass matrix, forces and forward dynamics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.elements import GROUND
from ...models.mechanism import Mechanism, Slide
from ...models.mjcf.writer import mjcf_names
from ..inspection import Dynamics, Inspection, State
from .build import load, preload, slot_contacts, start_data, stop_constraints
from .compat import mass_matrix
from .options import MujocoOptions
from .read import IN_PLANE, absolute_from_relative
from .reference_acceleration import ReferenceAccelerationCorrection, mujoco

# The softness of a limit and the solver's tolerance are numerical options: a limit at rest carries
# the same torque with any of them. With the hardest impedance MuJoCo takes, each round gains the
# four digits of 1 - d. With this stiffness a limit gives way by some 1e-10 rad per rad/s^2: far
# above the rounding of an angle, far below a gap.
_AT_REST: Mapping[str, object] = {
    "solver": "Newton",
    "tolerance": 1e-30,
    "iterations": 100,
    "solref": (-1e6, -1e3),
    "solimp": (0.9999, 0.9999, 0.001, 0.5, 2.0),
    "moving_points": True,
}
# Points are preloaded by an acceleration, whatever their stiffness [1/s^2] and damping [1/s]; their
# positions are rounded to some 1e-15 m, which such a small stiffness makes negligible.
_POINTS_AT_REST = (-1e-6, -1e-6)
_SETTLED = 1e-14  # change of the torques in a round, of the largest: rounding


def inspect(mechanism: Mechanism, states: Sequence[State], options: MujocoOptions) -> Inspection:
    """Inspect the built model in each state.

    Raises:
        SimulationError: MuJoCo refuses the model.
        UnsupportedProblemError: the mechanism cannot be written as MJCF.
    """
    model = load(mechanism, options.model_copy(update=_AT_REST))
    model.pair_solref[:], model.eq_solref[:] = _POINTS_AT_REST, _POINTS_AT_REST
    inspector = _Inspector(mechanism, model)
    start, start_speeds = inspector.start()
    return Inspection(
        start=start,
        start_speeds=start_speeds,
        dynamics=tuple(inspector.dynamics(state) for state in states),
        total_mass=float(model.body_mass.sum()),
    )


class _Inspector:
    """The model and its data; u = C qvel and q = start + C qpos, as trajectories are read."""

    def __init__(self, mechanism: Mechanism, model: Any) -> None:
        self.mechanism, self.model = mechanism, model
        self.data = start_data(model)
        self.names = mjcf_names(mechanism)
        self.constraints = stop_constraints(mechanism, model)
        self.correction = ReferenceAccelerationCorrection(model, velocity_term=True)
        self.sums = absolute_from_relative(mechanism, model)
        """C, shape (n_q, n_v)."""

    def start(self) -> tuple[FloatArray, FloatArray]:
        """The keyframe's q and u, with the full turns of the mechanism's start."""
        data = start_data(self.model)
        mujoco.mj_kinematics(self.model, data)
        q: list[float] = []
        for body in self.mechanism.bodies:
            if body.angle is not None:
                # Absolute angles are positive clockwise: a body's x axis is (cos q, -sin q).
                x, y = data.body(self.names[body.name]).xmat.reshape(3, 3)[IN_PLANE, 0]
                q.append(float(np.arctan2(-y, x)))
        q += [self._slide(data, slide) for slide in self.mechanism.slides]
        turns = np.round((np.array(self.mechanism.start) - q) / (2 * np.pi))
        turns[len(self.mechanism.angles) :] = 0.0
        return np.array(q) + 2 * np.pi * turns, self.sums @ data.qvel

    def _slide(self, data: Any, slide: Slide) -> float:
        """Distance of a body's joint along its line from where the slide is zero [m]."""
        joint, ground = slide.joint, slide.joint.parent == GROUND
        # MuJoCo's frames have their joint as origin.
        origin = (0.0, 0.0) if ground else self.mechanism.joint_of(joint.parent).child_point
        parent = data.body("world" if ground else self.names[joint.parent])
        turned = parent.xmat.reshape(3, 3)[np.ix_(IN_PLANE, IN_PLANE)]
        place = (data.body(self.names[joint.child]).xpos - parent.xpos)[IN_PLANE] @ turned + origin
        return float((complex(*(place - joint.parent_point)) * slide.direction.conjugate()).real)

    def dynamics(self, state: State) -> Dynamics:
        """The model in a state."""
        data, back = self.data, np.asarray(np.linalg.inv(self.sums), dtype=np.float64)
        data.qpos[:] = back @ (state.q - np.array(self.mechanism.start))
        data.qvel[:] = back @ state.u
        torques = self._torques_at_rest(state.closed)
        forces = data.qfrc_passive + data.qfrc_actuator + data.qfrc_applied - data.qfrc_bias
        names = {body.name: self.names[body.name] for body in self.mechanism.bodies}
        gaps = {name: stop.gap(data) for name, stop in self.constraints.items()}
        return Dynamics(
            accelerations=self.sums @ data.qacc,
            stop_torques=torques,
            mass_matrix=back.T @ mass_matrix(self.model, data) @ back,
            forces=back.T @ forces,
            centres={body: data.body(name).xipos[IN_PLANE] for body, name in names.items()},
            stop_gaps=gaps,
        )

    def _torques_at_rest(self, closed: Sequence[str]) -> dict[str, float]:
        """Torques of the closed stops as if they were rigid [N m or N].

        The constraints are preloaded as at the start of a run (:func:`.build.preload`), but at any
        gap, and until their forces do not change any more.
        """
        self.correction.clear()
        for constraint in self.constraints.values():
            constraint.deactivate(self.correction)
        with self.correction.applied():
            self.correction.forward(self.data)
            active = [self.constraints[name] for name in closed]
            for constraint in active:
                constraint.activate(self.data, self.correction)
            slots = slot_contacts(self.mechanism, self.model)
            preload(self.data, [*active, *slots], self.correction, _SETTLED)
        torques = dict.fromkeys(closed, 0.0)
        for name, constraint in zip(closed, active, strict=True):
            row = constraint.row(self.data)
            if row is not None:
                torques[name] = float(self.data.efc_force[row])
        return torques
