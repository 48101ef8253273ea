"""MuJoCo by itself: its model, its step from start to end, and what is read of it.

The whole model is MJCF; an option that is MuJoCo's default is not written. :func:`script` gives the
same run as a program that needs MuJoCo and NumPy alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.mechanism import Mechanism
from ...models.mjcf.elements import felt_from
from ...models.mjcf.variants import Numerics, Variant
from ...models.mjcf.writer import mjcf
from ...models.problem import Problem
from .. import study
from ..events import ContactEvents, note_own_releases, whole_steps
from ..protocol import Recording
from ..reading import timed_reading
from .build import compiled, controls_of, recorded_actuators, start_data, stop_constraints
from .compat import mujoco
from .motion import STATE, raised_warnings, rollout
from .options import MujocoOptions, scaled_solref
from .read import Samples, absolute_from_relative, recording

# MuJoCo's own defaults, which a file of the default preset leaves out.
_DEFAULTS = Numerics(
    timestep=2e-3,
    integrator="Euler",
    solver="Newton",
    tolerance=1e-8,
    iterations=100,
    solref=(0.02, 1.0),
    solref_of_points=(0.02, 1.0),
    solimp=(0.9, 0.95, 0.001, 0.5, 2.0),
    margin=0.0,
)


def run_alone(problem: Problem, options: MujocoOptions) -> Recording:
    """Step MuJoCo from the start to a problem's end or just beyond, and read the states.

    Raises:
        SimulationError: MuJoCo refused the model, or warned that it diverged.
        UnsupportedProblemError: the mechanism cannot be written as MJCF.
    """
    mechanism = problem.mechanism
    model = compiled(mechanism, model_text(mechanism, options))
    data = start_data(model)
    steps = whole_steps(problem.duration, options.timestep)
    before = np.empty(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, data, before, STATE)
    times = options.timestep * np.arange(steps + 1, dtype=np.float64)
    records = recorded_actuators(mechanism, model)
    controls = controls_of(records, model, times, options.timestep)
    with raised_warnings():
        # Its sensors are those before each step.
        held = None if controls is None else controls[None, :-1]
        states, sensors = rollout(model, data, before[None], held, nstep=steps)
        with timed_reading():
            mujoco.mj_setState(model, data, states[0, -1], STATE)
            if controls is not None:
                data.ctrl[:] = controls[-1]
            mujoco.mj_forward(model, data)
            states = np.concatenate([before[None], states[0]])
            sensors = np.concatenate([sensors[0], data.sensordata[None]])
    return recorded("mujoco", mechanism, model, states, sensors)


@timed_reading()
def recorded(
    engine: str, mechanism: Mechanism, model: Any, states: FloatArray, sensors: FloatArray
) -> Recording:
    """Record states, of MuJoCo's layout, at the start and after each step, and sensors there."""
    steps = len(states) - 1
    times: FloatArray = float(model.opt.timestep) * np.arange(steps + 1, dtype=np.float64)
    samples, events = Samples(steps=steps), ContactEvents(mechanism, engine)
    samples.add(times, states, sensors)
    found = recording(mechanism, model, stop_constraints(mechanism, model), samples, events)
    note_own_releases(events, times, found.stop_torques)
    return found


def model_text(mechanism: Mechanism, options: MujocoOptions, *, sensors: bool = True) -> str:
    """The mechanism as MJCF, with those options that are not MuJoCo's defaults."""
    stiffness = scaled_solref(options.timestep, options.integrator)
    numerics = Numerics(
        timestep=options.timestep,
        integrator=options.integrator,
        solver=options.solver,
        tolerance=options.tolerance,
        iterations=options.iterations,
        solref=options.solref or stiffness,
        solref_of_points=options.solref or stiffness,
        solimp=options.solimp,
        margin=options.margin,
        # Without a margin a slot that closes a loop has play, as each of its sides is pressed in.
        margin_of_slots=felt_from(mechanism, options.timestep) if options.margin else None,
    )
    changed = {
        name: value for name, value in vars(numerics).items() if value != getattr(_DEFAULTS, name)
    }
    variant = Variant(numerics=Numerics(**changed), sensors=sensors)
    return mjcf(mechanism, options.timestep, variant=variant)


def script(problem: Problem, options: MujocoOptions) -> str:
    """The run of :func:`run_alone` as a program of its own."""
    mechanism = problem.mechanism
    text = model_text(mechanism, options)
    model, instants = compiled(mechanism, text), np.array([0.0, *mechanism.instants])
    sums = absolute_from_relative(mechanism, model)
    controls = controls_of(recorded_actuators(mechanism, model), model, instants, options.timestep)
    return study.filled_template(
        __name__,
        "alone.py.j2",
        mjcf=text,
        instants=instants.tolist(),
        controls=None if controls is None else controls.tolist(),
        steps=whole_steps(problem.duration, options.timestep),
        start=mechanism.start,
        sums=sums.tolist(),
    )
