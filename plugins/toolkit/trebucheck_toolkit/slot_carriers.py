"""Slots that close loops, for engines that close loops by pins alone.

A carrier slides in each slot and is pinned to the child. It has a part of the child's mass, taken
from the child, so that the motion, the energies, and the force of the slot are the mechanism's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from trebucheck.models import elements
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics, initial_state
from trebucheck.models.mechanism import Body, Mechanism
from trebucheck.models.mjcf.variants import MassProperties

CARRIED = 0.1
"""Part of the child's mass on a carrier."""
CARRIERS = (
    "a slot that closes a loop is a slide of a carrier, with a tenth of the mass of the body that "
    "is pinned to it, taken from that body"
)
"""What an adapter that states it as a reading does."""
T = TypeVar("T")


def with_carriers(mechanism: Mechanism) -> Mechanism:
    """A mechanism with a carrier on a slide in each slot that closes a loop, pinned to the child.

    The slides of the carriers are the last coordinates. Other joints that close loops stay.

    Raises:
        UnsupportedProblemError: a slot closes a loop on a body that no mass can be taken from.
    """
    bodies = {body.name: body for body in mechanism.bodies}
    joints: dict[str, elements.AnyJoint] = {joint.name: joint for joint in mechanism.joints}
    slots = _slots(mechanism)
    for name, slot in slots.items():
        child, origin = bodies[slot.child], (0.0, 0.0)
        whole = MassProperties(child.mass, complex(*child.centre), child.inertia)
        left = whole.with_mass_at(complex(*slot.child_point), -CARRIED * child.mass)
        if left.inertia < 0:
            raise UnsupportedProblemError(
                f"our adapter takes the mass of the carrier in {slot.name!r}, which the engine "
                f"does not move without, from {slot.child!r}, and that has too little inertia."
            )
        update = vars(left) | {"centre": (left.centre.real, left.centre.imag)}
        bodies[slot.child] = child.model_copy(update=update)
        bodies[name] = Body(name=name, mass=CARRIED * child.mass, centre=origin, inertia=0.0)
        slide = slot.model_dump(exclude={"kind"})
        slide |= {"name": name, "child": name, "child_point": origin, "coordinate": name}
        joints[name] = elements.PrismaticJoint.model_validate(slide)
        joints[slot.name] = elements.PinJoint(
            name=slot.name,
            parent=name,
            parent_point=origin,
            child=slot.child,
            child_point=slot.child_point,
        )
    parts = {"bodies": tuple(bodies.values()), "joints": tuple(joints.values())}
    carried = mechanism.model_copy(update=parts)
    kinematics, known = Kinematics(carried), len(mechanism.coordinates)
    q, u = (np.pad(each, (0, len(slots))) for each in initial_state(mechanism))
    if slots:  # their places and speeds close the loops
        held = kinematics.loop_jacobian(q)[:, known:]
        q[known:] = np.linalg.lstsq(held, -kinematics.loop_residual(q))[0]
        held = kinematics.loop_jacobian(q)
        u[known:] = np.linalg.lstsq(held[:, known:], -held @ u)[0]
    return carried.model_copy(
        update={"start": tuple(q.tolist()), "start_speeds": tuple(u.tolist())}
    )


def slot_forces(mechanism: Mechanism, forces: Mapping[str, T]) -> dict[str, T]:
    """Forces of a mechanism's joints from those of it with carriers: a slot's is its slide's."""
    slots = {carrier: slot.name for carrier, slot in _slots(mechanism).items()}
    pins = frozenset(slots.values())
    return {slots.get(name, name): force for name, force in forces.items() if name not in pins}


def _slots(mechanism: Mechanism) -> dict[str, elements.SlotJoint]:
    """The slots that close loops, by the names of their carriers."""
    return {
        f"{joint.name} carrier": joint
        for joint in mechanism.loop_joints
        if isinstance(joint, elements.SlotJoint)
    }
