"""Forces of pins that close loops, for engines that tell what such pins do to bodies alone.

A body's loop pins exert one resultant on it. The engine tells it, or it is what Newton's law leaves
over (:func:`left_over`). The pins' forces follow from the resultants by a balance of each body.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import GROUND
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.mechanism import Mechanism


class LoopPins:
    """The pins that close a mechanism's loops.

    Pins that form a chain or a tree of bodies have one force each, whether or not the mechanism is
    overconstrained; pins that form a closed chain by themselves do not.

    Raises:
        UnsupportedProblemError: the forces do not follow from the resultants.
    """

    def __init__(self, mechanism: Mechanism, engine: str) -> None:
        """Note which bodies each pin acts on; the engine's name is for messages."""
        self.names = [joint.name for joint in mechanism.loop_joints]
        ends = [(joint.child, joint.parent) for joint in mechanism.loop_joints]
        self.bodies = sorted({name for pair in ends for name in pair} - {GROUND})
        acts = np.zeros((len(self.bodies), len(ends)))
        for column, pair in enumerate(ends):
            for body, sign in zip(pair, (1.0, -1.0), strict=True):
                if body != GROUND:
                    acts[self.bodies.index(body), column] = sign
        if ends and np.linalg.matrix_rank(acts) < len(ends):
            text = (
                f"our adapter of {engine} reads the forces of pins that close loops off their sums "
                f"on bodies, from which those of {', '.join(self.names)} do not follow."
            )
            raise UnsupportedProblemError(text)
        self._solve = np.linalg.pinv(acts)

    def forces(self, resultants: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Force of each pin on its child [N], from the resultant on each of the `bodies`.

        All are of shape (..., 2), in one frame.
        """
        if not self.names:
            return {}
        on_bodies = np.stack([resultants[name] for name in self.bodies])
        return dict(zip(self.names, np.tensordot(self._solve, on_bodies, 1), strict=True))


def left_over(
    mechanism: Mechanism,
    accelerations: Mapping[str, FloatArray],
    reactions: Mapping[str, FloatArray],
    applied: Mapping[str, FloatArray],
) -> dict[str, FloatArray]:
    """Resultant of the pins that close loops on each body [N]: what Newton's law leaves over.

    Args:
        mechanism: whose bodies move.
        accelerations: of the centres of mass [m/s^2], of those bodies that are asked for.
        reactions: force of each joint of the tree on its child [N]; those left out exert none.
        applied: other forces on bodies but gravity [N].
    """
    gravity = np.array(mechanism.gravity_vector)
    found: dict[str, FloatArray] = {}
    for name, acceleration in accelerations.items():
        force = mechanism.body(name).mass * (acceleration - gravity) - applied.get(name, 0.0)
        for joint in mechanism.tree_joints:
            sign = (joint.child == name) - (joint.parent == name)
            if sign and joint.name in reactions:
                force = force - sign * reactions[joint.name]
        found[name] = force
    return found
