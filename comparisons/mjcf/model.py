"""`tb.mjcf`: the MJCF of whatever has a name here, or of a mechanism, with its events as keyframes."""

from __future__ import annotations

from typing import Any

from ...models.errors import InputError, SimulationError
from ...models.machines.registry import library_problem, model, parameters_type
from ...models.mechanism import Mechanism
from ...models.mjcf import writer
from ...models.mjcf.paths import as_spec as spec_of
from ...models.mjcf.recorded import RecordedMotion, stored_motion
from ...models.mjcf.variants import Variant
from ...models.problem import Problem
from .events import LONGEST_STEP, motion_of, recorded, suitable_step


def mjcf(
    given: str | Mechanism | Problem,
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
        given: name of a machine or problem, a mechanism, or a problem.
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
    found = _named(given, parameters) if isinstance(given, str) else given
    if parameters and not isinstance(given, str):
        raise InputError(
            f"{', '.join(parameters)}: only what has a name has parameters; this is a mechanism as it is."
        )
    mechanism = found.mechanism if isinstance(found, Problem) else found
    variant = Variant(sensors=sensors, finite_inertia=finite_inertia, throw=throw)
    step, motion = step_and_motion(found, timestep, keyframes=keyframes)
    text = writer.mjcf(mechanism, step, motion, variant)
    return spec_of(text) if as_spec else text


def step_and_motion(
    given: Mechanism | Problem, timestep: float | None, *, keyframes: bool
) -> tuple[float, RecordedMotion | None]:
    """The step [s], one that suits the motion if none is given, and the motion if there are to be keyframes.

    The motion is the stored one of exactly this mechanism, or else a new one.

    Raises:
        InputError: the reference cannot begin, and there are to be keyframes.
        SimulationError: as well, it cannot move it.
    """
    stored = stored_motion(given) if isinstance(given, Mechanism) else None
    if stored or (timestep is not None and not keyframes):
        return LONGEST_STEP if timestep is None else timestep, stored if keyframes else None
    runner = motion_of(given)
    if keyframes:
        return suitable_step(runner) if timestep is None else timestep, recorded(runner)
    try:
        return suitable_step(runner), None
    except (InputError, SimulationError):
        return LONGEST_STEP, None


def _named(name: str, parameters: dict[str, float]) -> Mechanism | Problem:
    given = parameters_type(name)(**parameters)
    return library_problem(name, given) or model(name, given)
