"""Brax by itself: the run is the program that :func:`program` writes, executed here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from trebucheck.engines.events import whole_steps
from trebucheck.engines.inspection import Dynamics, Inspection, State
from trebucheck.engines.protocol import Recording
from trebucheck.engines.reading import timed_reading
from trebucheck.engines.study import filled_template
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import Problem
from trebucheck_toolkit.alone import BodySteps
from trebucheck_toolkit.jax_on_cpu import keep_compiled, without_words_on_warp
from trebucheck_toolkit.node_scene import MIRROR, NodeScene

from .build import Plan

_OPENING = 1e-3
"""Gap of a stop that is open for good [rad]: soft limits bounce by less while they settle."""


def program(problem: Problem, plan: Plan) -> str:
    """The program of a run."""
    mechanism, freedoms = plan.mechanism, plan.coordinates.freedoms
    places = [freedom.index for freedom in freedoms]
    turning = [body.name for body in mechanism.bodies if body.angle is not None]
    return filled_template(
        __name__,
        "alone.py.j2",
        plan=plan,
        options=plan.options,
        steps=whole_steps(problem.duration, plan.options.timestep),
        links=[plan.carrier(body) for body in turning],
        slides=[places.index(k) for k in range(len(turning), len(mechanism.coordinates))],
    )


def _executed(problem: Problem, plan: Plan) -> dict[str, Any]:
    """Names of the program of a run, after it."""
    with without_words_on_warp():
        import jax
        from brax.io import mjcf  # pyright: ignore # noqa: F401 - it prints where it is imported
    keep_compiled(jax)
    found: dict[str, Any] = {}
    exec(program(problem, plan), found)
    return found


def run_alone(problem: Problem, options: Any) -> Recording:
    """Step Brax from the start to a problem's end or just beyond, and read its links.

    Raises:
        UnsupportedProblemError: the mechanism has a part that the adapter builds no element for.
    """
    plan = Plan(problem, options)
    return _recording(problem, plan, _executed(problem, plan))


@timed_reading()
def _recording(problem: Problem, plan: Plan, found: dict[str, Any]) -> Recording:
    scene, t = NodeScene(plan.spread.mechanism, "brax"), found["t"]
    states = np.zeros((len(t), len(scene.bodies), 6))
    for index, body in enumerate(scene.mechanism.bodies):
        link, place = plan.carrier(body.name), np.array(scene.bodies[index]["position"])
        states[:, index, :2] = place
        if link >= 0:
            origin, turn, spin = (found[name][:, link] for name in ("places", "turns", "turning"))
            arm = np.exp(-1j * turn) * complex(*(place * MIRROR - origin[0]))
            moved = np.stack([arm.real, arm.imag], axis=-1)
            across = spin[:, None] * np.stack([arm.imag, -arm.real], axis=-1)
            states[:, index, :2] = (origin + moved) * MIRROR
            states[:, index, 3:5] = (found["velocities"][:, link] + across) * MIRROR
            states[:, index, 2], states[:, index, 5] = turn, spin
    told = np.asarray(found["limit_forces"], dtype=np.float64) * plan.unit
    torques = {
        name: np.maximum(0.0, sense * told[:, index])
        for name, (index, sense) in plan.places.items()
        if plan.options.capabilities.stop_torques
    }
    tells = torques or plan.options.capabilities.stop_torques
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


def inspect(mechanism: Mechanism, states: Sequence[State], options: Any) -> Inspection:
    """Mass matrix and forces of `generalized`; accelerations follow, with closed stops at rest."""
    problem = Problem(mechanism, duration=options.timestep)
    plan = Plan(problem, options)
    found, to = _executed(problem, plan), plan.coordinates
    system = found["system"]
    import jax
    from brax.actuator import to_tau
    from brax.generalized import dynamics, pipeline

    @jax.jit
    def look(q: Any, qd: Any) -> tuple[Any, Any]:
        state = pipeline.init(system, q, qd)
        tau = to_tau(system, found["control"](state), q, qd)
        return state.mass_mx, dynamics.forward(system, state, tau)

    def seen(state: State) -> Dynamics:
        j = to.positions(state.q) - to.positions(plan.start)
        mass, forces = (np.asarray(each) * plan.unit for each in look(j, to.speeds(state.u)))
        rows = np.zeros((len(state.closed), len(j)))
        for row, name in zip(rows, state.closed, strict=True):
            row[plan.places[name][0]] = plan.places[name][1]
        pushes = -np.linalg.solve(
            rows @ np.linalg.solve(mass, rows.T), rows @ np.linalg.solve(mass, forces)
        )
        a = np.linalg.solve(mass, forces + rows.T @ pushes)
        return Dynamics(
            accelerations=to.mechanism_speeds(a),
            stop_torques=dict(zip(state.closed, pushes.tolist(), strict=True)),
            mass_matrix=to.mass_matrix(mass),
            forces=np.linalg.solve(to.sums.T, forces),
        )

    return Inspection(found["q"][0], found["u"][0], tuple(map(seen, states)))
