"""MuJoCo's model as built, looked at in single states: its own mass matrix, forces and forward dynamics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..models.arrays import FloatArray
from ..models.mechanism import Mechanism
from ._mujoco_model import Limit, limits, load, mujoco, start_data
from ._mujoco_read import IN_PLANE, absolute_from_relative
from .inspection import Dynamics, Inspection, State

if TYPE_CHECKING:
    from .mujoco_ import MujocoEngine

# How soft a limit is and how far the solver goes are numerical options; a limit at rest carries the same torque
# whatever they are. With the hardest impedance MuJoCo takes, each round of settling gains the four digits of 1 - d.
# This reference presses a limit in by some 1e-10 rad a rad/s^2: far above the rounding of an angle, far below a gap.
_AT_REST: Mapping[str, object] = {
    "solver": "Newton",
    "tolerance": 1e-30,
    "iterations": 100,
    "solref": (-1e6, -1e3),
    "solimp": (0.9999, 0.9999, 0.001, 0.5, 2.0),
}
_ROUNDS = 50  # of settling, at most; four do, unless the machine is close to a singular place
_SETTLED = 1e-14  # change of the torques in a round, of the largest: rounding
_REACH = 1e-12  # [rad] a limit acts when strictly nearer than its margin


def inspect(mechanism: Mechanism, states: Sequence[State], options: MujocoEngine) -> Inspection:
    """Look at the built model in each state.

    Raises:
        SimulationError: MuJoCo refuses the model.
        UnsupportedProblemError: the mechanism cannot be written as MJCF, or starts with a stop's gap moving.
    """
    built = _Built(mechanism, load(mechanism, options.model_copy(update=_AT_REST)))
    start, start_speeds = built.start()
    return Inspection(
        start=start,
        start_speeds=start_speeds,
        dynamics=tuple(built.dynamics(state) for state in states),
        total_mass=float(built.model.body_mass.sum()),
    )


@dataclass(frozen=True)
class _Built:
    """The model and data to look at it with; u = C qvel and q = start + C qpos, as trajectories are read."""

    mechanism: Mechanism
    model: Any

    @cached_property
    def data(self) -> Any:
        return start_data(self.model)

    @cached_property
    def limits(self) -> dict[str, Limit]:
        return limits(self.mechanism, self.model)

    @cached_property
    def sums(self) -> FloatArray:
        """C, shape (n_q, n_v)."""
        return absolute_from_relative(self.mechanism, self.model)

    @cached_property
    def differences(self) -> FloatArray:
        """Inverse of C: joint coordinates from absolute ones, joint forces' weights in absolute ones."""
        return np.asarray(np.linalg.inv(self.sums), dtype=np.float64)

    def start(self) -> tuple[FloatArray, FloatArray]:
        """The keyframe's q and u: angles as the bodies stand in the world, to the turn the mechanism names."""
        data = start_data(self.model)
        mujoco.mj_kinematics(self.model, data)
        q = [self._angle(data, body.name) for body in self.mechanism.bodies]
        for slot in self.mechanism.slides:
            q.append(float(np.dot(self._place(data, slot.child) - slot.parent_point, slot.axis)))
        turns = np.round((np.array(self.mechanism.start) - q) / (2 * np.pi))
        turns[len(self.mechanism.bodies) :] = 0.0
        return np.array(q) + 2 * np.pi * turns, self.sums @ data.qvel

    def _angle(self, data: Any, body: str) -> float:
        """A body's absolute angle, positive clockwise: its x axis is (cos q, -sin q) in the plane."""
        x, y = data.body(body).xmat.reshape(3, 3)[IN_PLANE, 0]
        return float(np.arctan2(-y, x))

    def _place(self, data: Any, body: str) -> FloatArray:
        """Where the joint of a body is, which is its frame's origin [m]."""
        return np.asarray(data.body(body).xpos[IN_PLANE])

    def dynamics(self, state: State) -> Dynamics:
        """The model in a state."""
        data, back = self.data, self.differences
        data.qpos[:] = back @ (state.q - np.array(self.mechanism.start))
        data.qvel[:] = back @ state.u
        torques = self._torques_at_rest(state.closed)
        mass = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, data, mass)
        forces = data.qfrc_passive + data.qfrc_actuator + data.qfrc_applied - data.qfrc_bias
        return Dynamics(
            accelerations=self.sums @ data.qacc,
            stop_torques=torques,
            mass_matrix=back.T @ mass @ back,
            forces=back.T @ forces,
            centres={body.name: data.body(body.name).xipos[IN_PLANE] for body in self.mechanism.bodies},
            stop_gaps={name: self._gap(name) for name in self.limits},
        )

    def _gap(self, name: str) -> float:
        """Opening of a limit, as MuJoCo measures its joint or tendon [rad]; negative when pressed in."""
        limit, stop = self.limits[name], self.mechanism.stop(name)
        if limit.element == "tendon":
            value = self.data.ten_length[limit.index]
        else:
            value = self.data.qpos[self.model.jnt_qposadr[limit.index]]
        return float(stop.sense * (value - limit.range[limit.end]))

    def _torques_at_rest(self, closed: Sequence[str]) -> dict[str, float]:
        """Press the closed limits in until none accelerates any more; their torques are then a rigid stop's [N m].

        What :func:`._mujoco_model.preload` does at the start, but wherever the limit stands, and until it has settled.
        """
        self._open_all()
        mujoco.mj_forward(self.model, self.data)
        for name in closed:
            self._set_margin(name, self._gap(name) + _REACH)
        torques = np.zeros(len(closed))
        for _ in range(_ROUNDS):
            mujoco.mj_forward(self.model, self.data)
            before, torques = torques, np.array([self._torque(name) for name in closed])
            if np.abs(torques - before).max(initial=0.0) <= _SETTLED * np.abs(torques).max(initial=0.0):
                break
            for name in closed:
                self._press(name)
        return dict(zip(closed, torques.tolist(), strict=True))

    def _open_all(self) -> None:
        """No margins: an open stop's limit stays out of it, one that is pressed in by mistake shows."""
        self.model.jnt_margin[:], self.model.tendon_margin[:] = 0.0, 0.0

    def _set_margin(self, name: str, margin: float) -> None:
        limit = self.limits[name]
        getattr(self.model, f"{limit.element}_margin")[limit.index] = margin

    def _torque(self, name: str) -> float:
        row = self.limits[name].row(self.data)
        return 0.0 if row is None else float(self.data.efc_force[row])

    def _press(self, name: str) -> None:
        """Set the limit's margin so that its reference acceleration k d (margin - gap) is what R f takes from it."""
        row, data = self.limits[name].row(self.data), self.data
        if row is not None and data.efc_force[row] > 0:
            stiffness, _, impedance, _ = data.efc_KBIP[row]
            press = data.efc_R[row] * data.efc_force[row] / (stiffness * impedance)
            self._set_margin(name, float(data.efc_pos[row] + press))
