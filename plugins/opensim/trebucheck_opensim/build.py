"""The OpenSim model of a mechanism: a tree of custom joints in the x-y plane, turning about -z.

One custom joint has all the slides and the turn of a body: translations along directions of its
parent, then the rotation. Every coordinate has an actuator, which takes the generalized forces of
springs, motors and what is held.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import opensim as osim
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND, AnyJoint
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck_toolkit.joint_coordinates import JointCoordinates

osim.Logger.setLevelString("error")


class Built:
    """A mechanism's model, and a state of it."""

    def __init__(
        self,
        mechanism: Mechanism,
        add: Callable[[Built], None] | None = None,
        *,
        actuated: bool = True,
    ) -> None:
        """Build the model; `add` adds to it before it is finished."""
        self.mechanism = mechanism
        self.coordinates = JointCoordinates(mechanism)
        self.model = osim.Model()
        self.model.setName("mechanism")
        self.model.setGravity(in_space(mechanism.gravity_vector))
        self.bodies = {GROUND: self.model.getGround()}
        self.joints: dict[str, osim.Joint] = {}
        self._names: dict[int, str] = {}
        for body, joint in self.coordinates.links:
            self._add(body, joint)
        actuated_names = sorted(self._names.items()) if actuated else []
        self.actuators = [self._actuator(name) for _, name in actuated_names]
        """A generalized force on each joint coordinate, zero unless it is set in a state."""
        if add is not None:
            add(self)
        self.state = self.model.initSystem()
        for actuator in self.actuators:
            actuator.overrideActuation(self.state, True)
        self.moving = [
            self.model.getCoordinateSet().get(name) for _, name in sorted(self._names.items())
        ]
        """OpenSim's coordinates in the order of the joint coordinates."""
        self.places = self._places(self.state.getNU())

    def place(self, q: FloatArray, u: FloatArray, state: osim.State) -> None:
        """Set a state of the model."""
        to = self.coordinates
        for coordinate, j, v in zip(self.moving, to.positions(q), to.speeds(u), strict=True):
            coordinate.setValue(state, float(j), False)
            coordinate.setSpeedValue(state, float(v))

    def coordinates_of(self, state: osim.State) -> tuple[FloatArray, FloatArray]:
        """The mechanism's coordinates and speeds in a state of the model."""
        j = np.array([coordinate.getValue(state) for coordinate in self.moving])
        v = np.array([coordinate.getSpeedValue(state) for coordinate in self.moving])
        return self.coordinates.mechanism_positions(j), self.coordinates.mechanism_speeds(v)

    def apply(self, generalized: FloatArray, state: osim.State) -> None:
        """Set the generalized forces on the mechanism's coordinates [N m, N] in a state."""
        for actuator, force in zip(
            self.actuators, self.coordinates.forces(generalized), strict=True
        ):
            actuator.setOverrideActuation(state, float(force))

    def _places(self, n: int) -> FloatArray:
        """Index of each joint coordinate among Simbody's speeds."""
        state, places = osim.State(self.state), []
        for coordinate in self.moving:
            for other in self.moving:
                other.setSpeedValue(state, 0.0)
            coordinate.setSpeedValue(state, 1.0)
            speeds = state.getU()
            places.append(next(k for k in range(n) if speeds.get(k) == 1.0))
        return np.array(places, dtype=int)

    def _add(self, body: Body, joint: AnyJoint) -> None:
        # Of a flat body the inertias in its plane are half of that about its normal.
        half = 0.5 * body.inertia
        link = osim.Body(
            _named(body.name),
            body.mass,
            in_space(body.centre),
            osim.Inertia(half, half, body.inertia),
        )
        self.bodies[body.name] = link
        self.model.addBody(link)
        turned = joint.turned_by or 0.0
        frames = (
            self.bodies[joint.parent],
            in_space(joint.parent_point),
            osim.Vec3(0.0, 0.0, -turned),
            link,
            in_space(joint.child_point),
            osim.Vec3(0.0),
        )
        freedoms = [
            (k, f) for k, f in enumerate(self.coordinates.freedoms) if f.joint.name == joint.name
        ]
        if not freedoms:
            made = osim.WeldJoint(_named(joint.name), *frames)
        else:
            made = osim.CustomJoint(_named(joint.name), *frames, self._transform(freedoms, turned))
        for k, _ in freedoms:
            self._names[k] = f"freedom_{k}"
        self.joints[joint.name] = made
        self.model.addJoint(made)

    def _transform(self, freedoms: list, turned: float) -> osim.SpatialTransform:
        """Slides along their directions, then the turn about -z."""
        transform = osim.SpatialTransform()
        axes = [transform.upd_rotation1(), transform.upd_rotation2(), transform.upd_rotation3()]
        for axis, vector in zip(axes, ((0, 0, -1), (1, 0, 0), (0, 1, 0)), strict=True):
            axis.setAxis(osim.Vec3(*map(float, vector)))
        slides = [
            transform.upd_translation1(),
            transform.upd_translation2(),
            transform.upd_translation3(),
        ]
        # Directions are in the parent's frame, and the joint's frame may be turned from it; all
        # three axes are set, because none may be along another.
        along = [
            f.direction * np.exp(1j * turned) for _, f in freedoms if f.direction is not None
        ] or [1.0 + 0j]
        across = along[1] if len(along) > 1 else 1j * along[0]
        vectors = (
            in_space((along[0].real, along[0].imag)),
            in_space((across.real, across.imag)),
            osim.Vec3(0, 0, 1),
        )
        for axis, vector in zip(slides, vectors, strict=True):
            axis.setAxis(vector)
        for k, freedom in freedoms:
            axis = axes[0] if freedom.direction is None else slides.pop(0)
            axis.setCoordinateNames(osim.ArrayStr(f"freedom_{k}", 1))
            axis.set_function(osim.LinearFunction(1.0, 0.0))
        return transform

    def _actuator(self, name: str) -> osim.CoordinateActuator:
        actuator = osim.CoordinateActuator(name)
        actuator.setName(f"force_{name}")
        actuator.setOptimalForce(1.0)
        self.model.addForce(actuator)
        return actuator


def in_space(point: tuple[float, float]) -> osim.Vec3:
    """A vector of the plane in space."""
    return osim.Vec3(float(point[0]), float(point[1]), 0.0)


def _named(name: str) -> str:
    """A name as OpenSim takes it."""
    return "".join(c if c.isalnum() else "_" for c in name) + "_"
