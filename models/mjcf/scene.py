"""The scene around a mechanism: ground, frame, rails, boards, light, and a fitted camera.

It is fitted to a certified motion that a model file keeps: events as keyframes, and the path for
pictures. A motion is data here, made by whoever has a solver; those of the named machines are
stored beside their MJCF.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files

import numpy as np
from pydantic import Field

from ..arrays import FloatArray
from ..elements import GROUND, AnyJoint, PointStop
from ..kinematics import Kinematics
from ..mechanism import Mechanism
from ..spec import Real, Spec, Vector
from .appearance import WOOD, Appearance, Shapes, points_of
from .tree import add, as_text, valid_names

HOME = "home"
"""The keyframe of the start, speeds included."""
RECORDED_FILE = "motion.json"
SCENE_FILE = "scene.xml"

FIELD = 35.0
"""Vertical field of view of its camera [deg]."""
AZIMUTH, ELEVATION = 14.0, 7.0
"""Direction of its camera, left of the plane's normal and above the horizontal [deg]."""
_FRAME = "0.42 0.29 0.17 1"
_ASPECT = 4 / 3
_MARGIN = 0.96  # of the picture is used


class Keyframe(Spec):
    """A state of a motion, in the mechanism's coordinates."""

    name: str
    time: Real = Field(description="[s]")
    q: tuple[Real, ...] = Field(description="[rad or m]")
    u: tuple[Real, ...] = Field(description="[rad/s or m/s]")


class RecordedMotion(Spec):
    """Events of a motion, and where it goes between them."""

    mechanism_hash: str
    keyframes: tuple[Keyframe, ...]
    path: tuple[tuple[Real, ...], ...] = Field(
        description="q at evenly spaced times, rounded: for pictures only"
    )


def stored_motion(mechanism: Mechanism) -> RecordedMotion | None:
    """The stored motion of exactly this mechanism; None if there is none."""
    file = files(__package__ or "") / mechanism.name / RECORDED_FILE
    if not file.is_file():
        return None
    motion = RecordedMotion.from_json(file.read_bytes())
    return motion if motion.mechanism_hash == mechanism.content_hash else None


def event_names(events: list[tuple[str, str]]) -> list[str]:
    """Unique names of keyframes for stops and their events ("release", "impact", "rest").

    "hanger rest" and "release" give "hanger_release"; a second event of that name is
    "hanger_release_2".
    """
    taken, names = {HOME}, list[str]()
    for stop, what in events:
        short = stop.removesuffix(" rest").removesuffix(" stop")
        (name,) = valid_names([f"{short}_{what}" if short else what], taken).values()
        names.append(name)
        taken.add(name)
    return names


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
    return _Scene(mechanism, motion).corners


def line_of_sight() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Unit vectors of the scene's camera in MuJoCo's axes: line of sight, right and up."""
    azimuth, elevation = math.radians(AZIMUTH), math.radians(ELEVATION)
    sa, ca, se, ce = math.sin(azimuth), math.cos(azimuth), math.sin(elevation), math.cos(elevation)
    view, right = np.array([sa * ce, ca * ce, -se]), np.array([ca, -sa, 0.0])
    return view, right, np.cross(right, view)


def viewpoint(points: FloatArray, aspect: float = _ASPECT) -> FloatArray:
    """Nearest position of the scene's camera that shows all points [m], shape (3,).

    Args:
        points: in MuJoCo's axes [m], shape (n, 3).
        aspect: width over height of the picture.
    """
    view, right, up = line_of_sight()
    depth, tangent = points @ view, math.tan(math.radians(FIELD) / 2)
    middles: list[float] = []
    distances: list[float] = []
    # A corner at p and depth d is inside if |p - eye| <= tangent (d - eye's depth). This bounds the
    # eye at depth zero along each axis of the picture.
    for axis, part in ((right, aspect), (up, 1.0)):
        slope, p = float(tangent * part * _MARGIN), points @ axis
        low, high = float((p - slope * depth).max()), float((p + slope * depth).min())
        middles.append((low + high) / 2)
        distances.append((high - low) / (2 * slope))
    return min(distances) * view + middles[0] * right + middles[1] * up


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

    def places(self, body: str, point: Vector) -> FloatArray:
        """A body's point along the path [m], shape (n, 2)."""
        states = self.motion.path if self.motion and self.motion.path else [self.mechanism.start]
        row = self.kinematics.point(body, point)
        return np.asarray(self.kinematics.position(row, np.array(states)), dtype=np.float64)

    @cached_property
    def box(self) -> tuple[float, float, float, float]:
        """Least and greatest x, and y, of what moves and of what holds it [m]."""
        reach, around = self.look.reach, list[FloatArray]()
        for body in self.mechanism.bodies:
            points = points_of(self.mechanism, body.name)
            around += [self.places(body.name, point) for point in (body.centre, *points)]
            if body.inertia > 0 and body.centre not in points:
                centres, radius = self.places(body.name, body.centre), self.look.disc(body)
                around += [centres - radius, centres + radius]
        held = points_of(self.mechanism, GROUND)
        if held:
            around.append(np.array(held))
        for lump in self.look.lumps:
            places, size = self.places(lump.body, lump.point), 1.3 * self.look.half_size(lump)
            around += [places - size, places + size]
        spread = 0.04 * reach if self.motion else 1.05 * reach
        points = np.concatenate(around)
        (x0, y0), (x1, y1) = points.min(axis=0) - spread, points.max(axis=0) + spread
        x0, x1, y0, y1 = (round(float(value), 3) for value in (x0, x1, y0, y1))
        return x0, x1, y0, y1

    @property
    def ground(self) -> float:
        """Height of the ground [m]."""
        return self.box[2]

    @property
    def corners(self) -> FloatArray:
        x0, x1, y0, y1 = self.box
        deep = self.look.part(0.12)
        return np.array([(x, z, y) for x in (x0, x1) for z in (-deep, deep) for y in (y0, y1)])

    def root(self, model: str) -> ET.Element:
        x0, x1, y0, y1 = self.box
        root = ET.Element("mujoco", model=f"{self.mechanism.name} scene")
        root.append(ET.Comment(" Only looks: nothing here has mass or touches the machine. "))
        add(root, "include", file=model)
        extent = round(0.75 * max(x1 - x0, y1 - y0), 3)
        centre = (round((x0 + x1) / 2, 3), 0, round((y0 + y1) / 2, 3))
        add(root, "statistic", center=centre, extent=extent)
        visual = add(root, "visual")
        add(visual, "global", offwidth="1280", offheight="960", azimuth="76", elevation="-7")
        grey = "0.35 0.35 0.35"
        add(visual, "headlight", ambient=grey, diffuse=grey, specular="0 0 0")
        add(visual, "quality", shadowsize="4096")
        asset, size = add(root, "asset"), {"width": "256", "height": "256"}
        sky = {"rgb1": "0.42 0.60 0.82", "rgb2": "0.86 0.92 0.97"}
        grass = {"rgb1": "0.42 0.52 0.34", "rgb2": "0.46 0.56 0.38"}
        add(asset, "texture", sky | size, type="skybox", builtin="gradient")
        add(asset, "texture", grass | size, name="floor", type="2d", builtin="checker")
        repeat = round(2.0 / self.look.reach, 4)
        add(
            asset, "material", name="floor", texture="floor", texuniform="true",
            texrepeat=(repeat, repeat),
        )  # fmt: skip
        self._add_world(add(root, "worldbody"))
        return root

    def _add_world(self, world: ET.Element) -> None:
        x0, x1, _, y1 = self.box
        far = round(max(x1 - x0, y1 - self.ground), 3)
        above = round((x0 + x1) / 2 - 0.5 * far, 3), -far, round(self.ground + 2 * far, 3)
        add(
            world, "light", pos=above, dir="0.25 0.5 -1", directional="true",
            diffuse="0.6 0.6 0.55", specular="0.1 0.1 0.1",
        )  # fmt: skip
        none = {"contype": "0", "conaffinity": "0"}
        add(
            world, "geom", none, name="floor", type="plane", pos=(0, 0, self.ground),
            size="0 0 1", material="floor",
        )  # fmt: skip
        # The camera is before the plane of motion, to the left of its middle and above.
        _, right, up = line_of_sight()
        place = [round(float(value), 3) for value in viewpoint(self.corners)]
        axes = [round(float(value), 6) for value in (*right, *up)]
        add(world, "camera", pos=place, xyaxes=axes, fovy=FIELD, name="side")
        shapes = Shapes(world)
        for joint in self.mechanism.joints:
            if joint.parent == GROUND and joint.held_directions:
                if joint.free_directions:
                    self._add_track(shapes, joint)
                else:
                    self._add_frame(shapes, joint)
        for stop in self.mechanism.point_stops:
            if stop.relative_to == GROUND and stop.body != GROUND:
                self._add_board(shapes, stop)

    def _add_frame(self, shapes: Shapes, joint: AnyJoint) -> None:
        """Two trestles with an axle on them, before and behind the plane of motion."""
        (x, y), lane, thick = joint.parent_point, self.look.part(0.075), self.look.part(0.014)
        height, thin = y - self.ground, round(0.7 * thick, 3)
        if height <= 2 * thick:
            return
        foot = 0.3 * height
        shapes.disc((x, y), thick, round(1.3 * lane, 3), _FRAME)
        for side in (-lane, lane):
            for way in (-foot, foot):
                shapes.rod((x, y), (x + way, self.ground), thick, _FRAME, side)
            for part in (0.5, 0.95):
                width, level = part * foot, y - part * height
                shapes.rod((x - width, level), (x + width, level), thin, _FRAME, side)
        for way in (-0.95 * 0.3 * height, 0.95 * 0.3 * height):
            shapes.disc((x + way, self.ground + 0.05 * height), thin, lane, _FRAME)

    def _add_track(self, shapes: Shapes, joint: AnyJoint) -> None:
        """Add two rails below the wheels of a slot, on posts; two guides if it is steep."""
        (axis,), lane, wheel = joint.free_directions[:1], self.look.lane(joint), self.look.wheel
        thick = self.look.part(0.008)
        moved = self.places(joint.child, joint.child_point) - joint.parent_point
        along = moved @ (axis.real, axis.imag)
        beyond = 3 * wheel if self.motion else self.look.reach
        start = complex(*joint.parent_point)
        ends = [start + axis * (along.min() - beyond), start + axis * (along.max() + beyond)]
        across, steep = 1j * axis, abs(axis.imag) > 0.5
        if steep:
            ends.sort(key=lambda end: end.imag)
            ends[0] = ends[1] + axis * (self.ground - ends[1].imag) / axis.imag
        if not (across.imag < 0 or (steep and across.real < 0)):
            across = -1j * axis
        for side in (-lane, lane):
            for sense in (1, -1) if steep else (1,):
                a, b = (end + sense * across * (wheel + thick) for end in ends)
                shapes.rod(_pair(a), _pair(b), thick, _FRAME, side)
                if steep:
                    continue
                for post, way in ((a, -1), (a, 1), (b, -1), (b, 1)):
                    foot = post.real + 0.1 * way * (post.imag - self.ground)
                    shapes.rod(_pair(post), (foot, self.ground), thick, _FRAME, side)
                # A cross and a beam between the posts.
                middle = [complex(end.real, 0.5 * (end.imag + self.ground)) for end in (a, b)]
                for one, other in ((a, middle[1]), (b, middle[0]), (middle[0], middle[1])):
                    shapes.rod(_pair(one), _pair(other), round(0.7 * thick, 3), _FRAME, side)

    def _add_board(self, shapes: Shapes, stop: PointStop) -> None:
        """The part of a wall that its point comes near to."""
        places, look, thick = self.places(stop.body, stop.point), self.look, 0.006 * self.look.reach
        normal, tangent = np.array(stop.normal), np.array([stop.normal[1], -stop.normal[0]])
        near = np.abs(places @ normal - stop.offset) < 0.02 * look.reach
        along = (places @ tangent)[near] if near.any() else (places @ tangent)[:1]
        low, high = along.min() - 0.06 * look.reach, along.max() + 0.06 * look.reach
        radius = 0.0
        for lump in look.lumps:
            if (lump.body, lump.point) == (stop.body, stop.point):
                radius = max(radius, look.half_size(lump))
        behind = normal * (stop.offset - radius - thick)
        centre = behind + tangent * (low + high) / 2
        sizes = round((high - low) / 2, 3), look.part(0.05), round(thick, 3)
        angle = math.atan2(tangent[1], tangent[0])
        shapes.slab((float(centre[0]), float(centre[1])), sizes, angle, WOOD)
        if stop.normal[1] <= 0.9:
            return
        for t in (low, high):
            x, y = (float(value) for value in behind + tangent * t)
            for side in (-sizes[1], sizes[1]):
                shapes.rod((x, y), (x, self.ground), sizes[2], _FRAME, side)


def _pair(z: complex) -> Vector:
    return float(z.real), float(z.imag)
