"""Motion and readings of a mechanism by Pinocchio; states are in mechanism coordinates."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from trebucheck.engines.events import Contacts
from trebucheck.models.arrays import FloatArray
from trebucheck.models.mechanism import Mechanism
from trebucheck_toolkit.constrained import ConstrainedDynamics, Solved, subtree_sums
from trebucheck_toolkit.event_driver import Observation
from trebucheck_toolkit.schemes import State

from .build import Built


class Model:
    """Pinocchio's forward dynamics."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.built = Built(mechanism)
        self.model, self.data, self.coordinates = (
            self.built.model,
            self.built.data,
            self.built.coordinates,
        )

    def accelerations(self, q: FloatArray, u: FloatArray, applied: FloatArray) -> FloatArray:
        """Accelerations by `aba`."""
        to = self.coordinates
        a = pin.aba(self.model, self.data, to.positions(q), to.speeds(u), to.forces(applied))
        return to.mechanism_speeds(np.array(a))

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """Mass matrix by `crba`."""
        upper = np.triu(pin.crba(self.model, self.data, self.coordinates.positions(q)))
        return self.coordinates.mass_matrix(upper + np.triu(upper, 1).T)

    def bias(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """Bias forces of gravity and motion, with M a = -bias where nothing else acts."""
        to = self.coordinates
        forces = pin.nonLinearEffects(self.model, self.data, to.positions(q), to.speeds(u))
        return np.linalg.solve(to.sums.T, np.array(forces))


class Motion(ConstrainedDynamics):
    """The model moved by a scheme, stops and loops held by multipliers."""

    def __init__(self, mechanism: Mechanism, scheme: str) -> None:
        self.pinocchio = Model(mechanism)
        super().__init__(mechanism, self.pinocchio)
        self.scheme = scheme

    def advance(self, state: State, step: float, held: Contacts) -> State:
        """The state a step [s] later, contacts and loops held."""
        return self.stepped(state, step, held, self.scheme)

    def observe(self, q: FloatArray, u: FloatArray, solved: Solved) -> Observation:
        """Points, energies and joint forces, as Pinocchio has them."""
        model, data, built = self.pinocchio.model, self.pinocchio.data, self.pinocchio.built
        to = built.coordinates
        j, v, a = to.positions(q), to.speeds(u), to.speeds(solved.accelerations)
        pin.rnea(model, data, j, v, a)  # after it, data.f are the joint forces
        pin.forwardKinematics(model, data, j, v, a)
        pin.updateFramePlacements(model, data)
        needed = self._needed_by_subtrees()
        others = subtree_sums(self.mechanism, self.forces_on_bodies(q, u, solved))
        return Observation(
            points={name: self._point(frame) for name, frame in built.markers.items()},
            kinetic_energy=float(pin.computeKineticEnergy(model, data)),
            potential_energy=float(pin.computePotentialEnergy(model, data, j))
            + float(self.applied.potential_energy(q)),
            reactions={
                joint.name: needed[joint.name] - others[joint.name]
                for joint in self.mechanism.tree_joints
                if joint.held_directions
            }
            | dict(solved.loops),
        )

    def _needed_by_subtrees(self) -> dict[str, FloatArray]:
        """Force of each tree joint if only gravity acted beyond it [N], by name.

        It is the joint force of `rnea`. A weld is no joint of Pinocchio's: there it is what the
        welded body's acceleration and the joints on it ask for.
        """
        built, mechanism = self.pinocchio.built, self.mechanism
        needed: dict[str, FloatArray] = {}
        for body, joint in reversed(
            list(zip(mechanism.bodies, mechanism.tree_joints, strict=True))
        ):
            if joint.free_directions or body.angle is not None:
                needed[joint.name] = self._joint_force(built.places[body.name].joint)
            else:
                beyond = (
                    needed[mechanism.joint_of(child.name).name]
                    for child in mechanism.children(body.name)
                )
                needed[joint.name] = sum(
                    beyond, body.mass * self._felt_by(built.centres[body.name])
                )
        return needed

    def _joint_force(self, joint: int) -> FloatArray:
        data = self.pinocchio.data
        return np.array((data.oMi[joint].rotation @ data.f[joint].linear)[:2])

    def _felt_by(self, frame: int) -> FloatArray:
        """Acceleration of a point without gravity [m/s^2]."""
        model, data = self.pinocchio.model, self.pinocchio.data
        a = pin.getFrameClassicalAcceleration(
            model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        ).linear
        return np.array((a - model.gravity.linear)[:2])

    def _point(self, frame: int) -> tuple[FloatArray, FloatArray]:
        model, data = self.pinocchio.model, self.pinocchio.data
        velocity = pin.getFrameVelocity(
            model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        ).linear
        return np.array(data.oMf[frame].translation[:2]), np.array(velocity[:2])
