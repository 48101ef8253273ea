"""What a machine's MJCF shows: rods, balls, stands, and a scene around them; nothing here has mass or touches."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

from ..joints import AnyJoint
from ..kinematics import Kinematics
from ..mechanism import Body, Mechanism
from ..spec import Vector
from .text import as_text, from_origin, number, numbers

SCENE_FILE = "scene.xml"

_COLOURS = ("0.55 0.35 0.17 1", "0.20 0.45 0.70 1", "0.35 0.35 0.38 1", "0.75 0.55 0.20 1")
_DENSITY = 1000.0  # [kg/m^3] of the drawn spheres only


def scene(mechanism: Mechanism, model: str) -> str:
    """MJCF text that includes the model's file and adds light, a floor nothing collides with, and a camera."""
    reach = reach_of(mechanism)
    root = ET.Element("mujoco", model=f"{mechanism.name} scene")
    root.append(ET.Comment(" Only looks: nothing here has mass or touches the machine. "))
    ET.SubElement(root, "include", file=model)
    ET.SubElement(root, "statistic", center=numbers(0, 0, round(-0.2 * reach, 3)), extent=number(round(1.2 * reach, 3)))
    visual = ET.SubElement(root, "visual")
    ET.SubElement(visual, "global", offwidth="960", offheight="720")
    ET.SubElement(visual, "headlight", ambient="0.4 0.4 0.4", diffuse="0.5 0.5 0.5", specular="0 0 0")
    _add_materials(ET.SubElement(root, "asset"))
    world = ET.SubElement(root, "worldbody")
    down = -_floor_depth(reach)
    ET.SubElement(world, "light", pos=numbers(-reach, -2 * reach, 3 * reach), dir="0.3 0.6 -1", directional="true")
    ET.SubElement(
        world, "geom", name="floor", type="plane", pos=numbers(0, 0, down), size="0 0 1", material="floor",
        contype="0", conaffinity="0",
    )  # fmt: skip
    ET.SubElement(
        world, "camera", name="side", pos=numbers(0, round(-2.6 * reach, 3), 0.1 * reach), xyaxes="1 0 0 0 0.1 1"
    )
    return as_text(root)


def add_shapes(mechanism: Mechanism, element: ET.Element, body: Body, origin: Vector, reach: float) -> None:
    """Rods from the joint to whatever hangs on the body, and a ball for a point mass: only to be looked at."""
    colour = _COLOURS[mechanism.bodies.index(body) % len(_COLOURS)]
    thick = 0.009 * reach * (1.0 if body.inertia > 0 else 0.4)
    for point in _ends(mechanism, body, origin):
        ET.SubElement(
            element, "geom", type="capsule", fromto=f"0 0 0 {from_origin(origin, point)}", size=number(round(thick, 6)),
            rgba=colour,
        )  # fmt: skip
    if body.inertia == 0:
        radius = round((0.75 * body.mass / (math.pi * _DENSITY)) ** (1 / 3), 6)
        ET.SubElement(
            element, "geom", type="sphere", pos=from_origin(origin, body.centre), size=number(radius), rgba=colour
        )


def add_stand(world: ET.Element, joint: AnyJoint, reach: float) -> None:
    """Two legs under a pin, or a rail on posts through a slot; nothing where nothing is held."""
    if not joint.held_directions:
        return
    foot, (x, z) = -_floor_depth(reach), joint.parent_point
    if joint.free_directions:
        (axis,) = joint.free_directions
        a, b = (round(0.6 * reach * component, 3) for component in (axis.real, axis.imag))
        ends = ((x - a, z - b), (x + a, z + b))
        rods = [(*ends[0], *ends[1]), *((*end, end[0], foot) for end in ends)]
    else:
        rods = [(x, z, x + step, foot) for step in (round(-0.2 * reach, 3), round(0.2 * reach, 3))]
    look = {"type": "capsule", "size": number(round(0.006 * reach, 6)), "rgba": "0.5 0.5 0.5 1"}
    for x0, z0, x1, z1 in rods:
        ET.SubElement(world, "geom", look, fromto=numbers(x0, 0, z0, x1, 0, z1))


def _ends(mechanism: Mechanism, body: Body, origin: Vector) -> list[Vector]:
    """Points of a body worth a rod from its joint."""
    points = [joint.parent_point for joint in mechanism.tree_joints if joint.parent == body.name]
    for joint in mechanism.loop_joints:
        points += [point for name, point in _members(joint) if name == body.name]
    points = points or [marker.point for marker in mechanism.markers if marker.body == body.name] or [body.centre]
    return [point for point in dict.fromkeys(points) if math.dist(point, origin) > 0]


def _members(joint: AnyJoint) -> tuple[tuple[str, Vector], tuple[str, Vector]]:
    """The two bodies of a joint, and its point on each."""
    return (joint.parent, joint.parent_point), (joint.child, joint.child_point)


def reach_of(mechanism: Mechanism) -> float:
    """A length no point of the machine is farther from its ground joints [m]; at least something."""
    kinematics = Kinematics(mechanism)
    n_bodies = len(mechanism.angles)
    points = [(body.name, body.centre) for body in mechanism.bodies]
    points += [(item.body, item.point) for item in (*mechanism.markers, *mechanism.point_stops)]
    points += [member for joint in mechanism.loop_joints for member in _members(joint)]
    rows = [kinematics.point(*point) for point in points]
    return round(max(float(abs(row.coefficients[:n_bodies]).sum()) for row in rows), 3) or 1.0


def _floor_depth(reach: float) -> float:
    return round(1.05 * reach, 3)


def _add_materials(asset: ET.Element) -> None:
    size = {"width": "256", "height": "256"}
    sky, grass = {"rgb1": "0.75 0.85 0.95", "rgb2": "1 1 1"}, {"rgb1": "0.45 0.55 0.40", "rgb2": "0.50 0.60 0.45"}
    ET.SubElement(asset, "texture", sky | size, type="skybox", builtin="gradient")
    ET.SubElement(asset, "texture", grass | size, name="floor", type="2d", builtin="checker")
    ET.SubElement(asset, "material", name="floor", texture="floor", texuniform="true", texrepeat="0.2 0.2")
