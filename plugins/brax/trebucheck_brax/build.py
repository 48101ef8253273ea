"""A mechanism as the MJCF that Brax loads, and the forces of its elements on Brax's joints.

The text is that of trebucheck's writer. A welded body is one that MuJoCo's compiler joins with its
parent (`fusestatic`): Brax's own loader joins them without their masses and angles. Brax's
pipelines have no tendons, no forces on bodies, and two of them no springs of joints; what all have
are motors. So forces are the motors' controls, computed before each step.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import mujoco
import numpy as np
from trebucheck.engines.mujoco.alone import model_text
from trebucheck.engines.mujoco.options import MujocoOptions
from trebucheck.engines.point_masses import spread_masses
from trebucheck.models import elements
from trebucheck.models.elements import FORCE_ELEMENTS, GROUND, ElementTable, WeldJoint
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.problem import Problem
from trebucheck_toolkit.joint_coordinates import JointCoordinates
from trebucheck_toolkit.joint_tree import JointLimits
from trebucheck_toolkit.node_scene import lawful_stops

OWN = {"matrix_inv_iterations": 10, "solver_maxls": 20, "joint_scale_pos": 0.5}
OWN |= {"joint_scale_ang": 0.2, "constraint_stiffness": 2000.0}
OWN |= {"constraint_limit_stiffness": 1000.0, "constraint_vel_damping": 0.0}
"""Options that Brax reads from `numeric` elements, with its defaults; those are not written."""


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
        self.kinematics = Kinematics(self.mechanism)
        self.start = np.array(self.mechanism.start)
        self.places = JointLimits(self.coordinates, "brax").places
        links = self.coordinates.links
        self.links = [body.name for body, joint in links if not isinstance(joint, WeldJoint)]
        """Bodies that Brax has, in its order."""
        joints = len(self.coordinates.freedoms)
        self.constant = np.zeros(joints)
        self.stiffness, self.damping = np.zeros((joints, joints)), np.zeros((joints, joints))
        """Forces of joints a - K x - C dx/dt, of positions x that are zero at the start."""
        self.points, self.pushes, self.springs = list[Any](), list[Any](), list[Any]()
        """Links (-1: the ground) and places in them, of points that forces act on; points and
        constant forces; springs as pairs of points, stiffness, rest length and damping."""
        for element in self.mechanism.force_elements:
            _FORCES[element](self, element)
        self.unit = 1.0
        """Of mass [kg]; forces, stiffnesses and inertias are in units of so many of ours."""
        if options.mass_unit == "machine":
            # The greatest inertia that a limit feels (without any: a joint), as MuJoCo has it.
            weights = mujoco.MjModel.from_xml_string(self.text()).dof_invweight0
            limited = [index for index, _ in self.places.values()]
            self.unit = float(1.0 / (weights[limited] if limited else weights).min())

    def carrier(self, body: str) -> int:
        """The link that has a body; -1 for the ground and what is welded to it."""
        while body not in (*self.links, GROUND):
            body = self.mechanism.joint_of(body).parent
        return -1 if body == GROUND else self.links.index(body)

    def point(self, body: str, point: tuple[float, float]) -> int:
        """Index of a point of a body, which is added."""

        def place(body: str, point: tuple[float, float]) -> complex:
            row = self.kinematics.point(body, point)
            return complex(*self.kinematics.position(row, self.start))

        link, found = self.carrier(body), place(body, point)
        if link >= 0:
            carrier = self.links[link]
            found -= place(carrier, self.mechanism.joint_of(carrier).child_point)
            found *= np.exp(1j * self.kinematics.angle(carrier).value(self.start))
        self.points.append((link, [found.real, 0.0, found.imag]))
        return len(self.points) - 1

    def add_linear(self, function: Any, force: float, *law: float) -> None:
        """Add a constant force along an angle or a slide, by a stiffness, rest and damping."""
        weights = function.coefficients @ self.coordinates.sums
        stiffness, rest, damping = law or (0.0, 0.0, 0.0)
        self.constant += weights * (force - stiffness * (function.value(self.start) - rest))
        self.stiffness += stiffness * np.outer(weights, weights)
        self.damping += damping * np.outer(weights, weights)

    def text(self) -> str:
        """The MJCF."""
        options, unit = self.options, self.unit
        bodies = [
            body.model_copy(update={"mass": body.mass / unit, "inertia": body.inertia / unit})
            for body in self.mechanism.bodies
        ]
        update = {"bodies": tuple(bodies), "force_elements": ()}
        own = MujocoOptions(
            timestep=options.timestep,
            integrator="Euler",
            tolerance=1e-8,
            margin=0.0,
            iterations=options.solver_iterations,
            solref=options.solref or (8 * options.timestep, 1.0),
            solimp=options.solimp,
        )
        mechanism = self.mechanism.model_copy(update=update)
        root = ET.fromstring(model_text(mechanism, own, sensors=False))
        if root.find("tendon") is not None:
            raise UnsupportedProblemError("Brax has no limits of tendons, for clamped joints.")
        next(root.iter("compiler")).set("fusestatic", "true")
        custom, actuator = ET.SubElement(root, "custom"), ET.SubElement(root, "actuator")
        for name, default in OWN.items():
            scale = unit if name.startswith("constraint") else 1
            if (value := getattr(options, name) / scale) != default:
                ET.SubElement(custom, "numeric", name=name, data=f"{value!r}")
        for joint in root.iterfind("worldbody//joint") if self.mechanism.force_elements else ():
            ET.SubElement(actuator, "motor", joint=joint.get("name", ""))
        ET.indent(root)
        return ET.tostring(root, encoding="unicode")


def _angle(plan: Plan, element: Any) -> Any:
    return plan.kinematics.angle(element.body, element.relative_to)


def _spring(plan: Plan, e: elements.SpringDamper) -> None:
    ends = plan.point(e.body, e.point), plan.point(e.relative_to, e.relative_point)
    plan.springs.append((*ends, e.stiffness, e.rest_length, e.damping))


_FORCES: ElementTable[Any] = ElementTable(
    "the adapter for Brax",
    FORCE_ELEMENTS,
    {
        elements.ConstantTorque: lambda plan, e: plan.add_linear(_angle(plan, e), e.torque),
        elements.ConstantForce: lambda plan, e: plan.pushes.append(
            (plan.point(e.body, e.point), [e.force[0], 0.0, e.force[1]])
        ),
        elements.SpringDamper: _spring,
        elements.RotationalSpringDamper: lambda plan, e: plan.add_linear(
            _angle(plan, e), 0.0, e.stiffness, e.rest_angle, e.damping
        ),
    },
    others="our adapter gives Brax no such force",
)
