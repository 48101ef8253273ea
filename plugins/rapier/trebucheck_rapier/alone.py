"""Rapier by itself: its own joints and limits, its own step from start to end.

A body is a dynamic body with additional mass properties, a pin a revolute joint, a slider a
prismatic joint, a weld a fixed joint, all of them impulse joints. A stop is the limit of a revolute
joint, set once, and stays there for the whole run; those that a release-once law leaves out are
left out. Springs, dampers and motors are forces and torques that are given to the bodies before
each step.

The run is the program that :func:`script` writes, which Node.js runs; see
:mod:`trebucheck_toolkit.node_program` for how to do so and what it prints.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from trebucheck.engines.point_masses import NoPointMasses, spread_masses
from trebucheck.engines.protocol import Recording
from trebucheck.models.problem import Problem
from trebucheck_toolkit.alone import BodySteps
from trebucheck_toolkit.gap_releases import OPENING, releases
from trebucheck_toolkit.node_program import node_program
from trebucheck_toolkit.node_scene import MIRROR, Json, joint_limits

from .bridge import RAPIER
from .build import Built
from .options import OWN, RapierOptions


def run_alone(problem: Problem, options: RapierOptions) -> Recording:
    """Step Rapier from the start to a problem's end or just beyond, and read its bodies.

    Raises:
        UnsupportedProblemError: the mechanism has a part that the adapter builds no element for.
    """
    spread, built = _built(problem, options)
    arrays = RAPIER.arrays(_program(problem, options, spread, built, binary=True))
    steps = BodySteps(problem, built, spread, arrays["t"], arrays["states"])
    recording = steps.recording(arrays["q"], arrays["u"])
    return replace(recording, release_times=releases(steps.samples, options.opening or OPENING))


def script(problem: Problem, options: RapierOptions) -> str:
    """The program of a run.

    Raises:
        UnsupportedProblemError: the mechanism has a part that the adapter builds no element for.
    """
    return _program(problem, options, *_built(problem, options))


def _built(problem: Problem, options: RapierOptions) -> tuple[NoPointMasses, Built]:
    spread = spread_masses(problem.mechanism, options.least_inertia, "rapier")
    return spread, Built(spread.mechanism, options.carriage)


def _program(
    problem: Problem,
    options: RapierOptions,
    spread: NoPointMasses,
    built: Built,
    *,
    binary: bool = False,
) -> str:
    limits, joints = joint_limits(problem, built, within_half_a_turn=True), list[Json]()
    names = {index: name for name, index in built.index.items()}
    for index, joint in enumerate(built.joints):
        ends: Json = {"a": names[joint["a"]], "b": names[joint["b"]], "limits": None}
        if index in limits:
            low, high = limits[index]
            ends["limits"] = (
                -math.pi if low is None else low,
                math.pi if high is None else high,
            )
        joints.append({**ends, "call": _call(joint)})
    return node_program(
        __name__,
        built,
        problem,
        options.timestep,
        binary=binary,
        options=options,
        own=OWN,
        gravity=np.array(built.mechanism.gravity_vector) * MIRROR + 0.0,
        moves_mass=bool(spread.moved),
        joints=joints,
    )


def _call(joint: Json) -> str:
    """The call of a joint's data."""

    def vector(name: str) -> str:
        x, y = (value + 0.0 for value in joint[name])
        return f"{{ x: {x!r}, y: {y!r} }}"

    first, second = vector("pointA"), vector("pointB")
    return {
        "pin": lambda: f"R.JointData.revolute({first}, {second})",
        "slide": lambda: f"R.JointData.prismatic({first}, {second}, {vector('axis')})",
        "weld": lambda: f"R.JointData.fixed({first}, 0, {second}, 0)",
    }[joint["kind"]]()
