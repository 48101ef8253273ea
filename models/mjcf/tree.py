"""The tree of a mechanism in MJCF: names of its hinges and slides, and tendons that measure angles by hinges.

A body turns and slides relative to its parent by as many MuJoCo joints as its joint leaves free:
slides first, for the directions of their axes turn with the parent and not with the child.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence

from ..elements import GROUND, AnyJoint, FreeJoint
from ..mechanism import Body, Mechanism


def slide_joints(joint: AnyJoint) -> tuple[str, ...]:
    """Names of the sliding parts of a joint of the tree; its turning part has the joint's own name."""
    if isinstance(joint, FreeJoint):
        return f"{joint.name}/x", f"{joint.name}/y"
    return (f"{joint.name}/slide",) if joint.slides else ()


def joints_of(joint: AnyJoint) -> tuple[str, ...]:
    """Names of all parts of a joint of the tree, slides first."""
    return (*slide_joints(joint), *(() if joint.holds_angle else (joint.name,)))


def hinge_chain(mechanism: Mechanism, body: str) -> tuple[str, ...]:
    """Joints with a hinge from the ground to a body: its angle is the sum of these hinges and that at the start."""
    if body == GROUND:
        return ()
    joint = mechanism.joint_of(body)
    inner = hinge_chain(mechanism, joint.parent)
    return inner if joint.holds_angle else (*inner, joint.name)


def joint_values(mechanism: Mechanism, rates: Sequence[float]) -> list[float]:
    """Speeds of MuJoCo's joints, in its order: depth first, slides before hinges.

    Args:
        mechanism: any.
        rates: of the coordinates, in their order; changes of them since the start give those of the
            joints.
    """
    turning = {
        name: 0.0 if index is None else rates[index]
        for name, (index, _) in mechanism.attitudes.items()
    }
    sliding = dict(zip(mechanism.coordinates, rates, strict=True))
    values: list[float] = []
    for body in outwards(mechanism):
        joint = mechanism.joint_of(body.name)
        values += [sliding[name] for name in joint.slides]
        if not joint.holds_angle:
            values.append(turning[body.name] - turning[joint.parent])
    return values


def outwards(mechanism: Mechanism, parent: str = GROUND) -> Iterator[Body]:
    """The bodies beyond one in MuJoCo's order, depth first."""
    for body in mechanism.children(parent):
        yield body
        yield from outwards(mechanism, body.name)


def start_angles(mechanism: Mechanism) -> dict[str, float]:
    """Angles of the bodies and the ground at the start [rad], by name."""
    return mechanism.tree.configuration(mechanism.start).angles


def hinge_weights(mechanism: Mechanism, body: str, other: str) -> dict[str, int]:
    """Weights of the hinges whose sum is by how much a body's angle less that of another one has changed."""
    up, down = hinge_chain(mechanism, body), hinge_chain(mechanism, other)
    return {name: 1 for name in up if name not in down} | {
        name: -1 for name in down if name not in up
    }


def add_angle_tendon(
    tendon: ET.Element,
    mechanism: Mechanism,
    bodies: tuple[str, ...],
    sense: int = 1,
    **attributes: str,
) -> None:
    """Add a tendon whose length is the first body's angle less that of the second [rad], less the one at the start.

    Args:
        tendon: element that it is added to.
        mechanism: with the bodies.
        bodies: both names.
        sense: -1 for the opposite length.
        attributes: of the tendon.
    """
    fixed = ET.SubElement(tendon, "fixed", attributes)
    weights = hinge_weights(mechanism, *bodies) or _constant(mechanism)
    for name, weight in weights.items():
        ET.SubElement(fixed, "joint", joint=name, coef=str(sense * weight))


def _constant(mechanism: Mechanism) -> dict[str, int]:
    """A weight of zero: of bodies that turn together the angle is constant."""
    names = [name for joint in mechanism.tree_joints for name in joints_of(joint)]
    return dict.fromkeys(names[:1], 0)
