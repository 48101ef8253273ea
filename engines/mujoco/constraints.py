"""The unilateral constraints of a built model besides its joints, as MuJoCo's constraint rows.

A stop is a limit of a joint or tendon, or a contact of a point's sphere with a plane, or with a box
on a body that moves; a slot that closes a loop is two such contacts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.mechanism import Mechanism
from ...models.mjcf.points import RAIL_SIDES, Points, rail_contact, torque_sensor
from ...models.mjcf.writer import FAR, MARGIN, mjcf_names
from ...models.stops import PointStop, Stop
from .reference_acceleration import ReferenceAccelerationCorrection, mujoco


@dataclass(frozen=True)
class Limit:
    """A stop on angles as the limit of a joint or of a tendon.

    MuJoCo's constraints are soft: under a force f one gives way by R f / (k d), with its
    regularisation R, stiffness k and impedance d.
    """

    element: str
    """'jnt' or 'tendon', the prefix of the model's arrays."""
    index: int
    end: int
    """0 for the lower end of the range, 1 for the upper."""
    constraint: int
    """MuJoCo's type of its constraint rows."""
    range: tuple[float, float]
    """Of the joint or tendon, before anything was removed [rad]."""

    def remove(self, model: Any) -> None:
        """Remove the limit from the model; the other end of the range stays."""
        getattr(model, f"{self.element}_range")[self.index, self.end] = FAR if self.end else -FAR

    def restore(self, model: Any) -> None:
        """Put the limit back into the model."""
        getattr(model, f"{self.element}_range")[self.index, self.end] = self.range[self.end]

    def row(self, data: Any) -> int | None:
        """Its row among the constraints that are present; None if it is out of reach."""
        rows = np.flatnonzero((data.efc_type == self.constraint) & (data.efc_id == self.index))
        return int(rows[0]) if len(rows) else None

    def gap(self, model: Any, data: Any) -> float:
        """Its gap as MuJoCo measures its joint or tendon [rad]; negative in penetration."""
        on_tendon = self.element == "tendon"
        value = (
            data.ten_length[self.index] if on_tendon else data.qpos[model.jnt_qposadr[self.index]]
        )
        return float((1 - 2 * self.end) * (value - self.range[self.end]))

    def activate(self, model: Any, data: Any, correction: ReferenceAccelerationCorrection) -> None:
        """Let it act at its current gap, without preload: its margin is set just above the gap."""
        self._set_margin(model, self.gap(model, data) + MARGIN)

    def deactivate(self, model: Any, correction: ReferenceAccelerationCorrection) -> None:
        """Let it act in penetration only: its margin is set to zero."""
        self._set_margin(model, 0.0)

    def preload(
        self, model: Any, data: Any, correction: ReferenceAccelerationCorrection, forces: FloatArray
    ) -> None:
        """If it pushes, make up for its softness by its margin: the acceleration k d (margin - gap) is then R f.

        Args:
            model, data, correction: of MuJoCo.
            forces: f of all constraint rows.
        """
        row = self.row(data)
        if row is not None and forces[row] > 0:
            stiffness, _, impedance, _ = data.efc_KBIP[row]
            penetration = data.efc_R[row] * forces[row] / (stiffness * impedance)
            self._set_margin(model, self.gap(model, data) + penetration)

    def _set_margin(self, model: Any, margin: float) -> None:
        getattr(model, f"{self.element}_margin")[self.index] = margin

    def torque(self, sensed: FloatArray, positions: FloatArray, model: Any) -> FloatArray:
        """Its torque [N m] from its sensor's values (n,) and the joints' positions (n, n_q).

        Where two stops are the ends of one range, the nearer one has the sensor's torque.
        """
        if self.element == "tendon":
            return sensed
        value = positions[:, int(model.jnt_qposadr[self.index])]
        own, other = self.range[self.end], self.range[1 - self.end]
        return np.where(np.abs(value - own) < np.abs(value - other), sensed, 0.0)


@dataclass(frozen=True)
class PointContact:
    """A frictionless contact of a sphere with a wall: a stop on a point, or one side of a slot; as :class:`Limit`."""

    index: int
    """Of the pair of geoms."""
    geoms: tuple[int, int]
    """Wall and sphere, in the order that MuJoCo's contacts have: a plane before the sphere, the sphere before a box."""
    margin: float
    """Of the pair, before anything was removed [m]."""

    def remove(self, model: Any) -> None:
        """Set the margin so low that the sphere never comes within it."""
        model.pair_margin[self.index] = -FAR

    def restore(self, model: Any) -> None:
        """Set the margin back."""
        model.pair_margin[self.index] = self.margin

    def row(self, data: Any) -> int | None:
        """Its row among the constraints that are present; None if the sphere is out of reach."""
        contacts = np.flatnonzero((data.contact.geom == self.geoms).all(axis=1))
        row = int(data.contact.efc_address[contacts[0]]) if len(contacts) else -1
        return row if row >= 0 else None

    def gap(self, model: Any, data: Any) -> float:
        """Distance of the sphere from the wall [m]."""
        wall, sphere = sorted(
            self.geoms, key=lambda geom: model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_SPHERE
        )
        thickness = (
            0.0
            if model.geom_type[wall] == mujoco.mjtGeom.mjGEOM_PLANE
            else model.geom_size[wall, 2]
        )
        normal = data.geom_xmat[wall].reshape(3, 3)[:, 2]
        apart = (data.geom_xpos[sphere] - data.geom_xpos[wall]) @ normal
        return float(apart - thickness - model.geom_size[sphere, 0])

    def activate(self, model: Any, data: Any, correction: ReferenceAccelerationCorrection) -> None:
        """As :meth:`deactivate`: its margin is wide enough."""
        self.deactivate(model, correction)

    def deactivate(self, model: Any, correction: ReferenceAccelerationCorrection) -> None:
        """Let its margin give no acceleration."""
        correction.contacts[self.geoms] = 0.0

    def preload(
        self, model: Any, data: Any, correction: ReferenceAccelerationCorrection, forces: FloatArray
    ) -> None:
        """As :meth:`Limit.preload`, by the correction: inner stages of a step may lift the sphere beyond a margin."""
        row = self.row(data)
        if row is not None and forces[row] > 0:
            correction.contacts[self.geoms] = float(data.efc_R[row] * forces[row])

    def torque(self, sensed: FloatArray, positions: FloatArray, model: Any) -> FloatArray:
        """Its force [N], as the sensor gives it."""
        return sensed


UnilateralConstraint = Limit | PointContact
"""One constraint row that only pushes."""


def stop_constraints(mechanism: Mechanism, model: Any) -> dict[str, UnilateralConstraint]:
    """Each stop's limit or contact, by the stop's name."""
    names = mjcf_names(mechanism)
    return {
        stop.name: _contact(model, names[stop.name])
        if isinstance(stop, PointStop)
        else _limit(model, names[torque_sensor(stop.name)], stop)
        for stop in mechanism.stops
    }


def stop_contacts(mechanism: Mechanism, model: Any) -> list[PointContact]:
    """The contacts of the stops on points."""
    names = mjcf_names(mechanism)
    return [_contact(model, names[stop.name]) for stop in mechanism.point_stops]


def slot_contacts(mechanism: Mechanism, model: Any) -> list[PointContact]:
    """Both contacts of each slot that closes a loop."""
    names = mjcf_names(mechanism)
    return [
        _contact(model, names[rail_contact(slot.name, side)])
        for slot in Points(mechanism).slots
        for side in RAIL_SIDES
    ]


def _contact(model: Any, name: str) -> PointContact:
    pair = model.pair(name)
    first, second = sorted(
        (int(pair.geom1[0]), int(pair.geom2[0])), key=lambda geom: model.geom_type[geom]
    )
    return PointContact(int(pair.id), (first, second), float(pair.margin[0]))


def _limit(model: Any, name: str, stop: Stop) -> Limit:
    types, sensor = mujoco.mjtConstraint, model.sensor(name)
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
