"""MJX by itself: its model, its step from start to end, and what is read of it.

The model is the MJCF of MuJoCo by itself (:mod:`trebucheck.engines.mujoco.alone`): stops on angles
are limits, stops on points contacts, loops equalities and contacts, springs tendons. MJX moves it
without sensors; those that it has are read afterwards, in all states of a chunk at once.

What JAX compiles takes some ten seconds a model, however short the run. So it is compiled for
:data:`CHUNK` steps, not for as many as a run has, and is kept for the next run of the same model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from time import process_time
from typing import Any

import numpy as np
from trebucheck.engines.events import ContactEvents, note_own_releases, whole_steps
from trebucheck.engines.given import SteppedModel
from trebucheck.engines.mujoco.alone import model_text
from trebucheck.engines.mujoco.build import Limit, compiled, stop_constraints
from trebucheck.engines.mujoco.options import MujocoOptions
from trebucheck.engines.mujoco.read import IN_PLANE, absolute_from_relative
from trebucheck.engines.protocol import Recording
from trebucheck.engines.reading import timed_reading
from trebucheck.models.applied_forces import AppliedForces
from trebucheck.models.arrays import FloatArray
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.mjcf.writer import mjcf_names, position_sensor, velocity_sensor
from trebucheck.models.problem import Problem
from trebucheck.models.trajectory import PointMotion
from trebucheck_toolkit.constrained import subtree_sums

from .build import (
    KEPT,
    Given,
    jax,
    mjx,
    mujoco,
    of_a_step,
    on_device,
    use_precision,
    without_sensors,
)

CHUNK = 100
"""Steps, and readings, of one call of what is compiled."""


@dataclass(frozen=True)
class Seen:
    """Readings in n states."""

    mass: FloatArray
    """Full mass matrix, shape (n, n_v, n_v)."""
    rows: FloatArray
    """Forces of the constraint rows: equalities, limits of joints, of tendons, contacts (n, m)."""
    geoms: FloatArray
    """The two geoms of each contact, shape (n, n_contact, 2)."""
    sensors: FloatArray
    centres: FloatArray
    """World positions of the bodies' centres of mass [m], shape (n, n_body, 3)."""
    internal: FloatArray
    """Force of each body's parent on it, world frame [N], shape (n, n_body, 3)."""


def run_alone(problem: Problem, options: MujocoOptions, *, double: bool) -> Recording:
    """Step MJX from the start to a problem's end or just beyond, and read the states.

    Raises:
        SimulationError: MuJoCo refused the model.
        NotImplementedError: MJX has not what the model needs; its own words.
    """
    mechanism, steps = problem.mechanism, whole_steps(problem.duration, options.timestep)
    use_precision(double=double)
    bare, sensing = (
        Given(model_text(mechanism, options, sensors=sensors), double, mechanism)
        for sensors in (False, True)
    )
    return _recording(problem, options, sensing, _moved(bare, steps))


@timed_reading()
def _recording(
    problem: Problem, options: MujocoOptions, given: Given, states: tuple[FloatArray, ...]
) -> Recording:
    """Read the states after each step, as :func:`_moved` gives them, in a model with sensors."""
    mechanism, (positions, speeds, _) = problem.mechanism, states
    steps = len(positions) - 1
    looks, model = _looks(given), compiled(mechanism, given.text)
    sums, sensing = absolute_from_relative(mechanism, model), looks.model
    q, u = np.array(mechanism.start) + positions @ sums.T, speeds @ sums.T
    times: FloatArray = options.timestep * np.arange(steps + 1, dtype=np.float64)

    seen = _seen(looks, states)
    torques = _torques(mechanism, model, seen, positions)
    names, applied = mjcf_names(mechanism), AppliedForces(Kinematics(mechanism))

    def sensor(name: str) -> FloatArray:
        start = int(sensing.sensor(names[name]).adr[0])
        return seen.sensors[:, start : start + 3][:, IN_PLANE]

    weight = sensing.body_mass[:, None] * sensing.opt.gravity
    events = ContactEvents(mechanism, "mjx")
    note_own_releases(events, times, torques)
    return Recording(
        t=times,
        q=q,
        u=u,
        markers={
            m.name: PointMotion(sensor(position_sensor(m.name)), sensor(velocity_sensor(m.name)))
            for m in mechanism.markers
        },
        kinetic_energy=0.5 * np.einsum("ni,nij,nj->n", speeds, seen.mass, speeds),
        potential_energy=applied.potential_energy(q) - np.einsum("ij,nij->n", weight, seen.centres),
        stop_torques=torques,
        release_times=events.releases,
        joint_reactions=_reactions(mechanism, sensing, seen, applied.on_bodies(q, u)),
        steps=steps,
    )


class _Steps:
    """MJX's steps of a model from its start, compiled.

    Raises:
        SimulationError: MuJoCo refused the model.
        NotImplementedError: MJX has not what the model needs; its own words.
    """

    def __init__(self, given: Given) -> None:
        model = compiled(given.mechanism, given.text)
        mjx_model, data = on_device(model)
        of_start = model.key_qpos[0], model.key_qvel[0], data.qacc_warmstart
        self.first = tuple(np.array(each, dtype=np.float64) for each in of_start)
        """States at the start, as :func:`_moved` gives them."""
        self.data = of_a_step(mjx_model, data)

        def step(data: Any, _: None) -> tuple[Any, tuple[Any, Any, Any]]:
            data = mjx.step(mjx_model, data)
            return data, (data.qpos, data.qvel, data.qacc_warmstart)

        self.advance: Any = jax.jit(lambda data: jax.lax.scan(step, data, length=CHUNK))
        """Data and states after :data:`CHUNK` more steps."""


def stepped(model: Any, start: Any, controls: FloatArray, *, double: bool) -> SteppedModel:
    """Step a model as a file has it; it bears on a contact where its distance is below the margin.

    Raises:
        NotImplementedError: MJX has not what the model needs; its own words.
    """
    if model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP:  # it takes it, and none sleeps
        raise NotImplementedError("the flag sleep")
    use_precision(double=double)
    mjx_model, data = on_device(model, start)
    data, steps = of_a_step(mjx_model, data), len(controls)
    # What is compiled has CHUNK steps: those beyond the end are not read.
    padded = np.pad(controls, ((0, -steps % CHUNK), (0, 0)), mode="edge").astype(data.ctrl.dtype)
    jax.block_until_ready(_advance(mjx_model, data, padded[:CHUNK]))  # compiles
    chunks, began = list[Any](), process_time()
    for first in range(0, steps, CHUNK):
        data, chunk = _advance(mjx_model, data, padded[first : first + CHUNK])
        chunks.append(chunk)
    jax.block_until_ready(chunks)
    spent = process_time() - began
    qpos, qvel, touches = (np.concatenate(each)[:steps] for each in zip(*chunks, strict=True))
    return SteppedModel(
        np.vstack([start.qpos, qpos]),
        np.vstack([start.qvel, qvel]),
        int(np.argmax(touches)) if touches.any() else None,
        spent,
    )


@jax.jit
def _advance(mjx_model: Any, data: Any, controls: Any) -> Any:
    """Data after a step for each row of controls, and after each the state and whether it touches.

    The model is an argument: at another time step, or stiffer, it is the same program.
    """

    def step(data: Any, control: Any) -> tuple[Any, tuple[Any, Any, Any]]:
        data = mjx.step(mjx_model, data.replace(ctrl=control))
        contact = data._impl.contact
        return data, (data.qpos, data.qvel, (contact.dist < contact.includemargin).any())

    return jax.lax.scan(step, data, controls)


class _Looks:
    """MJX's readings of a model, compiled.

    Raises:
        NotImplementedError: MJX has not what the model needs; its own words.
    """

    def __init__(self, given: Given) -> None:
        self.model = without_sensors(given.text)
        mjx_model, data = on_device(self.model)
        self.number = data.qpos.dtype

        def look(position: Any, speed: Any, warm: Any) -> tuple[Any, ...]:
            placed = data.replace(qpos=position, qvel=speed, qacc_warmstart=warm)
            seen = mjx.forward(mjx_model, placed)
            # `forward` leaves internal forces, and with them force sensors, at zero.
            internal = mjx.rne_postconstraint(mjx_model, seen)._impl.cfrc_int[:, 3:]
            of_rows = seen._impl.efc_force, seen._impl.contact.geom
            mass = mjx.full_m(mjx_model, seen)
            return mass, *of_rows, seen.sensordata, seen.xipos, internal

        self.look: Any = jax.jit(jax.vmap(look))
        """Readings of :data:`CHUNK` states."""


_steps, _looks = lru_cache(KEPT)(_Steps), lru_cache(KEPT)(_Looks)


def _moved(given: Given, steps: int) -> tuple[FloatArray, ...]:
    """Positions and speeds of MuJoCo's joints at the start and after each step.

    With them the accelerations that the solver of the step that begins there starts from.
    """
    made, chunks = _steps(given), list[tuple[Any, ...]]()
    data = made.data
    for _ in range(0, steps, CHUNK):
        data, chunk = made.advance(data)
        chunks.append(chunk)
    return tuple(
        np.concatenate([first[None], *(np.asarray(each, np.float64) for each in found)])[
            : steps + 1
        ]
        for first, *found in zip(made.first, *chunks, strict=True)
    )


def _seen(looks: _Looks, states: tuple[FloatArray, ...]) -> Seen:
    """Readings in the states of a run, each as the step that begins there computes it."""
    n = len(states[0])
    found: list[tuple[Any, ...]] = []
    for start in range(0, n, CHUNK):
        rows = np.minimum(np.arange(start, start + CHUNK), n - 1)
        found.append(looks.look(*(each[rows].astype(looks.number) for each in states)))
    return Seen(
        *(
            np.concatenate([np.asarray(each, dtype=np.float64) for each in of_chunks])[:n]
            for of_chunks in zip(*found, strict=True)
        )
    )


def _torques(
    mechanism: Mechanism, model: Any, seen: Seen, positions: FloatArray
) -> dict[str, FloatArray]:
    """Torque or force of each stop [N m, N], from the row of its limit or contact.

    MJX has a row for each limit and contact of the model, also where it does not act.
    """
    limited = {
        "jnt": np.flatnonzero(model.jnt_limited).tolist(),
        "tendon": np.flatnonzero(model.tendon_limited).tolist(),
    }
    contacts = [frozenset(pair) for pair in seen.geoms[0].astype(int).tolist()]
    first_contact = seen.rows.shape[1] - len(contacts)
    first = {"tendon": first_contact - len(limited["tendon"])}
    first["jnt"] = first["tendon"] - len(limited["jnt"])
    torques = dict[str, FloatArray]()
    for name, stop in stop_constraints(mechanism, model).items():
        if isinstance(stop, Limit):
            row = first[stop.element] + limited[stop.element].index(stop.index)
        else:
            row = first_contact + contacts.index(frozenset(stop.geoms))
        torques[name] = stop.torque(seen.rows[:, row], positions)
    return torques


def _reactions(
    mechanism: Mechanism, model: Any, seen: Seen, applied: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Force of each joint on its child [N], without what springs do to the bodies beyond it.

    A joint that closes a loop is on a massless body welded to its child: the internal force there
    is the opposite of the joint's.
    """
    names = mjcf_names(mechanism)

    def internal(body: str) -> FloatArray:
        return seen.internal[:, int(model.body(names[body]).id)][:, IN_PLANE]

    beyond = subtree_sums(mechanism, applied)
    reactions = {
        joint.name: internal(joint.child) - beyond[joint.name]
        for joint in mechanism.tree_joints
        if joint.held_directions
    }
    of_loops = {joint.name: -internal(f"{joint.name}/point") for joint in mechanism.loop_joints}
    return reactions | of_loops
