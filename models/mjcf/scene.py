"""The scene around a mechanism: ground, frame, rails, boards, light, and a fitted camera."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import FloatArray
from ..elements import GROUND, AnyJoint, PointStop
from ..kinematics import Kinematics
from ..mechanism import Mechanism
from ..spec import Vector
from .appearance import WOOD, Appearance, Shapes, points_of
from .recorded import RecordedMotion
from .tree import as_text, number, numbers

SCENE_FILE = "scene.xml"

FIELD = 35.0
"""Vertical field of view of its camera [deg]."""
AZIMUTH, ELEVATION = 14.0, 7.0
"""Direction of its camera, left of the plane's normal and above the horizontal [deg]."""
_FRAME = "0.42 0.29 0.17 1"
_ASPECT = 4 / 3
_MARGIN = 0.96  # of the picture is used


def scene(mechanism: Mechanism, model: str, motion: RecordedMotion | None = None) -> str:
    """MJCF text that includes the model's file and adds ground, frame, light and a camera.

    Args:
        mechanism: any.
        model: name of the file of its MJCF.
        motion: that the ground, the frame and the camera are fitted to; without it they are far
            enough for any.
    """
    return as_text(_Scene(mechanism, motion).root(model))


def ground_level(mechanism: Mechanism, motion: RecordedMotion | None) -> float:
    """Height of the scene's ground [m]."""
    return _Scene(mechanism, motion).ground


def corners(mechanism: Mechanism, motion: RecordedMotion | None) -> FloatArray:
    """Corners of what the scene's camera shows, in MuJoCo's axes [m], shape (8, 3)."""
    return np.array(list(_Scene(mechanism, motion).corners()))


def line_of_sight() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Unit vectors of the scene's camera in MuJoCo's axes: line of sight, right and up."""
    sa, ca, se, ce = (
        f(math.radians(a)) for a in (AZIMUTH, ELEVATION) for f in (math.sin, math.cos)
    )
    view, right = np.array([sa * ce, ca * ce, -se]), np.array([ca, -sa, 0.0])
    return view, right, np.cross(right, view)


def viewpoint(points: FloatArray, aspect: float = _ASPECT) -> FloatArray:
    """Nearest position of the scene's camera that shows all points [m], shape (3,).

    Args:
        points: in MuJoCo's axes [m], shape (n, 3).
        aspect: width over height of the picture.
    """
    view, right, up = line_of_sight()
    tangents = math.tan(math.radians(FIELD) / 2) * np.array([aspect, 1.0]) * _MARGIN
    depth = points @ view
    lows, highs = zip(*_limits(points, (right, up), depth, tangents), strict=True)
    nearest = min(
        (high - low) / (2 * t) for low, high, t in zip(lows, highs, tangents, strict=True)
    )
    middle = [(low + high) / 2 for low, high in zip(lows, highs, strict=True)]
    return nearest * view + middle[0] * right + middle[1] * up


@dataclass(frozen=True)
class _Scene:
    mechanism: Mechanism
    motion: RecordedMotion | None

    @cached_property
    def look(self) -> Appearance:
        return Appearance(self.mechanism)

    @cached_property
    def kinematics(self) -> Kinematics:
        return Kinematics(self.mechanism)

    @cached_property
    def path(self) -> FloatArray:
        """States that the machine goes through, shape (n, n_q)."""
        states = self.motion.path if self.motion and self.motion.path else [self.mechanism.start]
        return np.array(states)

    def places(self, body: str, point: Vector) -> FloatArray:
        """A body's point along the path [m], shape (n, 2)."""
        row = self.kinematics.point(body, point)
        return np.asarray(self.kinematics.position(row, self.path), dtype=np.float64)

    @cached_property
    def box(self) -> tuple[float, float, float, float]:
        """Least and greatest x, and y, of what moves and of what holds it [m]."""
        reach, around = self.look.reach, list[FloatArray]()
        for body in self.mechanism.bodies:
            around += [
                self.places(body.name, point)
                for point in (body.centre, *points_of(self.mechanism, body.name))
            ]
            if body.inertia > 0 and body.centre not in points_of(self.mechanism, body.name):
                around += [
                    self.places(body.name, body.centre) + d * self.look.disc(body)
                    for d in (-1.0, 1.0)
                ]
        around.append(np.array([[0.0, 0.0], *points_of(self.mechanism, GROUND)])[1:])
        around += [self.places(lump.body, lump.point) + d * self.look.half_size(lump)
                   for lump in self.look.lumps for d in (-1.3, 1.3)]  # fmt: skip
        spread = 0.04 * reach if self.motion else 1.05 * reach
        points = np.concatenate(around)
        (x0, y0), (x1, y1) = points.min(axis=0) - spread, points.max(axis=0) + spread
        return tuple(round(float(value), 3) for value in (x0, x1, y0, y1))  # type: ignore[return-value]

    @property
    def ground(self) -> float:
        """Height of the ground [m]."""
        return self.box[2]

    def root(self, model: str) -> ET.Element:
        x0, x1, y0, y1 = self.box
        root = ET.Element("mujoco", model=f"{self.mechanism.name} scene")
        root.append(ET.Comment(" Only looks: nothing here has mass or touches the machine. "))
        ET.SubElement(root, "include", file=model)
        extent = round(0.75 * max(x1 - x0, y1 - y0), 3)
        centre = numbers(round((x0 + x1) / 2, 3), 0, round((y0 + y1) / 2, 3))
        ET.SubElement(root, "statistic", center=centre, extent=number(extent))
        visual = ET.SubElement(root, "visual")
        ET.SubElement(
            visual, "global", offwidth="1280", offheight="960", azimuth="76", elevation="-7"
        )
        ET.SubElement(
            visual,
            "headlight",
            ambient="0.35 0.35 0.35",
            diffuse="0.35 0.35 0.35",
            specular="0 0 0",
        )
        ET.SubElement(visual, "quality", shadowsize="4096")
        _add_materials(ET.SubElement(root, "asset"), self.look.reach)
        self._add_world(ET.SubElement(root, "worldbody"))
        return root

    def _add_world(self, world: ET.Element) -> None:
        x0, x1, _, y1 = self.box
        far = round(max(x1 - x0, y1 - self.ground), 3)
        ET.SubElement(
            world, "light",
            pos=numbers(round((x0 + x1) / 2 - 0.5 * far, 3), -far, round(self.ground + 2 * far, 3)),
            dir="0.25 0.5 -1", directional="true", diffuse="0.6 0.6 0.55", specular="0.1 0.1 0.1",
        )  # fmt: skip
        none = {"contype": "0", "conaffinity": "0"}
        ET.SubElement(
            world, "geom", none, name="floor", type="plane", pos=numbers(0, 0, self.ground),
            size="0 0 1", material="floor",
        )  # fmt: skip
        ET.SubElement(world, "camera", self._camera(), name="side")
        shapes = Shapes(world)
        for joint in self.mechanism.joints:
            if joint.parent == GROUND and joint.held_directions:
                (self._add_track if joint.free_directions else self._add_frame)(shapes, joint)
        for stop in self.mechanism.point_stops:
            if stop.relative_to == GROUND and stop.body != GROUND:
                self._add_board(shapes, stop)

    def _add_frame(self, shapes: Shapes, joint: AnyJoint) -> None:
        """Two trestles with an axle on them, before and behind the plane of motion."""
        (x, y), lane = joint.parent_point, round(0.075 * self.look.reach, 3)
        height, thick = y - self.ground, round(0.014 * self.look.reach, 3)
        if height <= 2 * thick:
            return
        shapes.disc((x, y), thick, round(1.3 * lane, 3), _FRAME)
        for side in (-lane, lane):
            foot = 0.3 * height
            for way in (-foot, foot):
                shapes.rod((x, y), (x + way, self.ground), thick, _FRAME, side)
            for part in (0.5, 0.95):
                width, level = part * foot, y - part * height
                shapes.rod(
                    (x - width, level), (x + width, level), round(0.7 * thick, 3), _FRAME, side
                )
        for way in (-0.95 * 0.3 * height, 0.95 * 0.3 * height):
            shapes.disc((x + way, self.ground + 0.05 * height), round(0.7 * thick, 3), lane, _FRAME)

    def _add_track(self, shapes: Shapes, joint: AnyJoint) -> None:
        """Add two rails below the wheels of a slot, on posts; two guides if it is steep."""
        (axis,), lane, wheel = joint.free_directions[:1], self.look.lane(joint), self.look.wheel
        thick = round(0.008 * self.look.reach, 3)
        along = (self.places(joint.child, joint.child_point) - joint.parent_point) @ (
            axis.real,
            axis.imag,
        )
        beyond = 3 * wheel if self.motion else self.look.reach
        ends = [
            complex(*joint.parent_point) + axis * t
            for t in (along.min() - beyond, along.max() + beyond)
        ]
        steep = abs(axis.imag) > 0.5
        if steep:
            ends = sorted(ends, key=lambda end: end.imag)
            ends[0] = ends[1] + axis * (self.ground - ends[1].imag) / axis.imag
        across = (
            1j * axis if (1j * axis).imag < 0 or (steep and (1j * axis).real < 0) else -1j * axis
        )
        for side in (-lane, lane):
            for sense in (1, -1) if steep else (1,):
                a, b = (end + sense * across * (wheel + thick) for end in ends)
                shapes.rod(_pair(a), _pair(b), thick, _FRAME, side)
                for post, way in () if steep else ((a, -1), (a, 1), (b, -1), (b, 1)):
                    foot = post.real + 0.1 * way * (post.imag - self.ground)
                    shapes.rod(_pair(post), (foot, self.ground), thick, _FRAME, side)
                if not steep:
                    self._add_braces(shapes, a, b, side, thick)

    def _add_braces(
        self, shapes: Shapes, a: complex, b: complex, side: float, thick: float
    ) -> None:
        """A cross and a beam between the posts below two ends of a rail."""
        middle = [complex(end.real, 0.5 * (end.imag + self.ground)) for end in (a, b)]
        for one, other in ((a, middle[1]), (b, middle[0]), tuple(middle)):
            shapes.rod(_pair(one), _pair(other), round(0.7 * thick, 3), _FRAME, side)

    def _add_board(self, shapes: Shapes, stop: PointStop) -> None:
        """The part of a wall that its point comes near to."""
        places, thick = self.places(stop.body, stop.point), 0.006 * self.look.reach
        normal, tangent = np.array(stop.normal), np.array([stop.normal[1], -stop.normal[0]])
        held = [
            lump for lump in self.look.lumps if lump.body == stop.body and lump.point == stop.point
        ]
        radius = max(map(self.look.half_size, held), default=0.0)
        near = np.abs(places @ normal - stop.offset) < 0.02 * self.look.reach
        along = (places @ tangent)[near] if near.any() else (places @ tangent)[:1]
        low, high = along.min() - 0.06 * self.look.reach, along.max() + 0.06 * self.look.reach
        centre = normal * (stop.offset - radius - thick) + tangent * (low + high) / 2
        sizes = round((high - low) / 2, 3), round(0.05 * self.look.reach, 3), round(thick, 3)
        angle = math.atan2(tangent[1], tangent[0])
        shapes.slab((float(centre[0]), float(centre[1])), sizes, angle, WOOD)
        for t in (low, high) if stop.normal[1] > 0.9 else ():
            post = normal * (stop.offset - radius - thick) + tangent * t
            for side in (-sizes[1], sizes[1]):
                shapes.rod(
                    (float(post[0]), float(post[1])),
                    (float(post[0]), self.ground),
                    sizes[2],
                    _FRAME,
                    side,
                )

    def _camera(self) -> dict[str, str]:
        """Before the plane of motion, to the left of its middle and above."""
        _, right, up = line_of_sight()
        at = viewpoint(np.array(list(self.corners())))
        return {
            "pos": numbers(*(round(float(value), 3) for value in at)),
            "xyaxes": numbers(*(round(float(value), 6) for value in (*right, *up))),
            "fovy": number(FIELD),
        }

    def corners(self) -> Iterator[tuple[float, float, float]]:
        x0, x1, y0, y1 = self.box
        deep = round(0.12 * self.look.reach, 3)
        return ((x, side, y) for x in (x0, x1) for side in (-deep, deep) for y in (y0, y1))


def _limits(
    corners: FloatArray,
    axes: tuple[FloatArray, FloatArray],
    depth: FloatArray,
    tangents: FloatArray,
) -> Iterator[tuple[float, float]]:
    """Bounds that corners put on the eye at depth zero, along each axis of the picture [m].

    A corner at p and depth d is inside if |p - eye| <= tangent (d - eye's depth).
    """
    for axis, tangent in zip(axes, tangents, strict=True):
        p = corners @ axis
        yield float((p - tangent * depth).max()), float((p + tangent * depth).min())


def _pair(z: complex) -> Vector:
    return float(z.real), float(z.imag)


def _add_materials(asset: ET.Element, reach: float) -> None:
    size = {"width": "256", "height": "256"}
    sky = {"rgb1": "0.42 0.60 0.82", "rgb2": "0.86 0.92 0.97"}
    grass = {"rgb1": "0.42 0.52 0.34", "rgb2": "0.46 0.56 0.38"}
    ET.SubElement(asset, "texture", sky | size, type="skybox", builtin="gradient")
    ET.SubElement(asset, "texture", grass | size, name="floor", type="2d", builtin="checker")
    repeat = number(round(2.0 / reach, 4))
    ET.SubElement(
        asset,
        "material",
        name="floor",
        texture="floor",
        texuniform="true",
        texrepeat=f"{repeat} {repeat}",
    )
