"""Box2D by itself: its own joints and limits, its own step from start to end.

A body is a dynamic body with its mass data, a pin a revolute joint, a slot a wheel joint without a
spring, a slider a prismatic joint, a weld a weld joint. A stop is the limit of a revolute joint and
stays there for the whole run; those that a release-once law leaves out are left out. Box2D's
springs are soft joints, given by a frequency of whatever mass they hold, not by a stiffness; so
springs, dampers and motors are forces and torques that are given to the bodies before each step.

The run is the program that :func:`script` writes, executed here: what it leaves is read.
"""

from __future__ import annotations

import Box2D
import numpy as np
from trebucheck.engines.point_masses import NoPointMasses, spread_masses
from trebucheck.engines.protocol import Recording
from trebucheck.models.problem import Problem
from trebucheck_toolkit.alone import BodySteps
from trebucheck_toolkit.body_program import body_program, run_program, scene_states
from trebucheck_toolkit.node_scene import MIRROR, NodeScene, lawful_stops

from .build import Plan
from .options import Box2DOptions


def run_alone(problem: Problem, options: Box2DOptions) -> Recording:
    """Step Box2D from the start to a problem's end or just beyond, and read its bodies.

    Raises:
        UnsupportedProblemError: the mechanism has a part that the adapter builds no element for.
    """
    spread, plan = _plan(problem, options)
    found = run_program(_program(problem, options, spread, plan))
    scene = NodeScene(spread.mechanism, "box2d")
    forces, pins = np.split(found["told"], [2 * len(plan.joints)], axis=1)
    limited = _limited(plan)
    return BodySteps(
        problem,
        scene,
        spread,
        found["t"],
        scene_states(plan, scene, found["states"]),
        forces=forces.reshape(len(forces), len(plan.joints), 2) * MIRROR,
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
    return body_program(
        __name__,
        plan,
        problem,
        options.timestep,
        options=options,
        plan=plan,
        moves_mass=bool(spread.moved),
        limited=_limited(plan),
    )
