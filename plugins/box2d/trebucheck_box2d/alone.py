"""Box2D by itself: its own joints and limits, its own step from start to end.

A body is a dynamic body with its mass data, a pin a revolute joint, a slot a wheel joint without a
spring, a slider a prismatic joint, a weld a weld joint. A stop is the limit of a revolute joint and
stays there for the whole run; those that a release-once law leaves out are left out. Box2D's
springs are soft joints, given by a frequency of whatever mass they hold, not by a stiffness; so
springs, dampers and motors are forces and torques that are given to the bodies before each step.

The run is the program that :func:`script` writes, executed here: what it leaves is read.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import Box2D
import numpy as np
from trebucheck.engines import study
from trebucheck.engines.events import whole_steps
from trebucheck.engines.point_masses import NoPointMasses, spread_masses
from trebucheck.engines.protocol import Recording
from trebucheck.models.elements import (
    FORCE_ELEMENTS,
    ConstantForce,
    ConstantTorque,
    CubicTorsionSpring,
    ElementTable,
    RecordedForce,
    RecordedTorque,
    RotationalSpringDamper,
    RotorInertia,
    SlideSpringDamper,
    SpringDamper,
)
from trebucheck.models.problem import Problem
from trebucheck_toolkit.alone import BodySteps
from trebucheck_toolkit.node_scene import MIRROR, NodeScene, lawful_stops

from .build import Plan, Vector
from .options import Box2DOptions


def run_alone(problem: Problem, options: Box2DOptions) -> Recording:
    """Step Box2D from the start to a problem's end or just beyond, and read its bodies.

    Raises:
        UnsupportedProblemError: the mechanism has a part that the adapter builds no element for.
    """
    spread, plan = _plan(problem, options)
    found: dict[str, Any] = {}
    exec(_program(problem, options, spread, plan), found)
    steps = len(found["t"]) - 1
    # Without the ground, to the scene's axes.
    scene = NodeScene(spread.mechanism, "box2d")
    states = found["states"][:, 1:] * np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
    states[..., 2] -= [scene.angles[body.name] for body in plan.bodies]
    pins = np.reshape(found["torques"], (steps, -1))
    limited = _limited(plan)
    return BodySteps(
        problem,
        scene,
        spread,
        found["t"],
        states,
        forces=np.reshape(found["forces"], (steps, len(plan.joints), 2)) * MIRROR,
        torques={
            name: np.maximum(0.0, limit.sense * pins[:, limited.index(plan.pins[limit.index])])
            for name, limit in plan.limits.items()
        },
        slop=Box2D.b2_angularSlop,
    ).recording(found["q"], found["u"])


def script(problem: Problem, options: Box2DOptions) -> str:
    """The program of a run.

    Raises:
        UnsupportedProblemError: the mechanism has a part that the adapter builds no element for.
    """
    return _program(problem, options, *_plan(problem, options))


def _plan(problem: Problem, options: Box2DOptions) -> tuple[NoPointMasses, Plan]:
    spread = spread_masses(problem.mechanism, options.least_inertia, "box2d")
    plan = Plan(
        spread.mechanism,
        lawful_stops(problem),
        set_back=options.set_back,
        allow_sleep=options.allow_sleep,
    )
    return spread, plan


def _limited(plan: Plan) -> list[str]:
    """Names of the pins that have limits."""
    return [joint.name for joint in plan.joints if "enableLimit" in joint.arguments]


def _program(problem: Problem, options: Box2DOptions, spread: NoPointMasses, plan: Plan) -> str:
    mechanism = problem.mechanism
    loads = [line for each in mechanism.force_elements for line in _LOADS[each](plan, each)]
    return study.filled_template(
        __name__,
        "alone.py.j2",
        options=options,
        steps=whole_steps(problem.duration, options.timestep),
        plan=plan,
        moves_mass=bool(spread.moved),
        limited=_limited(plan),
        loads=loads,
        calls={line.partition("(")[0] for line in loads},
        forces=any(isinstance(each, _ON_POINTS) for each in mechanism.force_elements),
        angles=[body.name for body in mechanism.bodies if body.angle is not None],
        slides=_slides(plan),
        text=_text,
    )


def _slides(plan: Plan) -> list[str]:
    """Arguments of the program's `slide` for each slide coordinate."""
    slides: list[str] = []
    for slide in plan.mechanism.slides:
        joint = slide.joint
        ends = (joint.parent, joint.parent_point), (joint.child, joint.child_point)
        points = (f"{body!r}, {complex(*plan.anchor(body, point))!r}" for body, point in ends)
        slides.append(f"{', '.join(points)}, {complex(slide.direction)!r}")
    return slides


def _text(value: Any) -> str:
    """A value as Python reads it, numbers as float64."""
    if isinstance(value, tuple):
        return f"({', '.join(map(_text, value))})"
    return repr(value + 0.0) if isinstance(value, float) else repr(value)


# --- Forces and torques of a step


def _end(plan: Plan, body: str, point: Vector) -> str:
    return f"{body!r}, {_text(plan.anchor(body, point))}"


def _force(plan: Plan, element: ConstantForce) -> list[str]:
    at = f"point({_end(plan, element.body, element.point)})[0]"
    return [f"push({element.body!r}, {at}, {complex(*element.force)!r})"]


def _torque(plan: Plan, element: ConstantTorque) -> list[str]:
    both = (element.body, -element.torque), (element.relative_to, element.torque)
    return [f"bodies[{body!r}].ApplyTorque({torque!r}, True)" for body, torque in both]


def _spring(plan: Plan, element: SpringDamper) -> list[str]:
    ends = (element.body, element.point), (element.relative_to, element.relative_point)
    law = _text((element.stiffness, element.damping, element.rest_length))[1:-1]
    return [f"spring({', '.join(_end(plan, *end) for end in ends)}, {law})"]


def _torsion_spring(plan: Plan, element: RotationalSpringDamper) -> list[str]:
    law = _text((element.stiffness, element.damping, element.rest_angle))[1:-1]
    return [f"torsion_spring({element.body!r}, {element.relative_to!r}, {law})"]


_ON_POINTS = (ConstantForce, SpringDamper)
_LOADS: ElementTable[Callable[[Plan, Any], list[str]]] = ElementTable(
    "the program for Box2D",
    FORCE_ELEMENTS,
    {
        ConstantForce: _force,
        ConstantTorque: _torque,
        SpringDamper: _spring,
        RotationalSpringDamper: _torsion_spring,
    },
    {
        CubicTorsionSpring: "its springs are linear",
        RotorInertia: "our adapter adds no inertia between two bodies",
        SlideSpringDamper: "our adapter builds no springs along slides",
        RecordedForce: "our adapter follows no record of efforts",
        RecordedTorque: "our adapter follows no record of efforts",
    },
)
