"""The scene of a mechanism for Rapier, which has no joint that both slides and turns."""

from __future__ import annotations

import numpy as np
from trebucheck.models.elements import SlotJoint
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck_toolkit.node_scene import MIRROR, Json, NodeScene


class RapierScene(NodeScene):
    """A mechanism's scene; carriages of slots come after its bodies."""

    def __init__(self, mechanism: Mechanism, carriage: float | None) -> None:
        """Make the scene.

        Args:
            mechanism: what is built; each body has an inertia.
            carriage: mass of the body in a slot, as a part of that of the body it carries; None:
                there are no slots.
        """
        self.carriage = carriage
        super().__init__(mechanism, "rapier")

    def _join_slot(self, joint: SlotJoint, ends: Json) -> None:
        """A slide of a carriage, and a pin on it."""
        rider = self._add_carriage(joint)
        self.joints.append(ends | {"kind": "slide", "axis": self.axis(joint).tolist()} | rider)
        self._pin(joint, ends | {"a": rider["b"], "pointA": [0.0, 0.0]})

    def _add_carriage(self, joint: SlotJoint) -> Json:
        """A small body in a slot, which the child is pinned to."""
        row, child = (
            self.kinematics.point(joint.child, joint.child_point),
            self.mechanism.body(joint.child),
        )
        assert self.carriage is not None  # slots are refused without one
        mass = self.carriage * child.mass
        self.others.append(f"carriage of {joint.name}")
        self.bodies.append(
            {
                "position": (self.kinematics.position(row, self.q) * MIRROR).tolist(),
                "velocity": (self.kinematics.velocity(row, self.q, self.u) * MIRROR).tolist(),
                "speed": float(self.kinematics.angle(joint.parent).coefficients @ self.u),
                "mass": mass,
                "inertia": mass * self._lever(child) ** 2,
            }
        )
        return {"b": len(self.bodies) - 1, "pointB": [0.0, 0.0]}

    def _lever(self, body: Body) -> float:
        points = [joint.child_point for joint in self.mechanism.joints if joint.child == body.name]
        points += [
            joint.parent_point for joint in self.mechanism.joints if joint.parent == body.name
        ]
        return max(float(np.hypot(*np.subtract(point, body.centre))) for point in points) or 1.0
