"""The tree of a mechanism in MJCF: hinges, slides and tendons over hinges; numbers and names.

A body turns and slides relative to its parent by as many MuJoCo joints as its joint leaves free:
slides first, for the directions of their axes turn with the parent and not with the child.

MJCF names have letters, digits, `_`, `-` and `.`; importers refuse or misread others. The writer
names elements after the mechanism ("sling pin", "sling pin/force"); in the finished tree every
other character becomes `_`, and a name that is then taken gets a number. Names that differ stay
different.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import count

from ..elements import (
    GROUND,
    JOINTS,
    AnyJoint,
    ElementTable,
    FreeJoint,
    PinJoint,
    PrismaticJoint,
    SlotJoint,
    TranslationJoint,
    WeldJoint,
)
from ..mechanism import Body, Mechanism
from ..spec import Vector

SLIDES: ElementTable[tuple[str, ...]] = ElementTable(
    "the MJCF writer",
    JOINTS,
    {
        PinJoint: (),
        WeldJoint: (),
        SlotJoint: ("slide",),
        PrismaticJoint: ("slide",),
        FreeJoint: ("x", "y"),
        TranslationJoint: ("x", "y"),
    },
)


def slide_joints(joint: AnyJoint) -> tuple[str, ...]:
    """Names of the sliding parts of a tree joint; its turning part has the joint's own name.

    Raises:
        UnsupportedProblemError: the writer does not know this class of joints.
    """
    parts = SLIDES[joint]
    return tuple(f"{joint.name}/{part}" for part in parts) if joint.slides else ()


def joints_of(joint: AnyJoint) -> tuple[str, ...]:
    """Names of all parts of a joint of the tree, slides first."""
    slides = slide_joints(joint)
    return slides if joint.holds_angle else (*slides, joint.name)


def hinge_chain(mechanism: Mechanism, body: str) -> tuple[str, ...]:
    """Joints with a hinge from the ground to a body; these hinges sum to its change of angle."""
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
    turning: dict[str, float] = {}
    for name, (index, _) in mechanism.attitudes.items():
        turning[name] = 0.0 if index is None else rates[index]
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


def hinge_weights(mechanism: Mechanism, body: str, other: str) -> dict[str, float]:
    """Weights of the hinges whose sum is the change of the angle between two bodies."""
    return _summed([(hinge_chain(mechanism, body), 1.0), (hinge_chain(mechanism, other), -1.0)])


def joint_weights(mechanism: Mechanism, weights: Mapping[str, float]) -> dict[str, float]:
    """Weights of hinges and slides whose sum is that of the changes of coordinates."""
    turning = {body.angle: body.name for body in mechanism.bodies}
    slides = {
        coordinate: name
        for joint in mechanism.tree_joints
        for coordinate, name in zip(joint.slides, slide_joints(joint), strict=True)
    }
    chains = {
        name: (slides[name],) if name in slides else hinge_chain(mechanism, turning[name])
        for name in weights
    }
    return _summed([(chains[name], weight) for name, weight in weights.items()])


def _summed(chains: Iterable[tuple[Iterable[str], float]]) -> dict[str, float]:
    """Sums of the weights of chains by joint, without those that cancel."""
    sums: dict[str, float] = {}
    for chain, weight in chains:
        for name in chain:
            sums[name] = sums.get(name, 0.0) + weight
    return {name: weight for name, weight in sums.items() if weight}


def add_angle_tendon(
    tendon: ET.Element,
    mechanism: Mechanism,
    bodies: tuple[str, ...],
    sense: int = 1,
    **attributes: Attribute,
) -> None:
    """Add a tendon whose length is the change of the angle between two bodies [rad].

    Args:
        tendon: element that it is added to.
        mechanism: with the bodies.
        bodies: both names.
        sense: -1 for the opposite length.
        attributes: of the tendon.
    """
    fixed, weights = add(tendon, "fixed", **attributes), hinge_weights(mechanism, *bodies)
    if not weights:  # of bodies that turn together the angle is constant: a weight of zero
        names = [name for joint in mechanism.tree_joints for name in joints_of(joint)]
        weights = dict.fromkeys(names[:1], 0)
    for name, weight in weights.items():
        add(fixed, "joint", joint=name, coef=sense * weight)


# --- Elements, numbers and names

Attribute = str | float | Sequence[float]


def add(
    parent: ET.Element,
    tag: str,
    common: Mapping[str, str] | None = None,
    /,
    **attributes: Attribute,
) -> ET.Element:
    """Add an element; its numbers are written as :func:`number`."""
    element = ET.SubElement(parent, tag, dict(common or {}))
    for name, value in attributes.items():
        if isinstance(value, str):
            element.set(name, value)
        elif isinstance(value, Sequence):
            element.set(name, numbers(*value))
        else:
            element.set(name, number(value))
    return element


def number(value: float) -> str:
    """The shortest decimal that reads back to the same float64."""
    text = repr(float(value) + 0.0)  # + 0.0 turns -0.0 into 0.0
    return text.removesuffix(".0")


def numbers(*values: float) -> str:
    """Several numbers, as :func:`number`, with blanks between them."""
    return " ".join(number(value) for value in values)


def spatial(vector: Vector) -> str:
    """A planar vector in MuJoCo's x-z plane."""
    return numbers(vector[0], 0, vector[1])


def from_origin(origin: Vector, point: Vector) -> str:
    """A point as seen from a frame's origin, both in that frame's axes."""
    return spatial((point[0] - origin[0], point[1] - origin[1]))


def as_text(root: ET.Element) -> str:
    """An element and all below it, indented."""
    ET.indent(root, space="  ")
    return ET.tostring(root, encoding="unicode") + "\n"


_REFERENCES = (
    "name", "body", "body1", "body2", "joint", "joint1", "joint2", "geom1", "geom2", "site",
    "site1", "site2", "refsite", "tendon", "tendon1", "objname",
)  # fmt: skip
_OTHERS = re.compile(r"[^\w.-]")


def _named(root: ET.Element) -> Iterator[ET.Element]:
    """Elements with names; keyframes, which a file may or may not have, have theirs apart."""
    return (element for element in root.iter() if element.tag != "key")


def names_in(root: ET.Element) -> dict[str, str]:
    """The name that each element's name becomes, by the one that the writer gave it."""
    names = (element.get("name") for element in _named(root))
    return valid_names(name for name in names if name is not None)


def rename(root: ET.Element) -> None:
    """Replace the names in a tree, and all references to them."""
    names = names_in(root)
    for element in _named(root):
        for attribute in _REFERENCES:
            if (name := element.get(attribute)) is not None:
                element.set(attribute, names.get(name, name))


def valid_names(names: Iterable[str], taken: Iterable[str] = ()) -> dict[str, str]:
    """A valid, unique name for each; names that are valid already are kept unless taken."""
    names, taken = tuple(dict.fromkeys(names)), set(taken)
    new = {name: name for name in names if not _OTHERS.search(name) and name not in taken}
    taken.update(new)
    for name in names:
        if name in new:
            continue
        valid = base = _OTHERS.sub("_", name)
        numbering = count(2)
        while valid in taken:
            valid = f"{base}_{next(numbering)}"
        new[name] = valid
        taken.add(valid)
    return new
