"""A mechanism as MuJoCo's model format, MJCF; written here, without MuJoCo.

The plane of the mechanism is MuJoCo's x-z plane (our y is its z), and a hinge about `0 1 0` turns x
towards -z: it is positive clockwise, as our angles are. MuJoCo's hinges are relative to the parent
body, and every joint reads zero at the start. That zero matters: a closed stop then stands exactly
at its limit, and how far it is pressed in (1e-10 rad) keeps all its digits, which it would lose
beside an angle of order one.

MuJoCo's own writer rounds to six digits, which moves the projectile by 3e-5 m; here each float is
written as the shortest decimal that reads back to the same bits.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, cast

from ..elements import GROUND, STOPS, ElementTable, PointStop, Stop
from ..errors import InputError, UnsupportedProblemError
from ..files import write_text
from ..kinematics import initial_state
from ..mechanism import Body, Mechanism
from ..spec import Vector
from .appearance import STONE, Appearance
from .elements import Forces, Points, felt_from, force_sensor, torque_sensor, written
from .scene import HOME, SCENE_FILE, RecordedMotion, ground_level, scene
from .tree import (
    add,
    add_angle_tendon,
    as_text,
    from_origin,
    hinge_weights,
    joint_values,
    names_in,
    numbers,
    rename,
    slide_joints,
    spatial,
    start_angles,
    valid_names,
)
from .variants import Numerics, Thrown, Variant, inertias

if TYPE_CHECKING:
    from ..library.registry import Model

KINETIC_ENERGY, POTENTIAL_ENERGY = "energy/kinetic", "energy/potential"

FAR = 1e10
"""Limit [rad] that stands for none: MuJoCo's ranges have two ends."""

MARGIN = 1e-12
"""Distance from a limit below which it acts [rad]; strictly below, so 0 would miss the start."""


def position_sensor(marker: str) -> str:
    """Name of the sensor of a marker's position [m]."""
    return f"{marker}/position"


def velocity_sensor(marker: str) -> str:
    """Name of the sensor of a marker's velocity [m/s]."""
    return f"{marker}/velocity"


def mjcf(
    mechanism: Mechanism,
    timestep: float = 1e-3,
    motion: RecordedMotion | None = None,
    variant: Variant = Variant(),  # noqa: B008 - frozen
) -> str:
    """The mechanism as MJCF text, the same for equal mechanisms, to the byte.

    Args:
        mechanism: any.
        timestep: of MuJoCo's integrator [s]; the stiffness of stops and loops is scaled with it.
        motion: of this mechanism; its events become keyframes beside that of the start, `home`.
        variant: what is written otherwise than in the committed files.

    Raises:
        InputError: the time step is not positive and finite, or the motion is another mechanism's.
        UnsupportedProblemError: a stop holds a body against itself, or a point of the ground
            against the ground.
    """
    if not (math.isfinite(timestep) and timestep > 0):
        raise InputError(f"timestep = {timestep!r} s must be positive and finite.")
    if motion is not None and motion.mechanism_hash != mechanism.content_hash:
        raise InputError(
            f"motion is not one of {mechanism.name!r}: it was recorded of another mechanism."
        )
    root = _Writer(mechanism, timestep, motion, variant).root()
    rename(root)
    return as_text(root)


def mjcf_names(mechanism: Model) -> Mapping[str, str]:
    """Names of bodies, joints, sites, sensors and the like in a mechanism's MJCF, read-only.

    A file has only letters, digits, `_`, `-` and `.` in its names. The keys are names with blanks
    and slashes, made of the mechanism's own ("sling pin", "sling pin/force"); files written by
    earlier versions have those.

    Args:
        mechanism: its name, the path of its .json file, itself, or a problem.

    Raises:
        InputError: nothing has that name.
        UnsupportedProblemError: as :func:`mjcf`.
    """
    from ..library.registry import model  # all machines and problems, for names alone

    # Type checkers do not see that a description has a hash.
    return _names(cast("Any", model(mechanism)))


@lru_cache(maxsize=64)
def _names(mechanism: Mechanism) -> Mapping[str, str]:
    return MappingProxyType(names_in(_Writer(mechanism, 1e-3, None, Variant()).root()))


def model_file(mechanism: Mechanism) -> str:
    """Name of the file of its MJCF, beside `scene.xml`: `rolling.xml`."""
    (name,) = valid_names([mechanism.name], taken=["scene"]).values()
    return f"{name}.xml"


def write_model_folder(
    mechanism: Mechanism,
    folder: str | Path,
    timestep: float = 1e-3,
    motion: RecordedMotion | None = None,
    variant: Variant = Variant(),  # noqa: B008 - frozen
) -> tuple[Path, Path]:
    """Write the model (`rolling.xml`, by the mechanism's name) and `scene.xml` into a folder.

    The folder is made if need be; neither file is ever there half-written.

    Args:
        mechanism: any.
        folder: where to; files of the same names are replaced.
        timestep: as :func:`mjcf` [s].
        motion: as :func:`mjcf`; the camera is fitted to its path.
        variant: as :func:`mjcf`.

    Returns:
        The two paths.

    Raises:
        InputError: the folder cannot be written to, or as :func:`mjcf`.
        UnsupportedProblemError: as :func:`mjcf`.
    """
    name = model_file(mechanism)
    texts = {
        name: mjcf(mechanism, timestep, motion, variant),
        SCENE_FILE: scene(mechanism, name, motion),
    }
    for name, text in texts.items():
        write_text(Path(folder) / name, text)
    return Path(folder) / name, Path(folder) / SCENE_FILE


def _following(mechanism: Mechanism, timestep: float) -> Numerics:
    """The numerical options of the committed files at a time step [s].

    A time constant of two steps and the greatest impedance MuJoCo takes: errors of the stops'
    softness then fall with the square of the step.
    """
    solref = (2 * timestep, 1.0)
    return Numerics(
        timestep=timestep,
        integrator="RK4",
        tolerance=1e-30,
        solref=solref,
        solref_of_points=solref,
        solimp=(0.9999, 0.9999, 0.001, 0.5, 2.0),
        margin=MARGIN,
        margin_of_slots=felt_from(mechanism, timestep),
    )


class _Writer:
    """One model's elements."""

    def __init__(
        self, mechanism: Mechanism, timestep: float, motion: RecordedMotion | None, variant: Variant
    ) -> None:
        for joint in mechanism.joints:  # unknown joints and stops are refused
            slide_joints(joint)
        for stop in mechanism.stops:
            STOP_SENSORS[stop]
        self.mechanism, self.motion, self.variant = mechanism, motion, variant
        self.timestep = timestep
        self.inertias = inertias(mechanism, variant)
        self.thrown = Thrown(mechanism, timestep) if variant.throw else None
        held = None
        if self.thrown:
            self.thrown.take_from(self.inertias)
            held = self.thrown.marker.body, self.thrown.marker.point
        self.start, self.speeds = (values.tolist() for values in initial_state(mechanism))
        self.angle = start_angles(mechanism)
        self.appearance = Appearance(mechanism, held)
        self.points, self.forces = Points(mechanism), Forces(mechanism)
        self.ranges: dict[str, list[float]] = {}
        self.on_tendon = tuple(s for s in mechanism.angle_stops if not self._fits_its_joint(s))

    def _range(self, stop: Stop) -> list[float]:
        """Range of an angle's change from the start [rad]; 0 to the last bit where it touches."""
        gap = 0.0
        if not stop.closed:
            turned = self.angle[stop.body] - self.angle[stop.relative_to]
            gap = stop.sense * turned - stop.limit
        return [-gap, FAR] if stop.sense > 0 else [-FAR, gap]

    def _fits_its_joint(self, stop: Stop) -> bool:
        """Give the stop an end of its joint's range; False if the joint has no such end."""
        if stop.body == GROUND:
            return False
        joint = self.mechanism.joint_of(stop.body)
        if joint.holds_angle:
            return False
        low, high = self._range(stop)
        taken = self.ranges.get(joint.name, [-FAR, FAR])
        end = 0 if stop.sense > 0 else 1
        merged = [max(low, taken[0]), min(high, taken[1])]
        # MuJoCo wants a range of some width: a joint clamped from both sides cannot have it.
        if stop.relative_to != joint.parent or abs(taken[end]) != FAR or not merged[0] < merged[1]:
            return False
        self.ranges[joint.name] = merged
        return True

    def root(self) -> ET.Element:
        """The `mujoco` element."""
        root = ET.Element("mujoco", model=self.mechanism.name)
        about = " Written by trebucheck.models.mjcf.writer; see README.md for signs and stops. "
        root.append(ET.Comment(about))
        add(root, "compiler", angle="radian", autolimits="false")
        numerics = self.variant.numerics or _following(self.mechanism, self.timestep)
        option = add(
            root, "option",
            written(numerics, "timestep", "integrator", "solver", "tolerance", "iterations"),
            gravity=spatial(self.mechanism.gravity_vector),
        )  # fmt: skip
        # Geoms are of no class that touches: the flag only saves MuJoCo the look.
        if not self.points.walls and not self.thrown and self.variant.numerics is None:
            add(option, "flag", contact="disable")
        default, soft = add(root, "default"), written(numerics, "solref", "solimp")
        limits = {f"{name}limit": value for name, value in soft.items()}
        limits |= written(numerics, "margin")
        if limits:
            add(default, "joint", limits)
            add(default, "tendon", limits)
        add(default, "geom", group="2", contype="0", conaffinity="0", mass="0")
        add(default, "site", group="4", size=0.01 * self.points.reach)
        self.points.add_defaults(default, numerics)
        world = add(root, "worldbody")
        self.points.add_points(world, GROUND, (0.0, 0.0))
        self._add_sites(world, GROUND, (0.0, 0.0))
        for body in self.mechanism.children(GROUND):
            self._add_body(world, body)
        if self.thrown:
            self.thrown.add_ground(world, ground_level(self.mechanism, self.motion))
        self.points.add_constraints(root, numerics)
        if self.thrown:
            self.thrown.add_constraints(root)
        if self.on_tendon or self.points.needs_tendons or self.forces.needs_tendons:
            self._add_tendons(add(root, "tendon"))
        self.forces.add_actuators(root)
        if self.variant.sensors:
            self._add_sensors(add(root, "sensor"))
        # The start, and the events of the recorded motion.
        keyframe, still = add(root, "keyframe"), [0.0] * len(self.speeds)
        places, speeds = self._joint_values(still), self._joint_values(self.speeds)
        controls = self.forces.controls(root, 0.0)
        common = {"ctrl": numbers(*controls)} if controls else {}
        add(keyframe, "key", common, name=HOME, qpos=places, qvel=speeds)
        for key in self.motion.keyframes if self.motion else ():
            moved = [q - start for q, start in zip(key.q, self.start, strict=True)]
            places, speeds = self._joint_values(moved), self._joint_values(key.u)
            add(keyframe, "key", name=key.name, time=key.time, qpos=places, qvel=speeds)
        # A record of controls, which whoever steps the model sets.
        for k, t in enumerate(self.mechanism.instants, start=1):
            controls = self.forces.controls(root, t)
            add(keyframe, "key", name=f"controls_{k}", time=t, ctrl=controls)
        return root

    def _joint_values(self, rates: Sequence[float]) -> list[float]:
        values = joint_values(self.mechanism, rates)
        return self.thrown.with_its_own(values) if self.thrown else values

    def _add_body(self, parent: ET.Element, body: Body) -> None:
        joint = self.mechanism.joint_of(body.name)
        turn = joint.turned_by  # from the parent at the start [rad]
        if turn is None:
            turn = self.angle[joint.child] - self.angle[joint.parent]
        # The origin of the body's frame is its joint, as it stands in the parent's at the start.
        (x, y), origin = joint.parent_point, (0.0, 0.0)
        coordinates = dict(zip(self.mechanism.coordinates, self.start, strict=True))
        for name, direction in zip(joint.slides, joint.free_directions, strict=True):
            x += coordinates[name] * direction.real
            y += coordinates[name] * direction.imag
        if joint.parent != GROUND:
            origin = self.mechanism.joint_of(joint.parent).child_point
        place = from_origin(origin, (x, y))
        element = add(parent, "body", name=body.name, pos=place, euler=(0, turn, 0))
        self.inertias[body.name].add_to(element, joint.child_point)
        for name, direction in zip(slide_joints(joint), joint.free_directions, strict=True):
            # MuJoCo takes an axis in the child's frame as it stands at the start.
            c, s, (x, y) = math.cos(turn), math.sin(turn), (direction.real, direction.imag)
            axis = spatial((c * x - s * y, s * x + c * y))
            own = self.forces.of_joint(name)
            add(element, "joint", own, name=name, type="slide", axis=axis)
        if not joint.holds_angle:
            hinge = add(element, "joint", name=joint.name, type="hinge", axis="0 1 0")
            if joint.name in self.ranges:
                hinge.set("limited", "true")
                hinge.set("range", numbers(*self.ranges[joint.name]))
            hinge.attrib |= self.forces.of_joint(joint.name)
        self.appearance.add(element, body, joint.child_point)
        add(element, "site", name=f"{joint.name}/joint")
        self._add_sites(element, body.name, joint.child_point)
        self.points.add_points(element, body.name, joint.child_point)
        if self.thrown:
            self.thrown.add_body(element, body.name, round(0.028 * self.points.reach, 3), STONE)
        for child in self.mechanism.children(body.name):
            self._add_body(element, child)

    def _add_sites(self, element: ET.Element, body: str, origin: Vector) -> None:
        for marker in self.mechanism.markers:
            if marker.body == body:
                add(element, "site", name=marker.name, pos=from_origin(origin, marker.point))
        self.forces.add_sites(element, body, origin)

    def _add_tendons(self, tendon: ET.Element) -> None:
        """Add stops that fit no joint's range: limits on the sum of hinges between two bodies."""
        for stop in self.on_tendon:
            if not hinge_weights(self.mechanism, *stop.bodies):
                raise UnsupportedProblemError(
                    f"stop {stop.name!r} holds {stop.body!r} against itself."
                )
            add_angle_tendon(
                tendon, self.mechanism, stop.bodies,
                name=stop.name, limited="true", range=self._range(stop),
            )  # fmt: skip
        self.points.add_tendons(tendon)
        self.forces.add_tendons(tendon)

    def _add_sensors(self, sensor: ET.Element) -> None:
        for stop in self.mechanism.stops:
            STOP_SENSORS[stop](self, sensor, stop)
        joints = [joint for joint in self.mechanism.tree_joints if joint.held_directions]
        for joint in (*joints, *self.mechanism.loop_joints):
            add(sensor, "force", name=force_sensor(joint.name), site=f"{joint.name}/joint")
        for marker in self.mechanism.markers:
            of = {"objtype": "site", "objname": marker.name}
            add(sensor, "framepos", of, name=position_sensor(marker.name))
            add(sensor, "framelinvel", of, name=velocity_sensor(marker.name))
        add(sensor, "e_kinetic", name=KINETIC_ENERGY)
        add(sensor, "e_potential", name=POTENTIAL_ENERGY)

    def add_limit_sensor(self, sensor: ET.Element, stop: Stop) -> None:
        """Add the torque of a limit, of a joint or of a tendon."""
        name = torque_sensor(stop.name)
        if stop in self.on_tendon:
            add(sensor, "tendonlimitfrc", name=name, tendon=stop.name)
        else:
            joint = self.mechanism.joint_of(stop.body).name
            add(sensor, "jointlimitfrc", name=name, joint=joint)


STOP_SENSORS: ElementTable[Callable[[_Writer, ET.Element, Any], None]] = ElementTable(
    "the MJCF writer",
    STOPS,
    {
        Stop: _Writer.add_limit_sensor,
        PointStop: lambda writer, sensor, stop: writer.points.add_stop_sensor(sensor, stop),
    },
)
