"""Brax by itself: the run is the program that :func:`script` writes, executed here."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from trebucheck.engines.events import whole_steps
from trebucheck.engines.protocol import Recording
from trebucheck.engines.reading import timed_reading
from trebucheck.engines.study import filled_template
from trebucheck.models.arrays import FloatArray
from trebucheck.models.problem import Problem
from trebucheck_toolkit.alone import BodySteps
from trebucheck_toolkit.jax_on_cpu import keep_compiled, without_words_on_warp
from trebucheck_toolkit.node_scene import MIRROR, NodeScene

from .build import Plan

_OPENING = 1e-3
"""Gap of a stop that is open for good [rad]: soft limits bounce by less while they settle."""


def run_alone(problem: Problem, options: Any) -> Recording:
    """Step Brax from the start to a problem's end or just beyond, and read its bodies.

    Raises:
        UnsupportedProblemError: the mechanism has a part that the adapter builds no element for.
    """
    plan, found = Plan(problem, options), dict[str, Any]()
    with without_words_on_warp():
        import brax.io.mjcf  # pyright: ignore[reportMissingImports, reportUnusedImport] # noqa: F401
        import jax
    keep_compiled(jax)
    exec(_program(problem, plan), found)
    return _recording(problem, plan, found)


def script(problem: Problem, options: Any) -> str:
    """The program of a run.

    Raises:
        UnsupportedProblemError: the mechanism has a part that the adapter builds no element for.
    """
    return _program(problem, Plan(problem, options))


def _program(problem: Problem, plan: Plan) -> str:
    mechanism, freedoms = plan.mechanism, plan.coordinates.freedoms
    places = [freedom.index for freedom in freedoms]
    turning = [body.name for body in mechanism.bodies if body.angle is not None]
    return filled_template(
        __name__,
        "alone.py.j2",
        plan=plan,
        options=plan.options,
        steps=whole_steps(problem.duration, plan.options.timestep),
        moves_mass=bool(plan.spread.moved),
        start=mechanism.start,
        sums=plan.coordinates.sums.tolist(),
        links=[plan.carrier(body) for body in turning],
        slides=[places.index(k) for k in range(len(turning), len(mechanism.coordinates))],
    )


@timed_reading()
def _recording(problem: Problem, plan: Plan, found: dict[str, Any]) -> Recording:
    scene = NodeScene(plan.spread.mechanism, "brax")
    t: FloatArray = found["t"]
    states = np.zeros((len(t), len(scene.bodies), 6))
    for index, body in enumerate(scene.mechanism.bodies):
        link, place = plan.carrier(body.name), np.array(scene.bodies[index]["position"])
        states[:, index, :2] = place
        if link is not None:
            origin, turn, spin = (found[name][:, link] for name in ("places", "turns", "turning"))
            x, y = place * MIRROR - origin[0]
            arm = np.exp(-1j * turn) * (x + 1j * y)
            states[:, index, 0] = origin[:, 0] + arm.real
            states[:, index, 1] = -origin[:, 1] - arm.imag
            states[:, index, 2] = turn
            states[:, index, 3:5] = found["velocities"][:, link] * MIRROR
            states[:, index, 3:5] += spin[:, None] * np.stack([arm.imag, arm.real], axis=-1)
            states[:, index, 5] = spin
    forces = np.asarray(found["limit_forces"], dtype=np.float64) * plan.unit
    torques = {
        name: np.maximum(0.0, sense * forces[:, index])
        for name, (index, sense) in plan.places.items()
    }
    tells = plan.options.capabilities.stop_torques
    steps = BodySteps(
        problem, scene, plan.spread, t, states, torques=torques if tells else None, slop=_OPENING
    )
    recording = steps.recording(found["q"], found["u"])
    if tells:
        return recording
    closed = [stop for stop in plan.mechanism.stops if stop.closed]
    opened = {stop.name: t[steps.samples.gap(stop) > _OPENING] for stop in closed}
    times = {name: float(after[0]) if len(after) else None for name, after in opened.items()}
    return replace(recording, release_times=times)
