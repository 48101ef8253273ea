"""MJCF of machines, problems and mechanisms, events of the certified motion as keyframes."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..models.errors import InputError, SimulationError
from ..models.library.registry import Model, model_of, named_parameters
from ..models.mechanism import Mechanism
from ..models.mjcf import as_spec as spec_of
from ..models.mjcf import writer
from ..models.mjcf.scene import Keyframe, RecordedMotion, event_names, stored_motion
from ..models.mjcf.variants import Variant
from ..models.problem import Problem, mechanism_of
from .runs.runner import Runner, motion_of

__path__: list[str] = []  # names of earlier releases below this module: see renamed.py

_PATH = 60  # intervals of the path
_DIGITS = 4  # of the path's coordinates: enough for a picture
LONGEST_STEP = 1e-3  # [s] of MuJoCo, where none is asked for; the named machines have it
_STEP = 0.01  # of the characteristic time
_MOST = 100  # events: what bounces to rest has no end of them


def recorded(runner: Runner) -> RecordedMotion:
    """Events of a reference motion up to the predictability horizon: behind it none is certain.

    Raises:
        InputError: the reference cannot begin.
        SimulationError: the reference cannot move the mechanism.
    """
    solution, end = runner.solution, min(runner.end, runner.judged_to)
    # Times [s], stops and what becomes of them; of the launch, no stop
    events = [(t, stop, "release") for stop, t in solution.release_times.items() if t is not None]
    for time, impulses in solution.impacts:
        events += [(time, stop, "impact") for stop, impulse in impulses.items() if impulse]
    for stop, times in solution.rest_times.items():
        events += [(time, stop, "rest") for time in times]
    if runner.launch_time is not None:
        events.append((runner.launch_time, "", "launch"))
    events = sorted(event for event in events if event[0] <= end)[:_MOST]
    names = event_names([(stop, what) for _, stop, what in events])
    at = solution.motion(np.array([time for time, *_ in events]))
    path = solution.motion(np.linspace(0.0, end, _PATH + 1)).q
    return RecordedMotion(
        mechanism_hash=runner.mechanism.content_hash,
        keyframes=tuple(
            Keyframe(name=name, time=event[0], q=tuple(q), u=tuple(u))
            for name, event, q, u in zip(names, events, at.q.tolist(), at.u.tolist(), strict=True)
        ),
        path=tuple(tuple(round(value, _DIGITS) for value in q) for q in path.tolist()),
    )


def mjcf(
    given: Model,
    *,
    timestep: float | None = None,
    keyframes: bool = True,
    sensors: bool = True,
    finite_inertia: bool = False,
    throw: bool = False,
    as_spec: bool = False,
    **parameters: float,
) -> Any:
    """The MJCF of a machine, of a problem of the library, or of any mechanism.

    >>> text = tb.mjcf("rolling", l1=9.5)  # doctest: +SKIP
    >>> mujoco.MjModel.from_xml_string(text)  # doctest: +SKIP

    Args:
        given: name of a machine or of a problem of the library, path of a mechanism's .json file, a
            mechanism, or a problem.
        timestep: of MuJoCo's integrator [s]; the stiffness of stops and loops is scaled with it. If
            left out it is a hundredth of the motion's characteristic time, but 1 ms at most; 1 ms
            as well where the reference cannot move it.
        keyframes: whether the reference is solved for a keyframe at each release, impact and rest,
            and at the launch; `home`, the start, is always there.
        sensors: whether sensors are written; without them older versions of MuJoCo read it.
        finite_inertia: give point masses on pins an inertia, for importers that refuse or raise
            small ones. Mass is moved across the pins, so that the equations of motion stay what
            they are; the forces in these pins do not, and of a pin on the ground the total mass
            grows. The third point mass of a chain stays one.
        throw: make the projectile a body of its own, tied to the machine by the equality
            `hold_projectile`; until that is switched off the machine moves as without it. A
            millionth of its mass is tied, the rest stays in the machine;
            `trebucheck.models.mjcf.throw.released(model, data)` switches it off and hands the mass
            over, `throw(model, data)` there steps to the landing.
        as_spec: give a `mujoco.MjSpec` instead of text.
        parameters: of a named machine or problem; their defaults where left out.

    Raises:
        InputError: nothing has that name, a parameter is not one of its, or the time step is not
        valid.
        UnsupportedProblemError: MJCF cannot hold it.
        SimulationError: the reference cannot move it; without keyframes it is written all the same.
        EngineNotInstalledError: MuJoCo is not there, for `as_spec`.
    """
    model = model_of(given, named_parameters(given, parameters))
    variant = Variant(sensors=sensors, finite_inertia=finite_inertia, throw=throw)
    step, motion = step_and_motion(model, timestep, keyframes=keyframes)
    text = writer.mjcf(mechanism_of(model), step, motion, variant)
    return spec_of(text) if as_spec else text


def step_and_motion(
    given: Mechanism | Problem, timestep: float | None, *, keyframes: bool
) -> tuple[float, RecordedMotion | None]:
    """Choose the step [s], given or suited to the motion, and the motion if keyframes are wanted.

    The motion is the stored one of exactly this mechanism, or else a new one.

    Raises:
        InputError: the reference cannot begin, and there are to be keyframes.
        SimulationError: as well, it cannot move it.
    """
    stored = stored_motion(given) if isinstance(given, Mechanism) else None
    if stored or (timestep is not None and not keyframes):
        return LONGEST_STEP if timestep is None else timestep, stored if keyframes else None
    runner, step = motion_of(given), timestep
    try:
        if step is None:
            # Two digits of a part of the characteristic time
            step = min(LONGEST_STEP, float(f"{_STEP * runner.scales.time:.1e}"))
    except (InputError, SimulationError):
        if keyframes:
            raise
        step = LONGEST_STEP
    return step, recorded(runner) if keyframes else None
