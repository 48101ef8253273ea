"""The Bullet multibody of a mechanism: a URDF tree in the x-y plane, turning about -z (clockwise).

Bullet's joints have one coordinate each: a slide is a prismatic joint onto a link without mass,
which a revolute joint follows. `changeDynamics` does not set the inertia of a link that
`createMultiBody` made; that of a URDF is taken.
"""

from __future__ import annotations

import cmath
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pybullet
from trebucheck.models.elements import GROUND, AnyJoint
from trebucheck.models.mechanism import Body, Mechanism

from .engine import NO_LIMIT

_CLOCKWISE = "0 0 -1"
_THICKNESS = 1e-9  # of the square of a body's centre of mass from its joint: beyond rounding


class Client:
    """Own physics client; `pybullet_utils.bullet_client` would print a line for each."""

    def __init__(self) -> None:
        self._id = pybullet.connect(pybullet.DIRECT)

    def __getattr__(self, name: str) -> Any:
        return partial(getattr(pybullet, name), physicsClientId=self._id)

    def __del__(self) -> None:
        with suppress(pybullet.error, TypeError):  # when Python ends, it may be gone before
            pybullet.disconnect(self._id)


@dataclass(frozen=True)
class Links:
    """A multibody in a client of its own, by the index of its links."""

    client: Client
    body: int
    carriers: dict[str, int]
    """Link of each body of the mechanism, whose frame lies at its joint's `child_point`."""
    moving: list[int]
    """Links whose joints move, in their order."""


def urdf(
    mechanism: Mechanism,
    order: Sequence[tuple[Body, AnyJoint]],
    opened: bool = False,
    ranges: Mapping[str, tuple[float, float]] | None = None,
) -> str:
    """The tree of a mechanism's joints as URDF.

    Args:
        mechanism: what is built.
        order: its bodies with their joints, parents first.
        opened: each body on two prismatic joints along its parent's x and y and a revolute one,
            whatever its joint holds: the joint forces of such a tree's inverse dynamics are the
            reactions.
        ranges: limits [rad] of turns, by the names of the bodies that turn.
    """
    root = ET.Element("robot", name="mechanism")
    _add_link(root, GROUND, 0.0, 0.0, (0.0, 0.0))
    for body, joint in order:
        joints = list(_joints(body, joint, opened))
        _add_body(root, body, joint, joints, mechanism, (ranges or {}).get(body.name))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def loaded(text: str, gravity: tuple[float, float], bodies: Collection[str]) -> Links:
    """A multibody of URDF in a client of its own, its joints without Bullet's motors.

    Args:
        text: URDF.
        gravity: in the plane [m/s^2].
        bodies: names of the links that are noted.
    """
    client = Client()
    client.setGravity(*gravity, 0.0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mechanism.urdf"
        path.write_text(text, encoding="utf-8")
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_MAINTAIN_LINK_ORDER
        multibody = client.loadURDF(str(path), useFixedBase=True, flags=flags)
    found = Links(client, multibody, {}, [])
    for link in range(client.getNumJoints(multibody)):
        info = client.getJointInfo(multibody, link)
        if (name := info[12].decode()) in bodies:
            found.carriers[name] = link
        if info[2] != pybullet.JOINT_FIXED:
            found.moving.append(link)
            # On at the start.
            client.setJointMotorControl2(multibody, link, pybullet.VELOCITY_CONTROL, force=0)
    return found


def build(
    mechanism: Mechanism, order: Sequence[tuple[Body, AnyJoint]], opened: bool = False
) -> Links:
    """Build a multibody without damping in a client of its own; arguments as of :func:`urdf`."""
    names = {body.name for body in mechanism.bodies}
    found = loaded(urdf(mechanism, order, opened), mechanism.gravity_vector, names)
    client, multibody = found.client, found.body
    for link in range(-1, client.getNumJoints(multibody)):
        client.changeDynamics(
            multibody,
            link,
            linearDamping=0,
            angularDamping=0,
            jointDamping=0,
            maxJointVelocity=NO_LIMIT,
        )
    return found


def _joints(body: Body, joint: AnyJoint, opened: bool) -> Iterator[tuple[str, str]]:
    """Kinds and axes of Bullet's joints for one of the mechanism's."""
    directions = (1.0, 1j) if opened else joint.free_directions
    for direction in directions:
        # The axis is in the joint's frame, which may be turned from the parent's.
        axis = direction * cmath.exp(1j * (joint.turned_by or 0.0))
        yield "prismatic", f"{axis.real!r} {axis.imag!r} 0"
    if opened or body.angle is not None:
        yield "continuous", _CLOCKWISE
    elif not directions:
        yield "fixed", _CLOCKWISE


def _add_body(
    root: ET.Element,
    body: Body,
    joint: AnyJoint,
    joints: list[tuple[str, str]],
    mechanism: Mechanism,
    limits: tuple[float, float] | None,
) -> None:
    parent, at = joint.parent, _origin(joint, mechanism)
    for k, (kind, axis) in enumerate(joints):
        last = k == len(joints) - 1
        child = body.name if last else f"{body.name} on {k}"
        made = _add_joint(root, f"{joint.name} {k}", kind, axis, parent, child, at)
        if last and limits is not None:
            _limit(made, *limits)
        parent, at = child, ("0 0 0", "0 0 0")
        if not last:
            _add_link(root, child, 0.0, 0.0, (0.0, 0.0))
    # The link's frame is where its joint is, at `child_point`.
    centre = (body.centre[0] - joint.child_point[0], body.centre[1] - joint.child_point[1])
    _add_link(root, body.name, body.mass, body.inertia, centre)


def _origin(joint: AnyJoint, mechanism: Mechanism) -> tuple[str, str]:
    """Place and turn of a joint in its parent's link, framed at the parent's `child_point`."""
    x, y = joint.parent_point
    if joint.parent != GROUND:
        own = mechanism.joint_of(joint.parent).child_point
        x, y = x - own[0], y - own[1]
    return f"{x!r} {y!r} 0", f"0 0 {-(joint.turned_by or 0.0)!r}"


def _add_link(
    root: ET.Element, name: str, mass: float, inertia: float, centre: tuple[float, float]
) -> None:
    inertial = ET.SubElement(ET.SubElement(root, "link", name=name), "inertial")
    ET.SubElement(inertial, "origin", xyz=f"{centre[0]!r} {centre[1]!r} 0")
    ET.SubElement(inertial, "mass", value=repr(mass))
    # The inertias about axes in the plane play no part. Bullet refuses a body of which they are
    # less, together, than the third about its joint: of a flat one rounding would decide that.
    across = inertia + _THICKNESS * mass * (centre[0] ** 2 + centre[1] ** 2)
    diagonal = {"ixx": across, "iyy": across, "izz": inertia}
    ET.SubElement(
        inertial,
        "inertia",
        {k: repr(v) for k, v in diagonal.items()} | dict.fromkeys(("ixy", "ixz", "iyz"), "0"),
    )


def _add_joint(
    root: ET.Element, name: str, kind: str, axis: str, parent: str, child: str, at: tuple[str, str]
) -> ET.Element:
    made = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(made, "parent", link=parent)
    ET.SubElement(made, "child", link=child)
    ET.SubElement(made, "origin", xyz=at[0], rpy=at[1])
    ET.SubElement(made, "axis", xyz=axis)
    # lower > upper: no limits
    ET.SubElement(made, "limit", lower="1", upper="-1", effort="0", velocity="0")
    return made


def _limit(made: ET.Element, low: float, high: float) -> None:
    """Turn a continuous joint into one with limits [rad]."""
    made.set("type", "revolute")
    limits = made.find("limit")
    assert limits is not None
    limits.set("lower", repr(max(low, -NO_LIMIT)))
    limits.set("upper", repr(min(high, NO_LIMIT)))
