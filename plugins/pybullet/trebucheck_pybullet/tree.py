"""A mechanism as a Bullet multibody: its dynamics, and what it shows."""

from __future__ import annotations

from typing import Any

import numpy as np
from trebucheck.models.arrays import FloatArray
from trebucheck.models.mechanism import Mechanism
from trebucheck_toolkit.event_driver import Observation
from trebucheck_toolkit.joint_coordinates import JointCoordinates

from .build import Links, build


class BulletTree:
    """Multibody for dynamics, and an opened one for reactions by inverse dynamics."""

    def __init__(self, mechanism: Mechanism) -> None:
        """Build both."""
        self.mechanism, self.coordinates = mechanism, JointCoordinates(mechanism)
        order = list(self.coordinates.links)
        self.links, self.opened = build(mechanism, order), build(mechanism, order, opened=True)
        self.client: Any = self.links.client
        self.inertias: dict[str, tuple[float, float]] = {}
        for name, link in self.links.carriers.items():
            info = self.client.getDynamicsInfo(self.links.body, link)
            self.inertias[name] = float(info[0]), float(info[2][2])

    # --- Dynamics
    # ---------------------------------------------------------------------------------------------

    def mass_matrix(self, j: FloatArray) -> FloatArray:
        """Mass matrix by `calculateMassMatrix`."""
        return np.array(self.client.calculateMassMatrix(self.links.body, j.tolist()))

    def bias(self, j: FloatArray, v: FloatArray) -> FloatArray:
        """Bias forces by `calculateInverseDynamics`."""
        return _inverse_dynamics(self.links, j, v, np.zeros_like(j))

    def total_mass(self) -> float:
        """Mass of all bodies [kg]."""
        return sum(mass for mass, _ in self.inertias.values())

    def centres(self, j: FloatArray) -> dict[str, FloatArray]:
        """Centre of mass of each body in the world [m]."""
        self.place(j, np.zeros_like(j))
        return {name: np.array(self._link(name)[0][:2]) for name in self.links.carriers}

    def place(self, j: FloatArray, v: FloatArray) -> None:
        """Set the state."""
        for link, at, speed in zip(self.links.moving, j.tolist(), v.tolist(), strict=True):
            self.client.resetJointState(self.links.body, link, at, speed)

    # --- What it shows
    # ---------------------------------------------------------------------------------------------

    def observe(self, j: FloatArray, v: FloatArray, a: FloatArray) -> Observation:
        """Points, speeds and energies of the links; reactions by inverse dynamics."""
        self.place(j, v)
        links = {name: self._link(name) for name in self.links.carriers}
        gravity = np.array(self.mechanism.gravity_vector)
        kinetic = potential = 0.0
        for name, (mass, inertia) in self.inertias.items():
            centre, speed, turning = (np.array(links[name][k]) for k in (0, 6, 7))
            kinetic += 0.5 * (mass * float(speed @ speed) + inertia * float(turning[2]) ** 2)
            potential -= mass * float(gravity @ centre[:2])
        markers = self.mechanism.markers
        return Observation(
            points={
                each.name: self._point(links[each.body], each.body, each.point) for each in markers
            },
            kinetic_energy=kinetic,
            potential_energy=potential,
            reactions=self._reactions(
                j, v, a, {name: turn(link[1]) for name, link in links.items()}
            ),
        )

    def _link(self, name: str) -> Any:
        return self.client.getLinkState(
            self.links.body,
            self.links.carriers[name],
            computeLinkVelocity=1,
            computeForwardKinematics=1,
        )

    def _point(
        self, link: Any, name: str, point: tuple[float, float]
    ) -> tuple[FloatArray, FloatArray]:
        # From the centre of mass: Bullet rounds the pose of the link's own frame to single
        # precision.
        arm = turn(link[1]) @ (np.array(point) - self.mechanism.body(name).centre)
        speed = np.array(link[6][:2]) + link[7][2] * np.array([-arm[1], arm[0]])
        return np.array(link[0][:2]) + arm, speed

    def _reactions(
        self, j: FloatArray, v: FloatArray, a: FloatArray, turned: dict[str, FloatArray]
    ) -> dict[str, FloatArray]:
        forces = _inverse_dynamics(self.opened, *(self._opened(values) for values in (j, v, a)))
        found: dict[str, FloatArray] = {}
        for k, (_, joint) in enumerate(self.coordinates.links):
            force = forces[3 * k : 3 * k + 2]
            found[joint.name] = turned[joint.parent] @ force if joint.parent in turned else force
        return found

    def _opened(self, values: FloatArray) -> FloatArray:
        """Coordinates, speeds or accelerations of the opened tree."""
        rows = {joint.name: np.zeros(3) for _, joint in self.coordinates.links}
        for freedom, value in zip(self.coordinates.freedoms, values, strict=True):
            d = freedom.direction
            rows[freedom.joint.name] += value * (
                np.array([0, 0, 1]) if d is None else np.array([d.real, d.imag, 0])
            )
        return np.concatenate(list(rows.values()))


def _inverse_dynamics(links: Links, j: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
    return np.array(
        links.client.calculateInverseDynamics(links.body, j.tolist(), v.tolist(), a.tolist())
    )


def turn(quaternion: tuple[float, float, float, float]) -> FloatArray:
    """Rotation in the plane of a quaternion (x, y, z, w) about z."""
    z, w = quaternion[2:]
    cos, sin = w * w - z * z, 2 * z * w
    return np.array([[cos, -sin], [sin, cos]])
