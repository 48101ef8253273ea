"""What holds a built model besides its joints: limits, walls and tied points, as MuJoCo's constraint rows.

A stop is a limit of a joint or tendon, or a wall that a point's ball rests on; a slot that closes a loop is two walls.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ...models.arrays import FloatArray
from ...models.mechanism import Mechanism, PointStop, Stop
from ...models.mjcf.points import RAIL_SIDES, Points, rail_contact, torque_sensor
from ...models.mjcf.writer import FAR, MARGIN
from .moving_points import Bias

mujoco: Any = importlib.import_module("mujoco")  # it carries no types


class Hold(Protocol):
    """One unilateral row that can be taken out, and pressed in through its margin."""

    def remove(self, model: Any) -> None:
        """Take it out of the model."""
        ...

    def row(self, data: Any) -> int | None:
        """Its row among the constraints that are present; None if it is out of reach."""
        ...

    def gap(self, model: Any, data: Any) -> float:
        """Its opening as MuJoCo measures it [rad or m]; negative when pressed in."""
        ...

    def close(self, model: Any, data: Any, bias: Bias) -> None:
        """Let it act where it stands, not pressed in."""
        ...

    def open(self, model: Any, bias: Bias) -> None:
        """Let it act only where it is pressed in by the position itself."""
        ...

    def press(self, model: Any, data: Any, bias: Bias) -> None:
        """Make up for its softness: if it pushes, press it in by what its force f takes, R f of acceleration."""
        ...

    def torque(self, sensed: FloatArray, positions: FloatArray, model: Any) -> FloatArray:
        """Its torque [N m] or force [N] from its sensor's values (n,) and the joints' positions (n, n_q)."""
        ...


@dataclass(frozen=True)
class Limit:
    """A stop on angles as the limit of a joint or of a tendon."""

    element: str
    """'jnt' or 'tendon', the prefix of the model's arrays."""
    index: int
    end: int
    """0 for the lower end of the range, 1 for the upper."""
    constraint: int
    """Type of its rows among MuJoCo's constraints."""
    range: tuple[float, float]
    """Of the joint or tendon, before anything was removed [rad]."""

    def remove(self, model: Any) -> None:
        """Take the limit out of the model; the other end of the range stays."""
        getattr(model, f"{self.element}_range")[self.index, self.end] = FAR if self.end else -FAR

    def row(self, data: Any) -> int | None:
        """Its row among the constraints that are present; None if it is out of reach."""
        found = np.flatnonzero((data.efc_type == self.constraint) & (data.efc_id == self.index))
        return int(found[0]) if len(found) else None

    def gap(self, model: Any, data: Any) -> float:
        """Its opening as MuJoCo measures its joint or tendon [rad]."""
        on_tendon = self.element == "tendon"
        value = data.ten_length[self.index] if on_tendon else data.qpos[model.jnt_qposadr[self.index]]
        return float((1 - 2 * self.end) * (value - self.range[self.end]))

    def close(self, model: Any, data: Any, bias: Bias) -> None:
        """Put its margin a trifle beyond where the joint or tendon stands."""
        self.set_margin(model, self.gap(model, data) + MARGIN)

    def open(self, model: Any, bias: Bias) -> None:
        """Take its margin away."""
        self.set_margin(model, 0.0)

    def press(self, model: Any, data: Any, bias: Bias) -> None:
        """Through its margin: the reference acceleration k d (margin - gap) is then R f."""
        row = self.row(data)
        if row is not None and data.efc_force[row] > 0:
            stiffness, _, impedance, _ = data.efc_KBIP[row]
            worth = data.efc_R[row] * data.efc_force[row] / (stiffness * impedance)
            self.set_margin(model, self.gap(model, data) + worth)

    def set_margin(self, model: Any, margin: float) -> None:
        """Set how near its limit the joint or tendon feels it [rad]; with more, it is as if pressed in."""
        getattr(model, f"{self.element}_margin")[self.index] = margin

    def torque(self, sensed: FloatArray, positions: FloatArray, model: Any) -> FloatArray:
        """Its torque [N m]; where two stops are the ends of one range, the nearer one has the sensor's."""
        if self.element == "tendon":
            return sensed
        value = positions[:, int(model.jnt_qposadr[self.index])]
        own, other = self.range[self.end], self.range[1 - self.end]
        return np.where(np.abs(value - own) < np.abs(value - other), sensed, 0.0)


@dataclass(frozen=True)
class Wall:
    """A plane that a ball rests on: a stop on a point, or a side of a slot."""

    index: int
    """Of the pair of geoms."""
    geoms: tuple[int, int]
    """Plane and ball."""

    def remove(self, model: Any) -> None:
        """Let no ball come near enough to the plane."""
        model.pair_margin[self.index] = -FAR

    def row(self, data: Any) -> int | None:
        """Its row among the constraints that are present; None if the ball is out of reach."""
        found = np.flatnonzero((data.contact.geom == self.geoms).all(axis=1))
        row = int(data.contact.efc_address[found[0]]) if len(found) else -1
        return row if row >= 0 else None

    def gap(self, model: Any, data: Any) -> float:
        """Distance of the ball from the plane [m]."""
        plane, ball = self.geoms
        normal = data.geom_xmat[plane].reshape(3, 3)[:, 2]
        return float((data.geom_xpos[ball] - data.geom_xpos[plane]) @ normal - model.geom_size[ball, 0])

    def close(self, model: Any, data: Any, bias: Bias) -> None:
        """As :meth:`open`: its margin is wide enough."""
        self.open(model, bias)

    def open(self, model: Any, bias: Bias) -> None:
        """Let its margin be worth nothing."""
        bias.walls[self.geoms] = 0.0

    def press(self, model: Any, data: Any, bias: Bias) -> None:
        """Through the bias: the margin stays, a step's inner stages may lift the ball farther than its softness."""
        row = self.row(data)
        if row is not None and data.efc_force[row] > 0:
            bias.walls[self.geoms] = float(data.efc_R[row] * data.efc_force[row])

    def torque(self, sensed: FloatArray, positions: FloatArray, model: Any) -> FloatArray:
        """Its force [N], which the sensor has."""
        return sensed


def stop_holds(mechanism: Mechanism, model: Any) -> dict[str, Hold]:
    """Each stop's limit or wall, by the stop's name."""
    return {
        stop.name: wall(model, stop.name) if isinstance(stop, PointStop) else _limit(model, stop)
        for stop in mechanism.stops
    }


def rails(mechanism: Mechanism, model: Any) -> list[Wall]:
    """Both walls of each slot that closes a loop."""
    return [wall(model, rail_contact(slot.name, side)) for slot in Points(mechanism).slots for side in RAIL_SIDES]


def wall(model: Any, name: str) -> Wall:
    """The wall of that name."""
    pair = model.pair(name)
    return Wall(int(pair.id), (int(pair.geom1[0]), int(pair.geom2[0])))


def _limit(model: Any, stop: Stop) -> Limit:
    types, sensor = mujoco.mjtConstraint, model.sensor(torque_sensor(stop.name))
    on_joint = int(sensor.type[0]) == mujoco.mjtSensor.mjSENS_JOINTLIMITFRC
    element, index = "jnt" if on_joint else "tendon", int(sensor.objid[0])
    low, high = getattr(model, f"{element}_range")[index]
    return Limit(
        element=element,
        index=index,
        end=0 if stop.sense > 0 else 1,
        constraint=int(types.mjCNSTR_LIMIT_JOINT if on_joint else types.mjCNSTR_LIMIT_TENDON),
        range=(float(low), float(high)),
    )
