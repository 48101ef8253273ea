"""MuJoCo's model as built, looked at in single states: its own mass matrix, forces and forward dynamics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.mechanism import Mechanism
from ..inspection import Dynamics, Inspection, State
from .build import load, mujoco, start_data
from .constraints import Hold, rails, stop_holds
from .moving_points import Bias, equality_rows
from .options import MujocoOptions
from .read import IN_PLANE, absolute_from_relative

# How soft a limit is and how far the solver goes are numerical options; a limit at rest carries the same torque
# whatever they are. With the hardest impedance MuJoCo takes, each round of settling gains the four digits of 1 - d.
# This reference presses a limit in by some 1e-10 rad a rad/s^2: far above the rounding of an angle, far below a gap.
_AT_REST: Mapping[str, object] = {
    "solver": "Newton",
    "tolerance": 1e-30,
    "iterations": 100,
    "solref": (-1e6, -1e3),
    "solimp": (0.9999, 0.9999, 0.001, 0.5, 2.0),
    "moving_points": True,
}
# Points are pressed in by an acceleration, whatever their stiffness, and where they stand is rounded to some 1e-15 m:
# with this one [1/s^2, 1/s], that is nothing.
_POINTS_AT_REST = (-1.0, -1.0)
_ROUNDS = 50  # of settling, at most; four do, unless the machine is close to a singular place
_SETTLED = 1e-14  # change of the torques in a round, of the largest: rounding


def inspect(mechanism: Mechanism, states: Sequence[State], options: MujocoOptions) -> Inspection:
    """Look at the built model in each state.

    Raises:
        SimulationError: MuJoCo refuses the model.
        UnsupportedProblemError: the mechanism cannot be written as MJCF, or starts with a stop's gap moving.
    """
    built = _Built(mechanism, _at_rest(mechanism, options))
    start, start_speeds = built.start()
    return Inspection(
        start=start,
        start_speeds=start_speeds,
        dynamics=tuple(built.dynamics(state) for state in states),
        total_mass=float(built.model.body_mass.sum()),
    )


def _at_rest(mechanism: Mechanism, options: MujocoOptions) -> Any:
    """The model with numerical options that make torques at rest exact."""
    model = load(mechanism, options.model_copy(update=_AT_REST))
    model.pair_solref[:], model.eq_solref[:] = _POINTS_AT_REST, _POINTS_AT_REST
    return model


@dataclass(frozen=True)
class _Built:
    """The model and data to look at it with; u = C qvel and q = start + C qpos, as trajectories are read."""

    mechanism: Mechanism
    model: Any

    @cached_property
    def data(self) -> Any:
        return start_data(self.model)

    @cached_property
    def holds(self) -> dict[str, Hold]:
        return stop_holds(self.mechanism, self.model)

    @cached_property
    def rails(self) -> list[Hold]:
        return list(rails(self.mechanism, self.model))

    @cached_property
    def bias(self) -> Bias:
        return Bias(self.model, moving=True)

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
            stop_gaps={name: hold.gap(self.model, data) for name, hold in self.holds.items()},
        )

    def _torques_at_rest(self, closed: Sequence[str]) -> dict[str, float]:
        """Press what holds in until none of it accelerates any more; its forces are then a rigid one's [N m or N].

        What :func:`.build.preload` does at the start, but wherever a stop stands, and until it has settled.
        """
        self.bias.walls.clear()
        self.bias.ties.clear()
        for hold in self.holds.values():
            hold.open(self.model, self.bias)
        with self.bias.applied():
            self._forward()
            holds = [self.holds[name] for name in closed]
            for hold in holds:
                hold.close(self.model, self.data, self.bias)
            self._settle([*holds, *self.rails])
        return {name: self._force(hold) for name, hold in zip(closed, holds, strict=True)}

    def _settle(self, holds: list[Hold]) -> None:
        forces = np.zeros(0)
        for _ in range(_ROUNDS):
            self._forward()
            before, forces = forces, np.array([*map(self._force, holds), *self._ties()])
            change = np.abs(forces - before).max(initial=0.0) if len(before) else np.inf
            if change <= _SETTLED * np.abs(forces).max(initial=0.0):
                break
            for hold in holds:
                hold.press(self.model, self.data, self.bias)
            self.bias.press_ties(self.data)

    def _forward(self) -> None:
        self.bias.restart()
        mujoco.mj_forward(self.model, self.data)

    def _force(self, hold: Hold) -> float:
        row = hold.row(self.data)
        return 0.0 if row is None else float(self.data.efc_force[row])

    def _ties(self) -> FloatArray:
        """Forces of the equalities [N]."""
        rows = [equality_rows(self.data, index) for index in range(self.model.neq)]
        return self.data.efc_force[np.concatenate(rows)] if rows else np.zeros(0)
