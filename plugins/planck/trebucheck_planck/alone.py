"""planck.js by itself: its own joints and limits, its own step from start to end.

A body is a dynamic body with its mass data, a pin a revolute joint, a slot a wheel joint without a
spring, a slider a prismatic joint, a weld a weld joint. A stop is the limit of a revolute joint and
stays there for the whole run; those that a release-once law leaves out are left out. planck.js's
springs are soft joints, given by a frequency of whatever mass they hold, not by a stiffness; so
springs, dampers and motors are forces and torques that are given to the bodies before each step.

The run is the program that :func:`script` writes, which Node.js runs; see
:mod:`trebucheck_toolkit.node_program` for how to do so and what it prints.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from trebucheck.engines.point_masses import NoPointMasses, spread_masses
from trebucheck.engines.protocol import Recording
from trebucheck.models.problem import Problem
from trebucheck_toolkit.alone import BodySteps
from trebucheck_toolkit.node_program import node_program
from trebucheck_toolkit.node_scene import MIRROR, Json, NodeScene, joint_limits, lawful_stops

from .bridge import PLANCK
from .options import OWN_SLOPS, PlanckOptions

_WIDE = 1e6  # [rad] a limit that is never met
_SLOP = math.radians(2.0)  # planck.js's own
_KINDS: Mapping[str, tuple[str, Json]] = {
    "pin": ("RevoluteJoint", {}),
    "slide": ("PrismaticJoint", {}),
    # Without a spring planck.js 1.4.2 multiplies by numbers that it has not set, and all is NaN.
    "slot": ("WheelJoint", {"frequencyHz": 1e-9, "dampingRatio": 0.0}),
    "weld": ("WeldJoint", {}),
}


def run_alone(problem: Problem, options: PlanckOptions) -> Recording:
    """Step planck.js from the start to a problem's end or just beyond, and read its bodies.

    Raises:
        UnsupportedProblemError: the mechanism has a part that the adapter builds no element for.
    """
    spread, scene = _scene(problem, options)
    arrays = PLANCK.arrays(_program(problem, options, spread, scene, binary=True))
    steps, joints = len(arrays["t"]) - 1, len(scene.joints)
    forces, pins = np.split(arrays["told"].reshape(steps, -1), [2 * joints], axis=1)
    stops, limited = _stops(problem, scene), [*_limits(problem, scene)]
    return BodySteps(
        problem,
        scene,
        spread,
        arrays["t"],
        arrays["states"],
        forces=forces.reshape(steps, joints, 2),
        torques={
            name: np.maximum(0.0, stop["side"] * pins[:, limited.index(stop["joint"])])
            for name, stop in stops.items()
        },
        slop=_SLOP,
    ).recording(arrays["q"], arrays["u"])


def script(problem: Problem, options: PlanckOptions) -> str:
    """The program of a run.

    Raises:
        UnsupportedProblemError: the mechanism has a part that the adapter builds no element for.
    """
    return _program(problem, options, *_scene(problem, options))


def _scene(problem: Problem, options: PlanckOptions) -> tuple[NoPointMasses, NodeScene]:
    spread = spread_masses(problem.mechanism, options.least_inertia, "planck")
    return spread, NodeScene(spread.mechanism, "planck")


def _stops(problem: Problem, scene: NodeScene) -> dict[str, Json]:
    return {stop.name: scene.stop(stop) for stop in lawful_stops(problem)}


def _limits(problem: Problem, scene: NodeScene) -> dict[int, Json]:
    """Options of the joints with limits, by their index."""
    return {
        joint: {
            "enableLimit": True,
            "lowerAngle": -_WIDE if low is None else low,
            "upperAngle": _WIDE if high is None else high,
        }
        for joint, (low, high) in joint_limits(problem, scene, within_half_a_turn=False).items()
    }


def _program(
    problem: Problem,
    options: PlanckOptions,
    spread: NoPointMasses,
    scene: NodeScene,
    *,
    binary: bool = False,
) -> str:
    limits, names = _limits(problem, scene), {index: name for name, index in scene.index.items()}
    joints: list[Json] = []
    for index, joint in enumerate(scene.joints):
        kind, more = _KINDS[joint["kind"]]
        ends = {"a": names[joint["a"]], "b": names[joint["b"]]}
        more = {**more, **limits.get(index, {})}
        joints.append({"axis": None, **joint, **ends, "kind": kind, "more": more})
    slops: dict[str, Any] = {
        "linearSlop": options.linear_slop,
        "angularSlop": options.angular_slop,
    }
    return node_program(
        __name__,
        scene,
        problem,
        options.timestep,
        binary=binary,
        options=options,
        slops={name: value for name, value in slops.items() if value != OWN_SLOPS[name]},
        gravity=np.array(scene.mechanism.gravity_vector) * MIRROR + 0.0,
        moves_mass=bool(spread.moved),
        joints=joints,
        limited=[*limits],
    )
