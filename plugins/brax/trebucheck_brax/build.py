"""A mechanism as the MJCF that Brax loads: its own numbers, and actuators for force elements.

The text is that of trebucheck's writer. A welded body is one that
MuJoCo's compiler joins with its parent (`fusestatic`): Brax's own loader joins them without their
masses and angles. Springs are actuators, which all of Brax's pipelines have: their force is their
control plus a bias that is linear in the joint's position and speed.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from trebucheck.engines.point_masses import spread_masses
from trebucheck.models import elements
from trebucheck.models.elements import FORCE_ELEMENTS, GROUND, ElementTable, WeldJoint
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mjcf.variants import Numerics, Variant
from trebucheck.models.mjcf.writer import mjcf
from trebucheck.models.problem import Problem
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.joint_tree import JointLimits
from trebucheck_toolkit.node_scene import lawful_stops

OWN = {
    "matrix_inv_iterations": 10,
    "solver_maxls": 20,
    "joint_scale_pos": 0.5,
    "joint_scale_ang": 0.2,
    "constraint_stiffness": 2000.0,
    "constraint_limit_stiffness": 1000.0,
    "constraint_vel_damping": 0.0,
}
"""Options that Brax reads from `numeric` elements, with its defaults; those are not written."""
SOLREF, SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)  # MuJoCo's defaults, for limits


class Drive(NamedTuple):
    """An actuator of a joint coordinate x that is zero at the start: f - k x - c dx/dt."""

    index: int
    control: float
    """f [N m, N]"""
    stiffness: float = 0.0
    damping: float = 0.0


class Plan:
    """What Brax is given of a problem; all stops are limits, for the whole run.

    Raises:
        UnsupportedProblemError: it has an element that the adapter builds none of Brax's for.
    """

    def __init__(self, problem: Problem, options: Any) -> None:
        self.options, self.spread = options, spread_masses(problem.mechanism, None, "brax")
        stops = {"stops": tuple(lawful_stops(problem))}
        self.mechanism = self.spread.mechanism.model_copy(update=stops)
        self.coordinates = JointCoordinates(self.mechanism)
        self.places = JointLimits(self.coordinates, "brax").places
        links = self.coordinates.links
        self.links = [body.name for body, joint in links if not isinstance(joint, WeldJoint)]
        """Bodies that Brax has, in its order."""
        forces = self.mechanism.force_elements
        self.drives = [drive for each in forces for drive in _DRIVES[each](self, each)]
        self.unit = 1.0
        """Of mass [kg]; forces, stiffnesses and inertias are in units of so many of ours."""
        if options.mass_unit == "machine":
            self.unit = self._greatest_inertia()

    @property
    def controls(self) -> list[float]:
        """Controls of the actuators."""
        return [drive.control / self.unit for drive in self.drives]

    def carrier(self, body: str) -> int | None:
        """The link that has a body; None for one that is welded to the ground."""
        while body not in self.links:
            if body == GROUND:
                return None
            body = self.mechanism.joint_of(body).parent
        return self.links.index(body)

    def angle(self, element: Any) -> tuple[Any, dict[int, float]]:
        """Angle between the bodies of an element, and weights of joint coordinates in it."""
        angle = Kinematics(self.mechanism).angle(element.body, element.relative_to)
        weights = (angle.coefficients @ self.coordinates.sums).tolist()
        return angle, {index: weight for index, weight in enumerate(weights) if weight}

    def _greatest_inertia(self) -> float:
        """Of what limits feel (without any: of all joints), as MuJoCo's compiler has it [kg m^2]."""
        import mujoco

        weights = mujoco.MjModel.from_xml_string(self.text()).dof_invweight0
        limited = [index for index, _ in self.places.values()]
        return float(1.0 / (weights[limited] if limited else weights).min())

    def text(self) -> str:
        """The MJCF."""
        options, unit = self.options, self.unit
        bodies = (
            body.model_copy(update={"mass": body.mass / unit, "inertia": body.inertia / unit})
            for body in self.mechanism.bodies
        )
        update = {"bodies": tuple(bodies), "force_elements": ()}
        solref = options.solref or (8 * options.timestep, 1.0)
        numerics = Numerics(
            timestep=options.timestep,
            iterations=options.solver_iterations,
            solref=None if solref == SOLREF else solref,
            solimp=None if options.solimp == SOLIMP else options.solimp,
        )
        variant = Variant(numerics=numerics, sensors=False)
        root = ET.fromstring(mjcf(self.mechanism.model_copy(update=update), variant=variant))
        if root.find("tendon") is not None:
            raise UnsupportedProblemError(
                "Brax has no limits of tendons, which stops that clamp a joint would need."
            )
        next(root.iter("compiler")).set("fusestatic", "true")
        custom, actuator = ET.SubElement(root, "custom"), ET.SubElement(root, "actuator")
        for name, default in OWN.items():
            scale = unit if name.startswith("constraint") else 1
            if (value := getattr(options, name) / scale) != default:
                ET.SubElement(custom, "numeric", name=name, data=f"{value!r}")
        joints = [each.get("name", "") for body in root.iter("body") for each in body.findall("joint")]
        for index, _, stiffness, damping in self.drives:
            bias = f"0 {-stiffness / unit!r} {-damping / unit!r}"
            own = {"joint": joints[index], "biastype": "affine", "biasprm": bias}
            ET.SubElement(actuator, "general", own)
        ET.indent(root)
        return ET.tostring(root, encoding="unicode")


def _torque(plan: Plan, element: elements.ConstantTorque) -> Iterator[Drive]:
    for index, weight in plan.angle(element)[1].items():
        yield Drive(index, weight * element.torque)


def _spring(plan: Plan, element: elements.RotationalSpringDamper) -> Iterator[Drive]:
    angle, weights = plan.angle(element)
    if len(weights) > 1:
        raise UnsupportedProblemError(
            f"our adapter builds a spring on angles as an actuator of one joint of Brax, and "
            f"{element.name!r} is on {len(weights)}."
        )
    for index, weight in weights.items():
        away = float(angle.value(np.array(plan.mechanism.start))) - element.rest_angle
        control = -weight * element.stiffness * away
        yield Drive(index, control, element.stiffness, element.damping)


def _slide_spring(plan: Plan, element: elements.SlideSpringDamper) -> Iterator[Drive]:
    coordinate = plan.mechanism.coordinates.index(element.coordinate)
    index = [freedom.index for freedom in plan.coordinates.freedoms].index(coordinate)
    away = plan.mechanism.start[coordinate] - element.rest_position
    control = element.force - element.stiffness * away
    yield Drive(index, control, element.stiffness, element.damping)


_POINTS = "Brax takes forces on joints alone"
_DRIVES: ElementTable[Callable[[Plan, Any], Iterator[Drive]]] = ElementTable(
    "the adapter for Brax",
    FORCE_ELEMENTS,
    {
        elements.ConstantTorque: _torque,
        elements.RotationalSpringDamper: _spring,
        elements.SlideSpringDamper: _slide_spring,
    },
    {
        elements.SpringDamper: _POINTS,
        elements.ConstantForce: _POINTS,
        elements.CubicTorsionSpring: "Brax's actuators are linear",
        elements.RotorInertia: "our adapter builds no armature of joints",
        elements.RecordedForce: "our adapter follows no record of efforts",
        elements.RecordedTorque: "our adapter follows no record of efforts",
    },
)
